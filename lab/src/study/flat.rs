//! Isosurfaces as flat maps of directions (V6).
//!
//! The centre is the centroid of the envelope, moved to the midsagittal plane. Each side is a disc: Lambert's azimuthal
//! equal-area projection of the directions from the centre, around the normal of the plane, with the front at the right
//! and the top above. A point of a map is the first hit of its ray from outside, so what lies behind is not shown. Areas
//! are true for directions, not on the isosurface: a map is as large as a ball with the mean squared distance of its hits.

use std::array::from_fn;
use std::sync::Arc;

use geometry::DepthField;
use glam::{DVec2, DVec3};

use super::region::{NEAR_MIDDLE, Region, TEMPLATE_MM, middle_weight};
use analysis::Head;
use analysis::steps::{Block, Kernel, depth_at, smooth};

#[cfg(test)]
mod tests;

/// The depths of the maps, in mm.
const DEPTHS_MM: [f32; 26] = depths_mm();
/// Pixels of a map per radius of its ball: 1 mm at a radius of 70 mm.
const PIXELS_PER_RADIUS: f64 = 70.0;
/// The pixels from the middle of a disc to its rim, and on one side of its square.
const RIM: usize = 98;
const SIDE: usize = 2 * RIM + 1;
/// The least step along a ray, in mm.
const LEAST_STEP_MM: f32 = 0.25;
/// The greatest distance of the first hit of a ray from a place that is shown, in mm.
const SHOWN_WITHIN_MM: f64 = 1.0;

const fn depths_mm() -> [f32; 26] {
    let mut depths_mm = [3.0; 26];
    let mut number = 1;
    while number < 26 {
        depths_mm[number] = depths_mm[number - 1] + 1.0;
        number += 1;
    }
    depths_mm
}

/// A point of the map of one side, in radii of its ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OnMap {
    is_left: bool,
    point: DVec2,
}

/// The centre and the axes of the rays of a head.
#[derive(Debug, Clone, Copy)]
struct Rays {
    centre: DVec3,
    left: DVec3,
    up: DVec3,
    front: DVec3,
    /// A distance from the centre beyond all of the head, in mm.
    from_mm: f64,
}

impl Rays {
    fn new(head: Head<'_>) -> Self {
        let grid = head.depth.grid();
        let inside = head.depth.values().iter().enumerate();
        let inside = inside.filter(|(_, depth)| **depth > 0).step_by(8);
        let (sum, count) = inside.fold((DVec3::ZERO, 0.0), |(sum, count), (index, _)| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            (sum + voxel, count + 1.0)
        });
        let centroid = grid
            .patient_from_voxel()
            .transform_point3(sum / f64::max(count, 1.0));
        let left = head.plane.normal();
        let from_plane = left.dot(centroid) - head.plane.offset_mm();
        let up = (DVec3::Z - left * left.z).normalize();
        let extent = DVec3::from_array(grid.size().map(|side| side as f64));
        Self {
            centre: centroid - left * from_plane,
            left,
            up,
            front: left.cross(up),
            from_mm: extent.length() * f64::from(head.depth.spacing_mm()),
        }
    }

    /// The direction of a point of a map; `None` beyond the rim.
    fn direction(&self, on_map: OnMap) -> Option<DVec3> {
        let OnMap { is_left, point } = on_map;
        let squared = point.length_squared();
        if squared > 2.0 {
            return None;
        }
        let across = (1.0 - squared / 4.0).sqrt();
        let outwards = if is_left { self.left } else { -self.left };
        let along = self.front * point.x + self.up * point.y;
        Some(outwards * (1.0 - squared / 2.0) + along * across)
    }

    /// The point of a map that shows the direction of a position.
    fn on_map(&self, position: DVec3) -> OnMap {
        let direction = (position - self.centre).normalize_or(self.left);
        let outwards = self.left.dot(direction);
        let along = DVec2::new(self.front.dot(direction), self.up.dot(direction));
        OnMap {
            is_left: outwards >= 0.0,
            point: along * (2.0 / (1.0 + outwards.abs())).sqrt(),
        }
    }

    /// The distances from the centre, in mm, at which a ray from outside first reaches each of some depths, in ascending
    /// order; fewer if it does not reach all.
    fn first_hits(&self, depth: &DepthField, direction: DVec3, depths_mm: &[f32]) -> Vec<f64> {
        let working_from_patient = depth.grid().voxel_from_patient();
        let mut hits = Vec::with_capacity(depths_mm.len());
        let (mut at_mm, mut before) = (self.from_mm, None::<(f64, f32)>);
        while at_mm > 0.0 && hits.len() < depths_mm.len() {
            let position = self.centre + direction * at_mm;
            let there = working_from_patient.transform_point3(position).as_vec3();
            let depth_mm = depth_at(depth, there);
            while let Some(&wanted) = depths_mm.get(hits.len()).filter(|&&d| d <= depth_mm) {
                let part = before.map_or(0.0, |(outer_mm, less)| {
                    f64::from((depth_mm - wanted) / (depth_mm - less)) * (outer_mm - at_mm)
                });
                hits.push(at_mm + part);
            }
            let Some(&next) = depths_mm.get(hits.len()) else {
                break;
            };
            before = Some((at_mm, depth_mm));
            // The depth grows by at most 1 mm per mm.
            at_mm -= f64::from((next - depth_mm).max(LEAST_STEP_MM));
        }
        hits
    }

    /// The depth of a position, if the maps show it and not something in front of it.
    fn shown(&self, depth: &DepthField, position: DVec3) -> Option<f32> {
        let grid = depth.grid();
        let there = grid.voxel_from_patient().transform_point3(position);
        let depth_mm = depth_at(depth, there.as_vec3());
        let from_centre = position - self.centre;
        let hits = self.first_hits(depth, from_centre.normalize_or(self.left), &[depth_mm]);
        let is_first = |hit: &f64| (hit - from_centre.length()).abs() < SHOWN_WITHIN_MM;
        (depth_mm > 0.0 && hits.first().is_some_and(is_first)).then_some(depth_mm)
    }
}

/// The first hits of all pixels of the maps of a head.
struct Hits {
    /// In voxels of the block, by depth, side (the left one first), row and pixel; NaN where there is none.
    voxels: Vec<[f32; 3]>,
    /// The radius of the ball at each depth, in mm.
    radii_mm: Vec<f64>,
}

/// Number of pixels of one side at one depth.
const PIXELS: usize = SIDE * SIDE;

fn on_map(is_left: bool, pixel: usize) -> OnMap {
    let along = |number: usize| (number as f64 - RIM as f64) / PIXELS_PER_RADIUS;
    OnMap {
        is_left,
        point: DVec2::new(along(pixel % SIDE), along(pixel / SIDE)),
    }
}

impl Hits {
    fn new(rays: &Rays, depth: &DepthField, block: &Block) -> Self {
        let voxel_from_patient = block.grid.voxel_from_patient();
        let mut voxels = vec![[f32::NAN; 3]; DEPTHS_MM.len() * 2 * PIXELS];
        let mut squares = vec![(0.0, 0.0); DEPTHS_MM.len()];
        for index in 0..2 * PIXELS {
            let on_map = on_map(index < PIXELS, index % PIXELS);
            let Some(direction) = rays.direction(on_map) else {
                continue;
            };
            let hits = rays.first_hits(depth, direction, &DEPTHS_MM);
            for (number, at_mm) in hits.into_iter().enumerate() {
                let voxel = voxel_from_patient.transform_point3(rays.centre + direction * at_mm);
                voxels[number * 2 * PIXELS + index] = voxel.as_vec3().to_array();
                let (sum, count) = &mut squares[number];
                (*sum, *count) = (*sum + at_mm * at_mm, *count + 1.0);
            }
        }
        let radius_mm = |(sum, count): (f64, f64)| (sum / count.max(1.0)).sqrt().max(1.0);
        Self {
            voxels,
            radii_mm: squares.into_iter().map(radius_mm).collect(),
        }
    }
}

/// A point of the junction on a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FlatPoint {
    pub(crate) position: DVec3,
    pub(crate) depth_mm: f32,
    /// The sharpness within the map, per mm.
    pub(crate) sharpness: f32,
}

/// The flat maps of a head at all depths.
pub(crate) struct FlatMaps {
    rays: Rays,
    hits: Arc<Hits>,
    /// The smoothed tissue scale of each pixel; NaN where there is none.
    tissue: Vec<f32>,
    /// The points of each depth and side.
    points: Vec<Arc<[FlatPoint]>>,
}

impl FlatMaps {
    /// The maps of a head, of which a region is the whole.
    pub(crate) fn of(head: Head<'_>, block: &Block, region: &Region) -> Self {
        let rays = Rays::new(head);
        let hits = Hits::new(&rays, head.depth, block);
        let sampled = hits.voxels.iter().map(|voxel| region.sampled(*voxel));
        let tissue: Vec<f32> = sampled.collect();
        let maps = tissue.chunks_exact(PIXELS).enumerate();
        Self {
            rays,
            points: maps
                .map(|(map, shown)| points(block, &hits, shown, map))
                .collect(),
            tissue,
            hits: Arc::new(hits),
        }
    }

    /// The maps with other values within a reach of a voxel of the block.
    pub(crate) fn with(
        &self,
        block: &Block,
        region: &Region,
        (centre, reach_mm): (DVec3, f64),
    ) -> Self {
        let spacing = block.spacing_mm;
        let mut tissue = self.tissue.clone();
        let mut maps = self.points.clone();
        let shown = tissue.chunks_exact_mut(PIXELS);
        let voxels = self.hits.voxels.chunks_exact(PIXELS);
        for (map, (own, (shown, voxels))) in maps.iter_mut().zip(shown.zip(voxels)).enumerate() {
            let mut is_changed = false;
            for (value, voxel) in shown.iter_mut().zip(voxels) {
                let off = from_fn(|axis| (f64::from(voxel[axis]) - centre[axis]) * spacing[axis]);
                if DVec3::from_array(off).length_squared() <= reach_mm * reach_mm {
                    let before = value.to_bits();
                    *value = region.sampled(*voxel);
                    is_changed |= value.to_bits() != before;
                }
            }
            if is_changed {
                *own = points(block, &self.hits, shown, map);
            }
        }
        Self {
            rays: self.rays,
            points: maps,
            tissue,
            hits: Arc::clone(&self.hits),
        }
    }

    pub(crate) fn points(&self) -> impl Iterator<Item = &FlatPoint> {
        self.points.iter().flat_map(|points| points.iter())
    }

    /// The sharpness at the point of the junction nearest to a position; `None` if no map shows the position.
    pub(crate) fn at(&self, depth: &DepthField, position: DVec3) -> Option<f32> {
        self.rays.shown(depth, position)?;
        let nearest = self.points().min_by(|a, b| {
            let [a, b] = [a, b].map(|point| point.position.distance_squared(position));
            a.total_cmp(&b)
        });
        nearest.map(|point| point.sharpness)
    }

    /// The positions in patient space of a patch of the map around a position, at its depth; `None` where the map ends.
    /// `offsets_mm` are lengths on the map. All are `None` if no map shows the position.
    pub(crate) fn patch(
        &self,
        depth: &DepthField,
        position: DVec3,
        offsets_mm: impl Iterator<Item = DVec2>,
    ) -> Vec<Option<DVec3>> {
        let rays = &self.rays;
        let shown = rays.shown(depth, position).map(|depth_mm| {
            let nearest = (depth_mm - DEPTHS_MM[0]).round().max(0.0) as usize;
            let radius_mm = self.hits.radii_mm[nearest.min(DEPTHS_MM.len() - 1)];
            (depth_mm, radius_mm, rays.on_map(position))
        });
        let at = |offset_mm: DVec2| {
            let (depth_mm, radius_mm, middle) = shown?;
            let point = middle.point + offset_mm / radius_mm;
            let direction = rays.direction(OnMap { point, ..middle })?;
            let hits = rays.first_hits(depth, direction, &[depth_mm]);
            hits.first().map(|at_mm| rays.centre + direction * *at_mm)
        };
        offsets_mm.map(at).collect()
    }
}

/// Every second pixel of the junction along each axis, with the sharpness under the template, in one of the maps,
/// which shows this tissue scale.
fn points(block: &Block, hits: &Hits, shown: &[f32], map: usize) -> Arc<[FlatPoint]> {
    let depth = map / 2;
    let pixel_mm = hits.radii_mm[depth] / PIXELS_PER_RADIUS;
    let voxels = &hits.voxels[map * PIXELS..(map + 1) * PIXELS];
    let mut weighted = [vec![0.0; PIXELS], vec![0.0; PIXELS]];
    for row in 1..SIDE - 1 {
        for pixel in row * SIDE + 1..(row + 1) * SIDE - 1 {
            let rise = |step: usize| shown[pixel + step] - shown[pixel - step];
            let gradient = rise(1).hypot(rise(SIDE)) / (2.0 * pixel_mm as f32);
            if !shown[pixel].is_nan() && !gradient.is_nan() {
                let weight = middle_weight(shown[pixel]);
                weighted[0][pixel] = weight * gradient;
                weighted[1][pixel] = weight;
            }
        }
    }
    let template = || Kernel::gaussian(f64::from(TEMPLATE_MM) / pixel_mm);
    for values in &mut weighted {
        // A mean over one pixel changes nothing: a map has no third axis.
        let kernels = [template(), template(), Kernel::mean(1.0)];
        smooth(values, [SIDE, SIDE, 1], &kernels);
    }
    let is_point = |pixel: &usize| {
        let is_even = (pixel % SIDE).is_multiple_of(2) && (pixel / SIDE).is_multiple_of(2);
        is_even && (shown[*pixel] - 0.5).abs() < NEAR_MIDDLE && weighted[1][*pixel] > 1e-6
    };
    let point = |pixel: usize| {
        let voxel = DVec3::from_array(voxels[pixel].map(f64::from));
        FlatPoint {
            position: block.grid.patient_from_voxel().transform_point3(voxel),
            depth_mm: DEPTHS_MM[depth],
            sharpness: weighted[0][pixel] / weighted[1][pixel],
        }
    };
    (0..PIXELS).filter(is_point).map(point).collect()
}
