//! The nearest facet at each sample of a band of the picture.

use std::ops::Range;

use multiversion::multiversion;

use super::triangle::{Bounds, Corner, LINES, Samples, Triangle, Triangles};
use crate::points::PointRow;

/// Heights of what each sample shows, in voxels, line by line; −∞ where there is nothing.
#[derive(Debug)]
pub(super) struct Heights {
    /// Lines in a row of pixels.
    lines: usize,
    width: usize,
    /// After the last line come [`BLOCK`] more, which mean nothing.
    heights: Vec<f32>,
}

/// Columns whose heights are raised together.
const BLOCK: usize = 8;

impl Heights {
    /// The heights in some rows of pixels of a picture of `width`.
    pub(super) fn of(triangles: &Triangles, rows: Range<usize>, width: usize) -> Self {
        let lines = triangles.samples.lines();
        let mut heights = vec![f32::NEG_INFINITY; rows.len() * lines * width + BLOCK];
        draw(triangles, rows.start * lines, width, &mut heights);
        Self {
            lines,
            width,
            heights,
        }
    }

    /// Writes the heights of a row of pixels, counted from the first of the band, and how much of each is covered.
    pub(super) fn resolve(&self, row: usize, piece: f32, points: &mut PointRow) {
        let samples = self.width * self.lines;
        let heights = &self.heights[row * samples..][..samples];
        if self.lines == 1 {
            points.heights.copy_from_slice(heights);
            return;
        }
        points.coverage.resize(self.width, 0.0);
        let mut lines = heights.chunks_exact(self.width);
        if let (Some(a), Some(b), Some(c), Some(d)) =
            (lines.next(), lines.next(), lines.next(), lines.next())
        {
            resolve(
                [a, b, c, d],
                piece,
                &mut points.heights,
                &mut points.coverage,
            );
        }
    }
}

/// Raises heights to those of the triangles, from line `first` of the picture on; after the lines come [`BLOCK`] heights more.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn draw(triangles: &Triangles, first: usize, width: usize, heights: &mut [f32]) {
    let mut band = Band {
        samples: triangles.samples,
        lines: first..first + (heights.len() - BLOCK) / width.max(1),
        width,
        heights,
    };
    let lines = band.lines.clone();
    for corners in triangles.facing(&lines) {
        band.draw(corners);
    }
    let floors = Floors::of(&band);
    for corners in triangles.averted(&lines) {
        if !floors.hide(&Bounds::new(corners, band.samples, width, &lines), first) {
            band.draw(corners);
        }
    }
}

/// The heights of some lines of the picture, and after them [`BLOCK`] more.
struct Band<'a> {
    samples: Samples,
    lines: Range<usize>,
    width: usize,
    heights: &'a mut [f32],
}

impl Band<'_> {
    /// Raises the heights to those of a triangle.
    #[inline(always)]
    fn draw(&mut self, corners: [Corner; 3]) {
        let triangle = Triangle::new(corners, self.samples);
        let [top, bottom] = [self.lines.start, self.lines.end].map(|line| line as i64);
        let [start, end] = [
            triangle.lines.start.max(top),
            triangle.lines.end.min(bottom),
        ];
        if !triangle.is_near {
            for line in start..end {
                self.draw_line(&triangle, line, triangle.columns(line, self.width));
            }
            return;
        }
        for first in (start..end).step_by(LINES) {
            let spans = triangle.spans(first, self.width);
            for line in 0..LINES.min((end - first) as usize) {
                self.draw_line(&triangle, first + line as i64, spans.on(line));
            }
        }
    }

    /// Raises the heights on a line to those of a triangle in these columns.
    #[inline(always)]
    fn draw_line(&mut self, triangle: &Triangle, line: i64, columns: Range<usize>) {
        if columns.is_empty() {
            return;
        }
        let [lowest, highest] = triangle.range;
        let per_column = triangle.per_column as f32;
        let start = triangle.height(columns.start, line);
        let row = line as usize - self.lines.start;
        let count = columns.len() as i32;
        let heights = &mut self.heights[row * self.width + columns.start..];
        let blocks = columns.len().div_ceil(BLOCK);
        for (block, heights) in heights.chunks_exact_mut(BLOCK).take(blocks).enumerate() {
            let first = (block * BLOCK) as i32;
            for (lane, height) in heights.iter_mut().enumerate() {
                let column = first + lane as i32;
                let plane = start + column as f32 * per_column;
                // A facet seen from the side has a steep plane: it ends at its corners.
                let plane = if plane < highest { plane } else { highest };
                let plane = if plane > lowest { plane } else { lowest };
                // A block may go on into the next line.
                let is_above = (column < count) & (plane > *height);
                *height = if is_above { plane } else { *height };
            }
        }
    }
}

/// Lines and columns of a tile.
const TILE: [usize; 2] = [8, 16];

/// The least height in each tile of a band.
struct Floors {
    columns: usize,
    heights: Vec<f32>,
}

impl Floors {
    #[inline(always)]
    fn of(band: &Band<'_>) -> Self {
        let columns = band.width.div_ceil(TILE[1]);
        let mut floors = Vec::with_capacity(columns * band.lines.len().div_ceil(TILE[0]));
        let heights = &band.heights[..band.lines.len() * band.width];
        for lines in heights.chunks(TILE[0] * band.width.max(1)) {
            let first = floors.len();
            floors.resize(first + columns, f32::INFINITY);
            for line in lines.chunks(band.width.max(1)) {
                for (floor, heights) in floors[first..].iter_mut().zip(line.chunks(TILE[1])) {
                    for &height in heights {
                        *floor = if height < *floor { height } else { *floor };
                    }
                }
            }
        }
        Self {
            columns,
            heights: floors,
        }
    }

    /// Whether nothing within the bounds is above any height of the band, whose first line is `first`.
    #[inline(always)]
    fn hide(&self, bounds: &Bounds, first: usize) -> bool {
        if bounds.lines.is_empty() || bounds.columns.is_empty() {
            return true;
        }
        let rows =
            (bounds.lines.start - first) / TILE[0]..=(bounds.lines.end - 1 - first) / TILE[0];
        let [left, right] = [bounds.columns.start, bounds.columns.end - 1].map(|at| at / TILE[1]);
        rows.map(|row| &self.heights[row * self.columns..][left..=right])
            .all(|floors| floors.iter().all(|&floor| bounds.highest <= floor))
    }
}

/// For each pixel the mean of its four samples that are within `piece` of the nearest, and which share of them shows anything.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn resolve(samples: [&[f32]; 4], piece: f32, heights: &mut [f32], coverage: &mut [f32]) {
    let [a, b, c, d] = samples;
    let width = heights.len();
    let (a, b, c, d) = (&a[..width], &b[..width], &c[..width], &d[..width]);
    let coverage = &mut coverage[..width];
    for column in 0..width {
        let samples = [a[column], b[column], c[column], d[column]];
        let nearest = greater(
            greater(samples[0], samples[1]),
            greater(samples[2], samples[3]),
        );
        let least = nearest - piece;
        let (mut sum, mut count, mut covered) = (0.0, 0.0, 0.0);
        for sample in samples {
            let is_near = (sample >= least) & (sample > f32::NEG_INFINITY);
            sum += if is_near { sample } else { 0.0 };
            count += if is_near { 1.0 } else { 0.0 };
            covered += if sample > f32::NEG_INFINITY {
                0.25
            } else {
                0.0
            };
        }
        let mean = sum / greater(count, 1.0);
        heights[column] = if covered > 0.0 {
            mean
        } else {
            f32::NEG_INFINITY
        };
        coverage[column] = covered;
    }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
