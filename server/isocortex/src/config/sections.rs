//! The sections of a configuration, each with its defaults. The keys of the file are the names of the fields.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;

use cases::pictures::GpuUse;
use http::timeouts::Timeouts;
use ipnet::IpNet;
use pipeline::HeadLimits;
use pipeline::atlas::AtlasChoice;
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

/// The number of CPU cores.
pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// `[limits]`: limits on uploads, preparations and queues.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// The largest accepted volume, in voxels.
    pub max_voxels: usize,
    /// The shortest side of a volume, in mm; infants and specimens may need less.
    pub min_field_mm: f64,
    /// Memory for all processes together that read files and prepare cases, in bytes; by default enough for all workers and two series.
    pub child_bytes: Option<u64>,
    /// Cases that may wait to be prepared.
    pub max_queued_cases: usize,
    /// Pictures, meshes and checks of uploads that may wait; no key.
    #[serde(skip)]
    pub max_queued_renders: usize,
    /// Whether to compute the maps of the junction of grey and white matter.
    pub maps: MapsUse,
}

/// Whether to compute maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapsUse {
    /// Once for each case, after it is ready.
    #[default]
    On,
    /// Never.
    Off,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_upload_bytes: 1 << 30,
            max_voxels: 64 << 20,
            min_field_mm: HeadLimits::default().field_mm[0],
            child_bytes: None,
            max_queued_cases: 256,
            max_queued_renders: 64,
            maps: MapsUse::default(),
        }
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

/// `[prepare]`: preparation of cases.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Prepare {
    /// Cases prepared at a time; with 0 `isocortex serve` leaves them to `isocortex work`.
    pub workers: usize,
    /// The address on which `isocortex work` answers `/healthz`, `/readyz` and `/metrics`; by default none.
    pub listen: Option<SocketAddr>,
    /// Time for a preparation, in seconds; then the case fails.
    pub max_secs: u64,
    /// CPU time of all threads for a preparation, in seconds; then the case fails.
    pub max_cpu_secs: u64,
    /// The file with the weights for brain extraction; by default the one beside the program, if there is one.
    pub network: Option<PathBuf>,
    /// The folder of the atlas that names gyri, or its file with labels, or `none`; by default that of Debian's package
    /// `mricron-data`, if it is installed.
    pub atlas: AtlasChoice,
}

impl Default for Prepare {
    fn default() -> Self {
        Self {
            workers: 1,
            listen: None,
            max_secs: 900,
            max_cpu_secs: 120,
            network: None,
            atlas: AtlasChoice::default(),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Render {
    /// Pictures, meshes and checks of uploads that are computed at a time.
    pub threads: usize,
    /// Whether a GPU may draw.
    pub gpu: GpuUse,
    /// GPU memory for cases, in bytes; no key.
    #[serde(skip)]
    pub gpu_case_bytes: u64,
    /// Memory for what is kept of cases, in bytes.
    pub cache_bytes: u64,
}

impl Default for Render {
    fn default() -> Self {
        Self {
            threads: cores(),
            gpu: GpuUse::default(),
            gpu_case_bytes: 1 << 30,
            cache_bytes: 960 << 20,
        }
    }
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
