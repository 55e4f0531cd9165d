//! The place of a head in the space of an atlas, by an affine transform.

use geometry::{Envelope, Mask, Volume, as_position};
use glam::{DAffine3, DQuat, DVec3};

use super::climb::{AFFINE, RIGID, climb};
use super::pose::{Motion, Pose};
use super::samples::Region;
use super::search::{by_worth, worth};
use super::{Pair, STEPS_MM, median, shifts_of_parts_mm};
use crate::MidsagittalPlane;

/// The first poses nod the head so far to either side, in steps of so many degrees.
const NODS: i32 = 5;
const NOD_DEGREES: f64 = 10.0;
/// The number of first poses that are improved. The right one of a head without a face was the fifth.
const CLIMBS: usize = 6;

/// The distance between compared points of two envelopes, in voxels.
const LATTICE_VOXELS: usize = 3;
/// Lengths of another head than the template are so much longer or shorter at most, along any direction.
const SCALES: [f64; 2] = [0.7, 1.4];
/// The least share of both envelopes that they have in common (Dice).
const LEAST_COMMON: f64 = 0.88;
/// How far the plane between the hemispheres may lie from that of the template, in degrees and, in its middle, in mm.
const GREATEST_TILT_DEGREES: f64 = 12.0;
const GREATEST_OFFSET_MM: f64 = 10.0;
/// The greatest median shift of the parts of the head, in mm.
const GREATEST_SHIFT_MM: f64 = 5.0;

/// Why a head has no place in the space of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misfit {
    /// One of the volumes has a single intensity in the compared region.
    NoContrast,
    /// It is far larger, smaller or flatter than the template, or mirrored.
    Scale,
    /// The plane between its hemispheres is not that of the template.
    Sides,
    /// Its envelope is not that of the template: a part of the brain is missing, or more than the brain is there.
    Overlap,
    /// Its parts do not agree: this is no head, or no placement within the range fits.
    Parts,
}

/// A head for an alignment: intensities, the envelope of the brain, and the plane between the hemispheres.
#[derive(Debug, Clone, Copy)]
pub struct Aligned<'a> {
    /// T1-weighted intensities.
    pub volume: &'a Volume,
    /// The envelope of the brain.
    pub envelope: &'a Envelope,
    /// The plane between the hemispheres.
    pub plane: &'a MidsagittalPlane,
}

/// The place of a head in the space of an atlas, and how well it fits there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// The affine transform from the patient space of the head to that of the template, LPS mm.
    pub template_from_head: DAffine3,
    /// Normalised mutual information there: 1 for none, 2 for complete.
    pub nmi: f64,
    /// The share of both envelopes that they have in common (Dice), 0 to 1.
    pub common: f64,
    /// The least and the greatest factor by which it changes lengths.
    pub scales: [f64; 2],
    /// The angle between both planes of the hemispheres, and how far they lie apart in the middle of the head.
    pub tilt_degrees: f64,
    /// See [`Alignment::tilt_degrees`].
    pub offset_mm: f64,
    /// The median shift at which the parts of the head fit best, each by itself, in mm.
    pub shift_mm: Option<f64>,
    /// Why it cannot be trusted, if it cannot.
    pub misfit: Option<Misfit>,
}

/// Finds the affine place of `head` in the space of `template`, another head.
///
/// First both planes between the hemispheres and the middles of both envelopes lie together, and the head is as large as the
/// template; it is nodded by up to 50° to either side. The best of these poses are improved as by [`register`](super::register), and
/// then stretched and sheared as well. Heads differ, so that a gyrus may lie some millimetres beside that of the template: this is
/// good for a coarse name of a place and for nothing that is measured.
///
/// The verdict comes from what the search does not use: both envelopes must cover each other, both planes must agree, and the
/// parts of the head must not move far. The same input gives the same result on every machine.
pub fn align(head: &Aligned<'_>, template: &Aligned<'_>) -> Alignment {
    let pair = Pair::new(head.volume, head.envelope, template.volume);
    let coarse = pair.comparison(0, None);
    let ranked = |poses: Vec<Pose>, climbed: &dyn Fn(Pose) -> (Pose, f64)| {
        by_worth(poses.into_iter().map(|pose| {
            let (pose, worth) = climbed(pose);
            (worth, pose)
        }))
    };
    let radius_mm = pair.region.radius_mm;
    let mut begun = ranked(nods(&pair, head, template), &|pose| {
        let (pose, score) = climb::<RIGID>(&coarse, pose, radius_mm, STEPS_MM[0]);
        (pose, worth(score))
    });
    begun.truncate(CLIMBS);
    let best = ranked(begun, &|pose| {
        let (pose, score) = pair.climbed::<AFFINE>(1, pose);
        (pose, worth(score))
    })[0];
    let (pose, score) = pair.climbed::<AFFINE>(2, best);
    let fine = pair.comparison(2, Some(pose));
    let template_from_head = pose.layer_from_case();
    let centre = pair.region.centre;
    let [tilt_degrees, offset_mm] = between_planes(template_from_head, centre, head, template);
    let mut found = Alignment {
        template_from_head,
        nmi: score.nmi,
        common: common(head.envelope, template.envelope, template_from_head),
        scales: scales(template_from_head),
        tilt_degrees,
        offset_mm,
        shift_mm: median(shifts_of_parts_mm(&fine, pose, STEPS_MM[2])),
        misfit: None,
    };
    found.misfit = match fine.is_flat() {
        true => Some(Misfit::NoContrast),
        false => found.misfit(),
    };
    found
}

/// Poses with both planes and both middles together, nodded.
fn nods(pair: &Pair, head: &Aligned<'_>, template: &Aligned<'_>) -> Vec<Pose> {
    let middle = Region::around(template.envelope, 0.0).centre;
    let (own, other) = (head.plane.normal(), template.plane.normal());
    let upright = DQuat::from_rotation_arc(own, other);
    let size_mm = |envelope: &Envelope| volume_mm3(envelope).cbrt();
    let growth = size_mm(template.envelope) / size_mm(head.envelope).max(1.0) - 1.0;
    let nod = |number: i32| {
        let angle = (f64::from(number) * NOD_DEGREES).to_radians();
        let rotation = DQuat::from_axis_angle(other, angle) * upright;
        let pose = Pose::new(pair.region.centre, rotation, middle);
        pose.after(Motion {
            stretch: DVec3::splat(growth.clamp(-0.3, 0.4)),
            ..Motion::default()
        })
    };
    (-NODS..=NODS).map(nod).collect()
}

impl Alignment {
    fn misfit(&self) -> Option<Misfit> {
        let [least, greatest] = self.scales;
        if least < SCALES[0] || greatest > SCALES[1] || self.is_mirrored() {
            Some(Misfit::Scale)
        } else if self.common < LEAST_COMMON {
            Some(Misfit::Overlap)
        } else if self.tilt_degrees > GREATEST_TILT_DEGREES || self.offset_mm > GREATEST_OFFSET_MM {
            Some(Misfit::Sides)
        } else if self.shift_mm.is_none_or(|shift| shift > GREATEST_SHIFT_MM) {
            Some(Misfit::Parts)
        } else {
            None
        }
    }

    fn is_mirrored(&self) -> bool {
        self.template_from_head.matrix3.determinant() <= 0.0
    }
}

/// The angle in degrees between the plane of the head, in the space of the template, and that of the template; and the distance
/// of the middle of the head from the latter, as far as it does not lie beside its own.
fn between_planes(
    template_from_head: DAffine3,
    centre: DVec3,
    head: &Aligned<'_>,
    template: &Aligned<'_>,
) -> [f64; 2] {
    let [own, other] = [head.plane, template.plane];
    // Normals are carried by the inverse transpose.
    let carried = template_from_head.matrix3.inverse().transpose() * own.normal();
    let cosine = carried.normalize().dot(other.normal());
    let on_plane = centre - own.normal() * (own.normal().dot(centre) - own.offset_mm());
    let there = template_from_head.transform_point3(on_plane);
    let apart = other.normal().dot(there) - other.offset_mm();
    [cosine.clamp(-1.0, 1.0).acos().to_degrees(), apart.abs()]
}

/// The least and the greatest factor by which a transform changes lengths, of those along many directions.
fn scales(transform: DAffine3) -> [f64; 2] {
    let signs = [-1.0, 0.0, 1.0];
    let directions = signs
        .into_iter()
        .flat_map(|x| signs.map(move |y| [x, y]))
        .flat_map(|[x, y]| signs.map(move |z| DVec3::new(x, y, z)))
        .filter(|direction| *direction != DVec3::ZERO);
    let factors = directions.map(|way| transform.transform_vector3(way).length() / way.length());
    factors.fold([f64::INFINITY, 0.0], |[least, greatest], factor| {
        [least.min(factor), greatest.max(factor)]
    })
}

/// The Dice coefficient of two envelopes, in the space of the second one.
fn common(head: &Envelope, template: &Envelope, template_from_head: DAffine3) -> f64 {
    let growth = template_from_head.matrix3.determinant().abs();
    let step_mm3 = voxel_mm3(template.mask()) * LATTICE_VOXELS.pow(3) as f64;
    let shared = shared_points(head, template, template_from_head.inverse()) as f64 * step_mm3;
    2.0 * shared / (volume_mm3(head) * growth + volume_mm3(template))
}

fn voxel_mm3(mask: &Mask) -> f64 {
    mask.grid().patient_from_voxel().matrix3.determinant().abs()
}

fn volume_mm3(envelope: &Envelope) -> f64 {
    let inside = envelope.mask().voxels().iter().filter(|is| **is);
    inside.count() as f64 * voxel_mm3(envelope.mask())
}

/// The number of points inside both envelopes, of a lattice in the other one.
pub fn shared_points(case: &Envelope, other: &Envelope, case_from_other: DAffine3) -> usize {
    let (case, other) = (case.mask(), other.mask());
    let voxel_from_other_voxel =
        case.grid().voxel_from_patient() * case_from_other * other.grid().patient_from_voxel();
    let lattice = |axis: usize| (0..other.grid().size()[axis]).step_by(LATTICE_VOXELS);
    let points =
        lattice(2).flat_map(|z| lattice(1).flat_map(move |y| lattice(0).map(move |x| [x, y, z])));
    points
        .map(as_position)
        .filter(|&place| {
            other.contains(place) && case.contains(voxel_from_other_voxel.transform_point3(place))
        })
        .count()
}
