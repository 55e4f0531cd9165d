//! The machine's graphics adapter.

use wgpu::{Backends, DeviceType, Instance, InstanceDescriptor};

use super::GpuError;

/// Describes the graphics adapter, for people and for choosing a renderer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterSummary {
    /// The name from the driver.
    pub name: String,
    /// The interface: `vulkan` or `gl`.
    pub interface: String,
    /// The driver and its version.
    pub driver: String,
    /// Whether it is software, such as Mesa's lavapipe; the CPU renderers of this crate are faster.
    pub is_software: bool,
}

impl AdapterSummary {
    /// Name, interface and driver in one line of at most 200 printable ASCII letters, for headers.
    pub fn line(&self) -> String {
        let text = format!("{} ({}, {})", self.name, self.interface, self.driver);
        let printable = |letter: char| {
            if matches!(letter, ' '..='~') {
                letter
            } else {
                '?'
            }
        };
        text.chars().take(200).map(printable).collect()
    }
}

/// An adapter, found once; each thread opens a device on it.
#[derive(Debug, Clone)]
pub(super) struct Adapter(wgpu::Adapter);

impl Adapter {
    /// Finds an adapter: Vulkan, in software if there is no other; otherwise a GPU with OpenGL.
    ///
    /// Software OpenGL is not used, because the CPU renderers are faster.
    pub(super) fn find() -> Result<Self, GpuError> {
        request(Backends::VULKAN).or_else(|reason| {
            request(Backends::GL)
                .ok()
                .filter(|adapter| adapter.0.get_info().device_type != DeviceType::Cpu)
                .ok_or(reason)
        })
    }

    pub(super) fn wgpu(&self) -> &wgpu::Adapter {
        &self.0
    }

    pub(super) fn summary(&self) -> AdapterSummary {
        let info = self.0.get_info();
        AdapterSummary {
            interface: info.backend.to_string(),
            driver: format!("{} {}", info.driver, info.driver_info)
                .trim()
                .to_owned(),
            is_software: info.device_type == DeviceType::Cpu,
            name: info.name,
        }
    }
}

fn request(backends: Backends) -> Result<Adapter, GpuError> {
    let instance = Instance::new(InstanceDescriptor {
        backends,
        ..InstanceDescriptor::new_without_display_handle()
    });
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    let found = pollster::block_on(instance.request_adapter(&options));
    // The driver stays loaded until the process ends. NVIDIA's leaves a destructor with each thread that has called it; once the driver
    // is unloaded, the process crashes when such a thread ends.
    std::mem::forget(instance);
    found.map(Adapter).map_err(|error| GpuError::NoAdapter {
        reason: error.to_string(),
    })
}
