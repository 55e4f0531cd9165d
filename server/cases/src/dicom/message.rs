//! The messages between the two processes.

use std::path::PathBuf;

use imaging::dicom::{Attributes, SeriesSummary};
use serde::{Deserialize, Serialize};

use case::Failure;

/// The file of the volume, in the output directory.
pub(super) const VOLUME: &str = "volume.nii.gz";

/// The file of the [`Outcome`].
pub(super) const OUTCOME: &str = "outcome.json";

/// A request, on the standard input of the child, because other users can see a command line.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Order {
    /// A file, or a directory of files.
    pub(super) input: PathBuf,
    /// The offset of the bytes in a single file.
    pub(super) input_start: u64,
    /// An empty directory.
    pub(super) output: PathBuf,
    /// The number of zero bytes to write before the volume.
    pub(super) room: u64,
    pub(super) series: Option<String>,
    pub(super) allow_gaps: bool,
    pub(super) max_voxels: usize,
    /// The limit for the unpacked bytes of all files.
    pub(super) max_input_bytes: u64,
    /// The limit for CPU time.
    pub(super) seconds: u64,
}

/// The outcome of a request.
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
    pub(super) others: Vec<SeriesSummary>,
    pub(super) ignored_files: usize,
}
