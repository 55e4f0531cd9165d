//! The `nifti` crate reads the same numbers from sound NIfTI-1 files.

use nifti_crate::{InMemNiftiObject, NiftiObject, RandomAccessNiftiVolume};

use crate::builder::*;

#[test]
fn another_reader_finds_the_same_intensities_and_affine() {
    for datatype in DATA_TYPES {
        for big_endian in [false, true] {
            let values: Vec<f64> = (0..24).map(|i| f64::from(i * i) / 6.0).collect();
            let mut file = Nifti::of(datatype, &values, 1, big_endian);
            (file.slope, file.intercept) = (1.5, -20.0);
            // It states nothing about sizes.
            file.pixdim = [0.0; 8];
            file.srow = [
                [-0.9, 0.1, 0.0, 80.0],
                [0.1, 0.8, 0.2, -120.5],
                [0.0, -0.3, 1.2, -60.0],
            ];
            compare(&file);
        }
    }
}

fn compare(file: &Nifti) {
    let ours = file.read().unwrap();
    let theirs = InMemNiftiObject::from_reader(&file.bytes()[..]).unwrap();
    let intensities = intensities(&ours);
    for (index, intensity) in intensities.iter().enumerate() {
        let [x, y, z] = ours.grid().voxel(index).map(|position| position as u16);
        let theirs = theirs.volume().get_f64(&[x, y, z]).unwrap();
        let tolerance = f64::from(ours.rescale().slope) / 2.0 + 1e-4;
        assert!(
            (intensity - theirs).abs() <= tolerance,
            "{intensity}, {theirs}"
        );
    }
    let header = theirs.header();
    let affine = ours.grid().patient_from_voxel();
    let rows = [header.srow_x, header.srow_y, header.srow_z];
    for (row, (theirs, sign)) in rows.iter().zip([-1.0, -1.0, 1.0]).enumerate() {
        let [x, y, z] = affine.matrix3.row(row).to_array();
        let ours = [x, y, z, affine.translation[row]].map(|entry| (sign * entry) as f32);
        assert_eq!(ours, *theirs);
    }
}
