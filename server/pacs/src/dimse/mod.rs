//! DIMSE (PS3.7, PS3.8): a listener for C-ECHO and C-STORE, for listed peers, and C-STORE to a node.
//!
//! A message is framed by PDUs, whose lengths are compared with a limit before anything is read. The command is read
//! here; the data set goes to the disk as it comes, and only the limited child parses it.

mod association;
mod command;
mod counts;
mod head;
mod listen;
mod negotiate;
mod node;
mod options;
mod outcome;
mod peers;
mod wire;

pub use self::counts::{AssociationCounts, Rejection};
pub use self::listen::serve;
pub use self::node::StorageNode;
pub use self::options::{DimseOptions, is_aet};
pub use self::peers::{Peer, PeerAddress};
pub use http::tls::{
    BadTls, ConnectingTls, ListeningTls, ReloadedTls, TlsAuthority, TlsIdentity, connecting_tls,
    listening_tls,
};

/// Whether bytes are a PDU, or a command, that is understood here. For tests of what strangers may send.
pub fn is_understood(bytes: &[u8]) -> bool {
    command::Request::parse(bytes).is_some()
        || command::status_of_response(bytes).is_some()
        || wire::parse_whole(bytes.to_vec())
}
