//! MGH files: what they say is read as what a NIfTI file says, and it is known where they state no axes.

use glam::{DMat3, DVec3};
use imaging::nifti::{self, Form};
use imaging::{Format, ImagingError, Limits, sniff};

use crate::builder::pack;

/// 2×3×4 voxels, 0 to 23, of the type `int`; the default is oblique, and sound.
#[derive(Clone)]
struct Mgh {
    sides: [i32; 4],
    code: i32,
    good_ras: i16,
    edges: DVec3,
    axes: DMat3,
    middle: DVec3,
    voxels: Vec<u8>,
    footer: Vec<u8>,
}

impl Default for Mgh {
    fn default() -> Self {
        Self {
            sides: [2, 3, 4, 1],
            code: 1,
            good_ras: 1,
            edges: DVec3::new(0.5, 1.0, 2.0),
            // Of a conformed volume, turned about the axis from foot to head.
            axes: DMat3::from_rotation_z(0.25) * DMat3::from_cols(-DVec3::X, -DVec3::Z, DVec3::Y),
            middle: DVec3::new(3.0, -20.0, 7.0),
            voxels: (0..24i32).flat_map(i32::to_be_bytes).collect(),
            footer: [&[0; 20][..], b"the names of the labels"].concat(),
        }
    }
}

impl Mgh {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = 1i32.to_be_bytes().to_vec();
        for number in self.sides.into_iter().chain([self.code, 0]) {
            bytes.extend(number.to_be_bytes());
        }
        bytes.extend(self.good_ras.to_be_bytes());
        let axes = self.axes.to_cols_array();
        for number in [&self.edges.to_array()[..], &axes, &self.middle.to_array()].concat() {
            bytes.extend((number as f32).to_be_bytes());
        }
        bytes.resize(284, 0);
        [&bytes, &self.voxels[..], &self.footer].concat()
    }

    fn refused(&self) -> ImagingError {
        nifti::read_volume(&self.bytes(), &Limits::default()).unwrap_err()
    }
}

#[test]
fn voxels_lie_where_the_header_says_and_left_is_left() {
    let file = Mgh::default();
    for bytes in [file.bytes(), pack(&file.bytes())] {
        let volume = nifti::read_volume(&bytes, &Limits::default()).unwrap();
        assert_eq!(volume.grid().size(), [2, 3, 4]);
        // Half the sides from the first voxel on, in RAS, lies the point that the header states (in LPS here).
        let at = |voxel: DVec3| volume.grid().patient_from_voxel().transform_point3(voxel);
        let lps = DVec3::new(-1.0, -1.0, 1.0);
        assert!(at(DVec3::new(1.0, 1.5, 2.0)).distance(file.middle * lps) < 1e-5);
        for (axis, direction) in DVec3::AXES.into_iter().enumerate() {
            let step = at(direction) - at(DVec3::ZERO);
            let stated = file.axes.col(axis) * file.edges[axis] * lps;
            assert!(step.distance(stated) < 1e-6, "{step} for {stated}");
        }
        // The first axis points to the left.
        assert!(at(DVec3::X).x > at(DVec3::ZERO).x);
        let expected: Vec<u16> = (0..24).collect();
        assert_eq!(volume.voxels(), expected);
        assert_eq!(
            nifti::read_grid(&bytes[..290.min(bytes.len())], &Limits::default()).unwrap(),
            *volume.grid()
        );
    }
}

#[test]
fn each_type_of_voxels_is_read_as_its_numbers() {
    let numbers = 0..24u8;
    let types: [(i32, Vec<u8>); 5] = [
        (0, numbers.clone().collect()),
        (
            1,
            numbers
                .clone()
                .flat_map(|n| i32::from(n).to_be_bytes())
                .collect(),
        ),
        (
            3,
            numbers
                .clone()
                .flat_map(|n| f32::from(n).to_be_bytes())
                .collect(),
        ),
        (
            4,
            numbers
                .clone()
                .flat_map(|n| i16::from(n).to_be_bytes())
                .collect(),
        ),
        (
            10,
            numbers
                .clone()
                .flat_map(|n| u16::from(n).to_be_bytes())
                .collect(),
        ),
    ];
    for (code, voxels) in types {
        let bytes = Mgh {
            code,
            voxels,
            ..Mgh::default()
        }
        .bytes();
        assert_eq!(sniff(&bytes), Format::Nifti);
        assert_eq!(sniff(&pack(&bytes)), Format::NiftiGz);
        let volume = nifti::read_volume(&bytes, &Limits::default()).unwrap();
        let stored = volume.voxels().iter();
        let intensities: Vec<f32> = stored
            .map(|&stored| volume.intensity(stored.into()))
            .collect();
        let expected: Vec<f32> = numbers.clone().map(f32::from).collect();
        assert_eq!(intensities, expected, "type {code}");
    }
}

#[test]
fn its_sform_can_be_kept_and_it_has_no_qform() {
    let bytes = Mgh::default().bytes();
    let limits = Limits::default();
    let kept = nifti::keeping_form(&bytes, Form::Sform, &limits).unwrap();
    assert_eq!(
        nifti::read_volume(&kept, &limits).unwrap(),
        nifti::read_volume(&bytes, &limits).unwrap()
    );
    assert!(matches!(
        nifti::keeping_form(&bytes, Form::Qform, &limits),
        Err(ImagingError::NiftiFormMissing { .. })
    ));
}

#[test]
fn axes_that_are_not_stated_are_those_that_freesurfer_assumes() {
    let limits = Limits::default();
    let stated = Mgh::default().bytes();
    assert!(!nifti::are_axes_assumed(&stated, &limits).unwrap());
    let bytes = Mgh {
        good_ras: 0,
        axes: DMat3::ZERO,
        ..Mgh::default()
    }
    .bytes();
    for bytes in [bytes.clone(), pack(&bytes)] {
        assert!(nifti::are_axes_assumed(&bytes, &limits).unwrap());
        assert!(!nifti::is_in_scanner_space(&bytes, &limits).unwrap());
        let grid = nifti::read_grid(&bytes, &limits).unwrap();
        let at = |voxel: DVec3| grid.patient_from_voxel().transform_point3(voxel);
        assert_eq!(at(DVec3::new(1.0, 1.5, 2.0)), DVec3::ZERO);
        // LPS: to the left, down, and to the front, in steps of 1 mm.
        let steps = DVec3::AXES.map(|axis| at(axis) - at(DVec3::ZERO));
        assert_eq!(steps, [DVec3::X, -DVec3::Z, -DVec3::Y]);
        assert!(matches!(
            nifti::keeping_form(&bytes, Form::Sform, &limits),
            Err(ImagingError::NiftiFormMissing { .. })
        ));
    }
}

#[test]
fn what_contradicts_itself_is_refused() {
    let sound = Mgh::default;
    for code in [2, 5, 6, -1] {
        assert_eq!(
            Mgh { code, ..sound() }.refused(),
            ImagingError::MghDataType { code }
        );
    }
    let several = Mgh {
        sides: [2, 3, 4, 3],
        ..sound()
    }
    .refused();
    assert_eq!(several, ImagingError::NiftiSeveralVolumes { count: 3 });
    for sides in [[0, 3, 4, 1], [2, -3, 4, 1], [2, 3, 4, -1]] {
        let refused = Mgh { sides, ..sound() }.refused();
        assert!(
            matches!(refused, ImagingError::NiftiDimension { .. }),
            "{refused}"
        );
    }
    assert!(matches!(
        Mgh {
            sides: [i32::MAX; 4],
            ..sound()
        }
        .refused(),
        ImagingError::NiftiSeveralVolumes { .. } | ImagingError::TooManyVoxels { .. }
    ));
    let nan = Mgh {
        middle: DVec3::NAN,
        ..sound()
    }
    .refused();
    assert!(matches!(nan, ImagingError::NiftiAffine { .. }), "{nan}");
    let flat = Mgh {
        axes: DMat3::ZERO,
        ..sound()
    }
    .refused();
    assert!(
        matches!(
            flat,
            ImagingError::NiftiAffine { .. } | ImagingError::NiftiFormsContradict { .. }
        ),
        "{flat}"
    );
    let long = Mgh {
        axes: 1.5 * sound().axes,
        ..sound()
    }
    .refused();
    assert!(
        matches!(long, ImagingError::NiftiFormsContradict { .. }),
        "{long}"
    );
    let whole = sound().bytes();
    for length in [4, 100, 283, 284, 300] {
        let cut = nifti::read_volume(&whole[..length], &Limits::default()).unwrap_err();
        assert!(matches!(cut, ImagingError::NiftiTruncated { .. }), "{cut}");
    }
}
