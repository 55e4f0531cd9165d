//! The isosurface {depth = D} and where a line of sight meets it.

use geometry::DepthField;

use crate::rays::Ray;
use crate::sampler::Sampler;

/// Depths, in voxels, above which the terraces of the envelope's voxels would show in the picture.
///
/// There the smoothed field, which has none, stands for the field: they are less than a voxel apart.
const SHALLOW: f32 = 4.0;

/// How far a hit may be from the isosurface, in voxels of depth.
const TOLERANCE: f32 = 0.04;

/// How far from a guess a hit may be, in voxels.
const MAX_CORRECTION: f32 = 3.0;

/// The shortest step along a line of sight, in voxels.
const SHORTEST_STEP: f32 = 0.25;

/// How much further than the distance to the isosurface a step along a line of sight may be.
const LONGEST_STRETCH: f32 = 2.0;

/// How many steps a line of sight is followed: more than any takes through a grid of 512 voxels a side.
const MAX_STEPS: usize = 4096;

/// A depth's isosurface. Heights and depths are in voxels of the working grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Isosurface<'a> {
    field: Sampler<'a, i16>,
    normals: Sampler<'a, i16>,
    /// In the field's steps.
    depth: f32,
}

impl<'a> Isosurface<'a> {
    /// The isosurface `depth_mm` below the envelope, to 0.1 voxel; above [`SHALLOW`] that of the smoothed field.
    pub(crate) fn new(field: &'a DepthField, normals: &'a DepthField, depth_mm: f64) -> Self {
        let voxel_mm = field.grid().spacing_mm()[0];
        let depth_in_voxels = (depth_mm / voxel_mm) as f32;
        let field = if depth_in_voxels < SHALLOW {
            normals
        } else {
            field
        };
        Self {
            field: Sampler::new(field.values(), field.grid().size()),
            normals: Sampler::new(normals.values(), normals.grid().size()),
            depth: depth_in_voxels * DepthField::STEPS_PER_VOXEL,
        }
    }

    /// How far a position in voxel coordinates lies below the isosurface; negative above it.
    #[inline(always)]
    fn below(&self, position: [f32; 3]) -> f32 {
        (self.field.at(position) - self.depth) * (1.0 / DepthField::STEPS_PER_VOXEL)
    }

    /// The unit vector inwards, across the smoothed field.
    #[inline]
    pub(crate) fn inward(&self, position: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.normals.gradient(position).unwrap_or_default();
        let length = (x * x + y * y + z * z).sqrt().max(1e-6);
        [x / length, y / length, z / length]
    }

    /// The greatest height at most `start` where `ray` enters the isosurface, `None` when there is none above `end`.
    ///
    /// The line of sight is followed in steps of its distance from the isosurface, which the distance map bounds.
    #[inline(never)]
    pub(crate) fn first_hit(&self, ray: &Ray, start: f32, end: f32) -> Option<f32> {
        let mut outside = start;
        let mut below = self.below(ray.at(outside));
        for _ in 0..8 {
            if below < 0.0 {
                break;
            }
            outside += below.max(SHORTEST_STEP);
            below = self.below(ray.at(outside));
        }
        // A slanted surface is approached in longer steps than a faced one.
        let mut stretch = 1.0;
        for _ in 0..MAX_STEPS {
            let step = (stretch * -below).max(SHORTEST_STEP);
            let height = outside - step;
            if height < end {
                return None;
            }
            let here = self.below(ray.at(height));
            if here >= 0.0 {
                return Some(self.between(ray, (outside, below), (height, here)));
            }
            stretch = (step / (here - below).abs().max(1e-6)).clamp(1.0, LONGEST_STRETCH);
            (outside, below) = (height, here);
        }
        None
    }

    /// The height of the isosurface between a place above it and one below it, by false position (the Illinois variant).
    fn between(&self, ray: &Ray, mut above: (f32, f32), mut under: (f32, f32)) -> f32 {
        let mut side = 0;
        for _ in 0..8 {
            let height = above.0 + (under.0 - above.0) * (above.1 / (above.1 - under.1));
            let here = self.below(ray.at(height));
            if here.abs() <= TOLERANCE {
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

    /// The height of the isosurface near `guess`, from secant steps; `None` when they do not settle near it.
    ///
    /// `facing` is about the cosine between the surface's normal and the line of sight.
    #[inline]
    pub(crate) fn hit_near(&self, ray: &Ray, guess: f32, facing: f32) -> Option<f32> {
        let mut height = guess;
        let mut slope = facing.max(0.25);
        let mut below = self.below(ray.at(height));
        for _ in 0..3 {
            if below.abs() <= TOLERANCE {
                // As far as the steepest surface needs: never past this one.
                return Some(height + below);
            }
            let next = height + below / slope;
            let there = self.below(ray.at(next));
            let secant = (below - there) / (next - height);
            slope = if secant > 0.1 { secant } else { slope };
            (height, below) = (next, there);
        }
        (below.abs() <= TOLERANCE && (height - guess).abs() < MAX_CORRECTION).then_some(height)
    }
}
