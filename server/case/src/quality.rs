//! The quality of a mask: measurements and a rating.

use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr};

/// The rating of a mask.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    EnumString,
    IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum QualityState {
    /// Nothing is unusual.
    Ok,
    /// Something is unusual: check the quality sheet before you use the case.
    Review,
    /// This is not the mask of a brain: replace it.
    Failed,
}

impl QualityState {
    /// The name used in JSON and in headers.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The rating with a name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        name.parse().ok()
    }
}

/// Where a mask came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MaskMethod {
    /// The client supplied it.
    Supplied,
    /// The volume was skull-stripped.
    Volume,
    /// The network extracted it.
    Network,
    /// Tree pruning extracted it.
    TreePruning,
}

impl MaskMethod {
    /// A description for people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Supplied => "mask as supplied",
            Self::Volume => "mask from the skull-stripped volume",
            Self::Network => "brain extracted by the network",
            Self::TreePruning => "brain extracted by tree pruning",
        }
    }

    /// Whether the brain was extracted by this program.
    pub fn is_extraction(self) -> bool {
        matches!(self, Self::Network | Self::TreePruning)
    }
}

/// The code of the doubt about left and right, which is no doubt about the mask.
const AXES_CORRECTED: &str = "axes-corrected";

/// The code of the same doubt of a file that does not state its axes.
pub const AXES_ASSUMED: &str = "axes-assumed";

const OTHER_AXES: &str = "another case has the same voxels with other axes, so that one of the two headers is wrong. The picture cannot tell left \
                          from right: ask whoever made the file which side is left, then delete both cases and upload the volume with the \
                          correct header";

/// The quality of the mask of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Quality {
    /// The rating.
    pub state: QualityState,
    /// Where the mask came from.
    pub method: MaskMethod,
    /// The measurements.
    pub numbers: QualityNumbers,
    /// Why the rating is not `ok`, in sentences; empty if it is `ok`.
    pub reasons: Vec<String>,
    /// The stable codes of the reasons, in the same order, such as `mask-cut-inferior`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reason_codes: Vec<String>,
    /// Other affines for the header, if the network finds the brain only with other axes than those in the header. Nothing was
    /// changed; a person must choose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected_header: Option<CorrectedHeader>,
}

impl Quality {
    /// How many of its reasons are doubts about left and right.
    pub fn doubts_about_sides(&self) -> usize {
        let codes = self.reason_codes.iter();
        codes
            .filter(|code| [AXES_CORRECTED, AXES_ASSUMED].contains(&code.as_str()))
            .count()
    }

    /// Takes in whether another case has the same voxels with other axes, the one doubt that comes and goes after the mask was rated.
    /// Returns whether this changed anything.
    pub fn set_axes_corrected(&mut self, is_contradicted: bool) -> bool {
        let known = self
            .reason_codes
            .iter()
            .position(|code| code == AXES_CORRECTED);
        match (known, is_contradicted) {
            (None, true) => {
                self.state = self.state.max(QualityState::Review);
                self.reasons.push(OTHER_AXES.to_owned());
                self.reason_codes.push(AXES_CORRECTED.to_owned());
            }
            (Some(at), false) => {
                self.reason_codes.remove(at);
                self.reasons.remove(at);
                if self.reasons.is_empty() && self.state == QualityState::Review {
                    self.state = QualityState::Ok;
                }
            }
            _ => return false,
        }
        true
    }
}

/// Two affines that could correct a header, as rows from the voxels of the volume to LPS mm. They differ only in left and right,
/// and the picture cannot tell them apart: a brain looks like its mirror image. If the header reverses one axis or exchanges two,
/// `turned` exchanges left and right, and `mirrored` is correct. Ask whoever made the file which side is left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CorrectedHeader {
    /// Correct if the header describes the head turned: two axes reversed, or all three exchanged in a circle.
    pub turned: [[f64; 4]; 4],
    /// Correct if the header describes the head mirrored: one axis reversed, or two exchanged. It is `turned`, reflected from left
    /// to right.
    pub mirrored: [[f64; 4]; 4],
}

impl CorrectedHeader {
    /// `turned` and its reflection at a sagittal plane, given by its distance to the left of the origin.
    pub fn reflected_at(plane_mm: f64, turned: [[f64; 4]; 4]) -> Self {
        let mut mirrored = turned;
        mirrored[0] = turned[0].map(|entry| 0.0 - entry);
        mirrored[0][3] += 2.0 * plane_mm;
        Self { turned, mirrored }
    }
}

/// The measurements of a mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QualityNumbers {
    /// Volume of the brain mask.
    pub brain_ml: f64,
    /// The volume that closing and hole filling added, as a fraction of the brain mask.
    pub closing_added: f64,
    /// Fraction of the mask in its largest component; the rest is dropped.
    pub largest_component: f64,
    /// Extents along left to right, front to back and top to bottom.
    pub extents_mm: [f64; 3],
    /// The area of the brain on the left, right, posterior, anterior, superior and inferior face of the volume, or on a plane beyond
    /// which the volume is constant.
    pub cut_area_cm2: [f64; 6],
    /// The agreement (Dice) of the coarse and the fine pass of the network, if it extracted the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agreement: Option<f64>,
    /// Voxels of which the network is uncertain, as a fraction of the voxels of the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertain: Option<f64>,
    /// How much brighter the inside of the brain is than its rim, as a fraction of the intensity range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast: Option<f64>,
    /// Fraction of the border of a supplied mask that looks like the border of a brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rim: Option<f64>,
    /// The overlap of a supplied mask with the mask from the network (Dice of their envelopes), if the network was certain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap: Option<f64>,
    /// The distance between these two envelopes: its 95th percentile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_95_mm: Option<f64>,
    /// The mean of the same distance: positive if the supplied mask is larger, negative if it is smaller.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_mean_mm: Option<f64>,
    /// The area of either envelope that is more than 7 mm from the other one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distant_cm2: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    const TURNED: [[f64; 4]; 4] = [
        [1.0, 0.0, 0.0, -90.0],
        [0.0, 0.0, -2.0, 100.0],
        [0.0, 1.5, 0.0, -70.0],
        [0.0, 0.0, 0.0, 1.0],
    ];

    #[test]
    fn the_mirrored_header_exchanges_left_and_right_and_keeps_the_plane() {
        let header = CorrectedHeader::reflected_at(10.0, TURNED);
        assert_eq!(header.turned, TURNED);
        assert_eq!(header.mirrored[0], [-1.0, 0.0, 0.0, 110.0]);
        assert_eq!(header.mirrored[1..], TURNED[1..]);
        // A voxel on the plane stays where it is.
        let x_of = |rows: [[f64; 4]; 4]| rows[0][0] * 100.0 + rows[0][3];
        assert_eq!(x_of(header.turned), 10.0);
        assert_eq!(x_of(header.mirrored), 10.0);
    }
}
