//! Compares supplied masks with the brain that the network finds.
//!
//! The distance between the two envelopes counts. Without a network, or if the network is not certain of what it found, the
//! contrast across the border of the mask does.

use geometry::{BorderField, Cut, DistanceMap, Grid, Mask, as_position};
use glam::{DAffine3, DVec3};

use crate::ExtractionError;
use crate::rating::{Rating, Reason, reason, review_if};
use crate::rim::{Rim, flips};

/// A supplied mask compared with the mask from the network, by their envelopes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Their overlap (Dice).
    pub overlap: f64,
    /// How far they are apart.
    pub distance: SurfaceDistance,
    /// How much farther out the supplied mask is at the left than at the right, at the back than in front, and above than below, in mm:
    /// the differences of the mean signed distances. Masks that are shifted or wrong on one side are so along one axis.
    pub lopsided_mm: [f64; 3],
    /// The same with the supplied mask flipped along an axis of the volume, as by a program that reverses an axis: the nearest
    /// flip.
    pub flipped: SurfaceDistance,
}

/// How far two envelopes are apart: from the border of each to the border of the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceDistance {
    /// The 95th percentile of the distance, in mm.
    pub percentile_95_mm: f64,
    /// The mean signed distance, in mm: positive if the first is larger.
    pub mean_mm: f64,
    /// The root of the mean square of the distance, in mm.
    pub rms_mm: f64,
    /// The area of either border that lies more than 7 mm from the other, in cm²: the greater one.
    pub patch_cm2: f64,
}

/// The limits for a mask to be ok. Of ten masks of five heads by other programs, the farthest has 4.5 mm, 1.7 mm and 8 cm²; masks made
/// 3 mm smaller have a mean of 2.8 mm, and those turned by 10° or of other heads at least 5.0 mm.
const MOST_95_MM: f64 = 4.7;
const MOST_MEAN_MM: f64 = 2.3;
const MOST_PATCH_CM2: f64 = 10.0;

/// The most that a mask may be farther out on one side than on the opposite one, in mm. Of ten right masks of five heads by other
/// programs, the farthest has 2.3 mm (voxels of 3 mm; the others 2.0 mm). Of six heads, halves that are 4 mm too large or too small have
/// 3.1 mm and more, and shifts of 5 mm at least 6 mm.
const MOST_LOPSIDED_MM: f64 = 2.7;

/// The names of the sides that are compared.
const SIDES: [[&str; 2]; 3] = [["left", "right"], ["back", "front"], ["top", "bottom"]];

/// The distance from which on a border belongs to a patch, in mm.
const PATCH_MM: f64 = 7.0;

/// The overlap below which it is the mask of something else.
const LEAST_OVERLAP: f64 = 0.7;

/// How much nearer a flipped mask must be to count as the right one.
const NEARER: f64 = 0.9;

/// The least fit of the border without a network, and the least gain over other positions.
const LEAST_RIM: f64 = 0.65;
const LEAST_GAIN: f64 = 0.0;

/// The fit from which on a mask is in the right place whatever the gain: masks of other heads reach 0.61, and right ones
/// moved by 4 mm 0.90. A ragged mask within the brain may fit as well a few millimetres aside.
const SURE_RIM: f64 = 0.92;

/// The least gain of a flip by the fit of the border, without a network: masks that are too large or too small gain less.
const LEAST_GAIN_OF_FLIP: f64 = 0.03;

/// The least fit of the border of a mask that was flipped back: less fits nothing.
const LEAST_FLIPPED_RIM: f64 = 0.5;

/// The greatest distance between voxel centres of two grids that still coincide, in voxels.
const SAME_PLACE: f64 = 0.05;

/// What is unusual about the border of a mask that is compared with nothing else.
pub(crate) fn reasons_of_border(
    rim: Option<Rim>,
    mask: &Grid,
    volume: &Grid,
) -> impl Iterator<Item = Reason> {
    let reasons = [
        rim.and_then(reason_of_side),
        reason_of_rim(rim),
        reason_of_grid(mask, volume),
    ];
    reasons.into_iter().flatten()
}

impl Comparison {
    /// Compares a mask with that from the network; `None` if nothing of either border is dura.
    pub(crate) fn new(
        supplied: &DistanceMap,
        network: &DistanceMap,
        volume_grid: &Grid,
    ) -> Result<Option<Self>, ExtractionError> {
        let to_network = BorderField::new(network)?;
        let border = supplied.border();
        let cuts: Vec<Cut> = [supplied, network]
            .iter()
            .flat_map(|distance| distance.envelope().cuts())
            .copied()
            .collect();
        // Positive outside the network's envelope, where the supplied one is larger.
        let from_supplied = |how: DAffine3| {
            let places = border.iter().map(|&place| how.transform_point3(place));
            measured(places, &to_network, &cuts)
        };
        let here = from_supplied(DAffine3::IDENTITY);
        let lopsided_mm = lopsided(&here);
        let here = lengths(here);
        let flipped = flips(volume_grid).map(|flip| {
            let distances_mm = lengths(from_supplied(flip));
            let area_mm2 = supplied.border_voxel_mm2();
            SurfaceDistance::new(&[(distances_mm, area_mm2)])
        });
        drop(to_network);
        let to_supplied = BorderField::new(supplied)?;
        let back = measured(network.border().into_iter(), &to_supplied, &cuts);
        let back = lengths(back)
            .into_iter()
            .map(|distance_mm| -distance_mm)
            .collect::<Vec<f64>>();
        let distance = SurfaceDistance::new(&[
            (here, supplied.border_voxel_mm2()),
            (back, network.border_voxel_mm2()),
        ]);
        let nearest = flipped
            .into_iter()
            .flatten()
            .min_by(|a, b| a.rms_mm.total_cmp(&b.rms_mm));
        let overlap = dice(supplied.envelope().mask(), network.envelope().mask());
        Ok(distance.zip(nearest).map(|(distance, flipped)| Self {
            overlap,
            distance,
            lopsided_mm,
            flipped,
        }))
    }

    pub(crate) fn reasons(&self) -> impl Iterator<Item = Reason> {
        [
            self.reason_of_overlap("the mask", "is this the mask of this head?"),
            self.reason_of_side(),
            self.distance.reason(),
            self.reason_of_lopsided(),
        ]
        .into_iter()
        .flatten()
    }

    pub(crate) fn reason_of_overlap(&self, what: &str, question: &str) -> Option<Reason> {
        let is_another = self.overlap < LEAST_OVERLAP;
        let rating = if is_another {
            Rating::Failed
        } else {
            Rating::Ok
        };
        reason(rating, "mask-overlap", || {
            format!(
                "{what} and the brain found by the network overlap by only {:.3} (Dice); {question}",
                self.overlap
            )
        })
    }

    fn reason_of_lopsided(&self) -> Option<Reason> {
        let farthest = self.lopsided_mm.into_iter().zip(SIDES);
        let (most, [first, second]) = farthest
            .max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()))
            .expect("three axes");
        let [out, other] = match most > 0.0 {
            true => [first, second],
            false => [second, first],
        };
        let is_lopsided = most.abs() > MOST_LOPSIDED_MM;
        reason(review_if(is_lopsided), "mask-lopsided", || {
            format!(
                "compared with the brain found by the network, the surface of the mask lies {:.1} mm farther out at the {out} than at the \
                 {other}; is the mask shifted, or wrong on one side?",
                most.abs()
            )
        })
    }

    /// A flipped mask is one that fits if it is flipped back, and better than it does as it is.
    fn reason_of_side(&self) -> Option<Reason> {
        let is_nearer = self.flipped.rms_mm < NEARER * self.distance.rms_mm;
        let is_flipped = is_nearer && !self.flipped.is_far();
        reason(review_if(is_flipped), "mask-flipped", flipped_sentence)
    }
}

/// Places with their signed distances from a border, without those that are nearer to a cut, beyond which the border may be nearer.
fn measured(
    places: impl Iterator<Item = DVec3>,
    border: &BorderField,
    cuts: &[Cut],
) -> Vec<(DVec3, f64)> {
    let known = |place: DVec3| {
        let distance_mm = border.distance_mm(place);
        let leaves = |cut: &Cut| cut.distance_mm(place) >= distance_mm.abs();
        cuts.iter().all(leaves).then_some((place, distance_mm))
    };
    places.filter_map(known).collect()
}

fn lengths(measured: Vec<(DVec3, f64)>) -> Vec<f64> {
    measured
        .into_iter()
        .map(|(_, length_mm)| length_mm)
        .collect()
}

/// The mean signed distance of what faces one side less that of what faces the opposite one, along L, P and S: 0 where nothing does.
///
/// A place faces a side if the direction to it from the middle of all is within 45° of that side. Distances count no more than
/// [`PATCH_MM`]: a stem that is longer in one mask is no shift.
fn lopsided(measured: &[(DVec3, f64)]) -> [f64; 3] {
    let middle = measured.iter().map(|(place, _)| *place).sum::<DVec3>() / measured.len() as f64;
    let (mut sums, mut counts) = ([[0.0; 2]; 3], [[0u32; 2]; 3]);
    for (place, distance_mm) in measured {
        let direction = (*place - middle).normalize_or_zero();
        for axis in 0..3 {
            if direction[axis].abs() > std::f64::consts::FRAC_1_SQRT_2 {
                let side = usize::from(direction[axis] < 0.0);
                sums[axis][side] += distance_mm.clamp(-PATCH_MM, PATCH_MM);
                counts[axis][side] += 1;
            }
        }
    }
    [0, 1, 2].map(|axis| {
        let mean = |side: usize| sums[axis][side] / f64::from(counts[axis][side]);
        match counts[axis].contains(&0) {
            true => 0.0,
            false => mean(0) - mean(1),
        }
    })
}

impl SurfaceDistance {
    /// From signed distances in mm, in each direction, with the area of each place in mm²; `None` if there are none.
    fn new(directions: &[(Vec<f64>, f64)]) -> Option<Self> {
        let mut lengths_mm = Vec::new();
        let (mut mean_mm, mut square, mut patch_cm2) = (0.0, 0.0, 0.0f64);
        let share = 1.0 / directions.len() as f64;
        for (distances_mm, area_mm2) in directions {
            let count = distances_mm.len() as f64;
            mean_mm += share * distances_mm.iter().sum::<f64>() / count;
            square += share * distances_mm.iter().map(|mm| mm * mm).sum::<f64>() / count;
            let far = distances_mm.iter().filter(|mm| mm.abs() > PATCH_MM).count();
            patch_cm2 = patch_cm2.max(far as f64 * area_mm2 / 100.0);
            lengths_mm.extend(distances_mm.iter().map(|mm| mm.abs()));
        }
        let rank = lengths_mm.len().checked_sub(1)? * 95 / 100;
        let (_, percentile, _) = lengths_mm.select_nth_unstable_by(rank, f64::total_cmp);
        mean_mm.is_finite().then_some(Self {
            percentile_95_mm: *percentile,
            mean_mm,
            rms_mm: square.sqrt(),
            patch_cm2,
        })
    }

    fn is_far(&self) -> bool {
        self.percentile_95_mm > MOST_95_MM
            || self.mean_mm.abs() > MOST_MEAN_MM
            || self.patch_cm2 > MOST_PATCH_CM2
    }

    fn reason(&self) -> Option<Reason> {
        let Self {
            percentile_95_mm,
            mean_mm,
            patch_cm2,
            ..
        } = self;
        reason(review_if(self.is_far()), "mask-distance", || {
            if mean_mm.abs() > MOST_MEAN_MM {
                let (size, side) = match *mean_mm > 0.0 {
                    true => ("large", "outside"),
                    false => ("small", "inside"),
                };
                format!(
                    "the mask seems too {size}: its surface lies {:.1} mm {side} that of the brain found by the network, on average",
                    mean_mm.abs()
                )
            } else if *patch_cm2 > MOST_PATCH_CM2 {
                format!(
                    "{patch_cm2:.0} cm² of the surface of the mask, or of the brain found by the network, lie more than {PATCH_MM} mm \
                     from the other; is a part of the brain missing?"
                )
            } else {
                format!(
                    "5 % of the surface of the mask lie more than {percentile_95_mm:.1} mm from that of the brain found by the network; is \
                     this the mask of this head, in the right place?"
                )
            }
        })
    }
}

fn reason_of_rim(rim: Option<Rim>) -> Option<Reason> {
    let here = rim.map_or(0.0, |rim| rim.here);
    let fits = here >= LEAST_RIM;
    let is_placed = here >= SURE_RIM || rim.is_some_and(|rim| here - rim.elsewhere >= LEAST_GAIN);
    reason(review_if(!fits || !is_placed), "mask-rim", || {
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

/// Of a head that is inverted, no flip of its mask fits.
fn reason_of_side(rim: Rim) -> Option<Reason> {
    let is_flipped = rim.flipped > (rim.here + LEAST_GAIN_OF_FLIP).max(LEAST_FLIPPED_RIM);
    reason(review_if(is_flipped), "mask-flipped", flipped_sentence)
}

fn flipped_sentence() -> String {
    "the mask fits the volume better when flipped along an axis; was it stored with other axes?"
        .to_owned()
}

fn reason_of_grid(mask: &Grid, volume: &Grid) -> Option<Reason> {
    reason(review_if(!share_places(mask, volume)), "mask-grid", || {
        "the voxels of the mask and of the volume do not coincide; is this the mask of this head?"
            .to_owned()
    })
}

/// The Dice coefficient of two sets on isotropic grids along the patient axes, at the voxels of the first.
fn dice(a: &Mask, b: &Mask) -> f64 {
    let both_ml = a.count_within(b) as f64 * a.grid().spacing_mm()[0].powi(3) / 1000.0;
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
