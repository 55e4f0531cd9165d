//! What can be told of an upload at once, before it is queued.

use super::brain::{closing_radius_mm, given_mask, to_working_grid};
use super::extractor::network_missing;
use super::{Limits, Source, from_geometry, read_volume};
use case::{Failure, MaskSource, Parameters};

/// Whether an upload can be prepared, as far as reading it and bringing its mask to the working grid tell; and the parameters
/// with which it will be, as [`settled`] makes them.
///
/// It takes about a tenth of a preparation. What it finds a preparation would find too, with the same [`Failure`].
///
/// # Errors
/// A [`Failure`] that names what is wrong with the input or the parameters.
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
        // Whether there is a brain in the volume, the extraction tells.
        return extracting(parameters, has_network);
    };
    let brain = to_working_grid(&mask, &parameters, volume.grid())?;
    let radius_mm = closing_radius_mm(&parameters);
    geometry::check_closing(brain.mask().grid(), radius_mm).map_err(from_geometry)?;
    Ok(parameters)
}

/// The parameters with which an upload will be prepared: where the brain must be extracted and there is no network, the method
/// is no longer left open. So the case is another one than that which a network would make of the same upload.
///
/// An input that cannot be read changes nothing: the preparation says what is wrong with it.
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
