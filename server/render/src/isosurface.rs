//! The isosurface {depth = D} and its intersections with lines of sight.

use geometry::{DeformableModel, DepthField, Solid};
use multiversion::multiversion;

use crate::points::{Point, PointRow};
use crate::rays::{Ray, Rays};
use crate::sampler::{LANES, Lanes, Sampler};

/// Depths, in voxels, between which the smoothed field gives way to the field.
const SHALLOW: [f32; 2] = [3.0, 5.0];

/// The share of the smoothed field in the isosurface at a depth in voxels, 0 to 1.
pub(crate) fn smooth_share(depth_in_voxels: f32) -> f32 {
    let share = (SHALLOW[1] - depth_in_voxels) / (SHALLOW[1] - SHALLOW[0]);
    share.clamp(0.0, 1.0)
}

/// The isosurface `depth_mm` below the envelope of a model as a closed mesh: the one that [`crate::draw_trace`] shows. It is empty if
/// nothing is as deep.
///
/// Its vertices lie on the isosurface to within 1/512 of a voxel of the working grid, but for the few from which polygons are filled
/// ([`geometry::solid`]); these and the middles of triangles are at most a tenth of a voxel off it.
pub fn solid(model: &DeformableModel, depth_mm: f64) -> Solid {
    let isosurface = Isosurface::new(model.field(), model.normals(), depth_mm);
    geometry::solid(model.field().grid(), |voxel| isosurface.below_centre(voxel))
}

/// A depth's isosurface. Heights and depths are in voxels of the working grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Isosurface<'a> {
    field: Sampler<'a, i16>,
    normals: Sampler<'a, i16>,
    /// In the field's steps.
    depth: f32,
    /// The share of the smoothed field, 0 to 1.
    smooth: f32,
}

impl<'a> Isosurface<'a> {
    /// The isosurface `depth_mm` below the envelope, without the terraces that the envelope's voxels make near it.
    ///
    /// It comes from the smoothed field down to `SHALLOW[0]` voxels, from the field itself from `SHALLOW[1]` on, and
    /// from a blend between them. The two differ by less than a voxel, and the blend leaves no step from one depth to
    /// the next.
    pub(crate) fn new(field: &'a DepthField, normals: &'a DepthField, depth_mm: f64) -> Self {
        let depth_in_voxels = (depth_mm / field.grid().spacing_mm()[0]) as f32;
        Self {
            field: Sampler::new(field.values(), field.grid().size()),
            normals: Sampler::new(normals.values(), normals.grid().size()),
            depth: depth_in_voxels * DepthField::STEPS_PER_VOXEL,
            smooth: smooth_share(depth_in_voxels),
        }
    }

    /// Whether it differs from the isosurface of the field itself.
    pub(crate) fn is_smoothed(&self) -> bool {
        self.smooth > 0.0
    }

    /// How far a position in voxel coordinates lies below the isosurface; negative above it.
    #[inline(always)]
    pub(crate) fn below(&self, position: [f32; 3]) -> f32 {
        let steps = if self.smooth == 0.0 {
            self.field.at(position)
        } else if self.smooth == 1.0 {
            self.normals.at(position)
        } else {
            let raw = self.field.at(position);
            raw + self.smooth * (self.normals.at(position) - raw)
        };
        (steps - self.depth) * (1.0 / DepthField::STEPS_PER_VOXEL)
    }

    /// As [`Isosurface::below`], at the centre of the voxel with an index.
    fn below_centre(&self, voxel: usize) -> f32 {
        let raw = self.field.of_voxel(voxel);
        let steps = raw + self.smooth * (self.normals.of_voxel(voxel) - raw);
        (steps - self.depth) * (1.0 / DepthField::STEPS_PER_VOXEL)
    }

    /// How far each of `count` positions, given by axis, lies below the isosurface; as [`Isosurface::below`].
    #[inline(always)]
    pub(crate) fn below_each(&self, positions: &[Lanes; 3], count: usize, below: &mut Lanes) {
        if self.smooth == 1.0 {
            self.normals.at_each(positions, count, below);
        } else {
            self.field.at_each(positions, count, below);
        }
        if self.smooth > 0.0 && self.smooth < 1.0 {
            let mut smoothed = [0.0; LANES];
            self.normals.at_each(positions, count, &mut smoothed);
            for (raw, smoothed) in below.iter_mut().zip(smoothed) {
                *raw += self.smooth * (smoothed - *raw);
            }
        }
        for steps in below {
            *steps = (*steps - self.depth) * (1.0 / DepthField::STEPS_PER_VOXEL);
        }
    }

    /// Depth of the isosurface, in voxels.
    pub(crate) fn depth_in_voxels(&self) -> f32 {
        self.depth / DepthField::STEPS_PER_VOXEL
    }

    /// Writes in which direction the isosurface faces at the heights of a row of pixels.
    pub(crate) fn face(&self, rays: &Rays, row: usize, points: &mut PointRow) {
        for first in (0..points.heights.len()).step_by(LANES) {
            let last = (first + LANES).min(points.heights.len());
            if points.heights[first..last]
                .iter()
                .any(|&height| height > f32::NEG_INFINITY)
            {
                face_block(self, rays, row, first, points);
            }
        }
    }

    /// The unit vector inwards, across the smoothed field.
    #[inline]
    pub(crate) fn inward(&self, position: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.normals.gradient(position).unwrap_or_default();
        let length = (x * x + y * y + z * z).sqrt().max(1e-6);
        let factor = 1.0 / length;
        [x * factor, y * factor, z * factor]
    }

    /// The point of the isosurface at a height of a line of sight.
    #[inline]
    pub(crate) fn point(&self, ray: &Ray, height: f32) -> Point {
        let inward = self.inward(ray.at(height));
        let [x, y, z] = ray.towards_viewer();
        Point {
            height,
            inward,
            facing: -(inward[0] * x + inward[1] * y + inward[2] * z),
        }
    }

    /// The height of the isosurface between a place above it and one below it (height, depth below the isosurface), to
    /// `tolerance` voxels of depth, by false position (the Illinois variant).
    pub(crate) fn between(
        &self,
        ray: &Ray,
        mut above: (f32, f32),
        mut under: (f32, f32),
        tolerance: f32,
    ) -> f32 {
        const MOST_STEPS: usize = 16;
        let mut side = 0;
        for _ in 0..MOST_STEPS {
            let height = above.0 + (under.0 - above.0) * (above.1 / (above.1 - under.1));
            let here = self.below(ray.at(height));
            if here.abs() <= tolerance {
                return height;
            }
            if here < 0.0 {
                above = (height, here);
                under.1 *= if side == -1 { 0.5 } else { 1.0 };
                side = -1;
            } else {
                under = (height, here);
                above.1 *= if side == 1 { 0.5 } else { 1.0 };
                side = 1;
            }
        }
        0.5 * (above.0 + under.0)
    }
}

/// Does [`Isosurface::face`] for the pixels from column `first` on.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn face_block(
    isosurface: &Isosurface<'_>,
    rays: &Rays,
    row: usize,
    first: usize,
    points: &mut PointRow,
) {
    let count = LANES.min(points.heights.len() - first);
    let mut positions = [[0.0; LANES]; 3];
    let mut towards_viewer = [[0.0; LANES]; 3];
    let heights = &points.heights[first..first + count];
    for (lane, &height) in heights.iter().enumerate() {
        let column = (first + lane) as u32 as i32 as f32;
        let ray = rays.through(column + 0.5, row as f32 + 0.5);
        [positions[0][lane], positions[1][lane], positions[2][lane]] = ray.at(height);
        let [x, y, z] = &mut towards_viewer;
        [x[lane], y[lane], z[lane]] = ray.towards_viewer();
    }
    let mut inward = [[0.0; LANES]; 3];
    isosurface
        .normals
        .gradient_at_each(&positions, count, &mut inward);
    let [x, y, z] = &towards_viewer;
    let facing = &mut points.facing[first..first + count];
    for (lane, facing) in facing.iter_mut().enumerate() {
        let [along_x, along_y, along_z] = [inward[0][lane], inward[1][lane], inward[2][lane]];
        let squared = along_x * along_x + along_y * along_y + along_z * along_z;
        let factor = 1.0 / squared.sqrt().max(1e-6);
        let unit = [along_x * factor, along_y * factor, along_z * factor];
        [inward[0][lane], inward[1][lane], inward[2][lane]] = unit;
        *facing = -(unit[0] * x[lane] + unit[1] * y[lane] + unit[2] * z[lane]);
    }
    if !points.inward.is_empty() {
        let directions = &mut points.inward[first..first + count];
        for (lane, direction) in directions.iter_mut().enumerate() {
            *direction = [inward[0][lane], inward[1][lane], inward[2][lane]];
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_solid_has_its_corners_on_the_traced_isosurface_and_its_facets_near_it() {
        let head = geometry::phantom::head(2.0);
        let grid = head.volume.grid().clone();
        let brain = geometry::BrainMask::from_mask(&head.brain, &grid).unwrap();
        let envelope = geometry::envelope(&brain, 10.0).unwrap();
        let model = geometry::phantom::model(head.volume, envelope).model;
        let voxel_from_patient = model.field().grid().voxel_from_patient();
        let mut before = f64::INFINITY;
        // Smoothed, blended with the field, and the field itself.
        for depth_mm in [0.0, 3.0, 7.0, 8.0, 16.0, 30.0] {
            let isosurface = Isosurface::new(model.field(), model.normals(), depth_mm);
            let solid = solid(&model, depth_mm);
            let corner = |vertex: u32| {
                DVec3::from(solid.positions_in_patient[vertex as usize].map(f64::from))
            };
            let off = |place: DVec3| {
                let place = voxel_from_patient.transform_point3(place).as_vec3();
                isosurface.below(place.to_array()).abs()
            };
            let corners = solid.positions_in_patient.iter();
            let corners: Vec<f32> = corners.map(|&at| off(at.map(f64::from).into())).collect();
            // The middles of polygons that are filled from there are not on the isosurface.
            let exact = corners.iter().filter(|&&off| off <= 1.0 / 512.0 + 1e-5);
            assert!(exact.count() as f64 > 0.995 * corners.len() as f64);
            let facets = solid.triangles.iter().map(|&triangle| {
                let [a, b, c] = triangle.map(corner);
                (a.dot(b.cross(c)) / 6.0, off((a + b + c) / 3.0))
            });
            let (parts, middles): (Vec<f64>, Vec<f32>) = facets.unzip();
            let furthest = corners.iter().chain(&middles).copied().fold(0.0, f32::max);
            assert!(furthest < 0.1, "{furthest} voxel at {depth_mm} mm");
            let mean = middles.iter().sum::<f32>() / middles.len() as f32;
            assert!(mean < 0.01, "{mean} voxel at {depth_mm} mm");
            let volume_mm3: f64 = parts.iter().sum();
            assert!(volume_mm3 < before);
            before = volume_mm3;
        }
    }
}
