//! Why a case has no maps, or no surfaces of parts.

use std::borrow::Cow;
use std::fmt::Display;

use analysis::{FlairUndefined, MapsUndefined, NoDivision};
use geometry::GeometryError;
use serde::{Deserialize, Serialize};

/// Why something is undefined for a case: its maps, the map of a FLAIR among its layers, or its surfaces of parts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{sentence}")]
pub struct Undefined {
    /// The stable name of the reason: `coarse-voxels`.
    pub code: Cow<'static, str>,
    /// The reason, for people.
    pub sentence: Cow<'static, str>,
}

impl Undefined {
    fn of(code: &'static str, reason: impl Display) -> Self {
        Self {
            code: code.into(),
            sentence: reason.to_string().into(),
        }
    }
}

impl From<MapsUndefined> for Undefined {
    fn from(reason: MapsUndefined) -> Self {
        Self::of(reason.code(), reason)
    }
}

impl From<FlairUndefined> for Undefined {
    fn from(reason: FlairUndefined) -> Self {
        Self::of(reason.code(), reason)
    }
}

impl From<NoDivision> for Undefined {
    fn from(reason: NoDivision) -> Self {
        Self::of(reason.code(), reason)
    }
}

impl From<GeometryError> for Undefined {
    fn from(error: GeometryError) -> Self {
        Self::of("surface-geometry", error)
    }
}
