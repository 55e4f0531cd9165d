//! Reads the headers of single DICOM files.

use std::path::Path;

use imaging::dicom::{Identity, MarkedPatient};
use storage::Spooled;

use worker::{FileReader, at_a_time};

use crate::error::Error;
use crate::limit::ConcurrencyLimit;

/// Files that may wait.
const WAITING: usize = 256;

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

    /// What the header of a file states, which nobody has checked.
    ///
    /// # Errors
    /// A [`Failure`](case::Failure) that states what is wrong with the file, or that its process died; [`Error::Busy`] if too many
    /// wait; [`Error::Internal`], logged, if the process cannot be started.
    pub async fn read(&self, file: &Spooled) -> Result<Identity, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.identity(file).await?)
    }

    /// The UIDs of the study and of the series that a file states, which may be damaged after them; nobody has checked them.
    ///
    /// # Errors
    /// As [`HeaderReader::read`].
    pub async fn series_of(&self, file: &Spooled) -> Result<[String; 2], Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.series_of(file).await?)
    }

    /// The findings of a measurement report.
    ///
    /// # Errors
    /// As [`HeaderReader::read`].
    pub(crate) async fn read_marks(&self, file: &Spooled) -> Result<MarkedPatient, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.marks(file).await?)
    }

    /// Writes a file without the identity of the patient, as an upload is spooled; what its header states then.
    ///
    /// # Errors
    /// As [`HeaderReader::read`].
    pub async fn deidentify(&self, file: &Spooled, output: &Path) -> Result<Identity, Error> {
        let _turn = self.limit.turn().await?;
        Ok(self.reader.deidentify(file, output).await?)
    }
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
    async fn read_by(script: &str, longest: Duration) -> Result<Identity, Error> {
        let arguments = vec!["-c".into(), script.into()];
        let program = Program::other("/bin/sh".into(), arguments);
        let reader = FileReader::new(program, ChildMemory::default());
        let reader = HeaderReader::new(reader.within(longest));
        let store = Store::in_memory(Options::default()).await.unwrap();
        let file = store
            .spools()
            .of(Bytes::from_static(b"file"))
            .await
            .unwrap();
        reader.read(&file).await
    }

    fn name(result: Result<Identity, Error>) -> String {
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

    #[tokio::test]
    async fn a_process_answers_for_its_file() {
        let identity = r#"{"read":{"sop_class_uid":"1.2","sop_instance_uid":"1.5","study_uid":"1.3","series_uid":"1.4","accession_number":null,"is_image":true}}"#;
        let read = read_by(&saying(identity), PATIENCE).await.unwrap();
        assert_eq!(read.sop_instance_uid, "1.5");
        assert_eq!(read.series_uid, "1.4");
    }

    #[tokio::test]
    async fn a_process_that_dies_or_is_silent_is_an_answer() {
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
        let refused = r#"{"refused":{"name":"dicom-none","kind":"unusable","detail":"words"}}"#;
        assert_eq!(
            name(read_by(&saying(refused), PATIENCE).await),
            "dicom-none"
        );
    }
}
