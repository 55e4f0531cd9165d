//! The values of attributes.

use dicom_core::Tag;
use dicom_object::InMemDicomObject;

/// An attribute's text, without padding.
pub(super) fn text(object: &InMemDicomObject, tag: Tag) -> Option<String> {
    let value = object.get(tag)?.to_str().ok()?;
    let text = value.trim_matches(['\0', ' ']);
    Some(text.chars().filter(|c| !c.is_control()).collect())
}

pub(super) fn reals(object: &InMemDicomObject, tag: Tag) -> Option<Vec<f64>> {
    let values = object.get(tag)?.to_multi_float64().ok()?;
    values
        .iter()
        .all(|value| value.is_finite())
        .then_some(values)
}

pub(super) fn real(object: &InMemDicomObject, tag: Tag) -> Option<f64> {
    reals(object, tag)?.first().copied()
}

pub(super) fn integer(object: &InMemDicomObject, tag: Tag) -> Option<i64> {
    object.get(tag)?.to_int().ok()
}
