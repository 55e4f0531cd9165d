//! An open device and what goes wrong with it.

use std::sync::{Arc, Mutex, PoisonError};

use wgpu::{Device, Features, Limits, Queue, TextureFormat, TextureFormatFeatureFlags};

use super::GpuError;
use super::adapter::Adapter;
use super::texels::Texels;

/// A device, its queue and what it offers.
#[derive(Debug, Clone)]
pub(super) struct OpenDevice {
    pub(super) device: Device,
    pub(super) queue: Queue,
    /// How values are kept in 3-D textures.
    pub(super) texels: Texels,
    /// Whether the mesh's depth buffer has several samples a pixel.
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

    /// As if the driver had said that there is no memory.
    #[cfg(any(test, feature = "faults"))]
    pub(super) fn run_short(&self) {
        self.faults.note(GpuError::OutOfMemory);
    }

    /// What has gone wrong since this was last asked; a lost device stays lost.
    pub(super) fn fault(&self) -> Option<GpuError> {
        self.faults.take()
    }
}

/// The first fault of a device that nobody has heard of.
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
