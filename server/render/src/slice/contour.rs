//! Contours of the isosurfaces on a slice.

use std::ops::RangeInclusive;

use geometry::{DepthField, Fenced};
use rayon::prelude::*;

use crate::Projection;
use crate::known::{CutPlane, cut_planes, deepest_known_mm};
use crate::rays::Rays;
use crate::sampler::Sampler;

/// Colours of the contours, in turn: bright, apart from one another and from grey.
const COLORS: [[u8; 3]; 8] = [
    [255, 225, 60],
    [80, 170, 255],
    [255, 140, 40],
    [90, 220, 110],
    [200, 120, 255],
    [60, 230, 230],
    [255, 90, 90],
    [255, 255, 255],
];

/// The colour of the contour of the n-th depth.
pub(crate) fn color(number: usize) -> [u8; 3] {
    COLORS[number % COLORS.len()]
}

/// How far a contour reaches from its middle, in pixels; the last pixel fades out.
const REACH: f32 = 1.1;

/// The least slope of the depth, in mm of depth per mm, for a contour; near a ridge, a contour would become a blot.
const LEAST_SLOPE: f32 = 0.2;

/// A depth equal to a level counts as below it, because the samples of a flat piece differ by rounding.
const LEVEL_MARGIN_PX: f32 = 1e-3;

/// The depth at every pixel of a slice and a pixel beyond each side.
pub(super) struct Contours<'a> {
    columns: usize,
    rays: Rays,
    cuts: Vec<CutPlane>,
    fenced: Option<&'a Fenced>,
    px_per_mm: f32,
    depths_px: Vec<f32>,
    levels_px: Vec<(f32, [u8; 3])>,
}

impl<'a> Contours<'a> {
    /// Contours of the depths `depths_mm` for the pixels of `projection`.
    pub(super) fn new(field: &'a DepthField, projection: &Projection, depths_mm: &[f64]) -> Self {
        let size = projection.size();
        let [columns, rows] = [size.width(), size.height()].map(|side| side as usize + 2);
        let sampler = Sampler::new(field.values(), field.grid().size());
        let rays = Rays::new(projection, field.grid(), 1.0);
        let px_per_mm = 1.0 / projection.mm_per_pixel();
        let voxel_px = field.grid().spacing_mm()[0] * px_per_mm;
        let px_per_step = voxel_px as f32 / DepthField::STEPS_PER_VOXEL;
        let mut depths_px = vec![0.0; columns * rows];
        depths_px
            .par_chunks_mut(columns)
            .enumerate()
            .for_each(|(row, depths)| {
                for (column, depth) in depths.iter_mut().enumerate() {
                    let place = rays.place_on_slice(column as f32 - 0.5, row as f32 - 0.5);
                    *depth = sampler.at(place) * px_per_step;
                }
            });
        let levels_px = depths_mm
            .iter()
            .enumerate()
            .map(|(number, depth_mm)| ((depth_mm * px_per_mm) as f32, color(number)))
            .collect();
        Self {
            columns,
            rays,
            cuts: cut_planes(field, 0.0),
            fenced: field.fenced(),
            px_per_mm: px_per_mm as f32,
            depths_px,
            levels_px,
        }
    }

    /// The colour of a pixel with the contours over it. A contour is drawn where its depth is known and the depth passes
    /// its level; not if the depth stays on the level, as in a slice along a flat side of the head.
    pub(super) fn over(&self, column: usize, row: usize, color: [u8; 3]) -> [u8; 3] {
        let here = (row + 1) * self.columns + column + 1;
        let depth = self.depths_px[here];
        let across = 0.5 * (self.depths_px[here + 1] - self.depths_px[here - 1]);
        let down =
            0.5 * (self.depths_px[here + self.columns] - self.depths_px[here - self.columns]);
        let slope = (across * across + down * down).sqrt().max(LEAST_SLOPE);
        let passes = self.range_around(here);
        self.levels_px.iter().fold(color, |color, (level, line)| {
            if !passes.contains(&(level - LEVEL_MARGIN_PX))
                || level + REACH > self.known_px(column, row)
            {
                return color;
            }
            let distance = (depth - level).abs() / slope;
            let cover = (REACH - distance).clamp(0.0, 1.0);
            std::array::from_fn(|channel| {
                let [under, over] = [color[channel], line[channel]].map(f32::from);
                (under + cover * (over - under) + 0.5) as u8
            })
        })
    }

    /// The depth down to which depths are known at a pixel. Few pixels ask for it: apart from the loop over all, it costs them nothing.
    #[inline(never)]
    fn known_px(&self, column: usize, row: usize) -> f32 {
        let place = (self.rays).place_on_slice(column as f32 + 0.5, row as f32 + 0.5);
        match self.fenced {
            Some(fenced) if fenced.covers(place) => f32::NEG_INFINITY,
            _ => deepest_known_mm(&self.cuts, place) * self.px_per_mm,
        }
    }

    /// The least and the greatest depth of a pixel and its eight neighbours.
    fn range_around(&self, here: usize) -> RangeInclusive<f32> {
        let rows = [here - self.columns, here, here + self.columns];
        let depths = rows
            .iter()
            .flat_map(|&row| &self.depths_px[row - 1..=row + 1]);
        let (least, greatest) = depths.fold(
            (f32::INFINITY, f32::NEG_INFINITY),
            |(least, greatest), &depth| (least.min(depth), greatest.max(depth)),
        );
        least..=greatest
    }
}
