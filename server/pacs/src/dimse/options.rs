//! The options of the listener.

use std::sync::Arc;
use std::time::Duration;

use crate::dimse::counts::AssociationCounts;
use crate::dimse::peers::Peer;
use access::audit::Audit;
use http::tls::ReloadedTls;

/// Whether a text is an application entity title (PS3.5 §6.2). Spaces at its ends do not count, so it has none there.
pub fn is_aet(text: &str) -> bool {
    let allowed = |byte: u8| (b' '..=b'~').contains(&byte) && byte != b'\\';
    (1..=16).contains(&text.len()) && text.trim() == text && text.bytes().all(allowed)
}

/// The options of the listener.
#[derive(Debug, Clone)]
pub struct DimseOptions {
    /// Our application entity title.
    pub aet: String,
    /// Who may connect. Nobody else.
    pub peers: Vec<Peer>,
    /// Associations at a time.
    pub max_associations: usize,
    /// How long a peer may send nothing, and how long it may take for a PDU.
    pub idle: Duration,
    /// How long an association may last.
    pub whole: Duration,
    /// TLS; without it, nothing is encrypted.
    pub tls: Option<ReloadedTls>,
    pub counts: Arc<AssociationCounts>,
    /// The record of who does what.
    pub audit: Audit,
}

impl Default for DimseOptions {
    fn default() -> Self {
        Self {
            aet: "ISOCORTEX".to_owned(),
            peers: Vec::new(),
            max_associations: 20,
            idle: Duration::from_secs(30),
            whole: Duration::from_secs(3600),
            tls: None,
            counts: Arc::default(),
            audit: Audit::default(),
        }
    }
}
