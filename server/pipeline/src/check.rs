//! Checks an upload before it is queued.

use super::Limits;
use super::brain::{closing_radius_mm, given_mask, moved};
use super::extractor::{from_extraction, network_missing};
use super::failure::from_geometry;
use super::source::{Source, read_sound_volume};
use case::{Failure, MaskSource, Parameters};

/// Checks an upload by reading it and resampling its mask to the working grid; returns the parameters for the preparation, as
/// [`settled`].
///
/// This takes about a tenth of the time of a preparation, which would find the same errors.
///
/// # Errors
/// A [`Failure`] that states what is wrong with the input or the parameters.
pub fn check(
    source: &Source,
    parameters: Parameters,
    limits: &Limits,
    has_network: bool,
) -> Result<Parameters, Failure> {
    parameters.check()?;
    let (volume, _) = read_sound_volume(source, limits)?;
    let given = given_mask(source, &volume, &parameters, limits)?;
    match given {
        Some(given) => {
            let given = given.on_working_grid(volume.grid())?;
            let moved = match parameters.offset_mm {
                0.0 => None,
                offset_mm => Some(moved(given.brain.clone(), offset_mm)?),
            };
            let grid = moved.as_ref().unwrap_or(&given.brain).mask().grid();
            let radius_mm = closing_radius_mm(&parameters);
            geometry::check_closing(grid, radius_mm).map_err(from_geometry)?;
            Ok(parameters)
        }
        // The extraction finds out whether there is a brain in the volume; what is no head at all is known at once.
        None => {
            extraction::check_foreground(&volume).map_err(from_extraction)?;
            extracting(parameters, has_network)
        }
    }
}

/// The parameters for the preparation. If the brain must be extracted without a network,
/// the method becomes `pruning`, so that the case differs from the one that a network would make from the same upload.
///
/// An unusable input changes nothing; the preparation reports what is wrong with it.
pub fn settled(
    source: &Source,
    parameters: Parameters,
    limits: &Limits,
    has_network: bool,
) -> Parameters {
    let is_open = parameters.mask == MaskSource::Auto && source.mask.is_none() && !has_network;
    if is_open && let Ok(settled) = check(source, parameters.clone(), limits, has_network) {
        return settled;
    }
    parameters
}

/// The parameters of a preparation that extracts the brain.
fn extracting(parameters: Parameters, has_network: bool) -> Result<Parameters, Failure> {
    match (parameters.mask, has_network) {
        (MaskSource::Network, false) => Err(network_missing()),
        (MaskSource::Auto, false) => Ok(Parameters {
            mask: MaskSource::Pruning,
            ..parameters
        }),
        _ => Ok(parameters),
    }
}
