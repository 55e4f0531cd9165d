//! A part of a head, for the observers of cuts.

use std::ops::RangeInclusive;

use geometry::DepthField;
use glam::{DVec3, Vec3};

use analysis::Head;
use analysis::steps::{Block, DEEP_FROM_MM, Kernel, depth_at, smooth};

/// More than the reach of the filters of the tissue scale, in mm.
pub(crate) const FILTER_MM: f64 = 4.0;
/// The greatest distance of a point of the junction from the middle between grey and white.
pub(crate) const NEAR_MIDDLE: f32 = 0.12;

/// The Gaussian of the gradient of an observer, in mm, and the width of its weight: from the pilot study, not from the
/// maps.
const GRADIENT_MM: f64 = 0.7;
const WEIGHT_WIDTH: f32 = 0.2;
/// The least depth of visible junction, in mm.
const FROM_MM: f32 = 2.5;
/// The least gradient at a point of the junction, per mm.
const LEAST_SLOPE: f64 = 0.05;
/// The template of an observer: a Gaussian in the cut, a narrower one across it, in mm, and their extent.
pub(crate) const TEMPLATE_MM: f32 = 3.0;
const ACROSS_MM: f32 = 0.6;
const REACH_MM: f64 = 9.0;
const REACH_ACROSS_MM: f64 = 1.5;

/// The sharpness of the junction in cuts through a point, per mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cuts {
    /// In slices across the first, the second and the third axis of the volume.
    pub(crate) planes: [f32; 3],
    /// In the isosurface at the depth of the point.
    pub(crate) isosurface: f32,
}

/// Gradients, weights and depths of a part of a block.
pub(crate) struct Region {
    /// The first voxel, in voxels of the block.
    first: [usize; 3],
    size: [usize; 3],
    spacing_mm: [f64; 3],
    /// The smoothed tissue scale.
    pub(crate) smooth: Vec<f32>,
    /// The gradient, per mm along the axes of the volume.
    gradients: Vec<Vec3>,
    weights: Vec<f32>,
    pub(crate) depths_mm: Vec<f32>,
    /// The normal of the isosurface, along the axes of the volume.
    normals: Vec<Vec3>,
}

impl Region {
    /// The part of a block between two voxels.
    pub(crate) fn new(
        head: Head<'_>,
        block: &Block,
        values: &[f32],
        ranges: [RangeInclusive<usize>; 3],
    ) -> Self {
        let first = [0, 1, 2].map(|axis| *ranges[axis].start());
        let size = [0, 1, 2].map(|axis| ranges[axis].end() - first[axis] + 1);
        let count = size.iter().product();
        let [nx, ny, _] = size;
        let in_block = |index: usize| {
            let voxel = [index % nx, index / nx % ny, index / nx / ny];
            [0, 1, 2].map(|axis| voxel[axis] + first[axis])
        };
        let mut tissue: Vec<f32> = (0..count)
            .map(|index| values[block.grid.index(in_block(index))])
            .collect();
        smooth(
            &mut tissue,
            size,
            &block.in_voxels(GRADIENT_MM).map(Kernel::gaussian),
        );
        let depths = Depths::new(head.depth, block);
        let (depths_mm, normals): (Vec<f32>, Vec<Vec3>) =
            (0..count).map(|index| depths.at(in_block(index))).unzip();
        let mut region = Self {
            first,
            size,
            spacing_mm: block.spacing_mm,
            weights: vec![0.0; count],
            gradients: vec![Vec3::ZERO; count],
            smooth: tissue,
            depths_mm,
            normals,
        };
        for index in 0..count {
            region.gradients[index] = region.gradient(index);
            let is_deep = region.depths_mm[index] > FROM_MM;
            region.weights[index] = if is_deep {
                middle_weight(region.smooth[index])
            } else {
                0.0
            };
        }
        region
    }

    fn gradient(&self, index: usize) -> Vec3 {
        let voxel = self.voxel(index);
        let along = |axis: usize| {
            let stride = self.stride(axis);
            if voxel[axis] == 0 || voxel[axis] + 1 == self.size[axis] {
                return 0.0;
            }
            let rise = self.smooth[index + stride] - self.smooth[index - stride];
            rise / (2.0 * self.spacing_mm[axis] as f32)
        };
        Vec3::new(along(0), along(1), along(2))
    }

    fn stride(&self, axis: usize) -> usize {
        self.size[..axis].iter().product()
    }

    fn voxel(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [index % nx, index / nx % ny, index / nx / ny]
    }

    /// The voxel of the block at an index of this region.
    pub(crate) fn in_block(&self, index: usize) -> [usize; 3] {
        let voxel = self.voxel(index);
        [0, 1, 2].map(|axis| voxel[axis] + self.first[axis])
    }

    pub(crate) fn voxel_count(&self) -> usize {
        self.smooth.len()
    }

    /// The smoothed tissue scale at a point in voxels of the block, trilinear; NaN outside the region.
    pub(crate) fn sampled(&self, voxel: [f32; 3]) -> f32 {
        let place: [f32; 3] = std::array::from_fn(|axis| voxel[axis] - self.first[axis] as f32);
        let is_inside =
            |axis: usize| place[axis] >= 0.0 && place[axis] < (self.size[axis] - 1) as f32;
        if !(0..3).all(is_inside) {
            return f32::NAN;
        }
        let part = place.map(f32::fract);
        let [x, y, z] = place.map(|along| along as usize);
        let start = x + self.size[0] * (y + self.size[1] * z);
        let between = |part: f32, a: f32, b: f32| a + part * (b - a);
        let row = |start: usize| between(part[0], self.smooth[start], self.smooth[start + 1]);
        let slice = |start: usize| between(part[1], row(start), row(start + self.size[0]));
        let above = self.size[0] * self.size[1];
        between(part[2], slice(start), slice(start + above))
    }

    /// Whether the whole template fits around a voxel of the block.
    pub(crate) fn has_room(&self, voxel: [usize; 3]) -> bool {
        let reach = self.reach();
        (0..3).all(|axis| {
            voxel[axis] >= self.first[axis] + reach[axis]
                && voxel[axis] + reach[axis] < self.first[axis] + self.size[axis]
        })
    }

    fn reach(&self) -> [usize; 3] {
        self.spacing_mm
            .map(|spacing| (REACH_MM / spacing).ceil() as usize)
    }

    /// The point of the junction nearest to a place, both in voxels of the block: where the smoothed tissue scale crosses
    /// the middle between grey and white, to a fraction of a voxel. `None` if there is none within a reach.
    pub(crate) fn nearest_junction(&self, place: DVec3, reach_mm: f64) -> Option<DVec3> {
        let spacing = DVec3::from_array(self.spacing_mm);
        let at_most_mm = spacing.max_element();
        let crossing = |index: usize| {
            let gradient = self.gradients[index].as_dvec3();
            let is_steep = gradient.length_squared() > LEAST_SLOPE * LEAST_SLOPE;
            if !is_steep || self.depths_mm[index] < DEEP_FROM_MM {
                return None;
            }
            let missing = 0.5 - f64::from(self.smooth[index]);
            let step_mm = gradient * (missing / gradient.length_squared());
            let voxel = DVec3::from_array(self.in_block(index).map(|along| along as f64));
            (step_mm.length() <= at_most_mm).then_some(voxel + step_mm / spacing)
        };
        let distance_mm = |point: &DVec3| ((*point - place) * spacing).length();
        (0..self.voxel_count())
            .filter_map(crossing)
            .filter(|point| distance_mm(point) <= reach_mm)
            .min_by(|a, b| distance_mm(a).total_cmp(&distance_mm(b)))
    }

    /// The sharpness in the cuts through a voxel of the block around which the template fits.
    pub(crate) fn cuts(&self, voxel: [usize; 3]) -> Cuts {
        let centre = [0, 1, 2].map(|axis| voxel[axis] - self.first[axis]);
        let own = centre[0] + self.size[0] * (centre[1] + self.size[1] * centre[2]);
        let own_depth = self.depths_mm[own];
        let reach = self.reach().map(|reach| reach as i64);
        let spacing = self.spacing_mm.map(|spacing| spacing as f32);
        let (mut sums, mut totals) = ([0.0f32; 4], [1e-6f32; 4]);
        let within = |off: [f32; 3]| off.iter().map(|off| off * off).sum::<f32>();
        for z in -reach[2]..=reach[2] {
            for y in -reach[1]..=reach[1] {
                let row = own as i64 + self.size[0] as i64 * (y + self.size[1] as i64 * z);
                for x in -reach[0]..=reach[0] {
                    let index = (row + x) as usize;
                    let weight = self.weights[index];
                    if weight < 0.01 {
                        continue;
                    }
                    let off = [
                        x as f32 * spacing[0],
                        y as f32 * spacing[1],
                        z as f32 * spacing[2],
                    ];
                    let squared = within(off);
                    if squared > (REACH_MM * REACH_MM) as f32 {
                        continue;
                    }
                    let weight = weight * (squared * (-0.5 / (TEMPLATE_MM * TEMPLATE_MM))).exp();
                    let gradient = self.gradients[index];
                    let length = gradient.length_squared();
                    for axis in 0..3 {
                        if off[axis].abs() <= REACH_ACROSS_MM as f32 {
                            let across = off[axis] / ACROSS_MM;
                            let weight = weight * (-0.5 * across * across).exp();
                            let along = (length - gradient[axis] * gradient[axis]).max(0.0);
                            sums[axis] += weight * along.sqrt();
                            totals[axis] += weight;
                        }
                    }
                    let across = (self.depths_mm[index] - own_depth) / ACROSS_MM;
                    if across.abs() <= REACH_ACROSS_MM as f32 / ACROSS_MM {
                        let weight = weight * (-0.5 * across * across).exp();
                        let through = gradient.dot(self.normals[index]);
                        sums[3] += weight * (length - through * through).max(0.0).sqrt();
                        totals[3] += weight;
                    }
                }
            }
        }
        let cut = |number: usize| sums[number] / totals[number];
        Cuts {
            planes: [cut(0), cut(1), cut(2)],
            isosurface: cut(3),
        }
    }
}

/// The voxels of a block within a reach of a place, which is in voxels of the block: a box.
pub(crate) fn box_around(block: &Block, place: DVec3, reach_mm: f64) -> [RangeInclusive<usize>; 3] {
    let reach = block.in_voxels(reach_mm);
    std::array::from_fn(|axis| {
        let low = (place[axis] - reach[axis]).floor().max(0.0) as usize;
        let high = (place[axis] + reach[axis]).ceil().max(0.0) as usize;
        low..=high.min(block.size[axis] - 1)
    })
}

/// The weight of a smoothed tissue scale: 1 in the middle between grey and white.
pub(crate) fn middle_weight(smooth: f32) -> f32 {
    let apart = (smooth - 0.5) / WEIGHT_WIDTH;
    (-0.5 * apart * apart).exp()
}

/// Depths and the normals of isosurfaces at the voxels of a block.
struct Depths<'a> {
    field: &'a DepthField,
    working_from_block: glam::DAffine3,
    /// Unit vectors in patient space.
    axes: [Vec3; 3],
}

impl<'a> Depths<'a> {
    fn new(field: &'a DepthField, block: &Block) -> Self {
        let columns = block.grid.patient_from_voxel().matrix3;
        let axes = [columns.x_axis, columns.y_axis, columns.z_axis];
        Self {
            field,
            working_from_block: field.grid().voxel_from_patient() * block.grid.patient_from_voxel(),
            axes: axes.map(|axis| axis.normalize().as_vec3()),
        }
    }

    fn at(&self, voxel: [usize; 3]) -> (f32, Vec3) {
        let place = DVec3::from_array(voxel.map(|along| along as f64));
        let place = self.working_from_block.transform_point3(place).as_vec3();
        let depth_mm = depth_at(self.field, place);
        if depth_mm < FROM_MM {
            return (depth_mm, Vec3::ZERO);
        }
        let inwards = self.field.gradient(place).normalize_or_zero();
        (
            depth_mm,
            Vec3::from_array(self.axes.map(|axis| axis.dot(inwards))),
        )
    }
}
