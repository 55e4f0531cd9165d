//! Input that cannot be used: each kind has a clear answer, leaves nothing behind, and the server goes on serving.

use std::time::Duration;

use axum::body::Body;
use axum::http::{Request, StatusCode, header};
use bytes::Bytes;
use futures_util::stream;

use crate::head::{mask_of, plain_head};
use crate::nifti::{Data, Nifti, gzip};
use crate::server::CLOSING_BYTES;
use crate::server::{Part, Server, form, form_type};

/// Uploads, and expects to be refused with this status and type.
async fn refused(parts: &[Part<'_>], status: u16, kind: &str) {
    let server = Server::start().await;
    let answer = server.upload(parts).await;
    assert_eq!(answer.problem(), kind, "{answer:?}");
    assert_eq!(answer.status.as_u16(), status);
    server.is_empty_and_well().await;
}

/// The plain head with bytes of its header replaced.
fn head_with(offset: usize, bytes: &[u8]) -> Vec<u8> {
    let mut file = plain_head().bytes();
    file[offset..offset + bytes.len()].copy_from_slice(bytes);
    file
}

#[tokio::test]
async fn a_truncated_gzip() {
    let whole = gzip(&plain_head().bytes());
    refused(
        &[("volume", &whole[..whole.len() / 2])],
        422,
        "gzip-truncated",
    )
    .await;
}

#[tokio::test]
async fn a_damaged_gzip() {
    let mut file = gzip(&plain_head().bytes());
    let end = file.len() - 6;
    file[end] ^= 1;
    refused(&[("volume", &file)], 422, "gzip-corrupt").await;
}

#[tokio::test]
async fn a_gzip_that_unpacks_to_gigabytes() {
    // A header of 600³ voxels of 64 bits, and zeros without end.
    let mut header = head_with(42, &600i16.to_le_bytes());
    header.truncate(352);
    for axis in 0..3 {
        header[42 + 2 * axis..44 + 2 * axis].copy_from_slice(&600i16.to_le_bytes());
    }
    header[70..72].copy_from_slice(&64i16.to_le_bytes());
    header[72..74].copy_from_slice(&64i16.to_le_bytes());
    header.resize(64 << 20, 0);
    refused(&[("volume", &gzip(&header))], 413, "too-many-voxels").await;
}

#[tokio::test]
async fn a_header_of_a_thousand_million_voxels() {
    let mut header = head_with(42, &1000i16.to_le_bytes());
    header.truncate(352);
    for axis in 0..3 {
        header[42 + 2 * axis..44 + 2 * axis].copy_from_slice(&1000i16.to_le_bytes());
    }
    header.resize(16 << 20, 0);
    refused(&[("volume", &gzip(&header))], 413, "too-many-voxels").await;
}

#[tokio::test]
async fn dimensions_of_zero_and_below() {
    for side in [0i16, -5] {
        let file = head_with(42, &side.to_le_bytes());
        refused(&[("volume", &file)], 422, "nifti-dimension").await;
    }
}

#[tokio::test]
async fn an_affine_that_is_not_a_number() {
    let file = head_with(284, &f32::NAN.to_le_bytes());
    refused(&[("volume", &file)], 422, "nifti-affine").await;
}

#[tokio::test]
async fn voxels_that_are_not_numbers() {
    let head = plain_head();
    let Data::I16(values) = &head.data else {
        unreachable!()
    };
    let mut values: Vec<f32> = values.iter().map(|&value| f32::from(value)).collect();
    values[40_000] = f32::NAN;
    let file = Nifti {
        data: Data::F32(values),
        ..head
    };
    refused(&[("volume", &file.bytes())], 422, "nifti-non-finite").await;
}

#[tokio::test]
async fn an_empty_mask() {
    let head = plain_head();
    let mut mask = mask_of(&head);
    mask.data = Data::U8(vec![0; 45 * 45 * 45]);
    let parts: [Part<'_>; 2] = [("volume", &head.bytes()), ("mask", &mask.bytes())];
    refused(&parts, 422, "mask-empty").await;
}

#[tokio::test]
async fn a_volume_of_one_intensity() {
    let mut head = plain_head();
    let mask = mask_of(&head);
    head.data = Data::I16(vec![7; 45 * 45 * 45]);
    let parts: [Part<'_>; 2] = [("volume", &head.bytes()), ("mask", &mask.bytes())];
    refused(&parts, 422, "volume-constant").await;
}

#[tokio::test]
async fn a_window_without_width_is_told_so() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for address in ["render?window=0,0", "slices/axial?window=0,0.5"] {
        let answer = server.get(&format!("{case}/{address}")).await;
        assert_eq!(answer.problem(), "query-value-out-of-range");
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.starts_with("`window` width is 0"), "{detail}");
        assert!(
            detail.contains("1 to 1e9") && detail.contains("width - 1"),
            "{detail}"
        );
    }
    let answer = server.get(&format!("{case}/render?window=2e9,10")).await;
    let detail = answer.json()["detail"].as_str().unwrap().to_owned();
    assert!(
        detail.starts_with("`window` centre is 2000000000;"),
        "{detail}"
    );
}

#[tokio::test]
async fn a_volume_far_beyond_every_window() {
    let mut head = plain_head();
    let mask = mask_of(&head);
    head.slope = 1e33;
    let parts: [Part<'_>; 2] = [("volume", &head.bytes()), ("mask", &mask.bytes())];
    refused(&parts, 422, "intensity-range").await;
}

#[tokio::test]
async fn the_mask_of_another_head() {
    let head = plain_head();
    let mut mask = mask_of(&head);
    mask.ras_from_voxel[1][3] += 500.0;
    let parts: [Part<'_>; 2] = [("volume", &head.bytes()), ("mask", &mask.bytes())];
    refused(&parts, 422, "mask-outside-volume").await;
}

#[tokio::test]
async fn a_head_with_its_skull_that_is_to_be_its_own_mask() {
    let mut head = plain_head();
    let Data::I16(values) = &mut head.data else {
        unreachable!()
    };
    values.iter_mut().for_each(|value| *value += 10);
    let server = Server::start().await;
    let parameters: Part<'_> = ("parameters", br#"{"mask": "volume"}"#);
    let answer = server
        .upload(&[("volume", &head.bytes()), parameters])
        .await;
    assert_eq!(answer.problem(), "mask-missing");
    assert!(answer.json()["detail"].as_str().unwrap().contains("`mask`"));
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn what_is_no_volume() {
    refused(
        &[("volume", b"not a volume at all, but a text")],
        415,
        "not-nifti",
    )
    .await;
    refused(&[("volume", b"")], 415, "not-nifti").await;
}

#[tokio::test]
async fn a_mask_that_touches_every_border_is_used() {
    let head = plain_head();
    let mut mask = mask_of(&head);
    mask.data = Data::U8(vec![1; 45 * 45 * 45]);
    let server = Server::start().await;
    let case = server
        .prepared(&[("volume", &head.bytes()), ("mask", &mask.bytes())])
        .await;
    // The block is 180 mm wide: its middle lies half of that below its surface, less half a voxel.
    let deepest = server.get(&case).await.json()["max_depth_mm"]
        .as_f64()
        .unwrap();
    assert!((deepest - 88.0).abs() < 2.1, "{deepest}");
}

#[tokio::test]
async fn forms_that_are_not_right() {
    let volume = plain_head().bytes();
    refused(&[], 400, "volume-missing").await;
    refused(&[("mask", &volume)], 400, "volume-missing").await;
    refused(
        &[("volume", &volume), ("volume", &volume)],
        400,
        "part-twice",
    )
    .await;
    refused(
        &[("volume", &volume), ("surname", b"x")],
        400,
        "unknown-part",
    )
    .await;
    for text in [&br#"{"closing_radius": 3}"#[..], br#"[7.5, "x"]"#, b"{"] {
        let parts = [("volume", &volume[..]), ("parameters", text)];
        refused(&parts, 400, "parameters-unreadable").await;
    }
    let wide: Part<'_> = ("parameters", br#"{"closing_radius_mm": 51}"#);
    refused(
        &[("volume", &volume), wide],
        422,
        "closing-radius-out-of-range",
    )
    .await;
}

#[tokio::test]
async fn a_body_that_is_no_form() {
    let server = Server::start().await;
    let request = Request::post("/v1/cases").header(header::CONTENT_TYPE, "application/json");
    let answer = server.send(request.body(Body::from("{}")).unwrap()).await;
    assert_eq!(answer.problem(), "unsupported-media-type");
    assert_eq!(answer.status, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_body_of_two_gigabytes_is_refused_by_its_length() {
    let server = Server::start().await;
    let request = Request::post("/v1/cases")
        .header(header::CONTENT_TYPE, form_type())
        .header(header::CONTENT_LENGTH, 2_000_000_000u64);
    // Had the body been read, this would never end.
    let never = stream::pending::<Result<Bytes, std::io::Error>>();
    let answer = server
        .send(request.body(Body::from_stream(never)).unwrap())
        .await;
    assert_eq!(answer.problem(), "body-too-large");
    assert_eq!(answer.status, StatusCode::PAYLOAD_TOO_LARGE);
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn a_body_without_a_length_is_cut_at_the_limit() {
    let server = Server::start_with(|config| config.limits.max_upload_bytes = 1 << 20).await;
    let mut parts = form(&[("volume", &[])]);
    parts.truncate(parts.len() - CLOSING_BYTES);
    let head = stream::iter([Ok::<_, std::io::Error>(Bytes::from(parts))]);
    let zeros = stream::iter((0..).map(|_| Ok(Bytes::from_static(&[0; 65_536]))));
    let request = Request::post("/v1/cases").header(header::CONTENT_TYPE, form_type());
    let body = Body::from_stream(futures_util::StreamExt::chain(head, zeros));
    let answer = server.send(request.body(body).unwrap()).await;
    assert_eq!(answer.problem(), "body-too-large");
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn an_upload_that_is_cut_in_the_middle() {
    let server = Server::start().await;
    let whole = form(&[("volume", &plain_head().bytes())]);
    let half = Bytes::copy_from_slice(&whole[..whole.len() / 2]);
    for body in [
        Body::from(half.clone()),
        Body::from_stream(stream::iter([
            Ok(half),
            Err(std::io::Error::other("the connection was cut")),
        ])),
    ] {
        let request = Request::post("/v1/cases").header(header::CONTENT_TYPE, form_type());
        let answer = server.send(request.body(body).unwrap()).await;
        assert_eq!(answer.problem(), "form-unreadable");
        server.is_empty_and_well().await;
    }
}

#[tokio::test]
async fn an_upload_that_stalls() {
    let server = Server::start_with(|config| config.http.upload_idle_secs = 1).await;
    let start = form(&[("volume", &plain_head().bytes())]);
    let start = stream::iter([Ok::<_, std::io::Error>(Bytes::copy_from_slice(
        &start[..5000],
    ))]);
    let body = Body::from_stream(futures_util::StreamExt::chain(start, stream::pending()));
    let request = Request::post("/v1/cases").header(header::CONTENT_TYPE, form_type());
    let answer = server.send(request.body(body).unwrap());
    let answer = tokio::time::timeout(Duration::from_secs(20), answer)
        .await
        .unwrap();
    assert_eq!(answer.problem(), "upload-stalled");
    server.is_empty_and_well().await;
}

/// Asks a ready case, and expects to be refused with this status, type and parameter.
async fn refused_query(server: &Server, address: &str, kind: &str, parameter: &str) {
    let answer = server.get(address).await;
    assert_eq!(answer.problem(), kind, "{address}");
    assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{address}");
    let named = answer.json()["parameter"].as_str().map(str::to_owned);
    assert_eq!(named.unwrap_or_default(), parameter, "{address}");
}

#[tokio::test]
async fn queries_that_are_not_right() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for (rest, kind, parameter) in [
        ("mesh?depth_mm=-1", "depth-negative", "depth_mm"),
        ("mesh?depth_mm=abc", "depth-not-a-number", "depth_mm"),
        ("mesh?depth_mm=NaN", "depth-not-a-number", "depth_mm"),
        ("render?depth_mm=inf", "depth-not-a-number", "depth_mm"),
        ("mesh?contours=2", "query-value-out-of-range", "contours"),
        ("mesh?contours=513", "query-value-out-of-range", "contours"),
        ("mesh?points=1025", "query-value-out-of-range", "points"),
        (
            "mesh/triangles?points=2",
            "query-value-out-of-range",
            "points",
        ),
        (
            "mesh/paths?contours=512&points=1024",
            "query-value-out-of-range",
            "contours",
        ),
        ("mesh?paths=shortest", "query-value-unreadable", "paths"),
        ("mesh?depth=8", "query-unknown-key", ""),
        ("volume?x=1", "query-unknown-key", ""),
        ("render?width=100000", "query-value-out-of-range", "width"),
        ("render?height=0", "query-value-out-of-range", "height"),
        ("render?width=-1", "query-value-unreadable", "width"),
        ("render?zoom=0", "query-value-out-of-range", "zoom"),
        ("render?view=top", "query-value-unreadable", "view"),
        (
            "render?orientation=0,0,0,0",
            "query-value-out-of-range",
            "orientation",
        ),
        (
            "render?orientation=0,0,1",
            "query-value-unreadable",
            "orientation",
        ),
        (
            "render?view=left&orientation=0,0,0,1",
            "query-value-out-of-range",
            "orientation",
        ),
        ("render?window=10,0", "query-value-out-of-range", "window"),
        ("render?ambient=2", "query-value-out-of-range", "ambient"),
        ("slices/axial?depth_mm=5,-1", "depth-negative", "depth_mm"),
        (
            "slices/axial?position_mm=left",
            "query-value-unreadable",
            "position_mm",
        ),
    ] {
        refused_query(&server, &format!("{case}/{rest}"), kind, parameter).await;
    }
    refused_query(
        &server,
        "/v1/cases?limit=0",
        "query-value-out-of-range",
        "limit",
    )
    .await;
    refused_query(
        &server,
        "/v1/cases?after=x",
        "query-value-out-of-range",
        "after",
    )
    .await;
    refused_query(&server, "/healthz?deep=1", "query-unknown-key", "").await;
}

#[tokio::test]
async fn a_depth_beyond_the_deepest_point_is_clamped_and_said_so() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let deepest = server.get(&case).await.json()["max_depth_mm"]
        .as_f64()
        .unwrap();
    for route in ["mesh", "render"] {
        let answer = server.get(&format!("{case}/{route}?depth_mm=9000")).await;
        assert_eq!(answer.status, StatusCode::OK);
        assert_eq!(answer.header("x-isocortex-depth-clamped"), "true");
        let depth: f64 = answer.header("x-isocortex-depth-mm").parse().unwrap();
        assert!((depth - deepest).abs() < 1e-3);
        let answer = server.get(&format!("{case}/{route}?depth_mm=1.5")).await;
        assert_eq!(answer.header("x-isocortex-depth-clamped"), "false");
        assert_eq!(answer.header("x-isocortex-depth-mm"), "1.5");
    }
}

#[tokio::test]
async fn media_types_that_are_not_offered() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    for route in [
        "mesh",
        "mesh/triangles",
        "mesh/paths",
        "volume",
        "distance",
        "render",
        "slices/axial",
    ] {
        let address = format!("{case}/{route}");
        let answer = server.get_with(&address, &[("accept", "text/html")]).await;
        assert_eq!(answer.problem(), "not-acceptable", "{route}");
        assert_eq!(answer.status, StatusCode::NOT_ACCEPTABLE);
    }
}

#[tokio::test]
async fn what_is_not_there() {
    let server = Server::start().await;
    let none = "/v1/cases/00000000000000000000000000000000";
    for rest in [
        "",
        "/mesh",
        "/mesh/paths",
        "/volume",
        "/render",
        "/slices/axial",
        "/events",
    ] {
        let answer = server.get(&format!("{none}{rest}")).await;
        assert_eq!(
            (answer.status.as_u16(), answer.problem().as_str()),
            (404, "no-such-case")
        );
    }
    assert_eq!(server.get("/v1/cases/abc").await.problem(), "not-a-case-id");
    assert_eq!(server.get("/v1/nothing").await.problem(), "no-such-address");
    let answer = server.method(axum::http::Method::PUT, "/v1/cases").await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (405, "method-not-allowed")
    );
}
