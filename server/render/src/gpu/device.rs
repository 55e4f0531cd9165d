//! An open device and its faults.

use std::sync::{Arc, Mutex, PoisonError};

use wgpu::{Device, Features, Limits, Queue, TextureFormat, TextureFormatFeatureFlags};

use super::GpuError;
use super::adapter::Adapter;
use super::texels::Texels;

/// A device, its queue and its features.
#[derive(Debug, Clone)]
pub(super) struct OpenDevice {
    pub(super) device: Device,
    pub(super) queue: Queue,
    /// The format of values in 3-D textures.
    pub(super) texels: Texels,
    /// Whether the depth buffer of the mesh has several samples per pixel.
    pub(super) is_multisampled: bool,
    /// The longest side of a 3-D texture: the adapter's own limit.
    pub(super) max_side_3d: u32,
    faults: Faults,
}

impl OpenDevice {
    /// Opens a device with the adapter's own limits.
    pub(super) fn open(adapter: &Adapter) -> Result<Self, GpuError> {
        let adapter = adapter.wgpu();
        let features = adapter.features() & Features::TEXTURE_FORMAT_16BIT_NORM;
        let limits = Limits::downlevel_defaults().using_resolution(adapter.limits());
        let max_buffer_size = adapter.limits().max_buffer_size;
        let opened = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("isocortex"),
            required_features: features,
            required_limits: Limits {
                max_buffer_size,
                ..limits.clone()
            },
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(opened).map_err(|error| GpuError::NoDevice {
            reason: error.to_string(),
        })?;
        let offers = |format: TextureFormat, flag| {
            let known = !format.required_features().intersects(!features);
            known
                && adapter
                    .get_texture_format_features(format)
                    .flags
                    .contains(flag)
        };
        let filters = |format| offers(format, TextureFormatFeatureFlags::FILTERABLE);
        let multisamples = |format| offers(format, TextureFormatFeatureFlags::MULTISAMPLE_X4);
        let is_whole = filters(TextureFormat::R16Unorm) && filters(TextureFormat::R16Snorm);
        Ok(Self {
            faults: Faults::watch(&device),
            texels: if is_whole {
                Texels::Whole
            } else {
                Texels::Half
            },
            is_multisampled: multisamples(super::formats::DEPTH),
            max_side_3d: limits.max_texture_dimension_3d,
            device,
            queue,
        })
    }

    /// Simulates a report of the driver that memory is exhausted.
    #[cfg(any(test, feature = "faults"))]
    pub(super) fn run_short(&self) {
        self.faults.note(GpuError::OutOfMemory);
    }

    /// Takes the fault since the last call, if any; a lost device stays lost.
    pub(super) fn fault(&self) -> Option<GpuError> {
        self.faults.take()
    }
}

/// The first fault that has not been reported.
#[derive(Debug, Clone, Default)]
struct Faults(Arc<Mutex<Option<GpuError>>>);

impl Faults {
    fn watch(device: &Device) -> Self {
        let faults = Self::default();
        let on_error = faults.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            on_error.note(match error {
                wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory,
                error => GpuError::Failed {
                    reason: error.to_string(),
                },
            });
        }));
        let on_loss = faults.clone();
        device.set_device_lost_callback(move |_, reason| on_loss.note(GpuError::Lost { reason }));
        faults
    }

    fn note(&self, fault: GpuError) {
        let mut first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_loss = matches!(fault, GpuError::Lost { .. });
        if first.is_none() || (is_loss && !matches!(*first, Some(GpuError::Lost { .. }))) {
            *first = Some(fault);
        }
    }

    fn take(&self) -> Option<GpuError> {
        let mut first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*first {
            Some(GpuError::Lost { .. }) => first.clone(),
            _ => first.take(),
        }
    }
}
