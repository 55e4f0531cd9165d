//! How the server is set up: a TOML file, over it the environment, over it the command line.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use cases::dicom::Program;
use cases::pictures::{GpuUse, GraphicsOptions};
use pipeline::{HeadLimits, Limits};
use serde::Deserialize;
use service::auth::{Access, BadToken};
use service::listen::ConnectionLimits;

use crate::logs::LogFormat;
use service::pace::LeastRate;

/// How much more than an upload the DICOM files in it may take when they are unpacked.
const DICOM_UNPACKING: u64 = 4;

/// The address to listen at where none is configured.
pub const DEFAULT_LISTEN: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 8640);

/// Everything that can be configured, with its defaults. The keys of the file are the names of the fields.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The directory of the store.
    pub data: PathBuf,
    /// Where to listen. Anything but this machine's own addresses needs a token.
    pub listen: SocketAddr,
    /// The bearer token that every request under `/v1` must carry.
    pub token: Option<Secret>,
    /// A file that holds the token, instead of `token`.
    pub token_file: Option<PathBuf>,
    /// How log lines are written.
    pub log_format: LogFormat,
    /// Which log lines are written, in the syntax of `RUST_LOG`.
    pub log: String,
    /// The largest accepted upload, in bytes.
    pub max_upload_bytes: u64,
    /// The largest accepted volume, in voxels: each takes two bytes, and a gzip can hold many in a few.
    pub max_voxels: usize,
    /// The shortest edge of a voxel, in mm. What is beyond this and the four next limits is no head: it is refused at once.
    pub min_voxel_mm: f64,
    /// The longest edge of a voxel, in mm.
    pub max_voxel_mm: f64,
    /// The shortest side of a volume, in mm; infants and specimens may need a smaller one.
    pub min_field_mm: f64,
    /// The longest side of a volume, in mm.
    pub max_field_mm: f64,
    /// How much longer than another edge one of a voxel may be.
    pub max_voxel_ratio: f64,
    /// How long a preparation may take, in seconds; then the case fails.
    pub max_prepare_secs: u64,
    /// How many cases may wait to be prepared.
    pub max_queued_cases: usize,
    /// Free bytes on the store's disk below which `/readyz` says that it is full.
    pub min_free_bytes: u64,
    /// Cases prepared at a time.
    pub prepare_workers: usize,
    /// The file with the weights of the network that extracts brains; by default the one beside the program, if there is one.
    pub network: Option<PathBuf>,
    /// Whether pictures may be drawn by a graphics device.
    pub gpu: GpuUse,
    /// Memory of the graphics device for cases, in bytes.
    pub gpu_case_bytes: u64,
    /// Threads that render.
    pub render_threads: usize,
    /// Renders that may wait for a thread.
    pub max_queued_renders: usize,
    /// Memory for warm cases, in bytes.
    pub model_cache_bytes: u64,
    /// Memory for compressed bodies, in bytes.
    pub body_cache_bytes: u64,
    /// Connections at a time. Of those beyond only health checks are answered.
    pub max_connections: usize,
    /// Of these, how many may come from one address. Behind a proxy all have one.
    pub max_connections_per_address: usize,
    /// Uploads at a time.
    pub max_uploads: usize,
    /// How fast a client must send a body, and take an answer, on average after the first seconds, in bytes a second.
    pub least_bytes_per_second: u64,
    /// For how long a client may be slower at first, in seconds.
    pub slow_start_secs: u64,
    /// Time for the headers of a request, in seconds; also how long a connection may be idle.
    pub header_timeout_secs: u64,
    /// Time for an answer, in seconds.
    pub answer_timeout_secs: u64,
    /// Time within which the next bytes of an upload must come, or of an answer be taken, in seconds.
    pub upload_idle_secs: u64,
    /// Time for a whole upload, in seconds.
    pub upload_timeout_secs: u64,
    /// Time for work to finish when the server is stopped, in seconds.
    pub shutdown_grace_secs: u64,
    /// The program that reads DICOM files: this one.
    #[serde(skip)]
    pub dicom_program: Program,
}

impl Default for Config {
    fn default() -> Self {
        let head = HeadLimits::default();
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            data: PathBuf::from("isocortex-data"),
            listen: DEFAULT_LISTEN,
            token: None,
            token_file: None,
            log_format: LogFormat::Text,
            log: "info".to_owned(),
            max_upload_bytes: 1 << 30,
            max_voxels: 64 << 20,
            min_voxel_mm: head.voxel_mm[0],
            max_voxel_mm: head.voxel_mm[1],
            min_field_mm: head.field_mm[0],
            max_field_mm: head.field_mm[1],
            max_voxel_ratio: head.max_ratio,
            max_prepare_secs: 900,
            max_queued_cases: 64,
            min_free_bytes: 64 << 20,
            prepare_workers: 1,
            network: None,
            gpu: GpuUse::default(),
            gpu_case_bytes: 1 << 30,
            render_threads: processors,
            max_queued_renders: 64,
            model_cache_bytes: 512 << 20,
            body_cache_bytes: 64 << 20,
            max_connections: 512,
            max_connections_per_address: 256,
            max_uploads: 64,
            least_bytes_per_second: 10_000,
            slow_start_secs: 10,
            header_timeout_secs: 10,
            answer_timeout_secs: 60,
            upload_idle_secs: 30,
            upload_timeout_secs: 3600,
            shutdown_grace_secs: 20,
            dicom_program: Program::default(),
        }
    }
}

/// A text that is not shown.
#[derive(Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct Secret(pub String);

impl std::fmt::Debug for Secret {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Secret(…)")
    }
}

/// What is wrong with a configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("the configuration file {} cannot be read: {source}", .path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not TOML, or holds an unknown key or a value of the wrong kind.
    #[error("the configuration file {} is not right: {source}", .path.display())]
    Malformed {
        /// Which.
        path: PathBuf,
        /// Why.
        source: Box<toml::de::Error>,
    },
    /// The token is too weak.
    #[error(transparent)]
    Token(#[from] BadToken),
    /// A token in two places.
    #[error("give the token in `token` or in `token_file`, not in both")]
    TwoTokens,
    /// Strangers could read everything.
    #[error(
        "refusing to listen on {listen} without a bearer token: set ISOCORTEX_TOKEN or `token_file`, or listen on 127.0.0.1"
    )]
    OpenToStrangers {
        /// Where it was to listen.
        listen: SocketAddr,
    },
    /// A limit of zero.
    #[error("`{key}` must be at least 1")]
    Zero {
        /// The key.
        key: &'static str,
    },
}

impl Config {
    /// Reads a TOML file; what it does not name has its default.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, or holds an unknown key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        toml::from_str(&text).map_err(|source| ConfigError::Malformed {
            path: path.to_owned(),
            source: Box::new(source),
        })
    }

    /// Who may ask.
    ///
    /// # Errors
    /// When the token cannot be read or is too weak, or when there is none and strangers could reach the server.
    pub fn access(&self) -> Result<Access, ConfigError> {
        match self.token_text()? {
            Some(token) => Ok(Access::with_token(token.trim())?),
            None if self.listen.ip().is_loopback() => Ok(Access::of_this_machine()),
            None => Err(ConfigError::OpenToStrangers {
                listen: self.listen,
            }),
        }
    }

    fn token_text(&self) -> Result<Option<String>, ConfigError> {
        match (&self.token, &self.token_file) {
            (Some(_), Some(_)) => Err(ConfigError::TwoTokens),
            (Some(token), None) => Ok(Some(token.0.clone())),
            (None, Some(path)) => {
                let read = std::fs::read_to_string(path);
                let unreadable = |source| ConfigError::Unreadable {
                    path: path.clone(),
                    source,
                };
                storage::keep_private(path, "the file of the token");
                read.map(Some).map_err(unreadable)
            }
            (None, None) => Ok(None),
        }
    }

    /// Whether the numbers can be used.
    ///
    /// # Errors
    /// When one of those that must be at least 1 is 0.
    pub fn check(&self) -> Result<(), ConfigError> {
        let counts = [
            ("max_upload_bytes", self.max_upload_bytes),
            ("max_voxels", self.max_voxels as u64),
            ("max_prepare_secs", self.max_prepare_secs),
            ("max_queued_cases", self.max_queued_cases as u64),
            ("prepare_workers", self.prepare_workers as u64),
            ("render_threads", self.render_threads as u64),
            ("max_queued_renders", self.max_queued_renders as u64),
            ("max_connections", self.max_connections as u64),
            (
                "max_connections_per_address",
                self.max_connections_per_address as u64,
            ),
            ("max_uploads", self.max_uploads as u64),
            ("least_bytes_per_second", self.least_bytes_per_second),
            ("slow_start_secs", self.slow_start_secs),
            ("header_timeout_secs", self.header_timeout_secs),
            ("answer_timeout_secs", self.answer_timeout_secs),
            ("upload_idle_secs", self.upload_idle_secs),
            ("upload_timeout_secs", self.upload_timeout_secs),
        ];
        match counts.into_iter().find(|&(_, value)| value == 0) {
            Some((key, _)) => Err(ConfigError::Zero { key }),
            None => Ok(()),
        }
    }

    /// How the application is set up.
    pub fn cases(&self) -> cases::Options {
        cases::Options {
            data: self.data.clone(),
            store: storage::Options {
                queue_limit: self.max_queued_cases,
                min_free_bytes: self.min_free_bytes,
                longest_preparation: Duration::from_secs(self.max_prepare_secs),
                ..storage::Options::default()
            },
            network: self.network.clone(),
            limits: Limits {
                max_voxels: self.max_voxels,
                ..Limits::default()
            },
            head: HeadLimits {
                voxel_mm: [self.min_voxel_mm, self.max_voxel_mm],
                field_mm: [self.min_field_mm, self.max_field_mm],
                max_ratio: self.max_voxel_ratio,
            },
            render_threads: self.render_threads,
            max_queued_renders: self.max_queued_renders,
            model_cache_bytes: self.model_cache_bytes,
            graphics: GraphicsOptions {
                use_of: self.gpu,
                drawers: self.render_threads,
                case_bytes: self.gpu_case_bytes,
            },
            dicom_program: self.dicom_program.clone(),
            max_dicom_bytes: self.max_upload_bytes.saturating_mul(DICOM_UNPACKING),
        }
    }

    /// What connections may take.
    pub fn connection_limits(&self) -> ConnectionLimits {
        ConnectionLimits {
            connections: self.max_connections,
            connections_per_address: self.max_connections_per_address,
            header_timeout: Duration::from_secs(self.header_timeout_secs),
            least_rate: LeastRate {
                bytes_per_second: self.least_bytes_per_second,
                grace: Duration::from_secs(self.slow_start_secs),
                pause: Duration::from_secs(self.upload_idle_secs),
            },
            shutdown_grace: Duration::from_secs(self.shutdown_grace_secs),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Config, ConfigError> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("isocortex.toml");
        std::fs::write(&path, text).unwrap();
        Config::read(&path)
    }

    #[test]
    fn what_a_file_does_not_name_has_its_default() {
        let config = parsed("max_connections = 7").unwrap();
        assert_eq!(
            config,
            Config {
                max_connections: 7,
                ..Config::default()
            }
        );
    }

    #[test]
    fn an_unknown_key_is_named() {
        let error = parsed("max_conections = 7").unwrap_err().to_string();
        assert!(error.contains("max_conections"), "{error}");
    }

    #[test]
    fn strangers_need_a_token() {
        let open = Config {
            listen: "0.0.0.0:8640".parse().unwrap(),
            ..Config::default()
        };
        let error = open.access().unwrap_err();
        assert!(matches!(error, ConfigError::OpenToStrangers { .. }));
        let guarded = Config {
            token: Some(Secret("0123456789abcdef".to_owned())),
            ..open
        };
        assert!(guarded.access().unwrap().wants_token());
    }

    #[test]
    fn a_token_can_come_from_a_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "0123456789abcdef\n").unwrap();
        let config = Config {
            token_file: Some(file.path().to_owned()),
            ..Config::default()
        };
        assert!(config.access().unwrap().wants_token());
    }

    #[test]
    fn a_token_is_never_shown() {
        let config = Config {
            token: Some(Secret("0123456789abcdef".to_owned())),
            ..Config::default()
        };
        assert!(!format!("{config:?}").contains("0123456789abcdef"));
    }

    #[test]
    fn a_limit_of_zero_is_named() {
        let config = Config {
            render_threads: 0,
            ..Config::default()
        };
        assert!(
            config
                .check()
                .unwrap_err()
                .to_string()
                .contains("render_threads")
        );
    }
}
