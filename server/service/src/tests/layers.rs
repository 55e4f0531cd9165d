//! Layers of a case over HTTP: added, drawn, changed, deleted.

use std::io::Read as _;
use std::time::Duration;

use axum::body::Body;
use axum::http::Method;
use case::MAX_LAYERS;
use cases::jobs::start_workers;
use geometry::Grid;
use glam::{DAffine3, DVec3};
use imaging::nifti::write_numbers;
use pipeline::testing::phantom;
use serde_json::{Value, json};

use super::server::{Answer, FORM, MAX_UPLOAD_BYTES, Server, form, head};

/// A layer on the grid of the coarse head, moved to the patient's left: its value from the head's intensity.
fn layer(shift_mm: f64, value: impl Fn(usize, f32) -> f32) -> Vec<u8> {
    let volume = phantom().volume;
    let affine = DAffine3::from_translation(DVec3::new(shift_mm, 0.0, 0.0))
        * volume.grid().patient_from_voxel();
    let grid = Grid::new(volume.grid().size(), affine).unwrap();
    let intensity = |(index, &stored): (usize, &u16)| value(index, volume.intensity(stored.into()));
    let numbers: Vec<f32> = volume.voxels().iter().enumerate().map(intensity).collect();
    write_numbers(&grid, &numbers).unwrap()
}

/// The head with another contrast, as a FLAIR would show it.
pub(super) fn flair(shift_mm: f64) -> Vec<u8> {
    layer(shift_mm, |_, intensity| 900.0 - intensity)
}

/// Labels in two halves of the volume.
fn labels() -> Vec<u8> {
    layer(0.0, |index, _| if index % 2 == 0 { 1.0 } else { 100.0 })
}

async fn add(server: &Server, case: &str, volume: &[u8], parameters: Value) -> Answer {
    let parameters = parameters.to_string();
    let parts = form(&[("volume", volume), ("parameters", parameters.as_bytes())]);
    let address = format!("{case}/layers");
    let form = [("content-type", FORM)];
    server.ask(Method::POST, &address, &form, parts).await
}

/// Adds a layer and waits until it is ready; its address.
pub(super) async fn added(server: &Server, case: &str, volume: &[u8], parameters: Value) -> String {
    let answer = add(server, case, volume, parameters).await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let address = answer.header("location").to_owned();
    assert_eq!(
        server.settled(&address).await,
        "ready",
        "{:?}",
        server.get(&address).await
    );
    address
}

async fn names(server: &Server, case: &str) -> Vec<String> {
    let list = server.get(&format!("{case}/layers")).await.json();
    let layers = list["layers"].as_array().unwrap().clone();
    let added = layers
        .iter()
        .filter(|layer| layer["transform"] != Value::Null);
    added
        .map(|layer| layer["name"].as_str().unwrap().to_owned())
        .collect()
}

/// The texts of a PNG file, by keyword.
fn text_of(png: &[u8], keyword: &str) -> Option<String> {
    let decoder = png::Decoder::new(std::io::Cursor::new(png));
    let reader = decoder.read_info().unwrap();
    let info = reader.info();
    let plain = info.uncompressed_latin1_text.iter();
    let plain = plain.map(|text| (text.keyword.clone(), text.text.clone()));
    let wide = info.utf8_text.iter();
    let wide = wide.map(|text| (text.keyword.clone(), text.get_text().unwrap()));
    plain
        .chain(wide)
        .find(|(key, _)| key == keyword)
        .map(|(_, text)| text)
}

/// The bytes of the pixels of a PNG file.
pub(super) fn pixels(png: &[u8]) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png))
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

#[tokio::test]
async fn a_layer_is_registered_listed_and_drawn_everywhere() {
    let (server, case) = Server::with_case().await;
    let workers = start_workers(server.cases.library.clone(), 1);
    let parameters = json!({"name": "FLAIR ü", "unit": "a.u."});
    let address = added(&server, &case, &flair(9.0), parameters.clone()).await;
    let view = server.get(&address).await.json();
    assert_eq!(
        (&view["kind"], &view["origin"]),
        (&json!("mr"), &json!("registered"))
    );
    assert_eq!(
        (&view["verdict"], &view["quality"]),
        (&json!("registered"), &json!("ok"))
    );
    let shift = view["case_from_layer"][0][3].as_f64().unwrap();
    assert!((shift + 9.0).abs() < 1.5, "{view}");
    for key in [
        "window",
        "range",
        "grid",
        "nmi_before",
        "overlap",
        "volume",
        "colormap",
    ] {
        assert_ne!(view[key], Value::Null, "{key}");
    }
    let again = add(&server, &case, &flair(9.0), parameters).await;
    assert_eq!(
        (again.status, again.header("location")),
        (200, address.as_str())
    );
    assert_eq!(names(&server, &case).await, ["FLAIR ü"]);

    let plain = server
        .get(&format!("{case}/render?depth_mm=8&width=96&height=96"))
        .await;
    for renderer in ["splat", "trace", "mesh"] {
        let query = format!("depth_mm=8&width=96&height=96&renderer={renderer}");
        for name in ["FLAIR%20%C3%BC", view["id"].as_str().unwrap()] {
            for key in ["layer", "overlay"] {
                let drawn = server
                    .get(&format!("{case}/render?{query}&{key}={name}"))
                    .await;
                assert_eq!(drawn.status, 200, "{drawn:?}");
                assert_ne!(drawn.body, plain.body);
                assert_eq!(text_of(&drawn.body, key).as_deref(), Some("FLAIR ü"));
                let place = text_of(&drawn.body, &format!("{key}_place"));
                assert_eq!(place.as_deref(), Some("registered"));
                assert_eq!(
                    text_of(&drawn.body, &format!("{key}_unit")).as_deref(),
                    Some("a.u.")
                );
                assert_eq!(drawn.header("cache-control"), "private, no-cache");
            }
        }
    }
    let slice = server
        .get(&format!(
            "{case}/slices/axial?layer=FLAIR%20%C3%BC&annotate=true"
        ))
        .await;
    assert_eq!(slice.status, 200, "{slice:?}");
    // Its edges alone are another picture than its colours, and mixed with nothing else.
    let over = format!("{case}/slices/axial?overlay=FLAIR%20%C3%BC&width=128&height=128");
    let colored = server.get(&over).await;
    let query = "edges=true&overlay_opacity=0&annotate=true";
    let edges = server.get(&format!("{over}&{query}")).await;
    assert_eq!((colored.status, edges.status), (200, 200), "{edges:?}");
    assert_eq!(text_of(&colored.body, "edges"), None);
    assert_eq!(text_of(&edges.body, "edges").as_deref(), Some("true"));
    assert_eq!(text_of(&edges.body, "overlay").as_deref(), Some("FLAIR ü"));
    let is_edge = |pixel: &[u8]| pixel[0] > 200 && pixel[1] < 110 && pixel[2] > 140;
    let count = |png: &[u8]| pixels(png).chunks(3).filter(|pixel| is_edge(pixel)).count();
    assert_eq!(count(&colored.body), 0);
    assert!(count(&edges.body) > 100, "{}", count(&edges.body));
    let refused = server
        .get(&format!(
            "{case}/slices/axial?layer=FLAIR%20%C3%BC&edges=true"
        ))
        .await;
    assert_eq!(
        (refused.refusal(), refused.parameter()),
        (
            (400, "query-value-out-of-range".to_owned()),
            "edges".to_owned()
        )
    );
    for body in [
        json!({"renders": [{"width": 64, "height": 64, "overlay": "FLAIR ü"}], "sheet": true}),
        json!({"swivel": {"frames": 2, "render": {"width": 64, "height": 64, "layer": "FLAIR ü"}}}),
        json!({"sweep": {"from_mm": 2, "to_mm": 6, "frames": 2, "render": {"width": 64, "height": 64, "overlay": "FLAIR ü"}}}),
    ] {
        let address = format!("{case}/renders");
        let many = server.ask(Method::POST, &address, &[], body.to_string());
        let many = many.await;
        assert_eq!(many.status, 200, "{many:?}");
    }
    let centre = server.get(&case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let centre: Vec<String> = centre
        .as_array()
        .unwrap()
        .iter()
        .map(Value::to_string)
        .collect();
    let profile = server
        .get(&format!("{case}/profile?position={}", centre.join(",")))
        .await;
    let profile = profile.json();
    assert_eq!(profile["layers"][0]["name"], "FLAIR ü", "{profile}");
    assert!(
        profile["own"]["point"]["layers"][0].is_number(),
        "{profile}"
    );
    workers.shut_down(Duration::from_secs(60)).await;
}

#[tokio::test]
async fn the_voxels_of_a_layer_can_be_fetched() {
    let (server, case) = Server::with_case().await;
    let workers = start_workers(server.cases.library.clone(), 1);
    let map = layer(0.0, |index, _| {
        if index % 7 == 0 {
            f32::NAN
        } else {
            (index % 5) as f32 - 2.0
        }
    });
    let address = added(&server, &case, &map, json!({"kind": "map", "unit": "z"})).await;
    let view = server.get(&address).await.json();
    assert_eq!(
        (&view["name"], &view["origin"]),
        (&json!("map"), &json!("header"))
    );
    assert_eq!(view["colormap"], "blue-orange");
    let voxels = server.get(view["volume"].as_str().unwrap()).await;
    let size: Vec<usize> = voxels
        .header("x-isocortex-size")
        .split(',')
        .map(|side| side.parse().unwrap())
        .collect();
    assert_eq!(voxels.header("x-isocortex-format"), "u16");
    assert_eq!(voxels.body.len(), 2 * size.iter().product::<usize>());
    let [scale, offset] = ["x-isocortex-scale", "x-isocortex-offset"]
        .map(|name| voxels.header(name).parse::<f32>().unwrap());
    let codes = voxels
        .body
        .chunks_exact(2)
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let values: Vec<f32> = codes
        .filter(|&code| code > 0)
        .map(|code| f32::from(code) * scale + offset)
        .collect();
    assert!(
        values
            .iter()
            .all(|value| (-2.0..=2.0).contains(value) && value.fract() == 0.0)
    );
    assert!(values.len() < size.iter().product(), "some are undefined");

    let file = server.get(&format!("{address}/nifti")).await;
    assert_eq!(file.status, 200, "{file:?}");
    let mut plain = Vec::new();
    flate2::read::GzDecoder::new(&*file.body)
        .read_to_end(&mut plain)
        .unwrap();
    assert_eq!(plain.len(), 352 + 2 * voxels.body.len());
    let tag = voxels.header("etag").to_owned();
    let known = server
        .get_with(view["volume"].as_str().unwrap(), &[("if-none-match", &tag)])
        .await;
    assert_eq!(known.status, 304);

    let address = added(&server, &case, &labels(), json!({"kind": "labels"})).await;
    let view = server.get(&address).await.json();
    let expected = json!(["cluster 1", "cluster 1, salient"]);
    let found: Vec<_> = view["labels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|label| label["name"].clone())
        .collect();
    assert_eq!(json!(found), expected);
    let voxels = server.get(&format!("{address}/volume")).await;
    assert_eq!(voxels.header("x-isocortex-format"), "u8");
    assert!(voxels.body.iter().all(|&code| code <= 2));
    let overlay = server
        .get(&format!(
            "{case}/render?overlay=labels&annotate=true&depth_mm=5"
        ))
        .await;
    assert_eq!(overlay.status, 200, "{overlay:?}");
    let edges = format!("{case}/slices/axial?overlay=labels&edges=true");
    let refused = server.get(&edges).await;
    assert_eq!(
        (refused.refusal(), refused.parameter()),
        (
            (400, "query-value-out-of-range".to_owned()),
            "edges".to_owned()
        )
    );
    for query in ["layer=labels", "overlay=labels&overlay_window=0,1"] {
        let refused = server.get(&format!("{case}/render?{query}")).await;
        assert_eq!(
            refused.refusal(),
            (400, "query-value-out-of-range".to_owned())
        );
    }
    workers.shut_down(Duration::from_secs(60)).await;
}

#[tokio::test]
async fn a_case_has_so_many_layers_and_no_more() {
    let (server, case) = Server::with_case().await;
    let workers = start_workers(server.cases.library.clone(), 1);
    for number in 0..MAX_LAYERS {
        let map = layer(0.0, |index, _| ((index + number) % 29) as f32);
        added(&server, &case, &map, json!({"kind": "map"})).await;
    }
    let refused = add(&server, &case, &flair(0.0), json!({})).await;
    assert_eq!(refused.refusal(), (409, "too-many-layers".to_owned()));
    workers.shut_down(Duration::from_secs(60)).await;
}

#[tokio::test]
async fn layers_are_renamed_moved_and_deleted_with_their_objects() {
    let (server, case) = Server::with_case().await;
    let before = server.stored_files();
    let workers = start_workers(server.cases.library.clone(), 1);
    let mut addresses = Vec::new();
    for number in 0..3 {
        let map = layer(0.0, |index, _| ((index + number) % 9) as f32);
        addresses.push(added(&server, &case, &map, json!({"kind": "map"})).await);
    }
    assert_eq!(names(&server, &case).await, ["map", "map 2", "map 3"]);
    let patch = async |address: &str, body: Value| {
        server
            .ask(Method::PATCH, address, &[], body.to_string())
            .await
    };
    let moved = patch(&addresses[2], json!({"name": "first", "place": 0})).await;
    assert_eq!(
        (moved.status, &moved.json()["name"]),
        (200, &json!("first"))
    );
    assert_eq!(names(&server, &case).await, ["first", "map", "map 2"]);
    for (body, status, kind) in [
        (json!({"name": "map"}), 409, "layer-name-taken"),
        (json!({"name": "blur"}), 422, "name-unusable"),
        (json!({"name": ".."}), 422, "name-unusable"),
        (json!({"name": ""}), 422, "name-unusable"),
        (json!({"nom": "x"}), 400, "body-unreadable"),
    ] {
        let refused = patch(&addresses[2], body).await;
        assert_eq!(refused.refusal(), (status, kind.to_owned()));
    }

    // A version has the layers, prepared with its own envelope at the same place.
    let mask = format!("{case}/mask?closing_radius_mm=8");
    let version = server.ask(Method::PUT, &mask, &[], Body::empty()).await;
    let version = version.header("location").to_owned();
    assert_eq!(server.settled(&version).await, "ready");
    assert_eq!(names(&server, &version).await, ["first", "map", "map 2"]);
    for address in &addresses {
        let id = address.rsplit('/').next().unwrap();
        assert_eq!(
            server.settled(&format!("{version}/layers/{id}")).await,
            "ready"
        );
    }

    // One that is being drawn can be deleted.
    let picture = format!("{case}/render?overlay=first&depth_mm=6");
    let (drawn, deleted) = tokio::join!(
        server.get(&picture),
        server.ask(Method::DELETE, &addresses[2], &[], Body::empty())
    );
    assert_eq!(deleted.status, 204);
    assert!([200, 404, 409].contains(&drawn.status), "{drawn:?}");
    assert_eq!(
        server.get(&picture).await.refusal(),
        (404, "no-such-layer".to_owned())
    );
    assert_eq!(
        server.get(&addresses[2]).await.refusal(),
        (404, "no-such-layer".to_owned())
    );
    for address in [&version, &addresses[0], &addresses[1]] {
        let deleted = server
            .ask(Method::DELETE, address, &[], Body::empty())
            .await;
        assert_eq!(deleted.status, 204, "{deleted:?}");
    }
    workers.shut_down(Duration::from_secs(60)).await;
    assert_eq!(server.stored_files(), before);
    let deleted = server.ask(Method::DELETE, &case, &[], Body::empty()).await;
    assert_eq!(deleted.status, 204);
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn layers_that_cannot_be_used_leave_nothing_behind() {
    let (server, case) = Server::with_case().await;
    let before = server.stored_files();
    let count = phantom().volume.voxels().len();
    let mut several = Vec::new();
    flate2::read::GzDecoder::new(&*flair(0.0))
        .read_to_end(&mut several)
        .unwrap();
    several[40..42].copy_from_slice(&4i16.to_le_bytes());
    several[48..50].copy_from_slice(&3i16.to_le_bytes());
    let map = json!({"kind": "map"});
    let matrix = json!([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    for (volume, parameters, status, kind) in [
        (several.clone(), json!({}), 422, "nifti-several-volumes"),
        (b"a fruit".to_vec(), json!({}), 415, "not-nifti"),
        (Vec::new(), json!({}), 415, "not-nifti"),
        (layer(0.0, |_, _| f32::NAN), json!({}), 422, "layer-empty"),
        (layer(0.0, |_, _| 7.0), json!({}), 422, "layer-empty"),
        (layer(0.0, |_, _| 2e9), map.clone(), 422, "intensity-range"),
        (
            layer(0.0, |index, _| index as f32 / count as f32),
            json!({"kind": "labels"}),
            422,
            "labels-not-whole",
        ),
        (
            flair(0.0),
            json!({"transform": "affine"}),
            400,
            "parameters-unreadable",
        ),
        (
            flair(0.0),
            json!({"transform": matrix}),
            422,
            "transform-not-rigid",
        ),
        (
            flair(0.0),
            json!({"kind": "labels", "transform": "rigid"}),
            422,
            "transform-not-possible",
        ),
        (
            flair(0.0),
            json!({"name": "sharpness"}),
            422,
            "name-unusable",
        ),
        (
            flair(0.0),
            json!({"fruit": 1}),
            400,
            "parameters-unreadable",
        ),
    ] {
        let refused = add(&server, &case, &volume, parameters.clone()).await;
        assert_eq!(refused.refusal(), (status, kind.to_owned()), "{parameters}");
    }
    assert_eq!(server.stored_files(), before);
    let promising = |side: i16| {
        let mut file = several.clone();
        file[40..42].copy_from_slice(&3i16.to_le_bytes());
        for at in [42, 44, 46] {
            file[at..at + 2].copy_from_slice(&side.to_le_bytes());
        }
        file
    };
    let noise = |index: usize| (index as u32).wrapping_mul(2_654_435_761).to_le_bytes()[3];
    let length = MAX_UPLOAD_BYTES as usize + (2 << 20);
    let too_long: Vec<u8> = (0..length).map(noise).collect();
    for (volume, status, kind) in [
        (promising(500), 413, "too-many-voxels"),
        (too_long, 413, "body-too-large"),
    ] {
        let refused = add(&server, &case, &volume, json!({})).await;
        assert_eq!(refused.refusal(), (status, kind.to_owned()));
    }
    assert_eq!(server.stored_files(), before);
    let nowhere = format!("/v1/cases/{}", "0".repeat(32));
    let refused = add(&server, &nowhere, &flair(0.0), json!({})).await;
    assert_eq!(refused.refusal(), (404, "no-such-case".to_owned()));

    // What is no image of this head fails when it is placed, and is never drawn.
    let workers = start_workers(server.cases.library.clone(), 1);
    let noise = layer(0.0, |index, _| {
        (index.wrapping_mul(2_654_435_761) % 997) as f32
    });
    let answer = add(&server, &case, &noise, json!({"name": "noise"})).await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let address = answer.header("location").to_owned();
    assert_eq!(server.settled(&address).await, "failed");
    let view = server.get(&address).await.json();
    let kind = &view["error"]["type"];
    assert_eq!(kind, "urn:isocortex:problem:layer-not-registered", "{view}");
    let drawn = server.get(&format!("{case}/render?layer=noise")).await;
    assert_eq!(drawn.refusal(), (422, "layer-not-registered".to_owned()));
    // Its file is removed right after it is said to have failed.
    let has_gone = async {
        while server.stored_files() != before {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let waited = tokio::time::timeout(Duration::from_secs(30), has_gone).await;
    assert!(waited.is_ok(), "{:?}", server.stored_files());
    // The file can be sent again, and fails again.
    let answer = add(&server, &case, &noise, json!({"name": "noise"})).await;
    assert_eq!(
        (answer.status, answer.header("location")),
        (202, address.as_str())
    );
    assert_eq!(server.settled(&address).await, "failed");
    // By hand it is another layer.
    let matrix = json!([
        [1.0, 0.0, 0.0, 2.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0]
    ]);
    let by_hand = added(&server, &case, &noise, json!({"transform": matrix})).await;
    assert_ne!(by_hand, address);
    let view = server.get(&by_hand).await.json();
    assert_eq!(
        (&view["origin"], &view["transform"]),
        (&json!("by-hand"), &matrix.clone())
    );
    let events = server.get(&format!("{by_hand}/events")).await;
    let events = String::from_utf8(events.body.to_vec()).unwrap();
    assert!(events.starts_with("event: layer\n"), "{events}");
    workers.shut_down(Duration::from_secs(60)).await;
}

#[tokio::test]
async fn a_layer_whose_header_is_wrong_by_half_a_turn_is_refused() {
    let (server, case) = Server::with_case().await;
    let workers = start_workers(server.cases.library.clone(), 1);
    let volume = phantom().volume;
    let [x, y, z] = volume.grid().size();
    let middle = volume
        .grid()
        .patient_from_voxel()
        .transform_point3(DVec3::new(x as f64, y as f64, z as f64) / 2.0);
    let numbers: Vec<f32> = volume
        .voxels()
        .iter()
        .map(|&stored| 900.0 - volume.intensity(stored.into()))
        .collect();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let turn = DAffine3::from_translation(middle)
            * DAffine3::from_axis_angle(axis, std::f64::consts::PI)
            * DAffine3::from_translation(-middle);
        let affine = turn * volume.grid().patient_from_voxel();
        let grid = Grid::new(volume.grid().size(), affine).unwrap();
        let file = write_numbers(&grid, &numbers).unwrap();
        let answer = add(&server, &case, &file, json!({})).await;
        assert_eq!(answer.status, 202, "{answer:?}");
        let address = answer.header("location");
        assert_eq!(server.settled(address).await, "failed", "about {axis}");
        let view = server.get(address).await.json();
        let kind = &view["error"]["type"];
        assert_eq!(kind, "urn:isocortex:problem:layer-not-registered", "{view}");
    }
    workers.shut_down(Duration::from_secs(60)).await;
}

#[tokio::test]
async fn a_layer_of_a_case_that_is_being_deleted_leaves_nothing() {
    let (server, _) = Server::with_case().await;
    let (volume, mask) = head();
    let workers = start_workers(server.cases.library.clone(), 1);
    for wait_ms in [0, 5, 20, 80, 300] {
        let parts = form(&[("volume", volume), ("mask", mask)]);
        let answer = server.post_form(parts).await;
        assert!([200, 202].contains(&answer.status), "{answer:?}");
        let case = answer.header("location").to_owned();
        assert_eq!(server.settled(&case).await, "ready");
        let file = flair(3.0);
        let delete = async {
            tokio::time::sleep(Duration::from_millis(wait_ms)).await;
            let body = Body::empty();
            server.ask(Method::DELETE, &case, &[], body).await
        };
        let (added, deleted) = tokio::join!(add(&server, &case, &file, json!({})), delete);
        assert_eq!(deleted.status, 204, "{deleted:?}");
        if added.status != 202 {
            assert_eq!(added.refusal(), (404, "no-such-case".to_owned()));
        }
        let layers = server.get(&format!("{case}/layers")).await;
        assert_eq!(layers.refusal(), (404, "no-such-case".to_owned()));
    }
    // The preparation of a layer may go on for a moment.
    workers.shut_down(Duration::from_secs(60)).await;
    server.is_empty_and_well().await;
}
