//! Whether two sources are of one patient.

use crate::application::Cases;
use crate::error::Error;
use case::{CaseId, ObjectKind};
use imaging::dicom::Attributes;
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
    pub fn is_stated(&self) -> bool {
        self.id.is_some() || self.name.is_some() || self.birth_date.is_some()
    }

    /// Whether something that both state differs. A name counts only without an id.
    pub fn contradicts(&self, other: &Self) -> bool {
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

    /// The patient in the words of the page (`web/src/base/pacs.ts`): `Müller, Änne · P-77 (HOSPITAL) · * 1967-03-12`. Two
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
    ///
    /// # Errors
    /// If the upload or the store cannot be read.
    pub async fn is_of_patient(
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

    /// The attributes of the source of a case; `None` if it has none, or they are damaged.
    ///
    /// # Errors
    /// If the store cannot be reached.
    pub async fn attributes_of(&self, case: &CaseId) -> Result<Option<Attributes>, StoreError> {
        let objects = self.store().objects_of(case).await?;
        self.attributes_among(case, &objects).await
    }

    /// The attributes among the objects of a case or of one of its layers, as [`Cases::attributes_of`].
    async fn attributes_among(
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
    use case::Parameters;
    use pipeline::Source;
    use storage::Store;
    use storage::testing::files_below;

    use super::*;
    use crate::testing::{application, options, source};

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
        // One script of the name is enough.
        assert_eq!(
            patient(&zed),
            patient(&[("PatientName", "Zed^Two=山田^太郎")])
        );
        // With an id, a name may be written in another way.
        let [before, after] = ["Zed^Two", "ZED^TWO"];
        let with_id = |name| patient(&[("PatientID", "P-1"), ("PatientName", name)]);
        assert_eq!(with_id(before), with_id(after));
        assert_ne!(with_id(before), patient(&zed));
        assert!(patient(&zed).is_stated() && !patient(&[("PatientSex", "F")]).is_stated());
    }

    #[tokio::test]
    async fn a_store_that_fails_is_an_error_and_not_a_case_that_states_no_patient() {
        let directory = tempfile::tempdir().unwrap();
        let store = Store::open(directory.path(), options());
        let cases = application(store.await.unwrap(), "");
        let stored =
            r#"{"attributes":[["PatientID","P-1"]],"instances":[],"interpolated_slices":[]}"#;
        let of_dicom = Source {
            dicom: Some(stored.into()),
            ..source("volume")
        };
        let submitted = cases.library.submit(of_dicom, Parameters::default());
        let id = submitted.await.unwrap().case.id;
        let attributes = cases.attributes_of(&id).await.unwrap().unwrap();
        assert_eq!(attributes.value("PatientID"), Some("P-1"));
        let [file] = &files_below(&directory.path().join("objects/source-dicom"))[..] else {
            panic!("one object has the attributes");
        };
        std::fs::write(file, b"damaged").unwrap();
        assert!(cases.attributes_of(&id).await.unwrap().is_none());
        // A link that leads to itself can be read as little as a disk that fails.
        std::fs::remove_file(file).unwrap();
        std::os::unix::fs::symlink(file, file).unwrap();
        let failed = cases.attributes_of(&id).await.unwrap_err();
        assert!(
            matches!(failed, StoreError::Objects(_) | StoreError::Disk(_)),
            "{failed:?}"
        );
    }
}
