//! MR intensities on their native grid.

use glam::{DVec3, Vec3};

use crate::grid::bounds_through;
use crate::{Envelope, GeometryError, Grid};

/// The linear map from stored 16-bit values to intensities: `slope * stored + intercept`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rescale {
    /// Intensity per stored unit.
    pub slope: f32,
    /// Intensity of the stored value 0.
    pub intercept: f32,
}

/// MR intensities on the grid of the acquisition, 16 bits each.
///
/// Intensities are never resampled: interpolation blurs, and blur is the sign that readers look for. Every picture
/// samples these voxels once, through the affine.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    grid: Grid,
    voxels: Vec<u16>,
    rescale: Rescale,
}

impl Volume {
    /// A volume of stored values, x-fastest, and their rescaling to intensities.
    ///
    /// # Errors
    /// If the number of values differs from the number of voxels.
    pub fn new(grid: Grid, voxels: Vec<u16>, rescale: Rescale) -> Result<Self, GeometryError> {
        if voxels.len() != grid.voxel_count() {
            return Err(GeometryError::ValueCount {
                values: voxels.len(),
                voxels: grid.voxel_count(),
            });
        }
        Ok(Self {
            grid,
            voxels,
            rescale,
        })
    }

    /// The grid of the voxels.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Stored values, x-fastest.
    pub fn voxels(&self) -> &[u16] {
        &self.voxels
    }

    /// The mapping from stored values to intensities.
    pub fn rescale(&self) -> Rescale {
        self.rescale
    }

    /// The intensity of a stored value.
    pub fn intensity(&self, stored: f32) -> f32 {
        self.rescale.slope * stored + self.rescale.intercept
    }

    /// The intensity at a position in patient space, LPS mm; `None` outside the volume.
    pub fn intensity_at(&self, position_in_patient: DVec3) -> Option<f32> {
        let voxel_from_patient = self.grid.voxel_from_patient();
        let voxel = voxel_from_patient.transform_point3(position_in_patient);
        self.sample(voxel.as_vec3())
            .map(|stored| self.intensity(stored))
    }

    /// Least and greatest intensity.
    pub fn intensity_range(&self) -> [f32; 2] {
        let least = self.voxels.iter().copied().min().unwrap_or_default();
        let greatest = self.voxels.iter().copied().max().unwrap_or_default();
        let ends = [least, greatest].map(|stored| self.intensity(f32::from(stored)));
        if self.rescale.slope < 0.0 {
            [ends[1], ends[0]]
        } else {
            ends
        }
    }

    /// The stored value at a position in voxel coordinates, trilinear between voxel centres.
    ///
    /// `None` outside every voxel. In the outer half of a border voxel, it is the value of that voxel.
    #[inline]
    pub fn sample(&self, position_in_voxel: Vec3) -> Option<f32> {
        let size = self.grid.size();
        let x = Cell::of(position_in_voxel.x, size[0])?;
        let y = Cell::of(position_in_voxel.y, size[1])?;
        let z = Cell::of(position_in_voxel.z, size[2])?;
        let plane = size[0] * size[1];
        let row = |y: usize, z: usize| {
            let start = y * size[0] + z * plane;
            let (low, high) = (self.voxels[start + x.low], self.voxels[start + x.high]);
            x.between(f32::from(low), f32::from(high))
        };
        let slice = |z: usize| y.between(row(y.low, z), row(y.high, z));
        Some(z.between(slice(z.low), slice(z.high)))
    }

    /// The quantiles of the intensities inside `envelope`.
    ///
    /// `fractions` are in 0..=1. A voxel is inside if its centre is in a voxel of the envelope. `None` if no voxel is
    /// inside.
    pub fn percentiles_inside<const N: usize>(
        &self,
        envelope: &Envelope,
        fractions: [f64; N],
    ) -> Option<[f32; N]> {
        let [first, last] = self.block_around(envelope.grid(), 0)?;
        let region = envelope.grid();
        let inside = envelope.mask().voxels();
        let region_from_voxel = region.voxel_from_patient() * self.grid.patient_from_voxel();
        let step = region_from_voxel.matrix3.x_axis;
        let mut histogram = vec![0u64; 1 << 16];
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let start = DVec3::from_array([first[0], y, z].map(|place| place as f64));
                let start = region_from_voxel.transform_point3(start);
                let row = self.grid.index([first[0], y, z]);
                for (x, &stored) in self.voxels[row..=row + last[0] - first[0]]
                    .iter()
                    .enumerate()
                {
                    let position = start + step * x as f64;
                    if region.contains(position) {
                        let nearest = position.round().to_array().map(|place| place as usize);
                        let nearest = region.index(clamped(nearest, region.size()));
                        histogram[usize::from(stored)] += u64::from(inside[nearest]);
                    }
                }
            }
        }
        self.percentiles_of(&histogram, fractions)
    }

    /// The quantiles of all intensities; `fractions` are in 0..=1.
    pub fn percentiles<const N: usize>(&self, fractions: [f64; N]) -> [f32; N] {
        let mut histogram = vec![0u64; 1 << 16];
        for &stored in &self.voxels {
            histogram[usize::from(stored)] += 1;
        }
        let found = self.percentiles_of(&histogram, fractions);
        found.expect("a volume has voxels")
    }

    fn percentiles_of<const N: usize>(
        &self,
        histogram: &[u64],
        fractions: [f64; N],
    ) -> Option<[f32; N]> {
        let total: u64 = histogram.iter().sum();
        if total == 0 {
            return None;
        }
        Some(fractions.map(|fraction| {
            // A negative slope reverses the order of the stored values.
            let fraction = if self.rescale.slope < 0.0 {
                1.0 - fraction
            } else {
                fraction
            };
            let wanted = (fraction * total as f64).ceil().max(1.0) as u64;
            let mut below = 0;
            let stored = histogram.iter().position(|&count| {
                below += count;
                below >= wanted
            });
            self.intensity(stored.unwrap_or(histogram.len() - 1) as f32)
        }))
    }

    /// The smallest block of voxels that surrounds `region` with a margin of `margin_voxels`, as a separate volume.
    ///
    /// The block is clipped to this volume. `None` if nothing of it is inside.
    pub fn crop_to(&self, region: &Grid, margin_voxels: usize) -> Option<Self> {
        let [first, last] = self.block_around(region, margin_voxels)?;
        let size = [0, 1, 2].map(|axis| last[axis] - first[axis] + 1);
        let grid = self
            .grid
            .block(first.map(|voxel| voxel as i64), size)
            .ok()?;
        let mut voxels = Vec::with_capacity(grid.voxel_count());
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let start = self.grid.index([first[0], y, z]);
                voxels.extend_from_slice(&self.voxels[start..start + size[0]]);
            }
        }
        Some(Self {
            grid,
            voxels,
            rescale: self.rescale,
        })
    }

    /// First and last voxel of the part of this volume that surrounds `region`.
    fn block_around(&self, region: &Grid, margin: usize) -> Option<[[usize; 3]; 2]> {
        let voxel_from_region = self.grid.voxel_from_patient() * region.patient_from_voxel();
        let far = DVec3::from_array(region.size().map(|side| side as f64 - 0.5));
        let [low, high] = bounds_through(voxel_from_region, [DVec3::splat(-0.5), far]);
        let size = self.grid.size();
        let mut block = [[0; 3]; 2];
        for axis in 0..3 {
            let first = (low[axis].floor() - margin as f64).max(0.0);
            let last = (high[axis].ceil() + margin as f64).min(size[axis] as f64 - 1.0);
            if first > last {
                return None;
            }
            block[0][axis] = first as usize;
            block[1][axis] = last as usize;
        }
        Some(block)
    }
}

/// A position between two voxel centres of one axis.
#[derive(Clone, Copy)]
struct Cell {
    low: usize,
    high: usize,
    fraction: f32,
}

impl Cell {
    /// `None` outside every voxel; in the outer half of the first and the last voxel, only that voxel.
    #[inline]
    fn of(position: f32, side: usize) -> Option<Self> {
        let last = (side - 1) as f32;
        if !(position >= -0.5 && position <= last + 0.5) {
            return None;
        }
        let position = position.clamp(0.0, last);
        let low = position as usize;
        Some(Self {
            low,
            high: (low + 1).min(side - 1),
            fraction: position - low as f32,
        })
    }

    #[inline]
    fn between(self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.fraction
    }
}

fn clamped(voxel: [usize; 3], size: [usize; 3]) -> [usize; 3] {
    [0, 1, 2].map(|axis| voxel[axis].min(size[axis] - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BrainMask, Mask, envelope};

    const PLAIN: Rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };

    /// A volume with the stored values `100 + 2x + 10y + 30z`.
    fn ramp(size: [usize; 3], rescale: Rescale) -> Volume {
        let grid = Grid::aligned(size, [1.0; 3], DVec3::ZERO).unwrap();
        let value = |index| {
            let [x, y, z] = grid.voxel(index);
            (100 + 2 * x + 10 * y + 30 * z) as u16
        };
        let voxels = (0..grid.voxel_count()).map(value).collect();
        Volume::new(grid, voxels, rescale).unwrap()
    }

    #[test]
    fn sampling_is_exact_on_a_linear_ramp() {
        let volume = ramp([4, 5, 6], PLAIN);
        let value = volume.sample(Vec3::new(1.25, 2.5, 3.75)).unwrap();
        assert!((value - (100.0 + 2.5 + 25.0 + 112.5)).abs() < 1e-3);
        assert_eq!(
            volume.sample(Vec3::new(3.0, 4.0, 5.0)),
            Some(100.0 + 6.0 + 40.0 + 150.0)
        );
    }

    #[test]
    fn outside_of_the_volume_there_is_nothing() {
        let volume = ramp([4, 5, 6], PLAIN);
        assert_eq!(volume.sample(Vec3::new(-0.4, 0.0, 0.0)), Some(100.0));
        assert_eq!(volume.sample(Vec3::new(-0.6, 0.0, 0.0)), None);
        assert_eq!(volume.sample(Vec3::new(0.0, 4.6, 0.0)), None);
        assert_eq!(volume.sample(Vec3::new(0.0, f32::NAN, 0.0)), None);
    }

    #[test]
    fn a_crop_keeps_every_voxel_at_its_place_in_the_patient() {
        let volume = ramp([20, 20, 20], PLAIN);
        let region = Grid::aligned([3; 3], [1.0; 3], DVec3::new(5.0, 6.0, 7.0)).unwrap();
        let crop = volume.crop_to(&region, 2).unwrap();
        let patient = DVec3::new(6.0, 7.5, 8.0);
        let at = |volume: &Volume| {
            let voxel = volume.grid().voxel_from_patient().transform_point3(patient);
            volume.sample(voxel.as_vec3()).unwrap()
        };
        assert_eq!(at(&crop), at(&volume));
        assert!(crop.voxels().len() < volume.voxels().len());
        let far = Grid::aligned([3; 3], [1.0; 3], DVec3::splat(100.0)).unwrap();
        assert!(volume.crop_to(&far, 2).is_none());
    }

    #[test]
    fn percentiles_count_the_voxels_inside_alone() {
        for slope in [1.0, -1.0] {
            let volume = ramp(
                [12, 12, 12],
                Rescale {
                    slope,
                    intercept: 5.0,
                },
            );
            let mut mask = vec![false; 1728];
            for x in 2..=6 {
                mask[volume.grid().index([x, 5, 5])] = true;
            }
            let mask = Mask::new(volume.grid().clone(), mask).unwrap();
            let brain = BrainMask::from_mask(&mask, volume.grid()).unwrap();
            let envelope = envelope(&brain, 0.0).unwrap();
            let [least, middle, most] = volume
                .percentiles_inside(&envelope, [0.0, 0.5, 1.0])
                .unwrap();
            let intensity = |x: f32| slope * (100.0 + 2.0 * x + 50.0 + 150.0) + 5.0;
            let mut expected = [intensity(2.0), intensity(4.0), intensity(6.0)];
            expected.sort_by(f32::total_cmp);
            assert_eq!([least, middle, most], expected);
        }
    }

    #[test]
    fn percentiles_count_every_voxel() {
        for slope in [1.0, -1.0] {
            let rescale = Rescale {
                slope,
                intercept: 5.0,
            };
            let volume = ramp([11, 1, 1], rescale);
            let mut intensities: Vec<f32> = volume
                .voxels()
                .iter()
                .map(|&stored| volume.intensity(f32::from(stored)))
                .collect();
            intensities.sort_by(f32::total_cmp);
            assert_eq!(
                volume.percentiles([0.0, 0.5, 1.0]),
                [intensities[0], intensities[5], intensities[10]]
            );
        }
    }

    #[test]
    fn the_range_is_that_of_the_intensities() {
        let volume = ramp(
            [2, 2, 2],
            Rescale {
                slope: -2.0,
                intercept: 1.0,
            },
        );
        assert_eq!(volume.intensity_range(), [-2.0 * 142.0 + 1.0, -199.0]);
    }
}
