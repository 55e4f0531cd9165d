//! What the two processes say to each other.

use std::path::PathBuf;

use imaging::dicom::{Attributes, SeriesSummary};
use serde::{Deserialize, Serialize};

use case::Failure;

/// The file of the volume, in the directory for what is written.
pub(super) const VOLUME: &str = "volume.nii.gz";

/// The file of the [`Outcome`].
pub(super) const OUTCOME: &str = "outcome.json";

/// What is to be read: on the child's standard input, because others can see a command line.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Order {
    /// A file, or a directory of files.
    pub(super) input: PathBuf,
    /// Where the bytes of a single file begin.
    pub(super) input_start: u64,
    /// An empty directory.
    pub(super) output: PathBuf,
    /// How many zero bytes are written before the volume.
    pub(super) room: u64,
    pub(super) series: Option<String>,
    pub(super) allow_gaps: bool,
    pub(super) max_voxels: usize,
    /// The most unpacked bytes of all files.
    pub(super) max_input_bytes: u64,
    /// How long it may compute.
    pub(super) seconds: u64,
}

/// What became of it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum Outcome {
    Read(Summary),
    Refused(Failure),
}

/// What is told beside the volume.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Summary {
    pub(super) attributes: Attributes,
    pub(super) series: SeriesSummary,
    pub(super) others: Vec<SeriesSummary>,
    pub(super) ignored_files: usize,
}
