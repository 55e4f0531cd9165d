//! Following a line of sight to the isosurface in few steps, as exactly as a splat needs.

use crate::isosurface::Isosurface;
use crate::rays::Ray;

/// How far a hit may be from the isosurface, in voxels of depth.
const TOLERANCE: f32 = 0.04;

/// How far from a guess a hit may be, in voxels.
const MAX_CORRECTION: f32 = 3.0;

/// The shortest step along a line of sight, in voxels: where it enters a ball of 5 voxels for less, it passes 0.025
/// voxel off its edge.
const SHORTEST_STEP: f32 = 1.0;

/// How much further than the distance to the isosurface a step may be towards a surface that comes nearer, and one that
/// does not.
const LONGEST_STRETCH: [f32; 2] = [6.0, 2.0];

/// How far below the floor a surface that comes nearer is followed, in voxels: more than the most slanted that is still
/// seen falls.
const DEEPEST_FALL: f32 = 16.0;

/// How far below the floor a surface may lie that already goes away again, in voxels.
const FLOOR_MARGIN: f32 = 2.0;

/// The most that a step is longer than the distance to the isosurface, in voxels: thin pieces behind an edge are not
/// leapt over.
const LONGEST_LEAP: f32 = 3.0;

/// How many steps a line of sight is followed: more than any takes through a grid of 512 voxels a side.
const MAX_STEPS: usize = 4096;

/// The height of the isosurface near `guess`, from secant steps; `None` if they do not converge near it.
///
/// `facing` is about the cosine between the surface's normal and the line of sight.
#[inline]
pub(super) fn hit_near(
    isosurface: &Isosurface<'_>,
    ray: &Ray,
    guess: f32,
    facing: f32,
) -> Option<f32> {
    let mut height = guess;
    let mut slope = facing.max(0.25);
    let mut below = isosurface.below(ray.at(height));
    for _ in 0..3 {
        if below.abs() <= TOLERANCE {
            // As far as the steepest surface needs: never past this one.
            return Some(height + below);
        }
        let next = height + below / slope;
        let there = isosurface.below(ray.at(next));
        let secant = (below - there) / (next - height);
        slope = if secant > 0.1 { secant } else { slope };
        (height, below) = (next, there);
    }
    (below.abs() <= TOLERANCE && (height - guess).abs() < MAX_CORRECTION).then_some(height)
}

/// The greatest height at most `start` where `ray` enters the isosurface, `None` when there is none down to about
/// `floor`, the lowest of what is seen around.
///
/// Steps are as long as the distance to the isosurface, and longer where the last one came less near than that.
#[inline(never)]
pub(super) fn first_hit(
    isosurface: &Isosurface<'_>,
    ray: &Ray,
    start: f32,
    floor: f32,
) -> Option<f32> {
    let mut outside = start;
    let mut below = isosurface.below(ray.at(outside));
    for _ in 0..8 {
        if below < 0.0 {
            break;
        }
        outside += below.max(SHORTEST_STEP);
        below = isosurface.below(ray.at(outside));
    }
    let mut stretch = 1.0;
    let mut goes_away = false;
    for _ in 0..MAX_STEPS {
        let distance = -below;
        let step = (stretch * distance)
            .min(distance + LONGEST_LEAP)
            .max(SHORTEST_STEP);
        let height = outside - step;
        if height
            < floor
                - if goes_away {
                    FLOOR_MARGIN
                } else {
                    DEEPEST_FALL
                }
        {
            return None;
        }
        let here = isosurface.below(ray.at(height));
        if here >= 0.0 {
            return Some(isosurface.between(ray, (outside, below), (height, here), TOLERANCE));
        }
        let nearer = here - below;
        goes_away = nearer < 0.0;
        stretch =
            (step / nearer.abs().max(1e-6)).clamp(1.0, LONGEST_STRETCH[usize::from(goes_away)]);
        (outside, below) = (height, here);
    }
    None
}
