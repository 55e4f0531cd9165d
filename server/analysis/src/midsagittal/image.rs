//! A head as a small image, which is cheap to mirror.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use geometry::{Envelope, Volume};

/// The greatest number of voxels along the longest side of the envelope.
const LONGEST_SIDE: f64 = 64.0;
/// The margin of empty voxels around the envelope, for smoothing.
const MARGIN: usize = 3;
/// The quantiles inside the envelope that become 0 and 1.
const FRACTIONS: [f64; 2] = [0.02, 0.98];

/// Values of 0 to 1 on an isotropic grid along the patient axes; 0 outside the envelope and outside the grid.
#[derive(Debug, Clone)]
pub(super) struct Image {
    size: [usize; 3],
    /// The centre of the first voxel, LPS mm.
    origin: DVec3,
    pub(super) step_mm: f64,
    values: Vec<f32>,
}

impl Image {
    /// The intensities of a volume inside the envelope, between the 2nd and the 98th percentile.
    ///
    /// For a volume of a single intensity, the image is the shape of the envelope.
    pub(super) fn new(envelope: &Envelope, volume: &Volume) -> Self {
        let mut image = Self::around(envelope);
        let volume_from_patient = volume.grid().voxel_from_patient();
        // NaN outside the head.
        image.fill(|position_in_patient| {
            if !is_inside(envelope, position_in_patient) {
                return f32::NAN;
            }
            let voxel = volume_from_patient.transform_point3(position_in_patient);
            let stored = volume.sample(voxel.as_vec3());
            stored.map_or(f32::NAN, |stored| volume.intensity(stored))
        });
        scale(&mut image.values);
        image
    }

    /// 1 inside an envelope, on the grid of [`Image::new`].
    pub(super) fn shape(envelope: &Envelope) -> Self {
        let mut image = Self::around(envelope);
        image.fill(|position_in_patient| {
            f32::from(u8::from(is_inside(envelope, position_in_patient)))
        });
        image
    }

    /// An image of zeros around an envelope.
    fn around(envelope: &Envelope) -> Self {
        let grid = envelope.grid();
        let [first, last] = envelope.mask().bounds().expect("an envelope is not empty");
        let sides = [0, 1, 2].map(|axis| (last[axis] - first[axis]) as f64 * envelope.spacing_mm());
        let longest_mm = sides.into_iter().fold(0.0, f64::max);
        let step_mm = envelope.spacing_mm().max(longest_mm / LONGEST_SIDE);
        let size = sides.map(|side| (side / step_mm).ceil() as usize + 1 + 2 * MARGIN);
        let corner = DVec3::from_array(first.map(|place| place as f64));
        let corner_in_patient = grid.patient_from_voxel().transform_point3(corner);
        Self {
            size,
            origin: corner_in_patient - DVec3::splat(MARGIN as f64 * step_mm),
            step_mm,
            values: vec![0.0; size.iter().product()],
        }
    }

    fn fill(&mut self, value_at: impl Fn(DVec3) -> f32 + Sync) {
        let ([nx, ny, _], origin, step_mm) = (self.size, self.origin, self.step_mm);
        let rows = self.values.par_chunks_mut(nx).enumerate();
        rows.for_each(|(row, values)| {
            for (x, value) in values.iter_mut().enumerate() {
                let voxel = [x, row % ny, row / ny].map(|place| place as f64);
                *value = value_at(origin + DVec3::from_array(voxel) * step_mm);
            }
        });
    }

    /// The image convolved with 1 2 1 along each axis: a standard deviation of 0.7 voxels.
    pub(super) fn smoothed(mut self) -> Self {
        let [nx, ny, nz] = self.size;
        for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            let values = &self.values;
            let at = |index: usize| {
                let place = index / stride % side;
                let before = if place > 0 {
                    values[index - stride]
                } else {
                    0.0
                };
                let after = if place + 1 < side {
                    values[index + stride]
                } else {
                    0.0
                };
                (before + 2.0 * values[index] + after) / 4.0
            };
            self.values = (0..values.len()).into_par_iter().map(at).collect();
        }
        self
    }

    /// The image with half as many voxels along each axis: means of eight.
    pub(super) fn halved(&self) -> Self {
        let size = self.size.map(|side| side.div_ceil(2));
        let [nx, ny, _] = size;
        let mean = |index: usize| {
            let first = [index % nx, index / nx % ny, index / nx / ny].map(|place| 2 * place);
            let corner = |number: usize| {
                self.value([0, 1, 2].map(|axis| first[axis] + (number >> axis & 1)))
            };
            (0..8).map(corner).sum::<f32>() / 8.0
        };
        Self {
            size,
            origin: self.origin + DVec3::splat(self.step_mm / 2.0),
            step_mm: 2.0 * self.step_mm,
            values: (0..size.iter().product()).map(mean).collect(),
        }
    }

    /// Voxels along x.
    pub(super) fn width(&self) -> usize {
        self.size[0]
    }

    fn value(&self, voxel: [usize; 3]) -> f32 {
        if (0..3).any(|axis| voxel[axis] >= self.size[axis]) {
            return 0.0;
        }
        let [nx, ny, _] = self.size;
        self.values[voxel[0] + nx * (voxel[1] + ny * voxel[2])]
    }

    /// The non-zero values at every `stride`-th voxel along each axis, with their positions in patient space.
    pub(super) fn points(&self, stride: usize) -> impl Iterator<Item = (DVec3, f32)> + '_ {
        let [nx, ny, _] = self.size;
        self.values
            .iter()
            .enumerate()
            .filter_map(move |(index, &value)| {
                let voxel = [index % nx, index / nx % ny, index / nx / ny];
                let is_taken =
                    value > 0.0 && voxel.iter().all(|place| place.is_multiple_of(stride));
                let position = DVec3::from_array(voxel.map(|place| place as f64));
                is_taken.then(|| (self.origin + position * self.step_mm, value))
            })
    }

    /// Converts a position in patient space to voxels of this image.
    pub(super) fn place_of(&self, position_in_patient: DVec3) -> Vec3 {
        ((position_in_patient - self.origin) / self.step_mm).as_vec3()
    }

    /// The value at a position in voxels, trilinear, and its derivatives along the axes, per voxel.
    pub(super) fn sample(&self, place: Vec3) -> (f32, Vec3) {
        let [nx, ny, nz] = self.size;
        let last = Vec3::new(nx as f32 - 1.0, ny as f32 - 1.0, nz as f32 - 1.0);
        // Also false for NaN.
        if !(place.cmpge(Vec3::ZERO).all() && place.cmplt(last).all()) {
            return (0.0, Vec3::ZERO);
        }
        let (base, part) = (place.floor(), place.fract());
        let start = base.x as usize + nx * (base.y as usize + ny * base.z as usize);
        // For each pair of neighbours along x: the value between them, and their difference.
        let pair = |offset: usize| {
            let [low, high] = [self.values[start + offset], self.values[start + offset + 1]];
            (low + (high - low) * part.x, high - low)
        };
        let slice = |offset: usize| {
            let [(low, low_x), (high, high_x)] = [pair(offset), pair(offset + nx)];
            let along_y = high - low;
            (
                low + along_y * part.y,
                low_x + (high_x - low_x) * part.y,
                along_y,
            )
        };
        let [(low, low_x, low_y), (high, high_x, high_y)] = [slice(0), slice(nx * ny)];
        let along_z = high - low;
        let along_x = low_x + (high_x - low_x) * part.z;
        let along_y = low_y + (high_y - low_y) * part.z;
        (low + along_z * part.z, Vec3::new(along_x, along_y, along_z))
    }
}

/// Whether the voxel of the working grid nearest to a position is in the envelope.
fn is_inside(envelope: &Envelope, position_in_patient: DVec3) -> bool {
    let voxel_from_patient = envelope.grid().voxel_from_patient();
    let position_in_voxel = voxel_from_patient.transform_point3(position_in_patient);
    envelope.mask().contains(position_in_voxel)
}

/// Maps intensities to values of 0 to 1, and NaN to 0.
fn scale(values: &mut [f32]) {
    let mut inside: Vec<f32> = values
        .iter()
        .copied()
        .filter(|value| !value.is_nan())
        .collect();
    let mut percentile = |fraction: f64| {
        let last = inside.len().checked_sub(1)?;
        let place = (fraction * last as f64).round() as usize;
        Some(*inside.select_nth_unstable_by(place, f32::total_cmp).1)
    };
    let [low, high] = FRACTIONS.map(|fraction| percentile(fraction).unwrap_or_default());
    for value in values {
        *value = match *value {
            intensity if intensity.is_nan() => 0.0,
            intensity if low < high => ((intensity - low) / (high - low)).clamp(0.0, 1.0),
            _ => 1.0,
        };
    }
}
