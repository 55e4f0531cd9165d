//! The studies that are here: the series that cases were made of, and the results that were sent.

use std::collections::{BTreeMap, HashMap, HashSet};

use case::{CaseFacts, CaseId};
use cases::arrivals::Patient;
use imaging::dicom::{Attributes, attribute};
use storage::ObjectName;
use storage::arrivals::{CaseSeries, SeriesQuery, SeriesUids, Uid};
use storage::results::HeldResult;

use crate::address::Named;
use crate::state::Pacs;
use http_support::problem::AppError;

/// Attributes of the patient and the study.
const OF_STUDY: [&str; 15] = [
    "PatientName",
    "PatientID",
    "IssuerOfPatientID",
    "PatientBirthDate",
    "PatientSex",
    "PatientAge",
    "PatientSize",
    "PatientWeight",
    "StudyInstanceUID",
    "StudyID",
    "StudyDate",
    "StudyTime",
    "StudyDescription",
    "AccessionNumber",
    "ReferringPhysicianName",
];

/// Attributes of each image. All others are of the series.
const OF_INSTANCE: [&str; 2] = ["ImageType", "PhotometricInterpretation"];

/// Values with their representations, by tag, such as `00100010`. This is patient data.
#[derive(Clone, Default)]
pub(crate) struct Values(BTreeMap<String, (&'static str, String)>);

impl Values {
    /// Adds a value by its keyword.
    pub(crate) fn put(&mut self, keyword: &str, text: impl Into<String>) {
        if let Some(known) = attribute(keyword) {
            self.0.insert(known.name(), (known.vr, text.into()));
        }
    }

    /// Adds all values of others.
    pub(crate) fn extend(&mut self, others: &Self) {
        let others = others.0.iter();
        self.0
            .extend(others.map(|(tag, value)| (tag.clone(), value.clone())));
    }

    /// The text of an attribute.
    pub(crate) fn text(&self, tag: &str) -> Option<&str> {
        self.0.get(tag).map(|(_, text)| text.as_str())
    }

    /// Tag, representation and text of each, in the order of tags.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &'static str, &str)> {
        let each = self.0.iter();
        each.map(|(tag, (vr, text))| (tag.as_str(), *vr, text.as_str()))
    }
}

/// An image or another object.
pub(crate) struct HeldInstance {
    pub(crate) uid: Uid,
    pub(crate) values: Values,
    /// Its file, if it may be retrieved.
    pub(crate) object: Option<ObjectName>,
}

pub(crate) struct HeldSeries {
    pub(crate) uid: Uid,
    pub(crate) values: Values,
    pub(crate) instances: Vec<HeldInstance>,
}

/// What there is of one patient in a study. By a mistake of the sender, a study may have images of several.
pub(crate) struct HeldStudy {
    pub(crate) uid: Uid,
    patient: Option<Patient>,
    /// The cases that its series became.
    cases: Vec<CaseId>,
    pub(crate) values: Values,
    pub(crate) series: Vec<HeldSeries>,
}

fn missing() -> AppError {
    let detail = "no case was made of this study, series or instance, or it was deleted";
    AppError::not_found("no-such-study", detail)
}

/// The answer to a request for images that are not kept.
pub(crate) fn not_kept() -> AppError {
    AppError::not_found(
        "images-not-kept",
        "the images are not kept here; set `keep_source = true` in `[pacs]` before they come, or retrieve them from the PACS",
    )
}

/// The files of those instances that may be retrieved; at least one.
pub(crate) fn files_of(studies: &[HeldStudy]) -> Result<Vec<ObjectName>, AppError> {
    let series = studies.iter().flat_map(|study| &study.series);
    let instances = series.flat_map(|series| &series.instances);
    let objects: Vec<_> = instances.filter_map(|instance| instance.object).collect();
    match objects.is_empty() {
        true => Err(not_kept()),
        false => Ok(objects),
    }
}

impl HeldStudy {
    /// The study of each patient with what the address names of it; at least one instance.
    pub(crate) async fn named(pacs: &Pacs, named: &Named) -> Result<Vec<Self>, AppError> {
        let uid = Uid::parse(&named.study).ok_or_else(missing)?;
        let mut studies = Self::load(pacs, &uid).await?;
        let is_named = |uid: &Uid, named: &Option<String>| {
            named.as_deref().is_none_or(|named| named == uid.as_str())
        };
        for study in &mut studies {
            study.series.retain_mut(|series| {
                let instances = &mut series.instances;
                instances.retain(|instance| is_named(&instance.uid, &named.instance));
                is_named(&series.uid, &named.series) && !instances.is_empty()
            });
        }
        studies.retain(|study| !study.series.is_empty());
        match studies.is_empty() {
            true => Err(missing()),
            false => Ok(studies),
        }
    }

    /// A study of each patient; none if no case was made of it.
    pub(crate) async fn load(pacs: &Pacs, uid: &Uid) -> Result<Vec<Self>, AppError> {
        let store = pacs.cases().store();
        let mut cases = store
            .cases_of(&SeriesQuery::Study(uid.clone(), None))
            .await?;
        // Those of a wrong patient are not shown at all.
        cases.retain(|case| !case.is_superseded());
        // The newest case of a series has all of its images; an upload may not be what the PACS has sent.
        cases.sort_by_key(|case| !case.is_received);
        let mut studies: Vec<Self> = Vec::new();
        for case in cases {
            Self::add_source(&mut studies, pacs, case).await?;
        }
        for result in store.results_of(uid, false).await? {
            // A case from NIfTI has no series of the study.
            let is_only = studies.len() == 1;
            let is_of = |study: &&mut Self| is_only || study.cases.contains(&result.case);
            if let Some(study) = studies.iter_mut().find(is_of) {
                study.series.push(of_result(result));
            }
        }
        for study in &mut studies {
            study.summarise();
        }
        Ok(studies)
    }

    fn empty(uid: Uid) -> Self {
        Self {
            uid,
            patient: None,
            cases: Vec::new(),
            values: Values::default(),
            series: Vec::new(),
        }
    }

    /// Adds the series of a case to the study of its patient; nothing but the case if that has the series.
    async fn add_source(
        studies: &mut Vec<Self>,
        pacs: &Pacs,
        case: CaseSeries,
    ) -> Result<(), AppError> {
        let store = pacs.cases().store();
        let uid = case.uids.series.clone();
        let mut series = HeldSeries {
            values: Values::default(),
            instances: Vec::new(),
            uid,
        };
        // What is known although the object with the attributes is damaged.
        let mut of_study = Values::default();
        if let Some(number) = &case.accession_number {
            of_study.put("AccessionNumber", number.as_str());
        }
        let stored = pacs.cases().attributes_of(&case.case).await?;
        let patient = (stored.as_ref()).map(|stored| Patient::of(|keyword| stored.value(keyword)));
        // Of damaged attributes nobody knows whose they are.
        let is_same = |study: &&mut Self| match (&study.patient, &patient) {
            (Some(one), Some(other)) => one == other,
            _ => true,
        };
        let study = match studies.iter_mut().find(is_same) {
            Some(study) => study,
            None => {
                studies.push(Self::empty(case.uids.study.clone()));
                studies.last_mut().expect("one was added")
            }
        };
        let is_new = !study.series.iter().any(|known| known.uid == series.uid);
        if let (Some(attributes), true) = (stored, is_new || study.patient.is_none()) {
            let held = store.case(&case.case).await?;
            let facts = held.and_then(|case| case.facts);
            // Images that the PACS has sent are not those of an upload, even if they have the same UIDs.
            let objects = match case.is_received {
                true => kept(pacs, &case.uids).await?,
                false => HashMap::new(),
            };
            series.read(&attributes, &mut of_study);
            series.list(&attributes, facts.as_ref(), &objects);
        }
        if study.patient.is_none() {
            study.values.extend(&of_study);
            study.patient = patient;
        }
        study.cases.push(case.case);
        if is_new {
            study.series.push(series);
        }
        Ok(())
    }

    /// Enters what follows from the parts: counts, modalities, addresses.
    fn summarise(&mut self) {
        let mut modalities: Vec<String> = Vec::new();
        let (mut count, mut are_here) = (0, false);
        let study_address = format!("/dicomweb/studies/{}", self.uid.as_str());
        for series in &mut self.series {
            let address = format!("{study_address}/series/{}", series.uid.as_str());
            let here = series.instances.iter().any(|each| each.object.is_some());
            for instance in &mut series.instances {
                let address = format!("{address}/instances/{}", instance.uid.as_str());
                let here = instance.object.is_some();
                instance.values.put("SOPInstanceUID", instance.uid.as_str());
                place(&mut instance.values, here, &address);
            }
            let values = &mut series.values;
            if let Some(modality) = values.text("00080060")
                && !modalities.iter().any(|known| known == modality)
            {
                modalities.push(modality.to_owned());
            }
            count += series.instances.len();
            are_here |= here;
            values.put("SeriesInstanceUID", series.uid.as_str());
            let related = series.instances.len().to_string();
            values.put("NumberOfSeriesRelatedInstances", related);
            place(values, here, &address);
        }
        let values = &mut self.values;
        values.put("SpecificCharacterSet", "ISO_IR 192");
        values.put("StudyInstanceUID", self.uid.as_str());
        values.put("ModalitiesInStudy", modalities.join("\\"));
        let related = self.series.len().to_string();
        values.put("NumberOfStudyRelatedSeries", related);
        values.put("NumberOfStudyRelatedInstances", count.to_string());
        place(values, are_here, &study_address);
    }
}

/// Whether it may be retrieved, and where.
fn place(values: &mut Values, is_here: bool, address: &str) {
    let (availability, address) = match is_here {
        true => ("ONLINE", address),
        false => ("UNAVAILABLE", ""),
    };
    values.put("InstanceAvailability", availability);
    values.put("RetrieveURL", address);
}

/// The files of a series, if they may be retrieved.
async fn kept(pacs: &Pacs, uids: &SeriesUids) -> Result<HashMap<Uid, ObjectName>, AppError> {
    if !pacs.serves_source() {
        return Ok(HashMap::new());
    }
    let images = pacs.cases().store().images_of(uids).await?;
    Ok(images.into_iter().collect())
}

impl HeldSeries {
    /// The attributes of the source.
    fn read(&mut self, source: &Attributes, of_study: &mut Values) {
        for (keyword, text) in &source.attributes {
            if OF_STUDY.contains(&keyword.as_str()) {
                of_study.put(keyword, text);
            } else if !OF_INSTANCE.contains(&keyword.as_str()) {
                self.values.put(keyword, text);
            }
        }
    }

    /// The images of the source.
    fn list(
        &mut self,
        source: &Attributes,
        facts: Option<&CaseFacts>,
        objects: &HashMap<Uid, ObjectName>,
    ) {
        let mut common = Values::default();
        for (keyword, text) in &source.attributes {
            if OF_INSTANCE.contains(&keyword.as_str()) {
                common.put(keyword, text);
            }
        }
        let places = facts.map(|facts| places(source, facts)).unwrap_or_default();
        let mut seen = HashSet::new();
        for (number, instance) in source.instances.iter().enumerate() {
            let Some(uid) = Uid::parse(&instance.sop_instance_uid) else {
                continue;
            };
            if !seen.insert(uid.clone()) {
                continue;
            }
            let mut values = common.clone();
            values.put("SOPClassUID", &instance.sop_class_uid);
            // Of a multi-frame image, the number is that of the frame.
            if let Some(number) = instance.number.filter(|_| instance.frame.is_none()) {
                values.put("InstanceNumber", number.to_string());
            }
            if let Some(place) = places.get(number) {
                values.extend(place);
            }
            self.instances.push(HeldInstance {
                object: objects.get(&uid).copied(),
                uid,
                values,
            });
        }
    }
}

/// Size and place of each image of a series with one slice in each; none if they are not known.
fn places(source: &Attributes, facts: &CaseFacts) -> Vec<Values> {
    let [columns, rows, slices] = facts.native_size;
    let interpolated = &source.interpolated_slices;
    let are_single = source.instances.iter().all(|each| each.frame.is_none());
    if !are_single || source.instances.len() + interpolated.len() != slices {
        return Vec::new();
    }
    let [x, y, z, _] = facts.native_patient_from_voxel;
    let column_of = |number: usize| [x[number], y[number], z[number]];
    let length = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
    let texts = |numbers: &[f64]| {
        let texts: Vec<String> = numbers.iter().map(f64::to_string).collect();
        texts.join("\\")
    };
    let [along_row, down_column, between] = [0, 1, 2].map(column_of);
    let spacing = [length(down_column), length(along_row)];
    let directions: Vec<f64> = along_row
        .map(|part| part / spacing[1])
        .into_iter()
        .chain(down_column.map(|part| part / spacing[0]))
        .collect();
    let origin = column_of(3);
    let acquired = (0..slices).filter(|slice| !interpolated.contains(&(slice + 1)));
    let place = |slice: usize| {
        let mut values = Values::default();
        let position = [0, 1, 2].map(|axis| origin[axis] + slice as f64 * between[axis]);
        values.put("Rows", rows.to_string());
        values.put("Columns", columns.to_string());
        values.put("PixelSpacing", texts(&spacing));
        values.put("ImageOrientationPatient", texts(&directions));
        values.put("ImagePositionPatient", texts(&position));
        values
    };
    acquired.map(place).collect()
}

fn of_result(result: HeldResult) -> HeldSeries {
    let HeldResult {
        instance,
        series,
        object,
        ..
    } = result;
    let modality = match series.sop_class_uid.as_str() {
        imaging::dicom::write::SEGMENTATION => "SEG",
        imaging::dicom::write::KEY_OBJECT => "KO",
        imaging::dicom::write::MEASUREMENT_REPORT => "SR",
        imaging::dicom::write::REPORT => "DOC",
        _ => "OT",
    };
    let mut values = Values::default();
    values.put("Modality", modality);
    values.put("SeriesNumber", series.number.to_string());
    values.put("SeriesDescription", series.description);
    let mut of_instance = Values::default();
    of_instance.put("SOPClassUID", series.sop_class_uid.as_str());
    of_instance.put("InstanceNumber", "1");
    HeldSeries {
        uid: series.series_uid,
        values,
        instances: vec![HeldInstance {
            uid: instance,
            values: of_instance,
            object: Some(object),
        }],
    }
}
