//! Attributes as DICOM JSON (PS3.18 annex F).

use dicom_core::dictionary::DataDictionary as _;
use dicom_core::header::Header;
use dicom_core::value::Value as DicomValue;
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, tags};
use dicom_object::InMemDicomObject;
use dicom_object::mem::InMemElement;
use serde_json::{Map, Number, Value, json};

use super::DicomError;
use super::header::parse;
use super::scan::{Wanted, scan_for};

/// The name in DICOM JSON of the attribute with a keyword: `00100010` of `PatientName`; `None` if the standard has none.
pub fn tag_of(keyword: &str) -> Option<String> {
    Some(name(StandardDataDictionary.by_name(keyword)?.tag.inner()))
}

/// An element with its values, which are separated by backslashes. An empty text has none.
fn element(vr: &str, text: &str) -> Value {
    let text = text.trim_matches(['\0', ' ']);
    if text.is_empty() {
        return json!({ "vr": vr });
    }
    let is_whole = matches!(vr, "LT" | "ST" | "UT" | "UR");
    let texts = match is_whole {
        true => vec![text],
        false => text
            .split('\\')
            .map(|text| text.trim_matches(' '))
            .collect(),
    };
    let values: Vec<Value> = texts.into_iter().map(|text| value(vr, text)).collect();
    json!({ "vr": vr, "Value": values })
}

fn value(vr: &str, text: &str) -> Value {
    if text.is_empty() {
        return Value::Null;
    }
    match vr {
        "PN" => {
            let groups = ["Alphabetic", "Ideographic", "Phonetic"];
            let groups = groups.into_iter().zip(text.splitn(3, '='));
            let groups = groups.filter(|(_, name)| !name.is_empty());
            groups
                .map(|(group, name)| (group.to_owned(), name.into()))
                .collect::<Map<_, _>>()
                .into()
        }
        "IS" | "SS" | "US" | "SL" | "UL" | "SV" | "UV" => {
            text.parse::<i64>().map_or_else(|_| real(text), Value::from)
        }
        "DS" | "FL" | "FD" => real(text),
        _ => text.into(),
    }
}

/// A number; what is none stays a text, which DICOM JSON allows.
fn real(text: &str) -> Value {
    let number = text.parse::<f64>().ok().and_then(Number::from_f64);
    number.map_or_else(|| text.into(), Value::Number)
}

fn name(tag: Tag) -> String {
    format!("{:04X}{:04X}", tag.0, tag.1)
}

/// The attributes of a file before its pixels. Private attributes and binary values are omitted.
///
/// # Errors
/// If the file is damaged.
pub fn metadata(file: &[u8]) -> Result<Value, DicomError> {
    let object = parse(&scan_for(file, Wanted::Texts)?)?;
    let mut all = data_set(&object);
    // Texts have been decoded, and JSON is UTF-8.
    all.insert(
        name(tags::SPECIFIC_CHARACTER_SET),
        element("CS", "ISO_IR 192"),
    );
    Ok(all.into())
}

fn data_set(object: &InMemDicomObject) -> Map<String, Value> {
    let is_plain = |found: &&InMemElement| found.tag().1 != 0 && found.tag().0.is_multiple_of(2);
    let elements = object.iter().filter(is_plain);
    elements
        .filter_map(|found| Some((name(found.tag()), of_element(found)?)))
        .collect()
}

fn of_element(found: &InMemElement) -> Option<Value> {
    let vr = found.vr();
    if let DicomValue::Sequence(sequence) = found.value() {
        let items = sequence.items().iter().map(data_set);
        let items: Vec<Value> = items.map(Into::into).collect();
        return Some(match items.is_empty() {
            true => json!({"vr": "SQ"}),
            false => json!({"vr": "SQ", "Value": items}),
        });
    }
    let vr_name = vr.to_string();
    match vr {
        VR::OB | VR::OD | VR::OF | VR::OL | VR::OV | VR::OW | VR::UN | VR::SQ => None,
        VR::AT => {
            let tags = found.value().primitive()?;
            let tags: Vec<String> = tags.tags().ok()?.iter().map(|&tag| name(tag)).collect();
            Some(json!({"vr": vr_name, "Value": tags}))
        }
        _ => Some(element(vr_name, &found.to_str().ok()?)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_keyword_has_its_tag() {
        assert_eq!(tag_of("PatientName").as_deref(), Some("00100010"));
        assert_eq!(tag_of("Patient"), None);
    }

    #[test]
    fn values_have_the_types_of_dicom_json() {
        assert_eq!(
            element("PN", "Müller^Änne=繆勒"),
            json!({"vr": "PN", "Value": [{"Alphabetic": "Müller^Änne", "Ideographic": "繆勒"}]})
        );
        assert_eq!(
            element("DS", r"1.5\ 2 "),
            json!({"vr": "DS", "Value": [1.5, 2.0]})
        );
        assert_eq!(element("IS", "7"), json!({"vr": "IS", "Value": [7]}));
        assert_eq!(
            element("IS", "seven"),
            json!({"vr": "IS", "Value": ["seven"]})
        );
        assert_eq!(
            element("LO", r"a\\b"),
            json!({"vr": "LO", "Value": ["a", null, "b"]})
        );
        assert_eq!(
            element("LT", r"a\b"),
            json!({"vr": "LT", "Value": [r"a\b"]})
        );
        assert_eq!(element("SH", " "), json!({"vr": "SH"}));
    }
}
