//! From an upload to a ready case, and away again.

use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use futures_util::future::join_all;
use jiff::Timestamp;
use serde_json::json;

use crate::head::{mask_of, plain_head};
use crate::nifti::gzip;
use crate::server::Server;

#[tokio::test]
async fn an_upload_becomes_a_case_with_its_facts() {
    let server = Server::start().await;
    let answer = server
        .upload(&[
            (
                "parameters",
                br#"{"closing_radius_mm": 8, "name": "A test head"}"#,
            ),
            ("volume", &gzip(&plain_head().bytes())),
            ("mask", &mask_of(&plain_head()).bytes()),
        ])
        .await;
    assert_eq!(answer.status, StatusCode::ACCEPTED);
    assert!(answer.headers.contains_key("retry-after"));
    let address = answer.header("location").to_owned();
    assert_eq!(
        address,
        format!("/v1/cases/{}", answer.json()["id"].as_str().unwrap())
    );
    let case = server.until_ready(&address).await;
    assert_eq!(case["name"], "A test head");
    assert_eq!(case["closing_radius_mm"], 8.0);
    assert_eq!(case["grid"]["spacing_mm"], 4.0);
    let deepest = case["max_depth_mm"].as_f64().unwrap();
    assert!((46.0..58.0).contains(&deepest), "{deepest}");
    assert_eq!(case["links"]["mesh"], format!("{address}/mesh"));
    assert!(case["timings"].as_array().unwrap().len() > 5);
    assert!(case["error"].is_null());
}

#[tokio::test]
async fn the_same_upload_twenty_times_at_once_is_one_case() {
    let server = Server::start().await;
    let volume = plain_head().bytes();
    let parts = [("volume", &volume[..])];
    let answers = join_all((0..20).map(|_| server.upload(&parts))).await;
    let created = answers
        .iter()
        .filter(|answer| answer.status == StatusCode::ACCEPTED);
    assert_eq!(created.count(), 1);
    let there = answers
        .iter()
        .filter(|answer| answer.status == StatusCode::OK);
    assert_eq!(there.count(), 19);
    assert_eq!(
        server.get("/v1/cases").await.json()["cases"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
    server.until_ready(answers[0].header("location")).await;
}

#[tokio::test]
async fn a_deleted_case_is_gone_with_all_its_files() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    assert_eq!(
        server.get(&format!("{case}/mesh")).await.status,
        StatusCode::OK
    );
    assert_eq!(
        server.method(Method::DELETE, &case).await.status,
        StatusCode::NO_CONTENT
    );
    assert_eq!(
        server.method(Method::DELETE, &case).await.problem(),
        "no-such-case"
    );
    for rest in ["", "/mesh", "/render", "/volume"] {
        let answer = server.get(&format!("{case}{rest}")).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{rest}");
    }
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_case_states_when_it_expires_unless_it_is_kept() {
    let server = Server::start_with(|config| config.storage.keep_days = Some(30)).await;
    let case = server.plain_case().await;
    let patch = async |address: &str, body: &'static str| {
        let request = Request::patch(address).body(Body::from(body)).unwrap();
        server.send(request).await
    };
    let time = |value: &serde_json::Value| value.as_str().unwrap().parse::<Timestamp>().unwrap();
    let json = server.get(&case).await.json();
    let [created, expires] = ["created_at", "expires_at"].map(|key| time(&json[key]));
    assert_eq!(json["kept"], false);
    assert_eq!(expires.as_second() - created.as_second(), 30 * 86_400);

    let kept = patch(&case, r#"{"kept": true}"#).await;
    assert_eq!(kept.status, StatusCode::OK, "{kept:?}");
    assert_eq!(kept.json()["kept"], true);
    assert_eq!(kept.json()["expires_at"], serde_json::Value::Null);
    let listed = server.get("/v1/cases").await.json();
    assert_eq!(listed["cases"][0]["kept"], true);
    let again = patch(&case, r#"{"kept": false}"#).await.json();
    assert_eq!(again["expires_at"], json["expires_at"]);

    for (address, body, problem) in [
        (case.as_str(), r#"{"keep": true}"#, "body-unreadable"),
        (&case, "kept", "body-unreadable"),
        (
            "/v1/cases/00000000000000000000000000000000",
            r#"{"kept": true}"#,
            "no-such-case",
        ),
    ] {
        assert_eq!(patch(address, body).await.problem(), problem, "{body}");
    }
}

#[tokio::test]
async fn the_list_is_paged_newest_first() {
    let server = Server::start().await;
    let volume = plain_head().bytes();
    let mut ids = Vec::new();
    for radius in 1..=5 {
        let parameters = json!({ "closing_radius_mm": radius }).to_string();
        let parts = [
            ("volume", &volume[..]),
            ("parameters", parameters.as_bytes()),
        ];
        ids.push(server.upload(&parts).await.json()["id"].clone());
    }
    ids.reverse();
    let mut listed = Vec::new();
    let mut address = "/v1/cases?limit=2".to_owned();
    loop {
        let page = server.get(&address).await.json();
        listed.extend(
            page["cases"]
                .as_array()
                .unwrap()
                .iter()
                .map(|case| case["id"].clone()),
        );
        match page["next"].as_str() {
            Some(next) => address = format!("/v1/cases?limit=2&after={next}"),
            None => break,
        }
    }
    assert_eq!(listed, ids);
}

#[tokio::test]
async fn events_follow_a_case_until_it_is_ready() {
    let server = Server::start().await;
    let answer = server.upload(&[("volume", &plain_head().bytes())]).await;
    let address = format!("{}/events", answer.header("location"));
    let events = server.get(&address).await;
    assert_eq!(events.header("content-type"), "text/event-stream");
    let text = String::from_utf8(events.body.to_vec()).unwrap();
    let last = text
        .lines()
        .rfind(|line| line.starts_with("data: "))
        .unwrap();
    let case: serde_json::Value = serde_json::from_str(&last[6..]).unwrap();
    assert_eq!(case["state"], "ready");
    assert!(text.contains("event: case"));
}

#[tokio::test]
async fn a_case_that_waits_says_so() {
    let server = Server::start_with(|config| config.prepare.workers = 1).await;
    let volume = plain_head().bytes();
    let mut last = String::new();
    for radius in 1..=6 {
        let parameters = json!({ "closing_radius_mm": radius }).to_string();
        let parts = [
            ("volume", &volume[..]),
            ("parameters", parameters.as_bytes()),
        ];
        server
            .upload(&parts)
            .await
            .header("location")
            .clone_into(&mut last);
    }
    let answer = server.get(&format!("{last}/mesh")).await;
    if answer.status != StatusCode::OK {
        assert_eq!(answer.problem(), "case-not-ready");
        assert_eq!(answer.status, StatusCode::CONFLICT);
        assert!(answer.headers.contains_key("retry-after"));
    }
    server.until_ready(&last).await;
}

#[tokio::test]
async fn a_full_queue_refuses_with_a_time_to_come_again() {
    let server = Server::start_with(|config| config.limits.max_queued_cases = 1).await;
    let volume = plain_head().bytes();
    let uploads = (1..=12).map(|radius| {
        let parameters = json!({ "closing_radius_mm": radius }).to_string();
        let (server, volume) = (&server, &volume);
        async move {
            let parts = [
                ("volume", &volume[..]),
                ("parameters", parameters.as_bytes()),
            ];
            server.upload(&parts).await
        }
    });
    let answers = join_all(uploads).await;
    let refused: Vec<_> = answers
        .iter()
        .filter(|answer| answer.status == StatusCode::SERVICE_UNAVAILABLE)
        .collect();
    assert!(!refused.is_empty());
    for answer in refused {
        assert_eq!(answer.problem(), "busy");
        assert!(answer.headers.contains_key("retry-after"));
    }
}

#[tokio::test]
async fn a_server_whose_disk_is_full_says_that_it_is_not_ready_and_serves_what_it_has() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    assert_eq!(server.get("/readyz").await.status, StatusCode::OK);
    // No disk has so much room.
    let server = server
        .restart_with(|config| config.storage.min_free_bytes = u64::MAX)
        .await;
    let answer = server.get("/readyz").await;
    assert_eq!(
        (answer.status, answer.problem().as_str()),
        (StatusCode::INSUFFICIENT_STORAGE, "storage-full")
    );
    let mesh = server.get(&format!("{case}/mesh")).await;
    assert_eq!(mesh.status, StatusCode::OK);
}
