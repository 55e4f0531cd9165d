//! Registration by normalised mutual information: rigid, of another volume of the same head; affine, to the template of an atlas.

mod align;
mod blocks;
mod climb;
mod image;
mod metric;
mod pose;
mod samples;
mod search;
#[cfg(test)]
mod tests;

use geometry::{Envelope, Volume};
use glam::{DAffine3, Vec3};

use self::blocks::shifts_of_parts_mm;
use self::climb::{RIGID, climb};
use self::image::Image;
use self::metric::{BINS, Comparison, Score};
use self::pose::Pose;
use self::samples::{Range, Region, Samples};
use self::search::{LEAST_OVERLAP, by_worth, offsets, summits, worth};
use crate::{MidsagittalPlane, midsagittal_plane};

pub use self::align::{Aligned, Alignment, Misfit, align, shared_points};

/// The margin around the envelope that is compared too, in mm.
const MARGIN_MM: f64 = 8.0;
/// The distances between compared points, in mm: coarse, medium, fine.
const STEPS_MM: [f64; 3] = [8.0, 4.0, 2.0];
/// The greatest median shift of the parts of a correctly placed head, in mm.
const GREATEST_RESIDUAL_MM: f64 = 1.5;
/// A layer counts as mirrored if mirroring multiplies the information by more than this, whatever its parts. Another
/// head fits its mirror image about as well as itself.
const CLEAR_GAIN: f64 = 1.3;
/// The fewest parts for a median shift.
const FEWEST_PARTS: usize = 5;
/// The cosine of half of 60°: the search begins at turns of up to 30°, and what it finds farther from the header than this may be a head
/// at half a turn from its place.
const FAR_HALF_COSINE: f64 = 0.866;
/// A smaller motion counts as none, in mm.
const LEAST_MOTION_MM: f64 = 0.25;

/// Whether a placement can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The layer was moved to where it fits.
    Registered,
    /// The layer fits where its header places it.
    Unchanged,
    /// No placement can be trusted; the layer stays where its header places it.
    Failed(Doubt),
}

/// Why a placement cannot be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doubt {
    /// One of the volumes has a single intensity in the compared region.
    NoContrast,
    /// The layer covers too little of the head.
    Overlap,
    /// The layer fits better when mirrored: its file or its header swaps left and right.
    Mirrored,
    /// The parts of the head do not agree: this is another head, or no placement within the range fits.
    Parts,
}

/// The placement of a layer in the patient space of a case, and its verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// The rigid transform from the patient space of the layer to that of the case, LPS mm. The identity unless
    /// registered.
    pub case_from_layer: DAffine3,
    /// The best transform that was found, whether or not it can be trusted.
    pub best_case_from_layer: DAffine3,
    /// Normalised mutual information at the placement of the header: 1 for none, 2 for complete.
    pub nmi_before: f64,
    /// The same at the best placement.
    pub nmi_after: f64,
    /// The fraction of the compared points that the layer covers at that placement, 0 to 1.
    pub overlap: f64,
    /// The median shift at which the parts of the head fit best, each by itself, in mm. `None` if the layer covers too
    /// few parts.
    pub residual_mm: Option<f64>,
    /// Whether the placement can be trusted.
    pub verdict: Verdict,
}

/// Finds the rigid placement of `layer` in the patient space of `case`, which contains `envelope`.
///
/// The volumes are compared inside the envelope, grown by 8 mm, at points 8, 4 and 2 mm apart, by normalised mutual
/// information with 48 bins. The histogram of the layer is a Parzen estimate with cubic B-splines, so that the gradient
/// is exact. On the coarsest images, poses around the header and around two alignments of the whole volumes are tried;
/// quasi-Newton steps improve the best ones. This finds motions of up to about 30° and any shift, for any contrast,
/// orientation of the voxels and partial coverage.
///
/// The verdict depends on the parts of the head: cubes of 36 mm, each shifted to where it fits best. In the same head
/// at the correct placement they stay; in another head, or at a wrong placement, most of them move by millimetres. The
/// layer must also fit better than its mirror image.
///
/// The same volumes give the same result on every machine. A call takes about one second of CPU time.
///
/// Sources: Studholme, Hill and Hawkes, "An overlap invariant entropy measure of 3D medical image alignment", Pattern
/// Recognition 32, 1999; Thévenaz and Unser, "Optimization of mutual information for multiresolution image
/// registration", IEEE Trans. Image Processing 9, 2000 (Parzen windows, slopes).
pub fn register(case: &Volume, envelope: &Envelope, layer: &Volume) -> Registration {
    let pair = Pair::new(case, envelope, layer);
    let identity = Pose::identity(pair.region.centre);
    let radius_mm = pair.region.radius_mm;
    let middle = pair
        .begun()
        .into_iter()
        .map(|pose| pair.climbed::<RIGID>(1, pose));
    let best = by_worth(middle.map(|(pose, score)| (worth(score), pose)))[0];
    let fine = pair.comparison(2, Some(best));
    let (pose, score) = climb::<RIGID>(&fine, best, radius_mm, STEPS_MM[2]);
    let plane = midsagittal_plane(envelope, case);
    let residual_mm = median(shifts_of_parts_mm(&fine, pose, STEPS_MM[2]));
    let doubt = if score.overlap < LEAST_OVERLAP {
        Some(Doubt::Overlap)
    } else if fine.is_flat() {
        Some(Doubt::NoContrast)
    } else {
        doubt(residual_mm, pair.gain_of_mirroring(&plane, pose))
    };
    let verdict = match doubt {
        Some(doubt) => Verdict::Failed(doubt),
        None if pose.distance_mm(identity, radius_mm) < LEAST_MOTION_MM => Verdict::Unchanged,
        None => Verdict::Registered,
    };
    Registration {
        case_from_layer: match verdict {
            Verdict::Registered => pose.case_from_layer(),
            Verdict::Unchanged | Verdict::Failed(_) => DAffine3::IDENTITY,
        },
        best_case_from_layer: pose.case_from_layer(),
        nmi_before: fine.score(identity).nmi,
        nmi_after: score.nmi,
        overlap: score.overlap,
        residual_mm,
        verdict,
    }
}

/// The doubt about a placement, from the median shift of the parts and the gain of mirroring.
fn doubt(residual_mm: Option<f64>, gain_of_mirroring: f64) -> Option<Doubt> {
    let Some(residual_mm) = residual_mm else {
        return Some(Doubt::Overlap);
    };
    let do_parts_fit = residual_mm <= GREATEST_RESIDUAL_MM;
    if gain_of_mirroring > CLEAR_GAIN || (do_parts_fit && gain_of_mirroring > 1.0) {
        Some(Doubt::Mirrored)
    } else if do_parts_fit {
        None
    } else {
        Some(Doubt::Parts)
    }
}

fn median(mut lengths_mm: Vec<f32>) -> Option<f64> {
    if lengths_mm.len() < FEWEST_PARTS {
        return None;
    }
    lengths_mm.sort_by(f32::total_cmp);
    Some(f64::from(lengths_mm[lengths_mm.len() / 2]))
}

/// Two volumes at three resolutions, coarse to fine, and the compared points.
struct Pair {
    region: Region,
    places: [Vec<Vec3>; 3],
    case: [Image; 3],
    layer: [Image; 3],
}

impl Pair {
    fn new(case: &Volume, envelope: &Envelope, layer: &Volume) -> Self {
        let region = Region::around(envelope, MARGIN_MM);
        Self {
            places: STEPS_MM.map(|step_mm| region.places(step_mm)),
            case: pyramid(case),
            layer: pyramid(layer),
            region,
        }
    }

    /// The rigid poses that fit best on the coarsest images.
    fn begun(&self) -> Vec<Pose> {
        let centre = self.region.centre;
        let coarse = self.comparison(0, None);
        let offsets = offsets(&self.case[0], &self.layer[0], centre);
        summits(
            &coarse,
            &offsets,
            Pose::identity(centre),
            self.region.radius_mm,
        )
    }

    /// The best pose near another one, at one resolution.
    fn climbed<const N: usize>(&self, level: usize, pose: Pose) -> (Pose, Score) {
        let comparison = self.comparison(level, Some(pose));
        climb::<N>(&comparison, pose, self.region.radius_mm, STEPS_MM[level])
    }

    /// The ratio by which the information grows when the case is mirrored.
    ///
    /// Both placements climb from the same pose at the same resolution: the pose was found at a finer one, and if the mirrored case alone
    /// climbed, a layer of weak contrast, or of a head whose sides differ little, would seem to fit the mirror image better. Far from the
    /// header the mirrored case alone climbs: the two do not tell a head from one at half a turn.
    fn gain_of_mirroring(&self, plane: &MidsagittalPlane, pose: Pose) -> f64 {
        let plain = self.comparison(1, Some(pose));
        let information = |comparison: &Comparison| {
            let radius_mm = self.region.radius_mm;
            let (_, score) = climb::<RIGID>(comparison, pose, radius_mm, STEPS_MM[1]);
            worth(score) - 1.0
        };
        let known = if pose.cosine_of_half_turn() < FAR_HALF_COSINE {
            plain.score(pose).nmi - 1.0
        } else {
            information(&plain)
        };
        information(&plain.mirrored(self.region.centre, plane)) / known.max(1e-9)
    }

    /// The volumes at one resolution. The bins of the layer cover the intensities that occur at a pose, or all
    /// intensities.
    fn comparison(&self, level: usize, pose: Option<Pose>) -> Comparison {
        let (centre, layer) = (self.region.centre, &self.layer[level]);
        let samples = Samples::new(&self.places[level], centre, &self.case[level], BINS);
        let range = pose.map(|pose| {
            let voxel_from_case = layer.patient_from_voxel.inverse() * pose.layer_from_case();
            let met = |place: &Vec3| {
                layer.sample(voxel_from_case.transform_point3(place.as_dvec3() + centre))
            };
            Range::of(&samples.places.iter().filter_map(met).collect::<Vec<f32>>())
        });
        Comparison::new(
            samples,
            layer,
            range.unwrap_or_else(|| Range::of(&layer.values)),
        )
    }
}

fn pyramid(volume: &Volume) -> [Image; 3] {
    let fine = Image::new(volume, STEPS_MM[2]);
    let middle = fine.coarser(STEPS_MM[1]);
    let coarse = middle.coarser(STEPS_MM[0]);
    [coarse, middle, fine]
}
