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

/// The parameters of a rigid motion: turns and shifts.
pub(super) const RIGID: usize = 6;
/// Those of an affine transform: also the strains along and between the axes.
pub(super) const AFFINE: usize = 12;

/// Takes quasi-Newton steps (Broyden, Fletcher, Goldfarb, Shanno) of the first `N` parameters, [`RIGID`] or [`AFFINE`], none
/// longer than `longest_mm`. Turns and strains are measured by the movement of a point at `radius_mm`.
pub(super) fn climb<const N: usize>(
    comparison: &Comparison,
    begun: Pose,
    radius_mm: f64,
    longest_mm: f64,
) -> (Pose, Score) {
    let in_mm = |slope: Motion| parameters::<N>(slope, 1.0 / radius_mm);
    let moved = |pose: Pose, step: &[f64; N]| pose.after(motion(step, radius_mm));
    let mut pose = begun;
    let (mut score, slope) = comparison.score_and_slope(pose);
    let mut slope = in_mm(slope);
    let mut curvature: Option<[[f64; N]; N]> = None;
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
        let bend: [f64; N] = std::array::from_fn(|k| slope[k] - next_slope[k]);
        curvature = updated(curvature, &taken, &bend);
        (pose, score, slope) = (next, next_score, next_slope);
        if length(&taken) < LEAST_STEP_MM {
            break;
        }
    }
    (pose, score)
}

/// The first of successively shorter steps with enough gain.
fn first_rise<const N: usize>(
    comparison: &Comparison,
    pose: Pose,
    score: Score,
    slope: &[f64; N],
    mut step: [f64; N],
    moved: &impl Fn(Pose, &[f64; N]) -> Pose,
) -> Option<(Pose, Score, Motion, [f64; N])> {
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
fn updated<const N: usize>(
    inverse: Option<[[f64; N]; N]>,
    step: &[f64; N],
    bend: &[f64; N],
) -> Option<[[f64; N]; N]> {
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

/// The first parameters of a motion; turns and strains are multiplied by `lever`.
fn parameters<const N: usize>(motion: Motion, lever: f64) -> [f64; N] {
    let Motion {
        turn,
        shift,
        stretch,
        shear,
    } = motion;
    let all = [turn * lever, shift, stretch * lever, shear * lever].map(|three| three.to_array());
    std::array::from_fn(|k| all[k / 3][k % 3])
}

fn motion<const N: usize>(step: &[f64; N], radius_mm: f64) -> Motion {
    let three = |first: usize| {
        let at = |k: usize| step.get(first + k).copied().unwrap_or(0.0);
        DVec3::new(at(0), at(1), at(2))
    };
    Motion {
        turn: three(0) / radius_mm,
        shift: three(3),
        stretch: three(6) / radius_mm,
        shear: three(9) / radius_mm,
    }
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn length<const N: usize>(a: &[f64; N]) -> f64 {
    dot(a, a).sqrt()
}

fn scaled<const N: usize>(a: &[f64; N], factor: f64) -> [f64; N] {
    a.map(|value| value * factor)
}

fn product<const N: usize>(matrix: &[[f64; N]; N], vector: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|row| dot(&matrix[row], vector))
}
