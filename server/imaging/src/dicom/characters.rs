//! Texts with code extensions: values in several character sets, with escape sequences between them (ISO 2022).
//!
//! A byte below 80 (hexadecimal) belongs to the set in G0, any other byte to the set in G1. An escape sequence replaces one
//! of the two. At the end of a line, of a value or of a part of a name, those of the first value of Specific Character Set
//! hold again. `dicom-object` knows only this first value, so the bytes of the texts are read one by one and decoded here.
//!
//! Source: PS3.5 §6.1.2.5 and PS3.3 §C.12.1.1.2.

use std::borrow::Cow;

use dicom_core::value::PrimitiveValue;
use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use encoding_rs::{
    EUC_JP, EUC_KR, Encoding, GB18030, GBK, ISO_8859_2, ISO_8859_3, ISO_8859_4, ISO_8859_5,
    ISO_8859_6, ISO_8859_7, ISO_8859_8, ISO_8859_15, SHIFT_JIS, UTF_8, WINDOWS_874, WINDOWS_1252,
    WINDOWS_1254,
};

const ESCAPE: u8 = 0x1B;

/// A character set besides ASCII, as a part of an encoding.
#[derive(Debug, Clone, Copy)]
struct Set {
    encoding: &'static Encoding,
    /// What the encoding has before a character of this set.
    prefix: &'static [u8],
    /// The longest character, in bytes.
    longest: usize,
}

impl Set {
    const fn new(encoding: &'static Encoding, longest: usize) -> Self {
        Self {
            encoding,
            prefix: b"",
            longest,
        }
    }

    /// The first character of `bytes`, of which the first is not ASCII, and its length; `None` if there is none.
    fn first(self, bytes: &[u8]) -> Option<(char, usize)> {
        let lengths = 1..=self.longest.min(bytes.len());
        lengths.into_iter().find_map(|length| {
            let whole = [self.prefix, &bytes[..length]].concat();
            let encoding = self.encoding;
            let text = encoding.decode_without_bom_handling_and_without_replacement(&whole)?;
            let mut letters = text.chars();
            match (letters.next(), letters.next()) {
                (Some(letter), None) if !letter.is_control() => Some((letter, length)),
                _ => None,
            }
        })
    }
}

/// JIS X 0208, with the highest bits set.
const KANJI: Set = Set::new(EUC_JP, 2);
/// JIS X 0212, with the highest bits set.
const SUPPLEMENTARY_KANJI: Set = Set {
    encoding: EUC_JP,
    prefix: b"\x8F",
    longest: 2,
};
/// The right half of JIS X 0201.
const KATAKANA: Set = Set::new(SHIFT_JIS, 1);
const KOREAN: Set = Set::new(EUC_KR, 2);
const CHINESE: Set = Set::new(GBK, 2);

/// The sets in G0, which is ASCII if it is `None`, and in G1.
#[derive(Debug, Clone, Copy)]
struct Sets {
    left: Option<Set>,
    right: Option<Set>,
}

/// What an escape sequence changes.
enum Change {
    Left(Option<Set>),
    Right(Set),
}

/// The change that an escape sequence makes, and its length without the escape; `None` if it is unknown.
fn change(after_escape: &[u8]) -> Option<(Change, usize)> {
    const fn bytes(encoding: &'static Encoding) -> Change {
        Change::Right(Set::new(encoding, 1))
    }
    let known = [
        (&b"(B"[..], Change::Left(None)),
        // JIS X 0201 differs from ASCII in how the backslash and the tilde look.
        (b"(J", Change::Left(None)),
        (b"$B", Change::Left(Some(KANJI))),
        (b"$(D", Change::Left(Some(SUPPLEMENTARY_KANJI))),
        (b")I", Change::Right(KATAKANA)),
        (b"$)C", Change::Right(KOREAN)),
        (b"$)A", Change::Right(CHINESE)),
        (b"-A", bytes(WINDOWS_1252)),
        (b"-B", bytes(ISO_8859_2)),
        (b"-C", bytes(ISO_8859_3)),
        (b"-D", bytes(ISO_8859_4)),
        (b"-F", bytes(ISO_8859_7)),
        (b"-G", bytes(ISO_8859_6)),
        (b"-H", bytes(ISO_8859_8)),
        (b"-L", bytes(ISO_8859_5)),
        (b"-M", bytes(WINDOWS_1254)),
        (b"-T", bytes(WINDOWS_874)),
        (b"-b", bytes(ISO_8859_15)),
    ];
    let found = known
        .into_iter()
        .find(|(sequence, _)| after_escape.starts_with(sequence));
    found.map(|(sequence, change)| (change, sequence.len()))
}

/// The set that the first value of Specific Character Set puts into G1.
fn initial(terms: &str) -> Option<Set> {
    let first = terms.split('\\').next().unwrap_or_default().trim();
    let first = first.to_ascii_uppercase();
    let registration = first
        .strip_prefix("ISO_IR")
        .or_else(|| first.strip_prefix("ISO 2022 IR"));
    let number = registration.map(|number| number.trim_matches([' ', '_']));
    let encoding = match number.unwrap_or(&first) {
        "13" => return Some(KATAKANA),
        "149" => return Some(KOREAN),
        "58" => return Some(CHINESE),
        "192" => return Some(Set::new(UTF_8, 4)),
        "GB18030" | "GBK" => return Some(Set::new(GB18030, 4)),
        "100" => WINDOWS_1252,
        "101" => ISO_8859_2,
        "109" => ISO_8859_3,
        "110" => ISO_8859_4,
        "126" => ISO_8859_7,
        "127" => ISO_8859_6,
        "138" => ISO_8859_8,
        "144" => ISO_8859_5,
        "148" => WINDOWS_1254,
        "166" => WINDOWS_874,
        "203" => ISO_8859_15,
        _ => return None,
    };
    Some(Set::new(encoding, 1))
}

/// Whether `dicom-object` cannot decode texts in these character sets: there are several, or it has no table for the only one.
pub(super) fn needs_decoding(terms: &[u8]) -> bool {
    let terms = terms.trim_ascii();
    terms.contains(&b'\\')
        || terms.starts_with(b"ISO 2022 IR")
        || matches!(terms, b"ISO_IR 148" | b"ISO_IR 203")
}

/// Hides a value of Specific Character Set from `dicom-object`, which then reads each byte of a text as a character of Latin 1.
pub(super) fn hide(terms: &mut [u8]) {
    // It compares the case of letters; `initial` does not.
    terms.make_ascii_lowercase();
}

/// Decodes the texts of a data set that was read with its character sets [hidden](hide). An item without character sets has
/// those around it.
pub(super) fn decode_texts(object: &mut InMemDicomObject, inherited: &str) {
    let own = object.get(tags::SPECIFIC_CHARACTER_SET);
    let own = own.and_then(|element| element.to_str().ok());
    let has_own = own.is_some();
    let terms = own.map_or_else(|| inherited.to_owned(), Cow::into_owned);
    let right = initial(&terms);
    let elements: Vec<(Tag, VR)> = object
        .iter()
        .map(|element| (element.header().tag, element.vr()))
        .collect();
    for (tag, vr) in elements {
        object.update_value(tag, |value| {
            if let Some(items) = value.items_mut() {
                items.iter_mut().for_each(|item| decode_texts(item, &terms));
            } else if let Some(value) = value.primitive_mut()
                && let Some(text) = decoded(value, vr, right)
            {
                *value = text;
            }
        });
    }
    if has_own {
        object.update_value(tags::SPECIFIC_CHARACTER_SET, |value| {
            *value = PrimitiveValue::from("ISO_IR 192").into();
        });
    }
}

/// A text whose characters are bytes, decoded; `None` if the representation of the value is always in ASCII.
fn decoded(value: &PrimitiveValue, vr: VR, right: Option<Set>) -> Option<PrimitiveValue> {
    let delimiters: &[u8] = match vr {
        VR::PN => b"^=\\",
        VR::LO | VR::SH | VR::UC => b"\\",
        VR::LT | VR::ST | VR::UT => b"",
        _ => return None,
    };
    // A second byte of a character may look like a backslash, so the whole value is one text here.
    let bytes: Vec<u8> = value
        .to_raw_str()
        .chars()
        .map(|letter| letter as u8)
        .collect();
    let text = decode(&bytes, right, delimiters);
    Some(match delimiters {
        b"" => PrimitiveValue::Str(text),
        _ => PrimitiveValue::Strs(text.split('\\').map(str::to_owned).collect()),
    })
}

/// The text in `bytes`. What cannot be decoded becomes hexadecimal numbers in angle brackets, so that different texts stay
/// different.
fn decode(bytes: &[u8], right: Option<Set>, delimiters: &[u8]) -> String {
    let first = Sets { left: None, right };
    let (mut sets, mut text, mut rest) = (first, String::new(), bytes);
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        if byte == ESCAPE
            && let Some((change, length)) = change(after)
        {
            match change {
                Change::Left(set) => sets.left = set,
                Change::Right(set) => sets.right = Some(set),
            }
            rest = &after[length..];
        } else if byte == ESCAPE {
            push_undecodable(&mut text, &[byte]);
        } else if byte < 0x20 || (sets.left.is_none() && delimiters.contains(&byte)) {
            sets = first;
            text.push(byte.into());
        } else {
            let length = push_character(&mut text, sets, byte, after);
            rest = &after[length - 1..];
        }
    }
    text
}

/// Writes the character that begins with `byte`, and returns its length in bytes.
fn push_character(text: &mut String, sets: Sets, byte: u8, after: &[u8]) -> usize {
    let is_left = byte < 0x80;
    let (Some(set), false) = (
        if is_left { sets.left } else { sets.right },
        matches!(byte, b' ' | 0x7F),
    ) else {
        match byte {
            0x80..0xA0 => push_undecodable(text, &[byte]),
            // Without a set in G1, Latin 1 is meant most often.
            _ => text.push(byte.into()),
        }
        return 1;
    };
    let mut raw = vec![byte];
    raw.extend(after.iter().take(set.longest - 1));
    let mut whole = raw.clone();
    if is_left {
        whole.iter_mut().for_each(|byte| *byte |= 0x80);
    }
    // The sets of two bytes have second bytes above 80; extensions of them also have letters, but no delimiters.
    let is_graphic = |&second: &u8| match is_left {
        true => (0x21..0x7F).contains(&second),
        false => second > 0x80 || second.is_ascii_alphabetic(),
    };
    if set.longest == 2 && !raw.get(1).is_some_and(is_graphic) {
        push_undecodable(text, &raw[..1]);
        return 1;
    }
    match set.first(&whole) {
        Some((letter, length)) => {
            text.push(if is_left {
                of_standard(set, letter)
            } else {
                letter
            });
            length
        }
        // A character of a manufacturer or a user: what follows it is read as before.
        None if set.longest == 2 && (is_left || raw[1] > 0x80) => {
            push_undecodable(text, &raw);
            2
        }
        None => {
            push_undecodable(text, &raw[..1]);
            1
        }
    }
}

fn push_undecodable(text: &mut String, bytes: &[u8]) {
    for byte in bytes {
        text.push_str(&format!("<{byte:02X}>"));
    }
}

/// A character of a Japanese set as in the tables of Unicode, from which those of the Web differ in these places.
fn of_standard(set: Set, letter: char) -> char {
    match letter {
        '\u{FF5E}' if set.prefix.is_empty() => '\u{301C}',
        '\u{FF5E}' => '~',
        '\u{2225}' => '\u{2016}',
        '\u{FF0D}' => '\u{2212}',
        '\u{FFE0}' => '\u{A2}',
        '\u{FFE1}' => '\u{A3}',
        '\u{FFE2}' => '\u{AC}',
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A name with the character sets in `terms`.
    fn name(terms: &str, bytes: &[u8]) -> String {
        decode(bytes, initial(terms), b"^=\\")
    }

    #[test]
    fn the_names_of_the_standard_are_decoded() {
        for (terms, bytes, expected) in [
            // PS3.5 H.3.1 and H.3.2.
            (
                r"\ISO 2022 IR 87",
                &b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B=\x1b$B$d$^$@\x1b(B^\x1b$B$?$m$&\x1b(B"[..],
                "Yamada^Tarou=山田^太郎=やまだ^たろう",
            ),
            (
                r"ISO 2022 IR 13\ISO 2022 IR 87",
                b"\xd4\xcf\xc0\xde^\xc0\xdb\xb3=\x1b$B;3ED\x1b(J^\x1b$BB@O:\x1b(J=\x1b$B$d$^$@\x1b(J^\x1b$B$?$m$&\x1b(J",
                "ﾔﾏﾀﾞ^ﾀﾛｳ=山田^太郎=やまだ^たろう",
            ),
            // I.2.
            (
                r"\ISO 2022 IR 149",
                b"Hong^Gildong=\x1b$)C\xfb\xf3^\x1b$)C\xd1\xce\xd4\xd7=\x1b$)C\xc8\xab^\x1b$)C\xb1\xe6\xb5\xbf",
                "Hong^Gildong=洪^吉洞=홍^길동",
            ),
            // K.2.
            (
                r"\ISO 2022 IR 58",
                b"Zhang^XiaoDong=\x1b$)A\xd5\xc5^\x1b$)A\xd0\xa1\xb6\xab=",
                "Zhang^XiaoDong=张^小东=",
            ),
            // Sets of one byte.
            (
                r"\ISO 2022 IR 100\ISO 2022 IR 144",
                b"J\x1b-A\xe9r\xf4me^\x1b-L\xbb\xee\xda",
                "Jérôme^Люк",
            ),
            (
                r"ISO 2022 IR 100\ISO 2022 IR 126",
                b"J\xe9r\xf4me^\x1b-F\xc4\xe9\xef",
                "Jérôme^Διο",
            ),
            (r"\ISO 2022 IR 148", b"\x1b-M\xddpek", "İpek"),
            (r"\ISO 2022 IR 166", b"\x1b-T\xca\xc1", "สม"),
            (r"\ISO 2022 IR 87", b"\x1b$B!A!]\x1b(B^A", "〜−^A"),
            // JIS X 0212.
            (r"\ISO 2022 IR 159", b"\x1b$(D\x30\x21\x1b(B^A", "丂^A"),
            // Sets that stand alone, although another one is stated.
            (r"ISO_IR 192\ISO 2022 IR 87", "王^小東".as_bytes(), "王^小東"),
            (r"GB18030\ISO 2022 IR 58", b"\xcd\xf5^\xd0\xa1\xb6\xab", "王^小东"),
            // The usual misuse: the right bytes without their escape sequence.
            (r"\ISO 2022 IR 100", b"M\xfcller", "Müller"),
        ] {
            assert_eq!(name(terms, bytes), expected, "{terms}");
        }
    }

    #[test]
    fn sets_return_at_delimiters_and_at_the_end_of_a_line() {
        // PS3.5 I.3.
        let text = b"\x1b$)CThe 1st line includes \xb1\xe6\xb5\xbf.\r\n\x1b$)CThe 2nd line includes \xb1\xe6\xb5\xbf, too.\r\nThe 3rd line";
        assert_eq!(
            decode(text, None, b""),
            "The 1st line includes 길동.\r\nThe 2nd line includes 길동, too.\r\nThe 3rd line"
        );
        assert_eq!(name(r"\ISO 2022 IR 144", b"\x1b-L\xbb^\xbb"), "Л^»");
        // A text has no parts of a name.
        assert_eq!(decode(b"\x1b-L\xbb^\xbb", None, b"\\"), "Л^Л");
        // The second byte of a character may look like a delimiter.
        assert_eq!(name("", b"\x1b$B\x24\x5e\x33\x5c\x1b(B"), "ま顎");
    }

    #[test]
    fn what_cannot_be_decoded_stays_different_and_harms_nothing_behind_it() {
        for (bytes, expected) in [
            (&b"A\x1b"[..], "A<1B>"),
            (b"A\x1b%GB", "A<1B>%GB"),
            (b"\x1b$B;3\x75\x21ED\x1b(B", "山<75><21>田"),
            (b"\x1b$B;3E", "山<45>"),
            (b"\x1b$)C\xfb", "<FB>"),
            (b"\x1b$)C\xfb^\x1b$)C\xfb\xf3", "<FB>^洪"),
            (b"\x1b-C\xa5\xa6", "<A5>Ĥ"),
            (b"\x90", "<90>"),
        ] {
            assert_eq!(name("", bytes), expected, "{bytes:x?}");
        }
    }

    #[test]
    fn any_bytes_have_a_text_without_control_characters_of_their_own() {
        let escapes: [&[u8]; 6] = [
            b"", b"\x1b$B", b"\x1b$(D", b"\x1b$)C", b"\x1b$)A", b"\x1b)I",
        ];
        for escape in escapes {
            for one in 0..=255 {
                for other in 0..=255 {
                    let text = name("", &[escape, &[one, other]].concat());
                    let stray = text.chars().find(|letter| letter.is_control());
                    assert!(stray.is_none_or(|letter| letter < ' ' || letter == '\x7f'));
                }
            }
        }
    }

    #[test]
    fn only_what_the_parser_cannot_decode_is_decoded_here() {
        for (terms, expected) in [
            (&br"\ISO 2022 IR 87"[..], true),
            (b"ISO 2022 IR 149", true),
            (b"ISO_IR 148", true),
            (b"ISO_IR 100", false),
            (b"ISO_IR 192 ", false),
            (b"GB18030", false),
            (b"", false),
        ] {
            assert_eq!(needs_decoding(terms), expected);
        }
    }
}
