//! What is asked of a ready case with a body: another label, versions of it, and many pictures.

use axum::body::Body;
use axum::http::Method;
use serde_json::{Value, json};

use super::server::{Answer, Part, Server, head};

async fn put(server: &Server, case: &str, query: &str, body: &[u8]) -> Answer {
    let address = format!("{case}/mask{query}");
    server.ask(Method::PUT, &address, &[], body.to_vec()).await
}

#[tokio::test]
async fn versions_that_cannot_be_made() {
    let (server, case) = Server::with_case().await;
    let (volume, mask) = head();
    let mask: &[u8] = mask;
    for (query, body, status, kind) in [
        ("", &b"a fruit"[..], 415, "not-nifti"),
        ("", &mask[..mask.len() / 2], 422, "gzip-truncated"),
        ("", &volume[..400], 422, "gzip-truncated"),
        ("?offset_mm=21", mask, 422, "offset-out-of-range"),
        ("?offset_mm=nan", mask, 422, "offset-out-of-range"),
        (
            "?closing_radius_mm=51",
            mask,
            422,
            "closing-radius-out-of-range",
        ),
        (
            "?closing_radius_mm=-1",
            b"",
            422,
            "closing-radius-out-of-range",
        ),
        ("?threshold=1", b"", 422, "threshold-out-of-range"),
        ("?source=volume", b"", 422, "mask-missing"),
        ("?source=network", b"", 501, "network-missing"),
        ("?kind=fruit", mask, 400, "query-value-unreadable"),
        ("?radius=3", mask, 400, "query-unknown-key"),
        ("?source=auto", mask, 400, "query-value-out-of-range"),
    ] {
        let answer = put(&server, &case, query, body).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{query}");
    }
    let form = [("content-type", super::server::FORM)];
    let address = format!("{case}/mask");
    let answer = server.ask(Method::PUT, &address, &form, Body::empty());
    assert_eq!(answer.await.refusal(), (400, "form-not-wanted".to_owned()));
    assert_eq!(server.get(&case).await.json()["next"], json!([]));
    let files = server.stored_files();
    assert!(
        files.iter().all(|file| !file.contains("uploads")),
        "{files:?}"
    );
}

#[tokio::test]
async fn a_version_is_a_case_that_names_the_other() {
    let (server, case) = Server::with_case().await;
    let made = put(&server, &case, "?closing_radius_mm=8", b"").await;
    assert_eq!((made.status, made.header("retry-after")), (202, "1"));
    let version = made.header("location").to_owned();
    let made = made.json();
    assert_eq!(made["closing_radius_mm"], 8.0);
    assert_eq!(made["previous"], server.get(&case).await.json()["id"]);
    assert_eq!(server.get(&case).await.json()["next"], json!([made["id"]]));
    let again = put(&server, &case, "?closing_radius_mm=8", b"").await;
    assert_eq!(
        (again.status, again.header("location")),
        (200, version.as_str())
    );
    // The same upload with those parameters is that case, too.
    let (volume, mask) = head();
    let parameters: Part<'_> = (
        "parameters",
        br#"{"closing_radius_mm": 8, "name": "Eight"}"#,
    );
    let uploaded = server
        .upload(&[("volume", volume), ("mask", mask), parameters])
        .await;
    assert_eq!(
        (uploaded.status, &uploaded.json()["id"]),
        (200, &made["id"])
    );
    assert_eq!(uploaded.json()["name"], "Eight");
    let other: Part<'_> = (
        "parameters",
        br#"{"closing_radius_mm": 8, "name": "Other"}"#,
    );
    let kept = server
        .upload(&[("volume", volume), ("mask", mask), other])
        .await;
    assert_eq!(kept.json()["name"], "Eight");
    let renaming: Part<'_> = (
        "parameters",
        br#"{"closing_radius_mm": 8, "name": "Other", "keep_name": false}"#,
    );
    let renamed = server
        .upload(&[("volume", volume), ("mask", mask), renaming])
        .await;
    assert_eq!(renamed.json()["name"], "Other");
}

#[tokio::test]
async fn a_case_is_renamed_and_kept() {
    let (server, case) = Server::with_case().await;
    let patch = async |body: Value| {
        server
            .ask(Method::PATCH, &case, &[], body.to_string())
            .await
    };
    let said = |answer: &Answer| (answer.json()["name"].clone(), answer.json()["kept"].clone());
    let renamed = patch(json!({"name": "Another"})).await;
    assert_eq!(renamed.status, 200);
    assert_eq!(said(&renamed), (json!("Another"), json!(false)));
    let kept = patch(json!({"kept": true})).await;
    assert_eq!(said(&kept), (json!("Another"), json!(true)));
    let long = "x".repeat(201);
    for (body, status, kind) in [
        (json!({"kept": false, "name": long}), 422, "name-too-long"),
        (json!({"kept": false, "name": "a\nb"}), 422, "name-not-text"),
        (json!({"name": 3}), 400, "body-unreadable"),
        (json!({"nom": "x"}), 400, "body-unreadable"),
    ] {
        let refused = patch(body).await;
        assert_eq!(refused.refusal(), (status, kind.to_owned()));
    }
    let now = server.get(&case).await;
    assert_eq!(said(&now), (json!("Another"), json!(true)));
    let both = patch(json!({"kept": false, "name": "Third"})).await;
    assert_eq!(said(&both), (json!("Third"), json!(false)));
}

/// A JSON body for many pictures, and the path of what is wrong with it.
fn wrong_bodies() -> Vec<(Value, &'static str)> {
    let picture =
        |depth_mm: f64| json!({"depth_mm": depth_mm, "view": "left", "width": 64, "height": 64});
    let one = picture(1.0);
    let wide = json!({"width": 4096, "height": 4096});
    let many = vec![one.clone(); 257];
    let column: Vec<_> = (0..70).map(|depth| picture(f64::from(depth))).collect();
    let swivel =
        |frames: u32, render: Value| json!({"swivel": {"frames": frames, "render": render}});
    let sweep = |from: f64, to: f64, render: Value| json!({"sweep": {"from_mm": from, "to_mm": to, "frames": 4, "render": render}});
    let quick = json!({"swivel": {"frames": 4, "delay_ms": 0, "render": {}}});
    let both =
        json!({"renders": [one], "sweep": {"from_mm": 0, "to_mm": 1, "frames": 2, "render": {}}});
    vec![
        (json!({"renders": [one, {"deep": 1}]}), "renders[1]"),
        (json!({"picture": 1}), "."),
        (json!({"renders": [{"zoom": 0}]}), "renders[0].zoom"),
        (
            json!({"renders": [one, {"depth_mm": -1}]}),
            "renders[1].depth_mm",
        ),
        (
            json!({"renders": [{"orientation": [0, 0, 0, 0]}]}),
            "renders[0].orientation",
        ),
        (
            json!({"renders": [{"orientation": [0, 0, 1]}]}),
            "renders[0].orientation",
        ),
        (json!({"renders": [{"view": "askew"}]}), "renders[0].view"),
        (json!({"renders": []}), "renders"),
        (json!({"renders": many}), "renders"),
        (json!({"renders": [wide, wide, wide, wide, one]}), "."),
        (json!({}), "."),
        (both, "."),
        (
            json!({"sheet": true, "swivel": {"frames": 2, "render": {}}}),
            "sheet",
        ),
        (json!({"sheet": true, "renders": [one, one]}), "renders[1]"),
        (
            json!({"sheet": true, "renders": [one, {"view": "right"}]}),
            "renders[1]",
        ),
        (json!({"sheet": true, "renders": column}), "sheet"),
        (swivel(1, json!({})), "swivel.frames"),
        (swivel(257, json!({})), "swivel.frames"),
        (quick, "swivel.delay_ms"),
        (swivel(256, json!({"width": 513})), "."),
        (swivel(4, json!({"slab_mm": 21})), "swivel.render.slab_mm"),
        (sweep(-1.0, 5.0, json!({})), "sweep.from_mm"),
        (sweep(0.0, 1001.0, json!({})), "sweep.to_mm"),
        (
            sweep(1.0, 5.0, json!({"depth_mm": 2})),
            "sweep.render.depth_mm",
        ),
        (
            sweep(1.0, 5.0, json!({"depth_mm": -2})),
            "sweep.render.depth_mm",
        ),
    ]
}

#[tokio::test]
async fn what_is_wrong_with_many_pictures_is_named_by_its_path() {
    let (server, case) = Server::with_case().await;
    let address = format!("{case}/renders");
    let post = async |body: String, accept: &str| {
        let headers = [("accept", accept)];
        server.ask(Method::POST, &address, &headers, body).await
    };
    for (body, path) in wrong_bodies() {
        let answer = post(body.to_string(), "*/*").await;
        let (status, kind) = answer.refusal();
        assert_eq!(
            (status, answer.parameter().as_str()),
            (400, path),
            "{answer:?}"
        );
        assert!(
            kind.starts_with("body-") || kind.starts_with("query-") || kind.starts_with("depth-")
        );
    }
    for text in ["", "{", "[]", "{} {}", "\u{1}"] {
        let answer = post(text.to_owned(), "*/*").await;
        assert_eq!(
            answer.refusal(),
            (400, "body-unreadable".to_owned()),
            "{text:?}"
        );
    }
    let one = json!({"renders": [{"width": 64, "height": 64}]}).to_string();
    let refused = post(one.clone(), "image/png").await;
    assert_eq!(refused.refusal(), (406, "not-acceptable".to_owned()));
    let long = post(" ".repeat(2 << 20), "*/*").await;
    assert_eq!(long.refusal(), (413, "body-too-large".to_owned()));
    let drawn = post(one, "application/zip").await;
    assert_eq!(
        (drawn.status, drawn.header("content-type")),
        (200, "application/zip")
    );
    assert_eq!(drawn.header("x-isocortex-renderer"), "trace on cpu");
}
