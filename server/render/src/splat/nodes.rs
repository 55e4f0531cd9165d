//! The isosurface at the nodes of the coarse grid.

use rayon::prelude::*;

use super::follow::{first_hit, hit_near};
use crate::isosurface::Isosurface;
use crate::points::Point;
use crate::rays::Rays;
use crate::seeds::{Lattice, Seeds};

/// The cosine at which a surface is seen as long as nothing better is known.
const USUAL_FACING: f32 = 0.75;

/// The least cosine at which a node's surface tells where its neighbour's is.
const LEAST_FACING: f32 = 0.3;

/// How far the height that a neighbour tells may be from that of the voxels, in voxels.
const NEIGHBOURLY: f32 = 3.0;

/// What the nodes' lines of sight meet, row by row.
#[derive(Debug)]
pub(super) struct Nodes {
    pub(super) lattice: Lattice,
    /// What each meets; a height of −∞ where it misses the isosurface.
    pub(super) points: Vec<Point>,
    /// No line of sight within a node meets the isosurface above this; −∞ where none meets it.
    pub(super) starts: Vec<f32>,
}

/// A node whose line of sight misses the isosurface.
const MISSED: Point = Point {
    height: f32::NEG_INFINITY,
    facing: 0.0,
    inward: [0.0; 3],
};

impl Nodes {
    /// Follows each node's line of sight to the isosurface.
    pub(super) fn new(isosurface: &Isosurface<'_>, rays: &Rays, seeds: &Seeds) -> Self {
        let Lattice { columns, rows, .. } = seeds.lattice;
        let mut nodes = Self {
            lattice: seeds.lattice,
            points: vec![MISSED; columns * rows],
            starts: seeds.starts(),
        };
        let (heights, floors) = (seeds.heights(), seeds.ends_in_cells());
        let starts = &nodes.starts;
        nodes
            .points
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, points)| {
                let begin = row * columns;
                let finder = RowFinder {
                    isosurface,
                    rays,
                    lattice: seeds.lattice,
                    row,
                };
                let mut left = MISSED;
                for (column, point) in points.iter_mut().enumerate() {
                    let node = begin + column;
                    if starts[node] > f32::NEG_INFINITY {
                        left = finder.find(column, left, heights[node], starts[node], floors[node]);
                        *point = left;
                    } else {
                        left = MISSED;
                    }
                }
            });
        nodes
    }
}

/// Finds what a row of nodes meets.
struct RowFinder<'a> {
    isosurface: &'a Isosurface<'a>,
    rays: &'a Rays,
    lattice: Lattice,
    row: usize,
}

impl RowFinder<'_> {
    /// What the line of sight of a node meets, whose left neighbour meets `left` and whose highest voxel is at `seed`.
    fn find(&self, column: usize, left: Point, seed: f32, start: f32, floor: f32) -> Point {
        let [x, y] = [column, self.row].map(|node| self.lattice.pixel(node));
        let ray = self.rays.through(x, y);
        let near = (seed > f32::NEG_INFINITY)
            .then(|| {
                let told = self.told_by(left);
                let (guess, facing) = if (told - seed).abs() < NEIGHBOURLY {
                    (told, left.facing)
                } else {
                    (seed, USUAL_FACING)
                };
                hit_near(self.isosurface, &ray, guess, facing)
            })
            .flatten();
        near.or_else(|| first_hit(self.isosurface, &ray, start, floor))
            .map_or(MISSED, |height| self.isosurface.point(&ray, height))
    }

    /// The height where the tangent plane at the left neighbour's point is met; not finite when it is too slanted to tell.
    #[inline]
    fn told_by(&self, left: Point) -> f32 {
        if left.facing < LEAST_FACING {
            return f32::NEG_INFINITY;
        }
        let [x, y, z] = self.rays.per_pixel_right();
        let rise = left.inward[0] * x + left.inward[1] * y + left.inward[2] * z;
        left.height + self.lattice.pitch * rise / left.facing
    }
}
