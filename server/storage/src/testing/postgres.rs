//! A PostgreSQL server of a test's own, started from the programs of this machine.

use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, geteuid, kill_process};
use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _, Executor as _};
use tempfile::TempDir;

/// Names the folder of `initdb` and `postgres`, where they are neither in Debian's folders nor in `PATH`.
const FOLDER_VARIABLE: &str = "ISOCORTEX_POSTGRES";

/// How long the server may take to start.
const PATIENCE: Duration = Duration::from_secs(60);

/// A server that listens on a socket in a temporary folder. Dropping it ends it.
#[derive(Debug)]
pub struct PostgresServer {
    folder: TempDir,
    programs: PathBuf,
    setting: &'static str,
    server: Child,
    databases: AtomicUsize,
}

impl PostgresServer {
    /// Starts a server; `None`, said aloud, where this machine has no PostgreSQL. That is a failure on CI.
    pub async fn start() -> Option<Self> {
        // What tests ask is not whether PostgreSQL survives a loss of power.
        Self::start_with("fsync=off").await
    }

    /// The same, which waits for the disk at each commit: for measurements.
    pub async fn start_durable() -> Option<Self> {
        Self::start_with("fsync=on").await
    }

    async fn start_with(setting: &'static str) -> Option<Self> {
        let Some(programs) = programs() else {
            let missing =
                "there is no PostgreSQL (Debian: postgresql), or it is not in ISOCORTEX_POSTGRES";
            assert!(std::env::var("CI").is_err(), "{missing}");
            eprintln!("SKIPPED: {missing}");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        if let Some((user, group)) = other_user() {
            std::os::unix::fs::chown(folder.path(), Some(user), Some(group)).unwrap();
        }
        let made = command(&programs.join("initdb"))
            .args([
                "--no-sync",
                "--no-instructions",
                "--locale=C",
                "--encoding=UTF8",
            ])
            .args(["--auth=trust", "--username=postgres", "--pgdata"])
            .arg(folder.path().join("data"))
            .stdout(Stdio::null())
            .status();
        assert!(made.unwrap().success(), "initdb failed");
        let server = run(&programs, folder.path(), setting);
        let server = Self {
            folder,
            programs,
            setting,
            server,
            databases: AtomicUsize::default(),
        };
        server.until_ready().await;
        Some(server)
    }

    /// The address of a new, empty database.
    pub async fn database(&self) -> String {
        let name = format!("test{}", self.databases.fetch_add(1, Ordering::Relaxed));
        let statement = AssertSqlSafe(format!("CREATE DATABASE {name}"));
        self.connect()
            .await
            .unwrap()
            .execute(statement)
            .await
            .unwrap();
        let folder = self.folder.path().display().to_string().replace('/', "%2F");
        format!("postgres://postgres@{folder}/{name}")
    }

    /// Ends the server at once, as a fault would.
    pub fn stop(&mut self) {
        if self.server.try_wait().unwrap().is_none() {
            kill_process(Pid::from_child(&self.server), Signal::QUIT).unwrap();
            self.server.wait().unwrap();
        }
    }

    /// Starts it again on the same databases.
    pub async fn start_again(&mut self) {
        self.server = run(&self.programs, self.folder.path(), self.setting);
        self.until_ready().await;
    }

    async fn connect(&self) -> Result<PgConnection, sqlx::Error> {
        let options = PgConnectOptions::new_without_pgpass()
            .socket(self.folder.path())
            .username("postgres")
            .database("postgres");
        options.connect().await
    }

    async fn until_ready(&self) {
        let begun = Instant::now();
        loop {
            match self.connect().await {
                Ok(connection) => return connection.close().await.unwrap(),
                Err(error) => assert!(begun.elapsed() < PATIENCE, "PostgreSQL: {error}"),
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
}

impl Drop for PostgresServer {
    fn drop(&mut self) {
        self.stop();
    }
}

fn run(programs: &Path, folder: &Path, setting: &str) -> Child {
    command(&programs.join("postgres"))
        .arg("-D")
        .arg(folder.join("data"))
        .arg("-k")
        .arg(folder)
        .args(["-c", "listen_addresses=", "-c", setting])
        .args([
            "-c",
            "log_destination=stderr",
            "-c",
            "logging_collector=off",
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// PostgreSQL refuses to run as root.
fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    if let Some((user, group)) = other_user() {
        command.uid(user).gid(group).current_dir("/");
    }
    command
}

/// For root, somebody else to be.
fn other_user() -> Option<(u32, u32)> {
    if !geteuid().is_root() {
        return None;
    }
    let users = std::fs::read_to_string("/etc/passwd").ok()?;
    let ids_of = |name: &str| {
        let line = users
            .lines()
            .find(|line| line.split(':').next() == Some(name))?;
        let mut ids = line.split(':').skip(2).map_while(|id| id.parse().ok());
        Some((ids.next()?, ids.next()?))
    };
    ids_of("postgres").or_else(|| ids_of("nobody"))
}

/// The folder with PostgreSQL's programs.
fn programs() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(FOLDER_VARIABLE) {
        return Some(named.into());
    }
    let debian = std::fs::read_dir("/usr/lib/postgresql")
        .into_iter()
        .flatten();
    let mut versions: Vec<_> = debian
        .flatten()
        .map(|entry| entry.path().join("bin"))
        .collect();
    versions.sort();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders = versions
        .into_iter()
        .rev()
        .chain(std::env::split_paths(&path));
    folders.find(|folder| folder.join("initdb").is_file())
}
