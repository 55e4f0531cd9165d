//! The parent process, which requests the reading of files and does not trust the result.

use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use case::images::{Fingerprint, Image};
use case::series::Uid;
use case::{Failure, FailureKind};
use imaging::Limits;
use imaging::dicom::{Attributes, Converted, MOST_LISTED, Options, SeriesSummary, UnreadFile};
use serde::de::DeserializeOwned;
use storage::Spooled;
use tempfile::TempDir;

use crate::confine::Confinement;
use crate::error::Error;
use crate::memory::{ChildMemory, series_bytes};
use crate::message::{Order, SeriesOrder, Stated, VOLUME};
use crate::outcome::{MAX_TEXT, is_sound, read_outcome};
use crate::program::{Program, cannot_run, was_interrupted};
use crate::reading::{Choice, Input, Reading};

/// The time limit for a series. The largest ones take seconds.
const LONGEST: Duration = Duration::from_secs(120);

/// The largest outcome: identifiers of some thousand slices.
const MAX_OUTCOME_BYTES: u64 = 16 << 20;

/// Reads series of DICOM files.
#[derive(Debug)]
pub struct SeriesReader {
    program: Program,
    limits: Limits,
    pub(crate) max_input_bytes: u64,
    pub(crate) longest: Duration,
    pub(crate) memory: ChildMemory,
}

impl SeriesReader {
    /// A reader of volumes within `limits`, from files of at most `max_input_bytes` altogether, unpacked.
    pub fn new(program: Program, limits: Limits, max_input_bytes: u64) -> Self {
        Self {
            program,
            limits,
            max_input_bytes,
            longest: LONGEST,
            memory: ChildMemory::default(),
        }
    }

    /// The same with memory that others share.
    #[must_use]
    pub fn with_memory(self, memory: ChildMemory) -> Self {
        Self { memory, ..self }
    }

    /// Sets the time limit.
    #[must_use]
    pub fn within(self, longest: Duration) -> Self {
        Self { longest, ..self }
    }

    pub(crate) fn limits(&self) -> Limits {
        self.limits
    }

    /// Reads a series.
    ///
    /// `scratch` is a directory where temporary files may be. Dropping the future ends the child.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the files, or how the child died; [`Error::NotRun`], logged, if the child cannot be
    /// started.
    pub async fn read(
        &self,
        input: Input<'_>,
        options: &Options,
        scratch: &Path,
    ) -> Result<Reading, Error> {
        let (input, input_start, is_own_input) = match input {
            Input::Path(path) => (path, 0, false),
            Input::Directory(directory) => (directory.path(), 0, true),
            Input::Spooled(file) => (file.path(), Spooled::START, false),
        };
        let output = tempfile::Builder::new()
            .prefix("dicom-")
            .tempdir_in(scratch)
            .map_err(cannot_run)?;
        let memory_bytes = series_bytes(&self.limits);
        let _memory = self.memory.take(memory_bytes).await;
        let order = SeriesOrder {
            input: std::path::absolute(input).map_err(cannot_run)?,
            is_own_input,
            input_start,
            output: std::path::absolute(output.path()).map_err(cannot_run)?,
            room: Spooled::START,
            options: options.clone(),
            max_voxels: self.limits.max_voxels,
            memory_bytes,
            max_input_bytes: self.max_input_bytes,
            seconds: self.longest.as_secs().max(1),
        };
        let status = self.run(&Order::Series(order)).await?;
        let limits = self.limits;
        let reading = tokio::task::spawn_blocking(move || take(status, output, &limits));
        Ok(reading.await.map_err(|_| Error::NotRun)??)
    }

    /// What the kernel of this machine gives to confine the child.
    ///
    /// # Errors
    /// [`Error::NotRun`], logged, if the child cannot be started, or does not answer.
    pub async fn confinement(&self) -> Result<Confinement, Error> {
        let mut process = self.program.start(Stdio::piped()).map_err(cannot_run)?;
        let answer = tokio::time::timeout(self.longest, process.ask(&Order::Confine)).await;
        let silent = || cannot_run(io::ErrorKind::UnexpectedEof.into());
        answer.ok().flatten().ok_or_else(silent)
    }

    pub(crate) async fn run(&self, order: &Order) -> Result<ExitStatus, Error> {
        let status = self.run_within(order).await.map_err(cannot_run)?;
        match status {
            Some(status) if was_interrupted(status) => Err(Error::Interrupted),
            Some(status) => Ok(status),
            None => Err(too_slow(self.longest).into()),
        }
    }

    /// Runs the child; `None` if it exceeds the time limit.
    async fn run_within(&self, order: &Order) -> io::Result<Option<ExitStatus>> {
        let mut process = self.program.start(Stdio::null())?;
        process.tell(order).await?;
        match tokio::time::timeout(self.longest, process.child.wait()).await {
            Ok(status) => status.map(Some),
            Err(_elapsed) => {
                process.child.kill().await?;
                Ok(None)
            }
        }
    }
}

fn too_slow(longest: Duration) -> Failure {
    Failure::unusable(
        "dicom-too-slow",
        format!(
            "reading the DICOM files exceeded the limit of {} seconds",
            longest.as_secs()
        ),
    )
}

/// The name of the failure of a file that ended the process that read it.
pub const READER_DIED: &str = "dicom-reader-died";

/// The process ended before it was done.
pub(crate) fn died() -> Failure {
    Failure::unusable(
        READER_DIED,
        "the DICOM files could not be read: the process that reads them ended, because they are damaged or need more memory \
         than allowed; convert the series with another program, such as dcm2niix"
            .to_owned(),
    )
}

/// What a child states that has read `files`, as its log line calls them.
pub(crate) fn outcome<T: DeserializeOwned>(
    status: ExitStatus,
    output: &TempDir,
    (files, most): (&str, u64),
) -> Result<T, Failure> {
    if !status.success() {
        tracing::warn!(%status, "the process that reads {files} died");
        return Err(died());
    }
    match read_outcome(output.path(), most).ok_or_else(died)? {
        Stated::Read(found) => Ok(found),
        Stated::Refused(failure) => Err(checked_failure(failure)),
    }
}

/// The files of a child.
fn take(status: ExitStatus, output: TempDir, limits: &Limits) -> Result<Reading, Failure> {
    let converted = outcome(status, &output, ("DICOM files", MAX_OUTCOME_BYTES))?;
    let largest = 4 * limits.max_voxels as u64 + (1 << 20);
    check_file(&output.path().join(VOLUME), Spooled::START + largest)?;
    reading(output, converted)
}

/// Whether the child left one regular file, not too large.
pub(crate) fn check_file(path: &Path, largest: u64) -> Result<(), Failure> {
    let file = std::fs::symlink_metadata(path).map_err(|_| died())?;
    let is_sound = file.is_file() && file.nlink() == 1;
    if is_sound && (Spooled::START..=largest).contains(&file.len()) {
        return Ok(());
    }
    Err(died())
}

/// A failure that may be passed on: a sound one, of a suitable kind.
pub(crate) fn checked_failure(failure: Failure) -> Failure {
    let fits = is_sound(&failure)
        && matches!(
            failure.kind,
            FailureKind::TooLarge
                | FailureKind::NotRecognised
                | FailureKind::Unusable
                | FailureKind::OutOfMemory
        );
    if fits { failure } else { died() }
}

fn reading(output: TempDir, converted: Converted) -> Result<Reading, Failure> {
    let Converted {
        attributes,
        series,
        is_t1,
        others,
        ignored_files,
        images,
        unread,
        ..
    } = converted;
    let all = std::iter::once(&series).chain(&others);
    let are_plain = all.clone().all(is_plain) && are_plain_files(&unread);
    if !are_plain || !are_texts(&attributes) {
        return Err(died());
    }
    // No PACS sends an image without a valid UID.
    let named = images.into_iter();
    let named = named.filter_map(|(uid, print)| Uid::parse(&uid).zip(Some(print)));
    let image = |(uid, print): (Uid, imaging::dicom::Fingerprint)| {
        Some(Image {
            uid,
            fingerprint: Fingerprint::new(&print.contents, print.is_lossy, print.corners_mm)?,
            times: 0,
        })
    };
    let images = named.map(image).collect::<Option<_>>();
    let stored = serde_json::to_vec(&attributes).map_err(|_| died())?;
    Ok(Reading {
        output,
        images: images.ok_or_else(died)?,
        choice: Choice {
            series,
            others,
            ignored_files,
            unread,
            interpolated_slices: attributes.interpolated_slices,
            is_t1,
        },
        attributes: stored.into(),
    })
}

fn is_plain(series: &SeriesSummary) -> bool {
    let is_word = |text: &str| text.len() <= 8 && text.chars().all(|c| c.is_ascii_alphanumeric());
    let is_unit = |unit: &String| unit.len() <= 16 && unit.chars().all(|c| c.is_ascii_graphic());
    is_word(&series.modality)
        && is_word(&series.token)
        && is_word(&series.name)
        && series.unit.as_ref().is_none_or(is_unit)
}

fn are_plain_files(files: &[UnreadFile]) -> bool {
    let is_token =
        |token: &String| token.len() <= 8 && token.chars().all(|c| c.is_ascii_hexdigit());
    let is_plain = |file: &UnreadFile| {
        file.series.as_ref().is_none_or(is_token)
            && file.reason.len() <= MAX_TEXT[1]
            && !file.reason.chars().any(char::is_control)
    };
    files.len() <= MOST_LISTED && files.iter().all(is_plain)
}

fn are_texts(attributes: &Attributes) -> bool {
    let texts = attributes
        .attributes
        .iter()
        .flat_map(|(key, value)| [key, value]);
    let uids = attributes
        .instances
        .iter()
        .flat_map(|instance| [&instance.sop_class_uid, &instance.sop_instance_uid]);
    texts
        .chain(uids)
        .all(|text| text.len() <= MAX_TEXT[1] && !text.chars().any(char::is_control))
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn read_by(script: &str, longest: Duration) -> Error {
        let arguments = vec!["-c".into(), script.into()];
        let program = Program::other("/bin/sh".into(), arguments);
        let reader = SeriesReader::new(program, Limits::default(), 1 << 20).within(longest);
        let scratch = tempfile::tempdir().unwrap();
        let input = scratch.path().join("input");
        std::fs::write(&input, b"anything").unwrap();
        let options = Options::default();
        let read = reader
            .read(Input::Path(&input), &options, scratch.path())
            .await;
        let error = read.map(|_| ()).unwrap_err();
        let left = std::fs::read_dir(scratch.path()).unwrap().count();
        assert_eq!(left, 1, "nothing but the input is left");
        error
    }

    fn name(error: Error) -> String {
        match error {
            Error::Failure(failure) => {
                assert_eq!(failure.kind, FailureKind::Unusable);
                failure.name
            }
            other => panic!("{other}"),
        }
    }

    /// Writes an outcome into the directory that the order names.
    fn saying(outcome: &str) -> String {
        format!(
            r#"order=$(/bin/cat); output=${{order#*\"output\":\"}}; output=${{output%%\"*}}; printf '%s' '{outcome}' > "$output/outcome.json""#
        )
    }

    const PLENTY: Duration = Duration::from_secs(60);

    #[tokio::test]
    async fn a_child_that_dies_is_an_answer() {
        for script in ["exit 1", "kill -ABRT $$", "kill -KILL $$", "exit 0"] {
            assert_eq!(name(read_by(script, PLENTY).await), "dicom-reader-died");
        }
    }

    #[tokio::test]
    async fn a_child_that_never_ends_is_ended() {
        let error = read_by("while :; do :; done", Duration::from_millis(50)).await;
        assert_eq!(name(error), "dicom-too-slow");
    }

    #[tokio::test]
    async fn what_a_child_says_is_not_believed() {
        let refused = |name: &str, kind: &str| {
            format!(r#"{{"refused":{{"name":"{name}","kind":"{kind}","detail":"words"}}}}"#)
        };
        let sound = saying(&refused("dicom-mosaic", "unusable"));
        assert_eq!(name(read_by(&sound, PLENTY).await), "dicom-mosaic");
        for outcome in [
            refused("Not A Name", "unusable"),
            refused("dicom-mosaic", "internal"),
            refused("dicom-mosaic", "fine"),
            "{}".to_owned(),
            "not json".to_owned(),
            r#"{"read":{"attributes":{"attributes":[],"instances":[],"interpolated_slices":[]},"series":{"number":1,"modality":"MR","name":"T1","size":[1,1,1],"is_volume":true,"token":"0"},"others":[],"ignored_files":0}}"#.to_owned(),
        ] {
            let error = read_by(&saying(&outcome), PLENTY).await;
            assert_eq!(name(error), "dicom-reader-died", "{outcome}");
        }
    }
}
