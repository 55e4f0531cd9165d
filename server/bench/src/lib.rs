//! What each step of Isocortex costs on a machine, and how good its meshes are: the paper's tables and figures.
//!
//! A [`Head`] is prepared with a clock beside every step ([`paper`]), drawn while it turns, and its meshes are held against
//! the isosurface ([`quality`]) and against exact pictures ([`agreement`]). Everything comes back as a [`Table`], for a
//! terminal, as JSON and as plots. The program `isocortex-bench` is a command line around this.

pub mod agreement;
mod backends;
mod clock;
pub mod counted;
mod error;
mod head;
mod machine;
pub mod paper;
mod plots;
mod prepared;
pub mod quality;
mod report;
mod rotation;
mod statistics;
mod steps;
pub mod study;
mod table;

pub use backends::Backends;
pub use clock::{Cost, Costs, timed};
pub use error::BenchError;
pub use head::Head;
pub use machine::Machine;
pub use plots::plots;
pub use prepared::PreparedHead;
pub use report::{HeadFacts, Report};
pub use rotation::{Rate, Spin, backend_label};
pub use statistics::{PowerLaw, Summary};
pub use steps::{Step, StepCosts};
pub use table::{Cell, Column, Table, column, readable};
