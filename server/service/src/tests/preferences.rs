//! What named users keep for themselves: one document each, which nobody else reads or overwrites.

use axum::http::Method;
use serde_json::json;

use super::readings::{ANA, BEN, NOBODY, VIEWER, get, with_readers};
use super::server::{Answer, Server};

const ADDRESS: &str = "/v1/preferences";

async fn put(server: &Server, who: &str, tag: &str, body: String) -> Answer {
    let headers = [("authorization", who), ("if-match", tag)];
    server.ask(Method::PUT, ADDRESS, &headers, body).await
}

#[tokio::test]
async fn preferences_are_of_one_user_whatever_they_may_do() {
    let (server, ..) = with_readers().await;
    let none = get(&server, ANA, ADDRESS).await;
    assert_eq!((none.status, none.json()), (200, json!({})));
    let chosen = json!({"choices": {"theme": "light"}, "layouts": [{"name": "À esquerda"}]});
    let kept = put(&server, ANA, none.header("etag"), chosen.to_string()).await;
    assert_eq!((kept.status, kept.json()), (200, chosen.clone()));
    let read = get(&server, ANA, ADDRESS).await;
    assert_eq!(
        (read.json(), read.header("etag")),
        (chosen.clone(), kept.header("etag"))
    );
    // Who may only look chooses as well, and nobody by the version of another; others do not see it.
    let anas = none.header("etag");
    let body = || "{\"a\": 1}".to_owned();
    let strange = put(&server, VIEWER, anas, body()).await;
    assert_eq!(strange.refusal(), (412, "preferences-changed".to_owned()));
    let viewers = put(&server, VIEWER, strange.header("etag"), body()).await;
    assert_eq!(viewers.status, 200, "{viewers:?}");
    assert_eq!(get(&server, BEN, ADDRESS).await.json(), json!({}));

    let late = put(&server, ANA, none.header("etag"), "{}".to_owned()).await;
    assert_eq!(late.refusal(), (412, "preferences-changed".to_owned()));
    assert_eq!(late.json()["preferences"], chosen);
    assert_eq!(late.header("etag"), kept.header("etag"));

    let headers = [("authorization", ANA)];
    let gone = server.ask(Method::DELETE, ADDRESS, &headers, "").await;
    assert_eq!(gone.status, 204);
    assert_eq!(get(&server, ANA, ADDRESS).await.json(), json!({}));
    assert_eq!(get(&server, VIEWER, ADDRESS).await.json(), json!({"a": 1}));
}

#[tokio::test]
async fn preferences_need_a_name_and_are_an_object_of_bounded_size() {
    let (server, ..) = with_readers().await;
    let unnamed = get(&server, NOBODY, ADDRESS).await;
    assert_eq!(unnamed.refusal(), (403, "reader-unnamed".to_owned()));
    let tag = get(&server, ANA, ADDRESS).await.header("etag").to_owned();
    let unnamed = put(&server, NOBODY, &tag, "{}".to_owned()).await;
    assert_eq!(unnamed.refusal(), (403, "reader-unnamed".to_owned()));
    let headers = [("authorization", ANA)];
    let unmatched = server.ask(Method::PUT, ADDRESS, &headers, "{}").await;
    assert_eq!(unmatched.refusal(), (428, "if-match-missing".to_owned()));
    for body in ["", "[]", "3", "{\"a\":"] {
        let refused = put(&server, ANA, &tag, body.to_owned()).await;
        assert_eq!(
            refused.refusal(),
            (400, "body-unreadable".to_owned()),
            "{body}"
        );
    }
    let of_length =
        |bytes: usize| json!({"a": "x".repeat(bytes - r#"{"a":""}"#.len())}).to_string();
    let large = put(&server, ANA, &tag, of_length((64 << 10) + 1)).await;
    assert_eq!(large.status, 413, "{large:?}");
    assert_eq!(get(&server, ANA, ADDRESS).await.json(), json!({}));
    let kept = put(&server, ANA, &tag, of_length(64 << 10)).await;
    assert_eq!(kept.status, 200, "{kept:?}");
}
