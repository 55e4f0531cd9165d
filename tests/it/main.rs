//! The integration tests: one program, one module for each subject.

mod bad_input;
mod head;
mod heads;
mod hygiene;
mod immutable;
mod interface;
mod kill;
mod layers;
mod nifti;
mod openapi;
mod renderers;
mod renders;
mod restart;
mod security;
mod server;
mod sides;
mod sockets;
mod uploads;
