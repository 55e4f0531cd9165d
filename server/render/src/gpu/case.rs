//! A case's textures.

use std::borrow::Cow;

use geometry::ShellIndex;
use glam::DVec3;
use wgpu::{
    Extent3d, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
};

use super::GpuError;
use super::device::OpenDevice;
use super::gradients::gradients;
use super::reduce::{reduced, reduced_size, reduction};
use super::texels::Texels;
use crate::Scene;

/// The number of bytes to upload at once: the driver keeps a copy of them until the device has them.
const UPLOAD_BYTES: usize = 32 << 20;

/// Bytes of a voxel of the working grid on the device: its depth, gradient and smoothed depth.
pub(super) const FIELD_BYTES: u64 = 2 + 4 + 2;

/// Facts about the textures of a case for the shaders.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CaseMaps {
    /// The format of values.
    pub(super) texels: Texels,
    /// The stored intensity of a texel of 0.
    pub(super) stored_offset: u16,
    /// Native voxels in a texel, along each axis.
    pub(super) reduction: [usize; 3],
    /// Texels of the volume.
    pub(super) volume_size: [usize; 3],
    /// The box around the centres of the envelope's voxels, in voxel coordinates of the depth field.
    pub(super) envelope_in_field: [DVec3; 2],
}

/// A case on the device.
#[derive(Debug, Clone)]
pub(super) struct CaseTextures {
    pub(super) maps: CaseMaps,
    pub(super) views: CaseViews,
}

/// Its textures.
#[derive(Debug, Clone)]
pub(super) struct CaseViews {
    pub(super) volume: TextureView,
    pub(super) field: TextureView,
    pub(super) normals: TextureView,
    pub(super) smoothed: TextureView,
}

/// The plan for uploading a case, and its size on the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CasePlan {
    reduction: [usize; 3],
    pub(super) bytes: u64,
}

impl CasePlan {
    /// The unchanged depth fields, and the volume reduced to fit into `limit` bytes beside them.
    pub(super) fn new(scene: &Scene<'_>, max_side: u32, limit: u64) -> Result<Self, GpuError> {
        let fields = FIELD_BYTES * scene.field.grid().voxel_count() as u64;
        let longest = scene.field.grid().size().into_iter().max().unwrap_or(0);
        let too_large = |needed| GpuError::CaseTooLarge { needed, limit };
        if longest > max_side as usize {
            return Err(too_large(fields));
        }
        let size = scene.volume.grid().size();
        let left = limit.checked_sub(fields).ok_or(too_large(fields))?;
        let reduction = reduction(size, max_side as usize, left);
        let texels: usize = reduced_size(size, reduction).iter().product();
        let bytes = fields + 2 * texels as u64;
        if bytes > limit {
            return Err(too_large(bytes));
        }
        Ok(Self { reduction, bytes })
    }

    /// How many native voxels become one, if the volume is reduced.
    pub(super) fn is_reduced(&self) -> bool {
        self.reduction != [1; 3]
    }
}

impl CaseTextures {
    /// Uploads a case to the device.
    pub(super) fn upload(open: &OpenDevice, scene: &Scene<'_>, plan: &CasePlan) -> Self {
        let native = scene.volume.grid().size();
        let stored = if plan.is_reduced() {
            Cow::Owned(reduced(scene.volume.voxels(), native, plan.reduction))
        } else {
            Cow::Borrowed(scene.volume.voxels())
        };
        let volume_size = reduced_size(native, plan.reduction);
        let texels = open.texels;
        let volume = texture(open, texels.intensity_format(), volume_size);
        let stored_offset = texels.stored_offset(&stored);
        fill(open, &volume, volume_size, &stored, |values| {
            texels.intensities(values, stored_offset)
        });
        let field_size = scene.field.grid().size();
        let [field, smoothed] = [scene.field, scene.normals].map(|field| {
            let texture = texture(open, texels.depth_format(), field_size);
            fill(open, &texture, field_size, field.values(), |steps| {
                texels.depths(steps)
            });
            texture
        });
        let normals = texture(open, TextureFormat::Rgba8Snorm, field_size);
        let gradients = gradients(scene.normals);
        fill(open, &normals, field_size, &gradients, |gradients| {
            Cow::Borrowed(bytemuck::cast_slice(gradients))
        });
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        Self {
            maps: CaseMaps {
                texels,
                stored_offset,
                reduction: plan.reduction,
                volume_size,
                envelope_in_field: box_around(scene.shell),
            },
            views: CaseViews {
                volume: view(&volume),
                field: view(&field),
                normals: view(&normals),
                smoothed: view(&smoothed),
            },
        }
    }
}

pub(super) fn texture(open: &OpenDevice, format: TextureFormat, size: [usize; 3]) -> wgpu::Texture {
    open.device.create_texture(&TextureDescriptor {
        label: Some("voxels"),
        size: extent(size),
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D3,
        format,
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Fills a texture, some slices at a time; `encode` keeps the size of the values.
pub(super) fn fill<T>(
    open: &OpenDevice,
    texture: &wgpu::Texture,
    size: [usize; 3],
    values: &[T],
    encode: impl Fn(&[T]) -> Cow<'_, [u8]>,
) {
    let plane = size[0] * size[1];
    let row_bytes = size_of::<T>() * size[0];
    let slices = (UPLOAD_BYTES / (row_bytes * size[1])).max(1);
    for (index, values) in values.chunks(slices * plane).enumerate() {
        let destination = wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d {
                x: 0,
                y: 0,
                z: (index * slices) as u32,
            },
            aspect: wgpu::TextureAspect::All,
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_bytes as u32),
            rows_per_image: Some(size[1] as u32),
        };
        let block = extent([size[0], size[1], values.len() / plane]);
        open.queue
            .write_texture(destination, &encode(values), layout, block);
        open.queue.submit([]);
    }
}

fn extent([width, height, depth]: [usize; 3]) -> Extent3d {
    Extent3d {
        width: width as u32,
        height: height as u32,
        depth_or_array_layers: depth as u32,
    }
}

/// The box around the voxel centres of an envelope.
fn box_around(shell: &ShellIndex) -> [DVec3; 2] {
    let half_voxel_mm = (0.5 * shell.grid().spacing_mm()[0]) as f32;
    let border = shell.shell(0.0, half_voxel_mm).iter();
    let centres = border.map(|voxel| DVec3::from(voxel.position().map(f64::from)));
    centres.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], at| {
        [low.min(at), high.max(at)]
    })
}
