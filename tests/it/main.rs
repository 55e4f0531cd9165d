//! The integration tests: one program, one module for each subject.

<<<<<<< HEAD
mod bad_input;
mod head;
=======
mod heads;
>>>>>>> main
mod hygiene;
mod immutable;
mod interface;
mod kill;
mod layers;
mod nifti;
mod openapi;
mod restart;
mod security;
mod server;
mod sides;
mod sockets;
mod uploads;
