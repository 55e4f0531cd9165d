//! Results as DICOM objects: valid, of the right patient, with the pixels that were asked for, and sent until they are there.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{Method, Request, StatusCode};
use axum::routing::{MethodRouter, post};
use isocortex::config::Config;
use pacs::settings::Node;
use serde_json::{Value, json};
use tokio::net::TcpListener;

use crate::dicom::head_slices;
use crate::head::{mask_of, plain_head};
use crate::maps::until_maps;
use crate::pacs::{Neighbour, an_image, with_texts};
use crate::scopes::TokensFile;
use crate::server::{Answer, Server};
use crate::skipped;
use crate::until::until;

pub(crate) const IDENTITY: [([u16; 2], &str, &str); 12] = [
    ([0x08, 0x0005], "CS", "ISO_IR 192"),
    ([0x08, 0x0020], "DA", "20261101"),
    ([0x08, 0x0030], "TM", "101112"),
    ([0x08, 0x0050], "SH", "A-1"),
    ([0x08, 0x0090], "PN", "Doe^Referring"),
    ([0x10, 0x0010], "PN", "Müller^Änne"),
    ([0x10, 0x0030], "DA", "19670312"),
    ([0x10, 0x0040], "CS", "F"),
    ([0x20, 0x0010], "SH", "S-1"),
    ([0x20, 0x0052], "UI", "1.2.3.9"),
    ([0x40, 0x0244], "DA", "20261101"),
    ([0x40, 0x0245], "TM", "101000"),
];

/// The files of the head, with an identity and a frame of reference.
pub(crate) fn identified_head() -> Vec<Vec<u8>> {
    let slices = head_slices();
    slices
        .iter()
        .map(|slice| with_texts(slice, &IDENTITY))
        .collect()
}

/// The address of the case of [`identified_head`], ready.
pub(crate) async fn identified_case(neighbour: &Neighbour) -> String {
    let stored = neighbour.store(&identified_head()).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    neighbour.server.until_ready(&case).await;
    case
}

/// Requests a result.
pub(crate) async fn result(server: &Server, case: &str, body: &Value) -> Answer {
    let request = Request::post(format!("{case}/dicom-results"));
    let request = request.body(Body::from(body.to_string()));
    server.send(request.unwrap()).await
}

/// A small picture, to be quick.
pub(crate) fn small() -> Value {
    json!({"depth_mm": 5, "width": 160, "height": 128})
}

/// The objects of each kind, in a folder.
struct Objects {
    _neighbour: Neighbour,
    case: Value,
    folder: tempfile::TempDir,
    files: Vec<PathBuf>,
}

async fn objects() -> Objects {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    let size = json!({"width": 160, "height": 128});
    for (name, body) in [
        ("view", json!({"what": "view", "render": small()})),
        (
            "plain",
            json!({"what": "view", "render": {"view": "right", "annotate": false}}),
        ),
        (
            "superior",
            json!({"what": "view", "render": {"view": "superior", "depth_mm": 12.4}}),
        ),
        ("sheet", json!({"what": "sheet", "render": size})),
        ("envelope", json!({"what": "envelope"})),
        ("mask", json!({"what": "mask"})),
    ] {
        let answer = result(server, &case, &body).await;
        assert_eq!(answer.status, 200, "{name}: {answer:?}");
        assert_eq!(answer.header("content-type"), "application/dicom");
        assert_eq!(answer.header("cache-control"), "no-store");
        let again = result(server, &case, &body).await;
        assert!(answer.body == again.body, "{name} differs the second time");
        let file = folder.path().join(format!("{name}.dcm"));
        std::fs::write(&file, &answer.body).unwrap();
        files.push(file);
    }
    // The pixels of the view are those of the picture.
    let picture = server
        .get(&format!(
            "{case}/render?depth_mm=5&width=160&height=128&annotate=true"
        ))
        .await;
    let picture = image::load_from_memory(&picture.body).unwrap().into_rgb8();
    let object = std::fs::read(&files[0]).unwrap();
    assert!(object.ends_with(picture.as_raw()));
    assert!(picture.iter().any(|&value| value > 20));
    Objects {
        case: server.get(&case).await.json(),
        _neighbour: neighbour,
        folder,
        files,
    }
}

/// The texts that a program prints; `None`, loudly, if it is not installed.
pub(crate) fn printed(program: &str, arguments: &[&Path]) -> Option<String> {
    let Ok(output) = Command::new(program).args(arguments).output() else {
        skipped(&format!("{program} is not installed"));
        return None;
    };
    let both = [output.stdout, output.stderr].concat();
    Some(String::from_utf8_lossy(&both).into_owned())
}

/// What dciodvfy finds wrong with a file; nothing, loudly, if it is not installed.
pub(crate) fn errors_in(file: &Path) -> Vec<String> {
    let report = printed("dciodvfy", &[Path::new("-new"), file]).unwrap_or_default();
    let lines = report.lines().filter(|line| line.contains("Error"));
    lines.map(str::to_owned).collect()
}

/// A Python with a package; `None`, loudly, if there is none.
pub(crate) fn python_with(package: &str) -> Option<PathBuf> {
    let ours = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/python/bin/python");
    let mut candidates = [ours, "python3"].map(PathBuf::from).into_iter();
    let imports = |python: &PathBuf| {
        let tried = Command::new(python)
            .args(["-c", &format!("import {package}")])
            .output();
        tried.is_ok_and(|output| output.status.success())
    };
    let found = candidates.find(imports);
    if found.is_none() {
        skipped(&format!("no Python with {package} is installed"));
    }
    found
}

#[tokio::test]
async fn every_object_is_valid_of_the_right_patient_and_the_same_every_time() {
    let objects = objects().await;
    for file in &objects.files {
        let name = file.file_stem().unwrap().to_str().unwrap();
        assert_eq!(errors_in(file), Vec::<String>::new(), "{name}");
        let Some(dump) = printed("/usr/bin/dcmdump", &[Path::new("+L"), file]) else {
            continue;
        };
        for expected in [
            "[Müller^Änne]",
            "[P-77]",
            "[19670312]",
            "(0020,000d) UI [1.2.3] ",
            "(0008,0050) SH [A-1]",
            "(0020,0010) SH [S-1]",
            "[ISO_IR 192]",
            "research use only",
            "(0002,0013) SH [ISOCORTEX_",
            "(0008,0021) DA [20",
            "(0008,0031) TM [",
            // A slice through the middle of the brain.
            "(0008,1155) UI [1.2.3.4.20]",
        ] {
            assert!(dump.contains(expected), "{name} lacks {expected}");
        }
        assert!(dump.contains("(0028,2110) CS [00]"), "{name}");
        let is_annotated = !["plain", "envelope", "mask"].contains(&name);
        let burned = if is_annotated { "YES" } else { "NO" };
        assert!(
            dump.contains(&format!("(0028,0301) CS [{burned}")),
            "{name}: {dump}"
        );
        // A curved cut has directions and a side, and no spacing.
        let (directions, side) = match name {
            "view" => (r"(0020,0020) CS [P\F]", "(0020,0062) CS [L]"),
            "plain" => (r"(0020,0020) CS [A\F]", "(0020,0062) CS [R]"),
            "superior" => (r"(0020,0020) CS [R\P]", "(0020,0062) CS [B]"),
            "sheet" => ("(0020,0020) CS (no value available)", "(0020,0062) CS [B]"),
            _ => ("(0028,0030)", "(0028,0030)"),
        };
        assert!(
            dump.contains(directions) && dump.contains(side),
            "{name}: {dump}"
        );
        assert_eq!(
            dump.contains("(0028,0030)"),
            directions == "(0028,0030)",
            "{name}"
        );
        let number = match name {
            "view" => 9105,
            "plain" => 9100,
            "superior" => 9112,
            "sheet" => 9204,
            "envelope" => 9400,
            _ => 9500,
        };
        assert!(
            dump.contains(&format!("(0020,0011) IS [{number}]")),
            "{name}: {dump}"
        );
        let is_sound = objects.case["quality"]["state"] == "ok";
        assert_eq!(dump.contains("(0028,0302) CS [NO]"), is_sound, "{name}");
    }
    let uid = |file: &PathBuf| {
        let bytes = std::fs::read(file).unwrap();
        let at = memchr::memmem::find(&bytes, b"\x08\0\x18\0UI").unwrap();
        bytes[at + 8..at + 30].to_vec()
    };
    let mut uids: Vec<_> = objects.files.iter().map(uid).collect();
    uids.dedup();
    assert_eq!(uids.len(), objects.files.len());
    assert!(uids.iter().all(|uid| uid.starts_with(b"2.25.")));
}

#[tokio::test]
async fn a_segmentation_of_a_lossy_source_without_a_ratio_is_valid() {
    let texts = [&IDENTITY[..], &[([0x28, 0x2110], "CS", "01")]].concat();
    let slices = head_slices();
    let files: Vec<_> = slices
        .iter()
        .map(|slice| with_texts(slice, &texts))
        .collect();
    let neighbour = Neighbour::start(|_| {}).await;
    assert_eq!(neighbour.store(&files).await.status, 200);
    let arrival = neighbour.settled().await;
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    neighbour.server.until_ready(&case).await;
    let made = result(&neighbour.server, &case, &json!({"what": "mask"})).await;
    assert_eq!(made.status, 200, "{made:?}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mask.dcm");
    std::fs::write(&file, &made.body).unwrap();
    assert_eq!(errors_in(&file), Vec::<String>::new());
    if let Some(dump) = printed("/usr/bin/dcmdump", &[&file]) {
        for text in ["(0028,2110) CS [01]", "(0028,2112) DS [1]"] {
            assert!(dump.contains(text), "{dump}");
        }
    }
}

#[tokio::test]
async fn what_was_lost_or_removed_in_the_source_and_its_time_zone_are_stated() {
    let texts = [
        ([0x08, 0x0201], "SH", "-0330"),
        ([0x12, 0x0062], "CS", "YES"),
        ([0x12, 0x0063], "LO", "Cleaned by hand"),
        ([0x28, 0x2110], "CS", "01"),
        ([0x28, 0x2112], "DS", "7.5"),
        ([0x28, 0x2114], "CS", "ISO_10918_1"),
    ];
    let texts = [&IDENTITY[..], &texts].concat();
    let slices = head_slices();
    let files: Vec<_> = slices
        .iter()
        .map(|slice| with_texts(slice, &texts))
        .collect();
    // The source's own zone counts, not the one of the configuration.
    let neighbour = Neighbour::start(|config| {
        config.pacs.time_zone = Some("+05:00".to_owned());
    })
    .await;
    assert_eq!(neighbour.store(&files).await.status, 200);
    let arrival = neighbour.settled().await;
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    neighbour.server.until_ready(&case).await;
    let created = neighbour.server.get(&case).await.json()["created_at"].clone();
    let created: jiff::Timestamp = created.as_str().unwrap().parse().unwrap();
    let zone = jiff::tz::TimeZone::fixed(jiff::tz::Offset::from_seconds(-12_600).unwrap());
    let here = created.to_zoned(zone).strftime("%Y%m%d %H%M").to_string();
    let (day, minute) = here.split_once(' ').unwrap();
    let folder = tempfile::tempdir().unwrap();
    until_maps(&neighbour.server, &case).await;
    for what in ["view", "sheet", "mask", "report"] {
        let mut body = json!({"what": what});
        if what == "view" {
            body["render"] = small();
        }
        let made = result(&neighbour.server, &case, &body).await;
        assert_eq!(made.status, 200, "{made:?}");
        let file = folder.path().join(format!("{what}.dcm"));
        std::fs::write(&file, &made.body).unwrap();
        assert_eq!(errors_in(&file), Vec::<String>::new(), "{what}");
        let Some(dump) = printed("/usr/bin/dcmdump", &[Path::new("+L"), &file]) else {
            continue;
        };
        let mut expected = vec![
            "(0008,0201) SH [-0330]".to_owned(),
            "(0012,0062) CS [YES]".to_owned(),
            "(0012,0063) LO [Cleaned by hand]".to_owned(),
            format!("(0008,0023) DA [{day}]"),
            format!("(0008,0033) TM [{minute}"),
            // As it was copied.
            "(0008,0030) TM [101112]".to_owned(),
        ];
        if what != "report" {
            expected.extend([
                "(0028,2110) CS [01]".to_owned(),
                "(0028,2112) DS [7.5]".to_owned(),
                "(0028,2114) CS [ISO_10918_1]".to_owned(),
            ]);
        }
        for text in expected {
            assert!(dump.contains(&text), "{what} lacks {text}: {dump}");
        }
    }
}

#[tokio::test]
async fn an_image_without_its_identity_is_still_valid() {
    // Only what may have two sides has an attribute for its side.
    is_valid_without_identity(&[]).await;
    is_valid_without_identity(&[([0x18, 0x0015], "CS", "HEAD")]).await;
}

async fn is_valid_without_identity(further: &[([u16; 2], &str, &str)]) {
    let texts = [
        ([0x18, 0x0020], "CS", "GR"),
        ([0x18, 0x0021], "CS", "SP"),
        ([0x18, 0x0050], "DS", "1"),
    ];
    let texts = [&IDENTITY[..], &texts, further].concat();
    let slices = head_slices();
    let files: Vec<_> = slices
        .iter()
        .map(|slice| with_texts(slice, &texts))
        .collect();
    let neighbour = Neighbour::start(|config| config.pacs.deidentify = true).await;
    assert_eq!(neighbour.store(&files).await.status, 200);
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let [study, series] = ["study", "series"].map(|name| arrival[name].as_str().unwrap());
    let image = an_image(&neighbour.server, study, series).await;
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), image).unwrap();
    assert_eq!(errors_in(file.path()), Vec::<String>::new());
}

#[tokio::test]
async fn highdicom_reads_segmentations_where_the_slices_are() {
    let Some(python) = python_with("highdicom") else {
        return;
    };
    let objects = objects().await;
    for (number, file) in identified_head().iter().enumerate() {
        let path = objects.folder.path().join(format!("slice-{number}.dcm"));
        std::fs::write(path, file).unwrap();
    }
    let script = r#"
import glob, sys, warnings, numpy, pydicom, highdicom
warnings.simplefilter("ignore")
folder = sys.argv[1]
slices = {s.SOPInstanceUID: s for s in map(pydicom.dcmread, glob.glob(folder + "/slice-*.dcm"))}
for name in ["mask", "envelope"]:
    seg = highdicom.seg.segread(f"{folder}/{name}.dcm")
    for frame in seg.PerFrameFunctionalGroupsSequence:
        source = frame.DerivationImageSequence[0].SourceImageSequence[0].ReferencedSOPInstanceUID
        here = frame.PlanePositionSequence[0].ImagePositionPatient
        assert numpy.allclose(here, slices[source].ImagePositionPatient, atol=1e-3), (here, source)
    uids = sorted(slices, key=lambda uid: slices[uid].ImagePositionPatient[2])
    pixels = seg.get_pixels_by_source_instance(uids, ignore_spatial_locations=True, assert_missing_frames_are_empty=True)
    first = next(iter(slices.values()))
    voxel = float(numpy.prod(first.PixelSpacing)) * float(seg.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0].SpacingBetweenSlices)
    # The brain is brighter than the air around it, wherever it is.
    values = numpy.stack([numpy.frombuffer(slices[uid].PixelData, "<i2").reshape(first.Rows, first.Columns) for uid in uids])
    inside = pixels[..., 0] > 0
    print(name, int(pixels.sum()) * voxel / 1000, float(values[inside].mean()), float(values[~inside].mean()))
"#;
    let output = Command::new(python)
        .args(["-c", script])
        .arg(objects.folder.path())
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{output:?}");
    let numbers: Vec<f64> = printed
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect();
    let [brain_ml, inside, outside, envelope_ml, ..] = numbers[..] else {
        panic!("{printed}");
    };
    let expected = objects.case["quality"]["numbers"]["brain_ml"]
        .as_f64()
        .unwrap();
    assert!(
        (brain_ml / expected - 1.0).abs() < 0.02,
        "{printed} {expected}"
    );
    assert!(envelope_ml >= brain_ml, "{printed}");
    assert!(inside > 2.0 * outside, "{printed}");
}

#[tokio::test]
async fn a_case_without_a_patient_is_refused_unless_the_request_names_the_study() {
    let server = Server::start().await;
    let mask = mask_of(&plain_head()).bytes();
    let case = server
        .prepared(&[("volume", &plain_head().bytes()), ("mask", &mask)])
        .await;
    let body = json!({"what": "view", "render": small()});
    let refused = result(&server, &case, &body).await;
    assert_eq!(refused.status, 422);
    assert_eq!(refused.problem(), "no-patient");
    let study =
        json!({"StudyInstanceUID": "1.2.77", "PatientID": "P-9", "PatientName": "Canary^Bird"});
    let body = json!({"what": "view", "render": small(), "study": study});
    let made = result(&server, &case, &body).await;
    assert_eq!(made.status, 200, "{made:?}");
    for text in ["1.2.77", "P-9", "Canary^Bird"] {
        assert!(memchr::memmem::find(&made.body, text.as_bytes()).is_some());
    }
    let body = json!({"what": "mask", "study": study});
    let refused = result(&server, &case, &body).await;
    assert_eq!(refused.problem(), "no-frame-of-reference");
    // Without images of a source, each is valid, too.
    let folder = tempfile::tempdir().unwrap();
    let curved =
        json!({"width": 128, "height": 130, "window": [500, 700], "window_function": "sigmoid"});
    for (name, mut body) in [
        ("view", json!({"what": "view", "render": curved})),
        ("sheet", json!({"what": "sheet", "render": curved})),
    ] {
        body["study"] = study.clone();
        let made = result(&server, &case, &body).await;
        assert_eq!(made.status, 200, "{name}: {made:?}");
        let file = folder.path().join(format!("{name}.dcm"));
        std::fs::write(&file, &made.body).unwrap();
        assert_eq!(errors_in(&file), Vec::<String>::new(), "{name}");
        let derived = b"sigmoid window centre 500 and width 700";
        assert!(memchr::memmem::find(&made.body, derived).is_some());
    }
    for (body, kind) in [
        (json!({"what": "view", "node": "x"}), "no-such-node"),
        (json!({"what": "picture"}), "body-unreadable"),
        (json!({"what": "view", "cine": {}}), "body-unreadable"),
        (
            json!({"what": "key-object", "key_object": {"instances": ["1.2"], "title": "of-interest"}}),
            "body-unreadable",
        ),
        (json!({"what": "view", "who": "x"}), "body-unreadable"),
        (
            json!({"what": "view", "render": {"zoom": "x"}}),
            "body-unreadable",
        ),
        (
            json!({"what": "view", "render": {"zoom": 0}}),
            "query-value-out-of-range",
        ),
        (
            json!({"what": "mask", "render": {}}),
            "body-value-out-of-range",
        ),
        (
            json!({"what": "view", "study": {"StudyInstanceUID": "Smith", "PatientID": "P"}}),
            "body-value-out-of-range",
        ),
    ] {
        let refused = result(&server, &case, &body).await;
        assert_eq!(refused.problem(), kind, "{body}");
        assert!(!String::from_utf8_lossy(&refused.body).contains("Smith"));
    }
    for (body, parameter) in [
        (
            json!({"what": "view", "render": {"zoom": 0}}),
            "render.zoom",
        ),
        (json!({"what": "mask", "render": {}}), "render"),
        (
            json!({"what": "key-object", "key_object": {"instances": [], "title": "rejected-for-safety"}}),
            "key_object.instances",
        ),
        (
            json!({"what": "view", "study": {"StudyInstanceUID": "Smith", "PatientID": "P"}}),
            "study.StudyInstanceUID",
        ),
    ] {
        let refused = result(&server, &case, &body).await.json();
        assert_eq!(refused["parameter"], parameter, "{body}");
    }
    let unknown = "/v1/cases/00000000000000000000000000000000";
    let refused = result(&server, unknown, &json!({"what": "view"})).await;
    assert_eq!(refused.problem(), "no-such-case");
    let missing = server.get("/v1/dicom-results/x").await;
    assert_eq!(missing.problem(), "no-such-result");
}

/// Requests the preview of a result.
async fn preview(server: &Server, case: &str, body: &Value) -> Answer {
    let request = Request::post(format!("{case}/dicom-results")).header("accept", "image/png");
    let request = request.body(Body::from(body.to_string()));
    server.send(request.unwrap()).await
}

#[tokio::test]
async fn a_preview_has_the_pixels_of_the_object_and_nothing_is_sent() {
    let (port, received) = busy_node(0).await;
    let address = format!("http://127.0.0.1:{port}/rs");
    let neighbour = Neighbour::start(|config| add_node(config, "archive", address)).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    for body in [
        json!({"what": "view", "render": small(), "node": "archive"}),
        json!({"what": "sheet", "render": {"width": 160, "height": 128}}),
    ] {
        let shown = preview(server, &case, &body).await;
        assert_eq!(shown.status, 200, "{shown:?}");
        assert_eq!(shown.header("content-type"), "image/png");
        assert_eq!(shown.header("cache-control"), "no-store");
        let pixels = image::load_from_memory(&shown.body).unwrap().into_rgb8();
        let mut unsent = body.clone();
        unsent.as_object_mut().unwrap().remove("node");
        let object = result(server, &case, &unsent).await;
        let found = memchr::memmem::find(&object.body, pixels.as_raw());
        assert!(found.is_some(), "{body}");
    }
    for what in ["envelope", "mask"] {
        let refused = preview(server, &case, &json!({"what": what})).await;
        assert_eq!(refused.status, 406, "{what}");
    }
    let unknown = Request::post(format!("{case}/dicom-results")).header("accept", "image/jpeg");
    let body = json!({"what": "view", "render": small()}).to_string();
    let refused = server.send(unknown.body(Body::from(body)).unwrap()).await;
    assert_eq!(refused.status, 406);
    assert!(received.lock().unwrap().is_empty());
}

/// The pixels that letters light at the left and at the right of a picture of a result, of which a view has nothing.
async fn letters(server: &Server, case: &str, view: &str) -> [usize; 2] {
    let render =
        json!({"view": view, "depth_mm": 5, "width": 160, "height": 128, "annotate": false});
    let marked = preview(server, case, &json!({"what": "view", "render": render})).await;
    let plain = format!("{case}/render?view={view}&depth_mm=5&width=160&height=128");
    let plain = server.get(&plain).await;
    let [marked, plain] =
        [marked, plain].map(|answer| image::load_from_memory(&answer.body).unwrap().into_luma8());
    assert_eq!(marked.dimensions(), plain.dimensions());
    let pairs = marked.enumerate_pixels().zip(plain.pixels());
    let lit = pairs.filter(|((.., marked), plain)| marked.0[0].abs_diff(plain.0[0]) > 60);
    let (left, right): (Vec<u32>, Vec<u32>) = lit.map(|((x, ..), _)| x).partition(|&x| x < 80);
    assert!(left.iter().all(|&x| x < 30) && right.iter().all(|&x| x >= 130));
    [left.len(), right.len()]
}

#[tokio::test]
async fn left_and_right_are_written_where_they_lie_in_pictures_from_above_and_below() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    // An R has more pixels than an L. From above, the patient's left is at the left.
    let [left, right] = letters(server, &case, "superior").await;
    assert!(left > 3 && right > left, "{left} {right}");
    assert_eq!(letters(server, &case, "inferior").await, [right, left]);
    assert_eq!(letters(server, &case, "posterior").await, [left, right]);
    // From the side, neither is at an edge.
    assert_eq!(letters(server, &case, "left").await, [0, 0]);
}

#[tokio::test]
async fn the_page_learns_the_nodes_and_whether_it_may_show_the_patient() {
    let pacs = async |configure: fn(&mut Config)| {
        let neighbour = Neighbour::start(configure).await;
        neighbour.server.get("/v1/pacs").await.json()
    };
    let nothing = json!({"nodes": [], "patient_banner": false});
    assert_eq!(pacs(|_| {}).await, nothing);
    let all = pacs(|config| {
        add_node(config, "archive", "http://127.0.0.1:9/".into());
        config.page.patient_banner = Some(true);
    });
    let expected = json!({"nodes": ["archive"], "patient_banner": true});
    assert_eq!(all.await, expected);
    // Without identities there is nothing to show, and nothing to send.
    let without = pacs(|config| {
        add_node(config, "archive", "http://127.0.0.1:9/".into());
        config.page.patient_banner = Some(true);
        config.pacs.deidentify = true;
    });
    assert_eq!(without.await, nothing);
}

/// What a node that has stored the object of a request answers, in DICOM JSON. The boundary has the instance UID.
fn report_of(body: &[u8]) -> String {
    let boundary = body.split(|&byte| byte == b'\r').next().unwrap();
    let boundary = std::str::from_utf8(boundary).unwrap();
    let uid = boundary.strip_prefix("--isocortex-").unwrap();
    let item = json!({"00081155": {"vr": "UI", "Value": [uid]}});
    json!({"00081199": {"vr": "SQ", "Value": [item]}}).to_string()
}

/// A node that is busy at first, and keeps what it is sent.
async fn busy_node(busy: u32) -> (u16, Arc<std::sync::Mutex<Vec<Bytes>>>) {
    let received = Arc::<std::sync::Mutex<Vec<Bytes>>>::default();
    let (asked, kept) = (Arc::new(AtomicU32::new(0)), Arc::clone(&received));
    let store = move |body: Bytes| {
        let number = asked.fetch_add(1, Ordering::Relaxed);
        kept.lock().unwrap().push(body.clone());
        async move {
            match number < busy {
                true => (StatusCode::SERVICE_UNAVAILABLE, String::new()),
                false => (StatusCode::OK, report_of(&body)),
            }
        }
    };
    (node(post(store)).await, received)
}

/// A node at `/rs` on this port, which answers what is sent to it.
async fn node(store: MethodRouter) -> u16 {
    let routes = Router::new()
        .route("/rs/studies", store)
        .layer(axum::extract::DefaultBodyLimit::disable());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    tokio::spawn(async move { axum::serve(listener, routes).await.unwrap() });
    port
}

pub(crate) fn add_node(config: &mut Config, name: &str, url: String) {
    config.pacs.nodes.push(Node {
        name: name.to_owned(),
        url: Some(url),
        ..Node::default()
    });
}

/// When a result is sent again after the first failure.
pub(crate) const RETRY_AFTER: Duration = Duration::from_secs(5);

/// The state of a result after the first attempt to send it.
pub(crate) async fn until_tried(server: &Server, accepted: &Answer) -> Value {
    until("the result is tried", async || {
        let state = server.get(accepted.header("location")).await.json();
        let was_tried = state["attempts"].as_u64() >= Some(1) && state["state"] != "running";
        was_tried.then_some(state)
    })
    .await
}

/// What becomes of a result that is sent.
pub(crate) async fn until_sent(server: &Server, accepted: &Answer) -> Value {
    assert_eq!(accepted.status, 202, "{accepted:?}");
    until("the result is sent", async || {
        let sent = server.get(accepted.header("location")).await.json();
        let has_ended = sent["state"] == "done" || sent["state"] == "failed";
        has_ended.then_some(sent)
    })
    .await
}

#[tokio::test]
async fn a_result_is_sent_until_the_node_has_it_and_a_refusal_is_told() {
    let (port, received) = busy_node(1).await;
    let neighbour = Neighbour::start(|config| {
        add_node(config, "busy", format!("http://127.0.0.1:{port}/rs"));
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let case = identified_case(&neighbour).await;
    let body = |node: &str| json!({"what": "view", "render": small(), "node": node});
    let accepted = result(&neighbour.server, &case, &body("busy")).await;
    assert_eq!(accepted.status, 202, "{accepted:?}");
    let queued = accepted.json();
    assert_eq!(queued["state"], "queued");
    let background = pacs::start_transfers(neighbour.server.pacs.clone());
    let tried = until_tried(&neighbour.server, &accepted).await;
    assert_eq!(tried["state"], "queued", "{tried}");
    neighbour.server.state.cases.store().pass_time(RETRY_AFTER);
    let sent = until_sent(&neighbour.server, &accepted).await;
    assert_eq!(
        (&sent["state"], &sent["attempts"]),
        (&json!("done"), &json!(2))
    );
    // Requested again, it is sent again: the same object, under the same name.
    let again = result(&neighbour.server, &case, &body("busy")).await;
    assert_eq!(again.json()["id"], queued["id"]);
    until_sent(&neighbour.server, &again).await;
    let bodies: Vec<Bytes> = received.lock().unwrap().clone();
    assert_eq!(bodies.len(), 3);
    assert!(bodies.iter().all(|body| *body == bodies[0]));
    let direct = json!({"what": "view", "render": small()});
    let direct = result(&neighbour.server, &case, &direct).await;
    assert!(memchr::memmem::find(&bodies[0], &direct.body).is_some());

    // A node that is away is asked again later, also after a restart.
    let accepted = result(&neighbour.server, &case, &body("away")).await;
    until_tried(&neighbour.server, &accepted).await;
    background.shut_down(Duration::from_secs(5)).await;
    let state = neighbour
        .server
        .get(accepted.header("location"))
        .await
        .json();
    assert_eq!(state["state"], "queued", "{state}");
    // Deleting the case leaves nothing.
    let deleted = neighbour.server.method(Method::DELETE, &case).await;
    assert_eq!(deleted.status, 204);
    let gone = neighbour.server.get(accepted.header("location")).await;
    assert_eq!(gone.problem(), "no-such-result");
    neighbour.server.is_empty_and_well().await;
}

#[tokio::test]
async fn what_a_killed_process_was_sending_is_sent_by_the_next_one() {
    let (port, received) = busy_node(0).await;
    let neighbour = Neighbour::start(|config| {
        add_node(config, "pacs", format!("http://127.0.0.1:{port}/rs"));
    })
    .await;
    let case = identified_case(&neighbour).await;
    let body = json!({"what": "view", "render": small(), "node": "pacs"});
    let accepted = result(&neighbour.server, &case, &body).await;
    // A process takes it, and ends before it has sent anything.
    let store = neighbour.server.state.cases.store();
    let leased = store
        .claim(case::JobKind::new("send", "delivery"), 8)
        .await
        .unwrap();
    assert!(leased.is_some());
    let server = neighbour.restarted().await;
    // Its lease ends.
    server
        .state
        .cases
        .store()
        .pass_time(Duration::from_secs(31));
    let _background = pacs::start_transfers(server.pacs.clone());
    let sent = until_sent(&server, &accepted).await;
    assert_eq!(
        (&sent["state"], &sent["attempts"]),
        (&json!("done"), &json!(2))
    );
    let again = result(&server, &case, &body).await;
    assert_eq!(again.json()["id"], sent["id"]);
    until_sent(&server, &again).await;
    let bodies = received.lock().unwrap().clone();
    assert_eq!(bodies.len(), 2);
    assert_eq!(bodies[0], bodies[1], "it is one object");
}

#[tokio::test]
async fn a_node_that_refuses_an_object_is_believed() {
    let refuse = async |body: Bytes| {
        let report = report_of(&body).replace("00081199", "00081198");
        (StatusCode::CONFLICT, report)
    };
    let port = node(post(refuse)).await;
    let neighbour = Neighbour::start(|config| {
        add_node(config, "refusing", format!("http://127.0.0.1:{port}/rs"));
        add_node(config, "none", format!("http://127.0.0.1:{port}/nothing"));
    })
    .await;
    let case = identified_case(&neighbour).await;
    let _background = pacs::start_transfers(neighbour.server.pacs.clone());
    for (node, reason) in [
        ("refusing", "node-did-not-store"),
        ("none", "node-has-no-stow"),
    ] {
        let body = json!({"what": "mask", "node": node});
        let accepted = result(&neighbour.server, &case, &body).await;
        let sent = until_sent(&neighbour.server, &accepted).await;
        assert_eq!(sent["state"], "failed");
        assert_eq!(sent["reason"]["name"], reason, "{sent}");
    }
}

#[tokio::test]
async fn an_open_reading_is_saved_and_only_a_signed_one_is_sent() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let mut tokens = TokensFile::new();
    tokens.add("ana", &["--scope", "read,write,results"]);
    let server = neighbour.restarted().await;
    let server = server.restart_with(|config| {
        config.http.tokens_file = Some(tokens.path());
        add_node(config, "away", "http://127.0.0.1:1/".to_owned());
    });
    let server = server.await;
    let send = async |method: Method, address: String, tag: &str, body: Value| {
        let request = Request::builder().method(method).uri(address);
        let request = request.header("authorization", tokens.bearer("ana"));
        let request = request.header("if-match", tag);
        let request = request.body(Body::from(body.to_string()));
        server.send(request.unwrap()).await
    };
    let mine = format!("{case}/readings/mine");
    let results = format!("{case}/dicom-results");
    let begun = send(Method::GET, mine.clone(), "", json!({})).await;
    let reading = json!({"conclusion": "Blurred, left frontal.", "findings": []});
    let kept = send(Method::PUT, mine.clone(), begun.header("etag"), reading).await;
    assert_eq!(kept.status, 200, "{kept:?}");
    let saved = json!({"what": "findings", "reading": "ana"});
    let sent = json!({"what": "findings", "reading": "ana", "node": "away"});
    let refused = send(Method::POST, results.clone(), "", sent.clone()).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem()),
        (409, "reading-open".to_owned())
    );
    let file = send(Method::POST, results.clone(), "", saved).await;
    assert_eq!(file.status, 200, "{file:?}");
    let signature = format!("{mine}/signature");
    let signed = send(Method::POST, signature, kept.header("etag"), json!({})).await;
    assert_eq!(signed.status, 200, "{signed:?}");
    let queued = send(Method::POST, results, "", sent).await;
    assert_eq!(queued.status, 202, "{queued:?}");
}
