//! What can be told of an upload at once, before it is queued.

use geometry::BrainMask;

use super::{Limits, Source, from_geometry, from_imaging, read_mask};
use crate::case::Failure;

/// Whether an upload can be prepared, as far as reading it and bringing its mask to the working grid tell.
///
/// It takes about a tenth of a preparation. What it finds a preparation would find too, with the same [`Failure`].
///
/// # Errors
/// A [`Failure`] that names what is wrong with the input.
pub fn check(source: &Source, limits: &Limits) -> Result<(), Failure> {
    let volume = imaging::nifti::read_volume(&source.volume, limits).map_err(from_imaging)?;
    let mask = read_mask(source, &volume, limits)?;
    let [least, greatest] = volume.intensity_range();
    if least >= greatest {
        return Err(super::constant(least));
    }
    BrainMask::from_mask(&mask, volume.grid()).map_err(from_geometry)?;
    Ok(())
}
