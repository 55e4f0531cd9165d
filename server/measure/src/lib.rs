//! What each step of Isocortex costs on a machine, and how good its meshes are: the paper's tables and figures, and growth.
//!
//! A [`Head`] is prepared with a clock beside every step ([`paper`]), drawn while it turns, and its meshes are held against
//! the isosurface ([`quality`]). Everything comes back as a [`Table`], which a terminal, JSON and a [`Plot`] show.
//! This crate has clocks and looks at the machine; it reads none of the caller's files and writes nothing.

mod asked;
mod case;
mod clock;
pub mod counted;
mod error;
pub mod growth;
mod head;
mod machine;
pub mod paper;
mod pictures;
mod plot;
pub mod quality;
mod report;
mod rotation;
mod statistics;
mod table;

pub use asked::{ASKED_DEPTH_MM, Asked, UnknownStep};
pub use case::{MeasuredCase, Step, StepCosts};
pub use clock::{Cost, Costs, timed};
pub use error::MeasureError;
pub use head::Head;
pub use machine::{Machine, memory_of, peak_memory_mib, reset_peak_memory};
pub use pictures::pictures;
pub use plot::{Axis, Plot, Series};
pub use report::{HeadFacts, Report};
pub use rotation::{Painter, Rate, Spin};
pub use statistics::{PowerLaw, Summary};
pub use table::{Cell, Column, Table, column, readable};
