//! Enters the series of cases into the index, by which viewers of a PACS find them.

use case::CaseId;
use case::series::{AccessionNumber, CaseSeries, PatientDigest, SeriesUids, Uid};
use storage::tables::series;
use storage::{StoreError, Upload};

use crate::application::Cases;
use crate::error::Error;

/// The series that an upload was made of.
#[derive(Debug)]
pub(crate) struct SeriesOfUpload {
    uids: SeriesUids,
    accession_number: Option<AccessionNumber>,
    patient: Option<PatientDigest>,
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
            patient: stored.value("PatientID").and_then(PatientDigest::of),
        }))
    }
}

impl SeriesOfUpload {
    pub(crate) fn series(&self) -> &Uid {
        &self.uids.series
    }
}

impl Cases {
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
            patient: series.patient,
        };
        self.store().index_series(&series).await
    }

    /// Enters a version under the series of its case.
    pub(crate) async fn index_version(&self, of: &CaseId, case: CaseId) -> Result<(), StoreError> {
        let store = self.store();
        let series = series::of_case(&mut store.connect().await?, of).await?;
        match series {
            Some(series) => store.index_series(&CaseSeries { case, ..series }).await,
            None => Ok(()),
        }
    }
}
