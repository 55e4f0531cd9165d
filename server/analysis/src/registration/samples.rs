//! The points of the case at which two volumes are compared.

use geometry::{BrainMask, Envelope, Mask, offset};
use glam::{DVec3, Vec3};

use super::image::Image;

/// Points of the case with the bins of their intensities.
pub(super) struct Samples {
    /// Whether all intensities of the case are equal.
    pub(super) are_flat: bool,
    /// The positions relative to the centre, in mm.
    pub(super) places: Vec<Vec3>,
    pub(super) bins: Vec<u8>,
}

/// The compared region: the envelope with a margin.
pub(super) struct Region {
    mask: Mask,
    pub(super) centre: DVec3,
    /// The root mean square distance of the region from its centre, in mm.
    pub(super) radius_mm: f64,
}

impl Region {
    /// The envelope grown by `margin_mm`, or the envelope itself if it cannot grow.
    pub(super) fn around(envelope: &Envelope, margin_mm: f64) -> Self {
        let grown = BrainMask::from_stored(envelope.mask().clone())
            .and_then(|brain| offset(&brain, margin_mm));
        let mask = grown.map_or_else(|_| envelope.mask().clone(), |grown| grown.mask().clone());
        let grid = mask.grid();
        let inside = (0..grid.voxel_count())
            .step_by(7)
            .filter(|&index| mask.voxels()[index]);
        let (mut sum, mut squared, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for index in inside {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            sum += voxel;
            squared += voxel * voxel;
            count += 1.0;
        }
        let mean = sum / f64::max(count, 1.0);
        let variance = (squared / f64::max(count, 1.0) - mean * mean).max(DVec3::ZERO);
        Self {
            centre: grid.patient_from_voxel().transform_point3(mean),
            radius_mm: variance.element_sum().sqrt() * grid.spacing_mm()[0],
            mask,
        }
    }

    /// Points inside, one at a pseudo-random position in each cube of `step_mm`. On a regular grid, repeated
    /// coincidences of the points with voxels would attract the images to each other.
    pub(super) fn places(&self, step_mm: f64) -> Vec<Vec3> {
        let grid = self.mask.grid();
        let [nx, ny, nz] = grid
            .size()
            .map(|side| (side as f64 * grid.spacing_mm()[0] / step_mm) as u32 + 1);
        let corner = grid.patient_from_voxel().translation;
        let mut places = Vec::new();
        for cube in 0..nx * ny * nz {
            let cell = [cube % nx, cube / nx % ny, cube / nx / ny].map(f64::from);
            let place = corner + (DVec3::from_array(cell) + jitter(cube)) * step_mm;
            if self.holds(place) {
                places.push((place - self.centre).as_vec3());
            }
        }
        places
    }

    fn holds(&self, place: DVec3) -> bool {
        let grid = self.mask.grid();
        let voxel = grid.voxel_from_patient().transform_point3(place);
        if !grid.contains(voxel) {
            return false;
        }
        let size = grid.size();
        let nearest = voxel.round().to_array().map(|place| place as usize);
        let nearest = [0, 1, 2].map(|axis| nearest[axis].min(size[axis] - 1));
        self.mask.voxels()[grid.index(nearest)]
    }
}

/// A pseudo-random point of the unit cube, determined by the number.
fn jitter(number: u32) -> DVec3 {
    let mut state = number.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    let mut next = || {
        state ^= state >> 16;
        state = state.wrapping_mul(0x7feb_352d);
        state ^= state >> 15;
        state = state.wrapping_mul(0x846c_a68b);
        state ^= state >> 16;
        f64::from(state) / f64::from(u32::MAX)
    };
    DVec3::new(next(), next(), next())
}

impl Samples {
    /// The intensities of the case at the points inside it.
    pub(super) fn new(places: &[Vec3], centre: DVec3, image: &Image, bin_count: usize) -> Self {
        let voxel_from_patient = image.patient_from_voxel.inverse();
        let (mut kept, mut values) = (Vec::new(), Vec::new());
        for &place in places {
            let voxel = voxel_from_patient.transform_point3(place.as_dvec3() + centre);
            if let Some(value) = image.sample(voxel) {
                kept.push(place);
                values.push(value);
            }
        }
        let range = Range::of(&values);
        let bin = |&value: &f32| {
            let bin = range.share(value) * bin_count as f32;
            (bin as usize).min(bin_count - 1) as u8
        };
        Self {
            are_flat: range.is_flat(),
            bins: values.iter().map(bin).collect(),
            places: kept,
        }
    }
}

/// The range of intensities of the bins; values beyond it count as its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    low: f32,
    high: f32,
}

impl Range {
    /// From the 0.5th to the 99.5th percentile; values beyond are rarely tissue.
    pub(super) fn of(values: &[f32]) -> Self {
        let mut sorted: Vec<f32> = values.to_vec();
        let last = sorted.len().saturating_sub(1);
        let mut at = |share: f64| {
            let rank = (share * last as f64) as usize;
            if sorted.is_empty() {
                return 0.0;
            }
            *sorted.select_nth_unstable_by(rank, f32::total_cmp).1
        };
        let (low, high) = (at(0.005), at(0.995));
        Self { low, high }
    }

    /// Whether there is at most one intensity.
    pub(super) fn is_flat(self) -> bool {
        self.high <= self.low
    }

    /// The position of a value between the ends, 0 to 1.
    pub(super) fn share(self, value: f32) -> f32 {
        if self.is_flat() {
            return 0.0;
        }
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }
}
