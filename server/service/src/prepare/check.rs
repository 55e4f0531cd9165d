//! What can be told of an upload at once, before it is queued.

use super::brain::{closing_radius_mm, given_mask, mask_missing, to_working_grid};
use super::{Limits, Source, from_geometry, read_volume};
use crate::case::{Failure, Parameters};

/// Whether an upload can be prepared, as far as reading it and bringing its mask to the working grid tell.
///
/// It takes about a tenth of a preparation. What it finds a preparation would find too, with the same [`Failure`].
///
/// # Errors
/// A [`Failure`] that names what is wrong with the input or the parameters.
pub fn check(source: &Source, parameters: &Parameters, limits: &Limits) -> Result<(), Failure> {
    parameters.check()?;
    let volume = read_volume(source, limits)?;
    let given = given_mask(source, &volume, (parameters, limits))?;
    let [least, greatest] = volume.intensity_range();
    if least >= greatest {
        return Err(super::constant(least));
    }
    let Some((mask, _)) = given else {
        return Err(mask_missing());
    };
    let brain = to_working_grid(&mask, parameters, volume.grid())?;
    let radius_mm = closing_radius_mm(parameters);
    geometry::check_closing(brain.mask().grid(), radius_mm).map_err(from_geometry)
}
