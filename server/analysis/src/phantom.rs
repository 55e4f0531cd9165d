//! A head whose junction has a known width everywhere.

use std::sync::LazyLock;

use geometry::{BrainMask, DepthField, Grid, Mask, Rescale, Volume, distance_map, envelope};
use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::{Head, Maps, MapsUndefined, MidsagittalPlane, StoredMap, maps, midsagittal_plane};

/// Half-axes of the brain, in mm.
const OUTLINE_MM: DVec3 = DVec3::new(48.0, 58.0, 44.0);
/// How far below the outline fluid ends and white matter begins, in mm.
const FLUID_MM: f64 = 5.0;
pub const JUNCTION_MM: f64 = 11.0;
/// The width of the phantom's junction, in mm.
pub const WIDTH_MM: f64 = 1.3;
/// Centre of the lesion: on the junction of the left side, in the head's own coordinates.
pub fn lesion() -> DVec3 {
    static LESION: LazyLock<DVec3> = LazyLock::new(|| on_junction(DVec3::new(0.72, -0.35, 0.6)));
    *LESION
}
/// Radius of the lesion, and the width of its junction.
const LESION_MM: f64 = 8.0;
const LESION_WIDTH_MM: f64 = 2.6;

/// The integral of the normal density.
pub fn rise(place: f64) -> f64 {
    if place.abs() > 9.0 {
        return f64::from(place > 0.0);
    }
    // Abramowitz and Stegun, 7.1.26.
    let x = place.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = [
        1.061_405_429,
        -1.453_152_027,
        1.421_413_741,
        -0.284_496_736,
        0.254_829_592,
    ];
    let tail = series.iter().fold(0.0, |sum, c| (sum + c) * t) * (-x * x).exp();
    if place < 0.0 {
        tail / 2.0
    } else {
        1.0 - tail / 2.0
    }
}

/// Of each number, a value of mean 0 and variance 1.
pub fn white_noise(number: usize) -> f64 {
    let uniform = |salt: u64| {
        let mixed = (number as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ salt;
        let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let [radius, angle] = [uniform(1), uniform(0x5555)];
    (-2.0 * radius.max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}

/// About how far a position of the head lies below its outline, in mm.
fn below_outline(place: DVec3) -> f64 {
    let scaled = place / OUTLINE_MM;
    let radius = scaled.length().max(1e-9);
    (1.0 - radius) * radius / (scaled / OUTLINE_MM).length().max(1e-9)
}

/// The point of the junction in a direction from the centre.
pub fn on_junction(direction: DVec3) -> DVec3 {
    let direction = direction.normalize();
    let (mut low, mut high) = (0.0, OUTLINE_MM.max_element());
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if below_outline(direction * middle) > JUNCTION_MM {
            low = middle;
        } else {
            high = middle;
        }
    }
    direction * low
}

/// What a phantom is like and how it lies.
#[derive(Debug, Clone, Copy)]
pub struct Phantom {
    /// From the head's own coordinates to the patient's.
    pub placed: DAffine3,
    /// By how much the width of the junction varies from place to place, as a share.
    pub liveliness: f64,
    pub has_lesion: bool,
    /// The contrast of white and grey matter in intensities, and the deviation of the noise.
    pub contrast: f64,
    pub noise: f64,
}

impl Phantom {
    pub const PLAIN: Self = Self {
        placed: DAffine3::IDENTITY,
        liveliness: 0.0,
        has_lesion: false,
        contrast: 600.0,
        noise: 0.0,
    };

    /// The width of the junction at a position of the head, in mm.
    fn width_mm(&self, place: DVec3) -> f64 {
        let wave =
            || (place.x / 6.5 + 0.7).sin() + (place.y / 7.5).sin() + (place.z / 7.0 + 1.9).cos();
        let wave = if self.liveliness > 0.0 { wave() } else { 0.0 };
        let width = WIDTH_MM * (1.0 + self.liveliness * wave / 3.0);
        let into_lesion = 1.0 - (place.distance(lesion()) - LESION_MM) / 2.0;
        let share = if self.has_lesion {
            into_lesion.clamp(0.0, 1.0)
        } else {
            0.0
        };
        width + (LESION_WIDTH_MM - width).max(0.0) * share
    }

    fn intensity(&self, place: DVec3, below: f64) -> f64 {
        let white = rise((below - JUNCTION_MM) / self.width_mm(place));
        let tissue = rise((below - FLUID_MM) / 0.8);
        // Fluid is as far below grey matter as white matter is above it, twice over.
        1500.0 + self.contrast * (2.0 * tissue - 2.0 + white * tissue)
    }

    pub fn scan(&self, grid: &Grid) -> Scan {
        let head_from_voxel = self.placed.inverse() * grid.patient_from_voxel();
        let place = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            head_from_voxel.transform_point3(voxel)
        };
        let count = grid.voxel_count();
        let below: Vec<f64> = (0..count)
            .map(|index| below_outline(place(index)))
            .collect();
        let value = |index: usize| {
            if below[index] < -4.0 {
                return 0;
            }
            (self.intensity(place(index), below[index]) + self.noise * white_noise(index))
                .round()
                .max(0.0) as u16
        };
        let rescale = Rescale {
            slope: 0.5,
            intercept: 10.0,
        };
        let volume = Volume::new(grid.clone(), (0..count).map(value).collect(), rescale).unwrap();
        let is_brain = below.iter().map(|below| *below > 0.0).collect();
        let mask = Mask::new(grid.clone(), is_brain).unwrap();
        Scan::new(volume, &mask)
    }
}

/// 1 mm along the patient's axes, around the origin.
pub fn plain_grid() -> Grid {
    let size = [114, 134, 106];
    let origin = DVec3::from_array(size.map(|side| (side - 1) as f64 / -2.0));
    Grid::aligned(size, [1.0; 3], origin).unwrap()
}

/// Turned about the axis from bottom to top, then about the one from front to back, and moved.
pub fn turned(yaw_deg: f64, roll_deg: f64, by: DVec3) -> DAffine3 {
    let turn = DQuat::from_rotation_y(roll_deg.to_radians())
        * DQuat::from_rotation_z(yaw_deg.to_radians());
    DAffine3::from_rotation_translation(turn, by)
}

/// The other side of the head on each side.
pub fn mirrored() -> DAffine3 {
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        translation: DVec3::ZERO,
    }
}

/// A volume with all that maps are made of.
pub struct Scan {
    pub volume: Volume,
    pub depth: DepthField,
    pub plane: MidsagittalPlane,
}

impl Scan {
    pub fn new(volume: Volume, mask: &Mask) -> Self {
        let brain = BrainMask::from_mask(mask, volume.grid()).unwrap();
        let envelope = envelope(&brain, 10.0).unwrap();
        Self {
            depth: DepthField::new(&distance_map(&envelope)),
            plane: midsagittal_plane(&envelope, &volume),
            volume,
        }
    }

    pub fn maps(&self) -> Result<Maps, MapsUndefined> {
        maps(self.head(), None)
    }

    pub fn head(&self) -> Head<'_> {
        Head {
            volume: &self.volume,
            depth: &self.depth,
            plane: &self.plane,
        }
    }
}

/// The value of a map at a position in the patient, trilinear; NaN if one of the eight voxels is undefined or outside.
pub fn sample(map: &StoredMap, position_in_patient: DVec3) -> f32 {
    let grid = map.grid();
    let place = grid
        .voxel_from_patient()
        .transform_point3(position_in_patient);
    let base = place.floor();
    let part = place - base;
    let size = DVec3::from_array(grid.size().map(|side| side as f64));
    if base.cmplt(DVec3::ZERO).any() || (base + 1.0).cmpge(size).any() {
        return f32::NAN;
    }
    let base = base.to_array().map(|along| along as usize);
    let corner = |number: usize| {
        let ends = [0, 1, 2].map(|axis| number >> axis & 1);
        let weight = |axis: usize| {
            if ends[axis] > 0 {
                part[axis]
            } else {
                1.0 - part[axis]
            }
        };
        let voxel = [0, 1, 2].map(|axis| base[axis] + ends[axis]);
        map.value(grid.index(voxel)) * (weight(0) * weight(1) * weight(2)) as f32
    };
    (0..8).map(corner).sum()
}
