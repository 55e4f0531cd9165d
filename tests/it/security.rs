//! Who may ask, and what every answer carries.

use axum::body::Body;
use axum::http::{Request, StatusCode};
use isocortex::config::Secret;

use crate::server::Server;

const TOKEN: &str = "correct-horse-battery-staple";

#[tokio::test]
async fn with_a_token_every_v1_route_wants_it() {
    let server =
        Server::start_with(|config| config.http.token = Some(Secret(TOKEN.to_owned()))).await;
    let none = "/v1/cases/00000000000000000000000000000000";
    let description = server.get("/openapi.json").await.json();
    let paths = description["paths"].as_object().unwrap();
    for (path, item) in paths.iter().filter(|(path, _)| path.starts_with("/v1")) {
        for method in item.as_object().unwrap().keys() {
            let address = path
                .replace("/v1/cases/{id}", none)
                .replace("{plane}", "axial");
            let request = Request::builder()
                .method(method.to_uppercase().as_str())
                .uri(&address);
            let answer = server.send(request.body(Body::empty()).unwrap()).await;
            assert_eq!(answer.problem(), "unauthorized", "{method} {path}");
            assert_eq!(answer.status, StatusCode::UNAUTHORIZED);
            assert!(answer.header("www-authenticate").starts_with("Bearer"));
        }
    }
    let right = format!("Bearer {TOKEN}");
    assert_eq!(
        server
            .get_with("/v1/cases", &[("authorization", &right)])
            .await
            .status,
        200
    );
    for wrong in [
        "Bearer correct-horse-battery-stapl",
        "Bearer",
        "Basic Y29ycmVjdA==",
    ] {
        let answer = server
            .get_with("/v1/cases", &[("authorization", wrong)])
            .await;
        assert_eq!(answer.status, StatusCode::UNAUTHORIZED, "{wrong}");
    }
    assert_eq!(server.get("/healthz").await.status, 200);
}

#[tokio::test]
async fn without_a_token_other_names_are_refused() {
    let server = Server::start().await;
    let host = async |host: &str| server.get_with("/v1/cases", &[("host", host)]).await;
    for own in ["localhost:8640", "127.0.0.1:8640", "[::1]:8640"] {
        assert_eq!(host(own).await.status, 200, "{own}");
    }
    let answer = host("rebound.example.org").await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (421, "wrong-host")
    );
}

#[tokio::test]
async fn pages_of_other_sites_cannot_upload_or_delete() {
    let server = Server::start().await;
    let request = Request::post("/v1/cases").header("sec-fetch-site", "cross-site");
    let answer = server.send(request.body(Body::empty()).unwrap()).await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (403, "cross-site")
    );
}

#[tokio::test]
async fn what_comes_from_another_origin_changes_nothing() {
    let server = Server::start().await;
    let none = "/v1/cases/00000000000000000000000000000000";
    let delete = async |origin: &str| {
        let request = Request::delete(none)
            .header("host", "127.0.0.1:8640")
            .header("origin", origin);
        server.send(request.body(Body::empty()).unwrap()).await
    };
    for other in ["null", "http://evil.example.org", "http://127.0.0.1:8641"] {
        let answer = delete(other).await;
        assert_eq!(answer.status.as_u16(), 403, "{other}");
        assert_eq!(answer.problem(), "cross-site", "{other}");
    }
    assert_eq!(delete("http://127.0.0.1:8640").await.status, 404);
}

const RANDOM_ID: &str = "0af76519-16cd-43dd-8448-eb211c80319c";

#[tokio::test]
async fn every_answer_carries_the_security_headers_and_an_id() {
    let server = Server::start().await;
    for address in [
        "/",
        "/docs",
        "/healthz",
        "/v1/cases",
        "/nothing",
        "/v1/cases/x/mesh",
    ] {
        let answer = server.get(address).await;
        assert_eq!(
            answer.header("x-content-type-options"),
            "nosniff",
            "{address}"
        );
        assert_eq!(answer.header("referrer-policy"), "no-referrer");
        assert_eq!(answer.header("cross-origin-resource-policy"), "same-origin");
        assert!(
            answer
                .header("content-security-policy")
                .contains("frame-ancestors 'none'")
        );
        assert!(!answer.header("x-request-id").is_empty(), "{address}");
        assert_eq!(answer.header("access-control-allow-origin"), "");
    }
    let answer = server
        .get_with("/healthz", &[("x-request-id", RANDOM_ID)])
        .await;
    assert_eq!(answer.header("x-request-id"), RANDOM_ID);
    for words in ["a b", "Smith-1967"] {
        let answer = server
            .get_with("/healthz", &[("x-request-id", words)])
            .await;
        assert_ne!(answer.header("x-request-id"), words);
    }
}
