//! Requests that are refused whatever is in the store, and what every answer carries.

use axum::body::Body;
use axum::http::Method;
use serde_json::json;

use super::server::Server;
use access::auth::Access;

const TOKEN: &str = "correct-horse-battery-staple";

const NOBODY: &str = "/v1/cases/00000000000000000000000000000000";

/// The address of a case that is not there.
fn of_nobody(path: &str) -> String {
    path.replace("{id}/nifti", "{id}/nifti?values=brain")
        .replace("/v1/cases/{id}", NOBODY)
        .replace("{plane}", "axial")
        .replace("{layer}", "blur")
        .replace("/profile", "/profile?position=0,0,0")
        .replace(
            "/registration",
            "/registration?with=00000000000000000000000000000000",
        )
}

/// Every operation under `/v1` of the description: its method, and an address of a case that is not there.
async fn operations(server: &Server) -> Vec<(Method, String)> {
    let description = server.get("/openapi.json").await.json();
    let mut found = Vec::new();
    for (path, item) in description["paths"].as_object().unwrap() {
        if !path.starts_with("/v1") {
            continue;
        }
        let address = of_nobody(path);
        for method in item.as_object().unwrap().keys() {
            let method = method.to_uppercase().parse().unwrap();
            found.push((method, address.clone()));
        }
    }
    assert!(found.len() > 15, "{found:?}");
    found
}

#[tokio::test]
async fn with_a_token_every_v1_route_requires_it() {
    let server = Server::start_with(Access::with_token(TOKEN).unwrap()).await;
    for (method, address) in operations(&server).await {
        let answer = server
            .ask(method.clone(), &address, &[], Body::empty())
            .await;
        assert_eq!(
            answer.refusal(),
            (401, "unauthorized".to_owned()),
            "{method} {address}"
        );
        assert!(answer.header("www-authenticate").starts_with("Bearer"));
    }
    let right = format!("Bearer {TOKEN}");
    for (authorization, status) in [
        (right.as_str(), 200),
        ("bearer correct-horse-battery-staple", 200),
        ("Bearer correct-horse-battery-stapl", 401),
        ("Bearer", 401),
        ("Basic Y29ycmVjdA==", 401),
    ] {
        let headers = [("authorization", authorization), ("host", "example.org")];
        let answer = server.get_with("/v1/cases", &headers).await;
        assert_eq!(answer.status, status, "{authorization}");
    }
    for open in ["/healthz", "/readyz", "/version", "/metrics", "/", "/docs"] {
        assert_eq!(server.get(open).await.status, 200, "{open}");
    }
}

#[tokio::test]
async fn a_case_that_is_not_there_is_not_found_by_any_route() {
    let server = Server::start().await;
    for (method, address) in operations(&server).await {
        if !address.starts_with(NOBODY) {
            continue;
        }
        let body = match method {
            Method::POST => Body::from(json!({"renders": [{}]}).to_string()),
            _ => Body::empty(),
        };
        let answer = server.ask(method.clone(), &address, &[], body).await;
        assert_eq!(
            answer.refusal(),
            (404, "no-such-case".to_owned()),
            "{method} {address}"
        );
    }
}

#[tokio::test]
async fn addresses_and_methods_that_there_are_not() {
    let server = Server::start().await;
    for (method, address, status, kind) in [
        (Method::GET, "/v1/nothing", 404, "no-such-address"),
        (Method::GET, "/main.css", 404, "no-such-address"),
        (Method::GET, "/v1/cases/abc", 404, "not-a-case-id"),
        (
            Method::GET,
            "/v1/cases/0000000000000000000000000000000A",
            404,
            "not-a-case-id",
        ),
        (Method::GET, "/v1/cases/abc/mesh", 404, "not-a-case-id"),
        (Method::DELETE, "/v1/cases/%2e%2e", 404, "not-a-case-id"),
        (Method::PUT, "/v1/cases", 405, "method-not-allowed"),
        (Method::POST, NOBODY, 405, "method-not-allowed"),
        (Method::PATCH, "/healthz", 405, "method-not-allowed"),
        (Method::DELETE, "/", 405, "method-not-allowed"),
    ] {
        let answer = server.ask(method, address, &[], Body::empty()).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{address}");
    }
    let plane = format!("{NOBODY}/slices/diagonal");
    assert_eq!(
        server.get(&plane).await.refusal(),
        (404, "no-such-address".to_owned())
    );
    // Which plane it is depends on the map of a case.
    let oblique = format!("{NOBODY}/slices/oblique?position=0,0,0");
    assert_eq!(
        server.get(&oblique).await.refusal(),
        (404, "no-such-case".to_owned())
    );
}

#[tokio::test]
async fn bodies_have_no_coding() {
    let server = Server::start().await;
    for (coding, expected) in [
        ("gzip", (415, "content-encoding")),
        ("identity", (415, "unsupported-media-type")),
    ] {
        let headers = [("content-encoding", coding)];
        let answer = server
            .ask(Method::POST, "/v1/cases", &headers, Body::from("x"))
            .await;
        let (status, kind) = answer.refusal();
        assert_eq!((status.into(), kind.as_str()), expected);
    }
}

#[tokio::test]
async fn media_types_are_refused_where_the_description_says_so() {
    let server = Server::start().await;
    let description = server.get("/openapi.json").await.json();
    let mut count = 0;
    for (path, item) in description["paths"].as_object().unwrap() {
        if !path.contains("{id}") || item["get"].is_null() {
            continue;
        }
        let is_negotiated = item["get"]["responses"]["406"].is_object();
        count += usize::from(is_negotiated);
        let expected = match is_negotiated {
            true => (406, "not-acceptable".to_owned()),
            false => (404, "no-such-case".to_owned()),
        };
        let headers = [("accept", "text/x-nothing")];
        let answer = server.get_with(&of_nobody(path), &headers).await;
        assert_eq!(answer.refusal(), expected, "{path}");
    }
    assert!(count >= 14, "{count} routes negotiate");
}

#[tokio::test]
async fn pages_of_other_sites_and_other_names_are_refused() {
    let server = Server::start().await;
    let own = ("host", "127.0.0.1:8640");
    for (method, headers, status) in [
        (Method::GET, vec![own], 404),
        (Method::GET, vec![("host", "localhost:8640")], 404),
        (Method::GET, vec![("host", "[::1]:8640")], 404),
        (Method::GET, vec![("host", "rebound.example.org")], 421),
        (
            Method::GET,
            vec![own, ("sec-fetch-site", "cross-site")],
            404,
        ),
        (
            Method::DELETE,
            vec![own, ("sec-fetch-site", "cross-site")],
            403,
        ),
        (
            Method::DELETE,
            vec![own, ("sec-fetch-site", "same-site")],
            403,
        ),
        (
            Method::DELETE,
            vec![own, ("sec-fetch-site", "same-origin")],
            404,
        ),
        (Method::DELETE, vec![own, ("origin", "null")], 403),
        (
            Method::DELETE,
            vec![own, ("origin", "http://evil.example.org")],
            403,
        ),
        (
            Method::DELETE,
            vec![own, ("origin", "http://127.0.0.1:8641")],
            403,
        ),
        (
            Method::DELETE,
            vec![own, ("origin", "http://127.0.0.1:8640")],
            404,
        ),
        (Method::DELETE, vec![own], 404),
    ] {
        let answer = server
            .ask(method.clone(), NOBODY, &headers, Body::empty())
            .await;
        let kind = match status {
            403 => "cross-site",
            421 => "wrong-host",
            _ => "no-such-case",
        };
        assert_eq!(
            answer.refusal(),
            (status, kind.to_owned()),
            "{method} {headers:?}"
        );
    }
}

#[tokio::test]
async fn every_answer_carries_the_security_headers_and_an_id() {
    const RANDOM: &str = "0af76519-16cd-43dd-8448-eb211c80319c";
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
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cross-origin-resource-policy", "same-origin"),
            ("cross-origin-opener-policy", "same-origin"),
            ("access-control-allow-origin", ""),
        ] {
            assert_eq!(answer.header(name), value, "{address} {name}");
        }
        let policy = answer.header("content-security-policy");
        assert!(policy.contains("frame-ancestors 'self'"), "{policy}");
        assert!(!answer.header("x-request-id").is_empty(), "{address}");
    }
    for (id, is_kept) in [(RANDOM, true), ("a b", false), ("Smith-1967", false)] {
        let answer = server.get_with("/healthz", &[("x-request-id", id)]).await;
        assert_eq!(answer.header("x-request-id") == id, is_kept, "{id}");
    }
}

#[tokio::test]
async fn the_list_has_pages() {
    let server = Server::start().await;
    let (volume, mask) = super::server::head();
    for radius in [8, 9] {
        let parameters = format!("{{\"closing_radius_mm\": {radius}}}");
        let parts = [
            ("volume", &volume[..]),
            ("mask", mask),
            ("parameters", parameters.as_bytes()),
        ];
        assert_eq!(server.upload(&parts).await.status, 202);
    }
    let first = server.get("/v1/cases?limit=1").await.json();
    assert_eq!(first["cases"].as_array().unwrap().len(), 1);
    let next = first["next"].as_str().unwrap();
    let second = server
        .get(&format!("/v1/cases?limit=1&after={next}"))
        .await
        .json();
    assert_eq!(second["cases"].as_array().unwrap().len(), 1);
    assert_ne!(first["cases"][0]["id"], second["cases"][0]["id"]);
    assert!(second["next"].is_null());
}
