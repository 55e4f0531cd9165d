//! What is written is read back, here and by another reader.

use geometry::{Grid, Mask, Rescale, Volume};
use glam::{DAffine3, DQuat, DVec3};
use imaging::{ImagingError, Limits, nifti};
use nifti_crate::{InMemNiftiObject, NiftiObject};

/// Grids of either handedness, straight and oblique, and one that is sheared.
fn grids() -> Vec<(Grid, bool)> {
    let offset = DVec3::new(81.25, -97.5, -60.0);
    let grid = |rotation: DQuat, edges: DVec3| {
        let affine = DAffine3::from_scale_rotation_translation(edges, rotation, offset);
        Grid::new([3, 4, 5], affine).unwrap()
    };
    let oblique = DQuat::from_axis_angle(DVec3::new(0.3, 0.2, -1.0).normalize(), 2.5);
    let edges = DVec3::new(0.5, 0.75, 1.25);
    let mut sheared = grid(DQuat::IDENTITY, edges).patient_from_voxel();
    sheared.matrix3.z_axis.x = 0.3;
    vec![
        (grid(DQuat::IDENTITY, edges), true),
        (grid(DQuat::IDENTITY, DVec3::new(-0.5, 0.75, 1.25)), true),
        (grid(DQuat::IDENTITY, DVec3::new(-0.5, -0.75, -1.25)), true),
        (grid(oblique, edges), true),
        (grid(oblique, DVec3::new(0.5, -0.75, 1.25)), true),
        (Grid::new([3, 4, 5], sheared).unwrap(), false),
    ]
}

fn assert_same_positions(actual: &Grid, expected: &Grid) {
    assert_eq!(actual.size(), expected.size());
    for index in 0..expected.voxel_count() {
        let voxel = DVec3::from_array(expected.voxel(index).map(|position| position as f64));
        let [actual, expected] =
            [actual, expected].map(|grid| grid.patient_from_voxel().transform_point3(voxel));
        assert!(actual.distance(expected) < 1e-4, "{actual} for {expected}");
    }
}

/// The file with the code of one of its forms set to 0.
fn without_form(packed: &[u8], at: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut flate2::bufread::GzDecoder::new(packed), &mut bytes).unwrap();
    bytes[at..at + 2].fill(0);
    bytes
}

fn pattern(grid: &Grid) -> Vec<bool> {
    (0..grid.voxel_count()).map(|index| index % 7 < 3).collect()
}

#[test]
fn a_mask_comes_back_in_its_place_by_either_form() {
    const QFORM_CODE: usize = 252;
    const SFORM_CODE: usize = 254;
    for (grid, orthogonal) in grids() {
        let mask = Mask::new(grid.clone(), pattern(&grid)).unwrap();
        let packed = nifti::write_mask(&mask).unwrap();
        let read = |bytes: &[u8]| nifti::read_mask(bytes, &Limits::default());
        let by_sform = read(&without_form(&packed, QFORM_CODE)).unwrap();
        assert_same_positions(by_sform.grid(), &grid);
        assert_eq!(by_sform.voxels(), mask.voxels());
        assert_eq!(read(&packed).unwrap(), by_sform);
        let by_qform = read(&without_form(&packed, SFORM_CODE));
        match by_qform {
            Ok(by_qform) => assert_same_positions(by_qform.grid(), &grid),
            Err(error) => assert_eq!(error, ImagingError::NiftiOrientationUnknown),
        }
        assert_eq!(read(&without_form(&packed, SFORM_CODE)).is_ok(), orthogonal);
    }
}

#[test]
fn a_volume_comes_back_to_the_bit() {
    for (grid, _) in grids() {
        let stored = (0..60).map(|index| index * 1110).collect();
        let rescale = Rescale {
            slope: 0.123,
            intercept: -45.6,
        };
        let volume = Volume::new(grid.clone(), stored, rescale).unwrap();
        let packed = nifti::write_volume(&volume).unwrap();
        let back = nifti::read_volume(&packed, &Limits::default()).unwrap();
        assert_same_positions(back.grid(), &grid);
        assert_eq!(back.voxels(), volume.voxels());
        assert_eq!(back.rescale(), rescale);
        let again = nifti::write_volume(&back).unwrap();
        assert_eq!(nifti::read_volume(&again, &Limits::default()), Ok(back));
    }
}

#[test]
fn another_reader_accepts_what_is_written() {
    for (grid, _) in grids() {
        let mask = Mask::new(grid.clone(), pattern(&grid)).unwrap();
        let file = without_form(&nifti::write_mask(&mask).unwrap(), 250);
        let object = InMemNiftiObject::from_reader(&file[..]).unwrap();
        let header = object.header();
        assert_eq!(header.dim[..4], [3, 3, 4, 5]);
        let spacing: Vec<f64> = header.pixdim[1..4]
            .iter()
            .map(|&edge| edge.into())
            .collect();
        for (theirs, ours) in spacing.iter().zip(grid.spacing_mm()) {
            assert!((theirs - ours).abs() < 1e-6);
        }
        assert_eq!(
            f64::from(header.srow_x[0]),
            f64::from(-grid.patient_from_voxel().matrix3.x_axis.x as f32)
        );
    }
}

#[test]
fn the_same_values_give_the_same_bytes() {
    let (grid, _) = grids().remove(0);
    let mask = Mask::new(grid.clone(), pattern(&grid)).unwrap();
    assert_eq!(nifti::write_mask(&mask), nifti::write_mask(&mask.clone()));
}

#[test]
fn what_nifti_cannot_say_is_refused() {
    let long = Grid::aligned([32768, 1, 1], [1.0; 3], DVec3::ZERO).unwrap();
    let mask = Mask::new(long, vec![true; 32768]).unwrap();
    let expected = ImagingError::SideTooLong { side: 32768 };
    assert_eq!(nifti::write_mask(&mask), Err(expected));
    let (grid, _) = grids().remove(0);
    let rescale = Rescale {
        slope: 0.0,
        intercept: 3.0,
    };
    let volume = Volume::new(grid, vec![0; 60], rescale).unwrap();
    assert_eq!(
        nifti::write_volume(&volume).unwrap_err().kind(),
        "unwritable"
    );
}
