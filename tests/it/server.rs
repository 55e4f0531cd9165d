//! A server to ask: with no socket, or through a real one.

use std::path::{Path, PathBuf};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, StatusCode, header};
use bytes::Bytes;
use cases::jobs::start_workers;
use cases::runner::Runner;
use http::listen;
use http::tls::ReloadedTls;
use http_body_util::BodyExt as _;
use isocortex::config::Config;
use isocortex::start;
use pacs::Pacs;
use pipeline::atlas::AtlasChoice;
use serde_json::Value;
use service::state::AppState;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tower::ServiceExt as _;

use crate::head::plain_head;
use crate::until::until;

/// A server on a store of its own.
pub(crate) struct Server {
    pub(crate) state: AppState,
    pub(crate) pacs: Pacs,
    router: Router,
    config: Config,
    directory: TempDir,
    _workers: Runner,
}

/// An answer, read to its end.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error} in {}", String::from_utf8_lossy(&self.body)))
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers
            .get(name)
            .map_or("", |value| value.to_str().unwrap())
    }

    /// Checks that this is a well-made problem and gives the last part of its type.
    pub(crate) fn problem(&self) -> String {
        assert_eq!(
            self.header("content-type"),
            "application/problem+json",
            "{self:?}"
        );
        let problem = self.json();
        assert_eq!(problem["status"], self.status.as_u16());
        assert!(!problem["title"].as_str().unwrap().is_empty());
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.len() > 10, "{detail}");
        let scratch = self::scratch();
        assert!(!detail.contains(&scratch), "a path is shown: {detail}");
        let kind = problem["type"].as_str().unwrap();
        kind.strip_prefix("urn:isocortex:problem:")
            .unwrap()
            .to_owned()
    }

    /// Positions as `f32` triples.
    pub(crate) fn positions(&self) -> Vec<[f32; 3]> {
        let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        let triple = |bytes: &[u8]| [0, 4, 8].map(|at| float(&bytes[at..at + 4]));
        assert_eq!(self.status, StatusCode::OK, "{self:?}");
        self.body.chunks_exact(12).map(triple).collect()
    }

    /// A grey picture: width and pixels.
    pub(crate) fn grey(&self) -> image::GrayImage {
        assert_eq!(self.status, StatusCode::OK, "{self:?}");
        image::load_from_memory(&self.body).unwrap().into_luma8()
    }
}

/// One part of a form: its name and its bytes.
pub(crate) type Part<'a> = (&'a str, &'a [u8]);

/// Where the stores of these tests are.
fn scratch() -> String {
    std::env::temp_dir().to_string_lossy().into_owned()
}

const BOUNDARY: &str = "isocortex-test-boundary";

/// Bytes of the line that ends a [`form`].
pub(crate) const CLOSING_BYTES: usize = "\r\n--".len() + BOUNDARY.len() + "--\r\n".len();

/// A multipart form.
pub(crate) fn form(parts: &[Part<'_>]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, bytes) in parts {
        let head = format!(
            "--{BOUNDARY}\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"f\"\r\n\r\n"
        );
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(bytes);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    body
}

/// The content type of [`form`].
pub(crate) fn form_type() -> String {
    format!("multipart/form-data; boundary={BOUNDARY}")
}

impl Server {
    /// A server with defaults, on an empty store.
    pub(crate) async fn start() -> Self {
        Self::start_with(|_| {}).await
    }

    /// A server with another configuration.
    pub(crate) async fn start_with(configure: impl FnOnce(&mut Config)) -> Self {
        Self::start_on(tempfile::tempdir().unwrap(), configure).await
    }

    /// The same, on the store in a directory.
    pub(crate) async fn start_on(directory: TempDir, configure: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config::default();
        config.storage.data = directory.path().to_owned();
        config.storage.create = true;
        // The same on every machine; heads of the tests that need names have an atlas of their own.
        config.prepare.atlas = AtlasChoice::Off;
        configure(&mut config);
        Self::on(directory, config).await
    }

    async fn on(directory: TempDir, config: Config) -> Self {
        let state = start::open(&config, &config.audit().unwrap())
            .await
            .unwrap();
        let pacs = start::pacs(&config, &state).unwrap();
        Self {
            router: start::router(&state, &pacs),
            pacs,
            _workers: start_workers(state.cases.library.clone(), config.prepare.workers),
            state,
            config,
            directory,
        }
    }

    /// Ends this server and starts another one on the same store.
    pub(crate) async fn restart(self) -> Self {
        self.restart_with(|_| {}).await
    }

    /// The same, with another configuration.
    pub(crate) async fn restart_with(self, configure: impl FnOnce(&mut Config)) -> Self {
        let Self {
            state,
            pacs,
            router,
            mut config,
            directory,
            _workers: workers,
            ..
        } = self;
        workers.shut_down(Duration::from_secs(10)).await;
        // As at the end of a process: the last connection of SQLite removes the log of writes by its name.
        state.cases.store().close().await;
        drop((state, pacs, router));
        configure(&mut config);
        Self::on(directory, config).await
    }

    /// Everything that it serves, for an answer that is not read to its end.
    pub(crate) fn router(&self) -> Router {
        self.router.clone()
    }

    pub(crate) async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        Answer {
            status: parts.status,
            headers: parts.headers,
            body: body.collect().await.unwrap().to_bytes(),
        }
    }

    pub(crate) async fn get(&self, address: &str) -> Answer {
        self.get_with(address, &[]).await
    }

    pub(crate) async fn get_with(&self, address: &str, headers: &[(&str, &str)]) -> Answer {
        let mut request = Request::get(address);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn method(&self, method: Method, address: &str) -> Answer {
        let request = Request::builder().method(method).uri(address);
        self.send(request.body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn upload(&self, parts: &[Part<'_>]) -> Answer {
        let request = Request::post("/v1/cases")
            .header(header::CONTENT_TYPE, form_type())
            .body(Body::from(form(parts)))
            .unwrap();
        self.send(request).await
    }

    /// Uploads and waits until the case is ready; its address.
    pub(crate) async fn prepared(&self, parts: &[Part<'_>]) -> String {
        let answer = self.upload(parts).await;
        assert!(answer.status.is_success(), "{answer:?}");
        let address = answer.header("location").to_owned();
        self.until_ready(&address).await;
        address
    }

    /// The address of the plain head, ready.
    pub(crate) async fn plain_case(&self) -> String {
        self.prepared(&[("volume", &plain_head().bytes())]).await
    }

    pub(crate) async fn until_ready(&self, address: &str) -> Value {
        let case = self.until_settled(address).await;
        assert_eq!(case["state"], "ready", "{case}");
        case
    }

    /// What a case says once it is ready, or has failed.
    pub(crate) async fn until_settled(&self, address: &str) -> Value {
        until(&format!("{address} is ready or fails"), async || {
            let case = self.get(address).await.json();
            let is_settled = ["ready", "failed"].contains(&case["state"].as_str().unwrap());
            is_settled.then_some(case)
        })
        .await
    }

    /// The directory of the store.
    pub(crate) fn directory(&self) -> &Path {
        self.directory.path()
    }

    /// What is in the store beside its database and its id: uploads under way and objects.
    pub(crate) fn stored_files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for folder in ["objects", "uploads"] {
            files_below(&self.directory.path().join(folder), &mut files);
        }
        files.retain(|file| !file.ends_with("store-id"));
        files
    }

    /// The contents of every file of the store, the database included.
    pub(crate) fn everything(&self) -> Vec<Vec<u8>> {
        let mut files = Vec::new();
        files_below(self.directory.path(), &mut files);
        // One may have been temporary.
        let contents = files
            .into_iter()
            .filter_map(|file| std::fs::read(file).ok());
        contents.collect()
    }

    /// Checks that nothing at all stays in the store, and that the server still serves. What was deleted may be removed by the
    /// sweep of a job that ended at the same time, which needs a moment more.
    pub(crate) async fn is_empty_and_well(&self) {
        let is_empty = async || self.stored_files().is_empty().then_some(());
        until("nothing is stored", is_empty).await;
        assert_eq!(
            self.get("/v1/cases").await.json()["cases"],
            serde_json::json!([])
        );
        assert_eq!(self.get("/healthz").await.status, StatusCode::OK);
    }

    /// Serves the same on a socket, until the guard is dropped.
    pub(crate) async fn on_a_socket(&self) -> Socket {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let limits = self.config.connection_limits();
        let serving = tokio::spawn(listen::serve(
            listener,
            self.router.clone(),
            limits,
            self.config.tls().unwrap().map(ReloadedTls::new),
            async {
                // Dropping the guard stops the server too.
                let _ = stopped.await;
            },
        ));
        Socket {
            address,
            stop,
            serving,
        }
    }
}

/// A server on a socket.
pub(crate) struct Socket {
    pub(crate) address: std::net::SocketAddr,
    pub(crate) stop: tokio::sync::oneshot::Sender<()>,
    pub(crate) serving: tokio::task::JoinHandle<()>,
}

fn files_below(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            files_below(&path, files);
        } else {
            files.push(path);
        }
    }
}
