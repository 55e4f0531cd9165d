//! Whether two sources are of one patient.

use crate::application::Cases;
use crate::error::Error;
use case::{CaseId, ObjectKind};
use imaging::dicom::Attributes;
use storage::arrivals::{CaseSeries, Uid};
use storage::{ObjectName, StoreError, Upload, unless_missing};

/// A patient, as a source states them. This is patient data.
///
/// Two are the same patient if id, issuer and date of birth agree: a name that is written in another way is still the same
/// patient's. One without an id is known by everything that is stated.
#[derive(Clone)]
pub struct Patient {
    id: Option<String>,
    issuer: Option<String>,
    birth_date: Option<String>,
    name: Option<String>,
    sex: Option<String>,
}

impl Patient {
    /// The patient in the attributes of a source, by keyword.
    pub fn of<'a>(value: impl Fn(&str) -> Option<&'a str>) -> Self {
        let stated = |keyword| {
            let value = value(keyword).map(|value| value.trim_matches(['\0', ' ']));
            value.filter(|value| !value.is_empty()).map(str::to_owned)
        };
        Self {
            id: stated("PatientID"),
            issuer: stated("IssuerOfPatientID"),
            birth_date: stated("PatientBirthDate"),
            // Other scripts of the name may be missing.
            name: stated("PatientName").and_then(|name| {
                let spelling = name.split('=').next()?.trim_end_matches(['^', ' ']);
                (!spelling.is_empty()).then(|| spelling.to_owned())
            }),
            sex: stated("PatientSex"),
        }
    }

    /// The patient in the stored attributes of a source.
    pub(crate) fn of_stored(stored: &[u8]) -> Option<Self> {
        let attributes = pipeline::attributes(stored).ok()?;
        Some(Self::of(|keyword| attributes.value(keyword)))
    }

    /// The patient of an upload; `None` if it is not DICOM.
    pub(crate) async fn of_upload(upload: &Upload) -> Result<Option<Self>, Error> {
        Ok(match &upload.dicom {
            Some(stored) => Self::of_stored(&stored.read().await?),
            None => None,
        })
    }

    /// Whether anything is stated by which the patient could be told from others.
    pub(crate) fn is_stated(&self) -> bool {
        self.id.is_some() || self.name.is_some() || self.birth_date.is_some()
    }

    /// Whether something that both state differs. A name counts only without an id.
    fn contradicts(&self, other: &Self) -> bool {
        let differ = |one: &Option<String>, other: &Option<String>| {
            one.as_ref()
                .zip(other.as_ref())
                .is_some_and(|(one, other)| one != other)
        };
        let has_ids = self.id.is_some() && other.id.is_some();
        differ(&self.id, &other.id)
            || differ(&self.issuer, &other.issuer)
            || differ(&self.birth_date, &other.birth_date)
            || !has_ids && differ(&self.name, &other.name)
    }

    /// Whether it has this id and this issuer; `None` agrees with every one.
    pub fn agrees(&self, id: Option<&str>, issuer: Option<&str>) -> bool {
        id.is_none_or(|id| self.id.as_deref() == Some(id))
            && issuer.is_none_or(|issuer| self.issuer.as_deref() == Some(issuer))
    }

    /// The patient in the words of the page (`web/src/pacs/neighbour.ts`): `Müller, Änne · P-77 (HOSPITAL) · * 1967-03-12`. Two
    /// hospitals may have given one id to two patients.
    pub fn words(&self) -> String {
        let text = |stated: &Option<String>| stated.clone().unwrap_or_default();
        let (id, name, birth) = (text(&self.id), text(&self.name), text(&self.birth_date));
        let name = name.replacen('^', ", ", 1).replace('^', " ");
        let id = match &self.issuer {
            None => id,
            Some(issuer) => format!("{id} ({issuer})"),
        };
        let birth = match &*birth {
            "" => String::new(),
            stated => format!("* {}", day(stated)),
        };
        let parts = [name.trim(), id.trim(), &birth];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        parts.join(" · ")
    }
}

impl PartialEq for Patient {
    fn eq(&self, other: &Self) -> bool {
        let stated = |patient: &Self| {
            let without_id = (patient.name.clone(), patient.sex.clone());
            let without_id = patient.id.is_none().then_some(without_id);
            let Self {
                id,
                issuer,
                birth_date,
                ..
            } = patient.clone();
            (id, issuer, birth_date, without_id)
        };
        stated(self) == stated(other)
    }
}

/// What is different about the images that the PACS has sent with the UIDs of an upload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contradiction {
    /// They are of another patient.
    Patient,
    /// They are of another patient, and the case is not DICOM: whoever requested a result named the study.
    Study,
}

impl Contradiction {
    /// The kind of the problem.
    pub fn name(self) -> &'static str {
        "several-patients"
    }

    /// What has happened.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Patient => {
                "the PACS has sent images of the series of the case as those of another patient"
            }
            Self::Study => {
                "the study that was named for the result is here, and images of it are of another patient"
            }
        }
    }
}

/// A date of DICOM as the page has it: `1967-03-12`.
pub(crate) fn day(date: &str) -> String {
    match date.len() == 8 && date.is_ascii() {
        true => format!("{}-{}-{}", &date[..4], &date[4..6], &date[6..]),
        false => date.to_owned(),
    }
}

/// Nothing of a patient is shown in logs.
impl std::fmt::Debug for Patient {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Patient(…)")
    }
}

impl Cases {
    /// Whether an upload is of the patient of a case; `None` if that is not known, because they differ and one of them states no
    /// patient.
    pub(crate) async fn is_of_patient(
        &self,
        upload: &Upload,
        case: &CaseId,
    ) -> Result<Option<bool>, Error> {
        let new = Patient::of_upload(upload).await?;
        let held = self.store().source_dicom(case).await?;
        let held = held.and_then(|stored| Patient::of_stored(&stored));
        Ok(new.zip(held).and_then(|(new, held)| {
            let is_same = new == held;
            (is_same || new.is_stated() && held.is_stated()).then_some(is_same)
        }))
    }

    /// Whether the PACS has sent images of the series of a case as those of another patient, also if they made no case.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn contradiction(&self, of: &CaseSeries) -> Result<Option<Contradiction>, Error> {
        let Some(source) = self.attributes_of(&of.case).await? else {
            return Ok(None);
        };
        let own = Patient::of(|keyword| source.value(keyword));
        let is_another = self.are_sent_of_another(&of.uids, &own).await?;
        Ok(is_another.then_some(Contradiction::Patient))
    }

    /// Whether images of a study are of another patient than the one who was named for a result of a case that is not DICOM.
    ///
    /// # Errors
    /// If the rows or the patient of an image cannot be read.
    pub async fn contradiction_of_study(
        &self,
        study: &Uid,
        named: &Patient,
    ) -> Result<Option<Contradiction>, Error> {
        let held = self.patients_of_study(study).await?;
        let is_another = held.iter().any(|held| held.contradicts(named));
        Ok(is_another.then_some(Contradiction::Study))
    }

    /// The patient of a stored object; `None` if it is lost or cannot be read.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn patient_of(&self, object: ObjectName) -> Result<Option<Patient>, Error> {
        Ok(self.patients_of_images(&[object]).await?.pop())
    }

    /// The attributes of the source of a case; `None` if it has none, or they are damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn attributes_of(&self, case: &CaseId) -> Result<Option<Attributes>, StoreError> {
        let objects = self.store().case_objects(case).await?;
        self.attributes_among(case, &objects).await
    }

    /// The attributes among the objects of a case or of one of its layers, as [`Cases::attributes_of`].
    pub(super) async fn attributes_among(
        &self,
        case: &CaseId,
        objects: &[ObjectName],
    ) -> Result<Option<Attributes>, StoreError> {
        let read = self.store().read(case, objects, ObjectKind::SourceDicom);
        let stored = unless_missing(read.await)?;
        Ok(stored.and_then(|stored| pipeline::attributes(&stored).ok()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patient(attributes: &[(&str, &str)]) -> Patient {
        let stored = serde_json::json!({ "attributes": attributes, "instances": [], "interpolated_slices": [] }).to_string();
        Patient::of_stored(stored.as_bytes()).expect("attributes")
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
        assert!(patient(&zed).is_stated() && !patient(&[("PatientSex", "F")]).is_stated());
    }
}
