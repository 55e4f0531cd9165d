//! Maps of the junction of grey and white matter: made, stored, drawn and served.

use std::io::Read as _;

use analysis::testing::brain::{self, BrainPhantom};
use axum::body::Body;
use axum::http::{Request, StatusCode};
use cases::settings::GpuUse;
use cases::settings::MapsUse;
use geometry::{Grid, Mask, Rescale, Volume};
use glam::DVec3;
use isocortex::config::Config;
use serde_json::{Value, json};

use crate::findings;
use crate::interface::gifti_arrays;
use crate::server::{Answer, Server};
use crate::until::until;

/// Half axes of the brain, in mm.
const OUTLINE_MM: DVec3 = DVec3::new(62.0, 76.0, 56.0);
/// How far below the outline fluid ends and white matter begins, in mm.
const FLUID_MM: f64 = 5.0;
const JUNCTION_MM: f64 = 12.0;
/// The place at which the junction is blurred: on the patient's left, in front and above, LPS mm.
const LESION: DVec3 = DVec3::new(36.0, -24.0, 26.0);
const LESION_MM: f64 = 7.0;
const SPACING_MM: f64 = 1.6;
const SIZE: [usize; 3] = [84, 102, 78];

/// The blur in colours from a lower value on than by default: the head has no folds, and its spread is small.
const OVERLAY: &str = "overlay=blur&overlay_window=1.5,4&overlay_threshold=1.5";

/// A smooth rise from 0 to 1 about 0, as wide as an error function of deviation 1.
fn rise(place: f64) -> f64 {
    1.0 / (1.0 + (-1.702 * place).exp())
}

/// About how far a position lies below the outline, in mm.
fn below_outline(place: DVec3) -> f64 {
    let scaled = place / OUTLINE_MM;
    let radius = scaled.length().max(1e-9);
    (1.0 - radius) * radius / (scaled / OUTLINE_MM).length().max(1e-9)
}

fn intensity(place: DVec3) -> f64 {
    let below = below_outline(place);
    if below < -4.0 {
        return 0.0;
    }
    let into_lesion = (1.0 - (place.distance(LESION) - LESION_MM) / 2.0).clamp(0.0, 1.0);
    let width_mm = 1.0 + 3.5 * into_lesion;
    let white = rise((below - JUNCTION_MM) / width_mm);
    let tissue = rise((below - FLUID_MM) / 0.8);
    400.0 + 300.0 * (2.0 * tissue - 1.0 + white * tissue)
}

/// A head whose junction is blurred at one place on the left, as files: volume and mask.
fn blurred_head() -> [Vec<u8>; 2] {
    let origin = DVec3::from_array(SIZE.map(|side| (side - 1) as f64 / -2.0 * SPACING_MM));
    let grid = Grid::aligned(SIZE, [SPACING_MM; 3], origin).unwrap();
    let place = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        grid.patient_from_voxel().transform_point3(voxel)
    };
    let speckle = |index: usize| f64::from((index as u32).wrapping_mul(2_654_435_761) >> 24) / 32.0;
    let count = grid.voxel_count();
    let value = |index: usize| match intensity(place(index)) {
        outside if outside <= 0.0 => 0,
        inside => (inside + speckle(index)) as u16,
    };
    let unscaled = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let voxels = (0..count).map(value).collect();
    let brain = (0..count).map(|index| below_outline(place(index)) > 0.0);
    let mask = Mask::new(grid.clone(), brain.collect()).unwrap();
    let volume = Volume::new(grid, voxels, unscaled).unwrap();
    [
        imaging::nifti::write_volume(&volume).unwrap(),
        imaging::nifti::write_mask(&mask).unwrap(),
    ]
}

/// The grid (LPS) and the voxels of a gzipped NIfTI file without extensions.
fn voxels_of<const N: usize, T>(answer: &Answer, number: fn([u8; N]) -> T) -> (Grid, Vec<T>) {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let grid = imaging::nifti::read_grid(&answer.body, &imaging::Limits::default()).unwrap();
    let mut file = Vec::new();
    flate2::read::GzDecoder::new(&answer.body[..])
        .read_to_end(&mut file)
        .unwrap();
    let offset = f32::from_le_bytes(file[108..112].try_into().unwrap()) as usize;
    let voxels = file[offset..].chunks_exact(N);
    let voxels: Vec<_> = voxels
        .map(|bytes| number(bytes.try_into().unwrap()))
        .collect();
    assert_eq!(voxels.len(), grid.voxel_count());
    (grid, voxels)
}

async fn server_with(configure: impl FnOnce(&mut Config)) -> (Server, String) {
    let server = Server::start_with(|config| {
        config.render.gpu = GpuUse::Off;
        configure(config);
    })
    .await;
    let [volume, mask] = blurred_head();
    let case = server
        .prepared(&[("volume", &volume), ("mask", &mask)])
        .await;
    (server, case)
}

/// The answer once what it needs is no longer being made.
pub(crate) async fn settled(server: &Server, address: &str) -> Answer {
    until("the maps are made", async || {
        let answer = server.get(address).await;
        let is_waiting =
            answer.status == StatusCode::CONFLICT && answer.problem() == "layer-not-ready";
        if !is_waiting {
            return Some(answer);
        }
        assert_eq!(answer.header("retry-after"), "2");
        None
    })
    .await
}

/// A server with the blurred head, and its maps made.
async fn ready() -> (Server, String) {
    let (server, case) = server_with(|_| {}).await;
    let answer = settled(&server, &format!("{case}/candidates")).await;
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    (server, case)
}

/// Waits until a case has its maps, or has none for good.
pub(crate) async fn until_maps(server: &Server, case: &str) {
    settled(server, &format!("{case}/candidates")).await;
}

fn picture(answer: &Answer) -> image::RgbImage {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    image::load_from_memory(&answer.body).unwrap().into_rgb8()
}

/// Whether a pixel is not grey.
fn is_coloured(pixel: &image::Rgb<u8>) -> bool {
    pixel.0[0].abs_diff(pixel.0[2]) > 24
}

/// The coloured pixels of the left and of the right half of a picture.
fn coloured(picture: &image::RgbImage) -> [usize; 2] {
    let half = picture.width() / 2;
    let count = |range: std::ops::Range<u32>| {
        let pixels = picture.enumerate_pixels();
        pixels
            .filter(|(x, _, pixel)| range.contains(x) && is_coloured(pixel))
            .count()
    };
    [count(0..half), count(half..picture.width())]
}

#[tokio::test]
async fn a_blur_on_the_left_is_coloured_there_and_not_on_the_right() {
    let (server, case) = ready().await;
    let candidates = server.get(&format!("{case}/candidates")).await.json();
    let first = &candidates["candidates"][0];
    assert_eq!(first["side"], "left", "{candidates}");
    let position: [f64; 3] = serde_json::from_value(first["position_in_patient"].clone()).unwrap();
    let off_mm = DVec3::from_array(position).distance(LESION);
    assert!(off_mm < 12.0, "{off_mm} mm: {first}");
    let depth_mm = first["depth_mm"].as_f64().unwrap();
    for renderer in ["splat", "trace", "mesh"] {
        let sides = async |view: &str| {
            let query = format!("renderer={renderer}&view={view}&{OVERLAY}&width=200&height=200");
            let address = format!("{case}/render?depth_mm={depth_mm}&{query}");
            coloured(&picture(&server.get(&address).await))
        };
        let shown = sides("left").await.iter().sum::<usize>();
        assert!(shown > 60, "{renderer}: {shown}");
        assert_eq!(sides("right").await, [0, 0], "{renderer}");
        // Facing the patient, the left is at the right of the picture; seen from above it is at the left.
        let [left, right] = sides("anterior").await;
        assert!(left == 0 && right > 20, "{renderer}: {left} {right}");
        let [left, right] = sides("superior").await;
        assert!(left > 20 && right == 0, "{renderer}: {left} {right}");
    }
    // On both planes the left is at the right of the picture.
    for (plane, along) in [("axial", 2), ("coronal", 1)] {
        let address = format!(
            "{case}/slices/{plane}?position_mm={}&{OVERLAY}&width=200&height=200",
            position[along]
        );
        let [left, right] = coloured(&picture(&server.get(&address).await));
        assert!(left == 0 && right > 20, "{plane}: {left} {right}");
    }
}

#[tokio::test]
async fn pictures_without_layers_are_what_they_were_and_those_with_layers_are_not() {
    let (server, case) = ready().await;
    let plain = format!("{case}/render?depth_mm=12&width=160&height=160");
    let before = server.get(&plain).await;
    assert_eq!(before.grey().width(), 160);
    assert!(before.header("cache-control").contains("immutable"));
    let mut tags = vec![before.header("etag").to_owned()];
    for layers in [
        "overlay=blur",
        "overlay=blur&overlay_opacity=0.5",
        "overlay=blur&overlay_threshold=1",
        "overlay=asymmetry&overlay_window=-3,3",
        "overlay=sharpness&overlay_colormap=hot",
        "layer=sharpness",
        "layer=sharpness&overlay=blur",
        "layer=junction&window=0.5,2",
    ] {
        let answer = server.get(&format!("{plain}&{layers}")).await;
        assert_eq!(answer.status, StatusCode::OK, "{layers}: {answer:?}");
        assert_ne!(answer.body, before.body, "{layers}");
        assert_eq!(answer.header("cache-control"), "private, no-cache");
        let tag = answer.header("etag").to_owned();
        assert!(!tags.contains(&tag), "{layers}");
        let known = [("if-none-match", tag.as_str())];
        let again = server.get_with(&format!("{plain}&{layers}"), &known).await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED);
        tags.push(tag);
    }
    assert_eq!(server.get(&plain).await.body, before.body);
}

#[tokio::test]
async fn an_annotated_picture_has_the_colours_of_its_overlay_and_the_state_names_it() {
    let (server, case) = ready().await;
    // From the right nothing but the legend is coloured.
    let address = format!("{case}/render?depth_mm=12&view=right&overlay=blur&width=400&height=400");
    let bare = picture(&server.get(&address).await);
    assert_eq!(coloured(&bare), [0, 0]);
    let answer = server.get(&format!("{address}&annotate=true")).await;
    let annotated = picture(&answer);
    let [left, right] = coloured(&annotated);
    assert!(left == 0 && right > 300, "{left} {right}");
    // Heads lie within the circle.
    let is_beside = |x: u32, y: u32| (f64::from(x) - 200.0).hypot(f64::from(y) - 200.0) > 195.0;
    let mut pixels = annotated.enumerate_pixels();
    assert!(pixels.all(|(x, y, pixel)| is_beside(x, y) || !is_coloured(pixel)));
    let reader = png::Decoder::new(std::io::Cursor::new(&answer.body))
        .read_info()
        .unwrap();
    let texts = &reader.info().uncompressed_latin1_text;
    let text = |name: &str| texts.iter().find(|text| text.keyword == name).unwrap();
    assert_eq!(text("overlay").text, "blur");
    assert_eq!(text("overlay_window").text, "2.5,5");
    assert_eq!(text("overlay_colormap").text, "vermilion-yellow");
}

#[tokio::test]
async fn many_pictures_have_layers_as_the_single_ones() {
    let (server, case) = ready().await;
    let post = async |body: Value| {
        let request = Request::post(format!("{case}/renders")).header("accept", "*/*");
        server
            .send(request.body(Body::from(body.to_string())).unwrap())
            .await
    };
    let one = |view: &str, overlay: Value| {
        let size = 160;
        json!({"depth_mm": 12, "view": view, "width": size, "height": size, "overlay": overlay})
    };
    let answer = post(json!({"renders": [one("left", json!("blur"))]})).await;
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(&answer.body)).unwrap();
    let mut png = Vec::new();
    zip.by_index(0).unwrap().read_to_end(&mut png).unwrap();
    let query = "depth_mm=12&view=left&width=160&height=160&overlay=blur";
    let single = server.get(&format!("{case}/render?{query}")).await;
    assert!(png == single.body);
    let renders = [one("left", json!("blur")), one("right", Value::Null)];
    let refused = post(json!({"sheet": true, "renders": renders})).await;
    assert_eq!(refused.problem(), "body-value-out-of-range");
    assert_eq!(refused.json()["parameter"], "renders[1]");
    let renders = [one("left", json!("blur")), one("right", json!("asymmetry"))];
    let sheet = post(json!({"sheet": true, "renders": renders})).await;
    assert_eq!(sheet.status, StatusCode::OK, "{sheet:?}");
    let wrong = post(json!({"renders": [one("left", json!("blurr"))]})).await;
    assert_eq!(wrong.problem(), "no-such-layer");
}

#[tokio::test]
async fn wrong_keys_of_layers_are_named() {
    let (server, case) = ready().await;
    for (query, kind, parameter) in [
        (
            "overlay_opacity=0.5",
            "query-value-out-of-range",
            "overlay_opacity",
        ),
        (
            "overlay=blur&overlay_opacity=2",
            "query-value-out-of-range",
            "overlay_opacity",
        ),
        (
            "overlay=blur&overlay_window=3,1",
            "query-value-out-of-range",
            "overlay_window",
        ),
        (
            "overlay=blur&overlay_window=3",
            "query-value-unreadable",
            "overlay_window",
        ),
        (
            "overlay=blur&overlay_threshold=NaN",
            "query-value-out-of-range",
            "overlay_threshold",
        ),
        (
            "overlay=blur&overlay_colormap=jet",
            "query-value-unreadable",
            "overlay_colormap",
        ),
        ("overlays=blur", "query-unknown-key", ""),
    ] {
        for route in ["render", "slices/axial"] {
            let answer = server.get(&format!("{case}/{route}?{query}")).await;
            assert_eq!(
                answer.status,
                StatusCode::BAD_REQUEST,
                "{query}: {answer:?}"
            );
            assert_eq!(answer.problem(), kind, "{query}");
            let named = answer.json()["parameter"]
                .as_str()
                .unwrap_or_default()
                .to_owned();
            assert_eq!(named, parameter, "{query}");
        }
    }
    for (route, status, kind) in [
        ("layers/smile", 404, "no-such-layer"),
        ("render?overlay=smile", 404, "no-such-layer"),
        ("render?layer=smile", 404, "no-such-layer"),
        ("slices/axial?overlay=smile", 404, "no-such-layer"),
        ("layers/smile/volume", 404, "no-such-layer"),
        ("layers/smile/nifti", 404, "no-such-layer"),
        ("candidates?limit=0", 400, "query-value-out-of-range"),
        ("candidates?limit=61", 400, "query-value-out-of-range"),
        ("profile", 400, "query-key-missing"),
        ("profile?position=1,2", 400, "query-value-unreadable"),
        ("profile?position=500,0,0", 400, "query-value-out-of-range"),
        ("profile?position=1e9,0,0", 400, "query-value-out-of-range"),
    ] {
        let answer = server.get(&format!("{case}/{route}")).await;
        assert_eq!(answer.status.as_u16(), status, "{route}: {answer:?}");
        assert_eq!(answer.problem(), kind, "{route}");
    }
}

#[tokio::test]
async fn layers_are_listed_and_their_voxels_are_those_of_the_nifti() {
    let (server, case) = ready().await;
    let list = server.get(&format!("{case}/layers")).await.json();
    let names: Vec<_> = list["layers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|layer| layer["name"].as_str().unwrap())
        .collect();
    let expected = [
        "blur",
        "thickness",
        "sharpness",
        "asymmetry",
        "intensity-asymmetry",
        "junction",
    ];
    assert_eq!(names, expected);
    // The junction of this head follows its outline, at 12 mm.
    let band = &list["junction_by_depth"][2];
    assert_eq!(
        (&band["from_mm"], &band["to_mm"]),
        (&10.0.into(), &15.0.into())
    );
    let deepest = &list["junction_by_depth"][5];
    assert_eq!(
        (&deepest["from_mm"], deepest.get("to_mm")),
        (&30.0.into(), None)
    );
    // Its regions are in doubt: the share of the cerebrum is unknown.
    assert_eq!(list.get("junction_poorly_met"), None);
    assert!(band["places"].as_u64().unwrap() > 500, "{band}");
    assert!(band["slanted_share"].as_f64().unwrap() > 0.9, "{band}");
    for (number, name) in expected.into_iter().enumerate() {
        let one = server.get(&format!("{case}/layers/{name}")).await.json();
        assert_eq!(one, list["layers"][number]);
        assert_eq!(one["state"], "ready");
        let volume = server.get(&format!("{case}/layers/{name}/volume")).await;
        assert_eq!(volume.status, StatusCode::OK, "{volume:?}");
        let number = |header: &str| volume.header(header).parse::<f32>().unwrap();
        let [scale, offset] = ["x-isocortex-scale", "x-isocortex-offset"].map(number);
        assert_eq!(volume.header("x-isocortex-undefined"), "0");
        assert_eq!(volume.header("x-isocortex-format"), "u8");
        let size: Vec<usize> = volume
            .header("x-isocortex-size")
            .split(',')
            .map(|side| side.parse().unwrap())
            .collect();
        assert_eq!(volume.body.len(), size.iter().product::<usize>());
        let file = server.get(&format!("{case}/layers/{name}/nifti")).await;
        assert!(
            file.header("content-disposition")
                .contains(&format!("{name}.nii.gz"))
        );
        let (grid, numbers) = voxels_of(&file, f32::from_le_bytes);
        assert_eq!(grid.size(), SIZE, "that of the volume");
        // The map is a block of it, whose affine the header states.
        let rows = volume.header("x-isocortex-patient-from-voxel");
        let rows: Vec<f64> = (rows.split(',').map(str::trim))
            .map(|one| one.parse().unwrap())
            .collect();
        let first = DVec3::new(rows[3], rows[7], rows[11]);
        let first = grid.voxel_from_patient().transform_point3(first).round();
        let first = first.to_array().map(|along| along as usize);
        let mut defined = 0;
        for (index, &code) in volume
            .body
            .iter()
            .enumerate()
            .filter(|(_, code)| **code > 0)
        {
            let place = [
                index % size[0],
                index / size[0] % size[1],
                index / size[0] / size[1],
            ];
            let found = numbers[grid.index([0, 1, 2].map(|axis| first[axis] + place[axis]))];
            let expected = f32::from(code) * scale + offset;
            assert!(
                (found - expected).abs() < 1e-4,
                "{name}: {found} {expected}"
            );
            defined += 1;
        }
        assert!(defined > 1000, "{name}: {defined}");
        let elsewhere = numbers.iter().filter(|number| number.is_nan()).count();
        assert_eq!(elsewhere + defined, grid.voxel_count(), "{name}");
    }
    let packed = [("accept-encoding", "zstd")];
    let packed = server
        .get_with(&format!("{case}/layers/blur/volume"), &packed)
        .await;
    let whole = server.get(&format!("{case}/layers/blur/volume")).await;
    assert_eq!(packed.header("content-encoding"), "zstd");
    assert!(zstd::decode_all(&packed.body[..]).unwrap() == whole.body);
}

/// The head of this test has no cerebellum.
#[tokio::test]
async fn a_list_states_what_stands_out_and_doubts_the_regions_of_half_a_brain() {
    let (server, case) = ready().await;
    let list = server.get(&format!("{case}/candidates")).await.json();
    assert_eq!(list["regions"]["state"], "review", "{list}");
    let codes = list["regions"]["reason_codes"].as_array().unwrap();
    let reasons = list["regions"]["reasons"].as_array().unwrap();
    assert!(!codes.is_empty() && codes.len() == reasons.len(), "{list}");
    let limits = [
        &list["limits"]["borderline_from"],
        &list["limits"]["unusual_above"],
    ];
    let [borderline, unusual] = limits.map(|limit| limit.as_f64().unwrap());
    let mut stands_out = false;
    for place in list["candidates"].as_array().unwrap() {
        assert_eq!(place["region"], "cerebrum", "{place}");
        let score = place["score"].as_f64().unwrap();
        let expected = match score {
            _ if score > unusual => "yes",
            _ if score >= borderline => "borderline",
            _ => "no",
        };
        assert_eq!(place["unusual"], expected, "{place}");
        stands_out |= expected == "yes";
    }
    assert_eq!(list["nothing_stands_out"], !stands_out);
    let all = server
        .get(&format!("{case}/candidates?region=all"))
        .await
        .json();
    assert_eq!(
        all["candidates"], list["candidates"],
        "nothing was taken off"
    );
    let unknown = server.get(&format!("{case}/candidates?region=pons")).await;
    assert_eq!(unknown.status, StatusCode::BAD_REQUEST, "{unknown:?}");
}

/// Limits of thickness were read off voxels of at most 1 mm.
#[tokio::test]
async fn a_head_of_coarse_voxels_has_no_limit_of_thickness_and_says_so_everywhere() {
    let (server, case) = ready().await;
    let address = format!("{case}/candidates?map=thickness");
    let thick = server.get(&address).await.json();
    assert_eq!(thick["caveat"]["reason_code"], "thickness-coarse-voxels");
    let reason = thick["caveat"]["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("with voxels of 1.6 mm, no limit"),
        "{reason}"
    );
    assert!(thick["limits"].is_null() && thick["nothing_stands_out"].is_null());
    let places = thick["candidates"].as_array().unwrap();
    assert!(!places.is_empty() && places.iter().all(|place| place["unusual"].is_null()));
    let blur = server.get(&format!("{case}/candidates")).await.json();
    assert_eq!(blur["caveat"]["reason_code"], "blur-coarse-voxels");
    assert_eq!(blur["limits"]["unusual_above"], 2.25);
    let csv = [("accept", "text/csv")];
    let csv = server.get_with(&address, &csv).await;
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let rows = text.split_terminator("\r\n").skip(1);
    assert!(
        rows.clone()
            .all(|row| row.ends_with(",,,thickness-coarse-voxels,,,")),
        "{text}"
    );
    assert_eq!(rows.count(), places.len());
    for (language, of_thickness, of_blur) in [
        (
            "en",
            "no limit of thickness is known",
            "a place that stands out means less",
        ),
        (
            "pt-BR",
            "não se conhece um limite de espessura",
            "um local que se destaca significa menos",
        ),
    ] {
        let report = server
            .get(&format!("{case}/report?language={language}"))
            .await;
        let html = String::from_utf8(report.body.to_vec()).unwrap();
        assert!(
            html.contains(of_thickness) && html.contains(of_blur),
            "{language}"
        );
    }
}

/// A head with a cerebellum below a tentorium, a brain stem and nuclei, as files: volume and mask.
pub(crate) fn whole_head() -> [Vec<u8>; 2] {
    let (volume, mask) = BrainPhantom::PLAIN.head(&brain::grid());
    [
        imaging::nifti::write_volume(&volume).unwrap(),
        imaging::nifti::write_mask(&mask).unwrap(),
    ]
}

#[tokio::test]
async fn places_outside_the_cerebrum_are_listed_on_request_with_their_region() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let [volume, mask] = whole_head();
    let case = server
        .prepared(&[("volume", &volume), ("mask", &mask)])
        .await;
    let usual = settled(&server, &format!("{case}/candidates?limit=60")).await;
    let usual = usual.json();
    assert_eq!(usual["regions"]["state"], "ok", "{}", usual["regions"]);
    let address = format!("{case}/candidates?limit=60&region=all");
    let all = server.get(&address).await.json();
    let places = |list: &Value| list["candidates"].as_array().unwrap().clone();
    let is_cerebrum = |place: &Value| place["region"] == "cerebrum";
    let score = |place: &Value| place["score"].as_f64().unwrap();
    assert!(!places(&usual).is_empty() && places(&usual).iter().all(is_cerebrum));
    let elsewhere = places(&all).into_iter().filter(|place| !is_cerebrum(place));
    let elsewhere: Vec<Value> = elsewhere.collect();
    let known = ["cerebellum", "brain-stem", "deep"];
    assert!(!elsewhere.is_empty(), "{all}");
    for place in &elsewhere {
        assert!(known.iter().any(|name| place["region"] == *name), "{place}");
    }
    let scores: Vec<f64> = places(&all).iter().map(score).collect();
    assert!(scores.is_sorted_by(|a, b| a >= b), "{scores:?}");
    // Places elsewhere do not decide whether something stands out.
    assert_eq!(all["nothing_stands_out"], usual["nothing_stands_out"]);
    let csv = [("accept", "text/csv")];
    let csv = server.get_with(&address, &csv).await;
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    assert_eq!(text.lines().count(), places(&all).len() + 1);
    assert!(known.iter().any(|name| text.contains(&format!(",{name},"))));
    // Thick cortex is a list of its own.
    let address = format!("{case}/candidates?map=thickness&limit=60");
    let thick = server.get(&address).await.json();
    assert!(!places(&thick).is_empty() && places(&thick).iter().all(is_cerebrum));
    assert_ne!(places(&thick), places(&usual));
    assert_eq!(thick["limits"]["unusual_above"], 5.5);
    assert_eq!(usual["limits"]["unusual_above"], 2.25);
    assert!(thick["caveat"].is_null() && usual["caveat"].is_null());
    for place in places(&thick) {
        let expected = match score(&place) {
            score if score > 5.5 => "yes",
            score if score >= 5.0 => "borderline",
            _ => "no",
        };
        assert_eq!(place["unusual"], expected, "{place}");
    }
    let stands_out = places(&thick).iter().any(|place| place["unusual"] == "yes");
    assert_eq!(thick["nothing_stands_out"], !stands_out);
    let unknown = server.get(&format!("{case}/candidates?map=junction")).await;
    assert_eq!(unknown.status, StatusCode::BAD_REQUEST, "{unknown:?}");
    let layers = server.get(&format!("{case}/layers")).await.json();
    let share = layers["junction_poorly_met"].as_f64().unwrap();
    assert!((0.01..0.9).contains(&share), "{share}");
}

#[tokio::test]
async fn a_report_shows_what_stands_out_first_and_doubts_the_regions() {
    let (server, case) = ready().await;
    let list = server.get(&format!("{case}/candidates")).await.json();
    let places = list["candidates"].as_array().unwrap();
    let standing_out = places.iter().filter(|place| place["unusual"] != "no");
    let standing_out = standing_out.count();
    for (language, nothing, others, doubt, region, thickness) in [
        (
            "en",
            "Nothing stands out. This does not exclude a lesion",
            "Other places",
            "The regions of the brain are in doubt",
            "cerebrum",
            "Thickness",
        ),
        (
            "pt-BR",
            "Nada se destaca. Isso não exclui uma lesão",
            "Outros locais",
            "As regiões do encéfalo são duvidosas",
            "cérebro",
            "Espessura",
        ),
    ] {
        let address = format!("{case}/report?language={language}");
        let html = server.get(&address).await;
        assert_eq!(html.status, StatusCode::OK, "{html:?}");
        let html = String::from_utf8(html.body.to_vec()).unwrap();
        assert_eq!(html.contains(nothing), list["nothing_stands_out"] == true);
        assert!(html.contains(doubt), "{language}");
        let heading = format!("<h3>{others}</h3>");
        // The list of thickness is another one.
        let (of_blur, _) = html.split_once(&format!("<h3>{thickness}</h3>")).unwrap();
        let (first, rest) = of_blur.split_once(&heading).unwrap_or((of_blur, ""));
        let rows = |text: &str| text.matches(&format!(">{region}</td>")).count();
        assert_eq!(rows(first), standing_out, "{language}");
        assert_eq!(
            rows(rest),
            places.len().min(20) - standing_out,
            "{language}"
        );
        // Six views at four depths, with and without the map.
        assert_eq!(html.matches("<image").count(), 48);
    }
    let accept = [("accept", "application/pdf")];
    let pdf = server.get_with(&format!("{case}/report"), &accept).await;
    assert!(pdf.body.starts_with(b"%PDF-"), "{pdf:?}");
    let again = server.get_with(&format!("{case}/report"), &accept).await;
    assert!(pdf.body == again.body && pdf.header("etag") == again.header("etag"));
}

#[tokio::test]
async fn candidates_descend_and_come_as_csv_as_well() {
    let (server, case) = ready().await;
    let list = server
        .get(&format!("{case}/candidates?limit=5"))
        .await
        .json();
    let list = list["candidates"].as_array().unwrap();
    assert_eq!(list.len(), 5);
    let scores: Vec<_> = list
        .iter()
        .map(|one| one["score"].as_f64().unwrap())
        .collect();
    assert!(scores.is_sorted_by(|a, b| a >= b), "{scores:?}");
    let accept = [("accept", "text/csv")];
    let csv = server
        .get_with(&format!("{case}/candidates?limit=5"), &accept)
        .await;
    assert_eq!(csv.header("content-type"), "text/csv; charset=utf-8");
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let rows: Vec<_> = text.split_terminator("\r\n").collect();
    assert_eq!(rows.len(), 6);
    assert!(
        rows[0].ends_with(",region,unusual,gyrus,caveat,mni152,talairach,ac_pc"),
        "{text}"
    );
    assert!(
        rows[1].starts_with("1,") && rows[1].contains(",left,"),
        "{text}"
    );
}

#[tokio::test]
async fn places_are_stated_in_the_axes_of_the_commissures_once_a_reader_has_set_them() {
    let (server, case) = ready().await;
    let address = format!("{case}/candidates?limit=1");
    let before = server.get(&address).await;
    assert!(before.json()["candidates"][0]["standard"].is_null());
    let centre = server.get(&case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let [x, y, z] = [0, 1, 2].map(|axis| centre[axis].as_f64().unwrap());
    let commissures = json!({
        "id": "axes", "kind": "acpc", "points_in_patient": [[x, y - 13.0, z], [x, y + 13.0, z]], "depth_mm": 40,
    });
    let body = json!({ "findings": [commissures] })
        .to_string()
        .into_bytes();
    let set = findings::put(&server, &case, "application/json", body).await;
    assert_eq!(set.status, StatusCode::OK, "{set:?}");

    let after = server.get(&address).await;
    assert_ne!(after.header("etag"), before.header("etag"));
    let place = &after.json()["candidates"][0];
    let at = &place["position_in_patient"];
    let [left, back, up] = [0, 1, 2].map(|axis| at[axis].as_f64().unwrap());
    let stated = &place["standard"]["ac_pc"];
    let expected = [x - left, y - back, up - z];
    for (axis, mm) in expected.into_iter().enumerate() {
        let off = (stated[axis].as_f64().unwrap() - mm).abs();
        // The plane between the hemispheres of the phantom is nearly upright.
        assert!(off < 1.5, "{stated} {expected:?}");
    }
    assert!(place["standard"]["mni152"].is_null(), "there is no atlas");
}

#[tokio::test]
async fn values_of_vertices_are_those_of_profiles_through_them() {
    let (server, case) = ready().await;
    let mesh = format!("{case}/mesh?depth_mm=12&contours=12&points=16");
    let positions = server.get(&mesh).await.positions();
    let mut points = Vec::new();
    for [x, y, z] in positions
        .iter()
        .step_by(5)
        .map(|place| place.map(f64::from))
    {
        let address = format!("{case}/profile?position={x},{y},{z}");
        points.push(server.get(&address).await.json()["own"]["point"].clone());
    }
    for name in ["intensity", "depth", "blur", "thickness"] {
        let address = format!("{mesh}&format=gifti&values={name}");
        let answer = server.get(&address).await;
        assert_eq!(answer.header("content-type"), "model/gifti+xml");
        let file = format!("attachment; filename=\"whole-12mm.{name}.shape.gii\"");
        assert_eq!(answer.header("content-disposition"), file);
        let [(about, values)] = &gifti_arrays(&answer.body)[..] else {
            panic!("{name} is one array");
        };
        assert!(
            about.starts_with("Intent=\"NIFTI_INTENT_SHAPE\""),
            "{about}"
        );
        assert_eq!(values.len(), positions.len());
        let values = values.iter().map(|&bits| f32::from_bits(bits));
        let values = values.map(|value| (!value.is_nan()).then_some(value));
        let values: Vec<Option<f32>> = values.step_by(5).collect();
        let key = if name == "depth" { "depth_mm" } else { name };
        let expected = points.iter().map(|point| point[key].as_f64());
        let expected: Vec<_> = expected.map(|value| Some(value? as f32)).collect();
        assert_eq!(values, expected, "{name}");
        assert!(values.iter().flatten().count() > 10, "{name}: {values:?}");
        // FreeSurfer's are the same.
        let address = format!("{mesh}&format=freesurfer&values={name}");
        let curv = server.get(&address).await;
        let file = format!("attachment; filename=\"whole.12mm.{name}\"");
        assert_eq!(curv.header("content-disposition"), file);
        let (head, curv) = curv.body.split_at(15);
        assert_eq!(head[..3], [0xff; 3]);
        assert_eq!(head[3..7], (positions.len() as u32).to_be_bytes());
        assert_eq!(head[11..], [0, 0, 0, 1]);
        let curv = curv.chunks_exact(20);
        let curv = curv.map(|four| f32::from_be_bytes(four[..4].try_into().unwrap()));
        let curv = curv.map(|value| (!value.is_nan()).then_some(value));
        assert!(
            curv.eq(values.into_iter().take(positions.len() / 5)),
            "{name}"
        );
    }
}

#[tokio::test]
async fn the_curved_cut_comes_as_data_with_a_column_for_each_depth() {
    let (server, case) = ready().await;
    let mesh = format!("{case}/mesh?contours=12&points=16&format=gifti");
    let answer = server
        .get(&format!("{mesh}&values=intensity&by_depth=true"))
        .await;
    let name = "attachment; filename=\"whole.intensity.func.gii\"";
    assert_eq!(answer.header("content-disposition"), name);
    let columns = gifti_arrays(&answer.body);
    assert_eq!(columns.len(), 31);
    let values = |columns: &[(String, Vec<u32>)], at: usize| -> Vec<Option<f32>> {
        let values = columns[at].1.iter().map(|&bits| f32::from_bits(bits));
        values
            .map(|value| (!value.is_nan()).then_some(value))
            .collect()
    };
    let mut lacking = Vec::new();
    for depth in [0, 7, 20, 30] {
        let about = &columns[depth].0;
        assert!(about.contains(&format!("<Value>intensity at {depth} mm</Value>")));
        let at = format!("{mesh}&depth_mm={depth}");
        let depths = server.get(&format!("{at}&values=depth")).await;
        let depths = values(&gifti_arrays(&depths.body), 0);
        let own = server.get(&format!("{at}&values=intensity")).await;
        let own = values(&gifti_arrays(&own.body), 0);
        let is_there = |vertex: usize| depths[vertex].is_some_and(|mm| mm > depth as f32 - 0.1);
        let expected: Vec<_> = (0..own.len())
            .map(|vertex| own[vertex].filter(|_| is_there(vertex)))
            .collect();
        assert_eq!(values(&columns, depth), expected, "{depth} mm");
        lacking.push(expected.iter().filter(|value| value.is_none()).count());
    }
    assert!(lacking[0] < 10, "{lacking:?}");
}

#[tokio::test]
async fn places_are_labels_where_the_surface_meets_them() {
    let (server, case) = ready().await;
    let list = server
        .get(&format!("{case}/candidates?limit=60"))
        .await
        .json();
    let places = list["candidates"].as_array().unwrap();
    let depth = places[0]["depth_mm"].as_f64().unwrap();
    let mesh = format!("{case}/mesh?depth_mm={depth}&contours=90&points=90&paths=flow");
    let positions = server.get(&mesh).await.positions();
    let labels = format!("{mesh}&format=gifti&values=blur-places");
    let answer = server.get(&labels).await;
    let name = answer.header("content-disposition").to_owned();
    assert!(name.ends_with(".blur-places.label.gii\""), "{name}");
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    assert_eq!(text.matches("<Label Key=").count(), places.len() + 1);
    assert!(text.contains(">1: score "), "{text}");
    let [(about, labels)] = &gifti_arrays(&answer.body)[..] else {
        panic!("labels are one array");
    };
    assert!(
        about.starts_with("Intent=\"NIFTI_INTENT_LABEL\""),
        "{about}"
    );
    let far = |place: &Value, position: &[f32; 3]| -> bool {
        let middle: [f64; 3] =
            serde_json::from_value(place["position_in_patient"].clone()).unwrap();
        let radius = (place["size_mm"].as_f64().unwrap() / 2.0).max(1.5);
        let position = glam::Vec3::from_array(*position).as_dvec3();
        glam::DVec3::from_array(middle).distance(position) > radius
    };
    let expected = positions.iter().map(|position| {
        let found = places.iter().position(|place| !far(place, position));
        found.map_or(0, |number| number as u32 + 1)
    });
    assert_eq!(*labels, expected.collect::<Vec<_>>());
    assert!(labels.contains(&1));
}

#[tokio::test]
async fn a_profile_tells_how_wide_the_junction_is_on_both_sides() {
    let (server, case) = ready().await;
    let candidates = server.get(&format!("{case}/candidates")).await.json();
    let position = &candidates["candidates"][0]["position_in_patient"];
    let [x, y, z]: [f64; 3] = serde_json::from_value(position.clone()).unwrap();
    let address = format!("{case}/profile?position={x},{y},{z}");
    let profile = server.get(&address).await.json();
    let [own, mirrored] = ["own", "mirrored"].map(|name| &profile[name]);
    assert_eq!([&own["side"], &mirrored["side"]], ["left", "right"]);
    let width = |point: &Value| point["junction_width"]["mm"].as_f64();
    let [blurred, sharp] = [width(own).unwrap(), width(mirrored).unwrap_or(1.0)];
    assert!(blurred > 1.4 * sharp, "{blurred} {sharp}");
    assert!(own["point"]["blur"].as_f64().unwrap() > 2.5);
    assert_eq!(own["point"]["position_in_patient"], *position);
    let samples = own["samples"].as_array().unwrap();
    let depths: Vec<_> = samples
        .iter()
        .map(|one| one["depth_mm"].as_f64().unwrap())
        .collect();
    assert!(depths.is_sorted(), "{depths:?}");
    assert!(
        depths[0] < 1.0 && *depths.last().unwrap() > 20.0,
        "{depths:?}"
    );
    let intensities: Vec<_> = samples
        .iter()
        .map(|one| one["intensity"].as_f64().unwrap())
        .collect();
    let [first, last] = [intensities[0], *intensities.last().unwrap()];
    assert!(first < 300.0 && last > 900.0, "{intensities:?}");
    let csv = server.get_with(&address, &[("accept", "text/csv")]).await;
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let rows = samples.len() + mirrored["samples"].as_array().unwrap().len();
    assert_eq!(text.split_terminator("\r\n").count(), rows + 1);
}

/// The files of stored maps.
fn stored_maps(server: &Server) -> Vec<std::path::PathBuf> {
    let mut files = server.stored_files();
    files.retain(|file| file.to_string_lossy().contains("maps"));
    files
}

#[tokio::test]
async fn a_restarted_server_serves_the_same_maps_and_makes_them_again_if_they_are_gone() {
    let (server, case) = ready().await;
    let routes = [
        "candidates",
        "layers/blur/volume",
        "render?depth_mm=12&overlay=blur",
    ];
    let mut before = Vec::new();
    for route in routes {
        before.push(server.get(&format!("{case}/{route}")).await);
    }
    let server = server.restart().await;
    for (route, before) in routes.iter().zip(&before) {
        let after = server.get(&format!("{case}/{route}")).await;
        assert_eq!(after.status, StatusCode::OK, "{route}: {after:?}");
        assert!(after.body == before.body, "{route}");
        assert_eq!(after.header("etag"), before.header("etag"));
    }
    let [file] = &stored_maps(&server)[..] else {
        panic!("one object of maps: {:?}", server.stored_files());
    };
    let damages: [fn(&std::path::Path); 2] = [
        |file| std::fs::remove_file(file).unwrap(),
        |file| {
            let mut bytes = std::fs::read(file).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            std::fs::write(file, bytes).unwrap();
        },
    ];
    let mut server = server;
    for damage in damages {
        // Nothing of the maps is in memory after a start.
        server = server.restart().await;
        damage(file);
        let address = format!("{case}/{}", routes[0]);
        let answer = server.get(&address).await;
        assert_eq!(answer.status, StatusCode::CONFLICT);
        assert_eq!(answer.problem(), "layer-not-ready");
        assert_eq!(answer.header("retry-after"), "2");
        let state = server.get(&case).await.json()["maps"]["state"].clone();
        assert!(
            ["making", "ready"].map(Value::from).contains(&state),
            "{state}"
        );
        // The case itself stays ready meanwhile.
        let plain = server.get(&format!("{case}/render?depth_mm=12")).await;
        assert_eq!(plain.status, StatusCode::OK);
        for (route, before) in routes.iter().zip(&before) {
            let after = settled(&server, &format!("{case}/{route}")).await;
            assert!(after.body == before.body, "{route}");
        }
        assert!(file.exists());
    }
    assert_eq!(
        server.get(&case).await.json()["maps"],
        json!({"state": "ready"})
    );
}

#[tokio::test]
async fn switched_off_there_are_no_maps_and_a_stored_case_gets_them_when_it_is_opened_later() {
    let (server, case) = server_with(|config| config.limits.maps = MapsUse::Off).await;
    let said = server.get(&case).await.json()["maps"].clone();
    assert_eq!(said["state"], "off");
    for route in [
        "candidates",
        "layers/blur/volume",
        "render?overlay=blur",
        "slices/axial?layer=blur",
        "mesh?format=gifti&values=thickness",
    ] {
        let answer = server.get(&format!("{case}/{route}")).await;
        assert_eq!(answer.status, StatusCode::CONFLICT, "{route}");
        assert_eq!(answer.problem(), "maps-undefined");
        assert!(
            answer.json()["detail"]
                .as_str()
                .unwrap()
                .contains("`limits.maps` is off")
        );
        assert_eq!(
            answer.header("retry-after"),
            "",
            "to come again does not help"
        );
    }
    let profile = server
        .get(&format!("{case}/profile?position=30,-20,30"))
        .await
        .json();
    assert_eq!(profile["own"]["point"]["blur"], Value::Null);
    assert!(profile["maps_undefined"].as_str().unwrap().contains("off"));
    assert!(stored_maps(&server).is_empty());
    let server = server
        .restart_with(|config| config.limits.maps = MapsUse::On)
        .await;
    // A picture is enough.
    let opened = server.get(&format!("{case}/render?depth_mm=12")).await;
    assert_eq!(opened.status, StatusCode::OK);
    let are_stored = async || (!stored_maps(&server).is_empty()).then_some(());
    until("maps are stored", are_stored).await;
    assert_eq!(stored_maps(&server).len(), 1, "nobody asked for maps");
    let answer = settled(&server, &format!("{case}/candidates")).await;
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
}

#[tokio::test]
async fn a_head_of_coarse_voxels_has_no_maps_and_says_why() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = server.plain_case().await;
    let answer = settled(&server, &format!("{case}/candidates")).await;
    assert_eq!(answer.status, StatusCode::CONFLICT, "{answer:?}");
    assert_eq!(answer.problem(), "maps-undefined");
    let detail = answer.json()["detail"].clone();
    assert!(detail.as_str().unwrap().contains("4.00 mm"), "{detail}");
    let said = server.get(&case).await.json()["maps"].clone();
    let expected = json!({"state": "undefined", "reason": detail, "reason_code": "coarse-voxels"});
    assert_eq!(said, expected);
    let layer = server.get(&format!("{case}/layers/blur")).await.json();
    assert_eq!(layer["state"], "undefined");
    assert_eq!(layer["reason_code"], "coarse-voxels");
    let refused = server.get(&format!("{case}/render?overlay=blur")).await;
    assert_eq!(refused.problem(), "maps-undefined");
    let plain = server.get(&format!("{case}/render")).await;
    assert_eq!(plain.status, StatusCode::OK);
    // The list of cases asks for no maps.
    let list = server.get("/v1/cases").await.json();
    assert_eq!(list["cases"][0].get("maps"), None);
}

#[tokio::test]
async fn what_is_known_of_voxels_is_written_in_the_grid_of_the_volume_with_the_left_on_the_left() {
    let (server, case) = ready().await;
    let get = async |values: &str| server.get(&format!("{case}/nifti?values={values}")).await;
    let labels = async |values: &str| voxels_of(&get(values).await, u16::from_le_bytes);
    let (grid, depth) = voxels_of(&get("depth").await, f32::from_le_bytes);
    let (_, brain) = voxels_of(&get("brain").await, |[voxel]: [u8; 1]| voxel);
    let (_, sides) = labels("sides").await;
    let (_, regions) = labels("regions").await;
    let (_, places) = labels("blur-places").await;
    assert_eq!(grid.size(), SIZE);
    let at = |place: DVec3| {
        grid.nearest(grid.voxel_from_patient().transform_point3(place))
            .unwrap()
    };
    // The lesion is on the left, at the junction: 12 mm below the outline.
    let (left, right) = (at(LESION), at(LESION * DVec3::new(-1.0, 1.0, 1.0)));
    for voxel in [left, right] {
        assert!((depth[voxel] - 12.0).abs() < 3.0, "{}", depth[voxel]);
        assert_eq!(brain[voxel], 1);
    }
    assert_eq!(
        [sides[left], sides[right], sides[at(DVec3::ZERO)]],
        [1, 2, 3]
    );
    assert_eq!([regions[left], regions[right]], [1, 2]);
    let list: Value = server.get(&format!("{case}/candidates")).await.json();
    let highest: [f64; 3] =
        serde_json::from_value(list["candidates"][0]["position_in_patient"].clone()).unwrap();
    assert_eq!(places[at(DVec3::from_array(highest))], 1);
    assert!(places[left] > 0 || DVec3::from_array(highest).distance(LESION) < 15.0);
    let marked = places.iter().filter(|rank| **rank > 0).count();
    assert!((10..grid.voxel_count() / 20).contains(&marked), "{marked}");
    let outside = at(DVec3::new(0.0, 0.0, 60.5));
    assert!(depth[outside].is_nan());
    assert_eq!(
        (brain[outside], sides[outside], regions[outside]),
        (0, 0, 0)
    );
    for (values, status, problem) in [
        ("flair", 409, "maps-undefined"),
        ("smile", 400, "query-value-unreadable"),
    ] {
        let answer = get(values).await;
        assert_eq!(
            (answer.status.as_u16(), &*answer.problem()),
            (status, problem)
        );
    }
}
