//! What a query finds besides the heads: series that make no case (yet). They can belong to another patient.

use case::{CaseState, Failure};
use storage::ObjectName;
use storage::arrivals::{
    AccessionNumber, Arrival, ArrivalStatus, MOVED, OTHER_OBJECTS, REJECTED, SeriesQuery,
    SeriesUids, Superseded,
};

use super::{Head, Patient};
use crate::application::Cases;
use crate::error::Error;

/// What a query finds.
#[derive(Debug, Default)]
pub struct Fitting {
    /// The cases, as [`Cases::heads`].
    pub heads: Vec<Head>,
    /// The series that make no case.
    pub others: Vec<Other>,
}

/// A series that makes no case.
#[derive(Debug)]
pub struct Other {
    /// The series and its study.
    pub uids: SeriesUids,
    /// The accession number of its study.
    pub accession_number: Option<AccessionNumber>,
    /// What lists call it.
    pub label: Option<String>,
    /// What has become of it; never a case.
    pub status: ArrivalStatus,
    /// Why it is no case.
    pub reason: Option<Failure>,
    /// Its patient; `None` if none of its images is kept.
    pub patient: Option<Patient>,
}

impl Other {
    /// The word for what has become of it, in answers.
    pub fn state(&self) -> &'static str {
        let reason = self.reason.as_ref();
        match self.status {
            ArrivalStatus::Nothing if reason.is_some_and(|reason| reason.name == REJECTED) => {
                REJECTED
            }
            status => status.name(),
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

impl Fitting {
    /// Whether the query does not tell which patient is meant, or which study: its cases are of several ones, or something that
    /// makes no case is of another patient.
    pub fn is_ambiguous(&self) -> bool {
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
    pub fn of_another(&self) -> impl Iterator<Item = &Other> {
        let first = self.heads.first();
        let others = self.others.iter();
        others.filter(move |other| first.is_some_and(|first| other.is_of_another(first)))
    }
}

impl Cases {
    /// What a query finds: its heads, and what makes no case but says that another patient is there. What a PACS has corrected
    /// or moved says so no longer.
    ///
    /// # Errors
    /// If the rows or the patient of an image cannot be read.
    pub async fn fitting(&self, query: &SeriesQuery) -> Result<Fitting, Error> {
        let heads = self.heads(query).await?;
        let heads_of = |uids: SeriesUids| heads.iter().filter(move |head| head.series.uids == uids);
        // An upload may have the UIDs of a series of another patient. One whose patient is not known counts as of the same.
        let is_head = |uids: &SeriesUids, patient: Option<&Patient>| {
            let mut heads = heads_of(uids.clone()).peekable();
            heads.peek().is_some()
                && patient.is_none_or(|own| heads.any(|head| head.patient().as_ref() == Some(own)))
        };
        let mut others = Vec::new();
        for arrival in self.store().arrivals_of(query).await? {
            let is_layer_of_head = arrival.status() == ArrivalStatus::Layer
                && heads.iter().any(|head| Some(head.case.id) == arrival.case);
            let is_case_of_head = arrival.status() == ArrivalStatus::Case
                && heads_of(arrival.uids.clone()).any(|head| Some(head.case.id) == arrival.case);
            if is_case_of_head || is_layer_of_head || !says_something(&arrival) {
                continue;
            }
            let other = self.other(arrival).await?;
            if !is_head(&other.uids, other.patient.as_ref()) {
                others.push(other);
            }
        }
        // Arrivals are forgotten before their cases.
        for series in self.store().cases_of(query).await? {
            if series.superseded != Some(Superseded::Rejected) {
                continue;
            }
            let source = self.attributes_of(&series.case).await?;
            let patient = source.map(|source| Patient::of(|keyword| source.value(keyword)));
            if is_head(&series.uids, patient.as_ref()) {
                continue;
            }
            let known = others.iter_mut().find(|other| other.uids == series.uids);
            match known {
                Some(other) => other.patient = other.patient.take().or(patient),
                None => others.push(Other {
                    uids: series.uids,
                    accession_number: series.accession_number,
                    label: None,
                    status: ArrivalStatus::Nothing,
                    reason: Some(super::rejection::reason()),
                    patient,
                }),
            }
        }
        Ok(Fitting { heads, others })
    }

    async fn other(&self, arrival: Arrival) -> Result<Other, Error> {
        let images = match arrival.instances {
            0 => Vec::new(),
            _ => self.store().images_of(&arrival.uids).await?,
        };
        let patient = match images.first() {
            Some((_, image)) => self.patient_of_image(*image).await?,
            None => None,
        };
        Ok(Other {
            status: match arrival.status() {
                ArrivalStatus::Case => ArrivalStatus::Nothing,
                status => status,
            },
            uids: arrival.uids,
            accession_number: arrival.accession_number,
            label: arrival.label,
            reason: arrival.reason,
            patient,
        })
    }

    /// The patient of a stored image; `None` if it is lost.
    async fn patient_of_image(&self, image: ObjectName) -> Result<Option<Patient>, Error> {
        if let Some(patient) = self.patients.get(&image) {
            return Ok(Some(patient));
        }
        let read = match self.stored_metadata(&[image]).await {
            Ok(read) => read.and_then(|all| all.into_iter().next()),
            // It cannot be read now or ever.
            Err(Error::Failure(_)) => None,
            Err(error) => return Err(error),
        };
        let patient = read.map(|image| {
            Patient::of(|keyword| {
                let tag = imaging::dicom::attribute(keyword)?.name();
                let value = &image[&tag]["Value"][0];
                value.as_str().or_else(|| value["Alphabetic"].as_str())
            })
        });
        if let Some(patient) = &patient {
            self.patients.insert(image, patient.clone());
        }
        Ok(patient)
    }
}

/// Whether a series that makes no case says that its patient is there. One without images was moved, or never had any.
fn says_something(arrival: &Arrival) -> bool {
    let is_gone = |reason: &Failure| [MOVED, OTHER_OBJECTS].contains(&&*reason.name);
    arrival.instances > 0 || !arrival.reason.as_ref().is_some_and(is_gone)
}
