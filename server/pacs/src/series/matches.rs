//! What a query finds: heads, and series that make no case (yet), which can belong to another patient.

use case::series::{AccessionNumber, SeriesQuery, SeriesUids, Uid};
use case::{CaseState, Closed, Failure};
use cases::{Error, Patient};
use storage::ObjectName;
use storage::tables::series::cases_of;

use super::{Arrivals, Head};
use crate::values::{
    Arrival, ArrivalState, INCOMPLETE_CORRECTION, MOVED, OTHER_OBJECTS, REJECTED, images_rejected,
};

/// The reason of a series with images of several patients.
const MIXED_PATIENTS: &str = "dicom-mixed-patients";

/// What a query finds.
#[derive(Debug, Default)]
pub(crate) struct Matches {
    /// The cases, as [`Arrivals::heads`].
    pub(crate) heads: Vec<Head>,
    /// The series that make no case.
    pub(crate) without_case: Vec<SeriesWithoutCase>,
}

/// A series that makes no case.
#[derive(Debug)]
pub(crate) struct SeriesWithoutCase {
    /// The series and its study.
    pub(crate) uids: SeriesUids,
    /// The accession number of its study.
    pub(crate) accession_number: Option<AccessionNumber>,
    /// What lists call it.
    pub(crate) label: Option<String>,
    /// What has become of it; never a case.
    pub(crate) state: ArrivalState,
    /// Why it is no case.
    pub(crate) reason: Option<Failure>,
    /// Its patient; `None` if none of its images is kept.
    pub(crate) patient: Option<Patient>,
}

impl SeriesWithoutCase {
    /// The word for what has become of it, in answers.
    pub(crate) fn word(&self) -> &'static str {
        let reason = self.reason.as_ref();
        match self.state {
            ArrivalState::Nothing if reason.is_some_and(|reason| reason.name == REJECTED) => {
                REJECTED
            }
            state => state.name(),
        }
    }

    /// Whether it is of another patient than a head. If no image of it is kept, it counts as of the patient of its study.
    fn is_of_another(&self, head: &Head) -> bool {
        match (&self.patient, head.patient()) {
            (Some(own), Some(of_head)) => *own != of_head,
            _ => self.uids.study != head.series.uids.study,
        }
    }
}

impl Matches {
    /// Whether the query does not tell which patient is meant, or which study: its cases are of several ones, or something that
    /// makes no case is of another patient.
    pub(crate) fn is_ambiguous(&self) -> bool {
        let Some(first) = self.heads.first() else {
            return false;
        };
        let (failed, usable): (Vec<_>, Vec<_>) = (self.heads.iter()).partition(|head| {
            head.case.state == CaseState::Failed && head.case.id != first.case.id
        });
        let owner = |head: &Head| (head.series.uids.study.clone(), head.patient());
        let of_another = |head: &&Head| match (head.patient(), first.patient()) {
            (Some(one), Some(other)) => one != other,
            _ => head.series.uids.study != first.series.uids.study,
        };
        usable.iter().any(|head| owner(head) != owner(first))
            || failed.iter().any(of_another)
            || self.of_another().next().is_some()
    }

    /// The series that make no case and are of another patient than the first head.
    pub(crate) fn of_another(&self) -> impl Iterator<Item = &SeriesWithoutCase> {
        let first = self.heads.first();
        let others = self.without_case.iter();
        others.filter(move |other| first.is_some_and(|first| other.is_of_another(first)))
    }
}

impl Arrivals {
    /// What a query finds: its heads, and what makes no case but says that another patient is there. What a PACS has corrected
    /// or moved says so no longer.
    ///
    /// # Errors
    /// If the rows or the patient of an image cannot be read.
    pub(crate) async fn matches(&self, query: &SeriesQuery) -> Result<Matches, Error> {
        let heads = self.heads(query).await?;
        let heads_of = |uids: SeriesUids| heads.iter().filter(move |head| head.series.uids == uids);
        // An upload may have the UIDs of a series of another patient. One whose patient is not known counts as of the same.
        let is_head = |uids: &SeriesUids, patient: Option<&Patient>| {
            let mut heads = heads_of(uids.clone()).peekable();
            heads.peek().is_some()
                && patient.is_none_or(|own| heads.any(|head| head.patient().as_ref() == Some(own)))
        };
        let mut telling = Vec::new();
        for arrival in self.store().arrivals_of(query).await? {
            let is_layer_of_head = arrival.state == ArrivalState::Layer
                && heads.iter().any(|head| Some(head.case.id) == arrival.case);
            let is_case_of_head = arrival.state == ArrivalState::Case
                && heads_of(arrival.uids.clone()).any(|head| Some(head.case.id) == arrival.case);
            if !is_case_of_head && !is_layer_of_head && says_something(&arrival) {
                telling.push(arrival);
            }
        }
        let patients = self.patients_of_series(&telling).await?;
        let others = telling.iter().zip(patients);
        let others = others.flat_map(|(arrival, patients)| without_case_of(arrival, patients));
        let is_other = |other: &SeriesWithoutCase| !is_head(&other.uids, other.patient.as_ref());
        let mut without_case: Vec<_> = others.filter(is_other).collect();
        // Arrivals are forgotten before their cases. What was corrected says nothing any more, nor what the series has a head instead of.
        let cases = cases_of(&mut self.cases.store().connect().await?, query).await?;
        for (id, series) in cases {
            let case = self.cases.store().case(&id).await?;
            if case.and_then(|case| case.closed) != Some(Closed::Rejected) {
                continue;
            }
            let source = self.cases.attributes_of(&id).await?;
            let patient = source.map(|source| Patient::of(|keyword| source.value(keyword)));
            if heads_of(series.uids.clone()).next().is_some() {
                continue;
            }
            let known = without_case
                .iter_mut()
                .find(|other| other.uids == series.uids);
            match known {
                Some(other) => other.patient = other.patient.take().or(patient),
                None => without_case.push(SeriesWithoutCase {
                    uids: series.uids,
                    accession_number: series.accession_number,
                    label: None,
                    state: ArrivalState::Nothing,
                    reason: Some(images_rejected()),
                    patient,
                }),
            }
        }
        Ok(Matches {
            heads,
            without_case,
        })
    }

    /// The patients of each of these series, in its images. There may be hundreds of series, so all images are read at once.
    async fn patients_of_series(&self, series: &[Arrival]) -> Result<Vec<Vec<Patient>>, Error> {
        let (mut images, mut counts) = (Vec::new(), Vec::with_capacity(series.len()));
        for arrival in series {
            let of_series = self.images_that_tell(arrival).await?;
            counts.push(of_series.len());
            images.extend(of_series);
        }
        let mut patients = self.patient_of_each(&images).await?.into_iter();
        let of_series = counts.into_iter();
        Ok(of_series
            .map(|count| distinct(patients.by_ref().take(count)))
            .collect())
    }

    /// The images that tell the patients of a series.
    async fn images_that_tell(&self, arrival: &Arrival) -> Result<Vec<ObjectName>, Error> {
        let mut images: Vec<_> = match arrival.instances {
            0 => Vec::new(),
            _ => self.store().counting_images_of(&arrival.uids).await?,
        };
        // Of all series but these, one image is enough.
        if !may_be_of_several(arrival) {
            images.truncate(1);
        }
        Ok(images)
    }

    /// The patients of a study, in its cases and in what makes none.
    pub(super) async fn patients_of_study(&self, study: &Uid) -> Result<Vec<Patient>, Error> {
        let query = SeriesQuery::Study(study.clone(), None);
        let mut telling = self.store().arrivals_of(&query).await?;
        telling.retain(says_something);
        let patients = self.patients_of_series(&telling).await?;
        let mut patients: Vec<_> = patients.into_iter().flatten().collect();
        let cases = cases_of(&mut self.cases.store().connect().await?, &query).await?;
        for (id, _) in cases {
            let case = self.cases.store().case(&id).await?;
            if case.is_some_and(|case| case.closed.is_none())
                && let Some(source) = self.cases.attributes_of(&id).await?
            {
                patients.push(Patient::of(|keyword| source.value(keyword)));
            }
        }
        Ok(patients)
    }

    /// Whether the PACS has sent images of a series as those of another patient than this one.
    pub(super) async fn are_sent_of_another(
        &self,
        uids: &SeriesUids,
        patient: &Patient,
    ) -> Result<bool, Error> {
        let stored = self.store().counting_images_of(uids).await?;
        self.states_another(&stored, patient).await
    }

    /// Whether any of these stored images states another patient than this one, if it is stated.
    async fn states_another(
        &self,
        images: &[ObjectName],
        patient: &Patient,
    ) -> Result<bool, Error> {
        if !patient.is_stated() {
            return Ok(false);
        }
        let stated = self.patients_of_images(images).await?;
        let is_another = |stated: &Patient| stated.is_stated() && stated != patient;
        Ok(stated.iter().any(is_another))
    }

    /// The patients of stored images; none of images that are lost.
    pub(super) async fn patients_of_images(
        &self,
        images: &[ObjectName],
    ) -> Result<Vec<Patient>, Error> {
        Ok(distinct(self.patient_of_each(images).await?))
    }

    /// The patient of each of these stored images; `None` of one that is lost or cannot be read.
    async fn patient_of_each(&self, images: &[ObjectName]) -> Result<Vec<Option<Patient>>, Error> {
        let known = images.iter().map(|image| self.patients.get(image));
        let mut patients: Vec<_> = known.collect();
        let mut unread: Vec<_> = (0..images.len())
            .filter(|&number| patients[number].is_none())
            .collect();
        if unread.is_empty() {
            return Ok(patients);
        }
        let names: Vec<_> = unread.iter().map(|&number| images[number]).collect();
        let mut read = self.readable_patients_of(&names).await?;
        // One that cannot be read hides none of the others.
        if read.is_none() && unread.len() > 1 {
            let mut found = Vec::new();
            for number in std::mem::take(&mut unread) {
                if let Some(one) = self.readable_patients_of(&[images[number]]).await? {
                    found.extend(one);
                    unread.push(number);
                }
            }
            read = Some(found);
        }
        for (number, patient) in unread.into_iter().zip(read.unwrap_or_default()) {
            self.patients.insert(images[number], patient.clone());
            patients[number] = Some(patient);
        }
        Ok(patients)
    }
}

impl Arrivals {
    /// The patients of stored images; `None` if one is lost, or cannot be read now or ever.
    async fn readable_patients_of(
        &self,
        images: &[ObjectName],
    ) -> Result<Option<Vec<Patient>>, Error> {
        match self.cases.patients_of(images).await {
            Err(Error::Failure(_)) => Ok(None),
            read => read,
        }
    }
}

/// What a series says, once for each of its patients.
fn without_case_of(arrival: &Arrival, patients: Vec<Patient>) -> Vec<SeriesWithoutCase> {
    let patients = match patients.is_empty() {
        true => vec![None],
        false => patients.into_iter().map(Some).collect(),
    };
    let other = |patient| SeriesWithoutCase {
        state: match arrival.state {
            ArrivalState::Case => ArrivalState::Nothing,
            state => state,
        },
        uids: arrival.uids.clone(),
        accession_number: arrival.accession_number.clone(),
        label: arrival.label.clone(),
        reason: arrival.reason.clone(),
        patient,
    };
    patients.into_iter().map(other).collect()
}

/// Each patient once.
fn distinct(patients: impl IntoIterator<Item = Option<Patient>>) -> Vec<Patient> {
    let mut distinct = Vec::new();
    for patient in patients.into_iter().flatten() {
        if !distinct.contains(&patient) {
            distinct.push(patient);
        }
    }
    distinct
}

/// Whether the images of a series may be of several patients: those that are still coming, or that were refused for it.
fn may_be_of_several(arrival: &Arrival) -> bool {
    let is_mixed =
        |reason: &Failure| [MIXED_PATIENTS, INCOMPLETE_CORRECTION].contains(&&*reason.name);
    arrival.state == ArrivalState::Receiving || arrival.reason.as_ref().is_some_and(is_mixed)
}

/// Whether a series that makes no case says that its patient is there. One without images was moved, or never had any.
fn says_something(arrival: &Arrival) -> bool {
    let is_gone = |reason: &Failure| [MOVED, OTHER_OBJECTS].contains(&&*reason.name);
    let is_gone = arrival.is_all_refused() || arrival.reason.as_ref().is_some_and(is_gone);
    arrival.instances > 0 || !is_gone
}
