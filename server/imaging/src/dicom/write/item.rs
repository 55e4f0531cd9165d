//! Data sets in the making.

use dicom_core::value::{DataSetSequence, PrimitiveValue};
use dicom_core::{DataElement, Tag, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;

/// The longest decimal string, in bytes (PS3.5 §6.2).
const MAX_DECIMAL_BYTES: usize = 16;

/// A data set, or an item of a sequence.
#[derive(Debug, Clone)]
pub(super) struct Item(InMemDicomObject);

/// A coded concept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::dicom) struct Code<'a> {
    pub(in crate::dicom) value: &'a str,
    pub(in crate::dicom) scheme: &'a str,
    pub(in crate::dicom) meaning: &'a str,
}

impl Item {
    pub(super) fn new() -> Self {
        Self(InMemDicomObject::new_empty())
    }

    /// Adds a text; several values are separated by backslashes. An empty text is an empty value.
    pub(super) fn text(&mut self, tag: Tag, vr: VR, text: &str) -> &mut Self {
        let value = match text {
            "" => PrimitiveValue::Empty,
            text => PrimitiveValue::from(text),
        };
        self.put(tag, vr, value)
    }

    /// Adds integers of 16 bits.
    pub(super) fn shorts(&mut self, tag: Tag, values: &[u16]) -> &mut Self {
        self.put(tag, VR::US, PrimitiveValue::U16(values.into()))
    }

    /// Adds integers of 32 bits.
    pub(super) fn longs(&mut self, tag: Tag, values: &[u32]) -> &mut Self {
        self.put(tag, VR::UL, PrimitiveValue::U32(values.into()))
    }

    /// Adds floating point numbers of 32 bits.
    pub(super) fn floats(&mut self, tag: Tag, values: &[f32]) -> &mut Self {
        self.put(tag, VR::FL, PrimitiveValue::F32(values.into()))
    }

    /// Adds decimal strings.
    pub(super) fn reals(&mut self, tag: Tag, values: &[f64]) -> &mut Self {
        let texts: Vec<String> = values.iter().map(|&value| decimal(value)).collect();
        self.text(tag, VR::DS, &texts.join("\\"))
    }

    /// Adds the tag of an attribute.
    pub(super) fn pointer(&mut self, tag: Tag, target: Tag) -> &mut Self {
        self.put(tag, VR::AT, PrimitiveValue::Tags([target][..].into()))
    }

    /// Adds bytes, such as pixels.
    pub(super) fn bytes(&mut self, tag: Tag, bytes: Vec<u8>) -> &mut Self {
        self.put(tag, VR::OB, PrimitiveValue::U8(bytes.into()))
    }

    pub(super) fn items(&mut self, tag: Tag, items: impl IntoIterator<Item = Self>) -> &mut Self {
        let items: Vec<_> = items.into_iter().map(|item| item.0).collect();
        let sequence = DataSetSequence::from(items);
        self.0.put(DataElement::new(tag, VR::SQ, sequence));
        self
    }

    /// Adds a sequence of coded concepts.
    pub(super) fn codes(&mut self, tag: Tag, codes: &[Code<'_>]) -> &mut Self {
        let coded = |code: &Code<'_>| {
            let mut item = Self::new();
            item.text(tags::CODE_VALUE, VR::SH, code.value)
                .text(tags::CODING_SCHEME_DESIGNATOR, VR::SH, code.scheme)
                .text(tags::CODE_MEANING, VR::LO, code.meaning);
            item
        };
        self.items(tag, codes.iter().map(coded))
    }

    pub(super) fn into_object(self) -> InMemDicomObject {
        self.0
    }

    fn put(&mut self, tag: Tag, vr: VR, value: PrimitiveValue) -> &mut Self {
        self.0.put(DataElement::new(tag, vr, value));
        self
    }
}

/// A number with as many digits as fit.
fn decimal(value: f64) -> String {
    // Adding 0 turns −0 into 0.
    let value = value + 0.0;
    let shortest = value.to_string();
    if shortest.len() <= MAX_DECIMAL_BYTES {
        return shortest;
    }
    let fixed = (0..MAX_DECIMAL_BYTES).rev();
    let mut fixed = fixed.map(|digits| format!("{value:.digits$}"));
    let fitting = fixed.find(|text| text.len() <= MAX_DECIMAL_BYTES);
    fitting.unwrap_or_else(|| format!("{value:.8e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_strings_are_short_and_close() {
        for value in [
            0.0,
            -0.0,
            1.0,
            0.1 + 0.2,
            -1.0 / 3.0,
            1e-20,
            -123_456.789_012_345_6,
            9.87e300,
        ] {
            let text = decimal(value);
            assert!(text.len() <= MAX_DECIMAL_BYTES, "{text}");
            let read: f64 = text.parse().unwrap();
            let error = (read - value).abs();
            assert!(error <= value.abs() * 1e-8 + 1e-13, "{value} is {text}");
        }
        assert_eq!(decimal(-0.0), "0");
    }
}
