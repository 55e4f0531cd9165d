//! Answers that never change: tags, 304, HEAD, ranges, codings.

use axum::http::{Method, StatusCode};
use bytes::Bytes;

use crate::server::Server;

const ROUTES: [&str; 10] = [
    "mesh?depth_mm=8",
    "mesh/triangles",
    "mesh/paths",
    "volume",
    "distance",
    "render?depth_mm=8&width=64&height=64",
    "slices/axial?width=64&height=64",
    "mask",
    "envelope",
    "quality",
];

#[tokio::test]
async fn what_is_known_is_not_sent_again() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for route in ROUTES {
        let address = format!("{case}/{route}");
        let first = server.get(&address).await;
        let tag = first.header("etag");
        assert!(tag.starts_with('"') && tag.ends_with('"'), "{tag}");
        assert_eq!(
            first.header("cache-control"),
            "private, max-age=31536000, immutable"
        );
        let again = server.get_with(&address, &[("if-none-match", tag)]).await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED, "{route}");
        assert_eq!(again.header("etag"), tag);
        assert!(again.body.is_empty());
        let other = server
            .get_with(&address, &[("if-none-match", "\"other\"")])
            .await;
        assert_eq!(other.body, first.body, "{route}: the same bytes each time");
    }
}

#[tokio::test]
async fn the_order_and_spelling_of_a_query_do_not_matter() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let tag = async |query: &str| {
        let answer = server.get(&format!("{case}/mesh?{query}")).await;
        answer.header("etag").to_owned()
    };
    let expected = tag("depth_mm=8&contours=30").await;
    assert_eq!(tag("contours=30&depth_mm=8.0&paths=forest").await, expected);
    assert_eq!(tag("depth_mm=8e0").await, expected);
    assert_ne!(tag("depth_mm=8.5").await, expected);
    let glb = server
        .get_with(
            &format!("{case}/mesh?depth_mm=8"),
            &[("accept", "model/gltf-binary")],
        )
        .await;
    assert_ne!(glb.header("etag"), expected);
    assert_eq!(glb.header("vary"), "accept");
}

#[tokio::test]
async fn head_tells_what_get_would() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for route in ROUTES {
        let address = format!("{case}/{route}");
        let get = server.get(&address).await;
        let head = server.method(Method::HEAD, &address).await;
        assert_eq!(head.status, StatusCode::OK);
        assert!(head.body.is_empty());
        assert_eq!(head.header("etag"), get.header("etag"));
        assert_eq!(
            head.header("content-length"),
            get.body.len().to_string(),
            "{route}"
        );
    }
}

#[tokio::test]
async fn ranges_are_cut_from_large_bodies() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for route in ["volume", "mask", "envelope"] {
        ranges_of(&server, &format!("{case}/{route}")).await;
    }
}

async fn ranges_of(server: &Server, address: &str) {
    let whole = server.get(address).await;
    let range = async |range: &str| {
        let headers = [("range", range), ("accept-encoding", "zstd")];
        server.get_with(address, &headers).await
    };
    let part = range("bytes=100-199").await;
    assert_eq!(part.status, StatusCode::PARTIAL_CONTENT);
    assert_eq!(part.body, whole.body[100..200]);
    assert_eq!(
        part.header("content-range"),
        format!("bytes 100-199/{}", whole.body.len())
    );
    assert_eq!(
        range("bytes=-10").await.body,
        whole.body[whole.body.len() - 10..]
    );
    let beyond = range("bytes=999999999-").await;
    assert_eq!(
        (beyond.status.as_u16(), beyond.problem().as_str()),
        (416, "range-not-satisfiable")
    );
    assert_eq!(
        beyond.header("content-range"),
        format!("bytes */{}", whole.body.len())
    );
    let outdated = [("range", "bytes=0-9"), ("if-range", "\"other\"")];
    assert_eq!(
        server.get_with(address, &outdated).await.status,
        StatusCode::OK
    );
}

#[tokio::test]
async fn textures_and_paths_come_compressed_where_that_is_welcome() {
    use std::io::Read as _;
    let server = Server::start().await;
    let case = server.plain_case().await;
    for route in ["volume", "distance", "mesh/paths", "mesh/triangles"] {
        let address = format!("{case}/{route}");
        let plain = server.get(&address).await;
        let zstd = server
            .get_with(&address, &[("accept-encoding", "gzip, br, zstd")])
            .await;
        assert_eq!(zstd.header("content-encoding"), "zstd");
        assert_eq!(zstd.header("vary"), "accept-encoding");
        assert!(zstd.body.len() < plain.body.len(), "{route}");
        let unpacked = zstd::stream::decode_all(&zstd.body[..]).unwrap();
        assert_eq!(Bytes::from(unpacked), plain.body, "{route}");
        let gzip = server
            .get_with(&address, &[("accept-encoding", "gzip")])
            .await;
        assert_eq!(gzip.header("content-encoding"), "gzip");
        let mut unpacked = Vec::new();
        flate2::read::GzDecoder::new(&gzip.body[..])
            .read_to_end(&mut unpacked)
            .unwrap();
        assert_eq!(Bytes::from(unpacked), plain.body, "{route}");
        let tags = [&plain, &zstd, &gzip].map(|answer| answer.header("etag"));
        assert!(tags[0] != tags[1] && tags[1] != tags[2] && tags[0] != tags[2]);
    }
    let png = server
        .get_with(&format!("{case}/render"), &[("accept-encoding", "zstd")])
        .await;
    assert_eq!(png.header("content-encoding"), "");
}
