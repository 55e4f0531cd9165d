//! The description of the interface: complete, and sound.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::results::python_with;
use crate::server::Server;

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
    let expected: BTreeSet<_> = [
        "get /healthz",
        "get /readyz",
        "get /metrics",
        "get /version",
        "get /sign-in",
        "get /v1/session",
        "get /v1/cases",
        "post /v1/cases",
        "get /v1/cases/{id}",
        "patch /v1/cases/{id}",
        "delete /v1/cases/{id}",
        "get /v1/cases/{id}/dicom",
        "get /v1/cases/{id}/events",
        "get /v1/cases/{id}/mesh",
        "get /v1/cases/{id}/mesh/triangles",
        "get /v1/cases/{id}/mesh/paths",
        "get /v1/cases/{id}/volume",
        "get /v1/cases/{id}/distance",
        "get /v1/cases/{id}/render",
        "post /v1/cases/{id}/renders",
        "get /v1/cases/{id}/slices/{plane}",
        "get /v1/cases/{id}/acquired/{plane}",
        "get /v1/cases/{id}/mask",
        "put /v1/cases/{id}/mask",
        "get /v1/cases/{id}/envelope",
        "get /v1/cases/{id}/quality",
        "get /v1/cases/{id}/layers",
        "post /v1/cases/{id}/layers",
        "get /v1/cases/{id}/layers/{layer}",
        "patch /v1/cases/{id}/layers/{layer}",
        "delete /v1/cases/{id}/layers/{layer}",
        "get /v1/cases/{id}/layers/{layer}/events",
        "get /v1/cases/{id}/layers/{layer}/volume",
        "get /v1/cases/{id}/layers/{layer}/nifti",
        "get /v1/cases/{id}/candidates",
        "get /v1/cases/{id}/findings",
        "put /v1/cases/{id}/findings",
        "post /v1/cases/{id}/findings/from/{other}",
        "get /v1/cases/{id}/report",
        "get /v1/cases/{id}/profile",
        "get /v1/cases/{id}/registration",
        "post /dicomweb/studies",
        "post /dicomweb/studies/{study}",
        "get /dicomweb/studies/{study}/rendered3D",
        "get /dicomweb/studies/{study}/series/{series}/rendered3D",
        "post /v1/cases/search",
        "get /v1/pacs",
        "get /v1/arrivals",
        "get /v1/arrivals/{id}",
        "post /v1/arrivals/{id}",
        "get /v1/rejections",
        "delete /v1/rejections/{id}",
        "post /v1/retrievals",
        "get /v1/retrievals",
        "get /v1/retrievals/{id}",
        "post /v1/cases/{id}/dicom-results",
        "get /v1/dicom-results",
        "get /v1/dicom-results/{id}",
        "post /v1/pacs/nodes/{name}/test",
        "post /v1/launch",
        "post /hooks/orthanc",
    ]
    .map(str::to_owned)
    .into();
    assert_eq!(described, expected);
}

/// Validates the description, and answers against the schemas that it has for them: a JSON object on standard input.
const VALIDATE: &str = r##"
import json, sys
from openapi_spec_validator import OpenAPIV31SpecValidator
from jsonschema import Draft202012Validator

given = json.load(sys.stdin)
description = given["description"]
found = [f"{'/'.join(map(str, error.absolute_path))}: {error.message}" for error in OpenAPIV31SpecValidator(description).iter_errors()]
for name, answer in given["answers"]:
    schema = {"$ref": f"#/components/schemas/{name}", "components": description["components"]}
    found += [f"{name}: {error.message}" for error in Draft202012Validator(schema).iter_errors(answer)]
print("\n".join(found))
"##;

#[tokio::test]
async fn the_description_is_valid_and_answers_are_as_it_says() {
    let Some(python) = python_with("openapi_spec_validator") else {
        return;
    };
    let server = Server::start().await;
    let case = server.plain_case().await;
    let mut answers = Vec::new();
    for (name, address) in [
        ("CasePage", "/v1/cases".to_owned()),
        ("Case", case.clone()),
        ("LayerList", format!("{case}/layers")),
        ("Layer", format!("{case}/layers/junction")),
        ("ArrivalList", "/v1/arrivals".to_owned()),
        ("RejectionList", "/v1/rejections".to_owned()),
        ("Problem", "/v1/cases/nonsense".to_owned()),
    ] {
        answers.push((name, server.get(&address).await.json()));
    }
    let given = serde_json::json!({
        "description": server.get("/openapi.json").await.json(),
        "answers": answers,
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
