//! A small made-up head: an ellipsoid of brain with a lump over zeros, and with a bright mark at the patient's right.

use glam::{Affine3A, Mat3, Quat, Vec3};

use crate::nifti::{Data, Nifti};

/// Half axes of the brain, in mm: right to left, back to front, bottom to top.
const HALF_AXES_MM: Vec3 = Vec3::new(60.0, 76.0, 54.0);

/// A lump at the right, front and top, RAS mm: no mirror image of the head is the head.
const LUMP_MM: Vec3 = Vec3::new(38.0, 45.0, 25.0);
const LUMP_RADIUS_MM: f32 = 26.0;

/// Edge of a voxel.
pub(crate) const SPACING_MM: f32 = 4.0;

/// Voxels along each axis: enough for the brain and some background in every orientation.
const SIDE: i16 = 45;

/// How an acquisition lies in the patient.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Orientation {
    pub(crate) name: &'static str,
    /// Voxel axes to RAS directions.
    axes: Mat3,
}

/// The orientations of the acceptance: three along the axes, and an oblique one.
pub(crate) fn orientations() -> [Orientation; 4] {
    let mirrored = |x: f32, y: f32, z: f32| Mat3::from_diagonal(Vec3::new(x, y, z));
    let turn = Quat::from_axis_angle(Vec3::new(1.0, -2.0, 0.5).normalize(), 0.3);
    [
        ("RAS", mirrored(1.0, 1.0, 1.0)),
        ("LAS", mirrored(-1.0, 1.0, 1.0)),
        ("LPS", mirrored(-1.0, -1.0, 1.0)),
        ("oblique", Mat3::from_quat(turn)),
    ]
    .map(|(name, axes)| Orientation { name, axes })
}

/// The intensity at a place of the patient, RAS mm.
///
/// Grey with a slow pattern, so that no two places look the same, and a bright cap at the right.
fn intensity(ras: Vec3) -> i16 {
    let in_lump = (ras - LUMP_MM).length() <= LUMP_RADIUS_MM;
    if (ras / HALF_AXES_MM).length() > 1.0 && !in_lump {
        return 0;
    }
    if ras.x > 0.7 * HALF_AXES_MM.x {
        return 1000;
    }
    (300.0 + 60.0 * (ras.y / 15.0).sin() + 40.0 * (ras.z / 11.0).cos()) as i16
}

/// The head as an acquisition of the given orientation.
pub(crate) fn head(orientation: Orientation) -> Nifti {
    let middle = Vec3::splat(f32::from(SIDE - 1) / 2.0);
    let axes = orientation.axes * SPACING_MM;
    let ras_from_voxel = Affine3A::from_mat3_translation(axes, -(axes * middle));
    let mut voxels = Vec::new();
    for z in 0..SIDE {
        for y in 0..SIDE {
            for x in 0..SIDE {
                let voxel = Vec3::new(f32::from(x), f32::from(y), f32::from(z));
                voxels.push(intensity(ras_from_voxel.transform_point3(voxel)));
            }
        }
    }
    let row = |row: usize| {
        [0, 1, 2, 3].map(|column| match column {
            3 => ras_from_voxel.translation[row],
            axis => axes.col(axis)[row],
        })
    };
    Nifti {
        size: [SIDE; 3],
        ras_from_voxel: [row(0), row(1), row(2)],
        slope: 1.0,
        data: Data::I16(voxels),
    }
}

/// The head that most tests use.
pub(crate) fn plain_head() -> Nifti {
    head(orientations()[0])
}

/// A mask of a head: the voxels of the brain.
pub(crate) fn mask_of(head: &Nifti) -> Nifti {
    let Data::I16(voxels) = &head.data else {
        panic!("heads are made of i16");
    };
    Nifti {
        data: Data::U8(voxels.iter().map(|&value| u8::from(value > 0)).collect()),
        ..head.clone()
    }
}
