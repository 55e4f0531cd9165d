//! How much of a pixel the isosurface covers at the edge of its picture.
//!
//! The line of sight of a pixel beside the edge gets at most some way below the isosurface, or misses it by some way.
//! That is how far the edge is from the pixel's centre: a pixel that it passes through the middle of is covered by half.

use std::ops::Range;

use crate::isosurface::Isosurface;
use crate::points::{Point, PointRow};
use crate::rays::{Ray, Rays};

/// The widest edge, in voxels: depths are not known far outside of the envelope.
const WIDEST: f32 = 2.0;

/// The most that the depth changes in a voxel's length.
const STEEPEST: f32 = 1.75;

/// The shortest step along a line of sight, in voxels.
const SHORTEST_STEP: f32 = 0.5;

/// How far above the points around it a line of sight is begun, in voxels.
const MARGIN: f32 = 1.0;

/// How far a line of sight goes away again from the isosurface before it counts as past it, in voxels.
const PAST: f32 = 0.5;

/// More steps than a line of sight takes beside the isosurface in a grid of 512 voxels a side.
const MAX_STEPS: usize = 4096;

/// The edges of an isosurface's picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Silhouette<'a> {
    isosurface: &'a Isosurface<'a>,
    rays: &'a Rays,
    /// A height below all of the isosurface.
    bottom: f32,
    /// How wide an edge is, in voxels: a pixel.
    width: f32,
}

/// What the pixel of a column shows, and how much of it the isosurface covers.
struct Edge {
    row: usize,
    column: usize,
    point: Option<Point>,
    coverage: f32,
}

impl<'a> Silhouette<'a> {
    pub(crate) fn new(isosurface: &'a Isosurface<'a>, rays: &'a Rays, bottom: f32) -> Self {
        let [x, y, z] = rays.per_pixel_right();
        Self {
            isosurface,
            rays,
            bottom,
            width: (x * x + y * y + z * z).sqrt().min(WIDEST),
        }
    }

    /// Makes the edges soft in those `inner` of some rows of pixels; the first of all is row `first` of the picture.
    ///
    /// A pixel is at the edge if it and a neighbour differ in that they show a point.
    pub(crate) fn soften(&self, first: usize, rows: &mut [PointRow], inner: Range<usize>) {
        let mut edges = Vec::new();
        let met: Vec<Vec<u8>> = rows.iter().map(met_columns).collect();
        for row in inner {
            self.find_edges(first, rows, row, &met, &mut edges);
        }
        for edge in edges {
            let points = &mut rows[edge.row];
            if let Some(point) = edge.point {
                points.set(edge.column, point);
            }
            points.coverage.resize(points.heights.len(), 1.0);
            points.coverage[edge.column] = edge.coverage;
        }
    }

    /// Finds the edges in one of some rows of pixels; `met` are their [`met_columns`].
    fn find_edges(
        &self,
        first: usize,
        rows: &[PointRow],
        row: usize,
        met: &[Vec<u8>],
        edges: &mut Vec<Edge>,
    ) {
        let around = row.saturating_sub(1)..(row + 2).min(rows.len());
        let mut counts = met[around.start].clone();
        for beside in &met[around.start + 1..around.end] {
            for (count, is_met) in counts.iter_mut().zip(beside) {
                *count += is_met;
            }
        }
        for (column, &height) in rows[row].heights.iter().enumerate() {
            let columns = column.saturating_sub(1)..(column + 2).min(counts.len());
            let shown: u8 = counts[columns.clone()].iter().sum();
            let is_edge = shown > 0 && usize::from(shown) < columns.len() * around.len();
            if !is_edge {
                continue;
            }
            let ray = self
                .rays
                .through(column as f32 + 0.5, (first + row) as f32 + 0.5);
            let edge = |point, coverage| Edge {
                row,
                column,
                point,
                coverage,
            };
            if height > f32::NEG_INFINITY {
                let (_, below) = self.deepest(&ray, height);
                let coverage = 0.5 + below.max(0.0) / self.width;
                if coverage < 1.0 {
                    edges.push(edge(None, coverage));
                }
            } else {
                let heights = rows[around.clone()]
                    .iter()
                    .flat_map(|row| &row.heights[columns.clone()]);
                let highest = heights.copied().fold(f32::NEG_INFINITY, f32::max);
                let (height, below) = self.deepest(&ray, highest + MARGIN);
                let coverage = 0.5 + below.min(0.0) / self.width;
                if coverage > 0.0 {
                    edges.push(edge(Some(self.isosurface.point(&ray, height)), coverage));
                }
            }
        }
    }

    /// Where a line of sight gets deepest below the isosurface, or misses it by the least, from a height on down: the
    /// height, and how far below the isosurface it is. The search ends where a pixel is covered whole.
    fn deepest(&self, ray: &Ray, start: f32) -> (f32, f32) {
        let enough = 0.5 * self.width;
        let mut height = start;
        let mut deepest = (start, f32::NEG_INFINITY);
        for _ in 0..MAX_STEPS {
            let below = self.isosurface.below(ray.at(height));
            if below > deepest.1 {
                deepest = (height, below);
            }
            let is_past = below < deepest.1 - PAST || (below < 0.0 && deepest.1 > 0.0);
            if below >= enough || is_past || height < self.bottom {
                break;
            }
            let step = if below < 0.0 {
                -below / STEEPEST
            } else {
                1.5 * (enough - below)
            };
            height -= step.max(SHORTEST_STEP);
        }
        deepest
    }
}

/// For each column of a row of pixels 1 if it shows a point, otherwise 0.
fn met_columns(row: &PointRow) -> Vec<u8> {
    let heights = row.heights.iter();
    heights
        .map(|&height| u8::from(height > f32::NEG_INFINITY))
        .collect()
}
