//! Voxels are where the header says, in LPS millimetres, and left is left.

use glam::{DMat3, DQuat, DVec3};
use imaging::nifti::{self, Form};
use imaging::{ImagingError, Limits};

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

fn sizes_of(axes: DMat3) -> [f64; 8] {
    let [x, y, z] = [0, 1, 2].map(|axis| axes.col(axis).length());
    [1.0, x, y, z, 0.0, 0.0, 0.0, 0.0]
}

fn with_sform(version: u8, axes: DMat3, offset: DVec3) -> Nifti {
    let row = |i: usize| [axes.row(i).x, axes.row(i).y, axes.row(i).z, offset[i]];
    Nifti {
        version,
        sform_code: 2,
        srow: [row(0), row(1), row(2)],
        pixdim: sizes_of(axes),
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

/// A header with a qform of 1 mm along the axes, and an sform.
fn with_both(version: u8, sform: DMat3) -> Nifti {
    let mut file = with_sform(version, sform, OFFSET);
    file.qform_code = 1;
    file.pixdim = [1.0; 8];
    file.qoffset = OFFSET.to_array();
    file
}

/// An sform by which lengths or angles are not those of the qform.
fn contradicting() -> Vec<DMat3> {
    let sized = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    let sheared = |amount: f64| DMat3::from_cols(DVec3::X, DVec3::new(amount, 1.0, 0.0), DVec3::Z);
    let template = DMat3::from_cols(
        DVec3::new(1.12, 0.05, 0.0),
        DVec3::new(-0.04, 1.18, 0.1),
        DVec3::new(0.02, -0.1, 1.09),
    );
    vec![
        sized(1.1, 1.1, 1.1),
        sized(0.9, 0.9, 0.9),
        sized(1.04, 0.96, 1.0),
        sized(1.0, 1.0, 1.02),
        sized(2.0, 2.0, 2.0),
        sheared(0.1),
        sheared(0.002),
        sheared(-0.05),
        template,
        DMat3::from_rotation_z(0.2) * sized(1.0, 1.05, 1.0),
    ]
}

#[test]
fn forms_with_other_sizes_or_angles_are_refused_with_both_readings() {
    for version in [1, 2] {
        for axes in contradicting() {
            let error = with_both(version, axes).read().unwrap_err();
            assert_eq!(error.kind(), "nifti-forms-contradict", "{axes}");
            let text = error.to_string();
            assert!(text.contains("1 × 1 × 1 mm with right angles"), "{text}");
            assert!(text.contains("`affine`: `sform` or `qform`"), "{text}");
        }
    }
    let text = with_both(1, contradicting()[0])
        .read()
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("by its sform a voxel measures 1.1 × 1.1 × 1.1 mm,"),
        "{text}"
    );
    let text = with_both(1, contradicting()[5])
        .read()
        .unwrap_err()
        .to_string();
    assert!(text.contains("and its axes lean by 5.7°"), "{text}");
}

#[test]
fn forms_that_differ_by_a_movement_or_by_rounding_are_no_contradiction() {
    let turn = DMat3::from_rotation_x(0.1) * DMat3::from_rotation_z(-0.2);
    let rounded = DMat3::from_cols(DVec3::X, DVec3::new(0.0009, 1.0, 0.0), DVec3::Z * 1.009);
    for axes in [
        DMat3::IDENTITY,
        turn,
        rounded,
        turn * rounded,
        DMat3::from_diagonal(DVec3::splat(0.995)),
    ] {
        assert_at(&with_both(1, axes), lps(axes, OFFSET));
    }
}

#[test]
fn the_form_that_was_asked_for_places_the_voxels() {
    let kept = |file: &Nifti, form| nifti::keeping_form(&file.bytes(), form, &Limits::default());
    let read = |bytes: &[u8]| nifti::read_volume(bytes, &Limits::default()).unwrap();
    for version in [1, 2] {
        for big_endian in [false, true] {
            for axes in contradicting() {
                let mut file = with_both(version, axes);
                file.big_endian = big_endian;
                for (form, expected) in [(Form::Sform, axes), (Form::Qform, DMat3::IDENTITY)] {
                    let bytes = kept(&file, form).unwrap();
                    assert_eq!(bytes, kept(&file, form).unwrap());
                    let volume = read(&bytes);
                    let found = volume.grid().patient_from_voxel();
                    for (voxel, place) in VOXELS.into_iter().zip(lps(expected, OFFSET)) {
                        assert!((found.transform_point3(voxel.into()) - place).length() < 1e-4);
                    }
                    assert_eq!(crate::builder::intensities(&volume)[7], 7.0);
                    let packed = nifti::keeping_form(&file.packed(), form, &Limits::default());
                    assert_eq!(packed.unwrap(), bytes);
                    let mask = nifti::read_mask(&bytes, &Limits::default()).unwrap();
                    assert_eq!(mask.grid(), volume.grid());
                }
            }
        }
    }
    let one = with_sform(1, DMat3::IDENTITY, OFFSET);
    assert_eq!(
        kept(&one, Form::Qform).unwrap_err().kind(),
        "nifti-form-missing"
    );
    let truncated = Nifti {
        data: vec![0; 20],
        ..with_both(1, contradicting()[0])
    };
    assert_eq!(
        kept(&truncated, Form::Qform).unwrap_err().kind(),
        "nifti-truncated"
    );
}

#[test]
fn sizes_that_contradict_a_lone_sform_are_refused_until_it_is_asked_for() {
    let mut file = with_sform(1, DMat3::from_diagonal(DVec3::splat(1.1)), OFFSET);
    file.pixdim = [1.0; 8];
    let text = file.read().unwrap_err().to_string();
    assert!(text.contains("by its pixdim 1 × 1 × 1 mm"), "{text}");
    assert!(nifti::keeping_form(&file.bytes(), Form::Sform, &Limits::default()).is_ok());
    file.pixdim = [0.0; 8];
    assert_at(&file, lps(DMat3::from_diagonal(DVec3::splat(1.1)), OFFSET));
}

#[test]
fn an_unusable_sform_beside_a_qform_says_how_to_use_the_qform() {
    for value in [0.0, f64::NAN, f64::INFINITY] {
        let mut file = with_both(1, DMat3::IDENTITY);
        file.srow = [[value; 4]; 3];
        let error = file.read().unwrap_err();
        assert_eq!(error.kind(), "nifti-affine");
        assert!(
            error.to_string().contains("send `affine` as `qform`"),
            "{error}"
        );
        assert!(nifti::keeping_form(&file.bytes(), Form::Qform, &Limits::default()).is_ok());
    }
}

#[test]
fn a_unit_by_mistake_is_named() {
    for (units, edge, words) in [
        (
            1,
            1.0,
            "an edge of a voxel is 1000 mm, because the NIfTI header states 1 metres",
        ),
        (
            1,
            2.0,
            "an edge of a voxel is 2000 mm, because the NIfTI header states 2 metres",
        ),
        (1, 0.5, "if it is 0.5 mm, set the unit to millimetres"),
        (
            3,
            1.0,
            "an edge of a voxel is 0.001 mm, because the NIfTI header states 1 micrometres",
        ),
        (3, 0.8, "if it is 0.8 mm"),
    ] {
        let mut file = with_sform(1, DMat3::from_diagonal(DVec3::splat(edge)), OFFSET);
        file.units = units;
        let error = file.read().unwrap_err();
        assert_eq!(error.kind(), "nifti-units");
        assert!(error.to_string().contains(words), "{error}");
    }
}
