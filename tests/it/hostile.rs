//! A file takes the process that reads it over: what it reaches then, beside a server that has a secret and other patients.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use tempfile::TempDir;

use crate::several_machines::program;

const TOKEN: &str = "the-secret-of-this-server";

/// The user of a server that is not root, as in the image.
const SERVERS_USER: u32 = 10_001;

/// A server in a process of its own. Dropping it kills it.
struct Beside {
    process: Child,
    port: u16,
    /// What it said about the child.
    said: String,
    programs: TempDir,
    store: PathBuf,
    user: Option<u32>,
}

impl Drop for Beside {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Beside {
    /// Starts a server as this user, or as another one.
    fn start(user: Option<u32>) -> Self {
        let programs = tempfile::tempdir().unwrap();
        let everybody = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(programs.path(), everybody).unwrap();
        for name in ["isocortex", "hostile-reader"] {
            std::fs::copy(program().with_file_name(name), programs.path().join(name))
                .expect("build the programs first: cargo build --workspace --bins");
        }
        let store = programs.path().join("store");
        std::fs::create_dir(&store).unwrap();
        std::os::unix::fs::chown(&store, user, user).unwrap();
        let token = programs.path().join("token");
        std::fs::write(&token, TOKEN).unwrap();
        std::os::unix::fs::chown(&token, user, user).unwrap();
        let mut command = command(&programs.path().join("isocortex"), user);
        let mut process = command
            .args(["serve", "--listen", "127.0.0.1:0", "--gpu", "off", "--data"])
            .arg(&store)
            .env("ISOCORTEX_CREATE", "true")
            .env("ISOCORTEX_TOKEN_FILE", &token)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = BufReader::new(process.stderr.take().unwrap());
        let (mut port, mut said) = (None, None);
        for line in log.lines() {
            let line = line.unwrap();
            if let Some((_, address)) = line.split_once("127.0.0.1:") {
                let digits: String = address.chars().take_while(char::is_ascii_digit).collect();
                port = digits.parse().ok();
            }
            if let Some((_, words)) = line.split_once("the process that reads DICOM files has ") {
                said = Some(words.to_owned());
            }
            if port.is_some() && said.is_some() {
                break;
            }
        }
        Self {
            process,
            port: port.expect("it says where it listens"),
            said: said.expect("it says what the kernel gave"),
            programs,
            store,
            user,
        }
    }

    /// What `hostile-reader` says, as this server's user.
    fn attacked(&self, role: &str) -> String {
        // A server may be started with files open that are not its own.
        let mut command = command(Path::new("/bin/sh"), self.user);
        command.args(["-c", "exec 9</dev/null; exec \"$0\" \"$@\""]);
        command.arg(self.programs.path().join("hostile-reader"));
        let next = self.store.join("next");
        std::fs::write(&next, "the next patient").unwrap();
        std::os::unix::fs::chown(&next, self.user, self.user).unwrap();
        command.arg(role).args([&self.store, &next]);
        let numbers = [self.process.id(), u32::from(self.port), std::process::id()];
        command.args(numbers.map(|number| number.to_string()));
        let output = command.output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{role}: {said}");
        said
    }

    /// The status of an answer.
    fn answers(&self, token: &str) -> String {
        let mut socket = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let request = format!(
            "GET /v1/cases HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nAuthorization: Bearer {token}\r\nConnection: close\r\n\r\n",
            self.port
        );
        socket.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        socket.read_to_string(&mut answer).unwrap();
        answer.split(' ').nth(1).unwrap_or_default().to_owned()
    }
}

fn command(program: &Path, user: Option<u32>) -> Command {
    let mut command = Command::new(program);
    command.env_clear().current_dir("/");
    if let Some(user) = user {
        command.uid(user).gid(user);
    }
    command
}

fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0)
}

/// The users whom this process may be: root and the server's own, or only its own.
fn users() -> Vec<Option<u32>> {
    match is_root() {
        true => vec![None, Some(SERVERS_USER)],
        false => vec![None],
    }
}

/// What was tried, and what came of it.
fn results(words: &str) -> BTreeMap<&str, &str> {
    words
        .split_whitespace()
        .filter_map(|word| word.split_once('='))
        .collect()
}

fn kernel_has_seccomp() -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| status.contains("\nSeccomp:"))
}

#[test]
fn a_reader_or_a_preparation_that_is_taken_over_reaches_nothing_that_is_not_its_own() {
    for user in users() {
        let server = Beside::start(user);
        let said = server.attacked("read");
        let mut lines = said.lines();
        let has_landlock = lines.next() == Some("landlock=true");
        let attacks: Vec<_> = lines.collect();
        assert_eq!(
            attacks.len(),
            3,
            "of a file, of a directory, of a case: {said}"
        );
        // A preparation has threads.
        for (attack, own) in attacks.into_iter().zip([&[][..], &[], &["thread"]]) {
            let results = results(attack);
            let given = |what| results.get(what) == Some(&"true");
            println!(
                "user {user:?}: the kernel has Landlock: {has_landlock}; it gave no new privileges {}, own user {}, own files {}, few calls {}",
                given("no-new-privileges"),
                given("own-user"),
                given("own-files"),
                given("few-calls"),
            );
            assert!(given("no-new-privileges"), "{attack}");
            assert_eq!(given("few-calls"), kernel_has_seccomp(), "{attack}");
            assert_eq!(given("own-files"), has_landlock, "{attack}");
            assert_eq!(given("own-user"), is_root() && user.is_none(), "{attack}");
            let reached = results.iter().filter(|(_, result)| **result == "reached");
            let reached: Vec<_> = reached.map(|(what, _)| *what).collect();
            if has_landlock && kernel_has_seccomp() {
                assert_eq!(results.len(), 4 + 32, "{attack}");
                assert_eq!(reached, own, "{attack}");
            } else {
                println!(
                    "SKIPPED: this kernel has no Landlock or no seccomp; it reached {reached:?}"
                );
            }
        }
    }
}

/// Otherwise the test above could not fail.
#[test]
fn the_same_code_reaches_almost_everything_where_it_is_not_confined() {
    for user in users() {
        let server = Beside::start(user);
        let said = server.attacked("control");
        let results = results(&said);
        let reached = |what: &str| results.get(what) == Some(&"reached");
        let always = [
            "environment-of-parent",
            "signal-to-server",
            "store-list",
            "store-rows",
            "store-write",
            "next-read",
            "next-write",
            "beside-list",
            "passwords",
            "temporary",
            "network-tcp",
            "network-udp",
            "network-unix",
            "inherited-file",
            "process",
            "thread",
        ];
        for what in always {
            // The parent is this test, whose user is another one.
            let is_foreign = what == "environment-of-parent" && user.is_some();
            assert_eq!(reached(what), !is_foreign, "user {user:?}: {what}: {said}");
        }
        // Root may look into every process; the server's user may not, because the server hides itself.
        for what in [
            "environment-of-server",
            "memory-of-server",
            "open-files-of-server",
            "vm-of-server",
            "trace-of-server",
        ] {
            let is_mighty = is_root() && user.is_none();
            assert_eq!(reached(what), is_mighty, "user {user:?}: {what}: {said}");
        }
    }
}

#[test]
fn a_secret_in_the_environment_that_would_be_used_is_refused_and_the_file_to_use_named() {
    let store = tempfile::tempdir().unwrap();
    let check = |settings: &[(&str, &str)]| {
        let mut command = command(&program(), None);
        command.arg("check-config").arg("--data").arg(store.path());
        command.envs(settings.iter().copied());
        let output = command.output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    let database = ("ISOCORTEX_DATABASE", "postgres://isocortex@db.example/x");
    let bucket = ("ISOCORTEX_OBJECTS", "s3://heads");
    for (place, secret, instead) in [
        (None, "ISOCORTEX_TOKEN", "ISOCORTEX_TOKEN_FILE"),
        (
            Some(database),
            "PGPASSWORD",
            "ISOCORTEX_DATABASE_PASSWORD_FILE",
        ),
        (
            Some(bucket),
            "AWS_ACCESS_KEY_ID",
            "AWS_SHARED_CREDENTIALS_FILE",
        ),
        (
            Some(bucket),
            "AWS_SECRET_ACCESS_KEY",
            "AWS_SHARED_CREDENTIALS_FILE",
        ),
        (
            Some(bucket),
            "AWS_SESSION_TOKEN",
            "AWS_SHARED_CREDENTIALS_FILE",
        ),
    ] {
        let settings = Vec::from_iter(place.into_iter().chain([(secret, TOKEN)]));
        let (status, said) = check(&settings);
        assert_eq!(status, Some(78), "{secret}: {said}");
        let is_named = said.contains(&format!("`{secret}`")) && said.contains(instead);
        assert!(is_named && !said.contains(TOKEN), "{said}");
        if place.is_some() {
            // The same variable of another program is nobody's business.
            let (status, said) = check(&[(secret, TOKEN)]);
            assert_eq!(status, Some(0), "{secret}: {said}");
        }
    }
    let in_address = format!("postgres://isocortex:{TOKEN}@db.example/x");
    let (status, said) = check(&[("ISOCORTEX_DATABASE", &in_address)]);
    assert_eq!(status, Some(78), "{said}");
    let is_named = said.contains("ISOCORTEX_DATABASE_PASSWORD_FILE");
    assert!(is_named && !said.contains(TOKEN), "{said}");
}

#[test]
fn a_server_shows_its_memory_and_its_environment_to_root_alone() {
    for user in users() {
        let server = Beside::start(user);
        assert_eq!(server.answers(TOKEN), "200");
        assert_eq!(server.answers("another-token-than-it"), "401");
        // The kernel gives these to root alone once a process may not be traced.
        for secret in ["environ", "mem", "fd"] {
            let secret = Path::new("/proc")
                .join(server.process.id().to_string())
                .join(secret);
            let owner = std::fs::metadata(&secret).unwrap().uid();
            assert_eq!(owner, 0, "{}", secret.display());
        }
        let expected = match is_root() && user.is_none() {
            true => {
                "no new privileges, its own files only (Landlock), few system calls (seccomp), a user of its own"
            }
            false => {
                "no new privileges, its own files only (Landlock), few system calls (seccomp); without a user of its own"
            }
        };
        println!("{}", server.said);
        if server.said.contains("own files only") {
            assert!(server.said.starts_with(expected), "{}", server.said);
        }
    }
}
