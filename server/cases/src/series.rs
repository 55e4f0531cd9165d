//! The series of cases, by which viewers find them.

use case::series::{AccessionNumber, CaseSeries, PatientDigest, SeriesUids, Uid};
use imaging::dicom::Attributes;

/// The series in stored attributes; `None` if they are damaged or lack a UID.
pub(crate) fn series_of_stored(stored: &[u8]) -> Option<CaseSeries> {
    series_of(&pipeline::attributes(stored).ok()?)
}

/// The series in the attributes of a source; `None` if they lack a UID.
pub fn series_of(attributes: &Attributes) -> Option<CaseSeries> {
    let uid = |keyword| attributes.value(keyword).and_then(Uid::parse);
    Some(CaseSeries {
        uids: SeriesUids {
            study: uid("StudyInstanceUID")?,
            series: uid("SeriesInstanceUID")?,
        },
        accession_number: attributes
            .value("AccessionNumber")
            .and_then(AccessionNumber::parse),
        patient: attributes.value("PatientID").and_then(PatientDigest::of),
    })
}
