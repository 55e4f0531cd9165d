//! How far a mask can be trusted: what was measured of it, and what that means.

use serde::{Deserialize, Serialize};

/// The verdict on a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum QualityState {
    /// Nothing is unusual.
    Ok,
    /// Look at the quality sheet before anything is read from the case.
    Review,
    /// The mask is not that of a brain; replace it.
    Failed,
}

impl QualityState {
    /// The name used in JSON and in headers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Review => "review",
            Self::Failed => "failed",
        }
    }
}

/// Where a mask came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum MaskMethod {
    /// It was supplied.
    Supplied,
    /// The volume was skull-stripped already.
    Volume,
    /// The network extracted it.
    Network,
    /// Tree pruning extracted it.
    TreePruning,
}

impl MaskMethod {
    /// Where the mask came from, in words.
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

/// How far the mask of a case can be trusted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Quality {
    /// The verdict.
    pub state: QualityState,
    /// Where the mask came from.
    pub method: MaskMethod,
    /// What was measured.
    pub numbers: QualityNumbers,
    /// Why the verdict is not `ok`: plain sentences; none where it is.
    pub reasons: Vec<String>,
    /// What each of the reasons is called, in their order: names that stay, such as `mask-cut-inferior`. Absent for a case that was
    /// prepared before they had any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reason_codes: Vec<String>,
    /// Rows of another affine from the volume's voxels to LPS mm, with which the network finds the brain if it does not with the
    /// volume's own: what the header might have to say. Nothing was turned; a person must compare it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected_header: Option<[[f64; 4]; 4]>,
}

/// What was measured of a mask.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct QualityNumbers {
    /// Volume of the brain mask.
    pub brain_ml: f64,
    /// What the closing and the filling of holes added, as a share of the brain mask.
    pub closing_added: f64,
    /// Share of the mask that is in its largest piece, which alone is kept.
    pub largest_component: f64,
    /// Extents along left to right, front to back and top to bottom.
    pub extents_mm: [f64; 3],
    /// The brain's area on the faces of the volume at left, right, posterior, anterior, superior and inferior.
    pub cut_area_cm2: [f64; 6],
    /// How well the network's first, coarse look and its mask agree (Dice), where it extracted the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agreement: Option<f64>,
    /// Voxels of which the network is unsure, as a share of those of the brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertain: Option<f64>,
    /// How much brighter the inside of the brain is than its rim, as a share of the range of intensities.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast: Option<f64>,
    /// Share of the border of a supplied mask that looks like that of a brain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rim: Option<f64>,
    /// How far a supplied mask and the network's agree (Dice of their envelopes), if the network was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap: Option<f64>,
}
