//! Named tokens: what each scope opens, on every route that there is.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use access::audited::Audited;
use access::scopes::Role;
use axum::body::Body;
use axum::http::{Method, Request};
use http_body_util::BodyExt as _;
use tower::ServiceExt as _;

use crate::head::plain_head;
use crate::server::{Answer, Server, form, form_type};
use crate::several_machines::program;

/// The scope of every route that is more than looking. A new route fails these tests until it states its scope, and stands here.
const MORE_THAN_LOOKING: [(&str, &str); 24] = [
    ("POST /v1/cases", "write"),
    ("POST /v1/cases/search", "read"),
    ("PATCH /v1/cases/{id}", "write"),
    ("DELETE /v1/cases/{id}", "write"),
    ("POST /v1/cases/{id}/renders", "read"),
    ("PUT /v1/cases/{id}/mask", "write"),
    ("PUT /v1/cases/{id}/findings", "write"),
    ("POST /v1/cases/{id}/findings/from/{other}", "write"),
    ("PUT /v1/cases/{id}/readings/mine", "write"),
    ("POST /v1/cases/{id}/readings/mine/signature", "write"),
    ("POST /v1/cases/{id}/layers", "write"),
    ("PATCH /v1/cases/{id}/layers/{layer}", "write"),
    ("DELETE /v1/cases/{id}/layers/{layer}", "write"),
    ("POST /dicomweb/studies", "dicom-store"),
    ("POST /dicomweb/studies/{study}", "dicom-store"),
    ("POST /hooks/orthanc", "dicom-store"),
    ("POST /v1/arrivals/{id}", "write"),
    ("POST /v1/retrievals", "write"),
    ("POST /v1/cases/{id}/dicom-results", "results"),
    ("POST /v1/launch", "read"),
    ("PUT /v1/preferences", "read"),
    ("DELETE /v1/preferences", "read"),
    ("POST /v1/pacs/nodes/{name}/test", "admin"),
    ("DELETE /v1/rejections/{id}", "admin"),
];

const SCOPES: [&str; 7] = [
    "read",
    "write",
    "dicom-store",
    "dicom-reject",
    "results",
    "metrics",
    "admin",
];

/// A file of tokens, one for each scope, and what they are.
pub(crate) struct TokensFile {
    folder: tempfile::TempDir,
    tokens: BTreeMap<String, String>,
}

impl TokensFile {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut file = Self {
            folder,
            tokens: BTreeMap::new(),
        };
        for scope in SCOPES {
            file.add(scope, &["--scope", scope]);
        }
        file
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.path().join("tokens.toml")
    }

    /// Makes a token as an administrator does.
    pub(crate) fn add(&mut self, name: &str, options: &[&str]) {
        let made = token_new(&self.path(), name, options);
        let status = made.status;
        assert!(
            status.success(),
            "{}",
            String::from_utf8_lossy(&made.stderr)
        );
        let token = String::from_utf8(made.stdout).unwrap().trim().to_owned();
        assert!(
            token.starts_with("isocortex_") && token.len() > 64,
            "{token}"
        );
        let file = std::fs::read_to_string(self.path()).unwrap();
        assert!(!file.contains(&token), "the token itself is in the file");
        self.tokens.insert(name.to_owned(), token);
    }

    pub(crate) fn bearer(&self, name: &str) -> String {
        format!("Bearer {}", self.tokens[name])
    }
}

fn token_new(file: &Path, name: &str, options: &[&str]) -> std::process::Output {
    let mut command = Command::new(program());
    command.args(["token", "new", name, "--file"]).arg(file);
    command.args(options).output().unwrap()
}

async fn ask(server: &Server, method: &Method, path: &str, authorization: Option<&str>) -> Answer {
    let address = path
        .replace("{id}", "00000000000000000000000000000000")
        .replace("{plane}", "axial")
        .replace("{layer}", "nobody")
        .replace(['{', '}'], "");
    let mut request = Request::builder().method(method).uri(address);
    if let Some(value) = authorization {
        request = request.header("authorization", value);
    }
    server.send(request.body(Body::empty()).unwrap()).await
}

/// What a request may be asked with.
const METHODS: [Method; 7] = [
    Method::GET,
    Method::HEAD,
    Method::POST,
    Method::PUT,
    Method::PATCH,
    Method::DELETE,
    Method::OPTIONS,
];

/// The templates of all paths, from the router itself: what is in no description is found too.
fn paths_of(router: &axum::Router) -> BTreeSet<String> {
    let written = format!("{router:?}");
    let paths = written.split("RouteId(").filter_map(|part| {
        let (_, path) = part.split_once("): \"")?;
        path.split_once('"').map(|(path, _)| path.to_owned())
    });
    // The fallback has a template of its own.
    let paths = paths.filter(|path| path.starts_with('/') && !path.contains("{*"));
    paths.collect()
}

/// The rows of all routes by method and path.
pub(crate) fn rows(server: &Server) -> BTreeMap<(String, String), (&'static str, Audited)> {
    let service = service::routes::scopes(&server.state);
    let routes = pacs::guarded_routes(&server.pacs);
    let (_, of_pacs) = routes.uploads.and(routes.answers).into_parts();
    let all = service.and(of_pacs);
    let rows: BTreeMap<_, _> = (all.rows())
        .map(|(method, path, scope, audited)| {
            (
                (method.to_string(), path.to_owned()),
                (scope.name(), audited),
            )
        })
        .collect();
    assert_eq!(rows.len(), all.rows().count(), "two rows are of one route");
    rows
}

/// The name of the token of a role.
fn in_role(role: &str) -> String {
    format!("in-role-{role}")
}

/// Whether a path is open to everybody: the page, and what asks for the health of the server.
fn is_open(path: &str) -> bool {
    let guarded = [
        "/v1",
        "/dicomweb",
        "/hooks",
        "/metrics",
        "/version",
        "/docs",
        "/openapi",
    ];
    !guarded.iter().any(|start| path.starts_with(start))
}

#[tokio::test]
async fn every_method_of_every_path_opens_to_its_scope_and_to_no_other() {
    let mut file = TokensFile::new();
    file.add("past", &["--role", "admin", "--until", "2020-02-29"]);
    for role in Role::ALL.map(Role::name) {
        file.add(&in_role(role), &["--role", role]);
    }
    let wrong = format!("Bearer isocortex_{}", "0".repeat(64));
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(file.path());
        config.http.guard_all = true;
    })
    .await;
    let (rows, more) = (rows(&server), BTreeMap::from(MORE_THAN_LOOKING));
    let paths = paths_of(&server.router());
    assert!(paths.len() > 70, "{paths:?}");
    let mut met = BTreeSet::new();
    for path in paths.iter().filter(|path| !is_open(path)) {
        for method in METHODS {
            let of = match method {
                Method::HEAD => Method::GET,
                _ => method.clone(),
            };
            let row = rows.get_key_value(&(of.to_string(), path.clone()));
            let route = format!("{method} {path}");
            let strangers = [
                ("nobody", None, "unauthorized"),
                ("a guesser", Some(wrong.clone()), "unauthorized"),
                (
                    "someone who ended",
                    Some(file.bearer("past")),
                    "token-ended",
                ),
            ];
            let Some((key, (needed, _))) = row else {
                // There is nothing; a route that is in no table would answer the administrator.
                let administrator = ("the administrator", Some(file.bearer("admin")), "");
                for (who, authorization, _) in strangers.into_iter().chain([administrator]) {
                    let answer = ask(&server, &method, path, authorization.as_deref()).await;
                    assert_eq!(answer.status, 405, "{route} by {who}, in no row");
                }
                continue;
            };
            met.insert(key);
            for (who, authorization, problem) in strangers {
                let answer = ask(&server, &method, path, authorization.as_deref()).await;
                let status = answer.status.as_u16();
                assert_eq!(status, 401, "{route} by {who}");
                assert!(answer.header("www-authenticate").starts_with("Bearer"));
                if method != Method::HEAD {
                    assert_eq!(answer.problem(), problem, "{route} by {who}");
                }
            }
            let expected = match (&of, path.as_str()) {
                (&Method::GET, "/metrics") => Some("metrics"),
                (&Method::GET, _) => Some("read"),
                _ => more.get(route.as_str()).copied(),
            };
            assert_eq!(Some(*needed), expected, "{route}");
            let named = SCOPES.map(|scope| (scope, file.bearer(scope), vec![scope]));
            let in_roles = Role::ALL.map(|role| {
                let scopes = role.scopes().iter().map(|scope| scope.name());
                let bearer = file.bearer(&in_role(role.name()));
                (role.name(), bearer, scopes.collect())
            });
            for (scope, bearer, permitted) in named.into_iter().chain(in_roles) {
                let answer = ask(&server, &method, path, Some(&bearer)).await;
                let status = answer.status.as_u16();
                if permitted.contains(needed) {
                    let is_open = ![401, 403, 405].contains(&status);
                    assert!(is_open, "{route} with {scope}: {status}");
                } else {
                    assert_eq!(status, 403, "{route} with {scope}");
                    let challenge = answer.header("www-authenticate");
                    let named = format!("scope=\"{needed}\"");
                    assert!(challenge.contains(&named), "{challenge}");
                }
            }
        }
    }
    let of_none: Vec<_> = rows.keys().filter(|key| !met.contains(key)).collect();
    assert!(
        of_none.is_empty(),
        "these rows are of no route: {of_none:?}"
    );
    for path in paths.iter().filter(|path| is_open(path)) {
        let answer = ask(&server, &Method::GET, path, None).await;
        assert_eq!(answer.status, 200, "{path}");
    }
}

#[tokio::test]
async fn whatever_shows_or_changes_something_of_a_patient_is_recorded() {
    let server = Server::start_with(|config| config.http.guard_all = true).await;
    let of_none = rows(&server)
        .into_iter()
        .filter(|(_, (_, audited))| *audited == Audited::No);
    let of_none: Vec<_> = of_none
        .map(|((method, path), _)| format!("{method} {path}"))
        .collect();
    let expected = [
        "DELETE /v1/preferences",
        "GET /docs",
        "GET /docs.css",
        "GET /metrics",
        "GET /openapi.json",
        "GET /v1/pacs",
        "GET /v1/preferences",
        "GET /v1/session",
        "GET /version",
        "PUT /v1/preferences",
    ];
    assert_eq!(of_none, expected);
}

#[tokio::test]
async fn metrics_version_and_documents_need_a_token_only_if_that_is_set() {
    let file = TokensFile::new();
    let server = Server::start_with(|config| config.http.tokens_file = Some(file.path())).await;
    for path in [
        "/metrics",
        "/version",
        "/docs",
        "/docs.css",
        "/openapi.json",
    ] {
        assert_eq!(ask(&server, &Method::GET, path, None).await.status, 200);
    }
}

#[tokio::test]
async fn the_token_of_before_opens_everything_beside_named_ones() {
    let file = TokensFile::new();
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(file.path());
        config.http.token = Some(isocortex::config::Secret("0123456789abcdef".to_owned()));
    })
    .await;
    let old = Some("Bearer 0123456789abcdef");
    assert_eq!(
        ask(&server, &Method::GET, "/v1/cases", old).await.status,
        200
    );
    assert_eq!(
        ask(&server, &Method::POST, "/v1/launch", old).await.status,
        400
    );
    let named = file.bearer("read");
    assert_eq!(
        ask(&server, &Method::GET, "/v1/cases", Some(&named))
            .await
            .status,
        200
    );
}

#[tokio::test]
async fn a_withdrawn_token_opens_no_longer_and_its_streams_of_events_end() {
    let file = TokensFile::new();
    let server = Server::start_with(|config| {
        config.http.tokens_file = Some(file.path());
        // The case never becomes ready, so its events do not end by themselves.
        config.prepare.workers = 0;
    })
    .await;
    let upload = Request::post("/v1/cases")
        .header("content-type", form_type())
        .header("authorization", file.bearer("write"))
        .body(Body::from(form(&[("volume", &plain_head().bytes())])));
    let uploaded = server.send(upload.unwrap()).await;
    assert_eq!(uploaded.status, 202, "{uploaded:?}");
    let events = format!("{}/events", uploaded.header("location"));
    let read = file.bearer("read");
    let request = Request::get(events).header("authorization", &read);
    let request = request.body(Body::empty()).unwrap();
    let mut stream = server.router().oneshot(request).await.unwrap().into_body();
    assert!(stream.frame().await.is_some(), "the state at once");
    let streamed = tokio::spawn(stream.collect());
    // As the server does when the file changes.
    let reload = || {
        let mut config = isocortex::config::Config::default();
        config.http.tokens_file = Some(file.path());
        server
            .state
            .access()
            .replace_tokens(&config.access().unwrap());
    };
    reload();
    let list = async || ask(&server, &Method::GET, "/v1/cases", Some(&read)).await;
    assert_eq!(list().await.status, 200);
    assert!(!streamed.is_finished());
    let tokens = std::fs::read_to_string(file.path()).unwrap();
    let kept: Vec<_> = (tokens.split("\n\n"))
        .filter(|entry| !entry.contains("name = \"read\""))
        .collect();
    assert_eq!(kept.len(), SCOPES.len() - 1);
    std::fs::write(file.path(), kept.join("\n\n")).unwrap();
    reload();
    assert_eq!(list().await.problem(), "unauthorized");
    let ended = tokio::time::timeout(Duration::from_secs(30), streamed).await;
    ended.expect("the stream ends").unwrap().unwrap();
}

#[test]
fn a_name_is_given_once_and_a_role_or_scopes_are_needed() {
    let mut file = TokensFile::new();
    file.add(
        "a.reader@site",
        &["--role", "editor", "--until", "2099-12-31"],
    );
    let before = std::fs::read(file.path()).unwrap();
    for (name, options, part) in [
        ("read", &["--scope", "read"][..], "has a token of this name"),
        ("two words", &["--scope", "read"], "the name of a token"),
        ("new", &[], "--role"),
        ("new", &["--scope", "all"], "is no scope"),
        ("new", &["--role", "viewer", "--until", "soon"], "--until"),
    ] {
        let made = token_new(&file.path(), name, options);
        assert_eq!(made.status.code(), Some(2), "{name} {options:?}");
        let words = String::from_utf8(made.stderr).unwrap();
        assert!(words.contains(part), "{words}");
        assert!(made.stdout.is_empty());
    }
    assert_eq!(std::fs::read(file.path()).unwrap(), before);
}
