//! Measures the cost of each step of Isocortex and the accuracy of its meshes: the tables and figures of the paper.
//!
//! A [`Head`] is prepared with a timer around every step ([`paper`]) and drawn while it turns. Its meshes are compared
//! with the isosurface ([`quality`]) and with exact pictures ([`agreement`]). Every result is a [`Table`], for a
//! terminal, as JSON and as plots. The program `isocortex-bench` is the command line.

pub mod agreement;
mod backends;
mod brain;
mod clock;
pub mod counted;
mod error;
mod files;
mod head;
mod machine;
pub mod paper;
mod plots;
mod prepared;
pub mod quality;
mod random;
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
