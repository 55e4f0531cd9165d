//! The isosurface at every pixel.

use std::ops::Range;

use super::follow::{first_hit, hit_near};
use super::nodes::Nodes;
use crate::isosurface::Isosurface;
use crate::points::{Point, PointRow};
use crate::rays::{Ray, Rays};
use crate::silhouette::Silhouette;
use crate::surface::Surface;

/// The greatest difference between the heights of four nodes between which the surface is as flat as
/// that interpolation meets it, in voxels.
const FLAT: f32 = 2.0;

/// The greatest difference between the heights of four nodes between which the surface counts as one piece, in voxels.
const SMOOTH: f32 = 6.0;

/// The isosurface as the picture's pixels see it.
#[derive(Debug)]
pub(super) struct Pixels<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    nodes: Nodes,
    gaps: Vec<Gap>,
    bottom: f32,
}

/// The columns of pixels between two neighbouring columns of nodes.
#[derive(Debug)]
struct Gap {
    /// The column of nodes to the left.
    left: usize,
    columns: Range<usize>,
}

impl<'a> Pixels<'a> {
    /// The isosurface between `nodes`, none of it under `bottom`, in a picture of `width` columns.
    pub(super) fn new(
        isosurface: Isosurface<'a>,
        rays: Rays,
        nodes: Nodes,
        width: usize,
        bottom: f32,
    ) -> Self {
        let left_of = |column| nodes.lattice.place(column).0;
        let mut gaps: Vec<Gap> = Vec::new();
        for column in 0..width {
            let left = left_of(column);
            match gaps.last_mut() {
                Some(gap) if gap.left == left => gap.columns.end = column + 1,
                _ => gaps.push(Gap {
                    left,
                    columns: column..column + 1,
                }),
            }
        }
        Self {
            isosurface,
            rays,
            nodes,
            gaps,
            bottom,
        }
    }
}

impl Surface for Pixels<'_> {
    fn find_rows(&self, first: usize, rows: &mut [PointRow]) {
        for (row, points) in rows.iter_mut().enumerate() {
            self.find_row(first + row, points);
        }
    }

    fn silhouette(&self) -> Option<Silhouette<'_>> {
        Some(Silhouette::new(&self.isosurface, &self.rays, self.bottom))
    }
}

impl Pixels<'_> {
    fn find_row(&self, row: usize, points: &mut PointRow) {
        let lattice = &self.nodes.lattice;
        let columns = lattice.columns;
        let (top, down) = lattice.place(row);
        let above = &self.nodes.points[top * columns..][..columns];
        let under = &self.nodes.points[(top + 1) * columns..][..columns];
        for gap in &self.gaps {
            let quad = [
                above[gap.left],
                above[gap.left + 1],
                under[gap.left],
                under[gap.left + 1],
            ];
            if !lattice.is_wide && quad.iter().all(|point| point.height == f32::NEG_INFINITY) {
                continue;
            }
            let spread = Spread::of(&quad);
            if spread.difference <= FLAT {
                self.flat_points(gap, &quad, down, points);
            } else {
                let corner = Corner {
                    row,
                    left: gap.left,
                    top,
                    down,
                };
                self.steep_points(gap, &quad, &spread, &corner, points);
            }
        }
    }
}

/// Where a row of pixels lies between four nodes.
struct Corner {
    row: usize,
    left: usize,
    top: usize,
    down: f32,
}

impl Pixels<'_> {
    /// The points between four nodes of about one height.
    #[inline]
    fn flat_points(&self, gap: &Gap, quad: &[Point; 4], down: f32, points: &mut PointRow) {
        let [left, right] = [mix(quad[0], quad[2], down), mix(quad[1], quad[3], down)];
        for column in gap.columns.clone() {
            let point = mix(left, right, self.nodes.lattice.place(column).1);
            points.set(column, point);
        }
    }

    /// The points between four nodes of differing heights.
    #[inline(never)]
    fn steep_points(
        &self,
        gap: &Gap,
        quad: &[Point; 4],
        spread: &Spread,
        corner: &Corner,
        points: &mut PointRow,
    ) {
        let [left, right] = [
            mix(quad[0], quad[2], corner.down),
            mix(quad[1], quad[3], corner.down),
        ];
        for column in gap.columns.clone() {
            let ray = self
                .rays
                .through(column as f32 + 0.5, corner.row as f32 + 0.5);
            let near = mix(left, right, self.nodes.lattice.place(column).1);
            let near = (spread.difference <= SMOOTH)
                .then(|| hit_near(&self.isosurface, &ray, near.height, near.facing))
                .flatten()
                .map(|height| Point { height, ..near });
            if let Some(point) = near.or_else(|| self.edge_point(&ray, spread, corner)) {
                points.set(column, point);
            }
        }
    }

    /// What a line of sight between four nodes meets that has to be followed on its own.
    fn edge_point(&self, ray: &Ray, spread: &Spread, corner: &Corner) -> Option<Point> {
        let Nodes {
            lattice, starts, ..
        } = &self.nodes;
        let first = corner.left + corner.top * lattice.columns;
        let [above, under] = [first, first + lattice.columns];
        let start = greater(
            greater(starts[above], starts[above + 1]),
            greater(starts[under], starts[under + 1]),
        );
        if start == f32::NEG_INFINITY {
            return None;
        }
        let (start, floor) = if spread.highest > f32::NEG_INFINITY {
            // Above its nodes' hits by more than this, a pixel sees nothing that is a voxel wide.
            (start.min(spread.highest + 3.0), spread.lowest)
        } else {
            (start, self.bottom)
        };
        first_hit(&self.isosurface, ray, start, floor)
            .map(|height| self.isosurface.point(ray, height))
    }
}

/// How the heights of four nodes differ.
struct Spread {
    highest: f32,
    /// The least height of those that meet the isosurface; +∞ where all miss it.
    lowest: f32,
    /// Between the greatest and the least height; not finite where one misses.
    difference: f32,
}

impl Spread {
    #[inline]
    fn of([a, b, c, d]: &[Point; 4]) -> Self {
        let highest = greater(greater(a.height, b.height), greater(c.height, d.height));
        let least = -greater(greater(-a.height, -b.height), greater(-c.height, -d.height));
        let lowest = if least > f32::NEG_INFINITY {
            least
        } else {
            let met = [a, b, c, d]
                .into_iter()
                .map(|point| point.height)
                .filter(|height| height.is_finite());
            met.fold(f32::INFINITY, f32::min)
        };
        Self {
            highest,
            lowest,
            difference: highest - least,
        }
    }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn mix(from: Point, to: Point, share: f32) -> Point {
    let mix = |from: f32, to: f32| from + share * (to - from);
    Point {
        height: mix(from.height, to.height),
        facing: mix(from.facing, to.facing),
        inward: [
            mix(from.inward[0], to.inward[0]),
            mix(from.inward[1], to.inward[1]),
            mix(from.inward[2], to.inward[2]),
        ],
    }
}
