//! The mask in the user's hands: had, put back, replaced, judged.

use axum::body::Body;
use axum::http::{Request, StatusCode};
use imaging::Limits;
use serde_json::Value;

use crate::head::{SPACING_MM, head, mask_of, orientations, plain_head};
use crate::nifti::{Data, gzip};
use crate::server::{Answer, Server};

async fn put(server: &Server, case: &str, query: &str, mask: &[u8]) -> Answer {
    let request = Request::put(format!("{case}/mask{query}"));
    let body = Body::from(mask.to_vec());
    server.send(request.body(body).unwrap()).await
}

/// Puts a mask and waits for the version; its address and what it says.
pub(crate) async fn version(
    server: &Server,
    case: &str,
    query: &str,
    mask: &[u8],
) -> (String, Value) {
    let answer = put(server, case, query, mask).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    assert!(answer.headers.contains_key("retry-after"));
    let address = answer.header("location").to_owned();
    let ready = server.until_ready(&address).await;
    (address, ready)
}

async fn positions(server: &Server, case: &str) -> Vec<[f32; 3]> {
    let address = format!("{case}/mesh?depth_mm=6");
    server.get(&address).await.positions()
}

fn furthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    assert_eq!(a.len(), b.len());
    let apart =
        |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
    a.iter().zip(b).map(apart).fold(0.0, f32::max)
}

fn id_of(address: &str) -> &str {
    address.rsplit('/').next().unwrap()
}

#[tokio::test]
async fn a_mask_put_back_unchanged_gives_the_same_mesh_and_both_cases_know_it() {
    let server = Server::start().await;
    let (volume, mask) = (plain_head(), mask_of(&plain_head()));
    let parameters = br#"{"name": "A test head", "closing_radius_mm": 7}"#;
    let case = server
        .prepared(&[
            ("volume", &volume.bytes()),
            ("mask", &gzip(&mask.bytes())),
            ("parameters", parameters),
        ])
        .await;
    let had = server.get(&format!("{case}/mask")).await;
    assert_eq!(had.header("content-type"), "application/gzip");
    assert_eq!(
        had.header("content-disposition"),
        "attachment; filename=\"mask.nii.gz\""
    );
    let (other, ready) = version(&server, &case, "", &had.body).await;
    assert_ne!(case, other);
    assert_eq!(ready["name"], "A test head");
    assert_eq!(ready["closing_radius_mm"], 7.0);
    assert_eq!(ready["previous"], id_of(&case));
    let before = server.get(&case).await.json();
    assert_eq!(before["next"], serde_json::json!([id_of(&other)]));
    assert!(before["previous"].is_null());
    assert_eq!(
        positions(&server, &case).await,
        positions(&server, &other).await
    );
    assert_eq!(server.get(&format!("{other}/mask")).await.body, had.body);
    let again = put(&server, &case, "", &had.body).await;
    assert_eq!(
        (again.status, again.header("location")),
        (StatusCode::OK, &other[..])
    );
}

#[tokio::test]
async fn a_round_trip_keeps_the_mesh_of_oblique_and_thick_slices_too() {
    let server = Server::start().await;
    let oblique = head(orientations()[3]);
    let mut thick = plain_head();
    thick.ras_from_voxel[2] = thick.ras_from_voxel[2].map(|x| x * 1.25);
    for volume in [oblique, thick] {
        let mask = mask_of(&volume);
        let case = server
            .prepared(&[("volume", &volume.bytes()), ("mask", &mask.bytes())])
            .await;
        let had = server.get(&format!("{case}/mask")).await.body;
        let (other, _) = version(&server, &case, "", &had).await;
        let apart = furthest(
            &positions(&server, &case).await,
            &positions(&server, &other).await,
        );
        assert!(apart < 0.02, "{apart} mm");
    }
}

#[tokio::test]
async fn the_mask_lies_where_the_volume_does() {
    let server = Server::start().await;
    for orientation in orientations() {
        let volume = head(orientation);
        let mask = mask_of(&volume);
        let case = server
            .prepared(&[("volume", &volume.bytes()), ("mask", &mask.bytes())])
            .await;
        let facts = server.get(&case).await.json();
        for route in ["mask", "envelope"] {
            let file = server.get(&format!("{case}/{route}")).await.body;
            let had = imaging::nifti::read_mask(&file, &Limits::default()).unwrap();
            let given = imaging::nifti::read_mask(&mask.bytes(), &Limits::default()).unwrap();
            let size: Vec<_> = had.grid().size().map(Value::from).to_vec();
            assert_eq!(facts["grid"]["size"], Value::from(size));
            let centre = |mask: &geometry::Mask| {
                let inside = (0..mask.voxels().len()).filter(|&index| mask.voxels()[index]);
                let places: Vec<_> = inside
                    .map(|index| {
                        let voxel = mask.grid().voxel(index).map(|place| place as f64);
                        let place = glam::DVec3::from_array(voxel);
                        mask.grid().patient_from_voxel().transform_point3(place)
                    })
                    .collect();
                places.iter().sum::<glam::DVec3>() / places.len() as f64
            };
            let apart = centre(&had).distance(centre(&given));
            assert!(apart < 2.0, "{} {route}: {apart} mm", orientation.name);
        }
    }
}

#[tokio::test]
async fn an_envelope_put_back_is_not_closed_again() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let envelope = server.get(&format!("{case}/envelope")).await.body;
    let (other, ready) = version(&server, &case, "?kind=envelope", &envelope).await;
    assert_eq!(ready["mask_kind"], "envelope");
    assert_eq!(ready["quality"]["numbers"]["closing_added"], 0.0);
    assert_eq!(
        positions(&server, &case).await,
        positions(&server, &other).await
    );
    assert_eq!(
        server.get(&format!("{other}/envelope")).await.body,
        envelope
    );
    // A cleft stays a cleft in an envelope, and is bridged in a brain.
    let cleft = with_cleft();
    let (as_envelope, _) = version(&server, &case, "?kind=envelope", &cleft).await;
    let (as_brain, _) = version(&server, &case, "", &cleft).await;
    let volume = async |case: &str| {
        server.get(case).await.json()["envelope_ml"]
            .as_f64()
            .unwrap()
    };
    let [open, closed] = [volume(&as_envelope).await, volume(&as_brain).await];
    assert!(closed > open + 20.0, "{open} ml, {closed} ml");
}

/// The mask of the plain head with a cleft of two voxels from above.
fn with_cleft() -> Vec<u8> {
    let mut mask = mask_of(&plain_head());
    let [nx, ny, _] = mask.size.map(|side| side as usize);
    let Data::U8(voxels) = &mut mask.data else {
        unreachable!()
    };
    for (index, voxel) in voxels.iter_mut().enumerate() {
        let (x, z) = (index % nx, index / (nx * ny));
        if x.abs_diff(nx / 2) < 1 && z > nx / 2 {
            *voxel = 0;
        }
    }
    mask.bytes()
}

#[tokio::test]
async fn other_parameters_make_a_version_of_the_same_mask() {
    let server = Server::start().await;
    let case = server
        .prepared(&[
            ("volume", &plain_head().bytes()),
            ("mask", &mask_of(&plain_head()).bytes()),
        ])
        .await;
    let depth = async |query: &str| {
        let (_, ready) = version(&server, &case, query, b"").await;
        ready["max_depth_mm"].as_f64().unwrap()
    };
    let before = server.get(&case).await.json()["max_depth_mm"]
        .as_f64()
        .unwrap();
    let larger = depth("?offset_mm=8").await;
    assert!((larger - before - 8.0).abs() < 2.0, "{before} {larger}");
    let smaller = depth("?offset_mm=-8&closing_radius_mm=3").await;
    assert!((smaller - before + 8.0).abs() < 2.0, "{before} {smaller}");
    let nothing_new = put(&server, &case, "", b"").await;
    assert_eq!(nothing_new.status, StatusCode::OK);
    assert_eq!(nothing_new.header("location"), case);
    // The volume is its own mask as well.
    let (own, ready) = version(&server, &case, "?source=volume", b"").await;
    assert_eq!(ready["quality"]["method"], "volume");
    assert_eq!(
        positions(&server, &own).await,
        positions(&server, &case).await
    );
    assert_eq!(
        server.get(&case).await.json()["next"]
            .as_array()
            .unwrap()
            .len(),
        3
    );
    // A version of a version keeps what the version was made with.
    let (offset, ready) = version(&server, &own, "?offset_mm=4", b"").await;
    let (closed, _) = version(&server, &offset, "?closing_radius_mm=12", b"").await;
    let ready_too = server.get(&closed).await.json();
    assert_eq!(
        (&ready["offset_mm"], &ready_too["offset_mm"]),
        (&Value::from(4.0), &Value::from(4.0))
    );
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

/// A ball of so many mm in the middle of the plain head.
fn mask_of_radius(radius_mm: f32) -> Vec<u8> {
    let mut mask = mask_of(&plain_head());
    let [nx, ny, _] = mask.size.map(|side| side as usize);
    let Data::U8(voxels) = &mut mask.data else {
        unreachable!()
    };
    for (index, voxel) in voxels.iter_mut().enumerate() {
        let place = [index % nx, index / nx % ny, index / (nx * ny)];
        let square: f32 = place.iter().map(|&at| (at as f32 - 22.0).powi(2)).sum();
        *voxel = u8::from(square.sqrt() * SPACING_MM <= radius_mm);
    }
    mask.bytes()
}

#[tokio::test]
async fn a_version_outlives_the_case_that_it_was_made_of() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let (second, _) = version(&server, &case, "?closing_radius_mm=4", b"").await;
    let (third, _) = version(&server, &second, "?closing_radius_mm=5", b"").await;
    let mesh = positions(&server, &third).await;
    let deleted = server.method(axum::http::Method::DELETE, &second).await;
    assert_eq!(deleted.status, StatusCode::NO_CONTENT);
    assert_eq!(server.get(&third).await.json()["previous"], id_of(&case));
    assert_eq!(
        server.get(&case).await.json()["next"],
        serde_json::json!([id_of(&third)])
    );
    server.method(axum::http::Method::DELETE, &case).await;
    let server = server.restart().await;
    assert!(server.get(&third).await.json()["previous"].is_null());
    assert_eq!(positions(&server, &third).await, mesh);
    assert_eq!(
        server.get(&format!("{third}/quality")).await.status,
        StatusCode::OK
    );
    server.method(axum::http::Method::DELETE, &third).await;
    server.is_empty_and_well().await;
}

/// The plain head with fluid at its border, as a brain has that lost no more than its skull.
fn head_with_fluid() -> Vec<u8> {
    let mut head = plain_head();
    let [nx, ny, _] = head.size.map(|side| side as usize);
    let Data::I16(voxels) = &mut head.data else {
        unreachable!()
    };
    let all = voxels.clone();
    for (index, voxel) in voxels
        .iter_mut()
        .enumerate()
        .filter(|(_, voxel)| **voxel > 0)
    {
        let steps = [1, nx, nx * ny];
        let is_border = steps
            .iter()
            .any(|step| all[index - step] == 0 || all[index + step] == 0);
        *voxel /= if is_border { 3 } else { 1 };
    }
    head.bytes()
}

#[tokio::test]
async fn what_is_unusual_about_a_mask_is_said_before_anyone_reads_the_case() {
    let server = Server::start().await;
    let case = server.prepared(&[("volume", &head_with_fluid())]).await;
    let usual = server.get(&case).await.json();
    assert_eq!(usual["quality"]["state"], "ok");
    assert_eq!(usual["quality"]["reasons"], serde_json::json!([]));
    let (small, ready) = version(&server, &case, "", &mask_of_radius(40.0)).await;
    assert_eq!(ready["quality"]["state"], "review");
    let reason = ready["quality"]["reasons"][0].as_str().unwrap();
    assert!(reason.contains("ml"), "{reason}");
    for (case, verdict) in [(&case, "ok"), (&small, "review")] {
        for route in [
            "render?width=64&height=64",
            "slices/axial?width=64&height=64",
            "mesh",
            "quality",
        ] {
            let answer = server.get(&format!("{case}/{route}")).await;
            assert_eq!(answer.header("x-isocortex-quality"), verdict, "{route}");
            let known = [("if-none-match", answer.header("etag"))];
            let again = server.get_with(&format!("{case}/{route}"), &known).await;
            assert_eq!(again.status, StatusCode::NOT_MODIFIED);
            assert_eq!(again.header("x-isocortex-quality"), verdict, "{route}");
        }
    }
    let sheet = server.get(&format!("{small}/quality")).await;
    let picture = image::load_from_memory(&sheet.body).unwrap();
    assert!(picture.width() > 1100 && picture.height() > 1200);
    let text = String::from_utf8_lossy(&sheet.body);
    assert!(text.contains("For research use only. Not for diagnosis."));
}

#[tokio::test]
async fn an_upload_can_say_that_its_mask_is_an_envelope_or_that_the_volume_is_its_own() {
    let server = Server::start().await;
    let (volume, mask) = (plain_head().bytes(), mask_of(&plain_head()).bytes());
    let case = server
        .prepared(&[
            ("volume", &volume),
            ("mask", &mask),
            (
                "parameters",
                br#"{"mask_kind": "envelope", "offset_mm": 4}"#,
            ),
        ])
        .await;
    let ready = server.get(&case).await.json();
    assert_eq!(ready["quality"]["numbers"]["closing_added"], 0.0);
    let both = [
        ("volume", &volume[..]),
        ("mask", &mask),
        ("parameters", br#"{"mask": "volume"}"#),
    ];
    assert_eq!(server.upload(&both).await.problem(), "mask-twice");
    let own = server
        .prepared(&[
            ("volume", &volume),
            ("parameters", br#"{"mask": "volume"}"#),
        ])
        .await;
    assert_eq!(server.get(&own).await.json()["quality"]["method"], "volume");
}

#[tokio::test]
async fn a_raw_head_goes_in_and_its_cortex_can_be_peeled() {
    let server = Server::start().await;
    let raw = geometry::phantom::head(2.0).volume;
    let raw = imaging::nifti::write_volume(&raw).unwrap();
    let case = server.prepared(&[("volume", &raw)]).await;
    let ready = server.get(&case).await.json();
    assert_eq!(ready["quality"]["method"], "tree_pruning");
    let envelope_ml = ready["envelope_ml"].as_f64().unwrap();
    // The phantom's brain is an ellipsoid of 1,664 ml.
    assert!((1500.0..1900.0).contains(&envelope_ml), "{envelope_ml}");
    let steps = ready["timings"].as_array().unwrap();
    assert!(steps.iter().any(|step| step["stage"] == "extracting"));
    let picture = server
        .get(&format!("{case}/render?depth_mm=8&width=64&height=64"))
        .await;
    let verdict = ready["quality"]["state"].as_str().unwrap();
    assert_eq!(picture.header("x-isocortex-quality"), verdict);
    let mask = server.get(&format!("{case}/mask")).await.body;
    let (edited, _) = version(&server, &case, "", &mask).await;
    assert_eq!(
        positions(&server, &case).await,
        positions(&server, &edited).await
    );
}

#[tokio::test]
async fn what_holds_no_brain_fails_in_words() {
    let server = Server::start().await;
    let mut noise = plain_head();
    let mut state = 1u32;
    noise.data = Data::I16(
        (0..45 * 45 * 45)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 22) as i16 + 1
            })
            .collect(),
    );
    // Noise is refused at once.
    let answer = server.upload(&[("volume", &noise.bytes())]).await;
    assert_eq!(answer.problem(), "no-brain-found");
    let detail = answer.json()["detail"].as_str().unwrap().to_owned();
    assert!(
        detail.contains("noise") && detail.contains("mask"),
        "{detail}"
    );
    server.is_empty_and_well().await;
    // What is solid is looked at.
    let mut wedge = plain_head();
    let brighter = |index: i32| (20 * (index % 45) + 1) as i16;
    wedge.data = Data::I16((0..45 * 45 * 45).map(brighter).collect());
    let answer = server.upload(&[("volume", &wedge.bytes())]).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED);
    let address = answer.header("location").to_owned();
    let case = server.until_settled(&address).await;
    if case["state"] == "failed" {
        let detail = case["error"]["detail"].as_str().unwrap();
        assert!(detail.contains("mask"), "{detail}");
    } else {
        assert_ne!(case["quality"]["state"], "ok");
        assert!(!case["quality"]["reasons"].as_array().unwrap().is_empty());
    }
}
