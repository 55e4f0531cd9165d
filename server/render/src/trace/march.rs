//! Sphere tracing (J. C. Hart, "Sphere tracing: a geometric method for the antialiased ray tracing of implicit surfaces",
//! The Visual Computer 12, 1996) with over-relaxation (B. Keinert et al., "Enhanced sphere tracing", STAG 2014).

use crate::isosurface::Isosurface;
use crate::rays::Ray;

/// The most that the trilinear depth field changes in a voxel's length, in voxels, rounding included.
///
/// Depths of 6-neighbours differ by at most 1 voxel: a distance changes by no more than one moves, and of two neighbours on either
/// side of the envelope's border the inner one is a border voxel, at depth 0. Each component of a trilinear gradient is a mean of such differences, so its length is
/// at most √3; stored values are rounded to 1/128 voxel.
const STEEPEST: f32 = 1.75;

/// How near the isosurface a hit is, in voxels of depth: 0.005 mm where voxels are 1 mm wide.
const TOLERANCE: f32 = 0.005;

/// Where the isosurface is thought to be at most this far ahead, a step tries to pass it, in voxels.
const NEAR: f32 = 1.0;

/// Share of the longest step that would still be safe if the depth went on as before.
const RELAXATION: f32 = 0.95;

/// How many steps a line of sight is followed: more than any takes through a grid of 512 voxels a side.
const MAX_STEPS: usize = 8192;

/// The greatest height at most `start` where `ray` enters the isosurface, `None` when there is none above `end`.
///
/// A step is at most as long as it is known to be safe, from its beginning and from its end: nothing is passed over, but what is less than a
/// [`NEAR`] voxel thick along the line of sight.
#[inline(never)]
pub(super) fn first_hit(
    isosurface: &Isosurface<'_>,
    ray: &Ray,
    start: f32,
    end: f32,
) -> Option<f32> {
    let above = |height: f32| -isosurface.below(ray.at(height));
    let mut height = start;
    let mut distance = above(height);
    for _ in 0..8 {
        if distance > 0.0 {
            break;
        }
        height += 1.0;
        distance = above(height);
    }
    // How much nearer the isosurface comes in a voxel's length.
    let mut slope = 1.0_f32;
    for _ in 0..MAX_STEPS {
        if distance <= TOLERANCE {
            return Some(height);
        }
        if height < end {
            return None;
        }
        let safe = distance / STEEPEST;
        let passing = 1.125 * distance;
        let step = if passing < NEAR * slope {
            passing / slope
        } else {
            (2.0 * RELAXATION * distance / (STEEPEST + slope.max(0.0))).max(safe)
        };
        let ahead = above(height - step);
        if ahead <= 0.0 {
            let [outside, inside] = [(height, -distance), (height - step, -ahead)];
            return Some(isosurface.between(ray, outside, inside, TOLERANCE));
        }
        let known_step = if safe + ahead / STEEPEST >= step {
            step
        } else {
            safe
        };
        let known = if known_step == step {
            ahead
        } else {
            above(height - safe)
        };
        slope = (distance - known) / known_step;
        (height, distance) = (height - known_step, known);
    }
    None
}
