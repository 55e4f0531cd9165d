//! DICOM in: the same head as from NIfTI, whose it is, and every file survived.

use std::io::{Cursor, Write as _};

use axum::http::StatusCode;
use cases::dicom::Program;
use zip::write::{SimpleFileOptions, ZipWriter};

use crate::head::{mask_of, plain_head};
use crate::nifti::Data;
use crate::series_builder::{Slice, Syntax, files};
use crate::server::{Answer, Part, Server};

/// The process that reads: this test program again.
#[test]
#[ignore = "it is started by the server of the tests below"]
fn child() {
    let ended = worker::run_child();
    assert_eq!(
        format!("{ended:?}"),
        format!("{:?}", std::process::ExitCode::SUCCESS)
    );
}

/// The program whose reader is [`child`].
pub(crate) fn reader() -> Program {
    let arguments = ["--exact", "dicom::child", "--ignored", "--test-threads=1"];
    Program::other(
        std::env::current_exe().unwrap(),
        arguments.map(Into::into).to_vec(),
    )
}

/// A server whose reader is [`child`].
async fn server() -> Server {
    Server::start_with(|config| {
        config.dicom_program = reader();
        config.limits.max_upload_bytes = 8 << 20;
    })
    .await
}

/// The plain head as axial slices.
pub(crate) fn head_slices() -> Vec<Slice> {
    let head = plain_head();
    let Data::I16(voxels) = &head.data else {
        panic!("heads are made of i16");
    };
    let [columns, rows, slices] = head.size.map(|side| side as usize);
    let rows_of = head.ras_from_voxel;
    let lps = |axis: usize| [-rows_of[0][axis], -rows_of[1][axis], rows_of[2][axis]].map(f64::from);
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let (x, y, z, origin) = (lps(0), lps(1), lps(2), lps(3));
    let unit = |v: [f64; 3]| v.map(|component| component / length(v));
    (0..slices)
        .map(|slice| {
            let samples = &voxels[slice * columns * rows..(slice + 1) * columns * rows];
            let [ux, uy] = [unit(x), unit(y)];
            Slice {
                position: [0, 1, 2].map(|axis| origin[axis] + z[axis] * slice as f64),
                orientation: [ux[0], ux[1], ux[2], uy[0], uy[1], uy[2]],
                spacing: [length(y), length(x)],
                columns: columns as u16,
                samples: samples.iter().map(|&sample| sample as u16).collect(),
                signed: true,
                bits_stored: 16,
                ..Slice::number(slice)
            }
        })
        .collect()
}

pub(crate) fn zipped(files: &[Vec<u8>]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let deflated =
        SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (number, file) in files.iter().enumerate() {
        let name = format!("../../Somebody^Secret/{}", files.len() - number);
        archive.start_file(name, deflated).unwrap();
        archive.write_all(file).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn parts(files: &[Vec<u8>]) -> Vec<Part<'_>> {
    files.iter().map(|file| ("dicom", &file[..])).collect()
}

/// Nothing in an answer says whose head it is.
fn assert_tells_nothing(answer: &Answer) {
    let text = format!(
        "{:?} {}",
        answer.headers,
        String::from_utf8_lossy(&answer.body)
    );
    for secret in ["Somebody", "Secret", "P-77", "1.2.3.4", "1.2.3.1"] {
        assert!(!text.contains(secret), "{text}");
    }
}

#[tokio::test]
async fn a_zip_of_slices_has_the_mesh_of_the_same_head_in_nifti() {
    let server = server().await;
    let mask = mask_of(&plain_head()).bytes();
    let from_nifti = server
        .prepared(&[("volume", &plain_head().bytes()), ("mask", &mask)])
        .await;
    let archive = zipped(&files(&head_slices(), Syntax::Explicit));
    let from_dicom = server
        .prepared(&[("volume", &archive), ("mask", &mask)])
        .await;
    assert_ne!(from_nifti, from_dicom);
    for what in [
        "mesh?depth_mm=0",
        "mesh?depth_mm=12.5",
        "render?depth_mm=9&renderer=splat",
    ] {
        let [a, b] = [
            server.get(&format!("{from_nifti}/{what}")).await,
            server.get(&format!("{from_dicom}/{what}")).await,
        ];
        // What is stored differs by an offset, and with it the rounding of what is between the voxels.
        let near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 1;
        let same = match what.starts_with("render") {
            true => a.grey().iter().zip(b.grey().iter()).all(near),
            false => a.positions() == b.positions(),
        };
        assert!(same, "{what} differs");
    }
}

#[tokio::test]
async fn the_same_files_however_they_are_sent_are_one_case() {
    let server = server().await;
    let slices = files(&head_slices(), Syntax::Implicit);
    let first = server.upload(&[("volume", &zipped(&slices))]).await;
    assert_eq!(first.status, StatusCode::ACCEPTED, "{first:?}");
    assert_tells_nothing(&first);
    let chosen = first.json()["dicom"]["series"].clone();
    assert_eq!(
        (&chosen["number"], &chosen["modality"]),
        (&4.into(), &"MR".into())
    );
    let reversed: Vec<Vec<u8>> = slices.iter().rev().cloned().collect();
    let again = server.upload(&parts(&reversed)).await;
    assert_eq!(again.status, StatusCode::OK, "{again:?}");
    assert_eq!(again.json()["id"], first.json()["id"]);
    server.until_ready(first.header("location")).await;
}

#[tokio::test]
async fn whose_head_it_is_stands_at_one_address_alone() {
    let server = server().await;
    let slices = files(&head_slices(), Syntax::Explicit);
    let case = server.prepared(&parts(&slices)).await;
    let server = server.restart().await;
    let answer = server.get(&format!("{case}/dicom")).await;
    assert_eq!(answer.status, StatusCode::OK);
    assert_eq!(answer.header("cache-control"), "no-store");
    let told = answer.json();
    assert_eq!(told["attributes"]["PatientName"], "Somebody^Secret");
    assert_eq!(told["attributes"]["StudyInstanceUID"], "1.2.3");
    assert_eq!(told["instances"].as_array().unwrap().len(), 45);
    assert_eq!(told["instances"][44]["sop_instance_uid"], "1.2.3.4.45");
    for address in [&case[..], "/v1/cases", "/metrics"] {
        assert_tells_nothing(&server.get(address).await);
    }
    let links = server.get(&case).await.json()["links"].clone();
    assert_eq!(links["dicom"], format!("{case}/dicom"));

    // A version with another mask is of the same patient.
    let mask = mask_of(&plain_head()).bytes();
    let (version, _) = crate::masks::version(&server, &case, "", &mask).await;
    assert_ne!(version, case);
    let of_version = server.get(&format!("{version}/dicom")).await;
    assert_eq!(of_version.json(), told);

    let plain = server.plain_case().await;
    let answer = server.get(&format!("{plain}/dicom")).await;
    assert_eq!(
        (answer.status, answer.problem()),
        (StatusCode::NOT_FOUND, "not-dicom".to_owned())
    );
    assert!(
        server.get(&plain).await.json()["links"]
            .get("dicom")
            .is_none()
    );
}

#[tokio::test]
async fn the_same_picture_of_somebody_else_is_another_case() {
    let server = server().await;
    let mut slices = head_slices();
    let first = server
        .upload(&parts(&files(&slices, Syntax::Explicit)))
        .await;
    for slice in &mut slices {
        slice.patient_id = "P-99";
    }
    let other = server
        .upload(&parts(&files(&slices, Syntax::Explicit)))
        .await;
    assert_eq!(other.status, StatusCode::ACCEPTED);
    assert_ne!(first.json()["id"], other.json()["id"]);
}

#[tokio::test]
async fn gaps_are_filled_where_that_is_asked_for_and_it_is_said() {
    let server = server().await;
    let mut slices = head_slices();
    slices.remove(20);
    // Thin enough that two slices are no wide gap.
    slices.iter_mut().for_each(|slice| slice.position[2] *= 0.6);
    let archive = zipped(&files(&slices, Syntax::Explicit));
    let refused = server.upload(&[("volume", &archive)]).await;
    assert_eq!(refused.problem(), "dicom-slices-missing");
    let allowed = [
        ("volume", &archive[..]),
        ("parameters", br#"{"allow_gaps": true, "series": 4}"#),
    ];
    let case = server.prepared(&allowed).await;
    let case = server.get(&case).await.json();
    assert_eq!(
        case["volume"]["interpolated_slices"],
        serde_json::json!([21])
    );
    // The image of slice 21 was number 21, and is missing.
    let images = case["volume"]["images"].as_array().unwrap();
    assert_eq!(
        (images[0]["count"].clone(), images[1].clone()),
        (
            20.into(),
            serde_json::json!({"slice": 22, "count": slices.len() - 20, "number": 22, "step": 1})
        )
    );
}

#[tokio::test]
async fn a_case_states_which_images_of_which_series_its_slices_are() {
    let server = server().await;
    let mut slices = head_slices();
    let count = slices.len() as i64;
    // The images are numbered from the top down, and arrive in another order.
    for (slice, number) in slices.iter_mut().zip((1..=count).rev()) {
        slice.instance = number;
        slice.series_number = 3;
    }
    slices.rotate_left(7);
    slices.swap(2, 11);
    let archive = zipped(&files(&slices, Syntax::Explicit));
    let case = server.prepared(&[("volume", &archive)]).await;
    let volume = server.get(&case).await.json()["volume"].clone();
    assert_eq!(volume["series_number"], 3);
    assert_eq!(
        volume["images"],
        serde_json::json!([{"slice": 1, "count": count, "number": count, "step": -1}])
    );
    // Slice 1 is the lowest, whose image was numbered last.
    let third_axis = volume["patient_from_voxel"][2][2].as_f64().unwrap();
    assert!(third_axis > 0.0);

    let mut interleaved = head_slices();
    for (slice, one) in interleaved.iter_mut().enumerate() {
        one.patient_id = "P-78";
        one.instance = [1, 101][slice % 2] + slice as i64 / 2;
    }
    let archive = zipped(&files(&interleaved, Syntax::Explicit));
    let case = server.prepared(&[("volume", &archive)]).await;
    let case = server.get(&case).await.json();
    let images = case["volume"]["images"].as_array().unwrap();
    let number_of = |slice: i64| {
        let of = |run: &serde_json::Value, key: &str| run[key].as_i64().unwrap();
        images.iter().find_map(|run| {
            let within = slice - of(run, "slice");
            let is_within = (0..of(run, "count")).contains(&within);
            is_within.then(|| of(run, "number") + within * of(run, "step"))
        })
    };
    for (slice, one) in (1..).zip(&interleaved) {
        assert_eq!(number_of(slice), Some(one.instance), "slice {slice}");
    }
    assert_eq!(number_of(count + 1), None);
}

#[tokio::test]
async fn images_that_are_not_numbered_apart_are_not_stated() {
    let server = server().await;
    let mut slices = head_slices();
    for slice in &mut slices {
        slice.instance = 0;
    }
    let archive = zipped(&files(&slices, Syntax::Explicit));
    let case = server.prepared(&[("volume", &archive)]).await;
    let volume = server.get(&case).await.json()["volume"].clone();
    assert_eq!(volume["series_number"], 4);
    assert_eq!(volume["images"], serde_json::Value::Null);
}

#[tokio::test]
async fn several_series_are_listed_without_saying_whose_they_are() {
    let server = server().await;
    let mut slices = head_slices();
    let mut second = slices.clone();
    for slice in &mut second {
        slice.series_uid = "1.2.3.18".to_owned();
        slice.series_number = 8;
    }
    slices.extend(second);
    let archive = zipped(&files(&slices, Syntax::Explicit));
    let refused = server.upload(&[("volume", &archive)]).await;
    assert_eq!(refused.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(refused.problem(), "dicom-several-series");
    assert_tells_nothing(&refused);
    let detail = refused.json()["detail"].as_str().unwrap().to_owned();
    assert!(
        detail.contains("series 4 (MR") && detail.contains("series 8"),
        "{detail}"
    );
    server.is_empty_and_well().await;
    let named = [
        ("volume", &archive[..]),
        ("parameters", br#"{"series": "8"}"#),
    ];
    let answer = server.upload(&named).await;
    assert_eq!(answer.json()["dicom"]["series"]["number"], 8);
    assert_eq!(answer.json()["dicom"]["others"][0]["number"], 4);
}

#[tokio::test]
async fn forms_that_contradict_themselves_are_refused() {
    let server = server().await;
    let volume = plain_head().bytes();
    let slices = files(&head_slices(), Syntax::Explicit);
    let both = [("volume", &volume[..]), ("dicom", &slices[0][..])];
    assert_eq!(server.upload(&both).await.problem(), "volume-twice");
    for parameters in [
        &br#"{"series": 3}"#[..],
        br#"{"allow_gaps": 1}"#,
        br#"{"series": "a/b"}"#,
    ] {
        let parts = [("volume", &volume[..]), ("parameters", parameters)];
        assert_eq!(
            server.upload(&parts).await.problem(),
            "parameters-unreadable"
        );
    }
    server.is_empty_and_well().await;
}

/// Files made to do harm, and what each is answered.
fn hostile() -> Vec<(&'static str, Vec<Vec<u8>>, &'static str)> {
    let slice = Slice::number(0);
    let mut nested = slice.data_set(Syntax::Explicit);
    for _ in 0..4000 {
        nested.head([0x5200, 0x9230], "SQ", u32::MAX);
        nested.delimiter(0xE000, u32::MAX);
    }
    let mut four_gigabytes = slice.data_set(Syntax::Explicit);
    four_gigabytes.head([0x28, 0x2110], "UT", 0xFFFF_FFF0);
    let pixels = |number: usize| {
        let mut set = Slice {
            columns: 1,
            samples: vec![0; 65535],
            ..Slice::number(number)
        }
        .data_set(Syntax::Rle);
        set.head([0x7FE0, 0x10], "OB", u32::MAX);
        set.delimiter(0xE000, 0);
        set.delimiter(0xE000, 64);
        set.bytes.extend([0xFF; 64]);
        set.delimiter(0xE0DD, 0);
        set.file()
    };
    let mut cut = files(&head_slices(), Syntax::Explicit);
    let half = cut[3].len() / 2;
    cut[3].truncate(half);
    vec![
        (
            "sequences in sequences",
            vec![nested.file()],
            "dicom-damaged",
        ),
        (
            "four gigabytes",
            vec![four_gigabytes.file()],
            "dicom-damaged",
        ),
        ("bad packing", (0..3).map(pixels).collect(), "dicom-pixels"),
        ("cut off", cut, "dicom-damaged"),
        (
            "a bomb",
            vec![zipped(&[
                [&[0; 128], &b"DICM"[..], &vec![0; 40 << 20]].concat()
            ])],
            "too-many-bytes",
        ),
        (
            "a bomb that is no DICOM",
            vec![zipped(&[vec![0; 40 << 20]])],
            "dicom-none",
        ),
        (
            "a damaged zip",
            vec![zipped(&[vec![1; 4000]])[..60].to_vec()],
            "dicom-unreadable",
        ),
        ("no DICOM", vec![zipped(&[b"hello".to_vec()])], "dicom-none"),
        (
            "a zip in a zip",
            vec![zipped(&[zipped(&files(&head_slices(), Syntax::Explicit))])],
            "dicom-none",
        ),
    ]
}

#[tokio::test]
async fn the_server_survives_every_file() {
    let server = server().await;
    for (what, files, kind) in hostile() {
        let answer = server.upload(&parts(&files)).await;
        eprintln!("{what}: {} {}", answer.status, answer.json()["detail"]);
        assert!(answer.status.is_client_error(), "{what}: {answer:?}");
        assert_eq!(answer.problem(), kind, "{what}");
        assert_tells_nothing(&answer);
        server.is_empty_and_well().await;
    }
}

/// A number that depends on nothing but its place in a sequence.
fn scrambled(seed: u64) -> u64 {
    let mut number = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    number ^= number >> 31;
    number = number.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    number ^ number >> 29
}

#[tokio::test]
async fn changed_bytes_in_files_of_scanners_end_in_an_answer() {
    let Some(samples) = crate::heads::data() else {
        return;
    };
    let unpacked = tempfile::tempdir().unwrap();
    for archive in ["vendors-mini.tar.gz", "transfer-syntaxes.tar.gz"] {
        let tar = std::process::Command::new("tar")
            .arg("xf")
            .arg(samples.join("dicom").join(archive))
            .arg("-C")
            .arg(unpacked.path())
            .status();
        assert!(tar.unwrap().success());
    }
    let folders = [
        "generic/compressed_j2k/001",
        "generic/compressed_jpeg/001",
        "generic/compressed_jpegls/001",
        "generic/compressed_rle/001",
        "philips_enhanced/anatomical/001",
        "siemens/anatomical/001",
        "hyperfine/anatomical/001",
    ];
    let server = server().await;
    for round in 0..70u64 {
        let folder = folders[round as usize % folders.len()];
        let folder = unpacked.path().join(folder);
        let mut files: Vec<Vec<u8>> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| std::fs::read(entry.unwrap().path()).unwrap())
            .collect();
        let file = &mut files[0];
        for change in 0..1 + scrambled(round) % 12 {
            let random = scrambled(1000 * round + change);
            let at = 128 + random as usize % (file.len() - 128);
            file[at] = (random >> 40) as u8;
        }
        let mut parts = parts(&files);
        parts.push(("parameters", br#"{"mask": "volume"}"#));
        let answer = server.upload(&parts).await;
        // What is still sound shows more than a brain, and needs a mask.
        assert!(answer.status.is_client_error(), "{round}: {answer:?}");
        if answer.problem() != "mask-missing" {
            eprintln!("{round}: {}", answer.json()["detail"]);
        }
    }
    server.is_empty_and_well().await;
}
