//! A store that an earlier program made is opened, and what is in it is as it was.
//!
//! `golden/store.zip` is a store of 0.1.0, and stays: each later migration has to open it. `ISOCORTEX_WRITE_STORE=1` has made it.
//! `ISOCORTEX_WRITE_GOLDEN=1` writes `golden/store.json` again, what is answered from it: look at what changes before it is committed.

use std::collections::BTreeMap;
use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};

use axum::http::StatusCode;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ring::digest::SHA256;
use serde_json::{Value, json};
use storage::testing::files_below;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use crate::dicom::head_slices;
use crate::findings::mark;
use crate::flair::{added, patch};
use crate::head::plain_head;
use crate::maps::until_maps;
use crate::pacs::Neighbour;
use crate::series_builder::{Syntax, files};
use crate::server::{Part, Server};

/// What is asked about the case: what it says, and what is computed from its objects.
const QUESTIONS: [&str; 8] = [
    "",
    "/findings",
    "/layers",
    "/dicom",
    "/volume",
    "/mesh?depth_mm=8",
    "/mesh/paths",
    "/render?depth_mm=8&renderer=splat",
];

/// A file beside the tests: the store, or the answers from it.
fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("golden")
        .join(name)
}

/// Makes a store with a case from a PACS that is kept and has findings and a layer.
async fn make() {
    let neighbour = Neighbour::start(|_| {}).await;
    let stored = neighbour
        .store(&files(&head_slices(), Syntax::Explicit))
        .await;
    assert_eq!(stored.status, StatusCode::OK, "{stored:?}");
    let arrival = neighbour.settled().await;
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    neighbour.server.until_ready(&case).await;
    let changed = patch(&neighbour.server, &case, json!({ "kept": true })).await;
    assert_eq!(changed.status, StatusCode::OK, "{changed:?}");
    let parameters = json!({ "contrast": "flair" }).to_string();
    let layer = plain_head().bytes();
    let parts: [Part<'_>; 2] = [("parameters", parameters.as_bytes()), ("volume", &layer)];
    added(&neighbour.server, &case, &parts).await;
    mark(&neighbour.server, &case).await;
    let server = neighbour.restarted().await;

    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for file in files_below(server.directory()) {
        let name = file.strip_prefix(server.directory()).unwrap();
        archive
            .start_file(name.to_string_lossy(), SimpleFileOptions::default())
            .unwrap();
        archive.write_all(&std::fs::read(&file).unwrap()).unwrap();
    }
    std::fs::write(kept("store.zip"), archive.finish().unwrap().into_inner()).unwrap();
}

/// The answers to all questions: JSON as it is, other bodies as digests, pictures by their pixels.
async fn answers(server: &Server, case: &str) -> BTreeMap<String, Value> {
    let mut answers = BTreeMap::new();
    for question in QUESTIONS {
        let answer = server.get(&format!("{case}{question}")).await;
        assert_eq!(answer.status, StatusCode::OK, "{question}: {answer:?}");
        let value = match answer.header("content-type") {
            "application/json" => answer.json(),
            "image/png" => json!(digest(answer.grey().as_raw())),
            _ => json!(digest(&answer.body)),
        };
        answers.insert(question.to_owned(), value);
    }
    answers
}

fn digest(bytes: &[u8]) -> String {
    STANDARD.encode(ring::digest::digest(&SHA256, bytes))
}

/// Whether all that an answer had is in another one, which may have more keys.
fn is_within(before: &Value, now: &Value) -> bool {
    match (before, now) {
        (Value::Object(before), Value::Object(now)) => before
            .iter()
            .all(|(key, value)| now.get(key).is_some_and(|now| is_within(value, now))),
        (Value::Array(before), Value::Array(now)) => {
            let mut pairs = before.iter().zip(now);
            before.len() == now.len() && pairs.all(|(before, now)| is_within(before, now))
        }
        _ => before == now,
    }
}

#[tokio::test]
async fn a_store_of_an_earlier_program_is_opened_and_has_what_it_had() {
    let is_asked = |variable| std::env::var_os(variable).is_some();
    if is_asked("ISOCORTEX_WRITE_STORE") {
        make().await;
    }
    let directory = tempfile::tempdir().unwrap();
    let archive = std::fs::File::open(kept("store.zip")).unwrap();
    ZipArchive::new(archive)
        .unwrap()
        .extract(directory.path())
        .unwrap();
    let server = Server::start_on(directory, |_| {}).await;
    // What is kept for some days only is gone by the time that a later program opens the store.
    let days = std::time::Duration::from_secs(30 * 24 * 3600);
    server.state.cases.store().pass_time(days);
    let list = server.get("/v1/cases").await.json();
    let [case] = &list["cases"].as_array().unwrap()[..] else {
        panic!("the store has one case: {list}");
    };
    let case = format!("/v1/cases/{}", case["id"].as_str().unwrap());
    // What a migration has counted in the document of the findings, and found in the facts of the case.
    let mask = &list["cases"][0]["quality"]["state"];
    let body = json!({"patients": false, "mask": mask}).to_string();
    let search = axum::http::Request::post("/v1/cases/search").body(axum::body::Body::from(body));
    let listed = server.send(search.unwrap()).await.json();
    let findings = server.get(&format!("{case}/findings")).await.json();
    let findings = findings["findings"].as_array().unwrap().iter();
    let counted = findings.filter(|one| one["is_dismissed"] != true).count();
    assert_eq!(listed["cases"][0]["finding_count"], counted);
    assert_eq!(listed["cases"][0]["readers"], json!(["Dr. Ana Müller"]));
    until_maps(&server, &case).await;
    let now = answers(&server, &case).await;
    if is_asked("ISOCORTEX_WRITE_GOLDEN") || is_asked("ISOCORTEX_WRITE_STORE") {
        let written = serde_json::to_string_pretty(&now).unwrap() + "\n";
        std::fs::write(kept("store.json"), written).unwrap();
    }
    let before = std::fs::read(kept("store.json")).unwrap();
    let before: BTreeMap<String, Value> = serde_json::from_slice(&before).unwrap();
    assert_eq!(before.len(), QUESTIONS.len());
    for (question, before) in before {
        let now = &now[&question];
        assert!(
            is_within(&before, now),
            "{question}\nbefore: {before}\nnow: {now}"
        );
    }
}
