//! The configuration: a TOML file with a section for each concern, overridden by the environment, overridden by the
//! command line.

mod memory;
mod others;
mod sections;
mod tokens;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use access::audit::{self, Audit};
use access::auth::{Access, BadToken, unnamed};
use access::origins::{NotAnOrigin, Origins};
use access::proxy::{BadProxy, ProxyOptions, SignInProxy};
use access::tokens::NamedToken;
use cases::BeforeRemoval;
use cases::settings::{Limits, Prepare, Render};
use http::files::{UnreadableFile, read_file};
use http::forwarded::TrustedProxies;
use http::listen::ConnectionLimits;
use http::tls::{BadTls, ListeningTls, serving_tls};
use pacs::settings::{BadSettings, Settings};
use serde::Deserialize;
use storage::{BadAddress, DatabaseAddress, Location, ObjectsAddress, Opening};
use worker::{ChildBudget, Program};

use crate::logs::LogFormat;

pub use self::sections::{DEFAULT_LISTEN, Http, Network, Page, Secret, Storage};
pub(crate) use self::tokens::check_name as check_token_name;

/// The usual options of a store, which has the tables of the PACS.
pub fn store_options() -> storage::Options {
    storage::Options {
        opening: Opening::Existing,
        tables: Arc::new(pacs::PacsTables),
        ..storage::Options::default()
    }
}

/// All settings with their defaults. The keys of the file are the names of the fields.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The format of log lines.
    pub log_format: LogFormat,
    /// The log lines to write: a level, and levels of targets.
    pub log: String,
    /// The record of who does what.
    pub audit: audit::Options,
    /// The server: address and access.
    pub http: Http,
    /// Limits on uploads and queues.
    pub limits: Limits,
    /// What the page shows.
    pub page: Page,
    /// Images from a PACS.
    pub pacs: Settings,
    pub prepare: Prepare,
    /// The proxy by which people sign in, if there is one.
    pub proxy: Option<ProxyOptions>,
    pub render: Render,
    pub storage: Storage,
    /// The file that this was read from, if it was.
    #[serde(skip)]
    pub file: Option<PathBuf>,
    /// Whether each preparation runs in a process of its own: in long-running commands, which the commands set.
    #[serde(skip)]
    pub prepares_apart: bool,
    /// The program of the processes that read files: this one.
    #[serde(skip)]
    pub dicom_program: Program,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            log_format: LogFormat::Text,
            log: "info".to_owned(),
            audit: audit::Options::default(),
            http: Http::default(),
            limits: Limits::default(),
            page: Page::default(),
            pacs: Settings::default(),
            prepare: Prepare::default(),
            proxy: None,
            render: Render::default(),
            storage: Storage::default(),
            file: None,
            prepares_apart: false,
            dicom_program: Program::default(),
        }
    }
}

/// Why a configuration is invalid.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error(transparent)]
    Unreadable(#[from] UnreadableFile),
    /// The file is not TOML, or has an unknown key or a value of the wrong kind.
    #[error("the configuration file {} is invalid: {source}", .path.display())]
    Malformed {
        path: PathBuf,
        source: Box<toml::de::Error>,
    },
    /// The token is too weak.
    #[error(transparent)]
    Token(#[from] BadToken),
    /// The file of the named tokens is wrong.
    #[error("cannot use the tokens in {}: {why}", .path.display())]
    Tokens {
        path: PathBuf,
        /// What is wrong, in one sentence.
        why: String,
    },
    /// Nothing can be recorded.
    #[error(
        "nothing can be written in the folder of the audit record {} (`audit.folder`): {source}; make it, for the user of the server alone", .folder.display()
    )]
    Audit {
        folder: PathBuf,
        source: std::io::Error,
    },
    /// A token in a variable, which others of the same user can read.
    #[error(
        "the variable `ISOCORTEX_TOKEN` has a secret; remove it, and write the token into the file that `ISOCORTEX_TOKEN_FILE` (`http.token_file`) names"
    )]
    TokenInVariable,
    /// A token in two places.
    #[error("set the token in `http.token` or in `http.token_file`, not in both")]
    TwoTokens,
    /// Nobody can sign in by the proxy.
    #[error("`proxy`: {0}")]
    Proxy(#[from] BadProxy),
    /// No proxy is trusted.
    #[error(
        "`proxy` needs `proxy.socket`, or the addresses of the proxies in `http.trusted_proxies`: headers that come from elsewhere are ignored"
    )]
    NoProxy,
    /// The trusted network covers all addresses, so any client could claim to be any user.
    #[error(
        "`http.trusted_proxies` has {network}, so that everybody could name anybody in the headers of `proxy`; list the addresses of the proxies alone"
    )]
    ProxyOfEverybody { network: ipnet::IpNet },
    /// Everyone on the network could read everything.
    #[error(
        "refusing to listen on {listen} without a bearer token: set `http.tokens_file` (`isocortex token new`), `http.token_file` or `proxy`, or listen on 127.0.0.1"
    )]
    OpenToStrangers { listen: SocketAddr },
    /// A setting of the PACS is invalid.
    #[error(transparent)]
    Pacs(#[from] BadSettings),
    /// An address of the store is invalid.
    #[error("`{key}`: {source}")]
    Address {
        key: &'static str,
        source: BadAddress,
    },
    /// An origin is none.
    #[error("`{key}`: {source}")]
    Origin {
        key: &'static str,
        source: NotAnOrigin,
    },
    /// The folder of the store is something else.
    #[error("`storage.data` is {}, which is no folder; name a folder, or one that does not exist yet", .folder.display())]
    NoFolder { folder: PathBuf },
    /// Two listeners cannot have one port.
    #[error(
        "`http.listen` and `pacs.dimse.listen` have the same port {port}; choose another one for C-STORE"
    )]
    SamePort { port: u16 },
    /// TLS of HTTP is configured incompletely.
    #[error("`http` needs both `tls_certificate` and `tls_key`, or neither")]
    HttpTls,
    /// A file for TLS of HTTP is invalid.
    #[error("TLS of HTTP: {0}")]
    BadHttpTls(BadTls),
    /// One process may use more than all together.
    #[error(
        "`limits.child_bytes` must be at least {least}: one process needs as much for a volume of `limits.max_voxels`"
    )]
    ChildBytes { least: u64 },
    /// A limit of zero.
    #[error("`{key}` must be at least 1")]
    Zero { key: &'static str },
}

impl Config {
    /// Reads a TOML file; missing keys have their defaults.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML, or has an unknown key.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = read_file(path, "the configuration file")?;
        let malformed = |source| ConfigError::Malformed {
            path: path.to_owned(),
            source: Box::new(source),
        };
        let mut config: Self = toml::from_str(&text).map_err(malformed)?;
        config.file = Some(path.to_owned());
        Ok(config)
    }

    /// The access rules.
    ///
    /// # Errors
    /// If the token cannot be read or is too weak, or if there is none and the server would listen on the network.
    pub fn access(&self) -> Result<Access, ConfigError> {
        let mut tokens = self.named_tokens()?;
        if let Some(token) = self.token_text()? {
            tokens.push(unnamed(token.trim())?);
        }
        let listen = self.http.listen;
        let proxy = self.sign_in_proxy()?;
        let wants_token = !tokens.is_empty() || self.http.tokens_file.is_some() || proxy.is_some();
        let access = match wants_token {
            true => Access::with_tokens(tokens),
            false if listen.ip().is_loopback() => Access::of_this_machine(),
            false => return Err(ConfigError::OpenToStrangers { listen }),
        };
        let [allowed, _] = self.origins()?;
        Ok(access.with_origins(allowed).with_proxy(proxy))
    }

    /// How people sign in by a proxy, if they do.
    ///
    /// # Errors
    /// If nobody could sign in, or everybody as anybody.
    pub fn sign_in_proxy(&self) -> Result<Option<SignInProxy>, ConfigError> {
        let Some(proxy) = &self.proxy else {
            return Ok(None);
        };
        let trusted = &self.http.trusted_proxies;
        if trusted.is_empty() && proxy.socket.is_none() {
            return Err(ConfigError::NoProxy);
        }
        if let Some(Network(network)) = trusted.iter().find(|it| it.0.prefix_len() == 0) {
            return Err(ConfigError::ProxyOfEverybody { network: *network });
        }
        Ok(Some(SignInProxy::new(proxy.clone())?))
    }

    /// The origins whose pages may read answers, and those in whose frames the page may stand.
    ///
    /// # Errors
    /// If one is no origin.
    pub fn origins(&self) -> Result<[Origins; 2], ConfigError> {
        let parse = |key, texts: &[String]| {
            let wrong = |source| ConfigError::Origin { key, source };
            Origins::parse(texts).map_err(wrong)
        };
        Ok([
            parse("http.allowed_origins", &self.http.allowed_origins)?,
            parse("http.frame_ancestors", &self.http.frame_ancestors)?,
        ])
    }

    /// Whether the page shows the patient of a case from DICOM: unless it is set, if strangers cannot open the page's cases.
    ///
    /// # Errors
    /// As [`Config::access`].
    pub fn shows_patient(&self) -> Result<bool, ConfigError> {
        match self.page.patient_banner {
            Some(shows) => Ok(shows),
            None => Ok(self.access()?.wants_token()),
        }
    }

    /// What is wrong if `http.tokens_file` has no token in it.
    ///
    /// # Errors
    /// As [`Config::named_tokens`].
    pub fn warn_of_no_tokens(&self) -> Result<Option<String>, ConfigError> {
        let Some(path) = &self.http.tokens_file else {
            return Ok(None);
        };
        let has_none = self.named_tokens()?.is_empty();
        Ok(has_none.then(|| {
            format!(
                "{} has no token: add one with `isocortex token new`, or leave `http.tokens_file` out",
                path.display()
            )
        }))
    }

    /// The tokens of `http.tokens_file`.
    ///
    /// # Errors
    /// If the file cannot be read, or one of them is described wrongly.
    pub fn named_tokens(&self) -> Result<Vec<NamedToken>, ConfigError> {
        let Some(path) = &self.http.tokens_file else {
            return Ok(Vec::new());
        };
        let text = read_file(path, "the file of named tokens")?;
        let wrong = |why| ConfigError::Tokens {
            path: path.clone(),
            why,
        };
        tokens::parse(&text).map_err(wrong)
    }

    /// The scheme of the server's address.
    pub fn scheme(&self) -> &'static str {
        match self.http.tls_certificate {
            Some(_) => "https",
            None => "http",
        }
    }

    /// TLS of the server, if it has a certificate.
    ///
    /// # Errors
    /// If the certificate or its key cannot be used.
    pub fn tls(&self) -> Result<Option<ListeningTls>, ConfigError> {
        match (&self.http.tls_certificate, &self.http.tls_key) {
            (None, None) => Ok(None),
            (Some(certificate), Some(key)) => {
                let certificate = read_file(certificate, "the certificate for TLS")?;
                let key = read_file(key, "the file of the key for TLS")?;
                let tls = serving_tls(certificate.as_bytes(), key.as_bytes());
                Ok(Some(tls.map_err(ConfigError::BadHttpTls)?))
            }
            _ => Err(ConfigError::HttpTls),
        }
    }

    /// Begins the record of who does what, if there is a folder for it.
    ///
    /// # Errors
    /// If nothing can be written there.
    pub fn audit(&self) -> Result<Audit, ConfigError> {
        Audit::start(self.audit.clone()).map_err(|source| self.not_recorded(source))
    }

    /// Checks that something can be written in the folder of the record, without beginning one.
    ///
    /// # Errors
    /// If nothing can.
    pub fn check_audit(&self) -> Result<(), ConfigError> {
        match &self.audit.folder {
            Some(folder) => audit::check_folder(folder).map_err(|source| self.not_recorded(source)),
            None => Ok(()),
        }
    }

    fn not_recorded(&self, source: std::io::Error) -> ConfigError {
        ConfigError::Audit {
            folder: self.audit.folder.clone().unwrap_or_default(),
            source,
        }
    }

    fn token_text(&self) -> Result<Option<String>, ConfigError> {
        match (&self.http.token, &self.http.token_file) {
            (Some(_), Some(_)) => Err(ConfigError::TwoTokens),
            (Some(token), None) => Ok(Some(token.0.clone())),
            (None, Some(path)) => Ok(Some(read_file(path, "the file of the token")?)),
            (None, None) => Ok(None),
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// If a number that must be at least 1 is 0.
    pub fn check(&self) -> Result<(), ConfigError> {
        let counts = [
            ("limits.max_upload_bytes", self.limits.max_upload_bytes),
            ("limits.max_voxels", self.limits.max_voxels as u64),
            (
                "limits.max_queued_cases",
                self.limits.max_queued_cases as u64,
            ),
            ("prepare.max_secs", self.prepare.max_secs),
            ("prepare.max_cpu_secs", self.prepare.max_cpu_secs),
            ("render.threads", self.render.threads as u64),
            ("http.max_connections", self.http.max_connections as u64),
            ("storage.keep_days", self.storage.keep_days.unwrap_or(1)),
        ];
        let mut counts = counts.into_iter().chain(self.pacs.counts());
        match counts.find(|&(_, value)| value == 0) {
            Some((key, _)) => Err(ConfigError::Zero { key }),
            None => Ok(()),
        }
    }

    /// Checks that the listeners for HTTP and C-STORE do not need the same port. The system chooses a free port for 0.
    ///
    /// # Errors
    /// If they do.
    pub fn check_ports(&self) -> Result<(), ConfigError> {
        let http = self.http.listen;
        let is_same = |dimse: &SocketAddr| {
            let is_any = http.ip().is_unspecified() || dimse.ip().is_unspecified();
            dimse.port() == http.port() && http.port() > 0 && (is_any || dimse.ip() == http.ip())
        };
        match self.pacs.dimse.listen.filter(is_same) {
            Some(dimse) => Err(ConfigError::SamePort { port: dimse.port() }),
            None => Ok(()),
        }
    }

    /// The location of the store.
    ///
    /// # Errors
    /// If an address is invalid, the password cannot be read, or the folder is something else.
    pub fn location(&self) -> Result<Location, ConfigError> {
        // A folder below a file cannot be made either.
        let folder = &self.storage.data;
        let mut above = folder.ancestors();
        if let Some(held) = above.find(|part| part.exists())
            && !held.is_dir()
        {
            return Err(ConfigError::NoFolder {
                folder: folder.clone(),
            });
        }
        let wrong = |key| move |source| ConfigError::Address { key, source };
        let address = self.storage.database.as_ref();
        let mut database = address
            .map(|address| DatabaseAddress::parse(&address.0))
            .transpose()
            .map_err(wrong("storage.database"))?;
        if let Some(path) = &self.storage.database_password_file {
            let password = read_file(path, "the file of the database's password")?;
            database = database.map(|address| address.with_password(password.trim_end()));
        }
        let objects = self.storage.objects.as_deref();
        let objects = objects.map(ObjectsAddress::parse).transpose();
        Ok(Location {
            folder: self.storage.data.clone(),
            database,
            objects: objects.map_err(wrong("storage.objects"))?,
        })
    }

    /// What the processes that read files and prepare cases may use together: what fits beside the rest into the memory of the container, if
    /// it is limited.
    ///
    /// # Errors
    /// If one of them needs more than the configuration gives.
    pub fn children(&self) -> Result<ChildBudget, ConfigError> {
        self.children_in(memory::limit())
    }

    /// The same in a container with so many bytes.
    ///
    /// # Errors
    /// As [`Config::children`].
    pub fn children_in(&self, container: Option<u64>) -> Result<ChildBudget, ConfigError> {
        let usual = ChildBudget::usual(&self.limits.volumes(), self.prepare.workers);
        let least = usual.least();
        match (self.limits.child_bytes, container) {
            (Some(bytes), _) if bytes < least => Err(ConfigError::ChildBytes { least }),
            (Some(bytes), _) => Ok(usual.of(bytes)),
            (None, None) => Ok(usual),
            (None, Some(container)) => {
                let fits = container.saturating_sub(self.own_bytes());
                Ok(usual.of(fits.clamp(least, usual.bytes.max(least))))
            }
        }
    }

    /// The memory of the container or, if it is not limited, of the machine, in bytes.
    pub(crate) fn memory_bytes() -> Option<u64> {
        let limits = [memory::limit(), memory::of_process(), memory::of_machine()];
        limits.into_iter().flatten().min()
    }

    /// The memory that this process and a preparation of the largest volume need, in bytes.
    ///
    /// # Errors
    /// As [`Config::children`].
    pub(crate) fn needed_bytes(&self) -> Result<u64, ConfigError> {
        let least = self.children()?.least();
        Ok(least.saturating_add(self.own_bytes()))
    }

    /// What this process uses itself, in bytes.
    fn own_bytes(&self) -> u64 {
        self.render.cache_bytes.saturating_add(memory::REST)
    }

    /// What may happen because the memory of the container is limited, if anything.
    ///
    /// # Errors
    /// As [`Config::children`].
    pub fn memory_warning(&self) -> Result<Option<String>, ConfigError> {
        let Some(container) = memory::limit() else {
            return Ok(None);
        };
        let children = self.children_in(Some(container))?.bytes;
        let needed = children.saturating_add(self.own_bytes());
        Ok((needed > container).then(|| {
            format!(
                "this process and its children may use {} MiB, but the memory of the container is limited to {} MiB: the system may end them; raise its limit, or lower `render.cache_bytes` or `limits.child_bytes`",
                needed >> 20,
                container >> 20
            )
        }))
    }

    /// The options of the application.
    ///
    /// # Errors
    /// As [`Config::location`].
    pub fn cases(&self) -> Result<cases::Options, ConfigError> {
        Ok(cases::Options {
            location: self.location()?,
            store: storage::Options {
                opening: match self.storage.create {
                    true => Opening::OrMake,
                    false => Opening::Existing,
                },
                queue_limit: self.limits.max_queued_cases,
                min_free_bytes: self.storage.min_free_bytes,
                longest_preparation: Duration::from_secs(self.prepare.max_secs),
                keep: self.storage.keep_days.map(days),
                ..store_options()
            },
            limits: self.limits.clone(),
            prepare: self.prepare.clone(),
            render: self.render.clone(),
            children: self.children()?,
            prepares_apart: self.prepares_apart,
            dicom_program: self.dicom_program.clone(),
            deidentify: self.pacs.deidentify,
            before_removal: BeforeRemoval::default(),
        })
    }

    /// The limits of connections.
    pub fn connection_limits(&self) -> ConnectionLimits {
        ConnectionLimits {
            connections: self.http.max_connections,
            trusted_proxies: TrustedProxies(
                (self.http.trusted_proxies.iter().map(|network| network.0)).collect(),
            ),
            timeouts: self.http.timeouts,
        }
    }
}

fn days(count: u64) -> Duration {
    Duration::from_secs(count.saturating_mul(24 * 3600))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Config, ConfigError> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("isocortex.toml");
        std::fs::write(&path, text).unwrap();
        let read = Config::read(&path)?;
        Ok(Config { file: None, ..read })
    }

    fn with_http(http: Http) -> Config {
        Config {
            http,
            ..Config::default()
        }
    }

    fn secret() -> Option<Secret> {
        Some(Secret("0123456789abcdef".to_owned()))
    }

    #[test]
    fn children_fit_into_the_memory_of_the_container() {
        let bytes = |config: &Config, container| config.children_in(container).unwrap().bytes;
        let config = Config::default();
        let usual = bytes(&config, None);
        assert_eq!(bytes(&config, Some(64 << 30)), usual);
        let within = bytes(&config, Some(4 << 30));
        assert_eq!(within, (4 << 30) - config.own_bytes());
        assert!(within < usual);
        // With less, each process still has its turn.
        let least = config.children_in(None).unwrap().least();
        assert_eq!(bytes(&config, Some(1 << 30)), least);
        let set = parsed("[limits]\nchild_bytes = 6442450944").unwrap();
        assert_eq!(bytes(&set, Some(4 << 30)), 6 << 30);
        let small = parsed("[limits]\nchild_bytes = 1").unwrap();
        assert!(small.children_in(Some(4 << 30)).is_err());
    }

    #[test]
    fn what_a_file_does_not_name_has_its_default() {
        let config = parsed("[http]\nmax_connections = 7").unwrap();
        let expected = with_http(Http {
            max_connections: 7,
            ..Http::default()
        });
        assert_eq!(config, expected);
    }

    #[test]
    fn an_unknown_key_is_named() {
        for text in [
            "max_conections = 7",
            "[http]\nmax_conections = 7",
            "[render]\ngpu = \"off\"\n[limits]\nmax_conections = 7",
        ] {
            let error = parsed(text).unwrap_err().to_string();
            assert!(error.contains("max_conections"), "{error}");
        }
    }

    /// The keys that a section may have, from the error that an unknown one gets.
    fn keys_of(section: &str) -> Vec<String> {
        let required = match section {
            "proxy" => "user_header = \"X-User\"\n",
            _ => "",
        };
        let text = match section {
            "" => "no_key = 1".to_owned(),
            _ => format!("[{section}]\n{required}no_key = 1"),
        };
        let error = parsed(&text).unwrap_err().to_string();
        let (_, expected) = error.split_once("expected").expect("the keys");
        let quoted = expected.split('`').skip(1).step_by(2);
        quoted.map(str::to_owned).collect()
    }

    #[test]
    fn the_file_of_the_debian_package_has_every_setting_as_a_comment() {
        let file = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../scripts/debian/isocortex.toml"
        );
        let text = std::fs::read_to_string(file).unwrap();
        let installed = parsed(&text).unwrap();
        assert_eq!(installed.storage.data, Path::new("/var/lib/isocortex"));
        // Sentences begin with a capital letter or a slash, settings do not.
        let is_setting = |line: &str| line.contains(" = ") || line.starts_with('[');
        let uncommented = text.lines().map(|line| match line.strip_prefix("# ") {
            Some(setting) if is_setting(setting) => setting,
            _ => line,
        });
        let uncommented: Vec<_> = uncommented.collect();
        parsed(&uncommented.join("\n")).unwrap();
        for section in [
            "",
            "storage",
            "http",
            "proxy",
            "audit",
            "prepare",
            "render",
            "limits",
            "page",
            "pacs",
            "pacs.dimse",
        ] {
            let header = format!("[{section}]");
            let lines = uncommented
                .iter()
                .skip_while(|line| !section.is_empty() && **line != header);
            let lines = lines.skip(usize::from(!section.is_empty()));
            let lines: Vec<_> = lines.take_while(|line| !line.starts_with('[')).collect();
            for key in keys_of(section) {
                let is_table = uncommented.iter().any(|line| {
                    line.trim_matches(['[', ']'])
                        == format!("{section}.{key}").trim_start_matches('.')
                });
                let is_there = lines
                    .iter()
                    .any(|line| line.starts_with(&format!("{key} = ")));
                assert!(is_there || is_table, "`{section}` lacks `{key}`");
            }
        }
    }

    #[test]
    fn cases_are_kept_for_ever_unless_days_are_set_and_never_for_none() {
        let keep = |text: &str| parsed(text).unwrap().cases().unwrap().store.keep;
        assert_eq!(keep(""), None);
        let two_days = Some(Duration::from_secs(172_800));
        assert_eq!(keep("[storage]\nkeep_days = 2"), two_days);
        let none = parsed("[storage]\nkeep_days = 0").unwrap();
        let error = none.check().unwrap_err().to_string();
        assert!(error.contains("`storage.keep_days`"), "{error}");
    }

    #[test]
    fn an_origin_is_no_pattern() {
        let config = parsed("[http]\nallowed_origins = [\"https://viewer.example\"]").unwrap();
        assert_eq!(config.origins().unwrap()[0].iter().count(), 1);
        for key in ["allowed_origins", "frame_ancestors"] {
            let config = parsed(&format!("[http]\n{key} = [\"*\"]")).unwrap();
            let error = config.origins().unwrap_err().to_string();
            assert!(error.contains(&format!("`http.{key}`")), "{error}");
        }
    }

    #[test]
    fn strangers_need_a_token() {
        let open = Http {
            listen: "0.0.0.0:8640".parse().unwrap(),
            ..Http::default()
        };
        let error = with_http(open.clone()).access().unwrap_err();
        assert!(matches!(error, ConfigError::OpenToStrangers { .. }));
        let guarded = with_http(Http {
            token: secret(),
            ..open
        });
        assert!(guarded.access().unwrap().wants_token());
    }

    #[test]
    fn the_patient_is_shown_where_a_token_is_needed_unless_it_is_set() {
        for (token, set, shown) in [
            (None, None, false),
            (secret(), None, true),
            (secret(), Some(false), false),
            (None, Some(true), true),
        ] {
            let mut config = Config::default();
            config.http.token = token;
            config.page.patient_banner = set;
            assert_eq!(config.shows_patient().unwrap(), shown);
        }
    }

    #[test]
    fn a_token_can_come_from_a_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "0123456789abcdef\n").unwrap();
        let config = with_http(Http {
            token_file: Some(file.path().to_owned()),
            ..Http::default()
        });
        assert!(config.access().unwrap().wants_token());
    }

    #[test]
    fn a_token_is_never_shown() {
        let config = with_http(Http {
            token: secret(),
            ..Http::default()
        });
        assert!(!format!("{config:?}").contains("0123456789abcdef"));
    }

    #[test]
    fn a_store_can_be_a_database_and_a_bucket_and_its_password_in_a_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "CANARY\n").unwrap();
        let config = parsed(&format!(
            "[storage]\ndatabase = \"postgres://u@db/cases\"\nobjects = \"s3://heads/a\"\n\
             database_password_file = \"{}\"",
            file.path().display()
        ));
        let config = config.unwrap();
        let location = config.location().unwrap();
        let shown = format!("{config:?} {location:?}");
        assert!(
            shown.contains("db:5432/cases") && !shown.contains("CANARY"),
            "{shown}"
        );
        for (key, value) in [
            ("database", "u:CANARY@db"),
            ("database", "postgres://u:CANARY@db/cases"),
            ("objects", "http://CANARY"),
        ] {
            let config = parsed(&format!("[storage]\n{key} = \"{value}\"")).unwrap();
            let error = config.location().unwrap_err().to_string();
            let named = format!("`storage.{key}`: ");
            assert!(
                error.contains(&named) && !error.contains("CANARY"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_limit_of_zero_is_named() {
        let (mut threads, mut seconds) = (Config::default(), Config::default());
        threads.render.threads = 0;
        seconds.prepare.max_secs = 0;
        for (config, key) in [(threads, "render.threads"), (seconds, "prepare.max_secs")] {
            let error = config.check().unwrap_err().to_string();
            assert!(error.contains(key), "{error}");
        }
    }
}
