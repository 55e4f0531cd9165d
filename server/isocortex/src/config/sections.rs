//! The sections of a configuration, each with its defaults. The keys of the file are the names of the fields.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;

use http::timeouts::Timeouts;
use ipnet::IpNet;
use serde::Deserialize;

pub const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8640);

/// `[http]`: address and access.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Http {
    /// The address to listen on. Any other than a loopback address needs a token.
    pub listen: SocketAddr,
    /// The bearer token that every request under `/v1` must carry.
    pub token: Option<Secret>,
    /// A file with the token, instead of `token`.
    pub token_file: Option<PathBuf>,
    /// A file with named tokens, beside the token or instead of it.
    pub tokens_file: Option<PathBuf>,
    /// A file with the certificate of the server in PEM, and those that issued it; then it speaks TLS alone.
    pub tls_certificate: Option<PathBuf>,
    /// A file with its key in PEM.
    pub tls_key: Option<PathBuf>,
    /// Whether `/metrics`, `/version`, `/docs` and `/openapi.json` need a token too.
    pub guard_all: bool,
    /// The origins of pages on other hosts that may read answers, such as a viewer.
    pub allowed_origins: Vec<String>,
    /// The origins in whose frames the page may stand, such as a PACS.
    pub frame_ancestors: Vec<String>,
    /// Connections at a time, of which one address that is not a trusted proxy has at most a quarter.
    pub max_connections: usize,
    /// The addresses or networks of the proxies that name the client in `X-Forwarded-For`.
    pub trusted_proxies: Vec<Network>,
    /// Uploads at a time; no key.
    #[serde(skip)]
    pub max_uploads: usize,
    /// How long clients may take; no key.
    #[serde(skip)]
    pub timeouts: Timeouts,
}

impl Default for Http {
    fn default() -> Self {
        Self {
            listen: DEFAULT_LISTEN,
            token: None,
            token_file: None,
            tokens_file: None,
            tls_certificate: None,
            tls_key: None,
            guard_all: false,
            allowed_origins: Vec::new(),
            frame_ancestors: Vec::new(),
            max_connections: 512,
            trusted_proxies: Vec::new(),
            max_uploads: 64,
            timeouts: Timeouts::default(),
        }
    }
}

/// An address, or a network such as `10.0.0.0/8`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Network(pub IpNet);

impl TryFrom<String> for Network {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for Network {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let address = || {
            text.parse()
                .map(|address: IpAddr| IpNet::from(address.to_canonical()))
        };
        let network = text.parse().or_else(|_| address());
        network.map(Self).map_err(|_| {
            format!("`{text}` is neither an IP address nor a network such as 10.0.0.0/8")
        })
    }
}

/// `[page]`: what the page shows.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Page {
    /// Whether it shows the patient, the study and the series of a case from DICOM. By default it does if the server needs a
    /// token.
    pub patient_banner: Option<bool>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Storage {
    /// The directory of the store.
    pub data: PathBuf,
    /// The database, unless it is in the directory: `postgres://…` or `sqlite:///file`.
    pub database: Option<Secret>,
    /// A file with the password for PostgreSQL.
    pub database_password_file: Option<PathBuf>,
    /// The objects, unless they are in the directory: `s3://bucket/prefix` or `file:///folder`.
    pub objects: Option<String>,
    /// Whether `serve` and `work` make a store if there is none.
    pub create: bool,
    /// The age in days at which ready and failed cases are removed, unless they are kept; by default none is.
    pub keep_days: Option<u64>,
    /// Free bytes on the disk of the store below which `/readyz` reports a full disk.
    pub min_free_bytes: u64,
}

impl Default for Storage {
    fn default() -> Self {
        Self {
            data: PathBuf::from("isocortex-data"),
            database: None,
            database_password_file: None,
            objects: None,
            create: false,
            keep_days: None,
            min_free_bytes: 64 << 20,
        }
    }
}

/// A text that is never shown.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct Secret(pub String);

impl std::fmt::Debug for Secret {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Secret(…)")
    }
}
