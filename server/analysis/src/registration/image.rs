//! A volume at a coarser resolution, along its own axes.

use geometry::Volume;
use glam::{DAffine3, DVec3};

/// The blur of an image, as a standard deviation in steps. A full width at half maximum of one step is 0.42.
const BLUR: f64 = 0.45;
/// The greatest length of a voxel, in steps.
const EXCESS: f64 = 0.3;
/// The fewest voxels along an axis that is coarsened.
const LEAST_SIDE: usize = 8;

/// Intensities on a grid along the axes of the volume, smoothed to match the voxel size.
#[derive(Debug, Clone)]
pub(super) struct Image {
    pub(super) size: [usize; 3],
    pub(super) patient_from_voxel: DAffine3,
    pub(super) values: Vec<f32>,
    /// The step that the smoothing of each axis matches, in mm.
    smooth_for_mm: [f64; 3],
}

impl Image {
    /// The intensities, smoothed and subsampled as by [`Image::coarser`], slice by slice, so that only one slice is
    /// copied at a time.
    pub(super) fn new(volume: &Volume, step_mm: f64) -> Self {
        let grid = volume.grid();
        let [nx, ny, nz] = grid.size();
        let intensity = |&stored: &u16| volume.intensity(f32::from(stored));
        let thinned = |stored: &[u16]| {
            let slice = Self {
                size: [nx, ny, 1],
                patient_from_voxel: grid.patient_from_voxel(),
                values: stored.iter().map(intensity).collect(),
                smooth_for_mm: grid.spacing_mm(),
            };
            slice.coarser_along(0, step_mm).coarser_along(1, step_mm)
        };
        let mut slices = volume.voxels().chunks_exact(nx * ny).map(thinned);
        let mut image = slices.next().expect("a grid is not empty");
        image.size[2] = nz;
        for slice in slices {
            image.values.extend(slice.values);
        }
        image.coarser_along(2, step_mm)
    }

    /// The image, smoothed and subsampled to voxels of about `step_mm`; coarser axes stay unchanged.
    pub(super) fn coarser(&self, step_mm: f64) -> Self {
        let along_x = self.coarser_along(0, step_mm);
        along_x.coarser_along(1, step_mm).coarser_along(2, step_mm)
    }

    fn coarser_along(&self, axis: usize, step_mm: f64) -> Self {
        let spacing = self.spacing_mm(axis);
        let side = self.size[axis];
        let factor = ((step_mm / spacing + EXCESS) as usize).clamp(1, (side / LEAST_SIDE).max(1));
        let missing = step_mm.powi(2) - self.smooth_for_mm[axis].powi(2);
        let deviation = BLUR * missing.max(0.0).sqrt() / spacing;
        if factor == 1 && deviation < 0.2 {
            return self.clone();
        }
        let kernel = Kernel::new(deviation, factor);
        let mut size = self.size;
        size[axis] = side / factor;
        let first = DVec3::AXES[axis] * kernel.centre;
        let mut patient_from_voxel = self.patient_from_voxel;
        patient_from_voxel.translation = patient_from_voxel.transform_point3(first);
        *patient_from_voxel.matrix3.col_mut(axis) *= factor as f64;
        let mut smooth_for_mm = self.smooth_for_mm;
        smooth_for_mm[axis] = smooth_for_mm[axis].max(step_mm);
        Self {
            size,
            patient_from_voxel,
            values: kernel.applied(&self.values, self.size, axis, size[axis]),
            smooth_for_mm,
        }
    }

    fn spacing_mm(&self, axis: usize) -> f64 {
        self.patient_from_voxel.matrix3.col(axis).length()
    }

    /// The value at a position in voxels, trilinear; `None` beyond the outermost voxel centres.
    pub(super) fn sample(&self, place: DVec3) -> Option<f32> {
        let [nx, ny, nz] = self.size;
        let last = DVec3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0);
        if !(place.cmpge(DVec3::ZERO).all() && place.cmple(last).all()) {
            return None;
        }
        let base = place.floor();
        let part = (place - base).as_vec3();
        let [x, y, z] = base.to_array().map(|place| place as usize);
        let next = |place: usize, side: usize| (place + 1).min(side - 1);
        let row = |y: usize, z: usize| {
            let start = nx * (y + ny * z);
            let (low, high) = (self.values[start + x], self.values[start + next(x, nx)]);
            low + (high - low) * part.x
        };
        let slice = |z: usize| {
            let (low, high) = (row(y, z), row(next(y, ny), z));
            low + (high - low) * part.y
        };
        let (low, high) = (slice(z), slice(next(z, nz)));
        Some(low + (high - low) * part.z)
    }

    /// The centre of the grid, LPS mm.
    pub(super) fn middle(&self) -> DVec3 {
        let middle = self.size.map(|side| (side - 1) as f64 / 2.0);
        self.patient_from_voxel
            .transform_point3(DVec3::from_array(middle))
    }

    /// The centroid of the voxels brighter than the mean, LPS mm.
    pub(super) fn centre_of_mass(&self) -> DVec3 {
        let mean = self
            .values
            .iter()
            .map(|&value| f64::from(value))
            .sum::<f64>()
            / self.values.len() as f64;
        let [nx, ny, _] = self.size;
        let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
        for (index, &value) in self.values.iter().enumerate() {
            if f64::from(value) > mean {
                let voxel = [index % nx, index / nx % ny, index / nx / ny];
                sum += DVec3::from_array(voxel.map(|place| place as f64));
                weight += 1.0;
            }
        }
        if weight == 0.0 {
            return self.middle();
        }
        self.patient_from_voxel.transform_point3(sum / weight)
    }
}

/// A Gaussian, evaluated at every `factor`-th voxel.
struct Kernel {
    weights: Vec<f32>,
    /// The position of the first result, in voxels of the source.
    centre: f64,
    /// The source voxel of the first weight of the first result.
    first: isize,
    factor: usize,
}

impl Kernel {
    fn new(deviation: f64, factor: usize) -> Self {
        let centre = (factor - 1) as f64 / 2.0;
        let deviation = deviation.max(1e-3);
        let reach = (3.0 * deviation).max(0.6);
        let first = (centre - reach).ceil() as isize;
        let last = (centre + reach).floor() as isize;
        let weight = |voxel: isize| (-0.5 * ((voxel as f64 - centre) / deviation).powi(2)).exp();
        let weights: Vec<f64> = (first..=last).map(weight).collect();
        let total: f64 = weights.iter().sum();
        Self {
            weights: weights
                .iter()
                .map(|weight| (weight / total) as f32)
                .collect(),
            centre,
            first,
            factor,
        }
    }

    /// The values convolved along one axis, with `side` voxels in the result. Beyond its ends the outermost voxels are
    /// repeated.
    fn applied(&self, values: &[f32], size: [usize; 3], axis: usize, side: usize) -> Vec<f32> {
        // Lines of the axis, as rows of `inner` values that are adjacent in memory.
        let inner: usize = size[..axis].iter().product();
        let along = size[axis];
        let outer: usize = size[axis + 1..].iter().product();
        let mut result = vec![0.0; inner * side * outer];
        let source = |place: usize, tap: usize| {
            let voxel = self.first + (place * self.factor + tap) as isize;
            voxel.clamp(0, along as isize - 1) as usize
        };
        for block in 0..outer {
            let from = &values[block * inner * along..][..inner * along];
            let to = &mut result[block * inner * side..][..inner * side];
            if inner == 1 {
                self.along_row(from, to, source);
                continue;
            }
            for place in 0..side {
                let row = &mut to[place * inner..][..inner];
                for (tap, &weight) in self.weights.iter().enumerate() {
                    let taken = &from[source(place, tap) * inner..][..inner];
                    for (sum, &value) in row.iter_mut().zip(taken) {
                        *sum += weight * value;
                    }
                }
            }
        }
        result
    }

    fn along_row(&self, from: &[f32], to: &mut [f32], source: impl Fn(usize, usize) -> usize) {
        let taps = self.weights.len();
        for (place, sum) in to.iter_mut().enumerate() {
            let start = self.first + (place * self.factor) as isize;
            let inside = start >= 0 && start as usize + taps <= from.len();
            *sum = if inside {
                let taken = &from[start as usize..][..taps];
                taken
                    .iter()
                    .zip(&self.weights)
                    .map(|(value, weight)| value * weight)
                    .sum()
            } else {
                let terms = self.weights.iter().enumerate();
                terms
                    .map(|(tap, weight)| from[source(place, tap)] * weight)
                    .sum()
            };
        }
    }
}
