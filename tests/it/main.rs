//! The integration tests: one program, one module for each subject.

mod heads;
mod hygiene;
mod kill;
mod layers;
