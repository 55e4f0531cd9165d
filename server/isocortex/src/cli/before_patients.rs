//! What a server needs before it gets heads of patients: the list at the end of `isocortex check-config`.

use std::fmt;

use crate::config::{Config, ConfigError};

/// How far a point of the list is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Done,
    Missing,
    /// This program cannot see it.
    Look,
}

/// A point of the list.
#[derive(Debug)]
pub(super) struct Point {
    state: State,
    name: &'static str,
    /// What is there, or what to do.
    words: String,
}

impl fmt::Display for Point {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = match self.state {
            State::Done => "done",
            State::Missing => "missing",
            State::Look => "look",
        };
        write!(formatter, "{state:<8} {:<10} {}", self.name, self.words)
    }
}

fn point(name: &'static str, state: State, words: impl Into<String>) -> Point {
    let words = words.into();
    Point { state, name, words }
}

/// The list for a configuration that a server can start with.
///
/// # Errors
/// If it cannot.
pub(super) fn points(config: &Config) -> Result<[Point; 10], ConfigError> {
    Ok([
        people(config)?,
        encrypted_network(config),
        strangers(),
        record(config),
        store(config)?,
        disk(),
        backup(config),
        retention(config),
        identity(config),
        files(config),
    ])
}

/// Whether each person and each program has a name.
fn people(config: &Config) -> Result<Point, ConfigError> {
    let tokens = config.named_tokens()?.len();
    let (state, words) = match (&config.proxy, tokens) {
        (Some(_), _) => (State::Done, "a proxy signs people in".to_owned()),
        (None, 0) => (
            State::Missing,
            "let a proxy sign people in (`[proxy]`), or `isocortex token new NAME --role editor --file FILE`".to_owned(),
        ),
        (None, tokens) => (State::Done, format!("{tokens} named tokens")),
    };
    Ok(point("people", state, words))
}

/// Whether what leaves this machine is encrypted.
fn encrypted_network(config: &Config) -> Point {
    let socket = config
        .proxy
        .as_ref()
        .and_then(|proxy| proxy.socket.as_ref());
    let (state, words) = match &config.http.tls_certificate {
        Some(_) => (State::Done, "the server has a certificate"),
        None if socket.is_some() || config.http.listen.ip().is_loopback() => (
            State::Look,
            "the proxy on this machine must have a certificate: `curl -I https://HOST/healthz`",
        ),
        None => (
            State::Missing,
            "set `http.tls_certificate` and `http.tls_key`",
        ),
    };
    point("TLS", state, words)
}

fn strangers() -> Point {
    let words = "the proxy must limit requests and connections of each address: its log has 429";
    point("strangers", State::Look, words)
}

fn record(config: &Config) -> Point {
    match &config.audit.folder {
        Some(folder) => point(
            "audit",
            State::Done,
            format!("`isocortex audit verify {}`", folder.display()),
        ),
        None => point("audit", State::Missing, "set `audit.folder`"),
    }
}

fn store(config: &Config) -> Result<Point, ConfigError> {
    let location = config.location()?;
    let folder = location.folder.display();
    Ok(
        match location.database.is_some() || location.folder.is_dir() {
            true => point(
                "store",
                State::Done,
                "`isocortex check-store` reads all of it",
            ),
            false => point(
                "store",
                State::Missing,
                format!("`isocortex init-store --data {folder}`"),
            ),
        },
    )
}

fn disk() -> Point {
    let words = "the disk of the store must be encrypted, here or by its provider: `lsblk -o NAME,TYPE,MOUNTPOINT`";
    point("disk", State::Look, words)
}

fn backup(config: &Config) -> Point {
    let words = match (&config.storage.database, &config.storage.objects) {
        (None, None) => format!(
            "each night: `isocortex migrate-store --from {} --to BACKUP`; try a restore once",
            config.storage.data.display()
        ),
        _ => "back up first the database, then the objects; try a restore once".to_owned(),
    };
    point("backup", State::Look, words)
}

fn retention(config: &Config) -> Point {
    match config.storage.keep_days {
        Some(days) => point(
            "retention",
            State::Done,
            format!("cases are removed after {days} days"),
        ),
        None => point(
            "retention",
            State::Missing,
            "cases stay until somebody deletes them: set `storage.keep_days`",
        ),
    }
}

fn identity(config: &Config) -> Point {
    match config.pacs.deidentify {
        true => point("identity", State::Done, "no identity of a patient is kept"),
        false => point(
            "identity",
            State::Look,
            "names and dates of DICOM images are kept: set `pacs.deidentify` if readers need none",
        ),
    }
}

fn files(config: &Config) -> Point {
    match config.open_files().is_empty() {
        true => point(
            "files",
            State::Done,
            "others on this machine can read no secret",
        ),
        false => point("files", State::Missing, "see the warnings above"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(config: &Config) -> [State; 10] {
        points(config).unwrap().map(|point| point.state)
    }

    #[test]
    fn a_fresh_configuration_is_told_what_to_do() {
        let mut config = Config::default();
        config.storage.data = "/nowhere/cases".into();
        let [
            people,
            tls,
            strangers,
            audit,
            store,
            disk,
            backup,
            retention,
            identity,
            files,
        ] = states(&config);
        assert_eq!([people, audit, store, retention], [State::Missing; 4]);
        assert_eq!([tls, strangers, disk, backup, identity], [State::Look; 5]);
        assert_eq!(files, State::Done);
        let lines = points(&config).unwrap().map(|point| point.to_string());
        for part in [
            "isocortex token new",
            "`audit.folder`",
            "init-store --data /nowhere/cases",
        ] {
            assert!(
                lines.iter().any(|line| line.contains(part)),
                "{part}: {lines:?}"
            );
        }
    }

    #[test]
    fn what_is_set_is_done() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::default();
        config.storage.data = folder.path().to_owned();
        config.storage.keep_days = Some(90);
        config.audit.folder = Some(folder.path().to_owned());
        config.http.tls_certificate = Some("certificate.pem".into());
        config.pacs.deidentify = true;
        let [
            people,
            tls,
            _,
            audit,
            store,
            _,
            backup,
            retention,
            identity,
            _,
        ] = states(&config);
        assert_eq!([tls, audit, store, retention, identity], [State::Done; 5]);
        assert_eq!([people, backup], [State::Missing, State::Look]);
    }
}
