//! Checks an upload before it is queued.

use super::brain::{closing_radius_mm, given_mask, to_working_grid};
use super::extractor::network_missing;
use super::{Limits, Source, from_geometry, read_volume};
use case::{Failure, MaskSource, Parameters};

/// Checks an upload by reading it and resampling its mask to the working grid. Returns the parameters for the
/// preparation, as from [`settled`].
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
    let volume = read_volume(source, limits)?;
    super::check_intensities(&volume)?;
    let given = given_mask(source, &volume, (&parameters, limits))?;
    let Some((mask, _)) = given else {
        // The extraction finds out whether there is a brain in the volume.
        return extracting(parameters, has_network);
    };
    let brain = to_working_grid(&mask, &parameters, volume.grid())?;
    let radius_mm = closing_radius_mm(&parameters);
    geometry::check_closing(brain.mask().grid(), radius_mm).map_err(from_geometry)?;
    Ok(parameters)
}

/// The parameters for the preparation. If the brain must be extracted without a network, the method becomes `pruning`,
/// so that the case differs from the one that a network would make from the same upload.
///
/// An unreadable input changes nothing; the preparation reports what is wrong with it.
pub fn settled(
    source: &Source,
    parameters: Parameters,
    limits: &Limits,
    has_network: bool,
) -> Parameters {
    let is_open = parameters.mask == MaskSource::Auto && source.mask.is_none() && !has_network;
    if is_open
        && let Ok(volume) = read_volume(source, limits)
        && let Ok(None) = given_mask(source, &volume, (&parameters, limits))
    {
        return pruning(parameters);
    }
    parameters
}

/// The parameters of a preparation that extracts the brain.
fn extracting(parameters: Parameters, has_network: bool) -> Result<Parameters, Failure> {
    match (parameters.mask, has_network) {
        (MaskSource::Network, false) => Err(network_missing()),
        (MaskSource::Auto, false) => Ok(pruning(parameters)),
        _ => Ok(parameters),
    }
}

fn pruning(parameters: Parameters) -> Parameters {
    Parameters {
        mask: MaskSource::Pruning,
        ..parameters
    }
}
