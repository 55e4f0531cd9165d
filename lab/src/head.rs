//! A head for measurements.

use geometry::{Mask, Volume};
use imaging::nifti;

use crate::BenchError;

/// A head and its brain mask as files; reading them is measured too.
#[derive(Debug, Clone)]
pub struct Head {
    /// Its name in the tables.
    pub name: String,
    /// The volume, NIfTI.
    pub volume: Vec<u8>,
    /// The brain mask, NIfTI.
    pub mask: Vec<u8>,
}

impl Head {
    /// The synthetic head of the tests and the demo.
    ///
    /// # Errors
    /// If it cannot be encoded as NIfTI.
    ///
    /// # Panics
    /// If `spacing_mm` is not within 0.5 to 4.
    pub fn phantom(spacing_mm: f64) -> Result<Self, BenchError> {
        let head = geometry::phantom::head(spacing_mm);
        Ok(Self {
            name: format!("phantom head at {spacing_mm} mm (not a real head)"),
            volume: nifti::write_volume(&head.volume)?,
            mask: nifti::write_mask(&head.brain)?,
        })
    }

    /// The volume and the mask.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn read(&self) -> Result<(Volume, Mask), BenchError> {
        let limits = imaging::Limits::default();
        let volume = nifti::read_volume(&self.volume, &limits)?;
        let mask = nifti::read_mask(&self.mask, &limits)?;
        Ok((volume, mask))
    }
}
