//! Why a head has no maps.

/// Why the maps of a head are undefined altogether.
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
    /// Grey and white matter do not stand out of the noise.
    #[error(
        "the contrast between grey and white matter is {contrast:.1} times the noise; maps of the junction need at least 5 times"
    )]
    LowContrast {
        /// The contrast, in deviations of the noise.
        contrast: f32,
    },
    /// Nothing below the envelope looks like white matter.
    #[error(
        "no white matter was found below the envelope; maps of the junction need a T1-weighted head"
    )]
    NoWhiteMatter,
    /// The envelope is not to be believed.
    #[error("the brain mask is judged as failed; correct the mask, then the maps are made")]
    FailedEnvelope,
    /// No voxel lies deep enough.
    #[error("no voxel of the volume lies 3 mm below the envelope")]
    NothingDeep,
}
