//! The start of a registration: many poses are tried, and the best ones are improved.

use glam::DVec3;

use super::climb::{RIGID, climb};
use super::image::Image;
use super::metric::{Comparison, Score};
use super::pose::{Motion, Pose};

/// The turns about each axis, in radians (17°), and the shifts along each axis, in mm.
const TURN: f64 = 0.3;
const SHIFT_MM: f64 = 15.0;
/// The number of poses to improve on the coarsest images, and the least distance between them, in mm.
const CLIMBS: usize = 14;
const APART_MM: f64 = 12.0;
/// The number of maxima to keep, and the least distance between them, in mm.
const SUMMITS: usize = 4;
const SUMMITS_APART_MM: f64 = 5.0;
/// Closer offsets count as one, in mm.
const SAME_OFFSET_MM: f64 = 3.0;
/// The longest step on the coarsest images, in mm.
const LONGEST_MM: f64 = 8.0;

/// The fraction of the case that the layer must cover.
pub(super) const LEAST_OVERLAP: f64 = 0.2;

/// The rank of a score; it counts as nothing if the layer covers too little.
pub(super) fn worth(score: Score) -> f64 {
    if score.overlap < LEAST_OVERLAP {
        1.0
    } else {
        score.nmi
    }
}

/// The best maxima on the coarsest images, highest first: at least one.
pub(super) fn summits(
    comparison: &Comparison,
    offsets: &[DVec3],
    identity: Pose,
    radius_mm: f64,
) -> Vec<Pose> {
    let tried = starts(offsets, identity);
    let ranked = by_worth(
        tried
            .into_iter()
            .map(|pose| (worth(comparison.score(pose)), pose)),
    );
    let mut begun = apart(&ranked, CLIMBS, APART_MM, radius_mm);
    begun.push(identity);
    let climbed = begun.into_iter().map(|pose| {
        let (pose, score) = climb::<RIGID>(comparison, pose, radius_mm, LONGEST_MM);
        (worth(score), pose)
    });
    apart(&by_worth(climbed), SUMMITS, SUMMITS_APART_MM, radius_mm)
}

/// Candidate offsets of the whole layer: as in the headers, with the bright parts of both aligned, or with the centres
/// of both aligned.
pub(super) fn offsets(case: &Image, layer: &Image, centre: DVec3) -> Vec<DVec3> {
    let candidates = [
        DVec3::ZERO,
        layer.centre_of_mass() - case.centre_of_mass(),
        layer.middle() - case.middle(),
        layer.middle() - centre,
    ];
    let mut offsets: Vec<DVec3> = Vec::new();
    for candidate in candidates {
        if offsets
            .iter()
            .all(|offset| offset.distance(candidate) > SAME_OFFSET_MM)
        {
            offsets.push(candidate);
        }
    }
    offsets
}

/// Each offset with turns about the three axes, and with shifts along them.
fn starts(offsets: &[DVec3], identity: Pose) -> Vec<Pose> {
    let turns = [-TURN, 0.0, TURN];
    let turns = turns.iter().flat_map(|&x| turns.map(|y| (x, y)));
    let turns: Vec<DVec3> = turns
        .flat_map(|(x, y)| [-TURN, 0.0, TURN].map(|z| DVec3::new(x, y, z)))
        .collect();
    let along = |axis: DVec3| [axis * SHIFT_MM, axis * -SHIFT_MM];
    let mut shifts = vec![DVec3::ZERO];
    shifts.extend(DVec3::AXES.into_iter().flat_map(along));
    let mut starts = Vec::new();
    for &offset in offsets {
        for &shift in &shifts {
            let shifted = identity.after(Motion {
                shift: offset + shift,
                ..Motion::default()
            });
            starts.extend(turns.iter().map(|&turn| {
                shifted.after(Motion {
                    turn,
                    ..Motion::default()
                })
            }));
        }
    }
    starts
}

/// Sorts by rank, greatest first; equal ones keep their order.
pub(super) fn by_worth(poses: impl Iterator<Item = (f64, Pose)>) -> Vec<Pose> {
    let mut poses: Vec<(f64, Pose)> = poses.collect();
    poses.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    poses.into_iter().map(|(_, pose)| pose).collect()
}

/// The first poses that are not near an earlier one.
fn apart(poses: &[Pose], most: usize, apart_mm: f64, radius_mm: f64) -> Vec<Pose> {
    let mut kept: Vec<Pose> = Vec::new();
    for &pose in poses {
        let is_new = |other: &Pose| other.distance_mm(pose, radius_mm) > apart_mm;
        if kept.len() < most && kept.iter().all(is_new) {
            kept.push(pose);
        }
    }
    kept
}
