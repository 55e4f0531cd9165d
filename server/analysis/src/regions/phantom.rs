//! A brain whose parts are known: a cerebrum with a fissure and ventricles, a cerebellum below a dark tentorium, and a
//! brain stem with a pons.

use geometry::{Grid, Mask, Rescale, Volume};
use glam::{DAffine3, DVec2, DVec3};

use super::Region;
use crate::phantom::{Scan, rise, white_noise};

// In mm along the axes of the phantom: to the left, to the front, upwards.
const CEREBRUM_MM: DVec3 = DVec3::new(0.0, 4.0, 14.0);
const CEREBRUM_HALF_AXES_MM: DVec3 = DVec3::new(68.0, 86.0, 58.0);
const CEREBELLUM_MM: DVec3 = DVec3::new(0.0, -46.0, -37.0);
const CEREBELLUM_HALF_AXES_MM: DVec3 = DVec3::new(53.0, 31.0, 27.0);
/// The base of the cerebrum in the middle, and how far to either side; the temporal lobes go deeper.
const BASE_MM: f64 = -18.0;
const BASE_TO_MM: f64 = 20.0;
/// The axis of the stem, (y, z), from the cerebrum down to where it leaves the volume.
const STEM_FROM: DVec2 = DVec2::new(-5.0, -10.0);
const STEM_TO: DVec2 = DVec2::new(-33.0, -67.0);
/// Along this axis: the narrowest place, which is the border of the cerebrum, and the middle of the pons.
const NECK_MM: f64 = 11.0;
const PONS_MM: f64 = 25.0;
/// The fluid around the stem.
const CISTERN_MM: f64 = 5.0;
/// The gap between cerebrum and cerebellum.
const TENTORIUM_MM: f64 = 2.0;
const CORTEX_MM: f64 = 3.0;
/// Farther than this inside the cerebrum, the nearest sulcus changes nothing.
const SULCI_TO_MM: f64 = 20.0;
/// The stem is nowhere thicker.
const STEM_RADIUS_MM: f64 = 18.0;
/// The middle of the left peduncle of the cerebellum, and its radius.
const PEDUNCLE_MM: DVec3 = DVec3::new(14.0, -27.0, -38.0);
const PEDUNCLE_RADIUS_MM: f64 = 8.0;

/// What a phantom is like and how it lies.
#[derive(Debug, Clone, Copy)]
pub struct BrainPhantom {
    /// From the axes of the phantom to the patient.
    pub placed: DAffine3,
    /// The half-axes of the ventricles, in mm.
    pub ventricles_mm: DVec3,
    /// The centre and the radius of a dark mass.
    pub mass: Option<(DVec3, f64)>,
    /// Whether the right half of the cerebrum is there.
    pub has_right_half: bool,
    /// How deep the fissure between the hemispheres is, in mm.
    pub fissure_mm: f64,
    /// The deviation of the noise, in tissue scale.
    pub noise: f64,
}

impl BrainPhantom {
    pub const PLAIN: Self = Self {
        placed: upright(),
        ventricles_mm: DVec3::new(7.0, 26.0, 9.0),
        mass: None,
        has_right_half: true,
        fissure_mm: 38.0,
        noise: 0.08,
    };
}

/// A further scan of the phantom, in a space of its own.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedLayer {
    pub spacing_mm: [f64; 3],
    /// The intensities of fluid, grey and white matter.
    pub tissues: [f64; 3],
    /// By how much of its intensity a ball is brighter, and the centre and the radius of the ball in the case.
    pub brighter: f64,
    pub lesion: (DVec3, f64),
    /// From its space to that of the case.
    pub case_from_layer: DAffine3,
}

impl SimulatedLayer {
    /// A FLAIR of a turbo spin echo, and one of a three-dimensional sequence with less contrast and brighter fluid.
    pub const FLAIR: Self = Self {
        spacing_mm: [1.5; 3],
        tissues: [200.0, 1300.0, 1000.0],
        brighter: 0.0,
        lesion: (DVec3::new(40.0, -25.0, 32.0), 8.0),
        case_from_layer: DAffine3::IDENTITY,
    };
    pub const WEAK_FLAIR: Self = Self {
        tissues: [500.0, 1150.0, 1000.0],
        ..Self::FLAIR
    };
    /// A T2, whose fluid is bright.
    pub const T2: Self = Self {
        tissues: [3000.0, 1600.0, 1000.0],
        ..Self::FLAIR
    };
}

/// The axes of the phantom in LPS: anterior is −y.
const fn upright() -> DAffine3 {
    DAffine3 {
        matrix3: glam::DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::Z),
        translation: DVec3::ZERO,
    }
}

/// About how far a place lies inside an ellipsoid, in mm.
fn inside(place: DVec3, centre: DVec3, half_axes: DVec3) -> f64 {
    let scaled = (place - centre) / half_axes;
    let radius = scaled.length().max(1e-9);
    (1.0 - radius) * radius / (scaled / half_axes).length().max(1e-9)
}

/// How much of a place belongs to an ellipsoid with a border about `blur_mm` wide.
fn share_of(place: DVec3, centre: DVec3, half_axes: DVec3, blur_mm: f64) -> f64 {
    if ((place - centre) / half_axes).length_squared() > 4.0 {
        return 0.0;
    }
    rise(inside(place, centre, half_axes) / blur_mm)
}

/// Whether a place may lie in the brain; most of a volume does not.
fn may_be_brain(place: DVec3, side: DVec3) -> bool {
    let is_in =
        |centre: DVec3, half_axes: DVec3| ((place - centre) / half_axes).length_squared() < 1.0;
    is_in(CEREBRUM_MM, CEREBRUM_HALF_AXES_MM)
        || is_in(CEREBELLUM_MM, CEREBELLUM_HALF_AXES_MM)
        || side.distance(PEDUNCLE_MM) < PEDUNCLE_RADIUS_MM
        || side.x < STEM_RADIUS_MM && place.z < STEM_FROM.y + STEM_RADIUS_MM
}

/// How far a place lies inside the stem, in mm, and where along its axis.
fn in_stem(place: DVec3) -> (f64, f64) {
    let downwards = (STEM_TO - STEM_FROM).normalize();
    let from = DVec2::new(place.y, place.z) - STEM_FROM;
    let along = from.dot(downwards);
    let from_axis = (from - downwards * along).extend(place.x).length();
    let from_neck = ((along - NECK_MM) / 8.0).powi(2).min(1.0);
    let bulge = 5.0 * (-((along - PONS_MM) / 8.0).powi(2)).exp();
    let radius = 11.0 + 2.0 * from_neck + bulge - 4.0 * ((along - PONS_MM) / 12.0).clamp(0.0, 1.0);
    let ends = along.min((STEM_TO - STEM_FROM).length() - along);
    ((radius - from_axis).min(ends), along)
}

/// The distance from the nearest of many dark sheets, about `apart_mm` from each other.
fn from_fold(place: DVec3, apart_mm: f64) -> f64 {
    let phase = place / (apart_mm / 3.0);
    let wave = (phase.x + 0.4).sin() + phase.y.sin() + (phase.z + 1.0).sin();
    wave.abs() * apart_mm / 4.0
}

/// As `hypot`, which takes several times as long to be right in the last bit.
fn length(x: f64, y: f64) -> f64 {
    DVec2::new(x, y).length()
}

impl BrainPhantom {
    /// The part of a place, by its axes, and the tissue scale there; `None` outside the brain.
    pub fn at(&self, place: DVec3) -> Option<(Region, f64)> {
        let side = DVec3::new(place.x.abs(), place.y, place.z);
        if !may_be_brain(place, side) {
            return None;
        }
        let (stem, along) = in_stem(place);
        let cerebellum = inside(place, CEREBELLUM_MM, CEREBELLUM_HALF_AXES_MM);
        let base = place.z - BASE_MM + 1.3 * (side.x - BASE_TO_MM).max(0.0);
        let to_stem = if along > NECK_MM {
            -stem - CISTERN_MM
        } else {
            f64::INFINITY
        };
        let own = inside(place, CEREBRUM_MM, CEREBRUM_HALF_AXES_MM)
            .min(base)
            .min(-cerebellum - TENTORIUM_MM)
            .min(to_stem);
        let peduncle = PEDUNCLE_RADIUS_MM - side.distance(PEDUNCLE_MM);
        let cerebrum = if place.x >= 0.0 {
            Region::LeftCerebrum
        } else {
            Region::RightCerebrum
        };
        let (region, below_surface) = if stem > 0.0 {
            let region = if along > NECK_MM {
                Region::BrainStem
            } else {
                cerebrum
            };
            (region, stem + CORTEX_MM)
        } else if cerebellum > 0.0 || peduncle > 0.0 {
            let folia = length(from_fold(place, 7.0), (cerebellum - 9.0).max(0.0)) + 1.5;
            (
                Region::Cerebellum,
                cerebellum.min(folia).max(peduncle + CORTEX_MM),
            )
        } else if own > 0.0 && (self.has_right_half || place.x > 0.0) {
            let sulci = if own > SULCI_TO_MM {
                own
            } else {
                length(from_fold(place, 14.0), (own - 11.0).max(0.0)) - 0.3
            };
            let fissure = length(side.x, (own - self.fissure_mm).max(0.0)) - 0.8;
            (cerebrum, own.min(sulci).min(fissure))
        } else {
            return None;
        };
        let white = rise((below_surface - CORTEX_MM) / 0.6);
        let grey = rise(below_surface / 0.5);
        let nuclei = [
            (DVec3::new(11.0, -2.0, 0.0), DVec3::new(8.0, 11.0, 8.0)),
            (DVec3::new(26.0, 14.0, 2.0), DVec3::new(6.0, 15.0, 11.0)),
        ]
        .map(|(centre, half_axes)| share_of(side, centre, half_axes, 0.6));
        let nucleus = nuclei[0].max(nuclei[1]);
        let fluid = share_of(side, DVec3::new(12.0, 0.0, 14.0), self.ventricles_mm, 0.5);
        let tissue = -1.6 * (1.0 - grey) + white * grey * (1.0 - 0.35 * nucleus);
        let mut value = tissue * (1.0 - fluid) - 1.6 * fluid;
        if let Some((centre, radius)) = self.mass {
            let mass = rise((radius - place.distance(centre)) / 1.5);
            value = value * (1.0 - mass) - 0.3 * mass;
        }
        Some((region, value))
    }

    pub fn scan(&self, grid: &Grid) -> Scan {
        self.scan_and_mask(grid).0
    }

    pub fn scan_and_mask(&self, grid: &Grid) -> (Scan, Mask) {
        let (volume, mask) = self.head(grid);
        (Scan::new(volume, &mask), mask)
    }

    /// The intensities, and the voxels of the brain.
    pub fn head(&self, grid: &Grid) -> (Volume, Mask) {
        let tissues = self.tissues(grid);
        let value = |(index, tissue): (usize, &Option<f64>)| {
            let value = tissue.unwrap_or(-1.8) + self.noise * white_noise(index);
            (1000.0 + 400.0 * value).round().max(0.0) as u16
        };
        let volume = Volume::new(
            grid.clone(),
            tissues.iter().enumerate().map(value).collect(),
            Rescale {
                slope: 1.0,
                intercept: 0.0,
            },
        )
        .unwrap();
        (volume, brain(grid, &tissues))
    }

    /// The tissue scale of each voxel; `None` outside the brain.
    fn tissues(&self, grid: &Grid) -> Vec<Option<f64>> {
        let own_from_voxel = self.placed.inverse() * grid.patient_from_voxel();
        let tissue = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            let place = own_from_voxel.transform_point3(voxel);
            self.at(place).map(|(_, tissue)| tissue)
        };
        (0..grid.voxel_count()).map(tissue).collect()
    }

    /// A simulated scan with another contrast, and with a bias of the coil and noise.
    pub fn other_contrast(&self, layer: &SimulatedLayer) -> Volume {
        let around = grid();
        let low = around.patient_from_voxel().translation - 10.0;
        let size = [0, 1, 2].map(|axis| {
            let side_mm = around.size()[axis] as f64 + 20.0;
            (side_mm / layer.spacing_mm[axis]).ceil() as usize
        });
        let own = Grid::aligned(size, layer.spacing_mm, low).unwrap();
        let patient_from_voxel = layer.case_from_layer.inverse() * own.patient_from_voxel();
        let layer_grid = Grid::new(size, patient_from_voxel).unwrap();
        let case_from_voxel = layer.case_from_layer * patient_from_voxel;
        let own_from_case = self.placed.inverse();
        let (centre, radius_mm) = layer.lesion;
        let [fluid, grey, white] = layer.tissues;
        let value = |index: usize| {
            let voxel = DVec3::from_array(layer_grid.voxel(index).map(|along| along as f64));
            let at = |part: DVec3| {
                let place = case_from_voxel.transform_point3(voxel + part);
                let tissue = self.at(own_from_case.transform_point3(place));
                let value = match tissue.map_or(-1.8, |(_, tissue)| tissue) {
                    tissue if tissue < 0.0 => grey + (grey - fluid) * tissue / 1.6,
                    tissue => grey + (white - grey) * tissue,
                };
                let in_lesion = (radius_mm - place.distance(centre)).clamp(0.0, 1.0);
                value * (1.0 + layer.brighter * in_lesion)
            };
            // A voxel averages over its volume.
            let parts = [-0.25, 0.25].map(|z| {
                [
                    at(DVec3::new(-0.25, 0.25, z)),
                    at(DVec3::new(0.25, -0.25, z)),
                ]
            });
            let place = case_from_voxel.transform_point3(voxel);
            let bias = 1.0 + place.x / 400.0 + place.y / 600.0;
            let mean = parts.as_flattened().iter().sum::<f64>() / 4.0;
            let noisy = mean * bias + 0.04 * white * white_noise(index + 7);
            noisy.round().max(1.0) as u16
        };
        let voxels = (0..layer_grid.voxel_count()).map(value).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        Volume::new(layer_grid, voxels, rescale).expect("one value for each voxel")
    }

    /// The voxels of the brain.
    pub fn mask(&self, grid: &Grid) -> Mask {
        brain(grid, &self.tissues(grid))
    }
}

fn brain(grid: &Grid, tissues: &[Option<f64>]) -> Mask {
    let voxels = tissues.iter().map(Option::is_some).collect();
    Mask::new(grid.clone(), voxels).expect("one value for each voxel")
}

/// Cubic voxels of 1 mm along the patient axes, around the phantom.
pub fn grid() -> Grid {
    let size = [150, 190, 150];
    let origin = DVec3::new(-74.5, -92.5, -76.0);
    Grid::aligned(size, [1.0; 3], origin).unwrap()
}
