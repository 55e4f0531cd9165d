//! Checks an upload before it is queued.

use std::time::{Duration, Instant};

use super::Limits;
use super::brain::{Placed, closing_radius_mm, given_mask, moved};
use super::extractor::{from_extraction, network_missing};
use super::failure::from_geometry;
use super::source::{Source, read_sound_volume};
use case::{Failure, MaskSource, Parameters};
use geometry::Volume;
use imaging::nifti::Replaced;

/// An upload that passed the checks.
#[derive(Debug)]
pub struct Checked {
    /// The parameters for the preparation, as from [`settled`].
    pub parameters: Parameters,
    /// The decoded upload, so that the preparation need not read it again.
    pub read: ReadSource,
}

/// The decoded volume of an upload, and its mask.
#[derive(Debug)]
pub struct ReadSource {
    pub(super) volume: Volume,
    /// The voxels of the volume that were replaced.
    pub(super) replaced: Replaced,
    /// `None` if the brain must be extracted.
    pub(super) given: Option<Placed>,
    /// The time for reading.
    pub(super) took: Duration,
}

/// The input of a preparation.
#[derive(Debug)]
pub struct Input<'a> {
    /// The upload. If `read` is present, its volume and mask are not used.
    pub source: &'a Source,
    /// The decoded upload, if it has been read already.
    pub read: Option<ReadSource>,
}

impl<'a> From<&'a Source> for Input<'a> {
    fn from(source: &'a Source) -> Self {
        Self { source, read: None }
    }
}

/// Checks an upload by reading it and resampling its mask to the working grid.
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
) -> Result<Checked, Failure> {
    parameters.check()?;
    let begun = Instant::now();
    let (volume, replaced) = read_sound_volume(source, limits)?;
    let given = given_mask(source, &volume, &parameters, limits)?;
    let given = given.map(|given| given.on_working_grid(volume.grid()));
    let read = ReadSource {
        given: given.transpose()?,
        volume,
        replaced,
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
        // The extraction finds out whether there is a brain in the volume; what is no head at all is known at once.
        None => {
            extraction::check_foreground(&read.volume).map_err(from_extraction)?;
            extracting(parameters, has_network)?
        }
    };
    Ok(Checked { parameters, read })
}

/// The parameters for the preparation, and what was read to find them. If the brain must be extracted without a network,
/// the method becomes `pruning`, so that the case differs from the one that a network would make from the same upload.
///
/// An unusable input changes nothing; the preparation reports what is wrong with it.
pub fn settled(
    source: &Source,
    parameters: Parameters,
    limits: &Limits,
    has_network: bool,
) -> (Parameters, Option<ReadSource>) {
    let is_open = parameters.mask == MaskSource::Auto && source.mask.is_none() && !has_network;
    if is_open && let Ok(checked) = check(source, parameters.clone(), limits, has_network) {
        return (checked.parameters, Some(checked.read));
    }
    (parameters, None)
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
