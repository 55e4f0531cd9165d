//! What can be told of an upload at once, before it is queued.

use std::time::{Duration, Instant};

use super::Limits;
use super::brain::{Placed, closing_radius_mm, given_mask, moved};
use super::extractor::network_missing;
use super::failure::from_geometry;
use super::source::{Source, read_sound_volume, read_volume};
use case::{Failure, MaskSource, Parameters};
use geometry::Volume;

/// An upload that can be prepared.
#[derive(Debug)]
pub struct Checked {
    /// The parameters with which it will be, as [`settled`] makes them.
    pub parameters: Parameters,
    /// What was read, so that the preparation need not read it again.
    pub read: ReadSource,
}

/// The volume of an upload, read, and its mask.
#[derive(Debug)]
pub struct ReadSource {
    pub(super) volume: Volume,
    /// `None` if the brain must be extracted.
    pub(super) given: Option<Placed>,
    /// How long reading took.
    pub(super) took: Duration,
}

/// What a preparation begins with.
#[derive(Debug)]
pub struct Input<'a> {
    /// The upload. If it was read already, neither its volume nor its mask is looked at.
    pub source: &'a Source,
    /// What was read of it.
    pub read: Option<ReadSource>,
}

impl<'a> From<&'a Source> for Input<'a> {
    fn from(source: &'a Source) -> Self {
        Self { source, read: None }
    }
}

/// Whether an upload can be prepared, as far as reading it and bringing its mask to the working grid tell.
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
) -> Result<Checked, Failure> {
    parameters.check()?;
    let begun = Instant::now();
    let volume = read_sound_volume(source, limits)?;
    let given = given_mask(source, &volume, (&parameters, limits))?;
    let given = given.map(|given| given.on_working_grid(volume.grid()));
    let read = ReadSource {
        given: given.transpose()?,
        volume,
        took: begun.elapsed(),
    };
    let parameters = match &read.given {
        Some(given) => {
            let moved = match parameters.offset_mm {
                0.0 => None,
                offset_mm => Some(moved(given.brain.clone(), offset_mm)?),
            };
            let grid = moved.as_ref().unwrap_or(&given.brain).mask().grid();
            let radius_mm = closing_radius_mm(&parameters);
            geometry::check_closing(grid, radius_mm).map_err(from_geometry)?;
            parameters
        }
        // Whether there is a brain in the volume, the extraction tells.
        None => extracting(parameters, has_network)?,
    };
    Ok(Checked { parameters, read })
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
