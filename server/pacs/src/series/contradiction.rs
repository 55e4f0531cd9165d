//! Whether the PACS has sent images of a case, or of its study, as those of another patient, in words.

use case::CaseId;
use case::series::Uid;
use cases::{Error, Patient};
use storage::ObjectName;
use storage::tables::series;

use super::Arrivals;

/// The kind of the problem.
pub(crate) const SEVERAL_PATIENTS: &str = "several-patients";

impl Arrivals {
    /// Why a result of a case must not leave as one of its patient: the PACS has sent images of its series, also if they made no case, or of the
    /// study that was named for a case that is not DICOM, as those of another patient. `named` is the patient who was named then.
    ///
    /// # Errors
    /// If the store cannot be reached, or the patient of an image cannot be read.
    pub(crate) async fn contradiction(
        &self,
        of: &CaseId,
        study: &Uid,
        named: impl Future<Output = Result<Option<Patient>, Error>>,
    ) -> Result<Option<&'static str>, Error> {
        let series = series::of_case(&mut self.cases.store().connect().await?, of).await?;
        if let Some(series) = series {
            let Some(source) = self.cases.attributes_of(of).await? else {
                return Ok(None);
            };
            let own = Patient::of(|keyword| source.value(keyword));
            let is_another = self.are_sent_of_another(&series.uids, &own).await?;
            return Ok(is_another.then_some(
                "the PACS has sent images of the series of the case as those of another patient; use a case of what the PACS has sent",
            ));
        }
        let Some(named) = named.await? else {
            return Ok(None);
        };
        let held = self.patients_of_study(study).await?;
        let is_another = held.iter().any(|held| held.contradicts(&named));
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
