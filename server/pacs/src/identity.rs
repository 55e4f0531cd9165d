//! What an object of a PACS is and which series it belongs to.

use case::images::Fingerprint;
use case::series::{AccessionNumber, SeriesUids, Uid};
use case::{Failure, Parameters};
use cases::dicom::READER_DIED;
use cases::{Cases, Error};
use imaging::dicom::Identity;
use storage::Spooled;

/// What a rejection note withdraws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rejection {
    /// Whether an instance counts again when it comes again.
    pub may_return: bool,
    /// The instances of each series.
    pub series: Vec<(SeriesUids, Vec<Uid>)>,
}

/// What an instance is and which series it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct InstanceIdentity {
    pub sop_class_uid: Uid,
    pub sop_instance_uid: Uid,
    pub uids: SeriesUids,
    /// The accession number of its study.
    pub accession_number: Option<AccessionNumber>,
    /// What lists call its series.
    pub label: Option<String>,
    /// Whether it is an MR or CT image.
    pub is_image: bool,
    /// What it rejects, if it is a rejection note.
    pub rejection: Option<Rejection>,
    /// What it states and shows, if it is an image whose pixels can be decoded.
    pub fingerprint: Option<Fingerprint>,
}

fn replaced(uid: &Uid) -> Uid {
    let uid = imaging::dicom::replaced_uid(uid.as_str());
    Uid::parse(&uid).expect("digits and points are a UID")
}

/// The UIDs in place of those of a series.
pub(crate) fn replaced_series(uids: &SeriesUids) -> SeriesUids {
    SeriesUids {
        study: replaced(&uids.study),
        series: replaced(&uids.series),
    }
}

/// The study and the series of a file that is refused, if a confined process can read them. A file that ended one is not read again.
pub(crate) async fn series_of(cases: &Cases, file: &Spooled, why: &Failure) -> Option<SeriesUids> {
    if why.name == READER_DIED {
        return None;
    }
    let [study, series] = cases.headers.series_of(file).await.ok()?;
    Some(SeriesUids {
        study: Uid::parse(&study)?,
        series: Uid::parse(&series)?,
    })
}

impl InstanceIdentity {
    /// The same with other UIDs, and without accession number and label.
    pub(crate) fn deidentified(self) -> Self {
        let replaced_rejection = |rejection: Rejection| Rejection {
            series: rejection
                .series
                .iter()
                .map(|(uids, instances)| {
                    let instances = instances.iter().map(replaced).collect();
                    (replaced_series(uids), instances)
                })
                .collect(),
            ..rejection
        };
        Self {
            sop_instance_uid: replaced(&self.sop_instance_uid),
            uids: replaced_series(&self.uids),
            rejection: self.rejection.map(replaced_rejection),
            accession_number: None,
            label: None,
            ..self
        }
    }

    /// What the confined process says that a file is.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the file, or that its process died; [`Error::Busy`] if too many wait; or another
    /// [`Error`] if the process cannot be started.
    pub(crate) async fn read(cases: &Cases, file: &Spooled) -> Result<Self, Error> {
        Self::checked(cases.headers.read(file).await?)
    }

    /// An answer that may be passed on.
    pub(crate) fn checked(identity: Identity) -> Result<Self, Error> {
        let uid = |name, text: &str| Uid::parse(text).ok_or_else(|| bad_uid(name));
        Ok(Self {
            sop_class_uid: uid("SOP Class UID", &identity.sop_class_uid)?,
            sop_instance_uid: uid("SOP Instance UID", &identity.sop_instance_uid)?,
            uids: SeriesUids {
                study: uid("Study Instance UID", &identity.study_uid)?,
                series: uid("Series Instance UID", &identity.series_uid)?,
            },
            accession_number: identity
                .accession_number
                .as_deref()
                .and_then(AccessionNumber::parse),
            label: identity
                .label
                .filter(|label| Parameters::check_name(label).is_ok()),
            is_image: identity.is_image,
            rejection: (identity.rejection.as_ref())
                .map(|rejection| {
                    let checked = checked_rejection(rejection);
                    checked.ok_or_else(|| bad_uid("list of UIDs"))
                })
                .transpose()?,
            fingerprint: (identity.fingerprint)
                .map(|print| {
                    let checked =
                        Fingerprint::new(&print.contents, print.is_lossy, print.corners_mm);
                    let why = "what the image shows cannot be read";
                    checked.ok_or_else(|| Failure::unusable("dicom-damaged", why))
                })
                .transpose()?,
        })
    }
}

fn checked_rejection(rejection: &imaging::dicom::Rejection) -> Option<Rejection> {
    let series = rejection.series.iter().map(|rejected| {
        let uids = SeriesUids {
            study: Uid::parse(&rejected.study_uid)?,
            series: Uid::parse(&rejected.series_uid)?,
        };
        let instances = rejected.instance_uids.iter();
        let instances = instances
            .map(|uid| Uid::parse(uid))
            .collect::<Option<_>>()?;
        Some((uids, instances))
    });
    Some(Rejection {
        may_return: rejection.may_return,
        series: series.collect::<Option<_>>()?,
    })
}

fn bad_uid(name: &str) -> Failure {
    let detail = format!(
        "its {name} is no UID (up to 64 digits and points); export the images with valid UIDs"
    );
    Failure::unusable("dicom-damaged", detail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_that_is_none_is_not_passed_on() {
        let identity = |uid: &str| Identity {
            sop_class_uid: "1.2".to_owned(),
            sop_instance_uid: uid.to_owned(),
            study_uid: "1.3".to_owned(),
            series_uid: "1.4".to_owned(),
            accession_number: None,
            label: None,
            is_image: true,
            rejection: None,
            fingerprint: None,
        };
        let read = InstanceIdentity::checked(identity("1.5")).unwrap();
        assert_eq!(read.sop_instance_uid.as_str(), "1.5");
        assert_eq!(read.uids.series.as_str(), "1.4");
        let lie = InstanceIdentity::checked(identity("Somebody^Secret"));
        assert!(matches!(lie, Err(Error::Failure(failure)) if failure.name == "dicom-damaged"));
    }
}
