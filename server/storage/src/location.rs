//! The location of a store: a folder of this process, a database, and a place for objects.

use std::fmt;
use std::path::{Path, PathBuf};

use sqlx::postgres::{PgConnectOptions, PgSslMode};

use super::sql::Rows;
use super::{StoreError, rows_file};

/// The accepted parameters of the address of a PostgreSQL database. Others are rejected, because sqlx would log them.
const POSTGRES_PARAMETERS: [&str; 11] = [
    "sslmode",
    "sslrootcert",
    "sslcert",
    "sslkey",
    "statement-cache-capacity",
    "host",
    "hostaddr",
    "port",
    "dbname",
    "user",
    "application_name",
];

/// The variables with secrets that a database of PostgreSQL would use, and what to use instead.
const POSTGRES_SECRETS: [(&str, &str); 1] = [(
    "PGPASSWORD",
    "write it into the file that `ISOCORTEX_DATABASE_PASSWORD_FILE` (`storage.database_password_file`) names, or into `~/.pgpass`",
)];

const INTO_CREDENTIALS: &str = "write it into the file that `AWS_SHARED_CREDENTIALS_FILE` names";

/// The variables with secrets that a bucket would use, and what to use instead.
const BUCKET_SECRETS: [(&str, &str); 5] = [
    ("AWS_ACCESS_KEY_ID", INTO_CREDENTIALS),
    ("AWS_SECRET_ACCESS_KEY", INTO_CREDENTIALS),
    ("AWS_SESSION_TOKEN", INTO_CREDENTIALS),
    ("AWS_TOKEN", INTO_CREDENTIALS),
    (
        "AWS_SSE_CUSTOMER_KEY_BASE64",
        "let the bucket encrypt with a key of its own (`AWS_SSE_KMS_KEY_ID`)",
    ),
];

/// The location of a store.
#[derive(Debug, Clone)]
pub struct Location {
    /// The folder of this process: for running uploads, and for the database and the objects unless they have other
    /// places. Created if missing.
    pub folder: PathBuf,
    /// The database, unless it is `rows.sqlite` in the folder.
    pub database: Option<DatabaseAddress>,
    /// The objects, unless they are in `objects` in the folder.
    pub objects: Option<ObjectsAddress>,
}

impl<P: AsRef<Path> + ?Sized> From<&P> for Location {
    fn from(folder: &P) -> Self {
        Self {
            folder: folder.as_ref().to_owned(),
            database: None,
            objects: None,
        }
    }
}

impl Location {
    /// Whether there are rows. Nothing is changed.
    ///
    /// # Errors
    /// If a database cannot be reached.
    pub(crate) async fn has_rows(&self) -> Result<bool, StoreError> {
        match &self.database {
            None => Ok(is_written(&rows_file(&self.folder))),
            Some(DatabaseAddress::Sqlite(file)) => Ok(is_written(file)),
            Some(DatabaseAddress::Postgres(options)) => {
                Rows::is_in_postgres((**options).clone()).await
            }
        }
    }

    /// The error of whoever finds no rows and must not make any.
    pub(crate) fn no_rows(&self) -> StoreError {
        StoreError::NoStore(match &self.database {
            None => "the folder has no `rows.sqlite`",
            Some(DatabaseAddress::Sqlite(_)) => "the file of the database does not exist",
            Some(DatabaseAddress::Postgres(_)) => "the database has no tables of a store",
        })
    }

    /// The folder of the objects, unless they are in a bucket.
    pub(crate) fn objects_folder(&self) -> Option<PathBuf> {
        match &self.objects {
            None => Some(self.folder.join("objects")),
            Some(ObjectsAddress::Folder(folder)) => Some(folder.clone()),
            Some(ObjectsAddress::Bucket { .. }) => None,
        }
    }
}

/// Whether a file of SQLite has been written.
fn is_written(file: &Path) -> bool {
    std::fs::metadata(file).is_ok_and(|metadata| metadata.is_file() && metadata.len() > 0)
}

/// The reason why an address is invalid. The address is not repeated, because it may contain a password.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum BadAddress {
    /// A database of another kind.
    #[error("write the database as `postgres://[user@]host[:port]/name` or `sqlite:///file`")]
    Database,
    /// Objects of another kind.
    #[error("write the place of the objects as `s3://bucket[/prefix]` or `file:///folder`")]
    Objects,
    /// An unknown parameter in the address of PostgreSQL.
    #[error("the parameter `{0}` is not accepted in the address of a PostgreSQL database")]
    Parameter(String),
    /// A password in the address of PostgreSQL, which is shown in lists of processes and in logs.
    #[error(
        "the address of a database must not have a password; write it into the file that `ISOCORTEX_DATABASE_PASSWORD_FILE` (`storage.database_password_file`) names, or into `~/.pgpass`"
    )]
    Password,
    /// A secret in a variable, which others of the same user can read.
    #[error("the variable `{name}` has a secret; remove it, and {instead}")]
    SecretInVariable {
        /// The variable.
        name: &'static str,
        /// What to do instead.
        instead: &'static str,
    },
    /// An unreadable address of PostgreSQL.
    #[error(
        "the address of the PostgreSQL database cannot be read; percent-encode special characters in it"
    )]
    Postgres,
}

/// A database. Neither its `Debug` nor its `Display` shows a password.
#[derive(Clone)]
pub enum DatabaseAddress {
    /// A file of SQLite.
    Sqlite(PathBuf),
    /// A database of PostgreSQL.
    Postgres(Box<PgConnectOptions>),
}

impl DatabaseAddress {
    /// Parses `postgres://…` or `sqlite:///file`. The `PG…` variables and `~/.pgpass` complete `postgres://…`.
    ///
    /// Any host but this machine must present a certificate for its name, unless `sslmode` sets another mode.
    ///
    /// # Errors
    /// If it is neither, or if a password is in it or in a variable.
    pub fn parse(text: &str) -> Result<Self, BadAddress> {
        if let Some(file) = text.strip_prefix("sqlite://") {
            return match file.starts_with('/') {
                true => Ok(Self::Sqlite(file.into())),
                false => Err(BadAddress::Database),
            };
        }
        if !text.starts_with("postgres://") && !text.starts_with("postgresql://") {
            return Err(BadAddress::Database);
        }
        let parameters = text
            .split_once('?')
            .map_or("", |(_, parameters)| parameters);
        let names = parameters.split('&').filter(|one| !one.is_empty());
        let names: Vec<_> = names
            .map(|one| one.split_once('=').map_or(one, |(name, _)| name))
            .collect();
        if has_password(text, &names) {
            return Err(BadAddress::Password);
        }
        refuse_secrets(&POSTGRES_SECRETS, is_set)?;
        if let Some(unknown) = names
            .iter()
            .find(|name| !POSTGRES_PARAMETERS.contains(name))
        {
            return Err(BadAddress::Parameter((*unknown).to_owned()));
        }
        let options: PgConnectOptions = text.parse().map_err(|_| BadAddress::Postgres)?;
        let is_plain = names.contains(&"sslmode")
            || std::env::var_os("PGSSLMODE").is_some()
            || is_this_machine(&options);
        Ok(Self::Postgres(Box::new(match is_plain {
            true => options,
            false => options.ssl_mode(PgSslMode::VerifyFull),
        })))
    }

    /// Sets the password, if it is PostgreSQL.
    #[must_use]
    pub fn with_password(self, password: &str) -> Self {
        match self {
            Self::Postgres(options) => Self::Postgres(Box::new(options.password(password))),
            sqlite @ Self::Sqlite(_) => sqlite,
        }
    }
}

/// Refuses variables with secrets: whoever has the user of a process reads its environment in `/proc`.
fn refuse_secrets(
    secrets: &[(&'static str, &'static str)],
    is_set: impl Fn(&str) -> bool,
) -> Result<(), BadAddress> {
    match secrets.iter().find(|(name, _)| is_set(name)) {
        Some(&(name, instead)) => Err(BadAddress::SecretInVariable { name, instead }),
        None => Ok(()),
    }
}

/// Whether a variable has a value.
fn is_set(name: &str) -> bool {
    std::env::var_os(name).is_some_and(|value| !value.is_empty())
}

/// Whether an address of PostgreSQL contains a password.
fn has_password(address: &str, parameters: &[&str]) -> bool {
    let authority = address.split_once("//").map_or("", |(_, rest)| rest);
    let authority = authority.split(['/', '?']).next().unwrap_or_default();
    let user = authority.rsplit_once('@').map_or("", |(user, _)| user);
    user.contains(':') || parameters.contains(&"password")
}

fn is_this_machine(options: &PgConnectOptions) -> bool {
    let host = options.get_host();
    let is_loopback = |address: std::net::IpAddr| address.is_loopback();
    options.get_socket().is_some()
        || host == "localhost"
        || host.starts_with('/')
        || host.parse().is_ok_and(is_loopback)
}

impl fmt::Display for DatabaseAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sqlite(file) => write!(formatter, "sqlite://{}", file.display()),
            Self::Postgres(options) => {
                let (host, port) = (options.get_host(), options.get_port());
                let database = options.get_database().unwrap_or_default();
                write!(formatter, "postgres://{host}:{port}/{database}")
            }
        }
    }
}

impl fmt::Debug for DatabaseAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, formatter)
    }
}

/// A place for objects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ObjectsAddress {
    /// A folder, which several machines may share. Created if missing.
    Folder(PathBuf),
    /// A bucket of an S3-compatible store, configured by the `AWS_…` variables.
    Bucket {
        /// Its name.
        bucket: String,
        /// The prefix of all names in it; may be empty.
        prefix: String,
    },
}

impl ObjectsAddress {
    /// Parses `s3://bucket/prefix` or `file:///folder`.
    ///
    /// # Errors
    /// If it is neither, or if a secret of a bucket is in a variable.
    pub fn parse(text: &str) -> Result<Self, BadAddress> {
        if let Some(folder) = text
            .strip_prefix("file://")
            .filter(|at| at.starts_with('/'))
        {
            return Ok(Self::Folder(folder.into()));
        }
        let place = text.strip_prefix("s3://").ok_or(BadAddress::Objects)?;
        let (bucket, prefix) = place.split_once('/').unwrap_or((place, ""));
        if bucket.is_empty() || bucket.contains(['@', ':', '?']) || prefix.contains('?') {
            return Err(BadAddress::Objects);
        }
        refuse_secrets(&BUCKET_SECRETS, is_set)?;
        Ok(Self::Bucket {
            bucket: bucket.to_owned(),
            prefix: prefix.trim_matches('/').to_owned(),
        })
    }
}

impl fmt::Display for ObjectsAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => write!(formatter, "file://{}", folder.display()),
            Self::Bucket { bucket, prefix } => write!(formatter, "s3://{bucket}/{prefix}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_in_an_address_is_seen() {
        let plain = "postgres://isocortex@db.example/isocortex";
        assert!(!has_password(plain, &[]));
        assert!(!has_password("postgres://[::1]:5432/isocortex", &[]));
        assert!(!has_password(
            "postgres:///isocortex?host=/a@b:c",
            &["host"]
        ));
        assert!(has_password(plain, &["sslmode", "password"]));
        assert!(has_password("postgres://a:b@db.example/isocortex", &[]));
        for address in [
            "postgres://a:b@db/isocortex",
            "postgres://db/isocortex?password=b",
        ] {
            let refused = DatabaseAddress::parse(address).unwrap_err();
            assert_eq!(refused, BadAddress::Password, "{address}");
        }
    }

    #[test]
    fn a_secret_in_a_variable_is_refused_by_its_name_with_the_file_to_use_instead() {
        for (secrets, set, instead) in [
            (
                &POSTGRES_SECRETS[..],
                "PGPASSWORD",
                "`ISOCORTEX_DATABASE_PASSWORD_FILE`",
            ),
            (
                &BUCKET_SECRETS,
                "AWS_ACCESS_KEY_ID",
                "`AWS_SHARED_CREDENTIALS_FILE`",
            ),
            (
                &BUCKET_SECRETS,
                "AWS_SECRET_ACCESS_KEY",
                "`AWS_SHARED_CREDENTIALS_FILE`",
            ),
            (
                &BUCKET_SECRETS,
                "AWS_SESSION_TOKEN",
                "`AWS_SHARED_CREDENTIALS_FILE`",
            ),
        ] {
            let refused = refuse_secrets(secrets, |name| name == set).unwrap_err();
            let said = refused.to_string();
            assert!(said.contains(set) && said.contains(instead), "{said}");
        }
        let files = [
            "AWS_SHARED_CREDENTIALS_FILE",
            "AWS_WEB_IDENTITY_TOKEN_FILE",
            "PGHOST",
        ];
        for secrets in [&POSTGRES_SECRETS[..], &BUCKET_SECRETS] {
            assert_eq!(
                refuse_secrets(secrets, |name| files.contains(&name)),
                Ok(())
            );
        }
    }

    fn ssl_mode(text: &str) -> String {
        match DatabaseAddress::parse(text) {
            Ok(DatabaseAddress::Postgres(options)) => format!("{:?}", options.get_ssl_mode()),
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn a_database_elsewhere_must_show_its_certificate() {
        for (address, mode) in [
            ("postgres://db.hospital/isocortex", "VerifyFull"),
            ("postgres://10.0.0.5/isocortex", "VerifyFull"),
            (
                "postgres://db.hospital/isocortex?sslmode=disable",
                "Disable",
            ),
            ("postgres://localhost/isocortex", "Prefer"),
            ("postgresql://u@127.0.0.1:5433/isocortex", "Prefer"),
            ("postgres://u@%2Frun%2Fpostgresql/isocortex", "Prefer"),
        ] {
            assert_eq!(ssl_mode(address), mode, "{address}");
        }
    }

    #[test]
    fn no_password_is_shown() {
        let database = DatabaseAddress::parse("postgres://user@db:5433/cases").unwrap();
        assert_eq!(
            format!("{database} {database:?}")
                .matches("db:5433/cases")
                .count(),
            2
        );
        let shown = [
            format!("{database} {:?}", database.clone().with_password("CANARY")),
            DatabaseAddress::parse("postgres://u:CANARY@[bad/x")
                .unwrap_err()
                .to_string(),
            DatabaseAddress::parse("postgres://x/y?password=CANARY")
                .unwrap_err()
                .to_string(),
            DatabaseAddress::parse("mysql://u:CANARY@x/y")
                .unwrap_err()
                .to_string(),
            DatabaseAddress::parse("postgres://x/y?pass=CANARY")
                .unwrap_err()
                .to_string(),
            ObjectsAddress::parse("s3://key:CANARY@bucket")
                .unwrap_err()
                .to_string(),
        ];
        assert!(!shown.concat().contains("CANARY"), "{shown:?}");
    }

    #[test]
    fn what_is_wrong_with_an_address_is_said() {
        for (text, expected) in [
            ("", BadAddress::Database),
            ("rows.sqlite", BadAddress::Database),
            ("sqlite://rows.sqlite", BadAddress::Database),
            ("mysql://db/cases", BadAddress::Database),
            ("postgres://[bad/cases", BadAddress::Postgres),
            ("postgres://db:port/cases", BadAddress::Postgres),
            ("postgres://db/cases?sslmode=perhaps", BadAddress::Postgres),
            ("postgres://db/cases?options=-c", parameter("options")),
            ("postgres://db/cases?port=1&pasword=x", parameter("pasword")),
            ("postgres://db/cases?flag", parameter("flag")),
        ] {
            let found = DatabaseAddress::parse(text).unwrap_err();
            assert_eq!(found, expected, "{text}");
        }
        for text in [
            "s3://a@b/c",
            "s3://a:b",
            "s3://a?b",
            "s3://a/b?c",
            "s3:///a",
        ] {
            let found = ObjectsAddress::parse(text);
            assert_eq!(found, Err(BadAddress::Objects), "{text}");
        }
    }

    fn parameter(name: &str) -> BadAddress {
        BadAddress::Parameter(name.to_owned())
    }

    #[test]
    fn a_folder_alone_has_the_rows_and_the_objects() {
        let location = Location::from(Path::new("/srv/isocortex"));
        assert_eq!(location.folder, Path::new("/srv/isocortex"));
        assert!(location.database.is_none() && location.objects.is_none());
        let sqlite = DatabaseAddress::parse("sqlite:///rows").unwrap();
        assert_eq!(sqlite.with_password("x").to_string(), "sqlite:///rows");
    }

    #[test]
    fn addresses_are_files_or_services() {
        let sqlite = DatabaseAddress::parse("sqlite:///srv/rows.sqlite").unwrap();
        assert_eq!(sqlite.to_string(), "sqlite:///srv/rows.sqlite");
        assert!(DatabaseAddress::parse("sqlite://rows.sqlite").is_err());
        for (text, expected) in [
            ("s3://bucket", "s3://bucket/"),
            ("s3://bucket/a/b/", "s3://bucket/a/b"),
            ("file:///srv/objects", "file:///srv/objects"),
        ] {
            assert_eq!(ObjectsAddress::parse(text).unwrap().to_string(), expected);
        }
        for text in ["file://folder", "s3://", "http://x/y", "bucket"] {
            assert_eq!(
                ObjectsAddress::parse(text),
                Err(BadAddress::Objects),
                "{text}"
            );
        }
    }
}
