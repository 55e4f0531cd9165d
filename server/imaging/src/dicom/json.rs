//! Attributes as DICOM JSON (PS3.18 annex F).

use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
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

/// An attribute of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attribute {
    /// Group and element.
    pub tag: [u16; 2],
    /// Its value representation, such as `PN`.
    pub vr: &'static str,
    /// Its keyword, such as `PatientName`.
    pub keyword: &'static str,
}

impl Attribute {
    /// Its name in DICOM JSON, such as `00100010`.
    pub fn name(&self) -> String {
        let [group, element] = self.tag;
        name(Tag(group, element))
    }
}

/// The attribute with a keyword or a tag, such as `PatientName` or `00100010`; `None` if the standard has none.
pub fn attribute(text: &str) -> Option<Attribute> {
    let is_tag = text.len() == 8 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let entry = match is_tag {
        true => {
            let number = u32::from_str_radix(text, 16).ok()?;
            let tag = Tag((number >> 16) as u16, number as u16);
            StandardDataDictionary.by_tag(tag)?
        }
        false => StandardDataDictionary.by_name(text)?,
    };
    let tag = entry.tag.inner();
    Some(Attribute {
        tag: [tag.0, tag.1],
        vr: entry.vr().relaxed().to_string(),
        keyword: entry.alias,
    })
}

/// An element with its values, which are separated by backslashes. An empty text has none.
pub fn element(vr: &str, text: &str) -> Value {
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
    fn attributes_are_found_by_keyword_and_by_tag() {
        let name = attribute("PatientName").unwrap();
        assert_eq!((name.name().as_str(), name.vr), ("00100010", "PN"));
        assert_eq!(attribute("00100010"), Some(name));
        assert_eq!(attribute("Patient"), None);
        assert_eq!(attribute("00091001"), None);
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
