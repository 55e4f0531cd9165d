//! Reasons why a head has no maps.

/// Why a head has no maps.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapsUndefined {
    /// The voxels are too large to show a blur of 1 to 2 mm.
    #[error(
        "the largest voxel spacing is {largest_mm:.2} mm; maps of the junction need at most 2.00 mm"
    )]
    CoarseVoxels {
        /// The largest edge of a voxel, in mm.
        largest_mm: f64,
    },
    /// The contrast between grey and white matter is too low for the noise.
    #[error(
        "the contrast between grey and white matter is {contrast:.1} times the noise; maps of the junction need at least 5 times"
    )]
    LowContrast {
        /// The contrast, in deviations of the noise.
        contrast: f32,
    },
    /// Much of the brain mask lies where the volume shows nothing, and no tissues are told apart.
    #[error(
        "{:.0} % of the brain mask lies where the volume is empty, so grey and white matter are not told apart: if a part of the head is missing, correct the mask so that it ends there",
        100.0 * .share
    )]
    EmptyVolume {
        /// The share of the mask.
        share: f64,
    },
    /// The slices were interpolated from thicker ones.
    #[error(
        "along one axis the volume has only {:.0} % of the fine detail that it has along another, as if thicker slices had been interpolated; maps of the junction need a volume that was acquired with voxels of at most 2 mm, and at least {:.0} %",
        100.0 * .share, 100.0 * crate::slices::LEAST_SHARE
    )]
    InterpolatedSlices {
        /// The least fine detail along an axis, as a share of the greatest.
        share: f64,
    },
    /// There is no white matter below the envelope.
    #[error(
        "no white matter was found below the envelope; maps of the junction need a T1-weighted head"
    )]
    NoWhiteMatter,
    /// Too few of the large voxels lie within white matter.
    #[error(
        "only {samples} of the voxels of up to {largest_mm:.2} mm lie within white matter; the noise cannot be measured \
         with fewer than {needed}, so maps of the junction need a T1-weighted head with smaller voxels"
    )]
    NoiseUnknown {
        /// Voxels of deep white matter.
        samples: usize,
        /// The fewest from which the noise is measured.
        needed: usize,
        /// The largest edge of a voxel, in mm.
        largest_mm: f64,
    },
    /// The brain mask is rated as failed.
    #[error("the brain mask is rated `failed`; correct the mask to get maps")]
    FailedEnvelope,
    /// No voxel is deep enough.
    #[error("no voxel of the volume is 3 mm below the envelope")]
    NothingDeep,
}

impl MapsUndefined {
    /// The stable name, for programs and translations: `coarse-voxels`.
    pub fn code(self) -> &'static str {
        match self {
            Self::CoarseVoxels { .. } => "coarse-voxels",
            Self::LowContrast { .. } => "low-contrast",
            Self::EmptyVolume { .. } => "empty-volume",
            Self::InterpolatedSlices { .. } => "interpolated-slices",
            Self::NoWhiteMatter => "no-white-matter",
            Self::NoiseUnknown { .. } => "noise-unknown",
            Self::FailedEnvelope => "failed-envelope",
            Self::NothingDeep => "nothing-deep",
        }
    }
}
