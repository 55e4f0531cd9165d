//! The map of a FLAIR: from the upload of the layer to the list, the picture and the report, and away with the layer.

use analysis::testing::brain::{BrainPhantom, SimulatedLayer};
use axum::body::Body;
use axum::http::{Method, Request, StatusCode, header};
use cases::settings::GpuUse;
use geometry::Volume;
use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Value, json};

use crate::dicom::reader;
use crate::findings::put;
use crate::interface::gifti_arrays;
use crate::maps::{settled, until_maps, whole_head};
use crate::series_builder::{Slice, Syntax, files};
use crate::server::{Answer, Part, Server, form, form_type};
use crate::until::until;

/// The overlay from a lower value on than by default: the phantom has a large spread.
const OVERLAY: &str = "overlay=flair&overlay_window=2,4&overlay_threshold=2";

/// The head of the phantom, ready and with its maps.
async fn ready() -> (Server, String) {
    let server = Server::start_with(|config| {
        config.render.gpu = GpuUse::Off;
        config.dicom_program = reader();
    })
    .await;
    let [volume, mask] = whole_head();
    let case = server
        .prepared(&[("volume", &volume), ("mask", &mask)])
        .await;
    until_maps(&server, &case).await;
    (server, case)
}

/// A FLAIR that is brighter at one place on the patient's left, in a space of its own.
fn ill() -> SimulatedLayer {
    SimulatedLayer {
        brighter: 0.35,
        case_from_layer: DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(0.1),
            DVec3::new(6.0, -8.0, 4.0),
        ),
        ..SimulatedLayer::FLAIR
    }
}

fn nifti(layer: &SimulatedLayer) -> Vec<u8> {
    imaging::nifti::write_volume(&BrainPhantom::PLAIN.other_contrast(layer)).unwrap()
}

/// A volume along the axes of the patient as the files of a series.
fn series(volume: &Volume) -> Vec<Vec<u8>> {
    let grid = volume.grid();
    let [columns, rows, slices] = grid.size();
    let [x, y, z] = grid.spacing_mm();
    let slice = |number: usize| {
        let first = DVec3::new(0.0, 0.0, number as f64);
        let place = grid.patient_from_voxel().transform_point3(first);
        Slice {
            description: "t2_space_dark-fluid_sag",
            echo_ms: 390.0,
            position: place.to_array(),
            spacing: [y, x],
            columns: columns as u16,
            samples: volume.voxels()[number * columns * rows..][..columns * rows].to_vec(),
            bits_stored: 16,
            ..Slice::number(number)
        }
    };
    assert!(z > 0.0);
    let slices: Vec<_> = (0..slices).map(slice).collect();
    files(&slices, Syntax::Explicit)
}

async fn post(server: &Server, address: &str, parts: &[Part<'_>]) -> Answer {
    let request = Request::post(address)
        .header(header::CONTENT_TYPE, form_type())
        .body(Body::from(form(parts)));
    server.send(request.unwrap()).await
}

/// Adds a layer and waits until it is ready; what it says then.
pub(crate) async fn added(server: &Server, case: &str, parts: &[Part<'_>]) -> Value {
    let answer = post(server, &format!("{case}/layers"), parts).await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{answer:?}");
    let address = answer.header("location").to_owned();
    let layer = server.until_ready(&address).await;
    assert_eq!(layer["contrast"], "flair", "{layer}");
    layer
}

pub(crate) async fn patch(server: &Server, address: &str, change: Value) -> Answer {
    let request = Request::patch(address)
        .header(header::CONTENT_TYPE, "application/json")
        .body(Body::from(change.to_string()));
    server.send(request.unwrap()).await
}

/// The map in the list of layers, once it is not being made.
async fn listed(server: &Server, case: &str) -> Option<Value> {
    until("the map of the FLAIR is made", async || {
        let list = server.get(&format!("{case}/layers")).await.json();
        let mut layers = list["layers"].as_array().unwrap().iter();
        let flair = layers.find(|layer| layer["id"] == "flair").cloned();
        let is_making = flair.as_ref().is_some_and(|map| map["state"] == "making");
        (!is_making).then_some(flair)
    })
    .await
}

async fn first_place(server: &Server, case: &str) -> (DVec3, f64) {
    let list = settled(server, &format!("{case}/candidates?map=flair")).await;
    assert_eq!(list.status, StatusCode::OK, "{list:?}");
    let list = list.json();
    // No limit is known for this map.
    assert_eq!(list["caveat"]["reason_code"], "untested-flair", "{list}");
    assert!(
        list["limits"].is_null() && list["nothing_stands_out"].is_null(),
        "{list}"
    );
    let first = &list["candidates"][0];
    assert!(first["unusual"].is_null(), "{first}");
    let position: [f64; 3] = serde_json::from_value(first["position_in_patient"].clone()).unwrap();
    (
        DVec3::from_array(position),
        first["score"].as_f64().unwrap(),
    )
}

/// The pixels that are not grey on the left and on the right half of a picture.
fn coloured(answer: &Answer) -> [usize; 2] {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let picture = image::load_from_memory(&answer.body).unwrap().into_rgb8();
    let mut counts = [0; 2];
    for (x, _, pixel) in picture.enumerate_pixels() {
        let half = usize::from(x >= picture.width() / 2);
        counts[half] += usize::from(pixel.0[0].abs_diff(pixel.0[2]) > 24);
    }
    counts
}

#[tokio::test]
async fn the_newest_flair_has_a_map_that_is_listed_drawn_and_reported_and_goes_with_its_layer() {
    let (server, case) = ready().await;
    assert_eq!(listed(&server, &case).await, None);
    let none = server.get(&format!("{case}/layers/flair")).await.json();
    assert_eq!(none["reason_code"], "no-flair", "{none}");
    let refused = server.get(&format!("{case}/candidates?map=flair")).await;
    assert_eq!(refused.problem(), "maps-undefined");
    let values = format!("{case}/mesh?depth_mm=8&format=gifti&values=flair");
    let refused = server.get(&values).await;
    assert_eq!(refused.problem(), "maps-undefined");
    let address = format!("{case}/report");
    let without = server.get(&address).await;
    let text = String::from_utf8(without.body.to_vec()).unwrap();
    assert!(
        !text.contains("FLAIR"),
        "nothing is said about what is not there"
    );

    // As NIfTI, with the contrast given.
    let (volume, parameters) = (nifti(&ill()), json!({"contrast": "flair"}).to_string());
    let parts = [
        ("volume", &volume[..]),
        ("parameters", parameters.as_bytes()),
    ];
    let first = added(&server, &case, &parts).await;
    assert_eq!(first["verdict"], "registered", "{first}");
    let map = listed(&server, &case).await.unwrap();
    assert_eq!(map["state"], "ready", "{map}");
    assert_eq!(map["of_layer"], first["id"]);
    let (place, score) = first_place(&server, &case).await;
    let lesion = ill().lesion.0;
    assert!(place.distance(lesion) < 9.0, "{place} with {score}");
    let csv = [("accept", "text/csv")];
    let csv = server
        .get_with(&format!("{case}/candidates?map=flair"), &csv)
        .await;
    let csv = String::from_utf8(csv.body.to_vec()).unwrap();
    assert!(csv.starts_with("rank,"), "{csv}");
    assert!(csv.contains(",cerebrum,,"), "{csv}");
    // On an axial slice, the left is at the right of the picture.
    let slice = format!("{case}/slices/axial?position_mm={}&{OVERLAY}", place.z);
    let drawn = server.get(&format!("{slice}&width=200&height=200")).await;
    let [left, right] = coloured(&drawn);
    assert!(right > 20 && right > 2 * left, "{left} {right}");
    let depth = server
        .get(&format!("{case}/candidates?map=flair"))
        .await
        .json();
    let depth_mm = &depth["candidates"][0]["depth_mm"];
    let head =
        format!("{case}/render?depth_mm={depth_mm}&view=left&{OVERLAY}&width=200&height=200");
    assert!(coloured(&server.get(&head).await).iter().sum::<usize>() > 20);
    let voxels = server.get(&format!("{case}/layers/flair/volume")).await;
    assert_eq!(voxels.header("x-isocortex-format"), "u8");
    // Kept from its list, it is reported with the map and the score for which it was kept.
    let finding = json!({
        "id": "a", "kind": "point", "from_map": "flair", "depth_mm": depth_mm,
        "points_in_patient": [depth["candidates"][0]["position_in_patient"]],
    });
    let kept = json!({"findings": [finding]}).to_string().into_bytes();
    let kept = put(&server, &case, "application/json", kept).await;
    assert_eq!(kept.status, StatusCode::OK, "{kept:?}");
    let report = server.get(&address).await;
    assert_ne!(report.header("etag"), without.header("etag"));
    let text = String::from_utf8(report.body.to_vec()).unwrap();
    let (front, rest) = text
        .split_once(r#"<section class="page finding">"#)
        .unwrap();
    let cell = format!(">{score:.2}</td>");
    assert!(
        front.contains("map of the FLAIR") && front.contains(&cell),
        "{cell}"
    );
    let (page, appendix) = rest.split_once("</section>").unwrap();
    assert!(page.contains("<figcaption>T1, map of the FLAIR, "));
    assert!(
        !appendix.contains(&cell),
        "it is no place that was not kept"
    );
    assert!(text.contains("<h3>FLAIR signal</h3>"), "{text}");
    assert!(text.contains("No limit is known for this map"), "{text}");

    // A newer one of the same head, as DICOM: its header tells the contrast.
    let sound = BrainPhantom::PLAIN.other_contrast(&SimulatedLayer::FLAIR);
    let files = series(&sound);
    let parts: Vec<Part<'_>> = files.iter().map(|file| ("dicom", &file[..])).collect();
    let second = added(&server, &case, &parts).await;
    assert_eq!(second["name"], "FLAIR");
    let map = listed(&server, &case).await.unwrap();
    assert_eq!(map["of_layer"], second["id"]);
    let (_, highest) = first_place(&server, &case).await;
    assert!(highest < score - 0.8, "{highest} and {score}");
    let other = server.get(&format!("{slice}&width=200&height=200")).await;
    assert_ne!(other.header("etag"), drawn.header("etag"));

    // It is no FLAIR after all: the older one has the map again.
    let second = format!("{case}/layers/{}", second["id"].as_str().unwrap());
    let changed = patch(&server, &second, json!({"contrast": "t2"})).await;
    assert_eq!(changed.json()["contrast"], "t2", "{changed:?}");
    assert_eq!(
        listed(&server, &case).await.unwrap()["of_layer"],
        first["id"]
    );
    assert_eq!(first_place(&server, &case).await, (place, score));
    let again = server.get(&format!("{slice}&width=200&height=200")).await;
    assert_eq!(again.header("etag"), drawn.header("etag"));

    // Values of vertices are revalidated: another layer may be the newest.
    let drawn = server.get(&values).await;
    assert_eq!(drawn.header("cache-control"), "private, no-cache");
    let [(_, numbers)] = &gifti_arrays(&drawn.body)[..] else {
        panic!("values are one array");
    };
    let is_number = |bits: &&u32| f32::from_bits(**bits).is_finite();
    let defined = numbers.iter().filter(is_number).count();
    assert!((1..numbers.len()).contains(&defined), "{defined}");

    // The map goes with its layer.
    let stored = server.stored_files().len();
    let first = format!("{case}/layers/{}", first["id"].as_str().unwrap());
    let deleted = server.method(Method::DELETE, &first).await;
    assert_eq!(deleted.status, StatusCode::NO_CONTENT);
    assert_eq!(listed(&server, &case).await, None);
    assert_eq!(
        server.stored_files().len(),
        stored - 4,
        "source, manifest, voxels and map"
    );
    let gone = server.get(&slice).await;
    assert_eq!(gone.problem(), "maps-undefined");
}

#[tokio::test]
async fn a_flair_whose_place_is_doubtful_or_that_is_coarse_has_no_map_and_a_reason() {
    let (server, case) = ready().await;
    let flat = SimulatedLayer {
        spacing_mm: [1.5, 1.5, 4.0],
        ..SimulatedLayer::FLAIR
    };
    let t2 = SimulatedLayer::T2;
    for (layer, transform, code) in [
        (SimulatedLayer::FLAIR, "none", "flair-place-doubtful"),
        (flat, "auto", "flair-coarse-voxels"),
        (t2, "auto", "flair-bright-fluid"),
    ] {
        let parameters = json!({"name": format!("FLAIR {code}"), "transform": transform});
        let (volume, parameters) = (nifti(&layer), parameters.to_string());
        let parts = [
            ("volume", &volume[..]),
            ("parameters", parameters.as_bytes()),
        ];
        added(&server, &case, &parts).await;
        let map = listed(&server, &case).await.unwrap();
        assert_eq!(map["state"], "undefined", "{map}");
        assert_eq!(map["reason_code"], code, "{map}");
        let refused = server.get(&format!("{case}/render?overlay=flair")).await;
        assert_eq!(refused.problem(), "maps-undefined");
    }
    let report = server.get(&format!("{case}/report")).await;
    let text = String::from_utf8(report.body.to_vec()).unwrap();
    assert!(
        text.contains("The FLAIR has no map: Fluid is brighter"),
        "{text}"
    );
    let wrong = json!({"contrast": "flair", "kind": "pet"}).to_string();
    let volume = nifti(&SimulatedLayer::T2);
    let parts = [("volume", &volume[..]), ("parameters", wrong.as_bytes())];
    let refused = post(&server, &format!("{case}/layers"), &parts).await;
    assert_eq!(refused.problem(), "contrast-unexpected");
}
