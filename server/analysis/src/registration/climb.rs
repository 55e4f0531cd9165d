//! Finds the pose with the greatest normalised mutual information nearby.

use super::metric::{Comparison, Score};
use super::pose::{Motion, Pose};
use glam::DVec3;

/// The greatest number of steps, and the step in mm at which the iteration ends.
const MAX_STEPS: usize = 30;
const LEAST_STEP_MM: f64 = 0.003;
/// The number of times a step is shortened before the iteration ends.
const MAX_SHORTENINGS: usize = 8;
/// The fraction of the expected gain that a step must reach (Armijo).
const LEAST_RISE: f64 = 1e-4;

type Six = [f64; 6];

/// Takes quasi-Newton steps (Broyden, Fletcher, Goldfarb, Shanno), none longer than `longest_mm`. Turns are measured by
/// the movement of a point at `radius_mm`.
pub(super) fn climb(
    comparison: &Comparison,
    begun: Pose,
    radius_mm: f64,
    longest_mm: f64,
) -> (Pose, Score) {
    let in_mm = |slope: Motion| six(slope.turn / radius_mm, slope.shift);
    let moved = |pose: Pose, step: &Six| pose.after(motion(step, radius_mm));
    let mut pose = begun;
    let (mut score, slope) = comparison.score_and_slope(pose);
    let mut slope = in_mm(slope);
    let mut curvature: Option<[Six; 6]> = None;
    for _ in 0..MAX_STEPS {
        let mut step = match &curvature {
            Some(inverse) => product(inverse, &slope),
            None => scaled(&slope, longest_mm / 4.0 / length(&slope).max(1e-300)),
        };
        if dot(&step, &slope) <= 0.0 {
            // Downhill: the estimated curvature is useless here.
            curvature = None;
            step = scaled(&slope, longest_mm / 4.0 / length(&slope).max(1e-300));
        }
        let long = length(&step);
        if long > longest_mm {
            step = scaled(&step, longest_mm / long);
        }
        let Some((next, next_score, next_slope, taken)) =
            first_rise(comparison, pose, score, &slope, step, &moved)
        else {
            if curvature.take().is_none() {
                break;
            }
            continue;
        };
        let next_slope = in_mm(next_slope);
        let bend: Six = std::array::from_fn(|k| slope[k] - next_slope[k]);
        curvature = updated(curvature, &taken, &bend);
        (pose, score, slope) = (next, next_score, next_slope);
        if length(&taken) < LEAST_STEP_MM {
            break;
        }
    }
    (pose, score)
}

/// The first of successively shorter steps with enough gain.
fn first_rise(
    comparison: &Comparison,
    pose: Pose,
    score: Score,
    slope: &Six,
    mut step: Six,
    moved: &impl Fn(Pose, &Six) -> Pose,
) -> Option<(Pose, Score, Motion, Six)> {
    for _ in 0..MAX_SHORTENINGS {
        let next = moved(pose, &step);
        let (next_score, next_slope) = comparison.score_and_slope(next);
        if next_score.nmi >= score.nmi + LEAST_RISE * dot(&step, slope) {
            return Some((next, next_score, next_slope, step));
        }
        if length(&step) < LEAST_STEP_MM {
            return None;
        }
        step = scaled(&step, 0.4);
    }
    None
}

/// Updates the inverse curvature after a step.
fn updated(inverse: Option<[Six; 6]>, step: &Six, bend: &Six) -> Option<[Six; 6]> {
    let along = dot(step, bend);
    if along <= 1e-12 * length(step) * length(bend) {
        return inverse;
    }
    let identity = along / dot(bend, bend);
    let old = inverse.unwrap_or_else(|| {
        std::array::from_fn(|row| std::array::from_fn(|k| if row == k { identity } else { 0.0 }))
    });
    let turned = product(&old, bend);
    let stretch = (1.0 + dot(bend, &turned) / along) / along;
    Some(std::array::from_fn(|row| {
        std::array::from_fn(|k| {
            old[row][k] + stretch * step[row] * step[k]
                - (turned[row] * step[k] + step[row] * turned[k]) / along
        })
    }))
}

fn six(turn: DVec3, shift: DVec3) -> Six {
    [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
}

fn motion(step: &Six, radius_mm: f64) -> Motion {
    Motion {
        turn: DVec3::new(step[0], step[1], step[2]) / radius_mm,
        shift: DVec3::new(step[3], step[4], step[5]),
    }
}

fn dot(a: &Six, b: &Six) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn length(a: &Six) -> f64 {
    dot(a, a).sqrt()
}

fn scaled(a: &Six, factor: f64) -> Six {
    a.map(|value| value * factor)
}

fn product(matrix: &[Six; 6], vector: &Six) -> Six {
    std::array::from_fn(|row| dot(&matrix[row], vector))
}
