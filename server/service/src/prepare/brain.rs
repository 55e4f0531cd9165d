//! The mask of the brain: supplied, the volume's own, or extracted.

use geometry::{BrainMask, Envelope, GeometryError, Grid, Mask, Volume};

use super::failure::{from_geometry, from_imaging};
use super::own_mask::own_mask;
use super::steps::Steps;
use super::{Limits, Source, StoredBrain};
use crate::case::{Failure, MaskKind, MaskSource, Parameters, Stage};
use crate::quality::{self, MaskMethod, Quality};
use crate::store::codec::decode_brain;

/// No mask of a human brain is smaller or larger, in ml: that of an infant born early has more than 100, a whole head with all
/// its scalp less than 7,000.
const POSSIBLE_ML: std::ops::RangeInclusive<f64> = 50.0..=8000.0;

/// The brain of a head, and where it came from.
pub(super) struct Found {
    pub(super) brain: BrainMask,
    verdict: Verdict,
}

/// What is known of a mask before it is closed.
enum Verdict {
    Measured {
        method: MaskMethod,
        largest_component: f64,
    },
    /// From an earlier preparation.
    Known(Quality),
}

impl Found {
    /// How far the mask can be trusted.
    pub(super) fn quality(&self, envelope: &Envelope, volume_grid: &Grid) -> Quality {
        match &self.verdict {
            Verdict::Known(quality) => quality.clone(),
            Verdict::Measured {
                method,
                largest_component,
            } => {
                let measured =
                    quality::measure(&self.brain, envelope, *largest_component, volume_grid);
                quality::of_supplied(measured, *method)
            }
        }
    }
}

/// Finds the brain of an upload and brings it to the working grid, as the parameters say.
pub(super) fn find_brain(
    source: &Source,
    volume: &Volume,
    (parameters, limits): (&Parameters, &Limits),
    steps: &mut Steps<'_>,
) -> Result<Found, Failure> {
    if let Some(stored) = &source.brain
        && let Some(found) = stored_brain(stored)
    {
        steps.begin(Stage::Mask)?;
        return Ok(found);
    }
    let Some((mask, method)) = given_mask(source, volume, (parameters, limits))? else {
        return Err(mask_missing());
    };
    steps.begin(Stage::Mask)?;
    Ok(Found {
        brain: to_working_grid(&mask, parameters, volume.grid())?,
        verdict: Verdict::Measured {
            method,
            largest_component: mask.largest_component_share(),
        },
    })
}

fn stored_brain(stored: &StoredBrain) -> Option<Found> {
    Some(Found {
        brain: decode_brain(&stored.mask)?,
        verdict: Verdict::Known(stored.quality.clone()),
    })
}

/// The mask that was supplied, or that the volume is of itself; `None` where the brain must be extracted.
pub(super) fn given_mask(
    source: &Source,
    volume: &Volume,
    (parameters, limits): (&Parameters, &Limits),
) -> Result<Option<(Mask, MaskMethod)>, Failure> {
    match (&source.mask, parameters.mask) {
        (Some(bytes), MaskSource::Auto) => {
            let mask = imaging::nifti::read_mask(bytes, limits).map_err(|error| {
                let failure = from_imaging(error);
                Failure {
                    detail: format!("the mask: {}", failure.detail),
                    ..failure
                }
            })?;
            Ok(Some((mask, MaskMethod::Supplied)))
        }
        (Some(_), MaskSource::Volume) => Err(Failure::unprocessable(
            "mask-twice",
            "a mask was supplied, and `mask` says to take the volume's own: leave one of them away"
                .to_owned(),
        )),
        (None, wanted) => match (own_mask(volume)?, wanted) {
            (Some(mask), _) => Ok(Some((mask, MaskMethod::Volume))),
            (None, MaskSource::Auto) => Ok(None),
            (None, MaskSource::Volume) => Err(mask_missing()),
        },
    }
}

/// A mask on the working grid, moved by the offset.
///
/// # Errors
/// When it is empty, largely outside of the volume, or of a size that no brain has.
pub(super) fn to_working_grid(
    mask: &Mask,
    parameters: &Parameters,
    volume_grid: &Grid,
) -> Result<BrainMask, Failure> {
    let brain = BrainMask::from_mask(mask, volume_grid).map_err(from_geometry)?;
    refuse_absurd(&brain)?;
    if parameters.offset_mm == 0.0 {
        return Ok(brain);
    }
    let moved = geometry::offset(&brain, parameters.offset_mm).map_err(|error| match error {
        GeometryError::EmptyMask => Failure::unprocessable(
            "offset-out-of-range",
            format!(
                "offset_mm is {}; nothing is left of the mask then",
                parameters.offset_mm
            ),
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
    // Three digits, however small it is.
    let digits = (2.0 - brain_ml.max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize;
    Err(Failure::unprocessable(
        "mask-size-absurd",
        format!(
            "the mask holds {brain_ml:.digits$} ml, and a brain {least} to {most}: is it a mask of the brain, and its spacing in mm?"
        ),
    ))
}

/// The radius by which the mask is closed: an envelope is closed already.
pub(super) fn closing_radius_mm(parameters: &Parameters) -> f64 {
    match parameters.mask_kind {
        MaskKind::Brain => parameters.closing_radius_mm,
        MaskKind::Envelope => 0.0,
    }
}

pub(super) fn mask_missing() -> Failure {
    Failure::unprocessable(
        "mask-missing",
        "the volume shows more than a brain, so a mask of the brain is needed: supply one as the part `mask` of the upload \
         (NIfTI, brain voxels above 0), or upload a volume that is already skull-stripped (background exactly 0)"
            .to_owned(),
    )
}
