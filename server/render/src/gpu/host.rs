//! The machine's graphics adapter.

use wgpu::{Adapter, Backends, DeviceType, Instance, InstanceDescriptor};

use super::GpuError;

/// What draws, for people to read and for choosing a renderer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterSummary {
    /// The adapter's name, as its driver gives it.
    pub name: String,
    /// The interface: `vulkan` or `gl`.
    pub interface: String,
    /// The driver and its version.
    pub driver: String,
    /// Whether it is a program, such as Mesa's lavapipe, that runs on the CPU: this crate's CPU renderers are faster.
    pub is_software: bool,
}

/// An adapter, found once, of which each thread opens a device.
#[derive(Debug, Clone)]
pub(super) struct Host {
    adapter: Adapter,
}

impl Host {
    /// Looks for an adapter: Vulkan, of software if need be; failing that, a GPU with OpenGL.
    ///
    /// Software OpenGL is not taken: it does nothing that the CPU renderers do not do faster.
    pub(super) fn find() -> Result<Self, GpuError> {
        adapter(Backends::VULKAN).or_else(|reason| {
            adapter(Backends::GL)
                .ok()
                .filter(|host| host.adapter.get_info().device_type != DeviceType::Cpu)
                .ok_or(reason)
        })
    }

    pub(super) fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    pub(super) fn summary(&self) -> AdapterSummary {
        let info = self.adapter.get_info();
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

fn adapter(backends: Backends) -> Result<Host, GpuError> {
    let instance = Instance::new(InstanceDescriptor {
        backends,
        ..InstanceDescriptor::new_without_display_handle()
    });
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    let found = pollster::block_on(instance.request_adapter(&options));
    found
        .map(|adapter| Host { adapter })
        .map_err(|error| GpuError::NoAdapter {
            reason: error.to_string(),
        })
}
