//! The integration tests: one program, one module for each subject.

mod agreement;
mod bad_input;
mod bench;
mod golden;
mod head;
mod heads;
mod hygiene;
mod immutable;
mod interface;
mod kill;
mod layers;
mod masks;
mod nifti;
mod openapi;
mod renderers;
mod renders;
mod restart;
mod scenes;
mod security;
mod server;
mod sides;
mod sockets;
mod uploads;
