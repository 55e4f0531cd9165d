//! Every fault has its error.

use flate2::Compression;
use imaging::{Format, ImagingError, Limits, nifti, sniff};

use crate::builder::*;

fn kind_of(bytes: &[u8]) -> &'static str {
    match nifti::read_volume(bytes, &Limits::default()) {
        Ok(_) => "sound",
        Err(error) => error.kind(),
    }
}

/// The same fault is found in either version, packed or not, and when the file is read as a mask.
fn assert_kind(file: &Nifti, kind: &str) {
    for version in [1, 2] {
        let file = Nifti {
            version,
            ..file.clone()
        };
        assert_eq!(kind_of(&file.bytes()), kind, "{file:?}");
        assert_eq!(kind_of(&file.packed()), kind, "{file:?}");
        let mask = nifti::read_mask(&file.bytes(), &Limits::default());
        assert_eq!(
            mask.map_or_else(|error| error.kind(), |_| "sound"),
            kind,
            "{file:?}"
        );
    }
}

#[test]
fn the_default_file_is_sound() {
    assert_kind(&Nifti::default(), "sound");
}

#[test]
fn dimensions_that_are_none_are_refused() {
    let dims = |dim: [i64; 8]| Nifti {
        dim,
        ..Nifti::default()
    };
    assert_kind(&dims([3, 0, 3, 4, 1, 1, 1, 1]), "nifti-dimension");
    assert_kind(&dims([3, 2, -3, 4, 1, 1, 1, 1]), "nifti-dimension");
    assert_kind(&dims([4, 2, 3, 4, -1, 1, 1, 1]), "nifti-dimension");
    // An axis that was counted and not filled.
    assert_kind(&dims([4, 2, 3, 4, 0, 1, 1, 1]), "sound");
    assert_kind(&dims([7, 2, 3, 4, 0, 0, 0, 0]), "sound");
    assert_kind(&dims([0, 2, 3, 4, 1, 1, 1, 1]), "nifti-dimension");
    assert_kind(&dims([8, 2, 3, 4, 1, 1, 1, 1]), "nifti-dimension");
    assert_kind(&dims([-1, 2, 3, 4, 1, 1, 1, 1]), "nifti-dimension");
    assert_kind(&dims([2, 2, 12, 1, 1, 1, 1, 1]), "nifti-not-a-volume");
    assert_kind(&dims([3, 2, 12, 1, 1, 1, 1, 1]), "nifti-not-a-volume");
    assert_kind(&dims([4, 2, 3, 2, 2, 1, 1, 1]), "nifti-several-volumes");
    assert_kind(&dims([5, 2, 2, 2, 1, 3, 1, 1]), "nifti-several-volumes");
}

#[test]
fn data_types_that_are_not_read_are_named() {
    for (datatype, name) in [
        (1, "binary"),
        (32, "complex64"),
        (128, "RGB24"),
        (1536, "float128"),
        (1792, "complex128"),
        (2048, "complex256"),
        (2304, "RGBA32"),
        (0, "unknown"),
        (7777, "unknown"),
    ] {
        let file = Nifti {
            datatype,
            ..Nifti::default()
        };
        assert_kind(&file, "nifti-data-type");
        assert!(file.read().unwrap_err().to_string().contains(name));
    }
}

#[test]
fn a_bitpix_that_is_not_the_types_is_refused() {
    for datatype in DATA_TYPES {
        for bitpix in [-8, 0, 1, 24, 128] {
            let file = Nifti {
                datatype,
                bitpix: Some(bitpix),
                ..Nifti::default()
            };
            assert_kind(&file, "nifti-bitpix");
        }
    }
}

#[test]
fn a_vox_offset_into_the_header_or_beyond_reason_is_refused() {
    for offset in [-1.0, 348.0, 351.0, 1e18] {
        let file = Nifti {
            vox_offset: Some(offset),
            ..Nifti::default()
        };
        assert_kind(&file, "nifti-vox-offset");
    }
    for offset in [352.5, f64::NAN, f64::INFINITY] {
        let file = Nifti {
            vox_offset: Some(offset),
            ..Nifti::default()
        };
        assert_eq!(file.read().unwrap_err().kind(), "nifti-vox-offset");
    }
}

#[test]
fn affines_that_are_none_are_refused() {
    let sform = |row: usize, column: usize, value: f64| {
        let mut file = Nifti::default();
        file.srow[row][column] = value;
        file
    };
    assert_kind(&sform(0, 0, f64::NAN), "nifti-affine");
    assert_kind(&sform(2, 3, f64::INFINITY), "nifti-affine");
    assert_kind(&sform(1, 1, 0.0), "nifti-affine");
    let mut pixdim = Nifti::default();
    pixdim.pixdim[2] = f64::NAN;
    assert_kind(&pixdim, "nifti-affine");
    let mut qform = Nifti {
        qform_code: 1,
        sform_code: 0,
        ..Nifti::default()
    };
    assert_kind(&qform, "sound");
    qform.quaternion = [0.8, 0.8, 0.8];
    assert_kind(&qform, "nifti-affine");
    qform.quaternion = [0.0, f64::NAN, 0.0];
    assert_kind(&qform, "nifti-affine");
    qform.quaternion = [0.0; 3];
    for edge in [0.0, -1.0] {
        qform.pixdim[3] = edge;
        assert_kind(&qform, "nifti-affine");
    }
    qform.pixdim[3] = 1e-12;
    assert_kind(&qform, "geometry");
}

#[test]
fn scalings_that_are_none_are_refused() {
    let scaled = |slope: f64, intercept: f64| Nifti {
        slope,
        intercept,
        ..Nifti::default()
    };
    assert_kind(&scaled(f64::INFINITY, 0.0), "nifti-scaling");
    assert_kind(&scaled(1.0, f64::NAN), "nifti-scaling");
    assert_kind(&scaled(1.0, f64::NEG_INFINITY), "nifti-scaling");
    assert_eq!(kind_of(&scaled(3e38, 0.0).bytes()), "nifti-intensity-range");
    assert_eq!(
        kind_of(&scaled(1e-42, 0.0).bytes()),
        "nifti-intensity-range"
    );
    let huge = Nifti::of(F64, &[-1e308, 1e308].repeat(12), 1, false);
    assert_eq!(kind_of(&huge.bytes()), "nifti-intensity-range");
    let tiny = Nifti::of(F64, &[0.0, 1e-300].repeat(12), 1, false);
    assert_eq!(kind_of(&tiny.bytes()), "nifti-intensity-range");
}

fn enclosed(replaced: &nifti::Replaced) -> usize {
    let mask = replaced.enclosed.as_ref().unwrap();
    mask.voxels().iter().filter(|&&is_marked| is_marked).count()
}

#[test]
fn voxels_that_are_no_numbers_become_0_and_are_counted() {
    for datatype in [F32, F64] {
        for (first, offset) in [(0, 0.0), (5, 0.0), (0, 100.0), (5, -7.5), (1, 0.25)] {
            let mut values: Vec<f64> = (0..24).map(|value| f64::from(value) + offset).collect();
            values[first] = f64::NAN;
            values[22] = f64::INFINITY;
            values[23] = f64::NEG_INFINITY;
            let bytes = Nifti::of(datatype, &values, 1, true).bytes();
            let (volume, replaced) = nifti::read_counted(&bytes, &Limits::default()).unwrap();
            assert_eq!((replaced.not_finite, enclosed(&replaced)), (3, 0));
            for (found, value) in intensities(&volume).into_iter().zip(values) {
                let expected = if value.is_finite() { value } else { 0.0 };
                assert!((found - expected).abs() < 1e-3, "{found} for {expected}");
            }
        }
    }
    let nothing = Nifti::of(F32, &[f64::NAN; 24], 1, false).read().unwrap();
    assert!(intensities(&nothing).iter().all(|&value| value == 0.0));
}

#[test]
fn voxels_without_a_number_within_the_others_are_told_from_those_around_them() {
    let mut file = Nifti {
        dim: [3, 5, 5, 5, 1, 1, 1, 1],
        datatype: F32,
        ..Nifti::default()
    };
    let at = |[x, y, z]: [usize; 3]| x + 5 * (y + 5 * z);
    for (holes, enclosed) in [
        (vec![[2, 2, 2]], 1),
        (vec![[2, 2, 2], [2, 2, 1], [2, 2, 0]], 0),
        (vec![[0, 2, 2], [1, 2, 2], [3, 3, 3]], 1),
        (vec![[1, 1, 1], [3, 1, 1], [1, 3, 3]], 3),
        (vec![[4, 4, 4], [3, 3, 3]], 1),
    ] {
        let mut values = vec![7.0; 125];
        holes.iter().for_each(|&hole| values[at(hole)] = f64::NAN);
        file.data = values
            .iter()
            .flat_map(|&value| encode(F32, value, false))
            .collect();
        let (_, replaced) = nifti::read_counted(&file.bytes(), &Limits::default()).unwrap();
        assert_eq!(replaced.not_finite, holes.len() as u64);
        assert_eq!(self::enclosed(&replaced), enclosed, "{holes:?}");
    }
}

#[test]
fn a_file_cut_anywhere_is_truncated() {
    for version in [1, 2] {
        let file = Nifti {
            version,
            ..Nifti::default()
        };
        let bytes = file.bytes();
        for length in 4..bytes.len() {
            assert_eq!(kind_of(&bytes[..length]), "nifti-truncated", "at {length}");
            assert_eq!(
                kind_of(&pack(&bytes[..length])),
                "nifti-truncated",
                "at {length}"
            );
        }
        let packed = file.packed();
        for length in 2..packed.len() {
            assert_eq!(kind_of(&packed[..length]), "gzip-truncated", "at {length}");
            assert_eq!(sniff(&packed[..length]), Format::NiftiGz);
        }
    }
    for length in 0..4 {
        assert_eq!(kind_of(&Nifti::default().bytes()[..length]), "not-nifti");
    }
}

#[test]
fn fewer_bytes_than_a_slice_after_the_voxels_are_passed_over() {
    let mut file = Nifti::default();
    // A slice is 2 × 3 voxels.
    for length in 1..6 {
        file.data.push(0);
        assert_kind(&file, "sound");
        assert_eq!(file.read(), Nifti::default().read(), "{length}");
    }
    file.data.push(0);
    assert_kind(&file, "nifti-trailing-data");
}

#[test]
fn a_wrong_checksum_is_found_and_what_follows_the_stream_is_passed_over() {
    let packed = Nifti::default().packed();
    for from_end in 1..=8 {
        let mut damaged = packed.clone();
        let at = damaged.len() - from_end;
        damaged[at] ^= 0x10;
        assert_eq!(
            kind_of(&damaged),
            "gzip-corrupt",
            "byte {from_end} from the end"
        );
    }
    let tails: [&[u8]; 5] = [b"something else", b"\n", &[0; 10_240], &[0xff], b"\x1f"];
    for tail in tails {
        let followed = [&packed[..], tail].concat();
        assert_eq!(kind_of(&followed), "sound", "{tail:?}");
    }
    let halves = Nifti::default().bytes();
    let members = [pack(&halves[..360]), pack(&halves[360..])].concat();
    assert_eq!(kind_of(&members), "sound");
    let lost = [pack(&halves[..360]), b"lost".to_vec()].concat();
    assert_eq!(kind_of(&lost), "nifti-truncated");
}

#[test]
fn other_formats_are_named() {
    let with_magic = |magic: &[u8; 4]| Nifti {
        magic: Some(*magic),
        ..Nifti::default()
    };
    assert_eq!(kind_of(&with_magic(b"ni1\0").bytes()), "nifti-header-only");
    assert_eq!(kind_of(&with_magic(b"n+9\0").bytes()), "nifti-header");
    assert_eq!(kind_of(&with_magic(&[0; 4]).bytes()), "analyze-unsupported");
    let mut second = with_magic(b"ni2\0");
    second.version = 2;
    assert_eq!(kind_of(&second.bytes()), "nifti-header-only");
    second.magic = Some(*b"n+1\0");
    assert_eq!(kind_of(&second.bytes()), "nifti-header");
    let unsized_header = Nifti {
        sizeof_hdr: Some(349),
        ..Nifti::default()
    };
    assert_eq!(kind_of(&unsized_header.bytes()), "not-nifti");
    assert_eq!(kind_of(b""), "not-nifti");
    assert_eq!(kind_of(b"PK\x03\x04 and so on"), "not-nifti");
    assert_eq!(kind_of(&pack(b"some text, packed")), "not-nifti");
}

#[test]
fn content_tells_nifti_from_other_gzip_files() {
    let file = Nifti::default();
    assert_eq!(sniff(&file.bytes()), Format::Nifti);
    assert_eq!(sniff(&file.packed()), Format::NiftiGz);
    let second = Nifti::of(I16, &[1.0; 24], 2, true);
    assert_eq!(sniff(&second.bytes()), Format::Nifti);
    assert_eq!(sniff(&second.packed()), Format::NiftiGz);
    assert_eq!(sniff(&pack(b"some text, packed")), Format::Unknown);
}

#[test]
fn limits_hold_for_voxels_and_for_bytes() {
    let file = Nifti::of(F64, &[1.0; 24], 1, false);
    let read = |max_voxels, max_bytes| {
        let limits = Limits {
            max_voxels,
            max_bytes,
        };
        nifti::read_volume(&file.packed(), &limits)
    };
    assert!(read(24, 192).is_ok());
    let voxels = ImagingError::TooManyVoxels {
        voxels: 24,
        limit: 23,
    };
    assert_eq!(read(23, 192), Err(voxels));
    let bytes = ImagingError::TooManyBytes {
        bytes: 192,
        limit: 191,
    };
    assert_eq!(read(24, 191), Err(bytes));
}

#[test]
fn sizes_beyond_all_numbers_are_too_many_voxels() {
    for sides in [[32767; 3], [2, i64::MAX, i64::MAX]] {
        let mut file = Nifti {
            version: 2,
            ..Nifti::default()
        };
        file.dim[1..4].copy_from_slice(&sides);
        assert_eq!(kind_of(&file.bytes()), "too-many-voxels");
        assert_eq!(kind_of(&file.packed()), "too-many-voxels");
        file.dim = [7, 2, 3, 4, i64::MAX, i64::MAX, 5, 6];
        assert_eq!(kind_of(&file.bytes()), "nifti-several-volumes");
    }
}

#[test]
fn a_short_stream_cannot_promise_much() {
    let file = Nifti {
        dim: [3, 512, 512, 512, 1, 1, 1, 1],
        ..Nifti::default()
    };
    assert_eq!(kind_of(&file.packed()), "nifti-promise");
    assert_eq!(kind_of(&file.bytes()), "nifti-truncated");
}

#[test]
fn a_stream_that_unpacks_to_gigabytes_is_not_unpacked() {
    let zeros = vec![0; 64 << 20];
    let bomb = [Nifti::default().bytes(), zeros].concat();
    let packed = {
        let mut packed = Vec::new();
        let mut encoder = flate2::bufread::GzEncoder::new(&bomb[..], Compression::best());
        std::io::Read::read_to_end(&mut encoder, &mut packed).expect("reading from memory");
        packed
    };
    assert_eq!(kind_of(&packed), "nifti-trailing-data");
    let larger = Nifti {
        dim: [3, 1024, 1024, 1025, 1, 1, 1, 1],
        data: Vec::new(),
        ..Nifti::default()
    };
    let promising = [larger.bytes(), vec![0; 16 << 20]].concat();
    assert_eq!(kind_of(&pack(&promising)), "too-many-voxels");
}

#[test]
fn no_message_repeats_a_text_of_the_file() {
    let mut file = Nifti::default().bytes();
    file[148..228].fill(b'Q');
    file[228..252].fill(b'Q');
    file[328..344].fill(b'Q');
    file[4..40].fill(b'Q');
    file.pop();
    let error = nifti::read_volume(&file, &Limits::default()).unwrap_err();
    assert_eq!(error.kind(), "nifti-truncated");
    assert!(!format!("{error} {error:?}").contains('Q'));
}
