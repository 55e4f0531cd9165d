//! DICOM files as scanners, anonymisers and converters write them although the standard has it otherwise: each is read as it is
//! meant, or refused in a sentence that names what is wrong.

use imaging::dicom::{Converted, DicomError, Options, SeriesName, convert};
use imaging::{Format, Limits, nifti, sniff};

use crate::series_builder::{DataSet, Slice, Syntax, enhanced, files, slices};

type Tag = [u16; 2];

const ROWS: Tag = [0x28, 0x10];
const SPACING: Tag = [0x28, 0x30];
const INTERCEPT: Tag = [0x28, 0x1052];
const SLOPE: Tag = [0x28, 0x1053];
const POSITION: Tag = [0x20, 0x32];
const ORIENTATION: Tag = [0x20, 0x37];
const IS_SIGNED: Tag = [0x28, 0x103];
const NAME: Tag = [0x10, 0x10];

fn converted_with(files: Vec<Vec<u8>>, options: &Options) -> Result<Converted, DicomError> {
    let mut files = files;
    convert(&mut files, options, &Limits::default())
}

fn converted(files: Vec<Vec<u8>>) -> Result<Converted, DicomError> {
    converted_with(files, &Options::default())
}

/// The intensities of what is converted.
fn intensities(converted: &Converted) -> Vec<f32> {
    let volume = nifti::read_volume(&converted.nifti, &Limits::default()).unwrap();
    let stored = volume.voxels().iter();
    stored
        .map(|&stored| volume.intensity(f32::from(stored)))
        .collect()
}

/// Those of a plain series.
fn plain(count: usize) -> Vec<f32> {
    intensities(&converted(files(&slices(count), Syntax::Explicit)).unwrap())
}

/// Slices with slope and intercept.
fn scaled(count: usize) -> Vec<Slice> {
    let mut slices = slices(count);
    for slice in &mut slices {
        slice.rescale = Some([2.5, -10.0]);
    }
    slices
}

/// An element as an explicit file has it.
fn element(tag: Tag, vr: &str, value: &[u8]) -> Vec<u8> {
    let mut set = DataSet::new(Syntax::Explicit);
    set.bytes(tag, vr, value);
    set.bytes
}

fn tag_bytes([group, element]: Tag) -> Vec<u8> {
    [group.to_le_bytes(), element.to_le_bytes()].concat()
}

/// Where an element with a short length begins in a file, and its value.
fn find(file: &[u8], tag: Tag) -> (usize, Vec<u8>) {
    let tag = tag_bytes(tag);
    let found = file[132..].windows(4).position(|window| window == tag);
    let at = 132 + found.expect("the element is there");
    let length = usize::from(u16::from_le_bytes([file[at + 6], file[at + 7]]));
    (at, file[at + 8..at + 8 + length].to_vec())
}

/// A file with another representation and value of an element.
fn with(file: &[u8], tag: Tag, vr: &str, change: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let (at, value) = find(file, tag);
    let changed = element(tag, vr, &change(&value));
    [&file[..at], &changed, &file[at + 8 + value.len()..]].concat()
}

/// A file without an element.
fn without(file: &[u8], tag: Tag) -> Vec<u8> {
    let (at, value) = find(file, tag);
    [&file[..at], &file[at + 8 + value.len()..]].concat()
}

/// A file with something before an element.
fn with_before(file: &[u8], tag: Tag, more: &[u8]) -> Vec<u8> {
    let (at, _) = find(file, tag);
    [&file[..at], more, &file[at..]].concat()
}

fn same(value: &[u8]) -> Vec<u8> {
    value.to_vec()
}

/// The end of the meta information, which has one element.
fn meta_end(file: &[u8]) -> usize {
    140 + usize::from(file[138])
}

#[test]
fn elements_of_an_unknown_representation_have_that_of_the_dictionary() {
    let expected = intensities(&converted(files(&scaled(4), Syntax::Explicit)).unwrap());
    let plain = converted(files(&scaled(4), Syntax::Explicit)).unwrap();
    for tag in [
        ROWS,
        SPACING,
        INTERCEPT,
        SLOPE,
        POSITION,
        ORIENTATION,
        NAME,
        IS_SIGNED,
    ] {
        let files = files(&scaled(4), Syntax::Explicit);
        let unknown = files.iter().map(|file| with(file, tag, "UN", same));
        let found = converted(unknown.collect()).unwrap();
        assert_eq!(intensities(&found), expected, "{tag:x?}");
        assert_eq!(found.nifti, plain.nifti, "{tag:x?}");
        assert_eq!(found.attributes, plain.attributes, "{tag:x?}");
    }
}

#[test]
fn numbers_are_read_as_texts_of_any_representation() {
    let expected = converted(files(&scaled(4), Syntax::Explicit)).unwrap();
    for (tag, vr) in [
        (SPACING, "UT"),
        (POSITION, "LO"),
        (SLOPE, "SH"),
        (ORIENTATION, "UT"),
        (INTERCEPT, "ST"),
    ] {
        let files = files(&scaled(4), Syntax::Explicit);
        let other = files.iter().map(|file| with(file, tag, vr, same));
        let found = converted(other.collect()).unwrap();
        assert_eq!(found.nifti, expected.nifti, "{tag:x?} {vr}");
    }
}

#[test]
fn a_slope_or_intercept_that_some_slices_lack_is_no_default_for_them() {
    let whole: Vec<_> = scaled(6)
        .iter()
        .map(|slice| slice.file(Syntax::Explicit))
        .collect();
    for (tag, name, defaults) in [
        (SLOPE, "RescaleSlope", [1.0, -10.0]),
        (INTERCEPT, "RescaleIntercept", [2.5, 0.0]),
    ] {
        for is_blank in [true, false] {
            let lacking = |file: &[u8]| match is_blank {
                true => with(file, tag, "DS", |_| Vec::new()),
                false => without(file, tag),
            };
            let mut some = whole.clone();
            for file in some.iter_mut().skip(1).step_by(2) {
                *file = lacking(file);
            }
            let error = converted(some).unwrap_err();
            assert_eq!(error.kind(), "dicom-value", "{error}");
            let words = format!("{name} of the image with instance number 2 cannot be read");
            assert!(error.to_string().contains(&words), "{error}");

            let all = whole.iter().map(|file| lacking(file)).collect();
            let [slope, intercept] = defaults;
            let expected = plain(6)
                .into_iter()
                .map(|stored| slope * stored + intercept);
            let found = intensities(&converted(all).unwrap());
            assert_eq!(found, expected.collect::<Vec<_>>(), "{name}");
        }
    }
    // What the others state is the default.
    let mut slices = slices(6);
    for slice in slices.iter_mut().step_by(2) {
        slice.rescale = Some([1.0, 0.0]);
    }
    let found = converted(files(&slices, Syntax::Explicit)).unwrap();
    assert_eq!(intensities(&found), plain(6));
}

#[test]
fn pixels_of_16_bits_state_whether_they_are_signed() {
    let values: [(Option<&[u8]>, &str); 3] = [
        (None, "absent or blank"),
        (Some(&[]), "absent or blank"),
        (Some(&[7, 0]), "7, neither 0 nor 1"),
    ];
    for (value, words) in values {
        let file = |slice: &Slice| {
            let file = slice.file(Syntax::Explicit);
            match value {
                Some(value) => with(&file, IS_SIGNED, "US", |_| value.to_vec()),
                None => without(&file, IS_SIGNED),
            }
        };
        let error = converted(slices(4).iter().map(file).collect()).unwrap_err();
        let words = format!(
            "PixelRepresentation of the image with instance number 1 cannot be read: it is {words}"
        );
        assert!(error.to_string().contains(&words), "{error}");
    }
    // 8 bits are never signed in practice.
    let of_8_bits = |slice: &Slice| {
        let mut slice = slice.clone();
        slice.bits_stored = 8;
        let mut set = slice.data_set(Syntax::Explicit);
        set.bytes([0x7FE0, 0x10], "OW", &[200; 30]);
        let file = with(&set.file(), [0x28, 0x100], "US", |_| vec![8, 0]);
        without(&file, IS_SIGNED)
    };
    let found = converted(slices(4).iter().map(of_8_bits).collect()).unwrap();
    assert_eq!(intensities(&found), [200.0; 120]);
}

#[test]
fn a_value_that_cannot_be_read_is_never_a_default() {
    let cases: [(Tag, &str, &[u8], &str); 12] = [
        (
            SLOPE,
            "DS",
            b"2,5 ",
            "RescaleSlope of the image with instance number 2 cannot be read: it is `2,5`",
        ),
        (SLOPE, "DS", b"2.5.1 ", "it is `2.5.1`"),
        (SLOPE, "DS", b"2\\5 ", "it is `2\\5`"),
        (SLOPE, "LO", b"Smith,Anna", "it is a text of 10 characters"),
        (
            INTERCEPT,
            "DS",
            b"-1O ",
            "RescaleIntercept of the image with instance number 2",
        ),
        (
            SPACING,
            "DS",
            b"1,5\\1,25",
            "PixelSpacing of the image with instance number 2 cannot be read: it is `1,5\\1,25`",
        ),
        (
            SPACING,
            "OB",
            b"1.5\\1.25",
            "PixelSpacing of the image with instance number 2 cannot be read: it is a value of the representation OB",
        ),
        (
            POSITION,
            "DS",
            b"1\\2\\x ",
            "ImagePositionPatient of the image with instance number 2",
        ),
        (
            ROWS,
            "OB",
            b"\x05\x00",
            "Rows of the image with instance number 2",
        ),
        (ROWS, "LO", b"five", "it is a text of 4 characters"),
        (SLOPE, "DS", b"inf ", "it is a text of 3 characters"),
        (
            IS_SIGNED,
            "DS",
            b"0.5 ",
            "PixelRepresentation of the image with instance number 2",
        ),
    ];
    for (tag, vr, value, words) in cases {
        let mut files: Vec<_> = scaled(4)
            .iter()
            .map(|slice| slice.file(Syntax::Explicit))
            .collect();
        files[1] = with(&files[1], tag, vr, |_| value.to_vec());
        let error = converted(files.clone()).unwrap_err();
        assert_eq!(error.kind(), "dicom-value", "{error}");
        assert!(error.to_string().contains(words), "{error}");
        assert!(!error.to_string().contains("Anna"), "{error}");
        // Beside another series it is still the T1 that is meant.
        let mut other = slices(4);
        for (number, slice) in other.iter_mut().enumerate() {
            slice.series_uid = "1.2.3.9".to_owned();
            slice.sop_uid = format!("1.2.3.9.{number}");
            slice.description = "t2_flair";
        }
        files.extend(other.iter().map(|slice| slice.file(Syntax::Explicit)));
        assert_eq!(converted(files).unwrap_err().kind(), "dicom-value");
    }
}

/// A slice in which a frame of pixels is padding.
fn padded(
    value: i32,
    limit: Option<i32>,
    signed: bool,
    around: i32,
    rescale: Option<[f64; 2]>,
) -> Vec<Vec<u8>> {
    let mut slices = slices(4);
    for slice in &mut slices {
        (slice.signed, slice.bits_stored, slice.rescale) = (signed, 16, rescale);
        for (at, sample) in slice.samples.iter_mut().enumerate() {
            if at % 6 == 0 || at < 6 {
                *sample = around as u16;
            }
        }
    }
    let file = |slice: &Slice| {
        let mut set = slice.data_set(Syntax::Explicit);
        let vr = if signed { "SS" } else { "US" };
        let mut padding = element([0x28, 0x120], vr, &(value as u16).to_le_bytes());
        if let Some(limit) = limit {
            padding.extend(element([0x28, 0x121], vr, &(limit as u16).to_le_bytes()));
        }
        let at = set
            .bytes
            .windows(4)
            .position(|window| window == tag_bytes(INTERCEPT));
        let at = at.unwrap_or(set.bytes.len());
        set.bytes.splice(at..at, padding);
        let samples = set.samples(&slice.samples);
        set.bytes([0x7FE0, 0x10], "OW", &samples);
        set.file()
    };
    slices.iter().map(file).collect()
}

#[test]
fn padding_is_the_background_and_no_image() {
    let mr = None;
    let ct = Some([1.0, -1024.0]);
    for (value, limit, signed, around, rescale, background) in [
        (-32768, None, true, -32768, mr, 0.0),
        (65535, None, false, 65535, mr, 0.0),
        (-2000, None, true, -2000, mr, 0.0),
        (-32768, Some(-32000), true, -32500, mr, 0.0),
        (63000, Some(65535), false, 64000, mr, 0.0),
        // Nothing in it is as dark as its background, which keeps its value.
        (0, None, false, 0, mr, 0.0),
        // The least value of a slice is 107; 0 would be water.
        (65535, None, false, 65535, ct, 107.0 - 1024.0),
        (-2000, None, true, -2000, ct, 107.0 - 1024.0),
        // A value that lies within those of the image is one of them.
        (200, None, false, 200, mr, 200.0),
    ] {
        let found = intensities(&converted(padded(value, limit, signed, around, rescale)).unwrap());
        let offset = rescale.map_or(0.0, |[_, intercept]| intercept as f32);
        for (index, intensity) in found.into_iter().enumerate() {
            let at = index % 30;
            let expected = match at % 6 == 0 || at < 6 {
                true => background,
                false => (100 * (index / 30 + 1) + at) as f32 + offset,
            };
            assert_eq!(intensity, expected, "{value} at {index}");
        }
    }
}

#[test]
fn dicom_is_told_whatever_its_preamble() {
    let preambles: [&[u8]; 8] = [
        &348i32.to_le_bytes(),
        &348i32.to_be_bytes(),
        &540i32.to_le_bytes(),
        &540i32.to_be_bytes(),
        &[0x1f, 0x8b, 8],
        b"PK\x03\x04",
        b"II*\0",
        b"NRRD0004",
    ];
    for preamble in preambles {
        let begun = |file: &Vec<u8>| [preamble, &file[preamble.len()..]].concat();
        let files: Vec<_> = files(&slices(4), Syntax::Explicit)
            .iter()
            .map(begun)
            .collect();
        assert_eq!(sniff(&files[0]), Format::Dicom);
        let found = converted(files).unwrap();
        assert_eq!(intensities(&found), plain(4), "{preamble:?}");
        assert_eq!(found.ignored_files, 0);
    }
}

/// An image of another series that cannot be read.
fn unread(number: usize) -> Vec<u8> {
    let other = Slice {
        series_uid: "1.2.3.8".to_owned(),
        sop_uid: format!("1.2.3.8.{number}"),
        instance: 70 + number as i64,
        ..Slice::number(number)
    };
    let whole = other.file(Syntax::Explicit);
    match number {
        // Cut in its pixels, in its header, before its pixels.
        0 => whole[..whole.len() - 7].to_vec(),
        1 => whole[..meta_end(&whole) + 30].to_vec(),
        2 => whole[..whole.len() - 72].to_vec(),
        3 => with_before(&whole, [0x20, 0x11], &element([0x20, 0x10], "??", b"ab")),
        _ => with_before(
            &whole,
            [0x28, 0x10],
            &[0x28, 0, 8, 0, b'U', b'N', 0, 0, 0xF0, 0xFF, 0xFF, 0xFF],
        ),
    }
}

#[test]
fn what_cannot_be_read_is_named_and_no_reason_against_another_series() {
    for number in 0..5 {
        let mut files = files(&slices(4), Syntax::Explicit);
        files.insert(2, unread(number));
        let found = converted(files).unwrap();
        assert_eq!(intensities(&found), plain(4));
        assert_eq!(found.ignored_files, 1);
        let [file] = &found.unread[..] else {
            panic!("{:?}", found.unread);
        };
        assert_eq!(file.file, 3);
        // Only what comes before the damage is known.
        let instance = [Some(70), None, Some(72), None, Some(74)][number];
        assert_eq!(file.instance, instance, "{number} {}", file.reason);
        assert_eq!(file.series.is_some(), instance.is_some() || number == 3);
        assert!(!file.reason.is_empty());
    }
}

#[test]
fn an_image_of_the_chosen_series_that_cannot_be_read_refuses_it() {
    for cut in [1, 20, 59, 72, 90] {
        let mut files = files(&slices(4), Syntax::Explicit);
        let shorter = files[1].len() - cut;
        files[1].truncate(shorter);
        let error = converted(files).unwrap_err();
        assert_eq!(error.kind(), "dicom-damaged");
        let text = error.to_string();
        assert!(
            text.contains("1 image of the series cannot be read: file 2 (instance number 3): "),
            "{text}"
        );
    }
    let mut all = files(&slices(3), Syntax::Explicit);
    all.iter_mut().for_each(|file| file.truncate(220));
    let text = converted(all).unwrap_err().to_string();
    assert!(
        text.starts_with("none of the images can be read: file 1: a DICOM file is damaged"),
        "{text}"
    );
}

#[test]
fn objects_that_are_no_images_are_ignored_beside_a_series() {
    let real_pixels = |class: &'static str| {
        let mut map = Slice::number(0);
        (map.sop_class, map.series_uid) = (class, "1.2.3.7".to_owned());
        let mut set = map.data_set(Syntax::Explicit);
        set.head([0x7FE0, 8], "OW", 120);
        let at = set.bytes.len() - 8;
        set.bytes[at..at + 2].copy_from_slice(b"OF");
        set.bytes.extend([0; 120]);
        set.file()
    };
    let map = "1.2.840.10008.5.1.4.1.1.30";
    let mr = "1.2.840.10008.5.1.4.1.1.4";
    for (object, is_image) in [(real_pixels(map), false), (real_pixels(mr), true)] {
        let mut files = files(&slices(4), Syntax::Explicit);
        files.push(object.clone());
        let found = converted(files).unwrap();
        assert_eq!(intensities(&found), plain(4));
        assert_eq!(
            (found.unread.len(), found.ignored_files),
            (0, usize::from(!is_image))
        );
        let alone = converted(vec![object]).unwrap_err();
        let kind = if is_image {
            "dicom-unsupported"
        } else {
            "dicom-no-images"
        };
        assert_eq!(alone.kind(), kind);
    }
}

#[test]
fn an_image_in_another_encoding_counts_once() {
    let others = [Syntax::Implicit, Syntax::BigEndian, Syntax::Rle];
    for syntax in others {
        let mut both = files(&slices(5), Syntax::Explicit);
        both.extend(files(&slices(5), syntax));
        let found = converted(both).unwrap();
        assert_eq!(intensities(&found), plain(5), "{syntax:?}");
        assert_eq!(found.series.size[2], 5);
        let mut some = files(&slices(5), Syntax::Explicit);
        some.extend(files(&slices(5)[1..3], syntax));
        assert_eq!(intensities(&converted(some).unwrap()), plain(5));
    }
    // Another file meta header.
    let exported = |file: &Vec<u8>| {
        let meta = element([2, 0x16], "AE", b"OTHER ");
        [&file[..meta_end(file)], &meta, &file[meta_end(file)..]].concat()
    };
    let mut twice = files(&slices(5), Syntax::Explicit);
    twice.extend(files(&slices(5), Syntax::Explicit).iter().map(exported));
    assert_eq!(intensities(&converted(twice).unwrap()), plain(5));
    // Other pixels, or another place, under one UID are not the same image.
    let mut other = slices(5);
    other[2].samples[4] += 1;
    let mut both = files(&slices(5), Syntax::Explicit);
    both.extend(files(&other[2..3], Syntax::Implicit));
    assert_eq!(converted(both).unwrap_err().kind(), "dicom-slices-doubled");
}

#[test]
fn what_is_missing_or_wrong_about_the_place_is_named() {
    let without = |tag: Tag| {
        let files = files(&slices(4), Syntax::Explicit);
        let files = files.iter().map(|file| {
            let (at, value) = find(file, tag);
            [&file[..at], &file[at + 8 + value.len()..]].concat()
        });
        converted(files.collect()).unwrap_err()
    };
    let with_text = |tag: Tag, text: &str| {
        let files = files(&slices(4), Syntax::Explicit);
        let files = files
            .iter()
            .map(|file| with(file, tag, "DS", |_| text.as_bytes().to_vec()));
        converted(files.collect()).unwrap_err()
    };
    for (error, words) in [
        (
            without(POSITION),
            "some slices lack Image Position (Patient)",
        ),
        (
            without(ORIENTATION),
            "some slices lack Image Orientation (Patient)",
        ),
        (without(SPACING), "some slices lack Pixel Spacing"),
        (
            with_text(POSITION, "1\\2 "),
            "Image Position (Patient) of some slices is not three numbers",
        ),
        (
            with_text(SPACING, "0\\1 "),
            "Pixel Spacing of some slices is not two positive numbers",
        ),
        (
            with_text(ORIENTATION, "0.98\\0.17\\0\\-0.17\\0.98\\0"),
            "perpendicular directions of length 1, to three decimals",
        ),
    ] {
        assert_eq!(error.kind(), "dicom-not-placed");
        assert!(error.to_string().contains(words), "{error}");
        assert!(
            error.to_string().contains("instance numbers 1, 2, 3, 4"),
            "{error}"
        );
    }
}

#[test]
fn slices_with_series_of_their_own_are_joined_if_that_is_asked_for() {
    let mut scattered = slices(5);
    for (number, slice) in scattered.iter_mut().enumerate() {
        slice.series_uid = format!("1.2.3.{}", 100 + number);
    }
    let error = converted(files(&scattered, Syntax::Explicit)).unwrap_err();
    assert_eq!(error.kind(), "dicom-series-scattered");
    assert!(
        error
            .to_string()
            .starts_with("5 series of one slice each have the number 4"),
        "{error}"
    );
    let asked = |name: &str| Options {
        series: SeriesName::parse(name),
        ..Options::default()
    };
    let joined = converted_with(files(&scattered, Syntax::Explicit), &asked("4")).unwrap();
    assert_eq!(intensities(&joined), plain(5));
    // One of another size, number or kind is none of them.
    let odd: [fn(&mut Slice); 3] = [
        |slice| slice.columns = 5,
        |slice| slice.series_number = 5,
        |slice| slice.sop_class = "1.2.840.10008.5.1.4.1.1.2",
    ];
    for change in odd {
        let mut slices = scattered.clone();
        change(&mut slices[2]);
        let error = converted(files(&slices, Syntax::Explicit)).unwrap_err();
        assert_eq!(error.kind(), "dicom-no-volume");
    }
    // Those of two patients are not joined.
    scattered[1].patient_id = "P-78";
    let error = converted_with(files(&scattered, Syntax::Explicit), &asked("4")).unwrap_err();
    assert_eq!(error.kind(), "dicom-mixed-patients");
    assert!(
        error.to_string().contains("differ in Patient ID"),
        "{error}"
    );
}

#[test]
fn odd_structures_are_read_as_other_readers_do() {
    let explicit = files(&slices(4), Syntax::Explicit);
    let implicit = files(&slices(4), Syntax::Implicit);
    let meta_of = |file: &Vec<u8>| file[..meta_end(file)].to_vec();
    let set_of = |file: &Vec<u8>| file[meta_end(file)..].to_vec();
    let mixed = |meta: &[Vec<u8>], sets: &[Vec<u8>]| -> Vec<Vec<u8>> {
        let pairs = meta.iter().zip(sets);
        pairs
            .map(|(meta, set)| [meta_of(meta), set_of(set)].concat())
            .collect()
    };
    let each = |change: &dyn Fn(&Vec<u8>) -> Vec<u8>| -> Vec<Vec<u8>> {
        explicit.iter().map(change).collect()
    };
    let implicit_meta = |file: &Vec<u8>| {
        let mut meta = DataSet::new(Syntax::Implicit);
        meta.text([2, 0x10], "UI", "1.2.840.10008.1.2.1");
        [vec![0; 128], b"DICM".to_vec(), meta.bytes, set_of(file)].concat()
    };
    let private = |inner: Vec<u8>, vr: &str| {
        let mut sequence = DataSet::new(Syntax::Explicit);
        sequence.head([0x19, 0x1010], vr, u32::MAX);
        sequence.delimiter(0xE000, u32::MAX);
        sequence.bytes.extend(inner);
        sequence.delimiter(0xE00D, 0);
        sequence.delimiter(0xE0DD, 0);
        sequence.bytes
    };
    let before = |more: Vec<u8>| each(&|file| with_before(file, [0x20, 0x0D], &more));
    let mut plain_implicit = DataSet::new(Syntax::Implicit);
    plain_implicit.text([0x19, 0x1011], "LO", "private");
    let odd_vr = |vr: &[u8], length: &[u8]| {
        [
            tag_bytes([0x19, 0x1010]),
            vr.to_vec(),
            length.to_vec(),
            b"abcd".to_vec(),
        ]
        .concat()
    };
    let kinds = [
        ("implicit meta information", each(&implicit_meta)),
        ("implicit, stated as explicit", mixed(&explicit, &implicit)),
        ("explicit, stated as implicit", mixed(&implicit, &explicit)),
        (
            "explicit items of unknown representation",
            before(private(element([0x19, 0x1011], "LO", b"private "), "UN")),
        ),
        (
            "implicit items in a sequence",
            before(private(plain_implicit.bytes, "SQ")),
        ),
        (
            "a private representation ??",
            before(odd_vr(b"??", &[4, 0])),
        ),
        (
            "a private representation of zeros",
            before(odd_vr(&[0, 0], &[4, 0])),
        ),
        (
            "a private representation in lower case",
            before(odd_vr(b"lo", &[4, 0])),
        ),
        (
            "an implicit private element",
            before(odd_vr(&[4, 0], &[0, 0])),
        ),
        ("the magic word first", each(&|file| file[128..].to_vec())),
        (
            "no magic word",
            each(&|file| [&file[..128], &file[132..]].concat()),
        ),
        ("no preamble", each(&|file| file[132..].to_vec())),
        (
            "a bare data set with the magic word in it",
            each(&|file| {
                let set = set_of(file);
                let at = set
                    .windows(4)
                    .position(|window| window == tag_bytes([8, 0x16]))
                    .unwrap();
                let filler = 128 - at - 8;
                let text = [
                    vec![b' '; filler],
                    b"DICM".to_vec(),
                    vec![b' '; 2 + filler % 2],
                ]
                .concat();
                [&set[..at], &element([8, 0x15], "LT", &text)[..], &set[at..]].concat()
            }),
        ),
    ];
    for (what, files) in kinds {
        let found = converted(files).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(intensities(&found), plain(4), "{what}");
        assert_eq!(found.ignored_files, 0, "{what}");
    }
}

/// The functional groups of an Enhanced image with an unknown representation and implicit items, as a node writes that does not
/// know them.
fn with_unknown_groups(file: &[u8], slices: &[Slice], components: [&str; 2]) -> Vec<u8> {
    let list = |values: &[f64]| {
        let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
        texts.join("\\")
    };
    let group = |tag: Tag, inner: Tag, text: &str| {
        let mut item = DataSet::new(Syntax::Implicit);
        item.text(inner, "DS", text);
        let mut sequence = DataSet::new(Syntax::Implicit);
        sequence.head(tag, "SQ", item.bytes.len() as u32 + 8);
        sequence.delimiter(0xE000, item.bytes.len() as u32);
        sequence.bytes.extend(item.bytes);
        sequence.bytes
    };
    let items = |all: Vec<Vec<u8>>| {
        let mut items = DataSet::new(Syntax::Implicit);
        for item in all {
            items.delimiter(0xE000, item.len() as u32);
            items.bytes.extend(item);
        }
        items.bytes
    };
    let first = &slices[0];
    let shared = items(vec![
        [
            group([0x20, 0x9116], ORIENTATION, &list(&first.orientation)),
            group([0x28, 0x9110], SPACING, &list(&first.spacing)),
        ]
        .concat(),
    ]);
    let frames = slices.iter().enumerate().map(|(number, slice)| {
        let component = components[number * 2 / slices.len()];
        let kind = group([0x18, 0x9226], [8, 0x9208], component);
        [
            kind,
            group([0x20, 0x9113], POSITION, &list(&slice.position)),
        ]
        .concat()
    });
    let frames = items(frames.collect());
    let at = |tag: Tag| {
        file.windows(4)
            .position(|window| window == tag_bytes(tag))
            .unwrap()
    };
    [
        &file[..at([0x5200, 0x9229])],
        &element([0x5200, 0x9229], "UN", &shared),
        &element([0x5200, 0x9230], "UN", &frames),
        &file[at([0x7FE0, 0x10])..],
    ]
    .concat()
}

#[test]
fn functional_groups_of_an_unknown_representation_are_read() {
    for count in [3, 4, 7] {
        let mut slices = slices(count);
        let file = with_unknown_groups(&enhanced(&slices), &slices, ["MAGNITUDE"; 2]);
        assert_eq!(intensities(&converted(vec![file]).unwrap()), plain(count));
        slices.reverse();
        let file = with_unknown_groups(&enhanced(&slices), &slices, ["MAGNITUDE"; 2]);
        assert_eq!(intensities(&converted(vec![file]).unwrap()), plain(count));
    }
    let twice = [slices(8), slices(8)].concat();
    let file = with_unknown_groups(&enhanced(&twice), &twice, ["MAGNITUDE", "PHASE"]);
    let refused = converted(vec![file]).unwrap_err().to_string();
    let difference = "differ in complex image component, such as magnitude and phase";
    assert!(refused.contains(difference), "{refused}");
}

#[test]
fn positions_with_one_decimal_on_an_oblique_series_are_in_line() {
    let turned = |decimals: f64, angles: [f64; 3], step: f64| {
        let rotation =
            glam::DMat3::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
        let mut slices = slices(40);
        for (number, slice) in slices.iter_mut().enumerate() {
            let place = rotation * glam::DVec3::new(-10.0, -20.0, 30.0 + step * number as f64);
            slice.position = place
                .to_array()
                .map(|number| (number * decimals).round() / decimals);
            let [row, column] = [rotation.x_axis, rotation.y_axis];
            slice.orientation = [row.x, row.y, row.z, column.x, column.y, column.z];
        }
        converted(files(&slices, Syntax::Explicit))
    };
    for angles in [
        [0.19, -0.12, 0.09],
        [0.4, 0.3, -0.2],
        [0.05, 0.02, 0.0],
        [-0.7, 0.1, 0.5],
        [0.01, -0.3, 1.2],
    ] {
        for (decimals, step) in [(10.0, 2.0), (10.0, 1.0), (100.0, 1.0), (1e6, 0.8)] {
            turned(decimals, angles, step)
                .unwrap_or_else(|error| panic!("{angles:?} {step}: {error}"));
        }
    }
    // A slice that was moved by more than rounding is found.
    let mut moved = slices(40);
    for (number, slice) in moved.iter_mut().enumerate() {
        slice.position[1] += 0.1 * number as f64 * 0.02;
    }
    moved[20].position[0] += 0.4;
    assert_eq!(
        converted(files(&moved, Syntax::Explicit))
            .unwrap_err()
            .kind(),
        "dicom-slice-shifted"
    );
}
