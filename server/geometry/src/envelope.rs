//! The closed mask that hugs the dura.

use crate::{BrainMask, GeometryError, Grid, Mask};

/// The Euclidean closing of a brain mask: its surface bridges the sulci and follows the dura.
#[derive(Debug, Clone, PartialEq)]
pub struct Envelope(pub(crate) Mask);

impl Envelope {
    /// An envelope from a mask on a working grid that was made by [`envelope`] before and stored.
    ///
    /// # Errors
    /// When the mask is empty or reaches a face of its grid.
    pub fn from_stored(mask: Mask) -> Result<Self, GeometryError> {
        let _ = mask;
        todo!()
    }

    /// The working grid.
    pub fn grid(&self) -> &Grid {
        self.0.grid()
    }

    /// The mask on the working grid.
    pub fn mask(&self) -> &Mask {
        &self.0
    }

    /// Volume enclosed, in millilitres.
    pub fn volume_ml(&self) -> f64 {
        todo!()
    }
}

/// Closes a brain mask by a ball of `closing_radius_mm`, fills the holes and keeps the largest component.
///
/// # Errors
/// When the radius is not within 0 to 50 mm.
pub fn envelope(brain: &BrainMask, closing_radius_mm: f64) -> Result<Envelope, GeometryError> {
    let _ = (brain, closing_radius_mm);
    todo!()
}
