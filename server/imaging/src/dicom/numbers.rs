//! The values of attributes.

use dicom_core::dictionary::{DataDictionary as _, DataDictionaryEntry as _};
use dicom_core::{PrimitiveValue, Tag};
use dicom_dictionary_std::StandardDataDictionary;
use dicom_object::InMemDicomObject;
use dicom_object::mem::InMemElement;

use super::DicomError;

/// The longest value that an error repeats.
const LONGEST_SHOWN: usize = 48;

/// The items of a sequence; none if it is absent.
pub(super) fn items(object: &InMemDicomObject, tag: Tag) -> &[InMemDicomObject] {
    let found = object.get(tag).and_then(|element| element.items());
    found.unwrap_or_default()
}

/// An attribute's text, without padding.
pub(super) fn text(object: &InMemDicomObject, tag: Tag) -> Option<String> {
    let value = object.get(tag)?.to_str().ok()?;
    let text = value.trim_matches(['\0', ' ']);
    Some(text.chars().filter(|c| !c.is_control()).collect())
}

/// A number that nothing depends on; `None` if it is absent or cannot be read.
pub(super) fn real(object: &InMemDicomObject, tag: Tag) -> Option<f64> {
    numbers(object.get(tag)?)?.first().copied()
}

/// A whole number that nothing depends on; `None` if it is absent or cannot be read.
pub(super) fn integer(object: &InMemDicomObject, tag: Tag) -> Option<i64> {
    object.get(tag)?.to_int().ok()
}

/// Numbers that the place or the values of voxels depend on; `None` if the element is absent or empty.
///
/// # Errors
/// [`DicomError::Value`] if there is something that is not a list of numbers.
pub(super) fn stated_reals(
    object: &InMemDicomObject,
    tag: Tag,
    instance: i64,
) -> Result<Option<Vec<f64>>, DicomError> {
    let Some(element) = object.get(tag) else {
        return Ok(None);
    };
    let numbers = numbers(element).ok_or_else(|| unreadable(element, tag, instance))?;
    Ok(Some(numbers).filter(|numbers| !numbers.is_empty()))
}

/// As [`stated_reals`], of an element with one value.
///
/// # Errors
/// As [`stated_reals`], or if it has several different ones.
pub(super) fn stated_real(
    object: &InMemDicomObject,
    tag: Tag,
    instance: i64,
) -> Result<Option<f64>, DicomError> {
    let numbers = stated_reals(object, tag, instance)?.unwrap_or_default();
    let Some((&first, others)) = numbers.split_first() else {
        return Ok(None);
    };
    match object.get(tag) {
        Some(element) if others.iter().any(|&other| other != first) => {
            Err(unreadable(element, tag, instance))
        }
        _ => Ok(Some(first)),
    }
}

/// As [`stated_real`], of a number that must be whole.
///
/// # Errors
/// As [`stated_real`].
pub(super) fn stated_integer(
    object: &InMemDicomObject,
    tag: Tag,
    instance: i64,
) -> Result<Option<i64>, DicomError> {
    let Some(number) = stated_real(object, tag, instance)? else {
        return Ok(None);
    };
    match object.get(tag) {
        Some(element) if number.fract() != 0.0 => Err(unreadable(element, tag, instance)),
        _ => Ok(Some(number as i64)),
    }
}

/// The finite numbers of an element, as numbers or as texts, whatever its value representation; `None` if it has others.
fn numbers(element: &InMemElement) -> Option<Vec<f64>> {
    let numbers: Vec<f64> = match element.value().primitive()? {
        PrimitiveValue::Empty => return Some(Vec::new()),
        PrimitiveValue::Str(_) | PrimitiveValue::Strs(_) => {
            let all = element.to_str().ok()?;
            let all = all.trim_matches(['\0', ' ']);
            if all.is_empty() {
                return Some(Vec::new());
            }
            let texts = all.split('\\').map(|text| text.trim_matches(['\0', ' ']));
            texts.map(|text| text.parse().ok()).collect::<Option<_>>()?
        }
        // Bytes of an unknown meaning, tags and times are no numbers.
        PrimitiveValue::U8(_)
        | PrimitiveValue::Tags(_)
        | PrimitiveValue::Date(_)
        | PrimitiveValue::Time(_)
        | PrimitiveValue::DateTime(_) => return None,
        value => value.to_multi_float64().ok()?,
    };
    numbers
        .iter()
        .all(|number: &f64| number.is_finite())
        .then_some(numbers)
}

/// The error about an element. A value that is more than a misspelt number may be anything, and is not repeated.
fn unreadable(element: &InMemElement, tag: Tag, instance: i64) -> DicomError {
    let is_of_number = |c: char| c.is_ascii_digit() || " ,.;:+-eE\\/".contains(c);
    let text = match element.value().primitive() {
        Some(PrimitiveValue::Str(_) | PrimitiveValue::Strs(_)) => element.to_str().ok(),
        _ => None,
    };
    let value = match text.as_deref().map(|text| text.trim_matches(['\0', ' '])) {
        Some(text) if text.len() <= LONGEST_SHOWN && text.chars().all(is_of_number) => {
            format!("`{text}`")
        }
        Some(text) => format!("a text of {} characters", text.chars().count()),
        None => format!("a value of the representation {}", element.vr()),
    };
    DicomError::Value {
        element: StandardDataDictionary
            .by_tag(tag)
            .map_or("an element", |entry| entry.alias()),
        value,
        instance,
    }
}
