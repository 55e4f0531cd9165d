//! The messages between the two processes.

use std::path::PathBuf;

use imaging::dicom::{Attributes, Difference, SeriesSummary, UnreadFile};
use serde::{Deserialize, Serialize};

use case::Failure;

use crate::apart::PrepareOrder;

/// The file of the volume, in the output directory.
pub(super) const VOLUME: &str = "volume.nii.gz";

/// The file of the [`Outcome`].
pub(super) const OUTCOME: &str = "outcome.json";

/// A request, the first line on the standard input of the child, because other users can see a command line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum Order {
    /// Make a volume of a series.
    Series(SeriesOrder),
    /// Read the header of a file; a [`Stated`] on the standard output answers it.
    Header(HeaderOrder),
    /// Read the findings of a measurement report; a [`Stated`] on the standard output answers it.
    Marks(HeaderOrder),
    /// Read stored files.
    Stored(StoredOrder),
    /// Prepare a case.
    Prepare(Box<PrepareOrder>),
    /// Only confine the process; a [`Confinement`](crate::Confinement) on the standard output answers it.
    Confine,
}

/// What to read of stored files.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StoredOrder {
    /// A directory with files named by their numbers from 0.
    pub(super) input: PathBuf,
    pub(super) count: usize,
    /// An empty directory.
    pub(super) output: PathBuf,
    pub(super) task: StoredTask,
    /// The limit for memory.
    pub(super) memory_bytes: u64,
    /// The limit for a file.
    pub(super) max_file_bytes: u64,
    /// The limit for CPU time.
    pub(super) seconds: u64,
}

/// What to read.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum StoredTask {
    /// The attributes of each file.
    Metadata,
    /// What is different about the second of two files of one instance.
    Compare,
}

/// What was read of stored files.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum StoredOutcome {
    Metadata(Vec<serde_json::Value>),
    Compared(Difference),
    Refused(Failure),
}

/// Which file to read the header of.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HeaderOrder {
    pub(super) file: PathBuf,
    /// The offset of the bytes in the file.
    pub(super) start: u64,
    /// Where to write the file without the identity of the patient, after as many zero bytes; `None` to write nothing.
    pub(super) output: Option<PathBuf>,
    /// The limit for the file.
    pub(super) max_file_bytes: u64,
    /// The limit for memory.
    pub(super) memory_bytes: u64,
    /// The limit for CPU time.
    pub(super) seconds: u64,
}

/// The answer about a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum Stated<T> {
    Read(T),
    Refused(Failure),
}

/// Which series to read.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SeriesOrder {
    /// A file, or a directory of files.
    pub(super) input: PathBuf,
    /// Whether a directory was made for this order, and may be given to a user of the process's own.
    pub(super) is_own_input: bool,
    /// The offset of the bytes in a single file.
    pub(super) input_start: u64,
    /// An empty directory.
    pub(super) output: PathBuf,
    /// The number of zero bytes to write before the volume.
    pub(super) room: u64,
    pub(super) series: Option<String>,
    pub(super) allow_gaps: bool,
    pub(super) is_layer: bool,
    pub(super) max_voxels: usize,
    /// The limit for memory.
    pub(super) memory_bytes: u64,
    /// The limit for the unpacked bytes of all files.
    pub(super) max_input_bytes: u64,
    /// The limit for CPU time.
    pub(super) seconds: u64,
}

/// The outcome of a request for a series.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum Outcome {
    Read(Summary),
    Refused(Failure),
}

/// The facts in addition to the volume.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Summary {
    pub(super) attributes: Attributes,
    pub(super) series: SeriesSummary,
    pub(super) is_t1: bool,
    pub(super) others: Vec<SeriesSummary>,
    pub(super) ignored_files: usize,
    pub(super) unread: Vec<UnreadFile>,
}
