//! Whether the PACS has sent images of a case, or of its study, as those of another patient, in words.

use case::CaseId;
use case::series::{SeriesUids, Uid};
use cases::{Error, Patient};
use storage::ObjectName;

use super::Arrivals;

/// The kind of the problem.
pub(crate) const SEVERAL_PATIENTS: &str = "several-patients";

impl Arrivals {
    /// Whether the PACS has sent images of the series of a case as those of another patient, also if they made no case.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn contradiction(
        &self,
        of: &CaseId,
        series: &SeriesUids,
    ) -> Result<Option<&'static str>, Error> {
        let Some(source) = self.cases.attributes_of(of).await? else {
            return Ok(None);
        };
        let own = Patient::of(|keyword| source.value(keyword));
        let is_another = self.are_sent_of_another(series, &own).await?;
        Ok(is_another.then_some(
            "the PACS has sent images of the series of the case as those of another patient",
        ))
    }

    /// Whether images of a study are of another patient than the one who was named for a result of a case that is not DICOM.
    ///
    /// # Errors
    /// If the rows or the patient of an image cannot be read.
    pub(crate) async fn contradiction_of_study(
        &self,
        study: &Uid,
        named: &Patient,
    ) -> Result<Option<&'static str>, Error> {
        let held = self.patients_of_study(study).await?;
        let is_another = held.iter().any(|held| held.contradicts(named));
        Ok(is_another.then_some(
            "the study that was named for the result is here, and images of it are of another patient",
        ))
    }

    /// The patient of a stored object; `None` if it is lost or cannot be read.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub(crate) async fn patient_of(&self, object: ObjectName) -> Result<Option<Patient>, Error> {
        Ok(self.patients_of_images(&[object]).await?.pop())
    }
}
