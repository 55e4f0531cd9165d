//! Converts stored values to texels.

use std::borrow::Cow;

use geometry::DepthField;
use half::f16;
use wgpu::TextureFormat;

/// A format of 16 bits that can be filtered between texels.
///
/// Whole numbers, which are exact, if the device can filter them. Otherwise half-precision numbers, which every device
/// can filter: then depths beyond 16 voxels are off by up to 1/128 voxel, and intensities are exact up to 2,048 above the
/// least.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Texels {
    /// `R16Unorm` and `R16Snorm`.
    Whole,
    /// `R16Float`.
    Half,
}

/// Stored intensities are divided by this, so that the greatest fit into half precision.
const HALF_SCALE: f32 = 32.0;

impl Texels {
    pub(super) fn intensity_format(self) -> TextureFormat {
        match self {
            Self::Whole => TextureFormat::R16Unorm,
            Self::Half => TextureFormat::R16Float,
        }
    }

    pub(super) fn depth_format(self) -> TextureFormat {
        match self {
            Self::Whole => TextureFormat::R16Snorm,
            Self::Half => TextureFormat::R16Float,
        }
    }

    /// The stored intensity of a texel of 1.
    pub(super) fn stored_scale(self) -> f32 {
        match self {
            Self::Whole => f32::from(u16::MAX),
            Self::Half => HALF_SCALE,
        }
    }

    /// The depth, in voxels, of a texel of 1.
    pub(super) fn depth_scale(self) -> f32 {
        match self {
            Self::Whole => f32::from(i16::MAX) / DepthField::STEPS_PER_VOXEL,
            Self::Half => 1.0,
        }
    }

    /// The stored intensity of a texel of 0: signed intensities are stored from 32,768 on, where half precision is coarse.
    pub(super) fn stored_offset(self, stored: &[u16]) -> u16 {
        match self {
            Self::Whole => 0,
            Self::Half => stored.iter().copied().min().unwrap_or(0),
        }
    }

    /// Bytes of stored intensities, none of which is below `offset`.
    pub(super) fn intensities(self, stored: &[u16], offset: u16) -> Cow<'_, [u8]> {
        match self {
            Self::Whole => Cow::Borrowed(bytemuck::cast_slice(stored)),
            Self::Half => {
                let above: Vec<u16> = stored.iter().map(|&stored| stored - offset).collect();
                Cow::Owned(halves(&above, 1.0 / HALF_SCALE).into_owned())
            }
        }
    }

    /// Bytes of depths in steps of a [`DepthField`].
    pub(super) fn depths(self, steps: &[i16]) -> Cow<'_, [u8]> {
        match self {
            Self::Whole => Cow::Borrowed(bytemuck::cast_slice(steps)),
            Self::Half => halves(steps, 1.0 / DepthField::STEPS_PER_VOXEL),
        }
    }
}

fn halves<T: Copy + Into<f32>>(values: &[T], scale: f32) -> Cow<'_, [u8]> {
    let halves = values
        .iter()
        .flat_map(|&value| f16::from_f32(value.into() * scale).to_ne_bytes());
    Cow::Owned(halves.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_holds_every_intensity_up_to_2048_and_comes_near_to_the_rest() {
        let stored: Vec<u16> = (0..=u16::MAX).collect();
        let bytes = Texels::Half.intensities(&stored, 0);
        for (&stored, bytes) in stored.iter().zip(bytes.chunks_exact(2)) {
            let half = f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32();
            let found = half * Texels::Half.stored_scale();
            let allowed = if stored <= 2048 {
                0.0
            } else {
                f32::from(stored) / 2048.0
            };
            assert!(
                (found - f32::from(stored)).abs() <= allowed,
                "{stored}: {found}"
            );
        }
    }

    #[test]
    fn half_precision_holds_signed_intensities_above_the_least() {
        let stored: Vec<u16> = (32_768..=34_816).rev().collect();
        let least = Texels::Half.stored_offset(&stored);
        assert_eq!(least, 32_768);
        let bytes = Texels::Half.intensities(&stored, least);
        for (&stored, bytes) in stored.iter().zip(bytes.chunks_exact(2)) {
            let half = f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32();
            let found = half * Texels::Half.stored_scale() + f32::from(least);
            assert_eq!(found, f32::from(stored));
        }
        assert_eq!(Texels::Whole.stored_offset(&stored), 0);
    }

    #[test]
    fn whole_depths_are_exact() {
        let steps = [-32767_i16, -768, 0, 5, 128, 32767];
        for (steps, bytes) in steps
            .iter()
            .zip(Texels::Whole.depths(&steps).chunks_exact(2))
        {
            let texel = f32::from(i16::from_ne_bytes([bytes[0], bytes[1]])) / 32767.0;
            let voxels = f32::from(*steps) / 128.0;
            assert!((texel * Texels::Whole.depth_scale() - voxels).abs() < 1e-4);
        }
    }
}
