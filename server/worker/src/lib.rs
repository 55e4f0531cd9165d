#![doc = include_str!("../README.md")]

mod child;
mod confine;
mod error;
mod files;
mod headers;
mod memory;
mod message;
mod outcome;
mod prepare;
mod priority;
mod program;
mod reader;
mod reading;
mod stored;
mod subject;
mod surface;

pub use child::run as run_child;
#[cfg(any(test, feature = "testing"))]
pub use child::run_instead;
pub use confine::{Confinement, hide};
pub use error::Error;
pub use headers::{FileReader, MAX_FILE_BYTES};
pub use memory::{ChildBudget, ChildMemory, MemoryPermit};
pub use prepare::PrepareProcess;
#[cfg(any(test, feature = "testing"))]
pub use prepare::prepare_by;
pub use priority::yield_to_answers;
pub use program::{Program, at_a_time};
pub use reader::{READER_DIED, SeriesReader};
pub use reading::{Choice, Input, Reading};
pub use subject::{SubjectReading, flat_name};
pub use surface::{SurfaceReading, Surfaces};

/// The subcommand of the child.
pub const SUBCOMMAND: &str = "read-dicom";
