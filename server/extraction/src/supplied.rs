//! Whether a mask that somebody supplied is that of the volume's brain.
//!
//! It is judged by its size, its parts and the faces it touches, by what the volume shows across its border, and by how much of it is
//! head at all. Where these let doubt, the network is asked, and what it finds decides.

use geometry::{BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DVec3};

use crate::ExtractionError;
use crate::extract::{Extraction, closed};
use crate::quality::{Doubt, MaskNumbers, Verdict, contrast, doubt, review_if};
use crate::rim::{Rim, rim};

/// A supplied mask, and what became of it.
#[derive(Debug, Clone, Copy)]
pub struct Supplied<'a> {
    /// As it was supplied, on a grid of its own.
    pub mask: &'a Mask,
    /// On the working grid.
    pub brain: &'a BrainMask,
    /// The head that it is said to be the brain of.
    pub volume: &'a Volume,
}

/// What is thought of a supplied mask.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The worst of the doubts.
    pub verdict: Verdict,
    /// What lets doubt; empty when the verdict is [`Verdict::Ok`].
    pub doubts: Vec<Doubt>,
    /// As [`crate::Quality::contrast`].
    pub contrast: Option<f64>,
    /// How well its border fits to what the volume shows.
    pub rim: Option<Rim>,
    /// How far the mask agrees with the network's (Dice of their envelopes), if the network was asked.
    pub overlap: Option<f64>,
}

/// How well the border must fit for the mask to be believed without asking the network, and by how much better than elsewhere.
const LEAST_RIM: f64 = 0.65;
const LEAST_GAIN: f64 = 0.0;

/// How far a mask must agree with the network's to be believed, and below which agreement it is that of something else.
const SURE_OVERLAP: f64 = 0.94;
const LEAST_OVERLAP: f64 = 0.7;

/// How far voxel centres of two grids may lie apart and still be the same, in voxels.
const SAME_PLACE: f64 = 0.05;

/// Judges a mask that was supplied.
///
/// `ask` is called only if something lets doubt, for what the network finds in the volume. If there is no network, or if what it finds
/// cannot be believed, doubt remains.
///
/// # Errors
/// Those of `ask`, but for [`ExtractionError::NoBrain`]; and when the voxels are too fine for the usual closing.
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
    let is_sure =
        rim.is_some_and(|rim| rim.here >= LEAST_RIM && rim.here - rim.elsewhere >= LEAST_GAIN);
    doubt(review_if(!is_sure), "mask-rim", || {
        format!(
            "across {:.0} % of the mask's border there is no brain within or nothing darker around, or it fits as well elsewhere; is it \
             the mask of this head?",
            100.0 * (1.0 - here)
        )
    })
}

fn doubt_of_side(rim: Rim) -> Option<Doubt> {
    doubt(review_if(rim.flipped > rim.here), "mask-flipped", || {
        "the mask fits the volume better turned over along an axis; was it stored with other axes?"
            .to_owned()
    })
}

fn doubt_of_grid(mask: &Grid, volume: &Grid) -> Option<Doubt> {
    doubt(review_if(!share_places(mask, volume)), "mask-grid", || {
        "the mask's voxels lie elsewhere than the volume's; is it the mask of this head?".to_owned()
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
            "the mask and what the network takes for the brain overlap to {overlap:.3} (Dice), where they do to 0.97 if the mask is right"
        )
    })
}

/// The Dice coefficient of two sets on isotropic grids along the patient axes, by the voxels of the first.
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

/// Whether the voxel centres of one grid are among those of another, or on the working grid that belongs to it.
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

/// Whether a volume's working grid is another than its own.
fn is_oblique_or_thick(volume: &Grid) -> bool {
    let own = volume.reordered_to_patient_axes();
    own.is_none_or(|grid| !grid.is_isotropic())
}

/// Whether an affine brings the corners of a grid to whole coordinates, by steps of one voxel.
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
