//! Rates supplied masks.
//!
//! A mask is rated by its size, its components, the faces it touches, the contrast across its border, and its share of
//! the head. If these leave a doubt, the network extracts the brain too, and the overlap decides.

use geometry::{BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DVec3};

use crate::ExtractionError;
use crate::methods::{Extraction, closed};
use crate::quality::{Doubt, MaskNumbers, Verdict, contrast, doubt, review_if};
use crate::rim::{Rim, rim};

/// A supplied mask, in both forms.
#[derive(Debug, Clone, Copy)]
pub struct Supplied<'a> {
    /// The supplied mask, on its own grid.
    pub mask: &'a Mask,
    /// The mask on the working grid.
    pub brain: &'a BrainMask,
    /// The volume it was supplied with.
    pub volume: &'a Volume,
}

/// The rating of a supplied mask.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The worst of the doubts.
    pub verdict: Verdict,
    /// The doubts; empty if the verdict is [`Verdict::Ok`].
    pub doubts: Vec<Doubt>,
    /// As [`crate::Quality::contrast`].
    pub contrast: Option<f64>,
    /// How well its border fits the volume.
    pub rim: Option<Rim>,
    /// The overlap with the mask from the network (Dice of their envelopes), if the network was used.
    pub overlap: Option<f64>,
}

/// The least fit of the border for which the network is not used, and the least gain over other positions.
const LEAST_RIM: f64 = 0.65;
const LEAST_GAIN: f64 = 0.0;

/// The fit from which on a mask is in the right place whatever the gain: masks of other heads reach 0.61, and right ones
/// moved by 4 mm 0.90. A ragged mask within the brain may fit as well a few millimetres aside.
const SURE_RIM: f64 = 0.92;

/// The least overlap for a mask to be ok, and the overlap below which it is the mask of something else.
const SURE_OVERLAP: f64 = 0.94;
const LEAST_OVERLAP: f64 = 0.7;

/// The greatest distance between voxel centres of two grids that still coincide, in voxels.
const SAME_PLACE: f64 = 0.05;

/// Rates a supplied mask.
///
/// Only if there is a doubt, `ask` is called to extract the brain with the network. Without a network, or if its result
/// cannot be trusted, the doubt remains.
///
/// # Errors
/// The errors of `ask`, except [`ExtractionError::NoBrain`]; and if the voxels are too small for the default closing.
pub fn judge(
    supplied: Supplied<'_>,
    ask: impl FnOnce() -> Result<Option<Extraction>, ExtractionError>,
) -> Result<Judgement, ExtractionError> {
    let Supplied {
        mask,
        brain,
        volume,
    } = supplied;
    let closed = closed(brain, volume)?;
    let numbers = MaskNumbers {
        volume_ml: brain.volume_ml(),
        largest_component: mask.largest_component_share(),
        cut_area_cm2: brain.cut_area_cm2(volume.grid()),
    };
    let contrast = contrast(volume, &closed);
    let rim = rim(volume, &closed);
    let mut doubts = numbers.doubts();
    doubts.extend(rim.and_then(doubt_of_side));
    let open: Vec<Doubt> = [doubt_of_rim(rim), doubt_of_grid(mask.grid(), volume.grid())]
        .into_iter()
        .flatten()
        .collect();
    let mut overlap = None;
    if !open.is_empty() {
        let found = match ask() {
            Err(ExtractionError::NoBrain { .. }) => None,
            found => found?.filter(|found| found.quality.is_sure_of_itself()),
        };
        overlap = found.map(|found| dice(closed.envelope().mask(), found.closed.envelope().mask()));
        match overlap {
            Some(overlap) => doubts.extend(doubt_of_overlap(overlap)),
            None => doubts.extend(open),
        }
    }
    let verdicts = doubts.iter().map(|doubt| doubt.verdict);
    Ok(Judgement {
        verdict: verdicts.max().unwrap_or(Verdict::Ok),
        doubts,
        contrast,
        rim,
        overlap,
    })
}

fn doubt_of_rim(rim: Option<Rim>) -> Option<Doubt> {
    let here = rim.map_or(0.0, |rim| rim.here);
    let fits = here >= LEAST_RIM;
    let is_placed = here >= SURE_RIM || rim.is_some_and(|rim| here - rim.elsewhere >= LEAST_GAIN);
    doubt(review_if(!fits || !is_placed), "mask-rim", || {
        if fits {
            "the border of the mask fits the volume as well when the mask is moved by 4 mm or turned by 5°, so the mask may lie in the wrong \
             place or be too rough; compare its outline with the slices"
                .to_owned()
        } else {
            format!(
                "{:.0} % of the border of the mask does not look like the border of a brain, with brain inside and something darker \
                 outside; is this the mask of this head?",
                100.0 * (1.0 - here)
            )
        }
    })
}

fn doubt_of_side(rim: Rim) -> Option<Doubt> {
    doubt(review_if(rim.flipped > rim.here), "mask-flipped", || {
        "the mask fits the volume better when flipped along an axis; was it stored with other axes?"
            .to_owned()
    })
}

fn doubt_of_grid(mask: &Grid, volume: &Grid) -> Option<Doubt> {
    doubt(review_if(!share_places(mask, volume)), "mask-grid", || {
        "the voxels of the mask and of the volume do not coincide; is this the mask of this head?"
            .to_owned()
    })
}

fn doubt_of_overlap(overlap: f64) -> Option<Doubt> {
    let verdict = if overlap < LEAST_OVERLAP {
        Verdict::Failed
    } else {
        review_if(overlap < SURE_OVERLAP)
    };
    doubt(verdict, "mask-overlap", || {
        format!(
            "the mask and the brain found by the network overlap by {overlap:.3} (Dice); a correct mask reaches {SURE_OVERLAP}"
        )
    })
}

/// The Dice coefficient of two sets on isotropic grids along the patient axes, at the voxels of the first.
fn dice(a: &Mask, b: &Mask) -> f64 {
    let b_from_a = b.grid().voxel_from_patient() * a.grid().patient_from_voxel();
    let size = b.grid().size();
    let is_in_b = |index: usize| {
        let place = as_position(a.grid().voxel(index));
        let place = b_from_a.transform_point3(place).round().to_array();
        let is_inside = (0..3).all(|axis| (0.0..size[axis] as f64).contains(&place[axis]));
        is_inside && b.voxels()[b.grid().index(place.map(|along| along as usize))]
    };
    let marked = (0..a.voxels().len()).filter(|&index| a.voxels()[index]);
    let both = marked.filter(|&index| is_in_b(index)).count() as f64;
    let both_ml = both * a.grid().spacing_mm()[0].powi(3) / 1000.0;
    2.0 * both_ml / (a.volume_ml() + b.volume_ml())
}

/// Whether the voxel centres of one grid are among those of another grid or of its working grid.
fn share_places(mask: &Grid, volume: &Grid) -> bool {
    let finest = volume
        .spacing_mm()
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let is_working = mask.is_isotropic()
        && mask.reordered_to_patient_axes().is_some()
        && (mask.spacing_mm()[0] / finest - 1.0).abs() < 1e-3;
    let volume_from_mask = volume.voxel_from_patient() * mask.patient_from_voxel();
    is_working && is_oblique_or_thick(volume) || is_whole(volume_from_mask, mask.size())
}

/// Whether the working grid of a volume differs from its own grid.
fn is_oblique_or_thick(volume: &Grid) -> bool {
    let own = volume.reordered_to_patient_axes();
    own.is_none_or(|grid| !grid.is_isotropic())
}

/// Whether an affine maps the corners of a grid to integer coordinates, in steps of one voxel.
fn is_whole(affine: DAffine3, size: [usize; 3]) -> bool {
    let steps = affine.matrix3.to_cols_array();
    let are_steps = steps
        .iter()
        .all(|step| (step - step.round()).abs() < SAME_PLACE && step.abs() < 1.5);
    let corner = as_position(size.map(|side| side - 1));
    let ends = [DVec3::ZERO, corner].map(|end| affine.transform_point3(end));
    let are_centres = ends
        .iter()
        .all(|end| (*end - end.round()).abs().max_element() < SAME_PLACE);
    are_steps && are_centres
}

fn as_position(voxel: [usize; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|place| place as f64))
}
