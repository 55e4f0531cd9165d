//! DIMSE (PS3.7, PS3.8): a listener for C-ECHO and C-STORE, for listed peers.
//!
//! A message is framed by PDUs, whose lengths are compared with a limit before anything is read. The command is read
//! here; the data set goes to the disk as it comes, and only the limited child parses it.

mod association;
mod command;
mod listen;
mod negotiate;
mod options;

pub use self::listen::serve;
pub use self::options::{DimseOptions, Peer};
