//! The messages between the two processes.

use std::path::PathBuf;

use imaging::dicom::Options;
use imaging::surface::Drawing;
use serde::{Deserialize, Serialize};

use case::{CutFacts, Failure, Parameters, Quality};

/// The file of the volume, in the output directory.
pub(crate) const VOLUME: &str = "volume.nii.gz";

/// A request, the first line on the standard input of the child, because other users can see a command line.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum Order {
    /// Make a volume of a series.
    Series(SeriesOrder),
    /// Read the header of a file; a [`Stated`] on the standard output answers it.
    Header(HeaderOrder),
    /// Read which study and series a file is of, whatever else is wrong with it; a [`Stated`] on the standard output answers it.
    SeriesOf(HeaderOrder),
    /// Read the findings of a measurement report; a [`Stated`] on the standard output answers it.
    Marks(HeaderOrder),
    /// Read the attributes of stored files; a [`Stated`] in a file answers it, and each of the orders to read a series or to prepare.
    Stored(StoredOrder),
    Prepare(Box<PrepareOrder>),
    /// Draw surfaces into voxels; a [`Stated`] in a file answers it.
    Surfaces(SurfaceOrder),
    /// Read the folder of a subject, or a zip of it; a [`Stated`] in a file answers it.
    Subject(SubjectOrder),
    /// Only confine the process; a [`Confinement`](crate::Confinement) on the standard output answers it.
    Confine,
}

/// What to prepare. The files of the upload, and later the results, are in `folder`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PrepareOrder {
    pub(crate) source: PathBuf,
    /// An empty directory.
    pub(crate) output: PathBuf,
    /// What is known of a stored brain, whose mask is a file.
    pub(crate) brain: Option<(Quality, Vec<CutFacts>)>,
    pub(crate) parameters: Parameters,
    pub(crate) max_voxels: usize,
    pub(crate) network: Option<PathBuf>,
    pub(crate) threads: usize,
    pub(crate) cpu_seconds: u64,
}

/// What to read of stored files.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StoredOrder {
    /// A directory with files named by their numbers from 0.
    pub(crate) input: PathBuf,
    pub(crate) count: usize,
    /// An empty directory.
    pub(crate) output: PathBuf,
    /// The limit for memory.
    pub(crate) memory_bytes: u64,
    /// The limit for a file.
    pub(crate) max_file_bytes: u64,
    /// The limit for CPU time.
    pub(crate) seconds: u64,
}

/// Which file to read the header of.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HeaderOrder {
    pub(crate) file: PathBuf,
    /// The offset of the bytes in the file.
    pub(crate) start: u64,
    /// Where to write the file without the identity of the patient, after as many zero bytes; `None` to write nothing.
    pub(crate) output: Option<PathBuf>,
    /// The limit for memory.
    pub(crate) memory_bytes: u64,
    /// The limit for CPU time.
    pub(crate) seconds: u64,
}

/// The answer to an order.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(crate) enum Stated<T> {
    Read(T),
    Refused(Failure),
}

/// Which series to read.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SeriesOrder {
    /// A file, or a directory of files.
    pub(crate) input: PathBuf,
    /// Whether a directory was made for this order, and may be given to a user of the process's own.
    pub(crate) is_own_input: bool,
    /// The offset of the bytes in a single file.
    pub(crate) input_start: u64,
    /// An empty directory.
    pub(crate) output: PathBuf,
    /// The number of zero bytes to write before the volume.
    pub(crate) room: u64,
    pub(crate) options: Options,
    pub(crate) max_voxels: usize,
    /// The limit for memory.
    pub(crate) memory_bytes: u64,
    /// The limit for the unpacked bytes of all files.
    pub(crate) max_input_bytes: u64,
    /// The limit for CPU time.
    pub(crate) seconds: u64,
}

/// Which surfaces to draw.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SurfaceOrder {
    /// Surfaces and their values.
    pub(crate) files: Vec<(PathBuf, Option<PathBuf>)>,
    pub(crate) t1: Option<PathBuf>,
    /// The offset of the bytes in each file, and the number of zero bytes to write before the volume.
    pub(crate) start: u64,
    /// An empty directory.
    pub(crate) output: PathBuf,
    pub(crate) drawing: Drawing,
    pub(crate) max_voxels: usize,
    /// The limit for memory.
    pub(crate) memory_bytes: u64,
    /// The limit for CPU time.
    pub(crate) seconds: u64,
}

/// Which folder of a subject to read.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SubjectOrder {
    /// A zip, or a folder.
    pub(crate) input: PathBuf,
    /// Whether a folder was made for this order, and may be given to a user of the process's own.
    pub(crate) is_own_input: bool,
    /// An empty directory.
    pub(crate) output: PathBuf,
    /// The number of zero bytes to write before each file.
    pub(crate) room: u64,
    pub(crate) max_voxels: usize,
    /// The limit for memory.
    pub(crate) memory_bytes: u64,
    /// The limit for the unpacked bytes of all files.
    pub(crate) max_input_bytes: u64,
    /// The limit for CPU time.
    pub(crate) seconds: u64,
}
