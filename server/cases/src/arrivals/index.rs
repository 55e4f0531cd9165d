//! Enters the series of cases into the index, by which viewers of a PACS find them.

use std::collections::BTreeSet;

use case::CaseId;
use imaging::dicom::Attributes;
use storage::arrivals::{AccessionNumber, CaseSeries, PatientDigest, SeriesUids, Superseded, Uid};
use storage::{StoreError, Upload};

use super::Patient;
use crate::application::Cases;
use crate::error::Error;

/// The series that an upload was made of.
#[derive(Debug)]
pub(crate) struct SeriesOfUpload {
    uids: SeriesUids,
    accession_number: Option<AccessionNumber>,
    patient: Option<PatientDigest>,
    images: Vec<Uid>,
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
            images: images_of(&stored),
            uids: SeriesUids { study, series },
            accession_number: stored
                .value("AccessionNumber")
                .and_then(AccessionNumber::parse),
            patient: stored.value("PatientID").and_then(PatientDigest::of),
        }))
    }
}

/// The UIDs of the images of a volume.
pub(super) fn images_of(source: &Attributes) -> Vec<Uid> {
    let images = source.instances.iter();
    let uids: BTreeSet<_> = images.map(|image| &image.sop_instance_uid).collect();
    uids.into_iter().filter_map(|uid| Uid::parse(uid)).collect()
}

impl SeriesOfUpload {
    pub(crate) fn series(&self) -> &Uid {
        &self.uids.series
    }
}

impl Cases {
    /// Whether the PACS has rejected any image of an upload.
    pub(crate) async fn is_rejected(&self, series: &SeriesOfUpload) -> Result<bool, StoreError> {
        let images = series.images.iter();
        let images: Vec<_> = images
            .map(|image| (series.uids.clone(), image.clone()))
            .collect();
        Ok(self.store().are_rejected(&images).await?.contains(&true))
    }

    /// Whether the PACS has sent the images of an upload, or others of its series, as those of another patient.
    pub(crate) async fn is_corrected(
        &self,
        series: &SeriesOfUpload,
        upload: &Upload,
    ) -> Result<bool, Error> {
        let Some(patient) = Patient::of_upload(upload).await? else {
            return Ok(false);
        };
        self.are_sent_of_another(&series.uids, &series.images, &patient)
            .await
    }

    /// Enters the series of a case. What the PACS has rejected does not count when a user uploads it.
    pub(crate) async fn index(
        &self,
        case: CaseId,
        series: Option<SeriesOfUpload>,
    ) -> Result<(), StoreError> {
        let Some(series) = series else {
            return Ok(());
        };
        let is_rejected = self.is_rejected(&series).await?;
        let series = CaseSeries {
            case,
            uids: series.uids,
            accession_number: series.accession_number,
            patient: series.patient,
            superseded: is_rejected.then_some(Superseded::Rejected),
            is_received: false,
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
