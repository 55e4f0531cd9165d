//! A PDF in a DICOM object.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};

use super::common::{Head, WriteError, file, reference};
use super::item::Item;
use crate::dicom::code;

const CLASS: &str = uids::ENCAPSULATED_PDF_STORAGE;

/// An Encapsulated PDF (PS3.3 A.45.1) that was made from the images of the source.
///
/// # Errors
/// If the source has no study, and as [`WriteError`].
pub fn encapsulated_pdf(
    head: &Head<'_>,
    title: &str,
    mut pdf: Vec<u8>,
) -> Result<Vec<u8>, WriteError> {
    let length = u32::try_from(pdf.len()).map_err(|_| WriteError::Size)?;
    if pdf.len() % 2 == 1 {
        pdf.push(0);
    }
    let mut item = head.begin_document(CLASS, "DOC")?;
    let sources: Vec<Item> = head.images().map(reference).collect();
    item.text(tags::CONVERSION_TYPE, VR::CS, "WSD")
        .text(tags::ACQUISITION_DATE_TIME, VR::DT, "")
        // A reader may have written anything into it.
        .text(tags::BURNED_IN_ANNOTATION, VR::CS, "YES")
        .text(tags::DOCUMENT_TITLE, VR::ST, title)
        .codes(
            tags::CONCEPT_NAME_CODE_SEQUENCE,
            &[code::IMAGING_MEASUREMENT_REPORT],
        )
        .text(tags::VERIFICATION_FLAG, VR::CS, "UNVERIFIED")
        .text(
            tags::MIME_TYPE_OF_ENCAPSULATED_DOCUMENT,
            VR::LO,
            "application/pdf",
        )
        .longs(tags::ENCAPSULATED_DOCUMENT_LENGTH, &[length])
        .bytes(tags::ENCAPSULATED_DOCUMENT, pdf);
    if !sources.is_empty() {
        item.items(tags::SOURCE_INSTANCE_SEQUENCE, sources);
    }
    file(item, CLASS, head.instance_uid)
}
