//! The surfaces of a case.

use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

/// A surface of a case, from which depth is measured.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Surface))]
#[serde(rename_all = "lowercase")]
pub enum SurfaceName {
    /// The whole brain.
    #[default]
    Whole,
    /// The left half of the cerebrum, closed along the falx: its inner side is measured from there.
    Left,
    /// The right half of the cerebrum.
    Right,
    /// Both halves of the cerebrum, without cerebellum and brain stem.
    Cerebrum,
}

impl SurfaceName {
    /// The name in addresses and JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// What an annotated picture calls it; `None` for the whole brain.
    pub fn words(self) -> Option<&'static str> {
        match self {
            Self::Whole => None,
            Self::Left => Some("left hemisphere"),
            Self::Right => Some("right hemisphere"),
            Self::Cerebrum => Some("cerebrum"),
        }
    }

    /// The surface of the mirrored places: of a half, the other half.
    #[must_use]
    pub fn mirrored(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            both => both,
        }
    }

    /// Whether it is the whole brain.
    pub fn is_whole(&self) -> bool {
        *self == Self::Whole
    }
}
