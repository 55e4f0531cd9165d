//! Cases are found by label, state, day, study, series, accession number and Patient ID, and no address has any of them.

use axum::body::Body;
use axum::http::{Method, Request};
use serde_json::{Value, json};

use crate::head::plain_head;
use crate::launch::Series;
use crate::pacs::Neighbour;
use crate::server::{Answer, Server};

async fn search(server: &Server, asked: &Value) -> Answer {
    let request = Request::post("/v1/cases/search").body(Body::from(asked.to_string()));
    server.send(request.unwrap()).await
}

/// The ids of the cases that are found, newest first.
async fn found(server: &Server, asked: Value) -> Vec<String> {
    let answer = search(server, &asked).await;
    assert_eq!(answer.status, 200, "{asked}: {answer:?}");
    assert_eq!(answer.header("cache-control"), "no-store");
    let found = answer.json();
    let cases = found["cases"].as_array().unwrap().iter();
    let ids = cases.map(|case| case["id"].as_str().unwrap().to_owned());
    ids.collect()
}

#[tokio::test]
async fn cases_are_found_by_what_they_are_and_whose() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let mut cases = Vec::new();
    for (study, uid, patient, number) in [
        ("1.2.60", "1.2.60.1", "PAT-A", "ACC-1"),
        ("1.2.60", "1.2.60.2", "PAT-B", "ACC-1"),
        ("1.2.61", "1.2.61.1", "PAT-B", "ACC-2"),
    ] {
        let series = Series {
            study,
            uid,
            texts: &[
                ([0x08, 0x50], "SH", number),
                ([0x10, 0x10], "PN", "Sousa^Maria"),
                ([0x10, 0x20], "LO", patient),
                ([0x10, 0x21], "LO", "HOSP"),
                ([0x10, 0x30], "DA", "19670312"),
            ],
        };
        cases.push(series.becomes(&neighbour).await);
    }
    let named = json!({"name": "by hand"}).to_string();
    let parts = [
        ("volume", &plain_head().bytes()[..]),
        ("parameters", named.as_bytes()),
    ];
    let uploaded = server.upload(&parts).await.json();
    let [first, second, third] = [0, 1, 2].map(|number: usize| cases[number].clone());
    let upload = uploaded["id"].as_str().unwrap().to_owned();
    let newest_first = [&upload, &third, &second, &first].map(String::clone);
    let ready = json!({"state": "ready", "study": "1.2.60"});
    let today = jiff::Timestamp::now().to_string()[..10].to_owned();
    for (asked, expected) in [
        (json!({}), newest_first.to_vec()),
        (json!({"label": "BY H"}), vec![upload.clone()]),
        (ready, vec![second.clone(), first.clone()]),
        (json!({"state": "failed"}), Vec::new()),
        (
            json!({"from": "2020-02-29", "to": "2020-02-29"}),
            Vec::new(),
        ),
        (json!({"to": "2999-12-31"}), newest_first.to_vec()),
        (json!({"from": today, "label": "by hand"}), vec![upload]),
        (json!({"series": "1.2.60.2"}), vec![second.clone()]),
        (
            json!({"accession_number": "ACC-1"}),
            vec![second.clone(), first.clone()],
        ),
        (json!({"accession_number": "ACC"}), Vec::new()),
        (
            json!({"patient_id": "PAT-B"}),
            vec![third.clone(), second.clone()],
        ),
        (json!({"patient_id": "PAT"}), Vec::new()),
        (
            json!({"patient_id": "PAT-B", "study": "1.2.60"}),
            vec![second.clone()],
        ),
        (
            json!({"patient_id": "PAT-A", "study": "1.2.61"}),
            Vec::new(),
        ),
    ] {
        assert_eq!(found(server, asked.clone()).await, expected, "{asked}");
    }

    // Each is shown with its study and its patient.
    let of_study = search(server, &json!({"study": "1.2.60", "limit": 1})).await;
    let page = of_study.json();
    let shown = &page["cases"][0];
    assert_eq!(
        [&shown["id"], &shown["study"], &shown["series"]],
        [&json!(second), &json!("1.2.60"), &json!("1.2.60.2")]
    );
    assert_eq!(shown["accession_number"], "ACC-1");
    assert_eq!(
        shown["patient"],
        "Sousa, Maria · PAT-B (HOSP) · * 1967-03-12"
    );
    assert_eq!(shown["links"]["self"], format!("/v1/cases/{second}"));
    let next = json!({"study": "1.2.60", "limit": 1, "after": page["next"]});
    let rest = search(server, &next).await.json();
    assert_eq!(rest["cases"][0]["id"], first);
    assert!(rest["next"].is_null(), "{rest}");
}

#[tokio::test]
async fn what_is_no_search_is_refused_and_not_repeated() {
    let server = Server::start().await;
    for (asked, parameter) in [
        (json!({"label": ""}), "label"),
        (json!({"state": "Secret"}), "state"),
        (json!({"from": "Secret"}), "from"),
        (json!({"to": "2026-02-30"}), "to"),
        (json!({"to": "9999-12-31"}), "to"),
        (json!({"study": "Secret"}), "study"),
        (json!({"series": "1..2"}), "series"),
        (json!({"accession_number": " "}), "accession_number"),
        (json!({"patient_id": " "}), "patient_id"),
        (json!({"text": ""}), "text"),
        (json!({"status": "Secret"}), "status"),
        (json!({"sort": "Secret"}), "sort"),
        (json!({"limit": 201}), "limit"),
        (json!({"after": "Secret"}), "after"),
    ] {
        let refused = search(&server, &asked).await;
        assert_eq!(refused.status, 400, "{asked}");
        let problem = refused.json();
        assert_eq!(problem["parameter"], parameter, "{problem}");
        assert!(!problem.to_string().contains("Secret"), "{problem}");
    }
    let unknown = search(&server, &json!({"PatientName": "Secret"})).await;
    assert_eq!(unknown.problem(), "body-unreadable");
    // Nothing is asked for in an address.
    let request = Request::post("/v1/cases/search?patient_id=Secret").body(Body::from("{}"));
    let refused = server.send(request.unwrap()).await;
    assert_eq!(refused.problem(), "query-unknown-key");
    let refused = server.method(Method::GET, "/v1/cases/search").await;
    assert_eq!(refused.status, 405);
}

#[tokio::test]
async fn a_worklist_states_what_is_to_be_done_and_the_trash_is_left_out() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let id = case.rsplit('/').next().unwrap();
    let row = async || {
        let page = search(&server, &json!({"patients": false, "skip": 0})).await;
        page.json()
    };
    let page = row().await;
    assert_eq!(page["total"], 1);
    assert_eq!(page["cases"][0]["status"], "new");
    assert_eq!(page["cases"][0]["finding_count"], 0);
    let list = server.get(&format!("{case}/findings")).await.json();
    assert!(list["findings"].as_array().unwrap().is_empty());
    crate::findings::mark(&server, &case).await;
    let page = row().await;
    assert_eq!(page["cases"][0]["status"], "begun");
    assert!(page["cases"][0]["finding_count"].as_u64().unwrap() > 0);

    let patch = async |trashed: bool| {
        let body = Body::from(json!({"trashed": trashed}).to_string());
        let request = Request::patch(&case).body(body).unwrap();
        server.send(request).await.json()
    };
    assert_eq!(patch(true).await["trashed"], true);
    assert_eq!(found(&server, json!({})).await, Vec::<String>::new());
    assert_eq!(found(&server, json!({"trashed": true})).await, [id]);
    let list = server.get("/v1/cases").await.json();
    assert_eq!(list["cases"], json!([]));
    assert_eq!(
        server.get(&case).await.json()["trashed"],
        true,
        "its address shows it"
    );
    assert!(patch(false).await.get("trashed").is_none());
    assert_eq!(found(&server, json!({})).await, [id]);
    // A cursor belongs to the newest first.
    let after = format!("1-{id}");
    for wrong in [
        json!({"sort": "label", "after": after}),
        json!({"skip": 0, "after": after}),
    ] {
        assert_eq!(search(&server, &wrong).await.json()["parameter"], "after");
    }
}

#[tokio::test]
async fn a_search_is_recorded_as_one_that_shows_patients() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start_with(|config| {
        config.audit.folder = Some(folder.path().to_owned());
    })
    .await;
    for asked in [
        json!({"patient_id": "CANARY"}),
        json!({"study": "1.2.3", "patients": false}),
        json!({"patients": false}),
    ] {
        let answer = search(&server, &asked).await;
        assert_eq!(answer.status, 200, "{answer:?}");
    }
    // It is on the disk before the answer.
    let files = std::fs::read_dir(folder.path()).unwrap();
    let texts = files.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap());
    let text: String = texts.collect();
    let lines = text
        .lines()
        .filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let is_search =
        |line: &Value| line["route"] == "POST /v1/cases/search" && line["object"] == "identity";
    assert_eq!(lines.filter(is_search).count(), 2, "{text}");
    assert!(!text.contains("CANARY"), "{text}");
}
