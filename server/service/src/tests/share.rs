//! A case as one file: what it holds is what the server answers, and nothing of it runs but the page.

use std::io::Read as _;

use axum::http::Method;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use case::CaseId;
use serde_json::{Value, json};

use super::report::mark;
use super::server::{Server, head};
use crate::wire;

/// The data of a class in a file.
fn data<'a>(html: &'a str, class: &str) -> Vec<&'a str> {
    let begin = format!("<script type=\"text/plain\" class=\"{class}\">");
    let parts = html.split(&*begin).skip(1);
    parts
        .map(|part| part.split_once("</script>").unwrap().0)
        .collect()
}

/// The answers in a file: what it says of each, and its bytes as they are written.
fn answers(html: &str) -> Vec<(Value, Vec<u8>)> {
    let abouts = data(html, "answer-about").into_iter();
    let answers = abouts.zip(data(html, "answer"));
    let unpacked = answers.map(|(about, base64)| {
        let packed = STANDARD.decode(base64).unwrap();
        let mut bytes = Vec::new();
        let mut reader = flate2::read::GzDecoder::new(&*packed);
        reader.read_to_end(&mut bytes).unwrap();
        (serde_json::from_str(about).unwrap(), bytes)
    });
    unpacked.collect()
}

#[tokio::test]
async fn the_file_holds_what_the_server_answers_and_runs_the_page_alone() {
    let (server, case) = Server::with_case().await;
    mark(
        &server,
        &case,
        &[("a", [25.0, 0.0, 0.0], "</script><script>alert(1)</script>")],
    )
    .await;
    let address = format!("{case}/share");
    let shared = server.get(&address).await;
    assert_eq!(shared.status, 200, "{:?}", shared.headers);
    assert_eq!(shared.header("content-type"), "text/html; charset=utf-8");
    let id = case.rsplit('/').next().unwrap();
    assert_eq!(
        shared.header("content-disposition"),
        format!("attachment; filename=\"isocortex-{}.html\"", &id[..8])
    );
    assert_eq!(shared.header("cache-control"), "private, no-cache");
    let known = [("if-none-match", shared.header("etag"))];
    assert_eq!(server.get_with(&address, &known).await.status, 304);

    let html = std::str::from_utf8(&shared.body).unwrap();
    assert!(html.contains("<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'sha256-"));
    assert!(!html.contains("connect-src") && !html.contains("unsafe-inline"));
    assert!(!html.contains("<script>alert") && html.contains("&lt;script&gt;alert(1)"));
    assert_eq!(html.matches("<script type=\"module\">").count(), 1);
    // The words of the report without its pictures.
    assert!(html.contains("<article lang=\"en\">") && !html.contains("<image"));

    let about: Value = serde_json::from_str(data(html, "about")[0]).unwrap();
    assert_eq!(about["id"], id);
    assert_eq!(about["volume"]["extent"], "whole");
    assert_eq!(about["patient"], "");
    let answers = answers(html);
    for (about, bytes) in &answers {
        let path = about["path"].as_str().unwrap();
        let answer = server.get(&format!("{case}{path}")).await;
        assert_eq!(answer.status, 200, "{path}");
        if answer.header("content-type") == "application/json" {
            let (mut own, held) = (
                answer.json(),
                serde_json::from_slice::<Value>(bytes).unwrap(),
            );
            for name in ["links", "previous", "next", "expires_at"] {
                own.as_object_mut().unwrap().remove(name);
            }
            assert_eq!(own, held, "{path}");
            continue;
        }
        assert_eq!(about["are_differences"], true);
        assert_eq!(&wire::differences(&answer.body), bytes, "{path}");
        for (name, value) in about["headers"].as_object().unwrap() {
            assert_eq!(answer.header(name), value.as_str().unwrap(), "{path}");
        }
    }
    let paths: Vec<_> = answers
        .iter()
        .map(|(about, _)| about["path"].as_str().unwrap())
        .collect();
    let whole = ["", "/findings", "/distance", "/volume?bits=16&extent=whole"];
    assert_eq!(paths[..4], whole);

    let portuguese = server.get(&format!("{address}?language=pt-BR")).await;
    let text = String::from_utf8_lossy(&portuguese.body).into_owned();
    assert!(text.contains("<article lang=\"pt-BR\">"));
}

#[tokio::test]
async fn nothing_is_loaded_for_a_file_before_its_turn() {
    let (server, case) = Server::with_case().await;
    let id = CaseId::parse(case.rsplit('/').next().unwrap()).unwrap();
    let (queue, router) = (server.cases.queue.clone(), &server);
    let all_waiting = async |count| {
        while queue.waiting() != count {
            tokio::task::yield_now().await;
        }
    };
    let mut held = vec![queue.turn().await.unwrap(), queue.turn().await.unwrap()];
    let address = format!("{case}/share");
    let between = async {
        // The report waits; who comes after it has the turn before the file.
        all_waiting(1).await;
        let mut next = Box::pin(queue.turn());
        assert!(futures_util::poll!(&mut next).is_pending());
        held.pop();
        let next = next.await.unwrap();
        all_waiting(1).await;
        server.cases.delete(&id).await.unwrap();
        drop((held, next));
    };
    let (shared, ()) = tokio::join!(router.get(&address), between);
    assert_eq!(shared.refusal(), (404, "no-such-case".to_owned()));
}

#[tokio::test]
async fn what_names_the_patient_is_kept_by_no_cache_and_has_the_label_alone() {
    let (server, case) = Server::with_case().await;
    let label = json!({ "name": "Ana Silva" }).to_string();
    let renamed = server.ask(Method::PATCH, &case, &[], label).await;
    assert_eq!(renamed.status, 200, "{renamed:?}");
    for (query, cache, has_label) in [
        ("", "private, no-cache", false),
        ("?patient=true", "no-store", true),
    ] {
        let shared = server.get(&format!("{case}/share{query}")).await;
        assert_eq!(shared.status, 200, "{:?}", shared.headers);
        assert_eq!(shared.header("cache-control"), cache);
        let html = std::str::from_utf8(&shared.body).unwrap();
        assert_eq!(html.contains("Ana Silva"), has_label);
        let (_, described) = &answers(html)[0];
        let described: Value = serde_json::from_slice(described).unwrap();
        assert_eq!(described["name"] == "Ana Silva", has_label);
    }
}

#[tokio::test]
async fn a_case_that_is_not_ready_is_not_handed_on() {
    let server = Server::start().await;
    let (volume, mask) = head();
    let answer = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let case = answer.header("location").to_owned();
    for (query, status, kind) in [
        ("", 409, "case-not-ready"),
        ("?fruit=1", 400, "query-unknown-key"),
    ] {
        let answer = server.get(&format!("{case}/share{query}")).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{query}");
    }
}
