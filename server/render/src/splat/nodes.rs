//! The isosurface at the nodes of the coarse grid.

use rayon::prelude::*;

use super::seeds::{Lattice, Seeds};
use crate::isosurface::Isosurface;
use crate::rays::Rays;

/// The cosine at which a surface is seen as long as nothing better is known.
const USUAL_FACING: f32 = 0.75;

/// What a node's line of sight meets.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Height of the isosurface; −∞ where the line of sight misses it.
    pub(super) height: f32,
    /// No line of sight within a node of this one meets the isosurface above this; −∞ where none meets it.
    pub(super) start: f32,
    /// Unit vector into the brain, in patient space.
    pub(super) inward: [f32; 3],
    /// Cosine between the outward normal and the direction to the viewer.
    pub(super) facing: f32,
}

/// Follows each node's line of sight to the isosurface.
pub(super) fn nodes(
    isosurface: &Isosurface<'_>,
    rays: &Rays,
    seeds: &Seeds,
    lowest: f32,
) -> Vec<Node> {
    let Lattice { columns, .. } = seeds.lattice;
    let starts = seeds.starts();
    let mut nodes = Vec::new();
    starts
        .par_iter()
        .with_min_len(columns)
        .enumerate()
        .map(|(index, &start)| {
            let [x, y] = [index % columns, index / columns].map(|node| seeds.lattice.pixel(node));
            let ray = rays.through(x, y);
            let seed = seeds.heights[index];
            let near = (seed > f32::NEG_INFINITY)
                .then(|| isosurface.hit_near(&ray, seed, USUAL_FACING))
                .flatten();
            let hit = match near {
                None if start > f32::NEG_INFINITY => isosurface.first_hit(&ray, start, lowest),
                near => near,
            };
            let Some(height) = hit else {
                return Node {
                    height: f32::NEG_INFINITY,
                    start,
                    inward: [0.0; 3],
                    facing: 0.0,
                };
            };
            let inward = isosurface.inward(ray.at(height));
            Node {
                height,
                start,
                inward,
                facing: facing(inward, rays.towards_viewer()),
            }
        })
        .collect_into_vec(&mut nodes);
    nodes
}

/// The cosine between an outward normal and the direction to the viewer.
pub(super) fn facing(inward: [f32; 3], towards_viewer: [f32; 3]) -> f32 {
    -(inward[0] * towards_viewer[0] + inward[1] * towards_viewer[1] + inward[2] * towards_viewer[2])
}
