//! The content of documents (PS3.3 C.17.3).

use dicom_core::VR;
use dicom_dictionary_std::tags;

use super::item::{Code, Item};

impl Item {
    /// Makes it a container of content items, of a template of PS3.16.
    pub(super) fn container(
        &mut self,
        name: Code<'_>,
        template: Option<&str>,
        items: impl IntoIterator<Item = Self>,
    ) -> &mut Self {
        self.text(tags::VALUE_TYPE, VR::CS, "CONTAINER")
            .codes(tags::CONCEPT_NAME_CODE_SEQUENCE, &[name])
            .text(tags::CONTINUITY_OF_CONTENT, VR::CS, "SEPARATE")
            .items(tags::CONTENT_SEQUENCE, items);
        if let Some(number) = template {
            let mut template = Self::new();
            template.text(tags::MAPPING_RESOURCE, VR::CS, "DCMR").text(
                tags::TEMPLATE_IDENTIFIER,
                VR::CS,
                number,
            );
            self.items(tags::CONTENT_TEMPLATE_SEQUENCE, [template]);
        }
        self
    }
}

pub(super) fn coded(relation: &str, name: Code<'_>, value: Code<'_>) -> Item {
    let mut item = content(relation, "CODE", name);
    item.codes(tags::CONCEPT_CODE_SEQUENCE, &[value]);
    item
}

pub(super) fn text(relation: &str, name: Code<'_>, value: &str) -> Item {
    let mut item = content(relation, "TEXT", name);
    item.text(tags::TEXT_VALUE, VR::UT, value);
    item
}

/// A content item without its value.
pub(super) fn content(relation: &str, value_type: &str, name: Code<'_>) -> Item {
    let mut item = related(relation);
    item.text(tags::VALUE_TYPE, VR::CS, value_type)
        .codes(tags::CONCEPT_NAME_CODE_SEQUENCE, &[name]);
    item
}

/// An item with its relation to the one around it.
pub(super) fn related(relation: &str) -> Item {
    let mut item = Item::new();
    item.text(tags::RELATIONSHIP_TYPE, VR::CS, relation);
    item
}
