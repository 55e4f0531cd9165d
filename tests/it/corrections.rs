//! A PACS corrects images: the same UIDs come again with another patient or other pixels.

use std::time::Duration;

use serde_json::{Value, json};

use crate::dicom::head_slices;
use crate::pacs::{Lines, Neighbour, dcmtk, dimse, dimse_options, items, run, with_texts};
use crate::results::{identified_case, identified_head, result, small};
use crate::series_builder::{Slice, Syntax, files};
use crate::server::Answer;

/// The files of [`identified_head`] with another patient.
fn corrected_head() -> Vec<Vec<u8>> {
    let texts = [
        ([0x10, 0x0010], "PN", "Right^Patient"),
        ([0x10, 0x0020], "LO", "PAT-RIGHT"),
    ];
    let frame = ([0x20, 0x0052], "UI", "1.2.3.9");
    let correct = |slice: &Slice| with_texts(slice, &[&texts[..], &[frame]].concat());
    head_slices().iter().map(correct).collect()
}

/// The warning reasons of the stored images.
fn warnings(answer: &Answer) -> Vec<u64> {
    let answer = answer.json();
    let reason = |item: &Value| item["00081196"]["Value"][0].as_u64();
    items(&answer, "00081199")
        .iter()
        .filter_map(reason)
        .collect()
}

async fn launched(neighbour: &Neighbour) -> Value {
    let body = json!({"query": "study=1.2.3"}).to_string();
    let request = axum::http::Request::post("/v1/launch").body(body.into());
    neighbour.server.send(request.unwrap()).await.json()
}

/// The case that the series became after one with another address.
async fn case_after(neighbour: &Neighbour, before: &str) -> String {
    for _ in 0..600 {
        let arrival = neighbour.settled().await;
        let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
        if case != before {
            neighbour.server.until_ready(&case).await;
            return case;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("no other case came");
}

#[tokio::test]
async fn a_corrected_patient_makes_a_new_case_and_nothing_more_is_sent_of_the_old() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let old = identified_case(&neighbour).await;
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &old, &view).await.status, 200);
    let corrected = corrected_head();
    let stored = neighbour.store(&corrected).await;
    assert_eq!(stored.status, 202, "{stored:?}");
    assert_eq!(warnings(&stored), vec![0xB000; corrected.len()]);
    // From now on, the old case is neither opened nor listed nor sent anywhere, even if there is no new one yet.
    let found = launched(&neighbour).await;
    let found = found["case"].as_str().unwrap_or_default();
    assert!(found.is_empty() || !old.ends_with(found));
    let refused = result(server, &old, &view).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "superseded")
    );
    let listed = server.get("/dicomweb/studies?PatientID=P-77").await;
    assert_eq!(listed.status, 204);
    // The same correction again changes nothing.
    assert_eq!(neighbour.store(&corrected).await.status, 200);
    let new = case_after(&neighbour, &old).await;
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["superseded"], corrected.len());
    let case = server.get(&new).await.json();
    assert!(
        case["previous"].is_null(),
        "nothing is inherited from another patient: {case}"
    );
    let found = launched(&neighbour).await;
    assert_eq!(
        format!("/v1/cases/{}", found["case"].as_str().unwrap()),
        new
    );
    let made = result(server, &new, &view).await;
    let has = |text: &str| memchr::memmem::find(&made.body, text.as_bytes()).is_some();
    assert!(has("PAT-RIGHT") && !has("P-77"));
    // One line for the series, which names nobody.
    let text = lines.text();
    assert_eq!(text.matches("have come with other contents").count(), 1);
    assert!(!text.contains("PAT-RIGHT") && !text.contains("Right^Patient"));
}

#[tokio::test]
async fn other_pixels_make_a_version_and_another_encoding_is_no_change() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let slices = head_slices();
    // One altered slice comes first, then the true series.
    let mut altered = slices[slices.len() / 2].file(Syntax::Explicit);
    let end = altered.len() - 1000;
    altered[end..].fill(0x11);
    assert_eq!(neighbour.store(&[altered]).await.status, 200);
    let sound = files(&slices, Syntax::Explicit);
    let stored = neighbour.store(&sound).await;
    assert_eq!(
        (stored.status.as_u16(), warnings(&stored)),
        (202, vec![0xB000])
    );
    let arrival = neighbour.settled().await;
    assert_eq!(
        (&arrival["state"], &arrival["instances"]),
        (&json!("case"), &json!(slices.len()))
    );
    let first = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&first).await;
    // The case is that of the true series.
    let upload = Neighbour::start(|_| {}).await;
    upload.store(&sound).await;
    assert_eq!(upload.settled().await["case"], arrival["case"]);
    for syntax in [Syntax::Implicit, Syntax::BigEndian, Syntax::Rle] {
        let again = neighbour.store(&files(&slices[..3], syntax)).await;
        assert_eq!(
            (again.status.as_u16(), warnings(&again)),
            (200, vec![]),
            "{syntax:?}"
        );
    }
    assert_eq!(neighbour.settled().await["case"], arrival["case"]);
    // What cannot be decoded takes nobody's place.
    let mut broken = slices[0].file(Syntax::Rle);
    broken.truncate(broken.len() - 200);
    broken.extend([0xFE, 0xFF, 0xDD, 0xE0, 0, 0, 0, 0]);
    assert_eq!(neighbour.store(&[broken]).await.status, 409);
    // Other pixels of the same patient make a version, which inherits.
    let middle = &slices[slices.len() / 2];
    let moved = Slice {
        samples: middle.samples.iter().map(|sample| sample / 2).collect(),
        ..middle.clone()
    };
    assert_eq!(
        neighbour
            .store(&[moved.file(Syntax::Explicit)])
            .await
            .status,
        202
    );
    let second = case_after(&neighbour, &first).await;
    let version = server.get(&second).await.json();
    assert_eq!(
        format!("/v1/cases/{}", version["previous"].as_str().unwrap()),
        first
    );
}

#[tokio::test]
async fn c_store_answers_a_correction_with_a_warning_and_accepts_whole_studies() {
    let Some(storescu) = dcmtk("storescu") else {
        return;
    };
    let neighbour = Neighbour::start(|_| {}).await;
    let address = dimse(&neighbour, dimse_options()).await;
    let port = address.port().to_string();
    let folder = tempfile::tempdir().unwrap();
    let store = async |name: &str, file: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, file).unwrap();
        let path = path.to_str().unwrap();
        let arguments = [
            "-v",
            "-R",
            "-aet",
            "SENDER",
            "-aec",
            "ISOCORTEX",
            "127.0.0.1",
            &port,
            path,
        ];
        let output = run(&storescu, &arguments).await;
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
    };
    let first = store("first.dcm", &identified_head()[0]).await;
    assert!(first.contains("(Success)"), "{first}");
    let corrected = store("corrected.dcm", &corrected_head()[0]).await;
    assert!(corrected.contains("Coercion"), "{corrected}");
    let report = Slice {
        sop_class: "1.2.840.10008.5.1.4.1.1.88.11",
        modality: "SR",
        series_uid: "1.2.3.88".to_owned(),
        sop_uid: "1.2.3.88.1".to_owned(),
        ..Slice::number(1)
    };
    let report = report.file(Syntax::Explicit);
    let accepted = store("report.dcm", &report).await;
    assert!(accepted.contains("(Success)"), "{accepted}");
    assert_eq!(neighbour.store(&[report]).await.status, 200);
    let list = neighbour.server.get("/v1/arrivals").await.json();
    let arrivals = list["arrivals"].as_array().unwrap();
    let of = |series: &str| {
        arrivals
            .iter()
            .find(|each| each["series"] == series)
            .unwrap()
    };
    let ignored = of("1.2.3.88");
    assert_eq!(
        (&ignored["ignored"], &ignored["instances"]),
        (&json!(2), &json!(0))
    );
    assert_eq!(
        (&ignored["state"], &ignored["reason"]["name"]),
        (&json!("nothing"), &json!("other-objects"))
    );
    assert_eq!(
        (&of("1.2.3.1")["superseded"], &of("1.2.3.1")["ignored"]),
        (&json!(1), &json!(0))
    );
}
