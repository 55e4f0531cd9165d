//! Voxels are where the header says, in LPS millimetres, and left is left.

use glam::{DMat3, DQuat, DVec3};
use imaging::ImagingError;

use crate::builder::Nifti;

/// The corners of the image and its middle, in the order that [`positions`] gives.
const VOXELS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 3.0], [0.5, 1.0, 1.5]];

fn positions(file: &Nifti) -> [DVec3; 4] {
    let volume = file.read().unwrap();
    let patient_from_voxel = volume.grid().patient_from_voxel();
    VOXELS.map(|voxel| patient_from_voxel.transform_point3(voxel.into()))
}

fn assert_at(file: &Nifti, expected: [DVec3; 4]) {
    for (actual, expected) in positions(file).into_iter().zip(expected) {
        assert!(actual.distance(expected) < 1e-5, "{actual} for {expected}");
    }
}

/// Where a RAS affine puts [`VOXELS`], in LPS.
fn lps(axes: DMat3, offset: DVec3) -> [DVec3; 4] {
    VOXELS.map(|voxel| (axes * DVec3::from(voxel) + offset) * DVec3::new(-1.0, -1.0, 1.0))
}

fn with_sform(version: u8, axes: DMat3, offset: DVec3) -> Nifti {
    let row = |i: usize| [axes.row(i).x, axes.row(i).y, axes.row(i).z, offset[i]];
    Nifti {
        version,
        sform_code: 2,
        srow: [row(0), row(1), row(2)],
        ..Nifti::default()
    }
}

fn with_qform(version: u8, rotation: DQuat, qfac: f64, edges: [f64; 3], offset: DVec3) -> Nifti {
    let rotation = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    let [x, y, z] = edges;
    Nifti {
        version,
        sform_code: 0,
        qform_code: 1,
        pixdim: [qfac, x, y, z, 0.0, 0.0, 0.0, 0.0],
        quaternion: rotation.xyz().to_array(),
        qoffset: offset.to_array(),
        ..Nifti::default()
    }
}

const EDGES: [f64; 3] = [0.5, 0.75, 1.25];
const OFFSET: DVec3 = DVec3::new(-90.0, 126.0, -72.0);

/// Rotation, handedness and the axes that they make, for RAS, LAS, LPS and an oblique grid of either handedness.
fn orientations() -> Vec<(DQuat, f64, DMat3)> {
    let about = |axis: DVec3, angle| DQuat::from_axis_angle(axis.normalize(), angle);
    let oblique = about(DVec3::new(1.0, -2.0, 0.5), 0.4);
    let half_turn = std::f64::consts::PI;
    let columns = |x: f64, y: f64, z: f64| DMat3::from_diagonal(DVec3::new(x, y, z));
    let [x, y, z] = EDGES;
    let oblique_axes = |qfac: f64| DMat3::from_quat(oblique) * columns(x, y, qfac * z);
    vec![
        (DQuat::IDENTITY, 1.0, columns(x, y, z)),
        (about(DVec3::Y, half_turn), -1.0, columns(-x, y, z)),
        (about(DVec3::Z, half_turn), 1.0, columns(-x, -y, z)),
        (oblique, 1.0, oblique_axes(1.0)),
        (oblique, -1.0, oblique_axes(-1.0)),
    ]
}

#[test]
fn the_sform_places_voxels() {
    for version in [1, 2] {
        for (_, _, axes) in orientations() {
            assert_at(&with_sform(version, axes, OFFSET), lps(axes, OFFSET));
        }
    }
}

#[test]
fn the_qform_places_the_same_voxels_in_the_same_places() {
    for version in [1, 2] {
        for (rotation, qfac, axes) in orientations() {
            let file = with_qform(version, rotation, qfac, EDGES, OFFSET);
            assert_at(&file, lps(axes, OFFSET));
        }
    }
}

#[test]
fn the_worked_half_turn_about_y_swaps_right_and_up() {
    // b, c, d = 0, 1, 0: i runs to the left, k downwards, and qfac = -1 turns k upwards again.
    let file = with_qform(
        1,
        DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0),
        -1.0,
        [2.0; 3],
        DVec3::ZERO,
    );
    let left_of_the_patient = positions(&file)[1];
    assert!(left_of_the_patient.distance(DVec3::new(2.0, 0.0, 0.0)) < 1e-9);
    let back_and_up = positions(&file)[2];
    assert!(back_and_up.distance(DVec3::new(0.0, -4.0, 6.0)) < 1e-9);
}

#[test]
fn a_qfac_of_zero_counts_as_one() {
    let file = |qfac| with_qform(1, DQuat::IDENTITY, qfac, EDGES, OFFSET);
    assert_eq!(positions(&file(0.0)), positions(&file(1.0)));
}

#[test]
fn the_sform_is_preferred_to_a_qform() {
    let axes = DMat3::from_diagonal(EDGES.into());
    let mut file = with_sform(1, axes, OFFSET);
    file.qform_code = 1;
    file.quaternion = DQuat::from_rotation_z(0.2).xyz().to_array();
    assert_at(&file, lps(axes, OFFSET));
}

#[test]
fn a_broken_qform_beside_a_sound_sform_is_ignored() {
    let axes = DMat3::from_diagonal(EDGES.into());
    let mut file = with_sform(1, axes, OFFSET);
    file.qform_code = 1;
    file.quaternion = [3.0, 0.0, 0.0];
    assert_at(&file, lps(axes, OFFSET));
}

#[test]
fn forms_that_put_left_on_opposite_sides_are_refused() {
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let turned = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let mirrored_front_to_back = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    for axes in [mirrored, turned, mirrored_front_to_back] {
        let mut file = with_sform(1, axes, OFFSET);
        file.qform_code = 1;
        assert_eq!(file.read(), Err(ImagingError::NiftiLeftRight));
    }
}

#[test]
fn a_file_without_forms_is_refused_because_left_is_unknown() {
    let file = Nifti {
        sform_code: 0,
        ..Nifti::default()
    };
    assert_eq!(file.read(), Err(ImagingError::NiftiOrientationUnknown));
}

#[test]
fn metres_and_micrometres_become_millimetres() {
    for version in [1, 2] {
        let in_units = |units: u8, factor: f64| {
            let axes = DMat3::from_diagonal(DVec3::from(EDGES) * factor);
            let mut file = with_sform(version, axes, OFFSET * factor);
            file.units = units | 8;
            file
        };
        let expected = lps(DMat3::from_diagonal(EDGES.into()), OFFSET);
        assert_at(&in_units(0, 1.0), expected);
        assert_at(&in_units(1, 0.001), expected);
        assert_at(&in_units(2, 1.0), expected);
        assert_at(&in_units(3, 1000.0), expected);
        let unknown = in_units(5, 1.0).read();
        assert_eq!(unknown, Err(ImagingError::NiftiUnits { code: 5 }));
    }
}
