//! Facets as edges and planes over a picture's samples.

use std::ops::Range;

use glam::{DAffine3, DVec3};

use super::facets::Facets;
use crate::Projection;

/// Steps of a fixed-point coordinate in a pixel, as on graphics devices.
const STEPS: i64 = 256;

/// How far beside the picture a corner may be, in pixels: more than any that is seen, and little enough for whole
/// numbers of 64 bits.
const FARTHEST: f64 = (1_u64 << 21) as f64;

/// The places of the samples. *Lines* are the rows of samples: each has one sample for each pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Samples {
    /// For each line of a pixel, from the top, how far right of the pixel's left edge its sample is, in fixed-point
    /// steps.
    across: &'static [i64],
}

impl Samples {
    /// One in the middle.
    pub(super) const ONE: Self = Self { across: &[128] };

    /// Four, at the standard places of Vulkan and Direct3D.
    pub(super) const FOUR: Self = Self {
        across: &[96, 224, 32, 160],
    };

    /// Lines in a row of pixels.
    pub(super) fn lines(self) -> usize {
        self.across.len()
    }

    /// Fixed-point steps from a line to the next, as a power of two; the first is half as far from the picture's edge.
    #[inline(always)]
    fn spacing_bits(self) -> u32 {
        STEPS.trailing_zeros() - self.across.len().trailing_zeros()
    }

    #[inline(always)]
    fn spacing(self) -> i64 {
        1 << self.spacing_bits()
    }

    /// The vertical position of line `line` of the picture.
    #[inline(always)]
    fn down(self, line: i64) -> i64 {
        self.spacing() * line + self.spacing() / 2
    }

    /// How far right of its pixel's left edge a sample of line `line` is.
    #[inline(always)]
    fn across(self, line: i64) -> i64 {
        self.across[line as usize % self.across.len()]
    }

    /// The lines between two places, both included.
    #[inline(always)]
    fn lines_between(self, top: i64, bottom: i64) -> Range<i64> {
        let (half, bits) = (self.spacing() / 2, self.spacing_bits());
        -((half - top) >> bits)..((bottom - half) >> bits) + 1
    }
}

/// A corner: fixed-point pixels to the right and down, and its height in voxels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    x: i64,
    y: i64,
    height: f64,
}

/// The facets that a picture may show.
#[derive(Debug)]
pub(super) struct Triangles {
    pub(super) samples: Samples,
    corners: Vec<Corner>,
    /// Front faces, then back faces; without folds, the front faces hide the back faces.
    facing: [ByLine; 2],
}

impl Triangles {
    /// The facets of a mesh whose heights are counted in `voxel_mm`.
    pub(super) fn new(
        projection: &Projection,
        voxel_mm: f64,
        facets: Facets<'_>,
        samples: Samples,
    ) -> Self {
        let corners = corners(projection, voxel_mm, facets);
        let size = projection.size();
        let right = i64::from(size.width()) * STEPS;
        let line_count = size.height() as usize * samples.lines();
        let count = facets.size.triangle_count();
        let mut seen: [Vec<Seen>; 2] = [(); 2].map(|()| Vec::with_capacity(count));
        for [first, second, third] in facets.size.triangles() {
            let [a, b, c] = [first, second, third].map(|index| corners[index as usize]);
            let double_area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            let lines = samples.lines_between(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
            let lines = lines.start.max(0)..lines.end.min(line_count as i64);
            let is_beside = a.x.max(b.x).max(c.x) < 0 || a.x.min(b.x).min(c.x) > right;
            if double_area == 0 || lines.is_empty() || is_beside {
                continue;
            }
            // Counter-clockwise from outside: so are those that face the viewer, where y goes up.
            let (side, clockwise) = if double_area < 0 {
                (0, [first, third, second])
            } else {
                (1, [first, second, third])
            };
            seen[side].push(Seen {
                clockwise,
                first_line: lines.start as u32,
                line_count: (lines.end - lines.start) as u32,
            });
        }
        Self {
            samples,
            corners,
            facing: seen.map(|seen| ByLine::new(&seen, line_count)),
        }
    }

    /// The corners of the triangles that face the viewer and may be on some lines.
    #[inline(always)]
    pub(super) fn facing(&self, lines: &Range<usize>) -> impl Iterator<Item = [Corner; 3]> {
        self.corners_of(self.facing[0].on(lines))
    }

    /// The corners of the others.
    #[inline(always)]
    pub(super) fn averted(&self, lines: &Range<usize>) -> impl Iterator<Item = [Corner; 3]> {
        self.corners_of(self.facing[1].on(lines))
    }

    #[inline(always)]
    fn corners_of<'a>(
        &'a self,
        triangles: impl Iterator<Item = &'a Seen>,
    ) -> impl Iterator<Item = [Corner; 3]> {
        triangles.map(|seen| seen.clockwise.map(|index| self.corners[index as usize]))
    }
}

/// A triangle that a picture may show.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    /// Its corners, clockwise in the picture.
    clockwise: [u32; 3],
    first_line: u32,
    line_count: u32,
}

/// Triangles by the first line that they are on.
#[derive(Debug)]
struct ByLine {
    triangles: Vec<Seen>,
    /// For each line, and the one after the last, how many triangles begin before it.
    before: Vec<u32>,
    /// The most lines that a triangle is on.
    most_lines: usize,
}

impl ByLine {
    fn new(seen: &[Seen], line_count: usize) -> Self {
        let mut before = vec![0; line_count + 1];
        for triangle in seen {
            before[triangle.first_line as usize + 1] += 1;
        }
        for line in 0..line_count {
            before[line + 1] += before[line];
        }
        let mut next = before.clone();
        let mut triangles = vec![Seen::default(); seen.len()];
        for triangle in seen {
            let place = &mut next[triangle.first_line as usize];
            triangles[*place as usize] = *triangle;
            *place += 1;
        }
        let most_lines = seen.iter().map(|triangle| triangle.line_count).max();
        Self {
            triangles,
            before,
            most_lines: most_lines.unwrap_or(0) as usize,
        }
    }

    /// The triangles that may be on some lines.
    #[inline(always)]
    fn on(&self, lines: &Range<usize>) -> impl Iterator<Item = &Seen> {
        let first = self.before[lines.start.saturating_sub(self.most_lines)];
        let end = self.before[lines.end.min(self.before.len() - 1)];
        let start = lines.start as u32;
        let near = &self.triangles[first as usize..end as usize];
        near.iter()
            .filter(move |seen| seen.first_line + seen.line_count > start)
    }
}

/// The corners of a mesh in a picture.
fn corners(projection: &Projection, voxel_mm: f64, facets: Facets<'_>) -> Vec<Corner> {
    let steps = DVec3::new(STEPS as f64, STEPS as f64, 1.0 / voxel_mm);
    let fixed_from_patient = DAffine3::from_scale(steps) * projection.frame_from_patient();
    let farthest = FARTHEST * STEPS as f64;
    let corner = |position: &[f32; 3]| {
        let position = DVec3::from(position.map(f64::from));
        let place = fixed_from_patient.transform_point3(position);
        Corner {
            x: place.x.clamp(-farthest, farthest).round() as i64,
            y: place.y.clamp(-farthest, farthest).round() as i64,
            height: place.z,
        }
    };
    let positions = &facets.mesh.positions_in_patient;
    positions.iter().map(corner).collect()
}

/// The bounds of a triangle.
#[derive(Debug, Clone)]
pub(super) struct Bounds {
    /// Columns and lines of the picture.
    pub(super) columns: Range<usize>,
    pub(super) lines: Range<usize>,
    pub(super) highest: f32,
}

impl Bounds {
    /// The part of a triangle on some lines of a picture of `width`.
    #[inline(always)]
    pub(super) fn new(
        [a, b, c]: [Corner; 3],
        samples: Samples,
        width: usize,
        lines: &Range<usize>,
    ) -> Self {
        let within = |range: Range<i64>, limits: Range<usize>| {
            let start = range.start.max(limits.start as i64);
            let end = range.end.min(limits.end as i64);
            start as usize..end.max(start) as usize
        };
        let columns =
            a.x.min(b.x).min(c.x).div_euclid(STEPS)..a.x.max(b.x).max(c.x).div_euclid(STEPS) + 1;
        let own_lines = samples.lines_between(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        Self {
            columns: within(columns, 0..width),
            lines: within(own_lines, lines.clone()),
            highest: a.height.max(b.height).max(c.height) as f32,
        }
    }
}

/// A triangle ready to be drawn.
#[derive(Debug)]
pub(super) struct Triangle {
    samples: Samples,
    edges: [Edge; 3],
    /// Whether the columns of many lines can be found at once.
    pub(super) is_near: bool,
    /// The lines that it may cover.
    pub(super) lines: Range<i64>,
    /// Its height at the sample of column 0 on line 0, were that at the left edge of its pixel; and how that grows.
    height: f64,
    pub(super) per_column: f64,
    per_line: f64,
    per_step: f64,
    /// Its least and greatest heights.
    pub(super) range: [f32; 2],
}

impl Triangle {
    #[inline(always)]
    pub(super) fn new([a, b, c]: [Corner; 3], samples: Samples) -> Self {
        let [ux, uy, vx, vy] = [b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y].map(|side| side as f64);
        let per_area = 1.0 / (ux * vy - uy * vx);
        let [u, v] = [b.height - a.height, c.height - a.height];
        let along_x = (u * vy - v * uy) * per_area;
        let along_y = (v * ux - u * vx) * per_area;
        let to_line = samples.down(0) as f64 - a.y as f64;
        let heights = [a.height, b.height, c.height];
        Self {
            samples,
            edges: [(a, b), (b, c), (c, a)].map(|(from, to)| Edge::new(from, to)),
            is_near: [a, b, c]
                .into_iter()
                .all(|corner| corner.x.abs().max(corner.y.abs()) <= NEAR),
            lines: samples.lines_between(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)),
            height: a.height - along_x * a.x as f64 + along_y * to_line,
            per_column: along_x * STEPS as f64,
            per_line: along_y * samples.spacing() as f64,
            per_step: along_x,
            range: [
                heights.into_iter().fold(f64::INFINITY, f64::min) as f32,
                heights.into_iter().fold(f64::NEG_INFINITY, f64::max) as f32,
            ],
        }
    }

    /// The columns of a picture of `width` whose samples on a line lie in the triangle.
    #[inline(always)]
    pub(super) fn columns(&self, line: i64, width: usize) -> Range<usize> {
        let place = [self.samples.across(line), self.samples.down(line)];
        let mut columns = 0..width as i64;
        for edge in &self.edges {
            edge.cut(place, &mut columns);
        }
        if columns.is_empty() {
            return 0..0;
        }
        columns.start as usize..columns.end as usize
    }

    /// [`Triangle::columns`] of [`LINES`] lines at once, from `first` on; the triangle must be [`Triangle::is_near`].
    #[inline(always)]
    pub(super) fn spans(&self, first: i64, width: usize) -> Spans {
        let mut starts = [0.0; LINES];
        let mut ends = [f64::from(width as i32); LINES];
        let lines: [i64; LINES] = std::array::from_fn(|line| first + line as i64);
        let places = [
            lines.map(|line| f64::from(self.samples.across(line) as i32)),
            lines.map(|line| f64::from(self.samples.down(line) as i32)),
        ];
        for edge in &self.edges {
            edge.cut_each(&places, (&mut starts, &mut ends));
        }
        // They are whole numbers of 0 to a million: with 2⁵² added, the low bits of a double are the number.
        let whole = |number: f64| (number + (1_u64 << 52) as f64).to_bits() as u32;
        Spans {
            starts: starts.map(whole),
            ends: ends.map(whole),
        }
    }

    /// The height at the sample of a column on a line.
    #[inline(always)]
    pub(super) fn height(&self, column: usize, line: i64) -> f32 {
        (self.height
            + line as f64 * self.per_line
            + column as f64 * self.per_column
            + self.samples.across(line) as f64 * self.per_step) as f32
    }
}

/// Lines whose columns are found together.
pub(super) const LINES: usize = 8;

/// How far from the picture's corner all of a triangle must be, in fixed-point steps, for its columns to be found by
/// many lines at once: what is computed is then a whole number below 2⁴⁹, which a double holds exactly.
const NEAR: i64 = 1 << 22;

/// The columns of a picture on some lines that lie in a triangle; none where the start is not below the end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spans {
    starts: [u32; LINES],
    ends: [u32; LINES],
}

impl Spans {
    /// The columns on a line, counted from the first.
    #[inline(always)]
    pub(super) fn on(&self, line: usize) -> Range<usize> {
        self.starts[line] as usize..self.ends[line] as usize
    }
}

/// An edge, with the triangle at its right as one goes along it.
///
/// A sample on it belongs to the triangle if the edge is at its left or its top: of two neighbours, just one has it.
#[derive(Debug)]
struct Edge {
    /// Along x and y.
    along: [i64; 2],
    /// A sample (x, y) is within when `along.x · y − along.y · x` is at least this.
    least: i64,
    /// 1 / (`along.y` · [`STEPS`]), about.
    per_column: f64,
}

impl Edge {
    #[inline(always)]
    fn new(from: Corner, to: Corner) -> Self {
        let along = [to.x - from.x, to.y - from.y];
        let has_its_samples = along[1] < 0 || (along[1] == 0 && along[0] > 0);
        Self {
            along,
            least: along[0] * from.y - along[1] * from.x + i64::from(!has_its_samples),
            per_column: 1.0 / (along[1] * STEPS) as f64,
        }
    }

    /// Keeps the columns of a line that are inside; the first sample is at `place`.
    #[inline(always)]
    fn cut(&self, [x, y]: [i64; 2], columns: &mut Range<i64>) {
        let [right, down] = self.along;
        let step = down * STEPS;
        // Column i is within when `within` is at least i · `step`.
        let within = right * y - down * x - self.least;
        if step == 0 {
            if within < 0 {
                columns.end = columns.start;
            }
            return;
        }
        // The whole number below, exact to one.
        let about = rounded_down(within as f64 * self.per_column);
        if step > 0 {
            let over = i64::from(about * step > within) - i64::from((about + 1) * step <= within);
            columns.end = columns.end.min(about - over + 1);
        } else {
            let over = i64::from(about * step <= within) - i64::from((about + 1) * step > within);
            columns.start = columns.start.max(about + 1 - over);
        }
    }
}

impl Edge {
    /// Does [`Edge::cut`] for [`LINES`] lines, whose first samples are at `places`, in doubles that hold every number
    /// exactly.
    #[inline(always)]
    fn cut_each(
        &self,
        [x, y]: &[[f64; LINES]; 2],
        (starts, ends): (&mut [f64; LINES], &mut [f64; LINES]),
    ) {
        let [right, down] = self.along.map(|side| f64::from(side as i32));
        let (step, least) = (down * STEPS as f64, self.least as f64);
        let within = |line: usize| right * y[line] - down * x[line] - least;
        if step > 0.0 {
            for (line, end) in ends.iter_mut().enumerate() {
                let within = within(line);
                let about = (within * self.per_column).floor();
                let over = within - about * step;
                let last = if over < 0.0 { about - 1.0 } else { about };
                let last = if over >= step { about + 1.0 } else { last };
                let own = if last >= 0.0 { last + 1.0 } else { 0.0 };
                *end = if own < *end { own } else { *end };
            }
        } else if step < 0.0 {
            for (line, start) in starts.iter_mut().enumerate() {
                let within = within(line);
                let about = (within * self.per_column).floor();
                // It falls by −`step` > 0 with each column to the right.
                let over = within - about * step;
                let own = if over >= 0.0 { about } else { about + 1.0 };
                let own = if over < step { about + 2.0 } else { own };
                let own = if own < 1e6 { own } else { 1e6 };
                *start = if own > *start { own } else { *start };
            }
        } else {
            for (line, end) in ends.iter_mut().enumerate() {
                *end = if within(line) < 0.0 { 0.0 } else { *end };
            }
        }
    }
}

/// The whole number at or below a place along a line: from −1 on, and to more than a picture has columns.
#[inline(always)]
fn rounded_down(place: f64) -> i64 {
    i64::from((place.clamp(-1.0, 1e6) + 1.0) as i32) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers that look like chance.
    fn chances(seed: u64) -> impl FnMut(i64) -> i64 {
        let mut state = seed;
        move |below| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as i64 % below
        }
    }

    fn corner(x: i64, y: i64) -> Corner {
        Corner { x, y, height: 0.0 }
    }

    /// Which samples of a picture of 24 × 24 pixels two triangles on either side of an edge cover, each drawn once.
    fn covered(triangles: &[[Corner; 3]], samples: Samples) -> Vec<u32> {
        let mut counts = vec![0; 24 * 24 * samples.lines()];
        for &corners in triangles {
            let triangle = Triangle::new(corners, samples);
            for line in 0..24 * samples.lines() as i64 {
                let columns = triangle.columns(line, 24);
                assert!(columns.is_empty() || triangle.lines.contains(&line));
                for column in columns {
                    counts[line as usize * 24 + column] += 1;
                }
            }
        }
        counts
    }

    #[test]
    fn a_sample_is_covered_when_it_is_within_all_three_edges() {
        let mut chance = chances(7);
        for round in 0..400 {
            // Every other round on whole pixels, so that edges pass through samples.
            let grid = if round % 2 == 0 { 128 } else { 1 };
            let mut place = || (chance(36 * STEPS) - 6 * STEPS) / grid * grid;
            let [a, b, c] = [(); 3].map(|()| corner(place(), place()));
            let double_area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if double_area <= 0 {
                continue;
            }
            for samples in [Samples::ONE, Samples::FOUR] {
                let found = covered(&[[a, b, c]], samples);
                for (index, found) in found.into_iter().enumerate() {
                    let (column, line) = (index as i64 % 24, index as i64 / 24);
                    let x = column * STEPS + samples.across(line);
                    let y = samples.down(line);
                    let within = [(a, b), (b, c), (c, a)].map(|(from, to)| {
                        let [right, down] = [to.x - from.x, to.y - from.y];
                        let side = right * (y - from.y) - down * (x - from.x);
                        side > 0 || (side == 0 && (down < 0 || (down == 0 && right > 0)))
                    });
                    let expected = u32::from(within.into_iter().all(|within| within));
                    assert_eq!(found, expected, "{a:?} {b:?} {c:?} {column} {line}");
                }
            }
        }
    }

    #[test]
    fn many_lines_at_once_have_the_columns_that_each_has() {
        let mut chance = chances(23);
        for round in 0..3000 {
            // Within the picture, about it, and as far from it as doubles are used.
            let wide = [30 * STEPS, 300 * STEPS, 2 * NEAR][round % 3];
            let grid = [1, 32, 128][round / 3 % 3];
            let mut place = || (chance(wide) - wide / 2) / grid * grid;
            let [mut a, mut b, c] = [(); 3].map(|()| corner(place(), place()));
            if round % 5 == 0 {
                b.y = a.y;
            }
            if (b.x - a.x) * (c.y - a.y) < (b.y - a.y) * (c.x - a.x) {
                std::mem::swap(&mut a, &mut b);
            }
            for samples in [Samples::ONE, Samples::FOUR] {
                let triangle = Triangle::new([a, b, c], samples);
                assert!(triangle.is_near);
                for first in [0, 5, 40] {
                    let spans = triangle.spans(first, 24);
                    for line in 0..LINES {
                        let plain = triangle.columns(first + line as i64, 24);
                        let found = spans.on(line);
                        let both_empty = plain.is_empty() && found.is_empty();
                        assert!(
                            both_empty || found == plain,
                            "{a:?} {b:?} {c:?} {first} {line}"
                        );
                    }
                }
            }
        }
        let far = corner(NEAR + 1, 0);
        assert!(!Triangle::new([far, corner(0, 9), corner(0, 0)], Samples::ONE).is_near);
    }

    #[test]
    fn two_triangles_that_share_an_edge_cover_each_sample_once() {
        let mut chance = chances(11);
        let [low, high] = [-2 * STEPS, 26 * STEPS];
        for round in 0..200 {
            let grid = if round % 2 == 0 { 128 } else { 1 };
            let mut place = || chance(24 * STEPS) / grid * grid;
            // A square around the picture, in four about a place in it.
            let middle = corner(place(), place());
            let square = [(low, low), (high, low), (high, high), (low, high)];
            let square = square.map(|(x, y)| corner(x, y));
            let fans: Vec<_> = (0..4)
                .map(|side| [square[side], square[(side + 1) % 4], middle])
                .collect();
            for samples in [Samples::ONE, Samples::FOUR] {
                assert!(
                    covered(&fans, samples).iter().all(|&count| count == 1),
                    "{middle:?}"
                );
            }
        }
    }

    #[test]
    fn corners_far_beside_the_picture_are_cut_exactly() {
        let far = FARTHEST as i64 * STEPS;
        let thin = [corner(-far, 3000), corner(far, 3001), corner(far, 3257)];
        for samples in [Samples::ONE, Samples::FOUR] {
            let counts = covered(&[thin], samples);
            let lit = counts.iter().filter(|&&count| count > 0).count();
            // Half a pixel high here, and 24 wide.
            let expected = 12 * samples.lines();
            assert!(lit.abs_diff(expected) <= 24, "{lit} for {expected}");
        }
    }
}
