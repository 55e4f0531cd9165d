//! Several processes on one PostgreSQL and one object store: any copy answers, and any worker prepares.

use std::collections::HashMap;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use storage::testing::postgres::PostgresServer;
use storage::testing::s3::{BUCKET, S3Server};
use tempfile::TempDir;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use crate::head::plain_head;
use crate::server::{form, form_type};

/// The program, which is built together with these tests.
pub(crate) fn program() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let program = test
        .parent()
        .and_then(Path::parent)
        .unwrap()
        .join("isocortex");
    let build = "build the program first: cargo build --workspace --bins";
    assert!(program.is_file(), "{build}");
    program
}

/// A process of the program. Dropping it kills it.
pub(crate) struct Process {
    process: Child,
    _folder: TempDir,
}

impl Process {
    /// Starts a command of the program on a shared store, with a folder of its own.
    fn start(command: &[&str], store: &HashMap<&str, String>) -> Self {
        Self::start_program(&program(), command, store)
    }

    fn start_program(program: &Path, command: &[&str], store: &HashMap<&str, String>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let process = Command::new(program)
            .args(command)
            .env("ISOCORTEX_DATA", folder.path())
            .env("ISOCORTEX_GPU", "off")
            .env("ISOCORTEX_CREATE", "true")
            .env_remove("ISOCORTEX_CONFIG")
            .envs(store)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            process,
            _folder: folder,
        }
    }

    /// A server without workers, and its address.
    fn server(store: &HashMap<&str, String>) -> (Self, SocketAddr) {
        Self::server_with(&["--workers", "0"], store)
    }

    /// A server with these options, and its address.
    pub(crate) fn server_with(
        options: &[&str],
        store: &HashMap<&str, String>,
    ) -> (Self, SocketAddr) {
        Self::server_of(&program(), options, store)
    }

    /// A server of this program with these options, and its address.
    fn server_of(
        program: &Path,
        options: &[&str],
        store: &HashMap<&str, String>,
    ) -> (Self, SocketAddr) {
        let command = [&["serve", "--listen", "127.0.0.1:0"][..], options].concat();
        let mut server = Self::start_program(program, &command, store);
        let mut lines = BufReader::new(server.process.stdout.take().unwrap()).lines();
        let line = lines.next().expect("it says where it listens").unwrap();
        let address = line.rsplit("http://").next().unwrap().parse().unwrap();
        (server, address)
    }

    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    /// Asks it to end, and waits until it has.
    async fn end(mut self) {
        let pid = self.id().to_string();
        assert!(Command::new("kill").arg(pid).status().unwrap().success());
        let begun = Instant::now();
        loop {
            if let Some(status) = self.process.try_wait().unwrap() {
                return assert!(status.success(), "{status}");
            }
            assert!(begun.elapsed() < Duration::from_secs(30), "it does not end");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended.
        let _ended = self.process.kill();
        let _status = self.process.wait();
    }
}

/// An answer as it came.
pub(crate) struct Answer {
    pub(crate) head: String,
    body: Vec<u8>,
}

impl Answer {
    pub(crate) fn status(&self) -> &str {
        self.head.split(' ').nth(1).unwrap_or_default()
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

pub(crate) async fn send(
    server: SocketAddr,
    method: &str,
    path: &str,
    body: Option<&[u8]>,
) -> Answer {
    let mut stream = TcpStream::connect(server).await.unwrap();
    let mut head = format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n");
    if let Some(body) = body {
        head += &format!(
            "Content-Type: {}\r\nContent-Length: {}\r\n",
            form_type(),
            body.len()
        );
    }
    stream.write_all((head + "\r\n").as_bytes()).await.unwrap();
    stream.write_all(body.unwrap_or_default()).await.unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.unwrap();
    let end = answer
        .windows(4)
        .position(|four| four == b"\r\n\r\n")
        .unwrap();
    Answer {
        head: String::from_utf8_lossy(&answer[..end]).into_owned(),
        body: answer[end + 4..].to_vec(),
    }
}

pub(crate) async fn get(server: SocketAddr, path: &str) -> Answer {
    send(server, "GET", path, None).await
}

/// Asks again and again until the status is the expected one; how long that took.
async fn until(server: SocketAddr, path: &str, status: &str) -> Duration {
    let begun = Instant::now();
    loop {
        let answer = get(server, path).await;
        if answer.status() == status {
            return begun.elapsed();
        }
        assert!(
            begun.elapsed() < Duration::from_secs(30),
            "{path}: {}",
            answer.head
        );
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

async fn upload(server: SocketAddr) -> Answer {
    let body = form(&[("volume", &plain_head().bytes())]);
    send(server, "POST", "/v1/cases", Some(&body)).await
}

/// The variables that lead to a store in PostgreSQL, and in S3 or a shared folder.
async fn shared_store(
    postgres: &PostgresServer,
    s3: Option<&S3Server>,
    folder: &Path,
) -> HashMap<&'static str, String> {
    let mut variables = HashMap::from([("ISOCORTEX_DATABASE", postgres.database().await)]);
    let objects = match s3 {
        Some(s3) => {
            variables.extend(s3.variables());
            format!("s3://{BUCKET}/heads")
        }
        None => format!("file://{}", folder.display()),
    };
    variables.insert("ISOCORTEX_OBJECTS", objects);
    variables
}

#[tokio::test]
async fn two_servers_and_a_worker_are_one_service_that_outlives_its_database() {
    let Some(mut postgres) = PostgresServer::start().await else {
        return;
    };
    let (s3, folder) = (S3Server::start().await, tempfile::tempdir().unwrap());
    let store = shared_store(&postgres, s3.as_ref(), folder.path()).await;
    let (first_process, first) = Process::server(&store);
    let (second_process, second) = Process::server(&store);

    // What is uploaded here is seen there, and its events are heard there.
    let submitted = upload(first).await;
    assert_eq!(submitted.status(), "202", "{}", submitted.head);
    let case = format!("/v1/cases/{}", submitted.json()["id"].as_str().unwrap());
    assert!(until(second, &case, "200").await < Duration::from_secs(1));
    let mut stream = TcpStream::connect(second).await.unwrap();
    let request =
        format!("GET {case}/events HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    // The worker starts once somebody listens.
    let mut events = Vec::new();
    while !String::from_utf8_lossy(&events).contains("event: case") {
        assert!(stream.read_buf(&mut events).await.unwrap() > 0);
    }
    let worker = Process::start(&["work"], &store);
    let rest = tokio::time::timeout(Duration::from_secs(60), stream.read_to_end(&mut events));
    rest.await.unwrap().unwrap();
    let events = String::from_utf8(events).unwrap();
    assert!(
        events.contains("\"queued\"") && events.contains("\"ready\""),
        "{events}"
    );

    // Every copy answers with the same bytes.
    for route in [
        "mesh?depth_mm=8",
        "mesh/paths",
        "volume",
        "render?depth_mm=8",
    ] {
        let path = format!("{case}/{route}");
        let [here, there] = [get(first, &path).await, get(second, &path).await];
        assert_eq!((here.status(), there.status()), ("200", "200"), "{route}");
        assert!(here.body == there.body, "{route}");
    }

    // Without the database what was seen is still served (for how long, the tests of `cases::models` say), and an upload is
    // refused for a moment.
    let picture = format!("{case}/render?depth_mm=8");
    postgres.stop();
    assert_eq!(get(first, &picture).await.status(), "200");
    let refused = upload(first).await;
    assert_eq!(refused.status(), "503", "{}", refused.head);
    assert!(
        refused.head.to_ascii_lowercase().contains("retry-after"),
        "{}",
        refused.head
    );
    postgres.start_again().await;
    let begun = Instant::now();
    while get(first, "/readyz").await.status() != "200" {
        assert!(begun.elapsed() < Duration::from_secs(10));
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    eprintln!("recovered after {:?}", begun.elapsed());
    assert_eq!(upload(first).await.status(), "200");

    // What is deleted here is gone there, from its memory as well.
    assert_eq!(get(second, &picture).await.status(), "200");
    assert_eq!(send(first, "DELETE", &case, None).await.status(), "204");
    assert!(until(second, &picture, "404").await < Duration::from_secs(2));
    for process in [worker, first_process, second_process] {
        process.end().await;
    }
}

#[tokio::test]
async fn a_server_whose_program_was_replaced_goes_on_preparing() {
    let program = program();
    let folder = tempfile::tempdir_in(program.parent().unwrap()).unwrap();
    let running = folder.path().join("isocortex");
    std::fs::hard_link(&program, &running).unwrap();
    let (_process, server) = Process::server_of(&running, &[], &HashMap::new());
    std::fs::remove_file(&running).unwrap();
    let submitted = upload(server).await;
    assert_eq!(submitted.status(), "202", "{}", submitted.head);
    let case = format!("/v1/cases/{}", submitted.json()["id"].as_str().unwrap());
    until(server, &format!("{case}/mesh?depth_mm=8"), "200").await;
}
