//! Named tokens: what each scope opens, on every route that there is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, Request};
use http_body_util::BodyExt as _;
use tower::ServiceExt as _;

use crate::head::plain_head;
use crate::server::{Answer, Server, form, form_type};
use crate::several_machines::program;

/// The scope of every route that is more than looking. A new route fails these tests until it has a row here and in its table.
const MORE_THAN_LOOKING: [(&str, &str); 17] = [
    ("POST /v1/cases", "write"),
    ("PATCH /v1/cases/{id}", "write"),
    ("DELETE /v1/cases/{id}", "write"),
    ("POST /v1/cases/{id}/renders", "read"),
    ("PUT /v1/cases/{id}/mask", "write"),
    ("PUT /v1/cases/{id}/findings", "write"),
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
    ("POST /v1/pacs/nodes/{name}/test", "admin"),
];

const SCOPES: [&str; 5] = ["read", "write", "dicom-store", "results", "admin"];

/// A file of tokens, one for each scope, and what they are.
struct TokensFile {
    folder: tempfile::TempDir,
    tokens: BTreeMap<String, String>,
}

impl TokensFile {
    fn new() -> Self {
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

    fn path(&self) -> PathBuf {
        self.folder.path().join("tokens.toml")
    }

    /// Makes a token as an administrator does.
    fn add(&mut self, name: &str, options: &[&str]) {
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

    fn bearer(&self, name: &str) -> String {
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

#[tokio::test]
async fn every_route_opens_to_the_scope_of_its_row_and_to_no_other() {
    let mut file = TokensFile::new();
    file.add("past", &["--role", "admin", "--until", "2020-02-29"]);
    let server = Server::start_with(|config| config.http.tokens_file = Some(file.path())).await;
    let description = server.get("/openapi.json").await.json();
    let rows = BTreeMap::from(MORE_THAN_LOOKING);
    let mut met = 0;
    for (path, item) in description["paths"].as_object().unwrap() {
        if !["/v1", "/dicomweb", "/hooks"]
            .iter()
            .any(|start| path.starts_with(start))
        {
            continue;
        }
        for method in item.as_object().unwrap().keys() {
            let method: Method = method.to_uppercase().parse().unwrap();
            let route = format!("{method} {path}");
            let needed = match rows.get(route.as_str()) {
                Some(scope) => *scope,
                None => {
                    assert_eq!(method, Method::GET, "{route} has no row");
                    "read"
                }
            };
            met += usize::from(rows.contains_key(route.as_str()));
            for (who, authorization, kind) in [
                ("nobody", None, "unauthorized"),
                (
                    "someone who ended",
                    Some(file.bearer("past")),
                    "token-ended",
                ),
            ] {
                let answer = ask(&server, &method, path, authorization.as_deref()).await;
                assert_eq!(
                    (answer.status.as_u16(), answer.problem().as_str()),
                    (401, kind),
                    "{route} by {who}"
                );
                assert!(answer.header("www-authenticate").starts_with("Bearer"));
            }
            for scope in SCOPES {
                let bearer = file.bearer(scope);
                let answer = ask(&server, &method, path, Some(&bearer)).await;
                let status = answer.status.as_u16();
                if scope == needed {
                    assert!(
                        ![401, 403, 429].contains(&status),
                        "{route} with {scope}: {status}"
                    );
                } else {
                    assert_eq!(
                        (status, answer.problem().as_str()),
                        (403, "missing-scope"),
                        "{route} with {scope}"
                    );
                    let challenge = answer.header("www-authenticate");
                    assert!(
                        challenge.contains(&format!("scope=\"{needed}\"")),
                        "{challenge}"
                    );
                }
            }
        }
    }
    assert_eq!(met, rows.len(), "a row is of no route");
    let wrong = "Bearer isocortex_0000000000000000000000000000000000000000000000000000000000000000";
    let answer = ask(&server, &Method::GET, "/v1/cases", Some(wrong)).await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (401, "unauthorized")
    );
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
    let streamed = tokio::spawn({
        let (router, read) = (server.router(), read.clone());
        async move {
            let request = Request::get(events).header("authorization", read);
            let response = router.oneshot(request.body(Body::empty()).unwrap()).await;
            let mut body = response.unwrap().into_body();
            assert!(body.frame().await.is_some(), "the state at once");
            body.collect().await.unwrap();
        }
    });
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
    ended.expect("the stream ends").unwrap();
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
