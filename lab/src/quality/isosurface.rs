//! Points on the isosurface.

use geometry::DepthField;
use glam::Vec3;
use rayon::prelude::*;

use crate::PreparedHead;

/// The depth tolerance of a point on the isosurface, in mm.
const SETTLED_MM: f32 = 0.005;
/// The number of steps along the gradient after which a point is dropped.
const STEPS: usize = 20;

/// At most about `count` points of the isosurface {depth = `depth_mm`}, in voxel coordinates, spread evenly.
pub(super) fn points(case: &PreparedHead, depth_mm: f32, count: usize) -> Vec<Vec3> {
    let spacing_mm = case.model().field().spacing_mm();
    // Each piece of the isosurface has a voxel nearer than half a voxel.
    let shell = case
        .model()
        .shell()
        .shell((depth_mm - spacing_mm / 2.0).max(0.0), spacing_mm);
    let stride = shell.len().div_ceil(count.max(1)).max(1);
    let chosen: Vec<_> = shell.iter().step_by(stride).collect();
    let starts = chosen
        .par_iter()
        .map(|voxel| Vec3::from_array(voxel.position().map(|place| place as f32)));
    starts
        .filter_map(|start| settle(case.model().field(), start, depth_mm))
        .collect()
}

/// The point at the depth along the gradient from `start`; `None` if it is not found, as can happen on ridges of the
/// depth.
fn settle(field: &DepthField, start: Vec3, depth_mm: f32) -> Option<Vec3> {
    let mut at = start;
    for _ in 0..STEPS {
        let off_mm = depth_mm - field.depth_mm(at);
        if off_mm.abs() <= SETTLED_MM {
            return Some(at);
        }
        let gradient = field.gradient(at);
        let steepness = gradient.length_squared();
        if steepness < 0.04 {
            return None;
        }
        // The trilinear depth is curved within a voxel; small steps avoid overshooting.
        let step = gradient * (off_mm / field.spacing_mm() / steepness);
        at += step.clamp_length_max(0.5);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Head;

    #[test]
    fn points_lie_on_the_isosurface_and_few_are_lost() {
        let (case, _) = PreparedHead::prepare(&Head::phantom(3.0).unwrap(), 10.0).unwrap();
        for depth_mm in [0.0, 10.0, 20.0] {
            let found = points(&case, depth_mm, 2000);
            assert!((800..=2000).contains(&found.len()), "{}", found.len());
            let off = |at: &Vec3| (case.model().field().depth_mm(*at) - depth_mm).abs();
            assert!(found.iter().all(|at| off(at) <= SETTLED_MM));
        }
    }
}
