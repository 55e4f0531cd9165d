//! What belongs to a mask.

use imaging::{ImagingError, Limits, nifti};

use crate::builder::*;

fn read(file: &Nifti) -> Result<Vec<bool>, ImagingError> {
    let mask = nifti::read_mask(&file.packed(), &Limits::default())?;
    assert_eq!(mask, nifti::read_mask(&file.bytes(), &Limits::default())?);
    Ok(mask.voxels().to_vec())
}

fn four_values(datatype: i16, values: [f64; 4]) -> Nifti {
    Nifti::of(datatype, &values.repeat(6), 1, false)
}

#[test]
fn zeros_and_ones_labels_and_skull_stripped_heads_belong_above_zero() {
    for datatype in DATA_TYPES {
        for values in [
            [0.0, 1.0, 0.0, 1.0],
            [0.0, 127.0, 0.0, 1.0],
            [0.0, 2.0, 0.0, 41.0],
        ] {
            let expected = [false, true, false, true].repeat(6);
            assert_eq!(
                read(&four_values(datatype, values)).unwrap(),
                expected,
                "{datatype}"
            );
        }
    }
    let head = four_values(F32, [-0.25, 118.7, 0.0, 0.3]);
    assert_eq!(read(&head).unwrap(), [false, true, false, true].repeat(6));
}

#[test]
fn values_below_zero_do_not_belong() {
    let depths = four_values(F32, [-1.0, 0.0, 4.0, 12.5]);
    assert_eq!(read(&depths).unwrap(), [false, false, true, true].repeat(6));
    let labels = four_values(I16, [-1.0, 0.0, 3.0, 300.0]);
    assert_eq!(read(&labels).unwrap(), [false, false, true, true].repeat(6));
}

#[test]
fn probabilities_belong_above_one_half() {
    let floats = four_values(F32, [0.004, 0.49, 0.51, 1.0]);
    let mut bytes = four_values(U8, [1.0, 125.0, 130.0, 255.0]);
    bytes.slope = 1.0 / 255.0;
    let overshooting = four_values(F64, [-0.08, 0.2, 0.7, 1.09]);
    for file in [floats, bytes, overshooting] {
        assert_eq!(read(&file).unwrap(), [false, false, true, true].repeat(6));
    }
}

#[test]
fn a_slope_that_rounds_changes_no_mask() {
    let mut file = four_values(U8, [0.0, 255.0, 0.0, 255.0]);
    file.slope = 0.003_921_569;
    assert_eq!(read(&file).unwrap(), [false, true, false, true].repeat(6));
}

#[test]
fn what_is_no_number_does_not_belong_to_a_mask() {
    let file = four_values(F32, [0.0, f64::NAN, f64::INFINITY, 1.0]);
    assert_eq!(read(&file).unwrap(), [false, false, false, true].repeat(6));
    let likely = four_values(F32, [f64::NAN, 0.4, 0.6, 1.0]);
    assert_eq!(read(&likely).unwrap(), [false, false, true, true].repeat(6));
}
