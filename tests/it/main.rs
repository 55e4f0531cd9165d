//! The integration tests: one program, one module for each subject. Everything is asked over HTTP.

<<<<<<< HEAD
mod bad_input;
mod head;
mod immutable;
mod interface;
mod nifti;
mod openapi;
mod restart;
mod security;
mod server;
mod sides;
mod sockets;
mod uploads;
=======
mod hygiene;
mod kill;
mod layers;
>>>>>>> refs/heads/store
