//! Reads what a file is and which series it belongs to.

use std::path::Path;

use case::images::Fingerprint;
use case::series::{AccessionNumber, SeriesUids, Uid};
use case::{Failure, Parameters};
use imaging::dicom::{Identity, MarkedPatient};
use storage::Spooled;

use worker::{FileReader, at_a_time};

use crate::error::Error;
use crate::limit::ConcurrencyLimit;

/// Files that may wait.
const WAITING: usize = 256;

/// What a rejection note withdraws.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rejection {
    /// Whether an instance counts again when it comes again.
    pub may_return: bool,
    /// The instances of each series.
    pub series: Vec<(SeriesUids, Vec<Uid>)>,
}

/// What an instance is and which series it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceIdentity {
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

impl InstanceIdentity {
    /// The same with other UIDs, and without accession number and label.
    pub fn deidentified(self) -> Self {
        let replaced = |uid: &Uid| {
            let uid = imaging::dicom::replaced_uid(uid.as_str());
            Uid::parse(&uid).expect("digits and points are a UID")
        };
        let replaced_series = |uids: &SeriesUids| SeriesUids {
            study: replaced(&uids.study),
            series: replaced(&uids.series),
        };
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

    /// An answer that may be passed on.
    fn checked(identity: Identity) -> Result<Self, Failure> {
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
                    let checked = checked_fingerprint(print);
                    let why = "what the image shows cannot be read";
                    checked.ok_or_else(|| Failure::unusable("dicom-damaged", why))
                })
                .transpose()?,
        })
    }
}

/// A fingerprint of the child; `None` if it is none.
pub(super) fn checked_fingerprint(print: imaging::dicom::Fingerprint) -> Option<Fingerprint> {
    Fingerprint::new(&print.contents, print.is_lossy, print.corners_mm)
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

/// Reads the headers of files. If many wait, the clients ([`for_client`](crate::for_client)) take turns.
#[derive(Debug)]
pub struct HeaderReader {
    reader: FileReader,
    limit: ConcurrencyLimit,
}

impl HeaderReader {
    /// As `reader`, a bounded number at a time.
    pub(crate) fn new(reader: FileReader) -> Self {
        Self {
            reader,
            limit: ConcurrencyLimit::new(at_a_time(), WAITING),
        }
    }

    /// What a file is.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the file, or that its process died; [`Error::Busy`] if too many
    /// wait; [`Error::Internal`], logged, if the process cannot be started.
    pub async fn read(&self, file: &Spooled) -> Result<InstanceIdentity, Error> {
        let _turn = self.limit.turn().await?;
        Ok(InstanceIdentity::checked(
            self.reader.identity(file).await?,
        )?)
    }

    /// The findings of a measurement report.
    ///
    /// # Errors
    /// As [`HeaderReader::read`].
    pub(crate) async fn read_marks(&self, file: &Spooled) -> Result<MarkedPatient, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.marks(file).await?)
    }

    /// Writes a file without the identity of the patient, as an upload is spooled; what it states and shows then.
    ///
    /// # Errors
    /// As [`HeaderReader::read`].
    pub async fn deidentify(
        &self,
        file: &Spooled,
        output: &Path,
    ) -> Result<Option<Fingerprint>, Error> {
        let _turn = self.limit.turn().await?;
        let identity = InstanceIdentity::checked(self.reader.deidentify(file, output).await?)?;
        Ok(identity.fingerprint)
    }
}

fn bad_uid(name: &str) -> Failure {
    let detail = format!(
        "its {name} is no UID (up to 64 digits and points); export the images with valid UIDs"
    );
    Failure::unusable("dicom-damaged", detail)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use bytes::Bytes;
    use case::FailureKind;
    use storage::{Options, Store};
    use worker::{ChildMemory, Program};

    use super::*;

    /// Longer than a busy machine takes to start a shell.
    const PATIENCE: Duration = Duration::from_secs(60);

    /// The answer of a shell script in place of the process.
    async fn read_by(script: &str, longest: Duration) -> Result<InstanceIdentity, Error> {
        let arguments = vec!["-c".into(), script.into()];
        let program = Program::other("/bin/sh".into(), arguments);
        let reader = FileReader::new(program, 1 << 20, ChildMemory::default());
        let reader = HeaderReader::new(reader.within(longest));
        let store = Store::in_memory(Options::default()).await.unwrap();
        let file = store
            .spools()
            .of(Bytes::from_static(b"file"))
            .await
            .unwrap();
        reader.read(&file).await
    }

    fn name(result: Result<InstanceIdentity, Error>) -> String {
        match result {
            Err(Error::Failure(failure)) => {
                assert_eq!(failure.kind, FailureKind::Unusable);
                failure.name
            }
            other => panic!("{other:?}"),
        }
    }

    fn saying(answer: &str) -> String {
        format!("read order; echo noise; printf '\\n%s\\n' '{answer}'; read more")
    }

    fn identity(uid: &str) -> String {
        format!(
            r#"{{"read":{{"sop_class_uid":"1.2","sop_instance_uid":"{uid}","study_uid":"1.3","series_uid":"1.4","accession_number":null,"is_image":true}}}}"#
        )
    }

    #[tokio::test]
    async fn a_process_answers_for_its_file() {
        let read = read_by(&saying(&identity("1.5")), PATIENCE).await.unwrap();
        assert_eq!(read.sop_instance_uid.as_str(), "1.5");
        assert_eq!(read.uids.series.as_str(), "1.4");
    }

    #[tokio::test]
    async fn a_process_that_dies_or_is_silent_or_lies_is_an_answer() {
        let endless = "while :; do printf xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx; done";
        let moment = Duration::from_millis(500);
        let bad = [
            ("exit 1", PATIENCE),
            ("kill -KILL $$", PATIENCE),
            ("sleep 5", moment),
            (endless, moment),
        ];
        for (script, longest) in bad {
            assert_eq!(
                name(read_by(script, longest).await),
                "dicom-reader-died",
                "{script}"
            );
        }
        let lie = saying(&identity("Somebody^Secret"));
        assert_eq!(name(read_by(&lie, PATIENCE).await), "dicom-damaged");
        let refused = r#"{"refused":{"name":"dicom-none","kind":"unusable","detail":"words"}}"#;
        assert_eq!(
            name(read_by(&saying(refused), PATIENCE).await),
            "dicom-none"
        );
    }
}
