//! Texts in several character sets: all readers find what a file in UTF-8 states.

use imaging::Limits;
use imaging::dicom::{Options, attributes, convert, deidentified_file, fingerprint, identify};

use crate::series_builder::{DataSet, Slice, Syntax, slices};

const NAME: &str = "Yamada^Tarou=山田^太郎=やまだ^たろう";
const NAME_IN_JIS: &[u8] =
    b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B=\x1b$B$d$^$@\x1b(B^\x1b$B$?$m$&\x1b(B";
const MANUFACTURER: &str = "東芝 顎";
const MANUFACTURER_IN_JIS: &[u8] = b"\x1b$BEl<G\x1b(B \x1b$B3\\\x1b(B";

/// A slice of this patient.
fn file(slice: &Slice, syntax: Syntax, sets: &str, name: &[u8], manufacturer: &[u8]) -> Vec<u8> {
    let even = |text: &[u8]| {
        let padding = text.len() % 2;
        [text, &b" "[..padding]].concat()
    };
    let plain = slice.data_set(syntax).bytes;
    let element = |tag: [u16; 2], vr: &str, value: &[u8]| {
        let mut set = DataSet::new(syntax);
        set.bytes(tag, vr, &even(value));
        set.bytes
    };
    let manufacturer = element([8, 0x70], "LO", manufacturer);
    let old_name = element([0x10, 0x10], "PN", b"Somebody^Secret");
    let mut set = DataSet::new(syntax);
    let at = |needle: &[u8]| {
        let mut windows = plain.windows(needle.len());
        windows.position(|bytes| bytes == needle).unwrap()
    };
    let description = element([8, 0x103E], "LO", slice.description.as_bytes());
    let (description, name_at) = (at(&description), at(&old_name));
    set.bytes
        .extend_from_slice(&element([8, 5], "CS", sets.as_bytes()));
    set.bytes.extend_from_slice(&plain[..description]);
    set.bytes.extend_from_slice(&manufacturer);
    set.bytes.extend_from_slice(&plain[description..name_at]);
    set.bytes
        .extend_from_slice(&element([0x10, 0x10], "PN", name));
    set.bytes
        .extend_from_slice(&plain[name_at + old_name.len()..]);
    let samples = set.samples(&slice.samples);
    set.bytes([0x7FE0, 0x10], "OW", &samples);
    set.file()
}

fn in_jis(slice: &Slice, syntax: Syntax) -> Vec<u8> {
    let sets = r"\ISO 2022 IR 87";
    file(slice, syntax, sets, NAME_IN_JIS, MANUFACTURER_IN_JIS)
}

fn in_utf_8(slice: &Slice) -> Vec<u8> {
    let [name, manufacturer] = [NAME, MANUFACTURER].map(str::as_bytes);
    file(slice, Syntax::Explicit, "ISO_IR 192", name, manufacturer)
}

#[test]
fn a_file_with_code_extensions_states_what_the_same_file_in_utf_8_states() {
    let slices = slices(3);
    for syntax in [Syntax::Implicit, Syntax::Explicit, Syntax::BigEndian] {
        let (one, other) = (in_jis(&slices[0], syntax), in_utf_8(&slices[0]));
        assert_eq!(fingerprint(&one).unwrap(), fingerprint(&other).unwrap());
        let stated = attributes(&one).unwrap();
        assert_eq!(stated.value("PatientName"), Some(NAME));
        assert_eq!(stated, attributes(&other).unwrap());
        assert_eq!(identify(&one).unwrap(), identify(&other).unwrap());
        let options = Options::default();
        let mut files: Vec<_> = slices.iter().map(|slice| in_jis(slice, syntax)).collect();
        let converted = convert(&mut files, &options, &Limits::default()).unwrap();
        assert_eq!(converted.attributes.value("PatientName"), Some(NAME));
        assert_eq!(
            converted.attributes.value("Manufacturer"),
            Some(MANUFACTURER)
        );
    }
}

#[test]
fn other_kanji_are_another_patient() {
    let slice = &slices(1)[0];
    let one = in_jis(slice, Syntax::Explicit);
    let sets = r"\ISO 2022 IR 87";
    let name = NAME_IN_JIS.escape_ascii().to_string();
    assert!(name.contains(";3ED"));
    let mut other = NAME_IN_JIS.to_vec();
    let at = other.windows(4).position(|four| four == b";3ED").unwrap();
    // One that no table has.
    for kanji in [b";3EE", b"\x75\x21ED", b"\x75\x22ED"] {
        other[at..at + 4].copy_from_slice(kanji);
        let other = file(slice, Syntax::Explicit, sets, &other, MANUFACTURER_IN_JIS);
        assert_ne!(fingerprint(&one).unwrap(), fingerprint(&other).unwrap());
    }
}

#[test]
fn a_file_that_is_written_again_states_the_new_character_set_of_its_texts() {
    let slice = &slices(1)[0];
    let one = in_jis(slice, Syntax::BigEndian);
    let nameless = deidentified_file(&one).unwrap();
    let stated = attributes(&nameless).unwrap();
    assert_eq!(stated.value("Manufacturer"), Some(MANUFACTURER));
    let expected = MANUFACTURER.as_bytes();
    assert!(
        nameless
            .windows(expected.len())
            .any(|bytes| bytes == expected)
    );
}
