//! What the maps are computed from.

use geometry::{DepthField, Volume};

use crate::MidsagittalPlane;

/// The input of the maps.
#[derive(Debug, Clone, Copy)]
pub struct Head<'a> {
    /// T1-weighted intensities.
    pub volume: &'a Volume,
    /// The depth below the envelope.
    pub depth: &'a DepthField,
    /// The plane between the hemispheres.
    pub plane: &'a MidsagittalPlane,
}
