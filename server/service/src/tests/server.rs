//! A server to ask with no socket.

use std::sync::OnceLock;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, header};
use bytes::Bytes;
use cases::dicom::Program;
use cases::jobs::start_workers;
use cases::settings::{Limits, MapsUse, Prepare, Render};
use cases::{Cases, Options};
use http_body_util::BodyExt as _;
use pipeline::atlas::AtlasChoice;
use pipeline::testing::{phantom, upload};
use serde_json::Value;
use tempfile::TempDir;
use tower::ServiceExt as _;

use crate::app::app;
use crate::state::{AppState, HttpOptions};
use access::auth::Access;
use http::uploads::UploadLimits;

/// The largest upload that is accepted here.
pub(super) const MAX_UPLOAD_BYTES: u64 = 4 << 20;

/// What separates the parts of a form.
const BOUNDARY: &str = "isocortex-test-boundary";

/// The content type of [`form`].
pub(super) const FORM: &str = "multipart/form-data; boundary=isocortex-test-boundary";

/// One part of a form: its name and its bytes.
pub(super) type Part<'a> = (&'a str, &'a [u8]);

/// A server on a store of its own.
pub(super) struct Server {
    pub(super) cases: Cases,
    router: Router,
    /// Dropped last: everything is in it.
    directory: TempDir,
}

/// An answer, read to its end.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) status: u16,
    pub(super) headers: HeaderMap,
    pub(super) body: Bytes,
}

impl Answer {
    pub(super) fn header(&self, name: &str) -> &str {
        let value = self.headers.get(name);
        value.map_or("", |value| value.to_str().unwrap())
    }

    pub(super) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error} in {self:?}"))
    }

    /// The status and the last part of the type of a problem that is well made.
    pub(super) fn refusal(&self) -> (u16, String) {
        let problem = self.json();
        assert_eq!(self.header("content-type"), "application/problem+json");
        assert_eq!(self.header("cache-control"), "no-store");
        assert_eq!(problem["status"], self.status);
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.len() > 10 && !detail.contains("/tmp"), "{detail}");
        let kind = problem["type"].as_str().unwrap();
        let kind = kind.strip_prefix("urn:isocortex:problem:").unwrap();
        (self.status, kind.to_owned())
    }

    /// The parameter that a problem names.
    pub(super) fn parameter(&self) -> String {
        let problem = self.json();
        problem["parameter"].as_str().unwrap_or_default().to_owned()
    }
}

pub(super) fn form(parts: &[Part<'_>]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, bytes) in parts {
        let head =
            format!("--{BOUNDARY}\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n");
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(bytes);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    body
}

/// The volume and the mask of a coarse head, packed NIfTI.
pub(super) fn head() -> &'static (Bytes, Bytes) {
    static HEAD: OnceLock<(Bytes, Bytes)> = OnceLock::new();
    HEAD.get_or_init(|| {
        let source = upload(&phantom());
        (source.volume, source.mask.unwrap())
    })
}

fn router(cases: &Cases, access: Access) -> Router {
    let http = HttpOptions {
        access,
        uploads: UploadLimits {
            max_bytes: MAX_UPLOAD_BYTES,
            at_a_time: 1,
            idle: Duration::from_secs(1),
            whole: Duration::from_secs(60),
        },
        answer_timeout: Duration::from_secs(60),
        frame_ancestors: Default::default(),
        guard_all: false,
        audit: Default::default(),
    };
    app(AppState::new(cases.clone(), http))
}

impl Server {
    /// A server on an empty store, without workers: what is uploaded waits.
    pub(super) async fn start() -> Self {
        Self::start_with(Access::of_this_machine()).await
    }

    /// The same, for those who may ask.
    pub(super) async fn start_with(access: Access) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let options = Options {
            location: directory.path().into(),
            store: storage::Options {
                queue_limit: 2,
                ..storage::Options::default()
            },
            limits: Limits {
                max_queued_renders: 16,
                maps: MapsUse::Off,
                ..Limits::default()
            },
            prepare: Prepare {
                atlas: AtlasChoice::Off,
                ..Prepare::default()
            },
            render: Render {
                threads: 2,
                cache_bytes: 512 << 20,
                ..Render::on_cpu()
            },
            children: worker::ChildBudget::default(),
            prepares_apart: false,
            dicom_program: Program::other("/bin/false".into(), Vec::new()),
            deidentify: false,
            before_removal: Default::default(),
        };
        let cases = Cases::open(options).await.unwrap();
        Self {
            router: router(&cases, access),
            cases,
            directory,
        }
    }

    /// The same server for others who may ask.
    pub(super) fn opened_to(self, access: Access) -> Self {
        let router = router(&self.cases, access);
        Self { router, ..self }
    }

    /// A server, and the address of the coarse head, which is ready.
    pub(super) async fn with_case() -> (Self, String) {
        let (volume, mask) = head();
        Self::with_head(volume, mask).await
    }

    /// A server, and the address of a head, which is ready.
    pub(super) async fn with_head(volume: &[u8], mask: &[u8]) -> (Self, String) {
        let server = Self::start().await;
        let answer = server.upload(&[("volume", volume), ("mask", mask)]).await;
        assert_eq!(answer.status, 202, "{answer:?}");
        let case = answer.header("location").to_owned();
        let workers = start_workers(server.cases.library.clone(), 1);
        assert_eq!(server.settled(&case).await, "ready");
        workers.shut_down(Duration::from_secs(60)).await;
        (server, case)
    }

    /// The state of a case once it is ready or has failed.
    pub(super) async fn settled(&self, case: &str) -> String {
        let wait = async {
            loop {
                let state = self.get(case).await.json()["state"].clone();
                match state.as_str().unwrap() {
                    state @ ("ready" | "failed") => return state.to_owned(),
                    _ => tokio::time::sleep(Duration::from_millis(20)).await,
                }
            }
        };
        tokio::time::timeout(Duration::from_secs(60), wait)
            .await
            .expect("a case settles")
    }

    pub(super) async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        Answer {
            status: parts.status.as_u16(),
            headers: parts.headers,
            body: body.collect().await.unwrap().to_bytes(),
        }
    }

    pub(super) async fn ask(
        &self,
        method: Method,
        address: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        let mut request = Request::builder().method(method).uri(address);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(body.into()).unwrap()).await
    }

    pub(super) async fn get(&self, address: &str) -> Answer {
        self.get_with(address, &[]).await
    }

    pub(super) async fn get_with(&self, address: &str, headers: &[(&str, &str)]) -> Answer {
        self.ask(Method::GET, address, headers, Body::empty()).await
    }

    pub(super) async fn post_form(&self, body: impl Into<Body>) -> Answer {
        let content_type = [(header::CONTENT_TYPE.as_str(), FORM)];
        self.ask(Method::POST, "/v1/cases", &content_type, body)
            .await
    }

    pub(super) async fn upload(&self, parts: &[Part<'_>]) -> Answer {
        self.post_form(form(parts)).await
    }

    /// The files of the store beside its database.
    pub(super) fn stored_files(&self) -> Vec<String> {
        let below = |folder| storage::testing::objects_below(&self.directory.path().join(folder));
        let files = ["objects", "uploads"].into_iter().flat_map(below);
        files.map(|file| file.display().to_string()).collect()
    }

    /// Checks that nothing at all is in the store, and that the server still serves.
    pub(super) async fn is_empty_and_well(&self) {
        assert_eq!(self.stored_files(), Vec::<String>::new());
        let list = self.get("/v1/cases").await.json();
        assert_eq!(list["cases"], serde_json::json!([]));
        let health = self.get("/healthz").await;
        assert_eq!(health.status, 200);
    }
}
