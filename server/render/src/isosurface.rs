//! The isosurface {depth = D} and where a line of sight meets it.

use geometry::DepthField;

use crate::rays::Ray;
use crate::sampler::Sampler;
use crate::surface::Point;

/// Depths, in voxels, between which the smoothed field gives way to the field.
const SHALLOW: [f32; 2] = [3.0, 5.0];

/// The share of the smoothed field in the isosurface at a depth in voxels, 0 to 1.
pub(crate) fn smooth_share(depth_in_voxels: f32) -> f32 {
    let share = (SHALLOW[1] - depth_in_voxels) / (SHALLOW[1] - SHALLOW[0]);
    share.clamp(0.0, 1.0)
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
    /// Down to `SHALLOW[0]` voxels it is that of the smoothed field, from `SHALLOW[1]` on that of the field itself, between them that
    /// of a blend: less than a voxel apart, and no step between one depth and the next.
    pub(crate) fn new(field: &'a DepthField, normals: &'a DepthField, depth_mm: f64) -> Self {
        let depth_in_voxels = (depth_mm / field.grid().spacing_mm()[0]) as f32;
        Self {
            field: Sampler::new(field.values(), field.grid().size()),
            normals: Sampler::new(normals.values(), normals.grid().size()),
            depth: depth_in_voxels * DepthField::STEPS_PER_VOXEL,
            smooth: smooth_share(depth_in_voxels),
        }
    }

    /// Whether it is another than that of the field itself.
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

    /// The height of the isosurface between a place above it and one below it (height, depth below the isosurface), to `tolerance`
    /// voxels of depth, by false position (the Illinois variant).
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
