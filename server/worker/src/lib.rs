//! Confined processes, which read the files of strangers and prepare heads: an order in, values out.
//!
//! Hostile files can make parsers and decoders run for ever, exhaust memory, or abort the process. So the program
//! starts itself again, as `isocortex read-dicom`, for each upload: a process with limits on memory, time and open
//! files, without environment, which opens the spooled files and the files for its results, confines itself (`confine.rs`), and only
//! then looks at what it reads. Its output is trusted as little as its input. If it dies, the upload is rejected and the server continues.

mod child;
mod confine;
mod error;
mod files;
mod headers;
mod memory;
mod message;
mod prepare;
mod priority;
mod program;
mod reader;
mod reading;
mod stored;

pub use child::run as run_child;
#[cfg(any(test, feature = "testing"))]
pub use child::run_instead;
pub use confine::{Confinement, hide};
pub use error::Error;
pub use headers::FileReader;
pub use memory::{ChildBudget, ChildMemory, Granted};
pub use prepare::PrepareProcess;
#[cfg(any(test, feature = "testing"))]
pub use prepare::prepare_by;
pub use priority::yield_to_answers;
pub use program::{Program, at_a_time};
pub use reader::SeriesReader;
pub use reading::{Choice, Input, Reading, SeriesView};

/// The subcommand of the child.
pub const SUBCOMMAND: &str = "read-dicom";
