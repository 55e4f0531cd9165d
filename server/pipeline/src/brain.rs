//! Finds the brain mask: supplied, from a skull-stripped volume, or extracted.

use extraction::{ExtractionError, Masked, Opinion, Origin, closed, rate};
use geometry::{
    BrainMask, ClosedBrain, Cut, DistanceMap, Envelope, GeometryError, Grid, Mask, Volume,
};
use imaging::nifti::Replaced;

use super::cuts::cuts_of;
use super::extractor::from_extraction;
use super::failure::{from_geometry, from_imaging};
use super::own_mask::own_mask;
use super::steps::Steps;
use super::{Extractor, How, Limits, Source, StoredBrain};
use crate::codec::decode_brain;
use crate::quality;
use case::{Failure, MaskKind, MaskMethod, MaskSource, Parameters, Quality, Stage};

/// The limits for the mask of a human brain, in ml: a preterm infant has more than 100, a whole head with its scalp
/// less than 7,000.
const POSSIBLE_ML: std::ops::RangeInclusive<f64> = 50.0..=8000.0;

/// The brain of a head and its origin.
pub(super) struct Found {
    pub(super) brain: BrainMask,
    /// The faces of the field of view that cut it.
    cuts: Vec<Cut>,
    /// The depth below its envelope, if the extraction or the rating has already closed it by the requested radius.
    closed: Option<DistanceMap>,
    quality: MaskQuality,
}

/// The quality of a mask.
enum MaskQuality {
    Measured(MaskMethod, Box<extraction::Quality>),
    /// From an earlier preparation.
    Stored(Box<Quality>),
}

impl Found {
    /// The brain, closed according to the parameters.
    pub(super) fn close(&mut self, parameters: &Parameters) -> Result<ClosedBrain, Failure> {
        if let Some(distance) = self.closed.take() {
            return Ok(ClosedBrain::Measured(distance));
        }
        let radius_mm = closing_radius_mm(parameters);
        let envelope = geometry::cut_envelope(&self.brain, radius_mm, &self.cuts);
        Ok(ClosedBrain::Envelope(envelope.map_err(from_geometry)?))
    }

    /// Adds to the rating what is unusual about the source of the volume. A rebuilt case has the rating of its first preparation.
    pub(super) fn rate_source(
        &mut self,
        envelope: &Envelope,
        volume_grid: &Grid,
        replaced: &Replaced,
        are_axes_assumed: bool,
    ) {
        if let MaskQuality::Measured(_, measured) = &mut self.quality {
            let holes = replaced.enclosed.as_ref();
            let inside = holes.map_or(0, |holes| holes.count_within(envelope.mask()));
            measured.rate_source(volume_grid, inside, are_axes_assumed);
        }
    }

    /// The quality of the mask.
    pub(super) fn quality(&self, envelope: &Envelope, volume_grid: &Grid) -> Quality {
        match &self.quality {
            MaskQuality::Stored(quality) => (**quality).clone(),
            MaskQuality::Measured(method, measured) => {
                quality::of(&self.brain, envelope, *method, measured, volume_grid)
            }
        }
    }
}

/// Finds the brain of an upload on the working grid, according to the parameters.
pub(super) fn find_brain(
    source: &Source,
    volume: &Volume,
    how: How<'_>,
    steps: &mut Steps<'_>,
) -> Result<Found, Failure> {
    let How {
        parameters,
        extractor,
        ..
    } = how;
    if let Some(stored) = &source.brain
        && let Some(found) = stored_brain(stored)
    {
        steps.begin(Stage::Mask)?;
        return Ok(found);
    }
    let Some(given) = given_mask(source, volume, parameters, how.limits)? else {
        steps.begin(Stage::Extracting)?;
        return extracted(volume, parameters, extractor, steps);
    };
    steps.begin(Stage::Mask)?;
    let Placed {
        mask,
        method,
        brain,
    } = given.on_working_grid(volume.grid())?;
    let (closed, cuts) = closed(&brain, volume).map_err(from_extraction)?;
    let masked = Masked {
        mask: &mask,
        brain: &brain,
        closed: &closed,
        cuts: &cuts,
        volume,
    };
    let found = extractor.second_opinion(volume, steps.cancelled());
    let network = match &found {
        Ok(None) => Opinion::NotAsked,
        Ok(Some(None)) => Opinion::Uncertain,
        Ok(Some(Some(found))) => Opinion::Brain(found),
        Err(ExtractionError::NoBrain { .. }) => Opinion::NoBrain,
        Err(error) => return Err(from_extraction(error.clone())),
    };
    let origin = match method {
        MaskMethod::Volume => Origin::Stripped(network),
        _ => Origin::Supplied(network),
    };
    let measured = rate(masked, origin).map_err(from_extraction)?;
    Ok(Found {
        cuts: moved_cuts(cuts.cuts, parameters.offset_mm),
        brain: moved(brain, parameters.offset_mm)?,
        closed: is_closed_so(parameters).then_some(closed),
        quality: MaskQuality::Measured(method, Box::new(measured)),
    })
}

/// Whether the parameters close a brain as it is closed for its rating.
fn is_closed_so(parameters: &Parameters) -> bool {
    parameters.offset_mm == 0.0 && closing_radius_mm(parameters) == extraction::CLOSING_RADIUS_MM
}

/// The faces that cut a brain, adjusted for a later offset of its surface.
fn moved_cuts(cuts: Vec<Cut>, offset_mm: f64) -> Vec<Cut> {
    let inwards_mm = (-offset_mm).max(0.0);
    cuts.into_iter()
        .map(|cut| cut.moved_inwards(inwards_mm))
        .collect()
}

/// Extracts the brain of a volume.
fn extracted(
    volume: &Volume,
    parameters: &Parameters,
    extractor: &Extractor,
    steps: &mut Steps<'_>,
) -> Result<Found, Failure> {
    let found = extractor.extract(
        volume,
        parameters.mask,
        parameters.threshold,
        &|done| steps.extracted(done),
        steps.cancelled(),
    )?;
    steps.begin(Stage::Mask)?;
    refuse_absurd(&found.brain)?;
    Ok(Found {
        cuts: moved_cuts(found.cuts.cuts, parameters.offset_mm),
        closed: is_closed_so(parameters).then_some(found.closed),
        brain: moved(found.brain, parameters.offset_mm)?,
        quality: MaskQuality::Measured(quality::method_of(found.method), Box::new(found.quality)),
    })
}

fn stored_brain(stored: &StoredBrain) -> Option<Found> {
    Some(Found {
        cuts: cuts_of(&stored.cuts),
        brain: decode_brain(&stored.mask)?,
        closed: None,
        quality: MaskQuality::Stored(Box::new(stored.quality.clone())),
    })
}

/// The supplied mask, or the mask from a skull-stripped volume.
#[derive(Debug)]
pub(super) struct Given {
    mask: Mask,
    method: MaskMethod,
}

/// A mask that was resampled to the working grid.
#[derive(Debug)]
pub(super) struct Placed {
    mask: Mask,
    method: MaskMethod,
    pub(super) brain: BrainMask,
}

impl Given {
    /// Resamples the mask to the working grid of a volume.
    ///
    /// # Errors
    /// If it is empty, mostly outside the volume, or of an impossible size.
    pub(super) fn on_working_grid(self, volume_grid: &Grid) -> Result<Placed, Failure> {
        let Self { mask, method } = self;
        let brain = BrainMask::from_mask(&mask, volume_grid).map_err(from_geometry)?;
        refuse_absurd(&brain).map_err(|failure| match POSSIBLE_ML.contains(&mask.volume_ml()) {
            true => Failure {
                detail: format!(
                    "{}; the whole mask has {:.0} ml, but the largest piece counts: are slices of it missing?",
                    failure.detail,
                    mask.volume_ml()
                ),
                ..failure
            },
            false => failure,
        })?;
        Ok(Placed {
            mask,
            method,
            brain,
        })
    }
}

/// The supplied mask, or the mask from a skull-stripped volume; `None` if the brain must be extracted.
pub(super) fn given_mask(
    source: &Source,
    volume: &Volume,
    parameters: &Parameters,
    limits: &Limits,
) -> Result<Option<Given>, Failure> {
    match (&source.mask, parameters.mask) {
        (Some(bytes), MaskSource::Auto) => {
            let mask = imaging::nifti::read_mask(bytes, limits).map_err(|error| {
                let failure = from_imaging(error);
                Failure {
                    detail: format!("the mask: {}", failure.detail),
                    ..failure
                }
            })?;
            let method = MaskMethod::Supplied;
            Ok(Some(Given { mask, method }))
        }
        (Some(_), _) => Err(Failure::unusable(
            "mask-twice",
            "send either a mask file or the parameter `mask`, not both".to_owned(),
        )),
        (None, MaskSource::Network | MaskSource::Pruning) => Ok(None),
        (None, wanted) => match (own_mask(volume)?, wanted) {
            (Some(mask), _) => {
                let method = MaskMethod::Volume;
                Ok(Some(Given { mask, method }))
            }
            (None, MaskSource::Volume) => Err(mask_missing()),
            (None, _) => Ok(None),
        },
    }
}

/// A mask moved by an offset.
pub(super) fn moved(brain: BrainMask, offset_mm: f64) -> Result<BrainMask, Failure> {
    if offset_mm == 0.0 {
        return Ok(brain);
    }
    let moved = geometry::offset(&brain, offset_mm).map_err(|error| match error {
        GeometryError::EmptyMask => Failure::unusable(
            "offset-out-of-range",
            format!("offset_mm is {offset_mm}; nothing is left of the mask"),
        ),
        other => from_geometry(other),
    })?;
    refuse_absurd(&moved)?;
    Ok(moved)
}

fn refuse_absurd(brain: &BrainMask) -> Result<(), Failure> {
    let brain_ml = brain.volume_ml();
    if POSSIBLE_ML.contains(&brain_ml) {
        return Ok(());
    }
    let (least, most) = POSSIBLE_ML.into_inner();
    // Three significant digits.
    let digits = (2.0 - brain_ml.max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize;
    Err(Failure::unusable(
        "mask-size-absurd",
        format!(
            "the mask has {brain_ml:.digits$} ml, but a brain has {least} to {most} ml; is it a brain mask, with its spacing in mm?"
        ),
    ))
}

/// The closing radius; an envelope is not closed.
pub(super) fn closing_radius_mm(parameters: &Parameters) -> f64 {
    match parameters.mask_kind {
        MaskKind::Brain => parameters.closing_radius_mm,
        MaskKind::Envelope => 0.0,
    }
}

fn mask_missing() -> Failure {
    Failure::unusable(
        "mask-missing",
        "the volume is not skull-stripped; omit `mask` to have the brain \
         extracted, or supply a mask as the part `mask` of the upload (NIfTI, brain voxels above 0)"
            .to_owned(),
    )
}
