//! Answers that never change: tags, 304, HEAD, ranges, codings.

use std::io::Read as _;
use std::time::Duration;

use axum::body::Body;
use axum::http::Method;
use bytes::Bytes;
use cases::jobs::start_workers;
use flate2::read::GzDecoder;

use super::server::Server;

/// Every route that never changes, the media type of its answer, and on which header of the request it depends.
const ROUTES: [(&str, &str, &str); 13] = [
    ("mesh?depth_mm=8", "application/octet-stream", "accept"),
    (
        "mesh/triangles",
        "application/octet-stream",
        "accept-encoding",
    ),
    (
        "mesh/paths",
        "application/vnd.isocortex.paths",
        "accept-encoding",
    ),
    ("volume", "application/octet-stream", "accept-encoding"),
    (
        "volume?extent=whole",
        "application/octet-stream",
        "accept-encoding",
    ),
    ("distance", "application/octet-stream", "accept-encoding"),
    (
        "render?depth_mm=8&width=64&height=64",
        "image/png",
        "accept",
    ),
    ("slices/axial?width=64&height=64", "image/png", "accept"),
    (
        "slices/oblique?position=0,0,0&width=64&height=64",
        "image/png",
        "accept",
    ),
    ("acquired/axial?width=64&height=64", "image/png", "accept"),
    ("mask", "application/gzip", "accept"),
    ("envelope", "application/gzip", "accept"),
    ("quality", "image/png", "accept"),
];

#[tokio::test]
async fn what_is_known_is_not_sent_again() {
    let (server, case) = Server::with_case().await;
    for (route, kind, vary) in ROUTES {
        let address = format!("{case}/{route}");
        let first = server.get(&address).await;
        let tag = first.header("etag").to_owned();
        assert!(tag.starts_with('"') && tag.ends_with('"'), "{tag}");
        assert_eq!(first.header("content-type"), kind, "{route}");
        for known in [
            tag.clone(),
            format!("W/{tag}"),
            format!("\"other\", {tag}"),
            "*".to_owned(),
        ] {
            let again = server
                .get_with(&address, &[("if-none-match", &known)])
                .await;
            assert_eq!(
                (again.status, again.body.len()),
                (304, 0),
                "{route} {known}"
            );
            for name in ["etag", "cache-control", "vary", "x-isocortex-quality"] {
                assert_eq!(again.header(name), first.header(name), "{route} {name}");
            }
        }
        assert_eq!(
            first.header("cache-control"),
            "private, max-age=31536000, immutable"
        );
        assert_eq!(first.header("vary"), vary, "{route}");
        let other = server
            .get_with(&address, &[("if-none-match", "\"other\"")])
            .await;
        assert!(
            other.body == first.body,
            "{route}: the same bytes each time"
        );
    }
}

#[tokio::test]
async fn head_tells_what_get_would() {
    let (server, case) = Server::with_case().await;
    for (route, ..) in ROUTES {
        let address = format!("{case}/{route}");
        let get = server.get(&address).await;
        let head = server.ask(Method::HEAD, &address, &[], Body::empty()).await;
        assert_eq!((head.status, head.body.len()), (200, 0), "{route}");
        for name in ["etag", "content-type", "cache-control", "vary"] {
            assert_eq!(head.header(name), get.header(name), "{route} {name}");
        }
        assert_eq!(head.header("content-length"), get.body.len().to_string());
    }
}

#[tokio::test]
async fn a_case_that_is_not_ready_is_never_known() {
    let server = Server::start().await;
    let (volume, mask) = super::server::head();
    let waiting = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let waiting = waiting.header("location").to_owned();
    let nobody = format!("/v1/cases/{}", "0".repeat(32));
    for (case, status, kind) in [
        (waiting, 409, "case-not-ready"),
        (nobody, 404, "no-such-case"),
    ] {
        for (route, ..) in ROUTES {
            if status == 409 && route.starts_with("acquired") {
                continue;
            }
            let address = format!("{case}/{route}");
            let answer = server.get_with(&address, &[("if-none-match", "*")]).await;
            assert_eq!(answer.refusal(), (status, kind.to_owned()), "{route}");
        }
    }
}

#[tokio::test]
async fn what_was_acquired_is_shown_before_the_case_is_ready_and_does_not_change() {
    let server = Server::start().await;
    let (volume, mask) = super::server::head();
    let waiting = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let case = waiting.header("location").to_owned();
    let route = |plane: &str| format!("{case}/acquired/{plane}?width=96&height=96");
    let planes = ["axial", "coronal", "sagittal"];
    let mut early = Vec::new();
    for plane in planes {
        let answer = server.get(&route(plane)).await;
        assert_eq!(answer.status, 200, "{plane}: {answer:?}");
        assert_eq!(server.get(&case).await.json()["state"], "queued");
        early.push(answer);
    }
    assert!(early[0].body != early[1].body && early[1].body != early[2].body);
    let annotated = server
        .get(&format!("{case}/acquired/axial?annotate=true"))
        .await;
    assert_eq!(annotated.header("cache-control"), "private, no-cache");
    let plain = server.get(&format!("{case}/acquired/axial")).await;
    assert!(annotated.body != plain.body);
    let workers = start_workers(server.cases.library.clone(), 1);
    assert_eq!(server.settled(&case).await, "ready");
    workers.shut_down(Duration::from_secs(60)).await;
    for (plane, early) in planes.into_iter().zip(early) {
        let late = server.get(&route(plane)).await;
        assert_eq!(late.header("etag"), early.header("etag"), "{plane}");
        assert!(late.body == early.body, "{plane}: the same bytes");
    }
    server.ask(Method::DELETE, &case, &[], Body::empty()).await;
    assert_eq!(server.get(&route("axial")).await.status, 404);
    let oblique = server.get(&route("oblique")).await;
    assert_eq!(oblique.refusal(), (404, "no-such-address".to_owned()));
}

#[tokio::test]
async fn what_is_deleted_is_gone_though_it_was_known() {
    let (server, case) = Server::with_case().await;
    let address = format!("{case}/volume");
    let zstd = [("accept-encoding", "zstd")];
    let known = server.get_with(&address, &zstd).await;
    let deleted = server.ask(Method::DELETE, &case, &[], Body::empty()).await;
    assert_eq!((deleted.status, deleted.body.len()), (204, 0));
    let tag = [("if-none-match", known.header("etag"))];
    for headers in [&zstd, &tag] {
        let answer = server.get_with(&address, headers).await;
        assert_eq!(answer.refusal(), (404, "no-such-case".to_owned()));
    }
    let again = server.ask(Method::DELETE, &case, &[], Body::empty()).await;
    assert_eq!(again.refusal(), (404, "no-such-case".to_owned()));
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn ranges_are_cut_from_large_bodies() {
    let (server, case) = Server::with_case().await;
    for route in ["volume", "mask", "envelope"] {
        let address = format!("{case}/{route}");
        let whole = server.get(&address).await;
        let (length, tag) = (whole.body.len(), whole.header("etag"));
        assert_eq!(whole.header("accept-ranges"), "bytes");
        let end = length - 10;
        for (range, condition, expected) in [
            ("bytes=100-199", None, Some((100, 199))),
            ("bytes=0-0", Some(tag), Some((0, 0))),
            ("bytes=-10", None, Some((end, length - 1))),
            ("bytes=100-", None, Some((100, length - 1))),
            ("bytes=0-999999999", None, Some((0, length - 1))),
            ("bytes=0-9", Some("\"other\""), None),
            ("bytes=0-9,20-29", None, None),
            ("bytes=9-0", None, None),
        ] {
            // A range counts the bytes that are documented, whatever coding is welcome.
            let mut headers = vec![("range", range), ("accept-encoding", "zstd")];
            headers.extend(condition.map(|tag| ("if-range", tag)));
            let part = server.get_with(&address, &headers).await;
            let Some((first, last)) = expected else {
                assert_eq!((part.status, part.body.len()), (200, length), "{range}");
                continue;
            };
            assert_eq!(part.status, 206, "{range}");
            assert_eq!(part.body, whole.body[first..=last], "{range}");
            let said = format!("bytes {first}-{last}/{length}");
            assert_eq!(part.header("content-range"), said);
        }
        let beyond = server
            .get_with(&address, &[("range", "bytes=999999999-")])
            .await;
        assert_eq!(beyond.refusal(), (416, "range-not-satisfiable".to_owned()));
        assert_eq!(beyond.header("content-range"), format!("bytes */{length}"));
    }
}

fn unpacked(coding: &str, body: &[u8]) -> Bytes {
    match coding {
        "zstd" => zstd::stream::decode_all(body).unwrap().into(),
        "gzip" => {
            let mut bytes = Vec::new();
            GzDecoder::new(body).read_to_end(&mut bytes).unwrap();
            bytes.into()
        }
        _ => Bytes::copy_from_slice(body),
    }
}

#[tokio::test]
async fn large_bodies_come_compressed_where_that_is_welcome() {
    let (server, case) = Server::with_case().await;
    for route in ["volume", "distance", "mesh/paths", "mesh/triangles"] {
        let address = format!("{case}/{route}");
        let plain = server.get(&address).await;
        let mut tags = vec![plain.header("etag").to_owned()];
        for (accepted, coding) in [
            ("gzip, br, zstd", "zstd"),
            ("gzip", "gzip"),
            ("zstd;q=0.5, gzip;q=1", "gzip"),
            ("*", "zstd"),
            ("br", ""),
            ("zstd;q=0", ""),
            ("identity, zstd;q=0.5", ""),
        ] {
            let answer = server
                .get_with(&address, &[("accept-encoding", accepted)])
                .await;
            assert_eq!(
                answer.header("content-encoding"),
                coding,
                "{route} {accepted}"
            );
            assert!(
                unpacked(coding, &answer.body) == plain.body,
                "{route} {accepted}"
            );
            assert_eq!(answer.body.len() < plain.body.len(), !coding.is_empty());
            tags.push(answer.header("etag").to_owned());
        }
        tags.sort();
        tags.dedup();
        assert_eq!(tags.len(), 3, "{route}: each coding has a tag of its own");
    }
    for route in ["render", "mask"] {
        let headers = [("accept-encoding", "zstd")];
        let packed = server.get_with(&format!("{case}/{route}"), &headers).await;
        assert_eq!(
            packed.header("content-encoding"),
            "",
            "{route} is packed already"
        );
    }
}

#[tokio::test]
async fn a_mesh_comes_in_the_form_that_is_liked_best() {
    let (server, case) = Server::with_case().await;
    let address = format!("{case}/mesh?depth_mm=8");
    let mut tags = Vec::new();
    for (accepted, kind, magic) in [
        ("*/*", "application/octet-stream", &b""[..]),
        ("model/*", "model/gltf-binary", b"glTF"),
        ("model/gltf-binary", "model/gltf-binary", b"glTF"),
        ("model/stl;q=0.5, model/obj", "model/obj", b"#"),
        ("application/ply, */*;q=0.1", "application/ply", b"ply\n"),
        ("model/gifti+xml", "model/gifti+xml", b"<?xml"),
        (
            "application/x-freesurfer",
            "application/x-freesurfer",
            b"\xff\xff\xfe",
        ),
    ] {
        let answer = server.get_with(&address, &[("accept", accepted)]).await;
        assert_eq!(answer.header("content-type"), kind, "{accepted}");
        assert!(answer.body.starts_with(magic), "{accepted}");
        tags.push(answer.header("etag").to_owned());
    }
    tags.sort();
    tags.dedup();
    assert_eq!(tags.len(), 6, "the same form has the same tag");
}

#[tokio::test]
async fn documents_are_asked_for_again_each_time() {
    let server = Server::start().await;
    for (address, kind) in [
        ("/", "text/html; charset=utf-8"),
        ("/?renderer=server", "text/html; charset=utf-8"),
        ("/openapi.json", "application/json"),
        ("/docs", "text/html; charset=utf-8"),
    ] {
        let first = server
            .get_with(address, &[("accept-encoding", "gzip")])
            .await;
        assert_eq!(
            (first.status, first.header("content-type")),
            (200, kind),
            "{address}"
        );
        assert_eq!(first.header("cache-control"), "no-cache");
        assert_eq!(first.header("content-encoding"), "gzip");
        let headers = [
            ("accept-encoding", "gzip"),
            ("if-none-match", first.header("etag")),
        ];
        let again = server.get_with(address, &headers).await;
        assert_eq!((again.status, again.body.len()), (304, 0), "{address}");
        let plain = server.get_with(address, &headers[1..]).await;
        assert_eq!(
            plain.status, 200,
            "{address}: another coding has another tag"
        );
        assert!(unpacked("gzip", &first.body) == plain.body, "{address}");
    }
}

#[tokio::test]
async fn scripts_of_the_page_are_kept_for_ever_in_the_coding_that_the_client_prefers() {
    let server = Server::start().await;
    let page = server.get("/").await;
    let page = String::from_utf8(page.body.to_vec()).unwrap();
    let mut scripts = page.split('"').filter(|word| word.ends_with(".js"));
    let address = scripts.next().unwrap().trim_start_matches('.').to_owned();
    let mut lengths = Vec::new();
    for (accepted, coding) in [
        ("gzip, deflate, br, zstd", "br"),
        ("gzip, deflate", "gzip"),
        ("identity", ""),
    ] {
        let answer = server
            .get_with(&address, &[("accept-encoding", accepted)])
            .await;
        assert_eq!(answer.status, 200, "{address}");
        assert_eq!(answer.header("content-encoding"), coding);
        assert_eq!(
            answer.header("content-type"),
            "text/javascript; charset=utf-8"
        );
        assert_eq!(
            answer.header("cache-control"),
            "public, max-age=31536000, immutable"
        );
        lengths.push(answer.body.len());
    }
    assert!(lengths.is_sorted(), "{lengths:?}");
}
