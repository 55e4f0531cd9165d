//! Enters the series of cases into the index, by which viewers of a PACS find them.

use case::CaseId;
use storage::arrivals::{AccessionNumber, CaseSeries, SeriesUids, Uid};
use storage::{StoreError, Upload};

use crate::application::Cases;
use crate::error::Error;

/// The series that an upload was made of.
#[derive(Debug)]
pub(crate) struct SeriesOfUpload {
    uids: SeriesUids,
    accession_number: Option<AccessionNumber>,
}

impl SeriesOfUpload {
    /// `None` if it is not DICOM, or lacks a UID.
    ///
    /// # Errors
    /// If the upload cannot be read.
    pub(crate) async fn read(upload: &Upload) -> Result<Option<Self>, Error> {
        let Some(stored) = &upload.dicom else {
            return Ok(None);
        };
        let Ok(stored) = pipeline::attributes(&stored.read().await?) else {
            return Ok(None);
        };
        let uid = |keyword| stored.value(keyword).and_then(Uid::parse);
        let uids = uid("StudyInstanceUID").zip(uid("SeriesInstanceUID"));
        Ok(uids.map(|(study, series)| Self {
            uids: SeriesUids { study, series },
            accession_number: stored
                .value("AccessionNumber")
                .and_then(AccessionNumber::parse),
        }))
    }
}

/// Attributes that tell two patients apart. A name that is written in another way is still the same patient's.
pub(crate) const OF_PATIENT: [&str; 3] = ["PatientID", "IssuerOfPatientID", "PatientBirthDate"];

/// What tells patients without an id apart, beside [`OF_PATIENT`].
const WITHOUT_ID: [&str; 2] = ["PatientName", "PatientSex"];

/// The patient of a source. One without an id is known by everything that is stated.
#[derive(Debug, PartialEq, Eq)]
struct Patient {
    stated: [Option<String>; 3],
    without_id: Option<[Option<String>; 2]>,
}

impl Patient {
    /// The patient in the stored attributes of a source.
    fn of(stored: &[u8]) -> Option<Self> {
        let attributes = pipeline::attributes(stored).ok()?;
        let value = |keyword: &str| {
            let value = attributes.value(keyword).map(str::trim);
            value.filter(|value| !value.is_empty()).map(str::to_owned)
        };
        let stated = OF_PATIENT.map(value);
        let without_id = stated[0].is_none().then(|| WITHOUT_ID.map(value));
        Some(Self { stated, without_id })
    }
}

impl Cases {
    /// Whether an upload is of the patient of a case; `false` if that is not known.
    pub(crate) async fn is_of_patient(
        &self,
        upload: &Upload,
        case: &CaseId,
    ) -> Result<bool, Error> {
        let Some(new) = &upload.dicom else {
            return Ok(false);
        };
        let new = Patient::of(&new.read().await?);
        let held = self.store().source_dicom(case).await?;
        let held = held.and_then(|stored| Patient::of(&stored));
        Ok(new.is_some() && new == held)
    }

    /// Enters the series of a case.
    pub(crate) async fn index(
        &self,
        case: CaseId,
        series: Option<SeriesOfUpload>,
    ) -> Result<(), StoreError> {
        let Some(series) = series else {
            return Ok(());
        };
        let series = CaseSeries {
            case,
            uids: series.uids,
            accession_number: series.accession_number,
            superseded: None,
        };
        self.store().index_series(&series).await
    }

    /// Enters a version under the series of its case.
    pub(crate) async fn index_version(&self, of: &CaseId, case: CaseId) -> Result<(), StoreError> {
        let store = self.store();
        match store.series_of(of).await? {
            Some(series) => store.index_series(&CaseSeries { case, ..series }).await,
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patient(attributes: &[(&str, &str)]) -> Patient {
        let stored = serde_json::json!({ "attributes": attributes, "instances": [], "interpolated_slices": [] }).to_string();
        Patient::of(stored.as_bytes()).expect("attributes")
    }

    #[test]
    fn without_an_id_patients_are_told_apart_by_all_that_is_stated() {
        let zed = [("PatientID", ""), ("PatientName", "Zed^Two")];
        let quin = [("PatientID", ""), ("PatientName", "Quin^Three")];
        assert_eq!(patient(&zed), patient(&zed[1..]));
        assert_ne!(patient(&zed), patient(&quin));
        // With an id, a name may be written in another way.
        let [before, after] = ["Zed^Two", "ZED^TWO"];
        let with_id = |name| patient(&[("PatientID", "P-1"), ("PatientName", name)]);
        assert_eq!(with_id(before), with_id(after));
        assert_ne!(with_id(before), patient(&zed));
    }
}
