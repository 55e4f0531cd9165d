//! Series that are fetched from a node, and work that ends the program each time.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use case::JobKind;
use imaging::dicom::write::KeyObjectTitle;
use serde_json::{Value, json};

use crate::archive::Archive;
use crate::corrections::{corrected_head, note_of};
use crate::dicom::head_slices;
use crate::pacs::Neighbour;
use crate::results::{add_node, identified_case, identified_head, result, small, until_sent};
use crate::server::{Answer, Server};
use crate::until::until;

/// The series of the head.
const SERIES: &str = "1.2.3.1";

async fn fetch(server: &Server, node: &str, series: &str) -> Answer {
    let order = json!({"node": node, "study": "1.2.3", "series": series}).to_string();
    let order = Request::post("/v1/retrievals").body(Body::from(order));
    server.send(order.unwrap()).await
}

/// The ids of the listed retrievals, newest first.
async fn listed(server: &Server, query: &str) -> Vec<Value> {
    let list = server.get(&format!("/v1/retrievals?{query}")).await.json();
    let retrievals = list["retrievals"].as_array().unwrap().iter();
    retrievals.map(|each| each["id"].clone()).collect()
}

#[tokio::test]
async fn a_series_is_fetched_from_a_node_and_the_retrieval_leads_to_its_case() {
    let node = Archive::start().await;
    node.hold("1.2.3", SERIES, identified_head());
    let ours = Neighbour::start(|config| {
        add_node(config, "node", node.root());
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &ours.server;
    let accepted = fetch(server, "node", SERIES).await;
    assert_eq!(accepted.status, 202, "{accepted:?}");
    assert_eq!(accepted.json()["state"], "queued");
    let twice = fetch(server, "node", SERIES).await.json();
    assert_eq!(twice["id"], accepted.json()["id"], "it waits already");
    let elsewhere = fetch(server, "node", "1.2.3.99").await;

    let _background = pacs::start_transfers(server.pacs.clone());
    let fetched = until_sent(server, &accepted).await;
    assert_eq!(fetched["state"], "done", "{fetched}");
    let count = json!(head_slices().len());
    assert_eq!(
        (&fetched["received"], &fetched["expected"]),
        (&count, &count)
    );
    let failed = until_sent(server, &elsewhere).await;
    assert_eq!(
        (&failed["state"], &failed["attempts"]),
        (&json!("failed"), &json!(1))
    );

    let arrival = ours.settled().await;
    assert_eq!(arrival["source"], "retrieval");
    let fetched = server.get(accepted.header("location")).await.json();
    assert_eq!(fetched["case"], arrival["case"]);
    assert_eq!(fetched["arrival"], arrival["id"]);
    let case = arrival["case"].as_str().unwrap();
    let (done, failed) = (fetched["id"].clone(), failed["id"].clone());
    assert_eq!(listed(server, "").await, [failed.clone(), done.clone()]);
    assert_eq!(listed(server, "state=failed").await, [failed]);
    assert_eq!(listed(server, &format!("case={case}")).await, [done]);
    let other = "0".repeat(32);
    assert!(listed(server, &format!("case={other}")).await.is_empty());
}

#[tokio::test]
async fn a_retrieval_of_corrected_or_rejected_images_names_no_closed_case() {
    let node = Archive::start().await;
    node.hold("1.2.3", SERIES, identified_head());
    let ours = Neighbour::start(|config| add_node(config, "node", node.root())).await;
    let server = &ours.server;
    let _background = pacs::start_transfers(server.pacs.clone());
    let first = fetch(server, "node", SERIES).await;
    assert_eq!(until_sent(server, &first).await["state"], "done");
    let wrong = ours.settled().await["case"].clone();
    let corrected = corrected_head();
    node.hold("1.2.3", SERIES, corrected.clone());
    let second = fetch(server, "node", SERIES).await;
    assert_eq!(second.json()["case"], Value::Null);
    let fetched = until("the corrected images are a case", async || {
        let now = server.get(second.header("location")).await.json();
        assert_ne!(now["case"], wrong, "{now}");
        now["case"].is_string().then_some(now)
    })
    .await;
    let arrival = ours.settled().await;
    assert_eq!(fetched["case"], arrival["case"]);
    assert_eq!(arrival["corrected"], corrected.len());
    // One version of all images, not one of each batch: the case before it is that of the wrong patient.
    let list = server.get("/v1/cases").await.json();
    assert_eq!(list["cases"].as_array().unwrap().len(), 2, "{list}");
    let first = server.get(first.header("location")).await.json();
    assert_eq!(first["case"], arrival["case"]);
    // Rejected images are kept and not read, and the answer says why there is no case.
    let uids: Vec<_> = head_slices()
        .into_iter()
        .map(|slice| slice.sop_uid)
        .collect();
    let rejection = note_of(KeyObjectTitle::RejectedForSafety, &uids);
    assert_eq!(ours.store(&[rejection]).await.status, 200);
    let third = fetch(server, "node", SERIES).await;
    assert_eq!(until_sent(server, &third).await["state"], "done");
    until("the retrieval says why there is no case", async || {
        let now = server.get(third.header("location")).await.json();
        assert_eq!(now["case"], Value::Null, "{now}");
        (now["reason"]["name"] == "rejected").then_some(())
    })
    .await;
}

/// Takes a job as often as there is one, and ends each time without a word, as a killed process does.
async fn die_each_time(server: &Server, kind: JobKind, max_attempts: u32) {
    let store = server.state.cases.store();
    let mut attempts = 0;
    while store.claim(kind, max_attempts).await.unwrap().is_some() {
        attempts += 1;
        assert!(attempts <= max_attempts, "it is tried for ever");
        store.pass_time(Duration::from_secs(3600));
    }
    assert_eq!(attempts, max_attempts);
}

#[tokio::test]
async fn a_client_sees_that_work_that_ends_the_program_each_time_has_failed() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let view = json!({"what": "view", "render": small(), "node": "away"});
    let result = result(server, &case, &view).await;
    let retrieval = fetch(server, "away", "1.2.3.9").await;
    for (kind, attempts, accepted) in [
        (JobKind::new("send", "delivery"), 8, result),
        (JobKind::new("fetch", "retrieval"), 5, retrieval),
    ] {
        die_each_time(server, kind, attempts).await;
        let seen = until_sent(server, &accepted).await;
        assert_eq!(seen["state"], "failed", "{seen}");
        assert_eq!(seen["attempts"], attempts);
        let words = seen["reason"]["detail"].as_str().unwrap();
        let expected = format!("failed after {attempts} attempts");
        assert!(words.starts_with(&expected), "{words}");
    }
}
