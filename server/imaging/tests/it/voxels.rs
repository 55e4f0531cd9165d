//! Values of every type become the right intensities.

use geometry::Rescale;
use imaging::{Limits, nifti};

use crate::builder::*;

/// 24 values that every type can hold, and some that only signed ones can.
fn values_of(datatype: i16) -> Vec<f64> {
    let signed = ![U8, U16, U32, U64].contains(&datatype);
    let least = if signed { -100.0 } else { 0.0 };
    (0..24).map(|i| least + f64::from(i * 9)).collect()
}

fn assert_near(actual: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    for (actual, expected) in actual.iter().zip(expected) {
        assert!(
            (actual - expected).abs() <= tolerance,
            "{actual} for {expected}"
        );
    }
}

#[test]
fn every_type_in_either_byte_order_and_version_is_read_exactly() {
    for datatype in DATA_TYPES {
        for (version, big_endian) in [(1, false), (1, true), (2, false), (2, true)] {
            let values = values_of(datatype);
            let file = Nifti::of(datatype, &values, version, big_endian);
            let plain = file.read().unwrap();
            assert_eq!(plain.grid().size(), [2, 3, 4]);
            assert_eq!(
                intensities(&plain),
                values,
                "{datatype} {version} {big_endian}"
            );
            let packed = nifti::read_volume(&file.packed(), &Limits::default()).unwrap();
            assert_eq!(packed, plain);
        }
    }
}

#[test]
fn sixteen_bits_are_kept_to_the_last_value() {
    for (datatype, ends) in [(I16, [-32768.0, 32767.0]), (U16, [0.0, 65535.0])] {
        let values = [ends, ends, ends].concat().repeat(4);
        let volume = Nifti::of(datatype, &values, 1, true).read().unwrap();
        assert_eq!(intensities(&volume), values);
        assert_eq!(volume.voxels()[..2], [0, 65535]);
    }
}

#[test]
fn wide_integers_far_from_zero_are_exact_while_their_range_fits() {
    let values = |base: f64| {
        (0..24)
            .map(|i| base + f64::from(i * 2849))
            .collect::<Vec<_>>()
    };
    for (datatype, base) in [(U32, 4e9), (I32, -2e9), (F32, -9e4), (F64, 70_001.0)] {
        let values = values(base);
        let volume = Nifti::of(datatype, &values, 1, false).read().unwrap();
        let steps: Vec<u16> = (0..24).map(|i| i * 2849).collect();
        assert_eq!(volume.voxels(), steps, "type {datatype}");
        assert_eq!(volume.rescale().slope, 1.0);
        assert_near(&intensities(&volume), &values, base.abs() * 1e-7);
    }
}

#[test]
fn sixty_four_bit_integers_that_no_double_tells_apart_are_told_apart() {
    let values: Vec<i64> = (0..24).map(|i| i64::MAX - i * 2849).collect();
    let mut file = Nifti::of(I64, &[], 1, false);
    file.data = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let expected: Vec<u16> = (0..24).rev().map(|i| i * 2849).collect();
    assert_eq!(file.read().unwrap().voxels(), expected);

    let ends = [i64::MIN, i64::MAX].repeat(12);
    file.data = ends.iter().flat_map(|value| value.to_le_bytes()).collect();
    let quantised = file.read().unwrap();
    assert!(quantised.voxels()[0] <= 1 && quantised.voxels()[1] >= 65534);
}

#[test]
fn other_ranges_are_quantised_within_half_a_step_and_zero_stays_zero() {
    let wide: Vec<f64> = (0..24).map(|i| (f64::from(i) - 7.0) * 1e5).collect();
    let fine: Vec<f64> = (0..24).map(|i| (f64::from(i) - 5.0) / 7.0).collect();
    let positive: Vec<f64> = (0..24).map(|i| f64::from(i) / 7.0).collect();
    let far: Vec<f64> = (0..24).map(|i| 10.0 + f64::from(i) / 7.0).collect();
    let cases = [
        (I32, &wide),
        (I64, &wide),
        (F32, &wide),
        (F64, &fine),
        (F32, &positive),
        (F64, &far),
    ];
    for (datatype, values) in cases {
        let range = values[23] - values[0];
        let volume = Nifti::of(datatype, values, 2, true).read().unwrap();
        let rounding = values[23].abs().max(values[0].abs()) * 2e-7;
        assert_near(&intensities(&volume), values, range / 131_068.0 + rounding);
        for (value, intensity) in values.iter().zip(intensities(&volume)) {
            assert_eq!(*value == 0.0, intensity == 0.0, "type {datatype}");
        }
    }
}

#[test]
fn a_constant_volume_is_that_constant() {
    for (datatype, constant) in [(U8, 7.0), (I16, -3.0), (F32, 0.25), (F64, -1e7)] {
        let volume = Nifti::of(datatype, &[constant; 24], 1, false)
            .read()
            .unwrap();
        assert_eq!(intensities(&volume), [constant; 24]);
    }
}

#[test]
fn intensities_are_scaled_by_slope_and_intercept() {
    for (datatype, slope, intercept) in [(U8, 0.5, 10.0), (I16, 2.0, -1.0), (F32, 0.25, 3.0)] {
        for version in [1, 2] {
            let values = values_of(datatype);
            let mut file = Nifti::of(datatype, &values, version, false);
            (file.slope, file.intercept) = (slope, intercept);
            let scaled: Vec<f64> = values.iter().map(|v| slope * v + intercept).collect();
            assert_near(&intensities(&file.read().unwrap()), &scaled, 1e-4);
        }
    }
}

#[test]
fn a_negative_slope_turns_the_stored_values_round() {
    let mut file = Nifti::of(I16, &values_of(I16), 1, false);
    file.slope = -0.5;
    let volume = file.read().unwrap();
    let scaled: Vec<f64> = values_of(I16).iter().map(|v| -0.5 * v).collect();
    assert_eq!(intensities(&volume), scaled);
    assert!(volume.rescale().slope > 0.0);
    assert!(volume.voxels()[0] > volume.voxels()[1]);
}

#[test]
fn a_slope_of_zero_or_not_a_number_means_unscaled() {
    for slope in [0.0, f64::NAN] {
        let file = Nifti {
            slope,
            intercept: 5.0,
            ..Nifti::default()
        };
        let unscaled = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        assert_eq!(file.read().unwrap().rescale(), unscaled);
    }
}

#[test]
fn zero_stays_zero_whatever_the_slope() {
    for (datatype, slope) in [
        (I16, 0.1),
        (F64, 0.3),
        (I8, 1.0 / 3.0),
        (I16, -0.7),
        (F32, -1.1),
    ] {
        let mut values = values_of(datatype);
        values[5] = 0.0;
        values[6] = 0.37;
        let mut file = Nifti::of(datatype, &values, 2, false);
        file.slope = slope;
        assert_eq!(
            intensities(&file.read().unwrap())[5],
            0.0,
            "type {datatype}"
        );
    }
}

#[test]
fn one_volume_of_four_dimensions_is_a_volume() {
    let file = Nifti {
        dim: [4, 2, 3, 4, 1, 0, 0, 0],
        ..Nifti::default()
    };
    assert_eq!(file.read().unwrap(), Nifti::default().read().unwrap());
}

#[test]
fn extensions_before_the_voxels_are_skipped() {
    for version in [1, 2] {
        let mut file = Nifti::of(U8, &values_of(U8), version, false);
        let expected = file.read().unwrap();
        let length = 700_000;
        file.vox_offset = Some(f64::from(length));
        let mut data = vec![0xff; length as usize - if version == 1 { 352 } else { 544 }];
        data.append(&mut file.data);
        file.data = data;
        assert_eq!(file.read().unwrap(), expected);
        assert_eq!(
            nifti::read_volume(&file.packed(), &Limits::default()).unwrap(),
            expected
        );
    }
}

#[test]
fn gzip_in_several_members_is_one_file() {
    let file = Nifti::default();
    let bytes = file.bytes();
    let members = [&bytes[..2], &bytes[2..351], &bytes[351..360], &bytes[360..]];
    let packed: Vec<u8> = members.iter().flat_map(|member| pack(member)).collect();
    let volume = nifti::read_volume(&packed, &Limits::default()).unwrap();
    assert_eq!(volume, file.read().unwrap());
}

/// A head of 40 × 20 × 10 voxels from 0.5 to 2.5, with odd values at its corner.
fn with_odd(datatype: i16, scale: f64, odd: &[f64]) -> Nifti {
    let mut values: Vec<f64> = (0..8000)
        .map(|at| scale * (0.5 + f64::from(at % 997) / 498.5))
        .collect();
    values[..odd.len()].copy_from_slice(odd);
    Nifti {
        dim: [3, 40, 20, 10, 1, 1, 1, 1],
        ..Nifti::of(datatype, &values, 1, false)
    }
}

fn levels(volume: &geometry::Volume) -> usize {
    let all: std::collections::BTreeSet<u16> = volume.voxels().iter().copied().collect();
    all.len()
}

#[test]
fn odd_voxels_do_not_take_the_levels_of_all_others() {
    for (datatype, scale, odd) in [
        (F32, 1.0, vec![5e3]),
        (F32, 1.0, vec![5e4, -5e4]),
        (F64, 1.0, vec![1e9]),
        (F32, 1e-3, vec![10.0, 20.0, 30.0]),
        (I32, 1000.0, vec![2e9]),
        (I32, 1000.0, vec![-2e9, 2e9]),
    ] {
        let file = with_odd(datatype, scale, &odd);
        let (volume, replaced) = nifti::read_counted(&file.bytes(), &Limits::default()).unwrap();
        assert_eq!(replaced.clipped, odd.len() as u64, "{datatype} {odd:?}");
        assert!(levels(&volume) > 190, "{} levels", levels(&volume));
        let all = intensities(&volume);
        for (at, found) in all.iter().enumerate().skip(odd.len()) {
            let expected = scale * (0.5 + (at % 997) as f64 / 498.5);
            let expected = if datatype == I32 {
                expected.trunc()
            } else {
                expected
            };
            assert!(
                (found - expected).abs() < 0.005 * 1.5 * scale,
                "{found} for {expected}"
            );
        }
    }
}

#[test]
fn values_that_leave_fine_steps_keep_their_range() {
    for (datatype, odd) in [(F32, vec![]), (F32, vec![100.0]), (F64, vec![-20.0, 200.0])] {
        let file = with_odd(datatype, 1.0, &odd);
        let (volume, replaced) = nifti::read_counted(&file.bytes(), &Limits::default()).unwrap();
        assert_eq!(replaced.clipped, 0);
        let greatest = odd.iter().copied().fold(2.498, f64::max);
        assert!((f64::from(volume.intensity_range()[1]) - greatest).abs() < 0.01);
    }
    // Whole numbers within 16 bits are exact, whatever lies between.
    let file = with_odd(I32, 2.0, &[60_000.0]);
    let (volume, replaced) = nifti::read_counted(&file.bytes(), &Limits::default()).unwrap();
    assert_eq!(
        (replaced.clipped, volume.intensity_range()[1]),
        (0, 60_000.0)
    );
}
