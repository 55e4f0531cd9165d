//! What the pixels of a file have lost.

use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;

use super::DicomError;
use super::numbers::integer;
use super::scan::{PixelBytes, Scanned, stated_syntax};

/// How the pixels of a file have lost something according to its transfer syntax (PS3.3 C.7.6.1.1.5): keywords, tags and
/// values of the attributes that state it; none if nothing was lost.
pub(super) fn lost(
    file: &[u8],
    scanned: &Scanned,
    object: &InMemDicomObject,
) -> Result<Vec<(&'static str, Tag, VR, String)>, DicomError> {
    let syntax = stated_syntax(file)?;
    let rest = syntax
        .as_deref()
        .and_then(|uid| uid.strip_prefix("1.2.840.10008.1.2.4."));
    let method = match rest {
        Some("50" | "51") => "ISO_10918_1",
        Some("81") => "ISO_14495_1",
        Some("91") => "ISO_15444_1",
        _ => return Ok(Vec::new()),
    };
    let mut stated = vec![
        (
            "LossyImageCompression",
            tags::LOSSY_IMAGE_COMPRESSION,
            VR::CS,
            "01".to_owned(),
        ),
        (
            "LossyImageCompressionMethod",
            tags::LOSSY_IMAGE_COMPRESSION_METHOD,
            VR::CS,
            method.to_owned(),
        ),
    ];
    if let Some(ratio) = ratio(scanned, object) {
        let tag = tags::LOSSY_IMAGE_COMPRESSION_RATIO;
        stated.push((
            "LossyImageCompressionRatio",
            tag,
            VR::DS,
            format!("{ratio:.2}"),
        ));
    }
    Ok(stated)
}

/// How many times as many bytes the pixels of a file have without compression.
fn ratio(scanned: &Scanned, object: &InMemDicomObject) -> Option<f64> {
    let Some(PixelBytes::Encapsulated { fragments, .. }) = scanned.pixels() else {
        return None;
    };
    let compressed: usize = fragments.iter().map(|fragment| fragment.len()).sum();
    let number = |tag| integer(object, tag);
    let frames = number(tags::NUMBER_OF_FRAMES).unwrap_or(1);
    let bits = number(tags::ROWS)? as f64
        * number(tags::COLUMNS)? as f64
        * number(tags::BITS_ALLOCATED)? as f64
        * frames as f64;
    (compressed > 0).then(|| (bits / 8.0 / compressed as f64).max(1.0))
}
