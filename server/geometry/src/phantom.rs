//! Shapes with known answers, and a synthetic head with folded gyri, for tests, benches and the demo.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::{
    BrainMask, BuiltModel, ClosedBrain, DeformableModel, Envelope, GeometryError, Grid, Mask,
    Rescale, Volume,
};

/// Half of the sides of the volume, in mm: left to right, front to back, top to bottom.
const HEAD_HALF_EXTENT_MM: DVec3 = DVec3::new(92.0, 108.0, 92.0);
/// Half-axes of the outline of the brain, in mm.
const BRAIN_HALF_AXES_MM: DVec3 = DVec3::new(70.0, 86.0, 66.0);
/// Thickness of the cortical ribbon, in mm.
const CORTEX_MM: f64 = 3.0;
/// Depth of the sulci below the outline, in mm.
const SULCUS_DEPTH_MM: f64 = 16.0;
/// Centre of the blurred lesion in LPS mm: in the right frontal lobe, at the bottom of sulci.
pub const LESION_IN_PATIENT: DVec3 = DVec3::new(-34.0, -46.0, 26.0);
/// Radius of the blur between grey and white matter, in mm.
const LESION_RADIUS_MM: f64 = 8.0;

/// A synthetic head and its brain mask.
#[derive(Debug, Clone)]
pub struct PhantomHead {
    /// T1-like intensities with skull and scalp.
    pub volume: Volume,
    /// The voxels of its brain.
    pub brain: Mask,
}

/// The envelope of the voxels of `grid` with `is_inside` true at their centres (LPS mm).
///
/// # Panics
/// If that is not a valid envelope: empty, touching a face of the grid, or not on a working grid.
pub fn envelope(grid: &Grid, is_inside: impl Fn(DVec3) -> bool) -> Envelope {
    let voxels = centres(grid).map(is_inside).collect();
    let mask = Mask::new(grid.clone(), voxels).expect("one value for each voxel");
    Envelope::from_stored(mask).expect("an envelope inside its grid")
}

/// A volume with the values of `intensity` at the centres of its voxels (LPS mm).
pub fn volume(grid: Grid, intensity: impl Fn(DVec3) -> u16) -> Volume {
    let voxels = centres(&grid).map(intensity).collect();
    Volume::new(grid, voxels, UNSCALED).expect("one value for each voxel")
}

/// The model of a volume and an envelope, whether or not the volume is cropped to it.
///
/// # Panics
/// If the envelope is too small for a mesh.
pub fn model(volume: Volume, envelope: Envelope) -> BuiltModel {
    let closed = ClosedBrain::Envelope(envelope);
    let built = DeformableModel::build(volume, closed, |_| Ok::<_, GeometryError>(()));
    built.expect("an envelope that is large enough for a mesh")
}

const UNSCALED: Rescale = Rescale {
    slope: 1.0,
    intercept: 0.0,
};

/// The centres of the voxels of a grid in LPS mm, x-fastest.
fn centres(grid: &Grid) -> impl Iterator<Item = DVec3> {
    let voxels = (0..grid.voxel_count()).map(|index| grid.voxel(index));
    voxels.map(|voxel| {
        let voxel = DVec3::from_array(voxel.map(|place| place as f64));
        grid.patient_from_voxel().transform_point3(voxel)
    })
}

/// A ball of `radius_voxels` around a voxel centre, at 1 mm.
///
/// # Panics
/// If the radius is not within 0 to 200.
pub fn ball(radius_voxels: f64) -> BrainMask {
    ellipsoid([radius_voxels; 3], 1.0)
}

/// An ellipsoid along the patient axes, around a voxel centre.
///
/// # Panics
/// If a half-axis is not within 0 to 200 voxels, or the spacing is not positive.
pub fn ellipsoid(half_axes_voxels: [f64; 3], spacing_mm: f64) -> BrainMask {
    let axes = DVec3::from_array(half_axes_voxels);
    shape(axes.ceil(), spacing_mm, |position| {
        (position / axes).length_squared() <= 1.0
    })
}

/// Two balls of the given radii, joined by a bar between their centres, which are `apart_voxels` from each other along
/// x.
///
/// # Panics
/// If a length is not within 0 to 200 voxels.
pub fn two_lobes(radii_voxels: [f64; 2], apart_voxels: f64, bar_radius_voxels: f64) -> BrainMask {
    let [left, right] = [-apart_voxels / 2.0, apart_voxels / 2.0];
    let widest = radii_voxels[0].max(radii_voxels[1]);
    let half_size = DVec3::new(apart_voxels / 2.0 + widest, widest, widest).ceil();
    shape(half_size, 1.0, |position| {
        let in_bar = DVec2::new(position.y, position.z).length() <= bar_radius_voxels
            && (left..=right).contains(&position.x);
        let in_ball = |centre: f64, radius| position.distance(DVec3::X * centre) <= radius;
        in_bar || in_ball(left, radii_voxels[0]) || in_ball(right, radii_voxels[1])
    })
}

/// The voxels that satisfy a predicate of the position relative to the central voxel, in voxels.
fn shape(half_size: DVec3, spacing_mm: f64, is_inside: impl Fn(DVec3) -> bool) -> BrainMask {
    let half = half_size.to_array().map(|side| side as usize);
    assert!(
        half.iter().all(|side| *side <= 200),
        "a phantom is at most 401 voxels wide"
    );
    let size = half.map(|side| 2 * side + 1);
    let grid = Grid::aligned(size, [spacing_mm; 3], -half_size * spacing_mm).expect("a small grid");
    let position =
        |index| DVec3::from_array(grid.voxel(index).map(|place| place as f64)) - half_size;
    let voxels = (0..grid.voxel_count())
        .map(|index| is_inside(position(index)))
        .collect();
    let mask = Mask::new(grid.clone(), voxels).expect("one value for each voxel");
    BrainMask::from_mask(&mask, &grid).expect("a shape is not empty")
}

/// A head with two hemispheres, folded gyri, a cortical ribbon and a blurred lesion in the right frontal lobe.
///
/// `spacing_mm` is the edge of a voxel. Axes run along L, P and S.
///
/// # Panics
/// If `spacing_mm` is not within 0.5 to 4.
pub fn head(spacing_mm: f64) -> PhantomHead {
    assert!(
        (0.5..=4.0).contains(&spacing_mm),
        "a phantom head has voxels of 0.5 to 4 mm"
    );
    let size = (HEAD_HALF_EXTENT_MM * 2.0 / spacing_mm)
        .round()
        .to_array()
        .map(|side| side as usize);
    let origin = DVec3::from_array(size.map(|side| (side - 1) as f64 / -2.0 * spacing_mm));
    let grid = Grid::aligned(size, [spacing_mm; 3], origin).expect("a grid within the limits");
    let at = |index: usize| {
        let position = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        let tissue = tissue_at(origin + position * spacing_mm);
        let speckle = f64::from((index as u32).wrapping_mul(2_654_435_761) >> 24) / 255.0 - 0.5;
        let noise = if tissue.intensity > 0.0 {
            speckle * 30.0
        } else {
            0.0
        };
        ((tissue.intensity + noise).max(0.0) as u16, tissue.is_brain)
    };
    let (voxels, brain) = (0..grid.voxel_count()).into_par_iter().map(at).unzip();
    PhantomHead {
        volume: Volume::new(grid.clone(), voxels, UNSCALED).expect("one value for each voxel"),
        brain: Mask::new(grid, brain).expect("one value for each voxel"),
    }
}

struct Tissue {
    intensity: f64,
    is_brain: bool,
}

const WHITE: f64 = 820.0;
const GREY: f64 = 560.0;
const FLUID: f64 = 210.0;

fn tissue_at(patient: DVec3) -> Tissue {
    let tissue = |intensity, is_brain| Tissue {
        intensity,
        is_brain,
    };
    let below_outline = depth_in_ellipsoid(patient, BRAIN_HALF_AXES_MM);
    if below_outline < 0.0 {
        return tissue(shell_intensity(-below_outline), false);
    }
    if is_in_ventricle(patient) {
        return tissue(FLUID, true);
    }
    let to_fluid = below_outline.min(distance_to_sulcus(patient, below_outline));
    if to_fluid < 0.6 {
        return tissue(FLUID, false);
    }
    // Grey changes to white over half a millimetre, and over several in the lesion.
    let into_lesion = 1.0 - patient.distance(LESION_IN_PATIENT) / LESION_RADIUS_MM;
    let blur = 0.5 + 6.0 * into_lesion.max(0.0);
    let white = ((to_fluid - 0.6 - CORTEX_MM) / blur + 0.5).clamp(0.0, 1.0);
    tissue(GREY + (WHITE - GREY) * white, true)
}

/// The intensity around the brain, by the distance from its outline: fluid, skull, scalp, air.
fn shell_intensity(outwards_mm: f64) -> f64 {
    match outwards_mm {
        distance if distance < 2.0 => FLUID,
        distance if distance < 8.0 => 60.0,
        distance if distance < 14.0 => 700.0,
        _ => 0.0,
    }
}

/// The approximate depth of a position inside an ellipsoid, in mm; negative outside.
fn depth_in_ellipsoid(position: DVec3, half_axes: DVec3) -> f64 {
    let scaled = position / half_axes;
    let radius = scaled.length();
    // The first-order distance: the value divided by the length of its gradient.
    let slope = (scaled / half_axes).length() / radius.max(1e-9);
    (1.0 - radius) / slope.max(1e-9)
}

fn is_in_ventricle(patient: DVec3) -> bool {
    let from_centre = DVec3::new(patient.x.abs() - 12.0, patient.y - 5.0, patient.z - 8.0);
    depth_in_ellipsoid(from_centre, DVec3::new(6.0, 30.0, 9.0)) > 0.0
}

/// The approximate distance of a position from the nearest fissure or sulcus, in mm.
///
/// Sulci are sheets perpendicular to the outline: the zeros of a wavy function of the direction. They end
/// [`SULCUS_DEPTH_MM`] below the outline; the fissure between the hemispheres is deeper.
fn distance_to_sulcus(patient: DVec3, below_outline: f64) -> f64 {
    let fissure = patient.x.abs().hypot((below_outline - 34.0).max(0.0));
    let direction = (patient / BRAIN_HALF_AXES_MM).normalize_or_zero() * BRAIN_HALF_AXES_MM;
    let wave = |position: DVec3| {
        let bend = 9.0
            * DVec3::new(
                (position.y / 17.0).sin() + (position.z / 23.0).cos(),
                (position.z / 19.0).sin() + (position.x / 21.0).cos(),
                (position.x / 15.0).sin() + (position.y / 25.0).cos(),
            );
        let bent = position + bend;
        (bent.y / 5.2).sin() + (bent.z / 6.1).sin() + (bent.x / 6.7).sin()
    };
    let step = 0.5;
    let slope = DVec3::new(
        wave(direction + DVec3::X * step) - wave(direction - DVec3::X * step),
        wave(direction + DVec3::Y * step) - wave(direction - DVec3::Y * step),
        wave(direction + DVec3::Z * step) - wave(direction - DVec3::Z * step),
    ) / (2.0 * step);
    let sheet = wave(direction).abs() / slope.length().max(0.02);
    sheet
        .hypot((below_outline - SULCUS_DEPTH_MM).max(0.0))
        .min(fissure)
}
