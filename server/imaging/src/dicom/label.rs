//! The label of a series in lists.

use unicode_normalization::UnicodeNormalization;
use unicode_normalization::char::is_combining_mark;

use super::attributes::Attributes;
use super::deidentify::kind_of_series;

/// The longest description in a label, in characters: the most that the standard allows (PS3.5 §6.2, LO).
const MAX_DESCRIPTION: usize = 64;

/// The shortest part of a name or an id that is looked for within words, in characters.
const MIN_PART: usize = 3;

/// As [`MIN_PART`], in scripts without spaces.
const MIN_IDEOGRAPHS: usize = 2;

impl Attributes {
    /// What lists call the series: description or protocol, and the date of the study; `None` if they state none of these.
    pub fn label(&self) -> Option<String> {
        series_label(|keyword| self.value(keyword).map(str::to_owned))
    }
}

/// A label for a series, from its attributes by keyword: description or protocol, and the date of the study.
///
/// Of a description that names the patient, only the words for kinds of sequences are used.
/// `None` if the attributes state neither description nor protocol nor date.
pub(super) fn series_label(value: impl Fn(&str) -> Option<String>) -> Option<String> {
    let value = |keyword: &str| {
        let text = value(keyword).unwrap_or_default();
        text.trim().to_owned()
    };
    let names = ["SeriesDescription", "ProtocolName"].map(value);
    let description = names.into_iter().find(|name| !name.is_empty());
    let patient = ["PatientName", "PatientID", "PatientBirthDate"].map(value);
    let description = description.map(|text| match names_somebody(&text, &patient) {
        true => kind_of_series(&text),
        false => text.chars().take(MAX_DESCRIPTION).collect(),
    });
    let date = day(&value("StudyDate"));
    if description.is_none() && date.is_none() {
        return None;
    }
    let description = description.filter(|text| !text.is_empty());
    let first = description.unwrap_or_else(|| value("Modality"));
    let parts = [Some(first), date];
    let parts = parts.into_iter().flatten().filter(|part| !part.is_empty());
    Some(parts.collect::<Vec<_>>().join(" · ")).filter(|label| !label.is_empty())
}

/// Whether a text contains a part of the name or the id, or the date of birth.
fn names_somebody(text: &str, [name, id, birth_date]: &[String; 3]) -> bool {
    contains_date(text, birth_date)
        || spellings(text).iter().any(|text| {
            let mut ids = words(id).into_iter().flat_map(|part| {
                let number = part.trim_start_matches('0').to_owned();
                [part, number]
            });
            let mut names = spellings(name).into_iter();
            ids.any(|part| contains_part(text, &part))
                || names.any(|name| contains_name(text, &name))
        })
}

fn contains_name(text: &str, name: &str) -> bool {
    let parts = words(name);
    let of_text = words(text);
    let is_word = |part: &&String| of_text.contains(part);
    let mut whole: Vec<&String> = parts.iter().filter(is_word).collect();
    whole.sort_unstable();
    whole.dedup();
    let is_joined = || {
        let mut pairs = parts
            .iter()
            .flat_map(|one| parts.iter().map(move |other| (one, other)));
        pairs.any(|(one, other)| one != other && of_text.contains(&format!("{one}{other}")))
    };
    parts.iter().any(|part| contains_part(text, part))
        || (whole.len() > 1 && whole.iter().any(|part| part.chars().count() > 1))
        || is_joined()
}

/// Whether a part is within a text, if it is long enough to mean somebody.
fn contains_part(text: &str, part: &str) -> bool {
    let has_no_spaces = |letter: char| letter >= '\u{2E80}';
    let shortest = match part.contains(has_no_spaces) {
        true => MIN_IDEOGRAPHS,
        false => MIN_PART,
    };
    part.chars().count() >= shortest && text.contains(part)
}

/// Whether a text contains a date (DA): the year first, the day first or the month first, with or without separators.
fn contains_date(text: &str, date: &str) -> bool {
    let Some([year, month, day]) = parts_of_date(date) else {
        return false;
    };
    let is_separator = |letter: char| matches!(letter, '-' | '.' | '/' | '_' | ' ');
    let text = text.replace(is_separator, "");
    let orders = [[year, month, day], [day, month, year], [month, day, year]];
    orders.iter().any(|order| text.contains(&order.concat()))
}

/// A text in small letters without accents, and with the digraphs that stand for some letters with accents.
fn spellings(text: &str) -> [String; 2] {
    let text: String = text.nfkc().flat_map(char::to_lowercase).nfc().collect();
    let mut digraphs = String::new();
    for letter in text.chars() {
        match letter {
            'ä' => digraphs.push_str("ae"),
            'ö' => digraphs.push_str("oe"),
            'ü' => digraphs.push_str("ue"),
            'å' => digraphs.push_str("aa"),
            'ø' => digraphs.push_str("oe"),
            _ => digraphs.push(letter),
        }
    }
    [text, digraphs].map(|text| without_accents(&text))
}

fn without_accents(text: &str) -> String {
    let mut plain = String::new();
    for letter in text.nfd().filter(|&letter| !is_combining_mark(letter)) {
        match letter {
            'ß' => plain.push_str("ss"),
            'æ' => plain.push_str("ae"),
            'œ' => plain.push_str("oe"),
            'þ' => plain.push_str("th"),
            'ø' => plain.push('o'),
            'ł' => plain.push('l'),
            'đ' | 'ð' => plain.push('d'),
            'ı' => plain.push('i'),
            _ => plain.push(letter),
        }
    }
    // Syllables of Korean are whole again.
    plain.nfc().collect()
}

/// What stands between anything but letters and digits.
fn words(text: &str) -> Vec<String> {
    let words = text.split(|letter: char| !letter.is_alphanumeric());
    let words = words.filter(|word| !word.is_empty());
    words.map(str::to_lowercase).collect()
}

/// Year, month and day of a date (DA).
fn parts_of_date(date: &str) -> Option<[&str; 3]> {
    let is_date = date.len() == 8 && date.bytes().all(|byte| byte.is_ascii_digit());
    is_date.then(|| [&date[..4], &date[4..6], &date[6..]])
}

/// A date (DA) as in ISO 8601.
fn day(date: &str) -> Option<String> {
    parts_of_date(date).map(|parts| parts.join("-"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(attributes: &[(&str, &str)]) -> Option<String> {
        series_label(|keyword| {
            let found = attributes.iter().find(|(name, _)| *name == keyword);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn a_label_has_the_description_or_the_protocol_and_the_date() {
        let date = ("StudyDate", "20260102");
        let protocol = ("ProtocolName", "epilepsy_t1");
        for (attributes, expected) in [
            (
                &[("SeriesDescription", " T1 MPRAGE "), protocol, date][..],
                Some("T1 MPRAGE · 2026-01-02"),
            ),
            (&[protocol, ("StudyDate", "2026")], Some("epilepsy_t1")),
            (&[("Modality", "MR"), date], Some("MR · 2026-01-02")),
            (&[date], Some("2026-01-02")),
            (&[("Modality", "MR")], None),
            (&[], None),
        ] {
            assert_eq!(label(attributes).as_deref(), expected, "{attributes:?}");
        }
    }

    #[test]
    fn a_description_that_names_the_patient_is_not_used() {
        let patient = [
            ("PatientName", "Doe^Jane"),
            ("PatientID", "P-4711"),
            ("Modality", "MR"),
        ];
        for (description, expected) in [
            ("JANE t1 mprage", "t1 mprage · 2026-01-02"),
            ("scan of 4711", "MR · 2026-01-02"),
            ("t1 P", "t1 P · 2026-01-02"),
        ] {
            let own = [
                ("SeriesDescription", description),
                ("StudyDate", "20260102"),
            ];
            let attributes = [&patient[..], &own].concat();
            assert_eq!(label(&attributes).as_deref(), Some(expected));
        }
    }

    #[test]
    fn other_spellings_of_the_patient_are_found() {
        let named = |name: &str, id: &str, text: &str| {
            let patient = [name, id, "19700131"].map(str::to_owned);
            names_somebody(text, &patient)
        };
        for (name, id, text) in [
            ("Li^Bo", "8", "T1 Li Bo"),
            ("Li^Bo", "8", "t1_bo_li"),
            ("Li^Bo", "8", "T1 LiBo"),
            ("Müller^Änne", "9", "T1 Mueller"),
            ("Müller^Änne", "9", "T1 MULLER"),
            ("Müller^Änne", "9", "T1 mu\u{308}ller"),
            ("Mu\u{308}ller^Änne", "9", "T1 MÜLLER"),
            ("Mueller^Anne", "9", "T1 Müller"),
            ("Weiß^Ida", "9", "T1 WEISS"),
            ("Łukasiewicz^Ida", "9", "Lukasiewicz t1"),
            ("O'Brien^Pat", "9", "t1 obrien"),
            ("Wang^XiaoDong=王^小东", "9", "t1 王小东"),
            ("Hong^Gildong=洪^吉洞=홍^길동", "9", "t1 홍길동"),
            ("Silva^Ana", "0100017", "T1 MPRAGE 100017"),
            ("Silva^Ana", "100017", "T1-0100017"),
            ("Silva^Ana", "5", "T1 19700131"),
            ("Silva^Ana", "5", "T1 1970-01-31"),
            ("Silva^Ana", "5", "31.01.1970 t1"),
            ("Silva^Ana", "5", "01/31/1970 t1"),
        ] {
            assert!(named(name, id, text), "{name} {id} {text}");
        }
        for (name, id, text) in [
            ("Li^Bo", "8", "T1 Li"),
            ("Li^Bo", "8", "T1 with library of bones 8"),
            ("Müller^Änne", "9", "T1 mprage sag 9"),
            ("Silva^Ana", "007", "T1 7 of 1970"),
            ("", "", "T1 mprage"),
        ] {
            assert!(!named(name, id, text), "{name} {id} {text}");
        }
    }
}
