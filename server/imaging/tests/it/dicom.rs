//! What becomes of DICOM series, sound ones and each kind of bad one.

use geometry::Volume;
use glam::DVec3;
use imaging::dicom::{Converted, DicomError, Options, SeriesName, convert};
use imaging::{Limits, nifti};

use crate::series_builder::{DataSet, Slice, Syntax, enhanced, files, slices};

fn converted_with(files: Vec<Vec<u8>>, options: &Options) -> Result<Converted, DicomError> {
    let mut files = files;
    convert(&mut files, options, &Limits::default())
}

fn converted(files: Vec<Vec<u8>>) -> Result<Converted, DicomError> {
    converted_with(files, &Options::default())
}

fn volume(converted: &Converted) -> Volume {
    nifti::read_volume(&converted.nifti, &Limits::default()).unwrap()
}

/// Kind and words of a refusal.
#[track_caller]
fn refused(slices: &[Slice]) -> (&'static str, String) {
    let error = converted(files(slices, Syntax::Explicit)).unwrap_err();
    let text = error.to_string();
    for secret in ["Somebody", "Secret", "P-77", "1.2.3", "t1_mprage"] {
        assert!(!text.contains(secret), "{text}");
    }
    (error.kind(), text)
}

fn allowing_gaps() -> Options {
    Options {
        allow_gaps: true,
        ..Options::default()
    }
}

fn taking(series: &str) -> Options {
    Options {
        series: SeriesName::parse(series),
        ..Options::default()
    }
}

#[track_caller]
fn assert_is_the_plain_series(volume: &Volume, count: usize) {
    assert_eq!(volume.grid().size(), [6, 5, count]);
    let at = |voxel: [f64; 3]| {
        let grid = volume.grid().patient_from_voxel();
        grid.transform_point3(DVec3::from_array(voxel))
    };
    assert!((at([0.0; 3]) - DVec3::new(-10.0, -20.0, 30.0)).length() < 1e-4);
    let far = at([5.0, 4.0, 2.0]);
    assert!((far - DVec3::new(-10.0 + 5.0 * 1.25, -20.0 + 4.0 * 1.5, 34.0)).length() < 1e-4);
    for (index, &stored) in volume.voxels().iter().enumerate() {
        let expected = 100 * (index / 30 + 1) + index % 30;
        assert_eq!(volume.intensity(f32::from(stored)), expected as f32);
    }
}

#[test]
fn a_series_is_the_same_volume_in_every_syntax() {
    for syntax in [
        Syntax::Implicit,
        Syntax::Explicit,
        Syntax::BigEndian,
        Syntax::Deflated,
        Syntax::Rle,
    ] {
        let converted = converted(files(&slices(7), syntax)).unwrap();
        assert_is_the_plain_series(&volume(&converted), 7);
    }
}

#[test]
fn an_enhanced_image_is_the_same_volume_as_its_slices() {
    let mut slices = slices(6);
    let whole = converted(vec![enhanced(&slices)]).unwrap();
    assert_is_the_plain_series(&volume(&whole), 6);
    assert_eq!(whole.attributes.instances[5].frame, Some(6));
    slices.reverse();
    let reversed = converted(vec![enhanced(&slices)]).unwrap();
    assert_is_the_plain_series(&volume(&reversed), 6);
    assert_eq!(reversed.attributes.instances[5].frame, Some(1));
}

#[test]
fn files_without_preamble_or_meta_information_are_found_by_content() {
    for syntax in [Syntax::Implicit, Syntax::Explicit] {
        let bare = |slice: &Slice| {
            let file = slice.file(syntax);
            // The one element of the meta information has its length at 138 and its value at 140.
            file[140 + usize::from(file[138])..].to_vec()
        };
        let mut files: Vec<Vec<u8>> = slices(4).iter().map(bare).collect();
        files.push(b"a text beside them".to_vec());
        let converted = converted(files).unwrap();
        assert_is_the_plain_series(&volume(&converted), 4);
        assert_eq!(converted.ignored_files, 1);
    }
}

#[test]
fn the_order_of_files_changes_nothing() {
    let sorted = converted(files(&slices(5), Syntax::Explicit)).unwrap();
    let mut other = files(&slices(5), Syntax::Explicit);
    other.swap(0, 3);
    other.push(other[2].clone());
    assert_eq!(converted(other).unwrap(), sorted);
}

#[test]
fn signs_and_slopes_are_those_of_the_header() {
    let mut slices = slices(3);
    for slice in &mut slices {
        slice.signed = true;
        slice.bits_stored = 16;
        slice.samples[0] = -5i16 as u16;
        slice.rescale = Some([0.5, -10.0]);
    }
    let volume = volume(&converted(files(&slices, Syntax::Explicit)).unwrap());
    assert_eq!(volume.intensity_range()[0], -12.5);
    assert_eq!(volume.intensity_range()[1], 0.5 * 329.0 - 10.0);
}

#[test]
fn slices_with_slopes_of_their_own_are_brought_to_one() {
    let mut slices = slices(3);
    for (slice, rescale) in slices.iter_mut().zip([[1.0, 0.0], [3.0, 1.0], [1.0, 0.0]]) {
        slice.rescale = Some(rescale);
    }
    let volume = volume(&converted(files(&slices, Syntax::Explicit)).unwrap());
    let of_slice = |slice: usize| volume.intensity(f32::from(volume.voxels()[30 * slice + 4]));
    assert!((of_slice(0) - 104.0).abs() < 0.01);
    assert!((of_slice(1) - (3.0 * 204.0 + 1.0)).abs() < 0.01);
}

#[test]
fn monochrome1_is_a_matter_of_display() {
    let mut slices = slices(3);
    for slice in &mut slices {
        slice.photometric = "MONOCHROME1";
    }
    let converted = converted(files(&slices, Syntax::Explicit)).unwrap();
    assert_is_the_plain_series(&volume(&converted), 3);
    let kept = &converted.attributes.attributes;
    assert!(kept.contains(&(
        "PhotometricInterpretation".to_owned(),
        "MONOCHROME1".to_owned()
    )));
}

#[test]
fn whose_head_it_is_comes_apart_from_the_pixels() {
    let converted = converted(files(&slices(3), Syntax::Implicit)).unwrap();
    let kept = |keyword: &str| {
        let found = converted
            .attributes
            .attributes
            .iter()
            .find(|(key, _)| key == keyword);
        found.map(|(_, value)| value.as_str())
    };
    assert_eq!(kept("PatientName"), Some("Somebody^Secret"));
    assert_eq!(kept("PatientID"), Some("P-77"));
    assert_eq!(kept("StudyInstanceUID"), Some("1.2.3"));
    assert_eq!(kept("SeriesInstanceUID"), Some("1.2.3.1"));
    let uids: Vec<&str> = converted
        .attributes
        .instances
        .iter()
        .map(|instance| instance.sop_instance_uid.as_str())
        .collect();
    assert_eq!(uids, ["1.2.3.4.1", "1.2.3.4.2", "1.2.3.4.3"]);
    let mut unpacked = Vec::new();
    let mut packed = flate2::read::GzDecoder::new(&converted.nifti[..]);
    std::io::Read::read_to_end(&mut packed, &mut unpacked).unwrap();
    let text = String::from_utf8_lossy(&unpacked);
    assert!(!text.contains("Somebody") && !text.contains("P-77"));
}

#[test]
fn a_missing_slice_is_named_and_interpolated_where_that_is_allowed() {
    let mut slices = slices(12);
    slices.remove(4);
    let (kind, text) = refused(&slices);
    assert_eq!(kind, "dicom-slices-missing");
    assert!(
        text.contains("number 5)") && text.contains("allow_gaps"),
        "{text}"
    );
    let filled = converted_with(files(&slices, Syntax::Explicit), &allowing_gaps()).unwrap();
    assert_eq!(filled.attributes.interpolated_slices, [5]);
    assert_eq!(filled.attributes.instances.len(), 11);
    assert_is_the_plain_series(&volume(&filled), 12);
}

#[test]
fn wide_or_many_gaps_are_never_interpolated() {
    let mut wide = slices(30);
    wide.drain(10..13);
    let mut many = slices(12);
    many.remove(7);
    many.remove(4);
    for slices in [wide, many] {
        let (kind, text) = refused(&slices);
        assert_eq!(kind, "dicom-slices-missing");
        assert!(!text.contains("allow_gaps"), "{text}");
        let files = files(&slices, Syntax::Explicit);
        assert!(converted_with(files, &allowing_gaps()).is_err());
    }
}

#[test]
fn bad_stacks_are_refused_with_the_slices_named() {
    let with = |change: &dyn Fn(&mut Vec<Slice>)| {
        let mut slices = slices(8);
        change(&mut slices);
        refused(&slices)
    };
    type Change<'a> = &'a dyn Fn(&mut Vec<Slice>);
    let cases: [(&str, &str, Change); 15] = [
        ("dicom-slices-doubled", "instance number 9", &|slices| {
            let double = Slice {
                instance: 9,
                sop_uid: "1.2.9".to_owned(),
                ..slices[3].clone()
            };
            slices.push(double);
        }),
        (
            "dicom-slices-uneven",
            "slices 4 and 5 are 3.000 mm",
            &|slices| {
                slices[4..]
                    .iter_mut()
                    .for_each(|slice| slice.position[2] += 1.0);
            },
        ),
        ("dicom-gantry-tilt", "14.0°", &|slices| {
            for (number, slice) in slices.iter_mut().enumerate() {
                slice.position[1] += 0.5 * number as f64;
            }
        }),
        ("dicom-slice-shifted", "slice 3 is 0.70 mm", &|slices| {
            slices[2].position[0] += 0.7;
        }),
        (
            "dicom-several-acquisitions",
            "2 acquisitions of 8 slices each, which differ in echo time",
            &|slices| {
                let mut second = slices.clone();
                for slice in &mut second {
                    slice.echo_ms = 7.5;
                    slice.instance += 8;
                    slice.sop_uid.push_str(".2");
                }
                slices.extend(second);
            },
        ),
        // A half that lies elsewhere does not lean.
        ("dicom-slice-shifted", "slice 5 is 3.00 mm", &|slices| {
            slices[4..]
                .iter_mut()
                .for_each(|slice| slice.position[0] += 3.0);
        }),
        (
            "dicom-several-acquisitions",
            "all 8 slices have the same position",
            &|slices| {
                let position = slices[0].position;
                slices
                    .iter_mut()
                    .for_each(|slice| slice.position = position);
            },
        ),
        (
            "dicom-not-placed",
            "two perpendicular directions of length 1",
            &|slices| {
                for slice in slices {
                    slice.orientation = [0.9, 0.0, 0.0, 0.0, 1.0, 0.0];
                }
            },
        ),
        ("dicom-mixed-sizes", "size: instance number 4", &|slices| {
            slices[3].columns = 5;
        }),
        (
            "dicom-mixed-orientations",
            "orientation: instance number 1",
            &|slices| {
                slices[0].orientation = [0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
            },
        ),
        (
            "dicom-mixed-spacings",
            "pixel spacing: instance number 6",
            &|slices| {
                slices[5].spacing = [1.5, 1.5];
            },
        ),
        (
            "dicom-mixed-patients",
            "Patient ID: instance number 2",
            &|slices| {
                slices[1].patient_id = "P-78";
            },
        ),
        ("dicom-not-placed", "instance number 7", &|slices| {
            slices[6].orientation = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        }),
        ("dicom-too-few-slices", "2 slices", &|slices| {
            slices.truncate(2);
        }),
        ("dicom-mosaic", "Siemens mosaic", &|slices| {
            for slice in slices {
                slice.image_type = "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC";
            }
        }),
    ];
    for (kind, words, change) in cases {
        let (found, text) = with(change);
        assert_eq!(found, kind, "{text}");
        assert!(text.contains(words), "{text}");
    }
}

#[test]
fn what_is_no_grey_mr_or_ct_image_is_refused_by_name() {
    let of = |change: &dyn Fn(&mut Slice)| {
        let mut slices = slices(4);
        slices.iter_mut().for_each(change);
        refused(&slices)
    };
    let (kind, text) = of(&|slice| slice.samples_per_pixel = 3);
    assert!(
        kind == "dicom-unsupported" && text.contains("colour"),
        "{text}"
    );
    let (kind, _) = of(&|slice| slice.sop_class = "1.2.840.10008.5.1.4.1.1.7");
    assert_eq!(kind, "dicom-no-images");
    let none = converted(vec![b"hello".to_vec()]).unwrap_err();
    assert_eq!(none.kind(), "dicom-none");
}

/// A series beside the plain one.
fn another(number: i64, description: &'static str, count: usize) -> Vec<Slice> {
    let mut slices = slices(count);
    for slice in &mut slices {
        slice.series_uid = format!("1.2.3.1{number}");
        slice.series_number = number;
        slice.description = description;
        slice.echo_ms = 90.0;
        slice.samples.iter_mut().for_each(|sample| *sample += 1);
    }
    slices
}

#[test]
fn a_ct_is_no_t1_whatever_its_names_and_its_timing_say() {
    let is_t1 = |sop_class, modality| {
        let slices = (0..5).map(|number| Slice {
            description: "t1 vertebra",
            sop_class,
            modality,
            ..Slice::number(number)
        });
        let files = files(&slices.collect::<Vec<_>>(), Syntax::Explicit);
        converted(files).unwrap().is_t1
    };
    assert!(is_t1("1.2.840.10008.5.1.4.1.1.4", "MR"));
    assert!(!is_t1("1.2.840.10008.5.1.4.1.1.2", "CT"));
}

#[test]
fn among_several_series_the_t1_is_taken_and_the_others_are_listed() {
    let mut slices = slices(6);
    slices.extend(another(2, "t2_flair", 9));
    slices.extend(another(9, "localizer", 3));
    let converted = converted(files(&slices, Syntax::Explicit)).unwrap();
    assert_eq!(converted.series.number, Some(4));
    let others: Vec<_> = converted
        .others
        .iter()
        .map(|series| series.number)
        .collect();
    assert_eq!(others, [Some(2), Some(9)]);
}

#[test]
fn a_series_that_makes_no_volume_is_named_and_the_others_are_listed() {
    let mut slices = slices(12);
    slices.remove(4);
    let (kind, text) = refused(&slices);
    assert_eq!(kind, "dicom-slices-missing");
    assert!(
        text.starts_with("series 4 (MR T1, 6 × 5 × 11, token "),
        "{text}"
    );
    assert!(!text.contains("also hold"), "{text}");
    slices.extend(another(2, "t2_flair", 9));
    slices.extend(another(9, "localizer", 3));
    let (kind, text) = refused(&slices);
    assert_eq!(kind, "dicom-slices-missing");
    assert!(
        text.starts_with("series 4 (MR T1, 6 × 5 × 11, token "),
        "{text}"
    );
    let others = text.split("; the files also hold ").nth(1).unwrap();
    assert!(
        others.contains("series 2 (MR FLAIR, 6 × 5 × 9, token "),
        "{text}"
    );
    assert!(others.contains("series 9 (MR, 6 × 5 × 3, token "), "{text}");
}

#[test]
fn where_several_series_could_be_meant_they_are_listed_and_one_can_be_named() {
    let mut slices = slices(6);
    slices.extend(another(7, "t1_mprage again", 5));
    let (kind, text) = refused(&slices);
    assert_eq!(kind, "dicom-several-series");
    assert!(
        text.contains("series 4 (MR T1, 6 × 5 × 6, token "),
        "{text}"
    );
    let token = text.rsplit("token ").next().unwrap().trim_end_matches(')');
    // The beginning of BLAKE3("1.2.3.17"), which no other version of the program or of Rust may change.
    assert_eq!(token, "5e0a7c27");
    for name in ["7", "1.2.3.17", token] {
        let converted = converted_with(files(&slices, Syntax::Explicit), &taking(name)).unwrap();
        assert_eq!(converted.series.size, [6, 5, 5], "{name}");
    }
    let unknown = converted_with(files(&slices, Syntax::Explicit), &taking("5")).unwrap_err();
    assert_eq!(unknown.kind(), "dicom-series-unknown");
}

#[test]
fn lengths_and_nesting_are_checked_before_anything_is_parsed() {
    let mut claims = Slice::number(0).data_set(Syntax::Explicit);
    claims.head([0x28, 0x2110], "UN", 0xFFFF_FFF0);
    let mut nested = Slice::number(0).data_set(Syntax::Explicit);
    for _ in 0..3000 {
        nested.head([0x5200, 0x9230], "SQ", u32::MAX);
        nested.delimiter(0xE000, u32::MAX);
    }
    let mut cut = Slice::number(0).file(Syntax::Explicit);
    cut.truncate(cut.len() - 20);
    let mut rle = Slice::number(0).data_set(Syntax::Rle);
    rle.head([0x7FE0, 0x10], "OB", u32::MAX);
    rle.delimiter(0xE000, 0);
    rle.delimiter(0xE000, 0xFFFF_FF00);
    for (file, words) in [
        (claims.file(), "longer than the rest of the file"),
        (nested.file(), "nested too deeply"),
        (cut, "pixel data is truncated"),
        (rle.file(), "compressed pixel data is truncated"),
    ] {
        let error = converted(vec![file]).unwrap_err();
        assert_eq!(error.kind(), "dicom-damaged");
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn private_sequences_of_unknown_kind_are_passed_over() {
    let file = |slice: &Slice| {
        let whole = slice.file(Syntax::Explicit);
        // Behind the patient's elements: an implicit sequence under an unknown representation, of undefined length.
        let mut odd = DataSet::new(Syntax::Explicit);
        odd.head([0x19, 0x1010], "UN", u32::MAX);
        odd.delimiter(0xE000, u32::MAX);
        let mut inner = DataSet::new(Syntax::Implicit);
        inner.text([0x19, 0x1011], "LO", "private");
        odd.bytes.extend(inner.bytes);
        odd.delimiter(0xE00D, 0);
        odd.delimiter(0xE0DD, 0);
        let at = whole
            .windows(4)
            .position(|window| window == [0x20, 0, 0x0D, 0])
            .unwrap();
        [&whole[..at], &odd.bytes, &whole[at..]].concat()
    };
    let files = slices(4).iter().map(file).collect();
    assert_is_the_plain_series(&volume(&converted(files).unwrap()), 4);
}

#[test]
fn a_volume_beyond_the_limits_is_refused() {
    let limits = Limits {
        max_voxels: 100,
        ..Limits::default()
    };
    let mut files = files(&slices(4), Syntax::Explicit);
    let error = convert(&mut files, &Options::default(), &limits).unwrap_err();
    assert!(error.is_too_large());
    assert_eq!(error.kind(), "too-many-voxels");
}

/// A number that depends on nothing but its place in a sequence.
fn scrambled(seed: u64) -> u64 {
    let mut number = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    number ^= number >> 31;
    number = number.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    number ^ number >> 29
}

#[test]
fn whatever_bytes_are_changed_there_is_an_answer() {
    let sound: Vec<Vec<Vec<u8>>> = vec![
        files(&slices(3), Syntax::Explicit),
        files(&slices(3), Syntax::Implicit),
        files(&slices(3), Syntax::BigEndian),
        files(&slices(3), Syntax::Rle),
        vec![enhanced(&slices(4))],
    ];
    for round in 0..2000 {
        let mut files = sound[round as usize % sound.len()].clone();
        let file = &mut files[0];
        for change in 0..1 + scrambled(round) % 4 {
            let random = scrambled(1000 * round + change);
            let at = 128 + random as usize % (file.len() - 128);
            file[at] = (random >> 40) as u8;
        }
        if let Ok(converted) = converted(files) {
            let volume = nifti::read_volume(&converted.nifti, &Limits::default());
            assert!(volume.is_ok_and(|volume| volume.voxels().len() >= 60));
        }
    }
}
