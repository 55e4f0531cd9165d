//! The description of the interface: complete, and sound.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::process::{Command, Stdio};

use axum::http::Request;
use serde_json::Value;

use crate::head::plain_head;
use crate::results::python_with;
use crate::scopes::rows;
use crate::server::{Answer, Server, form, form_type};

#[tokio::test]
async fn every_route_is_described_in_openapi_3_1() {
    let server = Server::start().await;
    let description = server.get("/openapi.json").await.json();
    assert!(description["openapi"].as_str().unwrap().starts_with("3.1."));
    let paths = description["paths"].as_object().unwrap();
    let described: BTreeSet<_> = paths
        .iter()
        .flat_map(|(path, item)| {
            let methods = item.as_object().unwrap().keys();
            methods.map(move |method| format!("{method} {path}"))
        })
        .collect();
    // Documents, and the other spelling of a word of the standard.
    let undescribed = |path: &str| {
        ["/docs", "/docs.css", "/openapi.json"].contains(&path) || path.ends_with("/rendered3d")
    };
    let routes = rows(&server)
        .into_keys()
        .filter(|(_, path)| !undescribed(path));
    let routes = routes.map(|(method, path)| format!("{} {path}", method.to_lowercase()));
    // The test of scopes finds that each row is a route, and each route in a row; these are open to everybody.
    let open = [
        "get /healthz",
        "get /readyz",
        "get /metrics",
        "get /version",
        "get /sign-in",
    ]
    .map(str::to_owned);
    assert_eq!(described, routes.chain(open).collect());
}

/// Validates the description, and answers against the schemas that it has for their routes: a JSON object on standard input.
const VALIDATE: &str = r##"
import json, sys
from openapi_spec_validator import OpenAPIV31SpecValidator
from jsonschema import Draft202012Validator

given = json.load(sys.stdin)
description = given["description"]
found = [f"{'/'.join(map(str, error.absolute_path))}: {error.message}" for error in OpenAPIV31SpecValidator(description).iter_errors()]
for address, schema, answer in given["answers"]:
    schema = {**schema, "components": description["components"]}
    found += [f"{address}: {error.message}" for error in Draft202012Validator(schema).iter_errors(answer)]
print("\n".join(found))
"##;

/// Answers of a server, each with its address and the schema of its route.
struct Answers {
    description: Value,
    all: Vec<Value>,
}

impl Answers {
    /// Keeps an answer in JSON that some route has a schema for. Others are not described: pictures, and streams.
    fn keep(&mut self, method: &str, path: &str, address: &str, answer: &Answer) {
        let media = answer.headers.get("content-type");
        let media = media.map_or("", |media| media.to_str().unwrap());
        let operation = &self.description["paths"][path][method];
        let described = &operation["responses"][answer.status.as_str()]["content"];
        if let Some(schema) = described[media].get("schema")
            && media.ends_with("json")
        {
            let kept = serde_json::json!([format!("{method} {address}"), schema, answer.json()]);
            self.all.push(kept);
        }
    }

    /// Asks every route that reads, about a case and its layers.
    async fn read(&mut self, server: &Server, case: &str) {
        let id = case.rsplit('/').next().unwrap();
        let layers = server.get(&format!("{case}/layers")).await.json();
        // None are listed before the case is ready; maps have a name alone.
        let layers = layers["layers"].as_array().into_iter().flatten();
        let ids = layers.filter_map(|layer| layer["id"].as_str().or(layer["name"].as_str()));
        let ids: Vec<_> = ids.map(str::to_owned).collect();
        let paths: Vec<_> = self.description["paths"]
            .as_object()
            .unwrap()
            .iter()
            .filter(|(path, item)| item.get("get").is_some() && !path.ends_with("/events"))
            .map(|(path, _)| path.clone())
            .collect();
        for path in paths {
            let of_case = path.replace("{id}", id).replace("{plane}", "axial");
            let addresses = match of_case.contains("{layer}") {
                true => ids
                    .iter()
                    .map(|layer| of_case.replace("{layer}", layer))
                    .collect(),
                false => vec![of_case],
            };
            for address in addresses {
                let answer = server.get(&address).await;
                self.keep("get", &path, &address, &answer);
            }
        }
    }
}

#[tokio::test]
async fn the_description_is_valid_and_answers_in_every_state_are_as_it_says() {
    let Some(python) = python_with("openapi_spec_validator") else {
        return;
    };
    let mut server = Server::start_with(|config| config.prepare.workers = 0).await;
    let mut answers = Answers {
        description: server.get("/openapi.json").await.json(),
        all: Vec::new(),
    };
    let head = plain_head().bytes();
    let uploaded = server.upload(&[("volume", &head)]).await;
    answers.keep("post", "/v1/cases", "/v1/cases", &uploaded);
    let case = uploaded.header("location").to_owned();
    let add = async |server: &Server| {
        let address = format!("{case}/layers");
        let request = Request::post(&address)
            .header("content-type", form_type())
            .body(
                form(&[
                    ("volume", &head[..]),
                    ("parameters", br#"{"name": "again"}"#),
                ])
                .into(),
            );
        (address, server.send(request.unwrap()).await)
    };
    let (address, refused) = add(&server).await;
    answers.keep("post", "/v1/cases/{id}/layers", &address, &refused);
    answers.read(&server, &case).await;
    // It has more voxels than it may have by now, and fails.
    server = server
        .restart_with(|config| {
            config.prepare.workers = 1;
            config.limits.max_voxels = 1000;
        })
        .await;
    assert_eq!(server.until_settled(&case).await["state"], "failed");
    answers.read(&server, &case).await;
    server = server
        .restart_with(|config| config.limits = isocortex::config::Config::default().limits)
        .await;
    let again = server.upload(&[("volume", &head)]).await;
    answers.keep("post", "/v1/cases", "/v1/cases", &again);
    server.until_ready(&case).await;
    // A layer that waits.
    server = server
        .restart_with(|config| config.prepare.workers = 0)
        .await;
    let (address, added) = add(&server).await;
    assert!(added.status.is_success(), "{added:?}");
    answers.keep("post", "/v1/cases/{id}/layers", &address, &added);
    answers.read(&server, &case).await;
    server = server
        .restart_with(|config| config.prepare.workers = 1)
        .await;
    server.until_ready(added.header("location")).await;
    answers.read(&server, &case).await;
    let states: BTreeSet<_> = (answers.all.iter())
        .filter(|kept| kept[0] == format!("get {case}"))
        .map(|kept| kept[2]["state"].as_str().unwrap())
        .collect();
    assert_eq!(states, ["failed", "queued", "ready"].into());
    assert!(answers.all.len() > 100, "{}", answers.all.len());
    let given = serde_json::json!({
        "description": answers.description,
        "answers": answers.all,
    });
    let mut validator = Command::new(python)
        .args(["-c", VALIDATE])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = validator.stdin.take().unwrap();
    stdin.write_all(given.to_string().as_bytes()).unwrap();
    drop(stdin);
    let output = validator.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8(output.stdout).unwrap().trim(), "");
}

#[tokio::test]
async fn every_error_has_a_schema_and_every_key_of_a_search_is_described() {
    let server = Server::start().await;
    let description = server.get("/openapi.json").await.json();
    let mut ids = BTreeSet::new();
    for (path, item) in description["paths"].as_object().unwrap() {
        for operation in item.as_object().unwrap().values() {
            let id = operation["operationId"].as_str().unwrap();
            assert!(ids.insert(id.to_owned()), "{id} twice");
            for (status, answer) in operation["responses"].as_object().unwrap() {
                let is_error = status.starts_with(['4', '5']);
                let has_schema = answer["content"].is_object();
                assert!(!is_error || has_schema, "{path}: {status}");
            }
        }
    }
    let schemes = description["components"]["securitySchemes"]
        .as_object()
        .unwrap();
    assert!(schemes.contains_key("basic") && schemes.contains_key("bearer"));
    for (path, key) in [
        ("/v1/arrivals", "limit"),
        ("/dicomweb/studies/{study}/rendered3D", "viewpointup"),
        ("/v1/dicom-results", "state"),
    ] {
        let parameters = description["paths"][path]["get"]["parameters"].as_array();
        let has_key = |parameter: &Value| parameter["name"] == key && parameter["in"] == "query";
        assert!(parameters.unwrap().iter().any(has_key), "{path} {key}");
    }
}

#[tokio::test]
async fn references_lead_somewhere_and_path_parameters_are_described() {
    let server = Server::start().await;
    let description = server.get("/openapi.json").await.json();
    let mut references = Vec::new();
    collect_references(&description, &mut references);
    assert!(!references.is_empty());
    for reference in references {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(
            description.pointer(pointer).is_some(),
            "{reference} leads nowhere"
        );
    }
    for (path, item) in description["paths"].as_object().unwrap() {
        for operation in item.as_object().unwrap().values() {
            let parameters: Vec<Value> = operation["parameters"]
                .as_array()
                .cloned()
                .unwrap_or_default();
            for name in path.split('/').filter_map(|part| part.strip_prefix('{')) {
                let name = name.trim_end_matches('}');
                let found = parameters
                    .iter()
                    .find(|parameter| parameter["name"] == *name);
                let found = found.unwrap_or_else(|| panic!("{path}: {name} is not described"));
                assert_eq!(
                    (&found["in"], &found["required"]),
                    (&Value::from("path"), &Value::from(true))
                );
            }
            assert!(!operation["responses"].as_object().unwrap().is_empty());
            assert!(operation["operationId"].is_string());
        }
    }
}

fn collect_references(value: &Value, references: &mut Vec<String>) {
    match value {
        Value::Object(members) => {
            for (name, member) in members {
                match (name.as_str(), member) {
                    ("$ref", Value::String(reference)) => references.push(reference.clone()),
                    _ => collect_references(member, references),
                }
            }
        }
        Value::Array(items) => items
            .iter()
            .for_each(|item| collect_references(item, references)),
        _ => {}
    }
}

#[tokio::test]
async fn the_manual_needs_nothing_from_elsewhere() {
    let server = Server::start().await;
    for address in ["/docs", "/"] {
        let page = server.get(address).await;
        assert!(page.header("content-type").starts_with("text/html"));
        assert!(
            page.header("content-security-policy")
                .starts_with("default-src 'none'")
        );
        let text = String::from_utf8(page.body.to_vec()).unwrap();
        for elsewhere in ["src=\"http", "href=\"http", "src=\"//", "href=\"//"] {
            assert!(!text.contains(elsewhere), "{address}: {elsewhere}");
        }
    }
    let manual = String::from_utf8(server.get("/docs").await.body.to_vec()).unwrap();
    for path in ["/v1/cases/{id}/mesh/paths", "/v1/cases/{id}/slices/{plane}"] {
        assert!(manual.contains(path));
    }
    assert_eq!(server.get("/docs.css").await.status, 200);
}

#[tokio::test]
async fn a_document_is_asked_for_again_with_its_tag() {
    let server = Server::start().await;
    let page = server.get_with("/", &[("accept-encoding", "gzip")]).await;
    assert_eq!(page.header("cache-control"), "no-cache");
    assert_eq!(page.header("content-encoding"), "gzip");
    let tag = page.header("etag");
    let again = server
        .get_with("/", &[("if-none-match", tag), ("accept-encoding", "gzip")])
        .await;
    assert_eq!(again.status, 304);
}

#[tokio::test]
async fn whatever_wants_a_token_says_so() {
    let server = Server::start().await;
    let description = server.get("/openapi.json").await.json();
    let scheme = &description["components"]["securitySchemes"]["bearer"];
    assert_eq!(
        (&scheme["type"], &scheme["scheme"]),
        (&"http".into(), &"bearer".into())
    );
    for (path, item) in description["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let is_guarded = ["/v1/", "/dicomweb/", "/hooks/"]
                .iter()
                .any(|guarded| path.starts_with(guarded));
            let wants_token = operation["security"][0]["bearer"].is_array();
            let can_refuse = operation["responses"]["401"].is_object();
            assert_eq!(
                [wants_token, can_refuse],
                [is_guarded; 2],
                "{method} {path}"
            );
        }
    }
    let mesh = &description["paths"]["/v1/cases/{id}/mesh"]["get"]["responses"];
    assert!(mesh["406"].is_object());
}
