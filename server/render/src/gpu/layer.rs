//! A layer's texture.

use std::borrow::Cow;

use glam::DAffine3;
use half::f16;
use wgpu::{TextureFormat, TextureView};

use super::GpuError;
use super::case::{fill, texture};
use super::device::OpenDevice;
use crate::{Layer, LayerValues};

/// A layer on the device: a value for each voxel, and 1 if it is defined or 0 if not. Undefined voxels have the value
/// 0, so that both can be filtered between voxels and divided.
#[derive(Debug, Clone)]
pub(super) struct LayerTexture {
    pub(super) view: TextureView,
    pub(super) size: [usize; 3],
    /// A value is scale times texel plus offset.
    pub(super) scale: f32,
    pub(super) offset: f32,
    pub(super) voxel_from_case: DAffine3,
    /// Whether a position has the value of its nearest voxel.
    pub(super) is_nearest: bool,
}

/// Bytes of a layer on the device.
pub(super) fn layer_bytes(layer: &Layer) -> u64 {
    let voxels: u64 = layer.size().iter().map(|&side| side as u64).product();
    match layer.values() {
        LayerValues::Codes { .. } | LayerValues::Labels { .. } => 2 * voxels,
        LayerValues::Numbers(_) => 4 * voxels,
    }
}

impl LayerTexture {
    /// Uploads a layer to the device.
    pub(super) fn upload(
        open: &OpenDevice,
        layer: &Layer,
        max_side: u32,
    ) -> Result<Self, GpuError> {
        let size = layer.size();
        let longest = size.into_iter().fold(0, usize::max);
        if longest > max_side as usize {
            let limit = max_side;
            return Err(GpuError::LayerTooLarge { longest, limit });
        }
        let (view, scale, offset) = match layer.values() {
            LayerValues::Codes { codes, least, step } => {
                (of_codes(open, size, codes), 255.0 * step, least - step)
            }
            LayerValues::Labels { codes, .. } => (of_codes(open, size, codes), 255.0, 0.0),
            LayerValues::Numbers(numbers) => {
                let [least, length] = range(numbers);
                let pair = |&number: &f32| match number.is_nan() {
                    true => [f16::ZERO.to_bits(); 2],
                    false => [(number - least) / length, 1.0].map(|x| f16::from_f32(x).to_bits()),
                };
                let pairs: Vec<[u16; 2]> = numbers.iter().map(pair).collect();
                let view = filled(open, TextureFormat::Rg16Float, size, &pairs);
                (view, length, least)
            }
        };
        Ok(Self {
            view,
            size,
            scale,
            offset,
            voxel_from_case: layer.voxel_from_case(),
            is_nearest: layer.has_labels(),
        })
    }

    /// A single undefined voxel, which is bound if there is no overlay.
    pub(super) fn none(open: &OpenDevice) -> TextureView {
        filled(open, TextureFormat::Rg8Unorm, [1; 3], &[[0_u8; 2]])
    }
}

fn of_codes(open: &OpenDevice, size: [usize; 3], codes: &[u8]) -> TextureView {
    let pairs: Vec<[u8; 2]> = codes.iter().map(|&code| code_pair(code)).collect();
    filled(open, TextureFormat::Rg8Unorm, size, &pairs)
}

fn code_pair(code: u8) -> [u8; 2] {
    [code, if code > 0 { 255 } else { 0 }]
}

/// The least defined number and the range above it: half-precision texels are most exact from 0 to 1.
fn range(numbers: &[f32]) -> [f32; 2] {
    let defined = numbers.iter().filter(|number| !number.is_nan());
    let (least, most) = defined.fold(
        (f32::INFINITY, f32::NEG_INFINITY),
        |(low, high), &number| (low.min(number), high.max(number)),
    );
    if least < most {
        [least, most - least]
    } else {
        [if least.is_finite() { least } else { 0.0 }, 1.0]
    }
}

fn filled<T: bytemuck::Pod>(
    open: &OpenDevice,
    format: TextureFormat,
    size: [usize; 3],
    pairs: &[T],
) -> TextureView {
    let texture = texture(open, format, size);
    fill(open, &texture, size, pairs, |pairs| {
        Cow::Borrowed(bytemuck::cast_slice(pairs))
    });
    texture.create_view(&Default::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spread_over_the_texels() {
        assert_eq!(range(&[-2.0, f32::NAN, 6.0]), [-2.0, 8.0]);
        assert_eq!(range(&[3.0, 3.0]), [3.0, 1.0]);
        assert_eq!(range(&[f32::NAN]), [0.0, 1.0]);
    }

    #[test]
    fn an_undefined_code_is_nothing_in_both_parts() {
        assert_eq!([0, 1, 255].map(code_pair), [[0, 0], [1, 255], [255, 255]]);
    }
}
