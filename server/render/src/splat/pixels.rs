//! The isosurface at every pixel.

use super::nodes::{Node, facing, nodes};
use super::seeds::{Lattice, Seeds};
use crate::isosurface::Isosurface;
use crate::rays::{Ray, Rays};

/// The greatest difference between the heights of four nodes between which the surface counts as one piece, in voxels.
const SMOOTH: f32 = 6.0;

/// The isosurface as the picture's pixels see it.
#[derive(Debug)]
pub(crate) struct Surface<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    lattice: Lattice,
    nodes: Vec<Node>,
    lowest: f32,
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    /// Height towards the viewer, in working voxels.
    pub(crate) height: f32,
    /// About a unit vector into the brain, in patient space.
    pub(crate) inward: [f32; 3],
    /// Cosine between the outward normal and the direction to the viewer.
    pub(crate) facing: f32,
}

impl<'a> Surface<'a> {
    /// The isosurface seen along `rays`, from where `seeds` begins to `lowest`.
    pub(super) fn new(isosurface: Isosurface<'a>, rays: Rays, seeds: Seeds, lowest: f32) -> Self {
        let nodes = nodes(&isosurface, &rays, &seeds, lowest);
        Self {
            isosurface,
            rays,
            lattice: seeds.lattice,
            nodes,
            lowest,
        }
    }

    /// Calls `show` with the column and the surface point of each of a row's pixels that show the isosurface.
    #[inline]
    pub(crate) fn row(&self, row: usize, width: usize, mut show: impl FnMut(usize, Point)) {
        let y = row as f32 + 0.5;
        let node_y = self.lattice.node(y);
        let top = (node_y as usize).min(self.lattice.rows - 2);
        let columns = self.lattice.columns;
        let above = &self.nodes[top * columns..][..columns];
        let below = &self.nodes[(top + 1) * columns..][..columns];
        let down = node_y - top as f32;
        for column in 0..width {
            let x = column as f32 + 0.5;
            let node_x = self.lattice.node(x);
            let left = (node_x as i32 as usize).min(columns - 2);
            let quad = [
                &above[left],
                &above[left + 1],
                &below[left],
                &below[left + 1],
            ];
            let start = quad
                .iter()
                .map(|node| node.start)
                .fold(f32::NEG_INFINITY, f32::max);
            if start > f32::NEG_INFINITY {
                let ray = self.rays.through(x, y);
                if let Some(point) = self.point(&ray, quad, [node_x - left as f32, down], start) {
                    show(column, point);
                }
            }
        }
    }

    /// What a line of sight between four nodes meets.
    #[inline]
    fn point(&self, ray: &Ray, quad: [&Node; 4], at: [f32; 2], start: f32) -> Option<Point> {
        let heights = quad.map(|node| node.height);
        let highest = heights.into_iter().fold(f32::NEG_INFINITY, f32::max);
        let lowest = heights.into_iter().fold(f32::INFINITY, f32::min);
        if highest - lowest <= SMOOTH {
            let facing = mix(quad.map(|node| node.facing), at);
            if let Some(height) = self.isosurface.hit_near(ray, mix(heights, at), facing) {
                let inward =
                    std::array::from_fn(|axis| mix(quad.map(|node| node.inward[axis]), at));
                return Some(Point {
                    height,
                    inward,
                    facing,
                });
            }
        }
        // Above its nodes' hits by more than this, a pixel sees nothing that is a voxel wide.
        let start = if highest > f32::NEG_INFINITY {
            start.min(highest + 3.0)
        } else {
            start
        };
        self.edge_point(ray, start)
    }

    /// What a line of sight meets that has to be followed on its own.
    #[inline(never)]
    fn edge_point(&self, ray: &Ray, start: f32) -> Option<Point> {
        let height = self.isosurface.first_hit(ray, start, self.lowest)?;
        let inward = self.isosurface.inward(ray.at(height));
        Some(Point {
            height,
            inward,
            facing: facing(inward, self.rays.towards_viewer()),
        })
    }
}

/// Bilinear between the values at top left, top right, bottom left and bottom right.
#[inline]
fn mix(corners: [f32; 4], [x, y]: [f32; 2]) -> f32 {
    let top = corners[0] + x * (corners[1] - corners[0]);
    let bottom = corners[2] + x * (corners[3] - corners[2]);
    top + y * (bottom - top)
}
