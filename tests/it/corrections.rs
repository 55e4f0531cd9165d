//! A PACS corrects images: the same UIDs come again with another patient or other pixels.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use imaging::dicom::Attributes;
use imaging::dicom::write::{Head, KeyObjectTitle, Listed, key_object};
use serde_json::{Value, json};

use crate::dicom::{head_slices, zipped};
use crate::head::plain_head;
use crate::pacs::{Lines, Neighbour, dcmtk, dimse, dimse_options, items, run, with_texts};
use crate::results::{IDENTITY, add_node, identified_case, identified_head, result, small};
use crate::series_builder::{Slice, Syntax, files};
use crate::server::{Answer, Part, Server, form, form_type};
use crate::until::until;

/// The files of [`identified_head`] with another patient.
pub(crate) fn corrected_head() -> Vec<Vec<u8>> {
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
pub(crate) async fn case_after(neighbour: &Neighbour, before: &str) -> String {
    let case = until("another case comes", async || {
        let arrival = neighbour.settled().await;
        let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
        (case != before).then_some(case)
    })
    .await;
    neighbour.server.until_ready(&case).await;
    case
}

/// The case that a link to the study opens, once there is one.
async fn case_of_a_link(neighbour: &Neighbour) -> String {
    let case = until("a link opens a case", async || {
        let found = launched(neighbour).await;
        let case = found["case"].as_str()?;
        Some(format!("/v1/cases/{case}"))
    })
    .await;
    neighbour.server.until_ready(&case).await;
    case
}

/// A version of a case with another mask, ready.
async fn other_mask(server: &Server, case: &str) -> String {
    let request = Request::put(format!("{case}/mask?offset_mm=-1&closing_radius_mm=8"));
    let version = server.send(request.body(Vec::new().into()).unwrap()).await;
    let version = format!("/v1/cases/{}", version.json()["id"].as_str().unwrap());
    server.until_ready(&version).await;
    version
}

async fn findings_of(server: &Server, case: &str) -> Value {
    let findings = server.get(&format!("{case}/findings")).await.json();
    findings["findings"].clone()
}

async fn put_report(server: &Server, case: &str, report: &[u8]) -> Answer {
    crate::findings::put(server, case, "application/dicom", report.to_vec()).await
}

/// Why a case is superseded, by its own address and by the list.
async fn superseded(server: &Server, case: &str) -> Value {
    let alone = server.get(case).await.json();
    let list = server.get("/v1/cases").await.json();
    let mut listed = list["cases"].as_array().unwrap().iter();
    let listed = listed.find(|each| each["id"] == alone["id"]).unwrap();
    assert_eq!(alone["superseded"], listed["superseded"]);
    alone["superseded"].clone()
}

/// A result once it was sent or has failed.
async fn ended(server: &Server, address: &str) -> Value {
    until("the result is sent or fails", async || {
        let result = server.get(address).await.json();
        let has_ended = result["state"] == "done" || result["state"] == "failed";
        has_ended.then_some(result)
    })
    .await
}

#[tokio::test]
async fn a_corrected_patient_makes_a_new_case_and_nothing_more_is_sent_of_the_old() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let old = identified_case(&neighbour).await;
    let view = json!({"what": "view", "render": small()});
    let sent = json!({"what": "view", "render": small(), "node": "away"});
    let sent = result(server, &old, &sent).await.json();
    assert_eq!(sent["node"], "away", "{sent}");
    let corrected = corrected_head();
    assert_eq!(superseded(server, &old).await, Value::Null);
    let stored = neighbour.store(&corrected).await;
    assert_eq!(stored.status, 202, "{stored:?}");
    assert_eq!(superseded(server, &old).await, "corrected");
    let report = server.get(&format!("{old}/report")).await;
    let report = String::from_utf8_lossy(&report.body).into_owned();
    assert!(report.contains("SUPERSEDED"), "{report}");
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
    // Nor is what waits already: its node may answer again at any time.
    let address = format!("/v1/dicom-results/{}", sent["id"].as_str().unwrap());
    let background = pacs::start_transfers(server.pacs.clone());
    let waiting = ended(server, &address).await;
    background.shut_down(Duration::from_secs(5)).await;
    assert_eq!(
        (&waiting["state"], &waiting["reason"]["name"]),
        (&json!("failed"), &json!("superseded"))
    );
    // What was sent is withdrawn by a note of the old patient; images of the PACS are not ours to withdraw.
    let withdraw = |uid: &Value| {
        let list = json!({"instances": [uid], "title": "rejected-for-safety"});
        json!({"what": "key-object", "key_object": list})
    };
    let note = result(server, &old, &withdraw(&sent["instance"])).await;
    assert_eq!(note.status, 200, "{note:?}");
    let has = |text: &str| memchr::memmem::find(&note.body, text.as_bytes()).is_some();
    assert!(has("113037") && has("P-77") && has(sent["instance"].as_str().unwrap()));
    let refused = result(server, &old, &withdraw(&json!("1.2.3.4.20"))).await;
    assert_eq!(refused.problem(), "no-such-instance");
    // The same correction again changes nothing.
    assert_eq!(neighbour.store(&corrected).await.status, 200);
    let new = case_after(&neighbour, &old).await;
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["superseded"], corrected.len());
    assert_eq!(superseded(server, &old).await, "corrected");
    let case = server.get(&new).await.json();
    assert_eq!(case["superseded"], Value::Null);
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
    assert_eq!(superseded(server, &first).await, "newer-version");
    assert_eq!(version["superseded"], Value::Null);
    // The older version is still the same patient's, and results are made of it.
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &first, &view).await.status, 200);
    // If the correction is taken back, the first version counts again, although it is the older one.
    let back = middle.file(Syntax::Explicit);
    assert_eq!(neighbour.store(&[back]).await.status, 202);
    assert_eq!(case_after(&neighbour, &second).await, first);
    assert_eq!(superseded(server, &first).await, Value::Null);
    assert_eq!(superseded(server, &second).await, "newer-version");
    let found = launched(&neighbour).await;
    assert!(first.ends_with(found["case"].as_str().unwrap()), "{found}");
    // Other pixels that make no case at all do not leave it as if nothing had come.
    let emptied = |slice: &Slice| Slice {
        samples: slice.samples.iter().map(|_| 1).collect(),
        ..slice.clone()
    };
    let emptied: Vec<_> = slices.iter().map(emptied).collect();
    let stored = neighbour.store(&files(&emptied, Syntax::Explicit)).await;
    assert_eq!(warnings(&stored).len(), slices.len());
    assert_eq!(superseded(server, &first).await, "newer-version");
    assert_eq!(neighbour.settled().await["state"], "nothing");
    // What shows nothing could show anything in any place.
    assert_eq!(superseded(server, &first).await, "moved");
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

/// A list of the images of the head, with a title.
fn note(title: KeyObjectTitle) -> Vec<u8> {
    let uids = head_slices().into_iter().map(|slice| slice.sop_uid);
    note_of(title, &uids.collect::<Vec<_>>())
}

/// A list of images of the series of the head, with a title.
pub(crate) fn note_of(title: KeyObjectTitle, uids: &[String]) -> Vec<u8> {
    note_in("1.2.3", title, uids)
}

/// A list of images as of that series in a study, with a title.
fn note_in(study: &str, title: KeyObjectTitle, uids: &[String]) -> Vec<u8> {
    note_naming((study, &head_slices()[0].series_uid, title, uids))
}

/// A list of images of a series, with a title.
fn note_naming((study, series, title, uids): (&str, &str, KeyObjectTitle, &[String])) -> Vec<u8> {
    let texts = [("StudyInstanceUID", study), ("PatientID", "P-77")];
    let source = Attributes {
        attributes: texts
            .map(|(name, value)| (name.to_owned(), value.to_owned()))
            .into(),
        ..Attributes::default()
    };
    let head = Head {
        source: &source,
        series_uid: "1.2.3.99",
        instance_uid: "1.2.3.99.1",
        series_number: 99,
        series_description: "note",
        derivation: "",
        comment: "",
        version: "1",
        date: "20261123",
        time: "120000",
        offset: None,
        is_annotated: false,
        is_recognizable: None,
    };
    let slice = Slice::number(0);
    let listed = |uid: &String| Listed {
        series_uid: series.to_owned(),
        sop_class_uid: slice.sop_class.to_owned(),
        sop_instance_uid: uid.clone(),
    };
    let listed: Vec<_> = uids.iter().map(listed).collect();
    key_object(&head, title, &listed).unwrap()
}

#[tokio::test]
async fn a_rejection_note_withdraws_the_series_and_another_list_does_not() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let view = json!({"what": "view", "render": small()});
    // The title "Of Interest" (113000) in place of a reason.
    let mut list = note(KeyObjectTitle::RetentionExpired);
    let at = memchr::memmem::find(&list, b"113039").unwrap();
    list[at..at + 6].copy_from_slice(b"113000");
    let stored = neighbour.store(&[list]).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    assert_eq!(launched(&neighbour).await["state"], "ready");
    let of_series = async || {
        let list = server.get("/v1/arrivals").await.json();
        let arrivals = list["arrivals"].as_array().unwrap().clone();
        let mut arrivals = arrivals.into_iter();
        arrivals.find(|each| each["series"] == "1.2.3.1").unwrap()
    };
    let rejection = note(KeyObjectTitle::RejectedForQuality);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    let found = launched(&neighbour).await;
    assert_eq!(found["case"], Value::Null, "{found}");
    assert_eq!(result(server, &case, &view).await.problem(), "superseded");
    assert_eq!(superseded(server, &case).await, "rejected");
    let arrival = of_series().await;
    assert_eq!(
        (
            &arrival["state"],
            &arrival["reason"]["name"],
            &arrival["instances"]
        ),
        (&json!("nothing"), &json!("rejected"), &json!(0))
    );
    // What was rejected for its quality does not come back, and nobody takes it.
    assert_eq!(neighbour.store(&identified_head()).await.status, 200);
    let arrival = of_series().await;
    assert_eq!(
        (
            &arrival["state"],
            &arrival["instances"],
            &arrival["ignored"]
        ),
        (
            &json!("nothing"),
            &json!(0),
            &json!(identified_head().len())
        )
    );
    let address = format!("/v1/arrivals/{}", arrival["id"].as_str().unwrap());
    let take = axum::http::Request::post(&address).body(r#"{"as": "case"}"#.into());
    assert_eq!(server.send(take.unwrap()).await.problem(), "no-images");
}

#[tokio::test]
async fn what_was_kept_long_enough_may_come_again() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let other_mask = other_mask(server, &case).await;
    let rejection = note(KeyObjectTitle::RetentionExpired);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    for version in [&case, &other_mask] {
        assert_eq!(superseded(server, version).await, "rejected");
    }
    assert_eq!(launched(&neighbour).await["case"], Value::Null);
    assert_eq!(neighbour.store(&identified_head()).await.status, 200);
    let found = until("it is a case again", async || {
        let found = launched(&neighbour).await;
        found["case"].as_str().map(str::to_owned)
    })
    .await;
    // Its newest version, as before.
    assert!(other_mask.ends_with(&found));
    for version in [&case, &other_mask] {
        assert_eq!(superseded(server, version).await, Value::Null);
    }
}

#[tokio::test]
async fn an_image_that_comes_under_another_study_supersedes_the_case_of_its_own() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let study = [
        ([0x20, 0x000D], "UI", "1.2.30"),
        ([0x20, 0x000E], "UI", "1.2.30.1"),
    ];
    let moved: Vec<_> = head_slices()
        .iter()
        .map(|slice| with_texts(slice, &study))
        .collect();
    let stored = neighbour.store(&moved).await;
    assert_eq!(
        (stored.status.as_u16(), warnings(&stored)),
        (202, vec![0xB000; moved.len()])
    );
    let found = launched(&neighbour).await;
    assert_eq!(found["case"], Value::Null, "{found}");
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &case, &view).await.problem(), "superseded");
    let list = server.get("/v1/arrivals").await.json();
    let arrivals = list["arrivals"].as_array().unwrap();
    let old = arrivals.iter().find(|each| each["series"] == "1.2.3.1");
    let old = old.unwrap();
    assert_eq!(
        (&old["state"], &old["reason"]["name"]),
        (&json!("nothing"), &json!("moved"))
    );
}

/// The head as a FLAIR of the same study, brighter by some steps.
fn flair(steps: u16) -> Vec<Vec<u8>> {
    files(&flair_slices(steps), Syntax::Explicit)
}

fn flair_slices(steps: u16) -> Vec<Slice> {
    let of = |slice: Slice| Slice {
        description: "FLAIR",
        sop_uid: format!("1.2.3.77.{}", slice.instance),
        series_uid: "1.2.3.77".to_owned(),
        series_number: 7,
        samples: slice.samples.iter().map(|value| value + steps).collect(),
        ..slice
    };
    head_slices().into_iter().map(of).collect()
}

/// The files of slices of the patient of [`identified_head`].
fn identified(slices: &[Slice]) -> Vec<Vec<u8>> {
    let identified = slices.iter().map(|slice| with_texts(slice, &IDENTITY));
    identified.collect()
}

#[tokio::test]
async fn a_layer_of_a_corrected_series_makes_room_for_the_corrected_one() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let t1 = files(&head_slices(), Syntax::Explicit);
    assert_eq!(neighbour.store(&t1).await.status, 200);
    let case = neighbour.settled().await["case"].clone();
    let address = format!("/v1/cases/{}/layers", case.as_str().unwrap());
    let layers = async || {
        let layers = server.get(&address).await.json();
        let layers = layers["layers"].as_array().unwrap().clone();
        // Beside the maps.
        let flair = |layer: &&Value| layer["name"].as_str().unwrap().starts_with("FLAIR");
        let flairs = layers.iter().filter(flair);
        flairs.map(|layer| layer["id"].clone()).collect::<Vec<_>>()
    };
    let until_other_than = async |before: &[Value]| {
        until("another layer comes", async || {
            let now = layers().await;
            (now.len() == 1 && now != before).then_some(now)
        })
        .await
    };
    // Of late images, the layer is made again, and the one of fewer images goes.
    let all = flair(0);
    let (late, early) = all.split_last().unwrap();
    assert_eq!(neighbour.store(early).await.status, 200);
    let first = until_other_than(&[]).await;
    assert_eq!(
        neighbour.store(std::slice::from_ref(late)).await.status,
        200
    );
    let second = until_other_than(&first).await;
    // What was corrected is not shown from the first image on.
    assert_eq!(neighbour.store(&flair(9)[..1]).await.status, 202);
    assert_eq!(layers().await, [] as [Value; 0]);
    assert_eq!(neighbour.store(&flair(9)[1..]).await.status, 202);
    until_other_than(&second).await;
}

/// The images of the head under another series, which differs by one grey value.
fn other_t1() -> Vec<Vec<u8>> {
    let of = |slice: Slice| Slice {
        sop_uid: format!("1.2.3.66.{}", slice.instance),
        series_uid: "1.2.3.66".to_owned(),
        series_number: 6,
        samples: slice.samples.iter().map(|value| value + 1).collect(),
        ..slice
    };
    let slices: Vec<_> = head_slices().into_iter().map(of).collect();
    identified(&slices)
}

#[tokio::test]
async fn a_series_of_another_patient_of_the_study_is_no_layer() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    // Without a patient, it is not known to be of this one.
    assert_eq!(neighbour.store(&flair(0)).await.status, 200);
    until("the series becomes nothing", async || {
        let list = neighbour.server.get("/v1/arrivals").await.json();
        let mut arrivals = list["arrivals"].as_array().unwrap().iter();
        let flair = arrivals.find(|each| each["series"] == "1.2.3.77")?;
        (flair["reason"]["name"] == "series-not-t1").then_some(())
    })
    .await;
    let layers = neighbour.server.get(&format!("{case}/layers")).await.json();
    assert!(!layers.to_string().contains("FLAIR"), "{layers}");
}

#[tokio::test]
async fn a_layer_of_a_rejected_head_goes_to_the_one_that_takes_its_place() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let rejected = identified_case(&neighbour).await;
    let of = async |series: &str| {
        let list = server.get("/v1/arrivals").await.json();
        let mut arrivals = list["arrivals"].as_array().unwrap().iter();
        arrivals.find(|each| each["series"] == series).cloned()
    };
    let case_of = async |series: &str, state: &str| {
        until(&format!("{series} becomes a {state}"), async || {
            let arrival = of(series).await?;
            (arrival["state"] == state).then(|| arrival["case"].as_str().unwrap().to_owned())
        })
        .await
    };
    let flair = identified(&flair_slices(0));
    assert_eq!(neighbour.store(&flair).await.status, 200);
    assert!(rejected.ends_with(&case_of("1.2.3.77", "layer").await));
    let rejection = note(KeyObjectTitle::RejectedForQuality);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    // There is no head any more.
    until("the layer is read again", async || {
        let arrival = of("1.2.3.77").await?;
        (arrival["reason"]["name"] == "series-not-t1").then_some(())
    })
    .await;
    assert_eq!(neighbour.store(&other_t1()).await.status, 200);
    let next = case_of("1.2.3.66", "case").await;
    assert!(!rejected.ends_with(&next));
    assert_eq!(case_of("1.2.3.77", "layer").await, next);
}

#[tokio::test]
async fn a_rejection_note_withdraws_the_images_that_it_names_and_no_others() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let count = head_slices().len();
    // One that never came. It is held back when it comes; what is here stays a case.
    let late = Slice {
        sop_uid: "1.2.3.4.9999".to_owned(),
        ..head_slices()[count - 1].clone()
    };
    for title in [
        KeyObjectTitle::RejectedForQuality,
        KeyObjectTitle::RejectedForSafety,
    ] {
        let absent = note_of(title, std::slice::from_ref(&late.sop_uid));
        assert_eq!(neighbour.store(&[absent]).await.status, 200);
    }
    let arrivals = neighbour.server.get("/v1/arrivals").await.json();
    let heads = arrivals["arrivals"].as_array().unwrap().iter();
    let mut heads = heads.filter(|each| each["series"] == "1.2.3.1");
    assert_eq!(heads.next().unwrap()["state"], "case");
    assert_eq!(superseded(&neighbour.server, &case).await, Value::Null);
    let found = launched(&neighbour).await;
    assert!(case.ends_with(found["case"].as_str().unwrap()), "{found}");
    let stored = neighbour.store(&identified(&[late])).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    assert_eq!(superseded(&neighbour.server, &case).await, Value::Null);
    // One of the case: nothing is shown of it, and what is left is read again.
    let last = head_slices()[count - 1].sop_uid.clone();
    let named = note_of(KeyObjectTitle::RejectedForSafety, &[last]);
    assert_eq!(neighbour.store(&[named]).await.status, 200);
    assert_eq!(superseded(&neighbour.server, &case).await, "rejected");
    let next = until("the other images are a case", async || {
        let found = launched(&neighbour).await;
        found["case"].as_str().map(str::to_owned)
    })
    .await;
    assert!(!case.ends_with(&next));
}

/// The head with left and right exchanged: the same pixels, in the mirrored place.
fn exchanged(slice: &Slice) -> Slice {
    let [x, y, z] = slice.position;
    let [a, b, c, d, e, f] = slice.orientation;
    Slice {
        position: [-x, y, z],
        orientation: [-a, b, c, -d, e, f],
        ..slice.clone()
    }
}

#[tokio::test]
async fn findings_and_layers_do_not_follow_images_that_lie_elsewhere() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let slices: Vec<_> = head_slices().iter().map(exchanged).collect();
    assert_eq!(neighbour.store(&identified(&slices)).await.status, 200);
    let wrong = neighbour.settled().await["case"].clone();
    let wrong = format!("/v1/cases/{}", wrong.as_str().unwrap());
    server.until_ready(&wrong).await;
    let marked = crate::findings::mark(server, &wrong).await;
    let layers = async |case: &str| {
        let layers = server.get(&format!("{case}/layers")).await.json();
        let layers = layers["layers"].as_array().unwrap().clone();
        // Beside the maps.
        let flairs = layers
            .iter()
            .filter(|layer| layer["name"].as_str().unwrap().starts_with("FLAIR"));
        // In the images that are exchanged it is a mirror image, and fails.
        flairs
            .filter(|layer| {
                ["ready", "failed"]
                    .map(Value::from)
                    .contains(&layer["state"])
            })
            .count()
    };
    assert_eq!(
        neighbour.store(&identified(&flair_slices(0))).await.status,
        200
    );
    until("the layer comes", async || {
        (layers(&wrong).await == 1).then_some(())
    })
    .await;
    // The same voxels elsewhere are another matter.
    let of_study = [
        ([0x20, 0x0D], "UI", "1.2.40"),
        ([0x20, 0x0E], "UI", "1.2.40.1"),
    ];
    let elsewhere = |slice: &Slice| {
        let sop = format!("1.2.40.1.{}", slice.instance);
        let sop = [([0x08, 0x18], "UI", sop.as_str())];
        with_texts(slice, &[&IDENTITY[..], &of_study, &sop].concat())
    };
    let elsewhere: Vec<_> = slices.iter().map(elsewhere).collect();
    assert_eq!(neighbour.store(&elsewhere).await.status, 200);
    let elsewhere = until("the other study is a case", async || {
        let list = server.get("/v1/arrivals").await.json();
        let mut arrivals = list["arrivals"].as_array().unwrap().iter();
        let other = arrivals.find(|each| each["series"] == "1.2.40.1")?;
        Some(format!("/v1/cases/{}", other["case"].as_str()?))
    })
    .await;
    // The archive corrects the orientation of every image. From the first one on, nothing is made of the old case.
    let corrected = identified_head();
    let (first, rest) = corrected.split_at(1);
    assert_eq!(warnings(&neighbour.store(first).await).len(), 1);
    assert_eq!(superseded(server, &wrong).await, "moved");
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &wrong, &view).await.problem(), "superseded");
    let stored = neighbour.store(rest).await;
    assert_eq!(warnings(&stored).len(), rest.len());
    let right = until("the corrected images are a case", async || {
        let found = launched(&neighbour).await;
        let case = format!("/v1/cases/{}", found["case"].as_str()?);
        (case != wrong).then_some(case)
    })
    .await;
    server.until_ready(&right).await;
    let version = server.get(&right).await.json();
    assert!(
        wrong.ends_with(version["previous"].as_str().unwrap()),
        "{version}"
    );
    assert_eq!(
        server.get(&format!("{right}/findings")).await.json()["findings"],
        json!([])
    );
    // They are not lost: they stay where they were marked, which says what happened.
    let kept = server.get(&format!("{wrong}/findings")).await.json();
    assert_eq!(kept["findings"], marked["findings"]);
    assert_eq!(superseded(server, &wrong).await, "moved");
    assert_eq!(superseded(server, &elsewhere).await, Value::Null);
    // The series that was a layer is placed again, in the corrected images.
    until("the layer comes again", async || {
        (layers(&right).await == 1).then_some(())
    })
    .await;
    for (case, words) in [(&wrong, "MOVED:"), (&right, "CORRECTED:")] {
        crate::maps::until_maps(server, case).await;
        // It waits for the map of the FLAIR, too.
        let report = until("the report comes", async || {
            let report = server.get(&format!("{case}/report")).await;
            (report.status == 200).then_some(report)
        })
        .await;
        let report = String::from_utf8_lossy(&report.body).into_owned();
        let doubts = report.split("class=\"doubt\"").nth(1).unwrap_or(&report);
        assert!(
            report.contains(words),
            "{words}: {}",
            &doubts[..doubts.len().min(300)]
        );
    }
}

#[tokio::test]
async fn findings_stay_with_a_rejected_case_when_the_series_comes_under_new_uids() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let rejected = identified_case(&neighbour).await;
    let marked = crate::findings::mark(server, &rejected).await;
    let rejection = note(KeyObjectTitle::IncorrectWorklistEntry);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    // The right images of the series lie elsewhere.
    let renamed = |slice: &Slice, series: u32| {
        let sop = format!("1.2.3.{series}.{}", slice.instance);
        let sop = [([0x08, 0x18], "UI", sop.as_str())];
        with_texts(slice, &[&IDENTITY[..], &sop].concat())
    };
    let slices = head_slices();
    let mirrored: Vec<_> = slices
        .iter()
        .map(|slice| renamed(&exchanged(slice), 44))
        .collect();
    assert_eq!(neighbour.store(&mirrored).await.status, 200);
    let next = case_of_a_link(&neighbour).await;
    let findings = async |case: &str| {
        let findings = server.get(&format!("{case}/findings")).await.json();
        findings["findings"].clone()
    };
    let version = server.get(&next).await.json();
    assert!(rejected.ends_with(version["previous"].as_str().unwrap()));
    assert_eq!(findings(&next).await, json!([]));
    assert_eq!(findings(&rejected).await, marked["findings"]);
    assert_eq!(superseded(server, &rejected).await, "rejected");
    assert_eq!(superseded(server, &next).await, Value::Null);
}

#[tokio::test]
async fn a_corrected_name_hides_no_other_place_of_the_images() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    let marked = other_mask(server, &first).await;
    let findings = crate::findings::mark(server, &marked).await;
    let mut reports = Vec::new();
    for what in ["findings", "finding-segments"] {
        let report = result(server, &marked, &json!({ "what": what })).await;
        assert_eq!(report.status, 200, "{report:?}");
        reports.push(report.body.to_vec());
    }
    let view = |node: Value| json!({"what": "view", "render": small(), "node": node});
    let sent = result(server, &marked, &view(json!("away"))).await.json();
    // A version of other pixels has what was marked in the version that readers saw, and takes reports of it.
    let darker = darker_slices();
    assert_eq!(neighbour.store(&identified(&darker)).await.status, 202);
    let second = case_after(&neighbour, &first).await;
    let version = server.get(&second).await.json();
    assert!(marked.ends_with(version["previous"].as_str().unwrap()));
    let inherited = findings_of(server, &second).await;
    assert_eq!(inherited, findings["findings"]);
    for report in &reports {
        let taken = put_report(server, &second, report).await;
        assert_eq!(taken.status, 200, "{taken:?}");
    }
    // The name and the place of all images are corrected in one go.
    let name = [([0x10, 0x0010], "PN", "Müller^Anne")];
    let corrected = |slice: &Slice| with_texts(&exchanged(slice), &[&IDENTITY[..], &name].concat());
    let corrected: Vec<_> = darker.iter().map(corrected).collect();
    assert_eq!(neighbour.store(&corrected).await.status, 202);
    let third = case_after(&neighbour, &second).await;
    let version = server.get(&third).await.json();
    assert!(second.ends_with(version["previous"].as_str().unwrap()));
    assert_eq!(findings_of(server, &third).await, json!([]));
    assert_eq!(superseded(server, &third).await, Value::Null);
    for report in &reports {
        let refused = put_report(server, &third, report).await;
        assert_eq!(
            (refused.status.as_u16(), refused.problem().as_str()),
            (409, "findings-elsewhere")
        );
    }
    for case in [&first, &marked, &second] {
        assert_eq!(superseded(server, case).await, "moved", "{case}");
        let refused = result(server, case, &view(Value::Null)).await;
        assert_eq!(
            (refused.status.as_u16(), refused.problem().as_str()),
            (409, "superseded")
        );
        let detail = refused.json()["detail"].to_string();
        assert!(detail.contains("left and right"), "{detail}");
    }
    // Nor is what waits already sent.
    let address = format!("/v1/dicom-results/{}", sent["id"].as_str().unwrap());
    let background = pacs::start_transfers(server.pacs.clone());
    let waiting = ended(server, &address).await;
    background.shut_down(Duration::from_secs(5)).await;
    assert_eq!(waiting["reason"]["name"], "superseded", "{waiting}");
    // Deleted cases tell nothing of their images any more.
    for case in [&first, &marked, &second] {
        let deleted = server.method(axum::http::Method::DELETE, case).await;
        assert_eq!(deleted.status, 204, "{deleted:?}");
    }
    for report in &reports {
        let refused = put_report(server, &third, report).await;
        assert_eq!(refused.problem(), "findings-elsewhere");
    }
}

#[tokio::test]
async fn a_corrected_name_hides_no_rejection() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let rejected = identified_case(&neighbour).await;
    crate::findings::mark(server, &rejected).await;
    let slices = head_slices();
    let (last, others) = slices.split_last().unwrap();
    let named = note_of(
        KeyObjectTitle::RejectedForSafety,
        std::slice::from_ref(&last.sop_uid),
    );
    assert_eq!(neighbour.store(&[named]).await.status, 200);
    // The name is corrected in the others, most likely before they are read again.
    let name = [([0x10, 0x0010], "PN", "Müller^Anne")];
    let corrected = |slice: &Slice| with_texts(slice, &[&IDENTITY[..], &name].concat());
    let corrected: Vec<_> = others.iter().map(corrected).collect();
    assert_eq!(neighbour.store(&corrected).await.status, 202);
    let next = case_of_a_link(&neighbour).await;
    assert_eq!(superseded(server, &rejected).await, "rejected");
    assert_eq!(findings_of(server, &next).await, json!([]));
}

#[tokio::test]
async fn findings_do_not_follow_pixels_that_are_mirrored_or_shifted() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let mut before = identified_case(&neighbour).await;
    // One that is mirrored and shifted, and one that is shifted.
    let pictures = [2, 5].map(|shift| mirrored_head(shift, &[]));
    for (number, pictures) in pictures.iter().enumerate() {
        crate::findings::mark(server, &before).await;
        assert_eq!(neighbour.store(pictures).await.status, 202, "{number}");
        let next = case_after(&neighbour, &before).await;
        assert_eq!(findings_of(server, &next).await, json!([]), "{number}");
        assert_eq!(superseded(server, &before).await, "moved", "{number}");
        before = next;
    }
}

#[tokio::test]
async fn a_report_is_not_taken_over_into_pixels_that_were_mirrored_behind_another_patient() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    crate::findings::mark(server, &first).await;
    let report = result(server, &first, &json!({"what": "findings"})).await;
    assert_eq!(report.status, 200, "{report:?}");
    let wrong = [([0x10, 0x20], "LO", "PAT-WRONG")];
    assert_eq!(neighbour.store(&mirrored_head(0, &wrong)).await.status, 202);
    let second = case_after(&neighbour, &first).await;
    assert_eq!(neighbour.store(&mirrored_head(0, &[])).await.status, 202);
    let third = case_after(&neighbour, &second).await;
    assert_eq!(findings_of(server, &third).await, json!([]));
    let refused = put_report(server, &third, &report.body).await;
    assert_eq!(refused.problem(), "findings-elsewhere");
    // Into other pixels that show the same it is.
    let darker = darker_slices();
    assert_eq!(neighbour.store(&identified(&darker)).await.status, 202);
    let fourth = case_after(&neighbour, &third).await;
    let taken = put_report(server, &fourth, &report.body).await;
    assert_eq!(taken.status, 200, "{taken:?}");
}

#[tokio::test]
async fn a_report_is_not_taken_over_into_mirrored_pixels_of_another_series() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    crate::findings::mark(server, &first).await;
    let report = result(server, &first, &json!({"what": "findings"})).await;
    let series = [([0x20, 0x0E], "UI", "1.2.3.98")];
    assert_eq!(
        neighbour.store(&mirrored_head(0, &series)).await.status,
        202
    );
    let second = until("the other series is a case", async || {
        let found = launched(&neighbour).await;
        let case = format!("/v1/cases/{}", found["case"].as_str()?);
        (case != first).then_some(case)
    })
    .await;
    server.until_ready(&second).await;
    let refused = put_report(server, &second, &report.body).await;
    assert_eq!(refused.problem(), "findings-elsewhere");
}

#[tokio::test]
async fn another_frame_of_reference_is_another_place() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    crate::findings::mark(server, &first).await;
    let frame = [([0x20, 0x52], "UI", "1.2.3.97")];
    let texts = [&IDENTITY[..], &frame].concat();
    let slices = head_slices();
    let other: Vec<_> = slices
        .iter()
        .map(|slice| with_texts(slice, &texts))
        .collect();
    let stored = neighbour.store(&other).await;
    assert_eq!(warnings(&stored).len(), other.len(), "{stored:?}");
    assert_eq!(superseded(server, &first).await, "moved");
    let second = case_after(&neighbour, &first).await;
    assert_eq!(findings_of(server, &second).await, json!([]));
}

#[tokio::test]
async fn a_correction_counts_although_the_images_before_it_are_forgotten() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let store = server.pacs.cases().store().clone();
    let first = identified_case(&neighbour).await;
    crate::findings::mark(server, &first).await;
    store.forget(Duration::ZERO).await.unwrap();
    assert_eq!(neighbour.store(&mirrored_head(0, &[])).await.status, 200);
    let second = case_after(&neighbour, &first).await;
    assert_eq!(superseded(server, &first).await, "moved");
    assert_eq!(findings_of(server, &second).await, json!([]));
    store.forget(Duration::ZERO).await.unwrap();
    assert_eq!(neighbour.store(&corrected_head()).await.status, 200);
    let third = case_after(&neighbour, &second).await;
    assert_eq!(superseded(server, &second).await, "corrected");
    assert_eq!(superseded(server, &third).await, Value::Null);
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &second, &view).await.problem(), "superseded");
}

#[tokio::test]
async fn a_result_that_waits_is_not_sent_once_a_layer_was_withdrawn() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    for number in 0..2 {
        let flair = identified(&flair_slices(number));
        let status = if number == 0 { 200 } else { 202 };
        assert_eq!(neighbour.store(&flair[..1]).await.status, status);
        assert_eq!(neighbour.store(&flair[1..]).await.status, status);
        let mut shown = small();
        shown["layer"] = ready_flair(server, &case).await;
        let view = json!({"what": "view", "render": shown, "node": "away"});
        let waiting = result(server, &case, &view).await.json();
        let address = format!("/v1/dicom-results/{}", waiting["id"].as_str().unwrap());
        let waits = server.get(&address).await.json();
        assert_eq!(waits["state"], "queued", "{waits}");
        if number == 0 {
            // The first image of the FLAIR is corrected.
            let corrected = identified(&flair_slices(9));
            assert_eq!(neighbour.store(&corrected[..1]).await.status, 202);
        } else {
            let uids: Vec<_> = flair_slices(0)
                .into_iter()
                .map(|slice| slice.sop_uid)
                .collect();
            let title = KeyObjectTitle::RejectedForSafety;
            let rejection = note_naming(("1.2.3", "1.2.3.77", title, &uids));
            assert_eq!(neighbour.store(&[rejection]).await.status, 200);
        }
        let failed = server.get(&address).await.json();
        assert_eq!(failed["state"], "failed", "{failed}");
        assert_eq!(failed["reason"]["name"], "layer-withdrawn", "{failed}");
    }
}

/// The head with half the brightness.
fn darker_slices() -> Vec<Slice> {
    let darker = |slice: &Slice| Slice {
        samples: slice.samples.iter().map(|sample| sample / 2).collect(),
        ..slice.clone()
    };
    head_slices().iter().map(darker).collect()
}

/// The slices of the head with the columns reversed, and so many of them moved from one end to the other, with these texts.
fn mirrored_head(shift: usize, texts: &[([u16; 2], &str, &str)]) -> Vec<Vec<u8>> {
    let mirrored = |slice: &Slice| {
        let rows = slice.samples.chunks(slice.columns.into());
        let mirrored = rows.flat_map(|row| {
            let mut row = row.to_vec();
            row.reverse();
            row.rotate_right(shift);
            row
        });
        let slice = Slice {
            samples: mirrored.collect(),
            ..slice.clone()
        };
        with_texts(&slice, &[&IDENTITY[..], texts].concat())
    };
    head_slices().iter().map(mirrored).collect()
}

#[tokio::test]
async fn findings_do_not_follow_pixels_that_are_mirrored_part_by_part() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let before = identified_case(&neighbour).await;
    crate::findings::mark(server, &before).await;
    let mirrored = mirrored_head(0, &[]);
    let (first, rest) = mirrored.split_at(mirrored.len() / 2);
    assert_eq!(neighbour.store(first).await.status, 202);
    let half = case_after(&neighbour, &before).await;
    assert_eq!(neighbour.store(rest).await.status, 202);
    let next = case_after(&neighbour, &half).await;
    assert_eq!(findings_of(server, &next).await, json!([]));
    assert_eq!(superseded(server, &before).await, "moved");
}

#[tokio::test]
async fn images_in_the_same_place_under_new_uids_do_not_bring_back_what_was_rejected() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let rejected = identified_case(&neighbour).await;
    crate::findings::mark(server, &rejected).await;
    let rejection = note(KeyObjectTitle::RejectedForSafety);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    let renamed = |slice: &Slice| {
        let sop = format!("1.2.3.45.{}", slice.instance);
        let sop = [([0x08, 0x18], "UI", sop.as_str())];
        with_texts(slice, &[&IDENTITY[..], &sop].concat())
    };
    let renamed: Vec<_> = head_slices().iter().map(renamed).collect();
    assert_eq!(neighbour.store(&renamed).await.status, 200);
    let next = case_of_a_link(&neighbour).await;
    let findings = server.get(&format!("{next}/findings")).await.json();
    assert_eq!(findings["findings"], json!([]));
}

#[tokio::test]
async fn images_whose_uids_were_exchanged_leave_an_older_version_behind() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let before = identified_case(&neighbour).await;
    let slices = head_slices();
    let exchanged: Vec<_> = slices
        .iter()
        .zip(slices.iter().rev())
        .map(|(slice, other)| {
            let sop = [([0x08, 0x18], "UI", other.sop_uid.as_str())];
            with_texts(slice, &[&IDENTITY[..], &sop].concat())
        })
        .collect();
    assert_eq!(neighbour.store(&exchanged).await.status, 202);
    let next = case_after(&neighbour, &before).await;
    assert_eq!(superseded(server, &before).await, "moved");
    assert_eq!(superseded(server, &next).await, Value::Null);
}

#[tokio::test]
async fn a_note_of_another_study_neither_withdraws_an_image_nor_holds_its_correction_back() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let uids = head_slices().into_iter().map(|slice| slice.sop_uid);
    let title = KeyObjectTitle::RejectedForQuality;
    let foreign = note_in("1.2.30", title, &uids.collect::<Vec<_>>());
    assert_eq!(neighbour.store(&[foreign]).await.status, 200);
    assert_eq!(superseded(server, &case).await, Value::Null);
    let corrected = corrected_head();
    let stored = neighbour.store(&corrected).await;
    assert_eq!(warnings(&stored), vec![0xB000; corrected.len()]);
    assert_eq!(superseded(server, &case).await, "corrected");
    assert!(!lines.text().contains("is withdrawn"), "{}", lines.text());
    // The same note of its own study does.
    let rejection = note(KeyObjectTitle::RejectedForQuality);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    assert!(lines.text().contains("is withdrawn"));
    let stored = neighbour.store(&corrected).await;
    assert_eq!((stored.status.as_u16(), warnings(&stored)), (200, vec![]));
    let text = lines.text();
    let line = text.lines().rfind(|line| line.contains("by STOW-RS"));
    // Without the codes of colours.
    let parts = line.unwrap().split('\u{1b}').enumerate();
    let plain: String = parts
        .map(|(at, part)| match part.split_once('m') {
            Some((_, rest)) if at > 0 => rest,
            _ => part,
        })
        .collect();
    let count = format!("images=0 ignored={} ", corrected.len());
    assert!(plain.contains(&count), "{plain}");
}

/// The arrival of a series.
async fn arrival_of(server: &Server, series: &str) -> Value {
    let list = server.get("/v1/arrivals").await.json();
    let mut arrivals = list["arrivals"].as_array().unwrap().iter();
    let found = arrivals.find(|each| each["series"] == series);
    found.cloned().unwrap_or_default()
}

/// The files of slices of another patient than [`identified_head`].
fn of_another(slices: &[Slice]) -> Vec<Vec<u8>> {
    let other = [
        ([0x10, 0x0010], "PN", "Right^Patient"),
        ([0x10, 0x0020], "LO", "PAT-RIGHT"),
        ([0x08, 0x0050], "SH", "A-2"),
    ];
    let texts = [&IDENTITY[..], &other].concat();
    let slices = slices.iter();
    slices.map(|slice| with_texts(slice, &texts)).collect()
}

async fn until_layer(server: &Server, series: &str) {
    until("the series is a layer", async || {
        (arrival_of(server, series).await["state"] == "layer").then_some(())
    })
    .await;
}

#[tokio::test]
async fn deleting_a_case_leaves_the_images_that_were_corrected_or_rejected_since() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = flair_slices(0);
    assert_eq!(neighbour.store(&identified(&flair)).await.status, 200);
    until_layer(server, "1.2.3.77").await;
    // The FLAIR was another patient's, and leads to the case of this one no longer.
    let corrected = of_another(&flair);
    assert_eq!(neighbour.store(&corrected).await.status, 202);
    let arrival = arrival_of(server, "1.2.3.77").await;
    assert_eq!(arrival["case"], Value::Null, "{arrival}");
    // Every image of the head comes with other pixels, and the user deletes the case that shows the old ones.
    let brighter = |slice: &Slice| Slice {
        samples: slice.samples.iter().map(|value| value + 1).collect(),
        ..slice.clone()
    };
    let brighter: Vec<_> = head_slices().iter().map(brighter).collect();
    assert_eq!(neighbour.store(&identified(&brighter)).await.status, 202);
    let deleted = server.method(axum::http::Method::DELETE, &case).await;
    assert!(deleted.status.is_success(), "{deleted:?}");
    for series in ["1.2.3.77", "1.2.3.1"] {
        let arrival = arrival_of(server, series).await;
        assert_eq!(arrival["instances"], flair.len(), "{series}: {arrival}");
    }
    let next = until("the new pixels are a case", async || {
        let arrival = arrival_of(server, "1.2.3.1").await;
        arrival["case"].as_str().map(str::to_owned)
    })
    .await;
    assert!(!case.ends_with(&next));
}

#[tokio::test]
async fn a_correction_that_cannot_be_decoded_takes_nobodys_place() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let middle = &head_slices()[20];
    let other = ([0x10, 0x0020], "LO", "PAT-RIGHT");
    let cut = Slice {
        samples: middle.samples[..500].to_vec(),
        ..middle.clone()
    };
    let rows = u16::try_from(middle.samples.len() / usize::from(middle.columns)).unwrap();
    let rows = String::from_utf8(rows.to_le_bytes().into()).unwrap();
    let broken = [
        (&cut, ([0x28, 0x10], "US", rows.as_str())),
        (middle, ([0x28, 0x10], "US", "\0\0")),
        (middle, ([0x28, 0x100], "US", "\u{c}\0")),
        (middle, ([0x20, 0x32], "DS", "nan\\0\\0")),
        (middle, ([0x20, 0x37], "DS", "1\\0\\0\\1\\0\\0")),
        (middle, ([0x28, 0x30], "DS", "0\\0")),
    ];
    for (slice, wrong) in broken {
        for texts in [&[wrong][..], &[wrong, other]] {
            let file = with_texts(slice, &[&IDENTITY[..], texts].concat());
            let refused = neighbour.store(&[file]).await;
            assert_eq!(refused.status, 409, "{texts:?}: {refused:?}");
        }
    }
    let arrival = arrival_of(server, "1.2.3.1").await;
    assert_eq!(
        (&arrival["state"], &arrival["superseded"]),
        (&json!("case"), &json!(0))
    );
    assert_eq!(superseded(server, &case).await, Value::Null);
}

/// Adds the files of a volume to a case as a layer.
async fn add_layer(server: &Server, case: &str, files: &[Vec<u8>]) -> Answer {
    let form = form(&[("volume", &zipped(files))]);
    let request = axum::http::Request::post(format!("{case}/layers"))
        .header("content-type", form_type())
        .body(form.into());
    server.send(request.unwrap()).await
}

/// The layers of a case that were uploaded, beside its maps.
async fn flairs(server: &Server, case: &str) -> usize {
    let layers = server.get(&format!("{case}/layers")).await.json();
    let layers = layers["layers"].as_array().unwrap().iter();
    let names = layers.filter_map(|layer| layer["name"].as_str());
    names.filter(|name| name.starts_with("FLAIR")).count()
}

#[tokio::test]
async fn what_was_rejected_does_not_come_back_by_upload() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let rejected = identified_case(&neighbour).await;
    let rejection = note(KeyObjectTitle::RejectedForSafety);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    // With another parameter, it is another case.
    let volume = zipped(&identified_head());
    let parts: [Part<'_>; 2] = [
        ("volume", &volume),
        ("parameters", br#"{"closing_radius_mm": 9}"#),
    ];
    let uploaded = server.prepared(&parts).await;
    assert_ne!(uploaded, rejected);
    assert_eq!(superseded(server, &uploaded).await, "rejected");
    let found = launched(&neighbour).await;
    assert_eq!(found["case"], Value::Null, "{found}");
    let view = json!({"what": "view", "render": small()});
    let refused = result(server, &uploaded, &view).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "superseded")
    );
    // Nor is it shown over another head.
    assert_eq!(neighbour.store(&other_t1()).await.status, 200);
    let next = case_of_a_link(&neighbour).await;
    let refused = add_layer(server, &next, &identified_head()).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (422, "images-rejected")
    );
}

#[tokio::test]
async fn a_layer_of_a_corrected_or_rejected_series_is_removed_from_cases_of_other_studies() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    // The FLAIR of the same patient in two other studies, which a user added by hand.
    let elsewhere = |study: &str, patient: &str| {
        let series = format!("{study}.1");
        let file = |slice: &Slice| {
            let sop = format!("{series}.{}", slice.instance);
            let texts = [
                ([0x08, 0x18], "UI", sop.as_str()),
                ([0x10, 0x20], "LO", patient),
                ([0x20, 0x0D], "UI", study),
                ([0x20, 0x0E], "UI", series.as_str()),
            ];
            with_texts(slice, &[&IDENTITY[..], &texts].concat())
        };
        flair_slices(0).iter().map(file).collect::<Vec<_>>()
    };
    for (added, study) in ["1.2.31", "1.2.32"].into_iter().enumerate() {
        let files = elsewhere(study, "P-77");
        assert_eq!(neighbour.store(&files).await.status, 200);
        let answer = add_layer(server, &case, &files).await;
        assert_eq!(answer.status, 202, "{answer:?}");
        assert_eq!(flairs(server, &case).await, added + 1);
    }
    let corrected = elsewhere("1.2.31", "PAT-RIGHT");
    assert_eq!(neighbour.store(&corrected[..1]).await.status, 202);
    assert_eq!(flairs(server, &case).await, 1);
    let uids: Vec<_> = (flair_slices(0).iter())
        .map(|slice| format!("1.2.32.1.{}", slice.instance))
        .collect();
    let series = (
        "1.2.32",
        "1.2.32.1",
        KeyObjectTitle::RejectedForSafety,
        &uids[..],
    );
    assert_eq!(neighbour.store(&[note_naming(series)]).await.status, 200);
    assert_eq!(flairs(server, &case).await, 0);
}

#[tokio::test]
async fn a_note_that_comes_before_its_images_names_them_in_its_own_study_alone() {
    let neighbour = Neighbour::start(|_| {}).await;
    let uids = head_slices().into_iter().map(|slice| slice.sop_uid);
    let title = KeyObjectTitle::RejectedForQuality;
    let foreign = note_in("1.2.30", title, &uids.collect::<Vec<_>>());
    assert_eq!(neighbour.store(&[foreign]).await.status, 200);
    assert_eq!(neighbour.store(&identified_head()).await.status, 200);
    let arrival = arrival_of(&neighbour.server, "1.2.3.1").await;
    assert_eq!(
        (&arrival["instances"], &arrival["ignored"]),
        (&json!(head_slices().len()), &json!(0))
    );
}

#[tokio::test]
async fn findings_follow_other_intensities_and_not_a_mirror_image_that_is_inverted() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let before = identified_case(&neighbour).await;
    crate::findings::mark(server, &before).await;
    // Other intensities in the same place take the findings along.
    assert_eq!(
        neighbour.store(&identified(&darker_slices())).await.status,
        202
    );
    let darker = case_after(&neighbour, &before).await;
    assert_ne!(findings_of(server, &darker).await, json!([]));
    assert_eq!(superseded(server, &before).await, "newer-version");
    let inverted = |slice: &Slice| {
        let rows = slice.samples.chunks(slice.columns.into());
        let mirrored = rows.flat_map(|row| row.iter().rev());
        Slice {
            samples: mirrored
                .map(|&sample| if sample > 0 { 1100 - sample } else { 0 })
                .collect(),
            ..slice.clone()
        }
    };
    let inverted: Vec<_> = head_slices().iter().map(inverted).collect();
    assert_eq!(neighbour.store(&identified(&inverted)).await.status, 202);
    let next = case_after(&neighbour, &darker).await;
    assert_eq!(findings_of(server, &next).await, json!([]));
    assert_eq!(superseded(server, &darker).await, "moved");
    assert_eq!(superseded(server, &before).await, "moved");
}

/// The id of the FLAIR of a case, once it is ready. It may have a number behind its name.
async fn ready_flair(server: &Server, case: &str) -> Value {
    until_layer(server, "1.2.3.77").await;
    until("the layer is ready", async || {
        let layers = server.get(&format!("{case}/layers")).await.json();
        let mut layers = layers["layers"].as_array().unwrap().iter();
        let flair = layers.find(|layer| layer["name"].as_str().unwrap().starts_with("FLAIR"))?;
        (flair["state"] == "ready").then(|| flair["id"].clone())
    })
    .await
}

/// Takes a queued result as sent.
async fn sent(server: &Server) {
    let store = server.pacs.cases().store();
    let send = case::JobKind::new("send", "delivery");
    let leased = store.claim(send, 3).await.unwrap().expect("a result");
    assert!(store.finish(&leased).await.unwrap());
}

#[tokio::test]
async fn a_result_that_was_sent_with_a_layer_is_found_and_withdrawn_after_the_layer() {
    sent_with_a_layer(false).await;
}

#[tokio::test]
async fn a_result_with_a_layer_that_was_deleted_is_found_when_its_images_are_corrected() {
    sent_with_a_layer(true).await;
}

async fn sent_with_a_layer(is_deleted: bool) {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = identified(&flair_slices(0));
    assert_eq!(neighbour.store(&flair).await.status, 200);
    let flair = ready_flair(server, &case).await;
    let mut shown = small();
    let mut uids = Vec::new();
    for has_layer in [false, true] {
        if has_layer {
            shown["layer"] = flair.clone();
        }
        let view = json!({"what": "view", "render": shown, "node": "away"});
        let queued = result(server, &case, &view).await;
        assert_eq!(queued.status, 202, "{queued:?}");
        uids.push(queued.json()["instance"].clone());
        sent(server).await;
    }
    let not_valid = async || {
        let id = case.rsplit('/').next().unwrap();
        let list = server.get(&format!("/v1/dicom-results?case={id}")).await;
        let list = list.json();
        let results = list["results"].as_array().unwrap();
        let of = |uid: &Value| {
            let mut results = results.iter();
            let result = results.find(|result| result["instance"] == *uid).unwrap();
            result["not_valid"].clone()
        };
        [of(&uids[0]), of(&uids[1])]
    };
    assert_eq!(not_valid().await, [Value::Null, Value::Null]);
    if is_deleted {
        let address = format!("{case}/layers/{}", flair.as_str().unwrap());
        let request = axum::http::Request::delete(address).body(Default::default());
        assert_eq!(server.send(request.unwrap()).await.status, 204);
        assert_eq!(not_valid().await, [Value::Null, Value::Null]);
    }
    // The FLAIR was another patient's.
    let corrected = of_another(&flair_slices(0));
    assert_eq!(neighbour.store(&corrected[..1]).await.status, 202);
    assert_eq!(not_valid().await, [Value::Null, json!("layer-withdrawn")]);
    let note = json!({"what": "key-object", "node": "away",
        "key_object": {"instances": [uids[1]], "title": "rejected-for-safety"}});
    let noted = result(server, &case, &note).await;
    assert_eq!(noted.status, 202, "{noted:?}");
    assert_eq!(not_valid().await, [Value::Null, json!("withdrawn")]);
}

#[tokio::test]
async fn files_from_before_a_correction_make_no_layer() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = identified(&flair_slices(0));
    assert_eq!(neighbour.store(&flair).await.status, 200);
    ready_flair(server, &case).await;
    let corrected = of_another(&flair_slices(0));
    assert_eq!(neighbour.store(&corrected).await.status, 202);
    assert_eq!(flairs(server, &case).await, 0);
    let added = add_layer(server, &case, &flair).await;
    assert_eq!(added.problem(), "layer-of-another-patient", "{added:?}");
    assert_eq!(flairs(server, &case).await, 0);
}

#[tokio::test]
async fn a_result_that_was_withdrawn_is_not_drawn_either() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let queued = json!({"what": "view", "render": small(), "node": "away"});
    let queued = result(server, &case, &queued).await.json();
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &case, &view).await.status, 200);
    let note = json!({"what": "key-object", "node": "away",
        "key_object": {"instances": [queued["instance"]], "title": "rejected-for-quality"}});
    assert_eq!(result(server, &case, &note).await.status, 202);
    assert_eq!(result(server, &case, &view).await.problem(), "withdrawn");
}

#[tokio::test]
async fn an_upload_whose_side_the_pacs_contradicts_makes_no_results() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let other: Vec<_> = head_slices().iter().map(exchanged).collect();
    let volume = zipped(&identified(&other));
    let parts: [Part<'_>; 1] = [("volume", &volume)];
    let upload = server.prepared(&parts).await;
    let view = json!({"what": "view", "render": small(), "node": "away"});
    let waiting = result(server, &upload, &view).await.json();
    let case = identified_case(&neighbour).await;
    assert_eq!(result(server, &case, &view).await.status, 202);
    let refused = result(server, &upload, &view).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "superseded")
    );
    let background = pacs::start_transfers(server.pacs.clone());
    let address = format!("/v1/dicom-results/{}", waiting["id"].as_str().unwrap());
    let failed = ended(server, &address).await;
    background.shut_down(Duration::from_secs(5)).await;
    assert_eq!(failed["reason"]["name"], "superseded", "{failed}");
}

#[tokio::test]
async fn an_upload_makes_no_results_if_the_pacs_has_its_images_as_another_patients_without_a_case()
{
    let few = &head_slices()[20..23];
    let under_another_study = [
        ([0x20, 0x000D], "UI", "1.2.9"),
        ([0x20, 0x000E], "UI", "1.2.9.1"),
    ];
    let moved = few.iter().map(|slice| {
        let texts = [
            ([0x10, 0x0010], "PN", "Right^Patient"),
            ([0x10, 0x0020], "LO", "PAT-RIGHT"),
        ];
        with_texts(
            slice,
            &[&IDENTITY[..], &texts, &under_another_study].concat(),
        )
    });
    for images in [of_another(few), moved.collect()] {
        let neighbour = Neighbour::start(|_| {}).await;
        let server = &neighbour.server;
        let volume = zipped(&identified(&head_slices()));
        let parts: [Part<'_>; 1] = [("volume", &volume)];
        let upload = server.prepared(&parts).await;
        let view = json!({"what": "view", "render": small()});
        assert_eq!(result(server, &upload, &view).await.status, 200);
        assert_eq!(neighbour.store(&images).await.status, 200);
        assert_eq!(neighbour.settled().await["state"], "nothing");
        let refused = result(server, &upload, &view).await;
        assert_eq!(refused.problem(), "several-patients", "{refused:?}");
    }
}

#[tokio::test]
async fn a_result_that_names_its_study_is_of_the_patient_of_that_study() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let volume = plain_head().bytes();
    let case = server.prepared(&[("volume", &volume)]).await;
    let named = |patient: &str| {
        let study = json!({"StudyInstanceUID": "1.2.3", "PatientID": patient});
        json!({"what": "view", "render": small(), "study": study, "node": "away"})
    };
    let waiting = result(server, &case, &named("P-9")).await;
    assert_eq!(waiting.status, 202, "{waiting:?}");
    // The PACS says whose study it is.
    let known = identified_case(&neighbour).await;
    let own = server.get(&format!("{known}/dicom")).await.json();
    let own = own["attributes"]["PatientID"].as_str().unwrap();
    assert_eq!(result(server, &case, &named(own)).await.status, 202);
    let refused = result(server, &case, &named("P-9")).await;
    assert_eq!(refused.problem(), "several-patients", "{refused:?}");
    let background = pacs::start_transfers(server.pacs.clone());
    let id = waiting.json()["id"].as_str().unwrap().to_owned();
    let failed = ended(server, &format!("/v1/dicom-results/{id}")).await;
    background.shut_down(Duration::from_secs(5)).await;
    assert_eq!(failed["reason"]["name"], "several-patients", "{failed}");
}

#[tokio::test]
async fn an_annotated_picture_states_that_its_case_was_moved() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let pictures = async || {
        let mut pictures = Vec::new();
        for annotate in [false, true] {
            let address = format!("{case}/render?width=640&height=480&annotate={annotate}");
            let picture = server.get(&address).await;
            pictures.push((picture.header("etag").to_owned(), picture.body));
        }
        pictures
    };
    let before = pictures().await;
    assert_eq!(neighbour.store(&mirrored_head(0, &[])).await.status, 202);
    case_after(&neighbour, &case).await;
    assert_eq!(superseded(server, &case).await, "moved");
    let after = pictures().await;
    assert_eq!(before[0], after[0]);
    assert_ne!(before[1].0, after[1].0);
    assert_ne!(before[1].1, after[1].1);
}

#[tokio::test]
async fn a_picture_that_was_corrected_does_not_come_back_when_the_correction_is_deleted() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let before = identified_case(&neighbour).await;
    let darker = identified(&darker_slices());
    assert_eq!(neighbour.store(&darker).await.status, 202);
    let after = case_after(&neighbour, &before).await;
    assert_eq!(superseded(server, &before).await, "newer-version");
    let deleted = Request::delete(&after).body(Body::empty()).unwrap();
    assert_eq!(server.send(deleted).await.status, 204);
    let found = launched(&neighbour).await;
    assert_eq!(found["state"], "absent", "{found}");
}

#[tokio::test]
async fn one_image_of_another_patient_removes_the_layer_of_images_that_are_forgotten() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = flair_slices(0);
    assert_eq!(neighbour.store(&identified(&flair)).await.status, 200);
    until_layer(server, "1.2.3.77").await;
    let store = server.pacs.cases().store().clone();
    store.forget(Duration::ZERO).await.unwrap();
    assert_eq!(flairs(server, &case).await, 1);
    let one = of_another(&flair[3..4]);
    assert_eq!(neighbour.store(&one).await.status, 200);
    assert_eq!(neighbour.settled().await["state"], "nothing");
    assert_eq!(flairs(server, &case).await, 0);
}

#[tokio::test]
async fn a_layer_of_a_user_goes_when_the_pacs_sends_its_images_as_another_patients() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = flair_slices(0);
    let added = add_layer(server, &case, &identified(&flair)).await;
    assert_eq!(added.status, 202, "{added:?}");
    assert_eq!(flairs(server, &case).await, 1);
    assert_eq!(neighbour.store(&of_another(&flair)).await.status, 200);
    until("the layer is removed", async || {
        (flairs(server, &case).await == 0).then_some(())
    })
    .await;
}

#[tokio::test]
async fn a_layer_does_not_stay_on_a_head_that_was_corrected_to_another_patient() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = identified(&flair_slices(0));
    assert_eq!(neighbour.store(&flair).await.status, 200);
    until_layer(server, "1.2.3.77").await;
    assert_eq!(flairs(server, &case).await, 1);
    assert_eq!(
        neighbour.store(&of_another(&head_slices())).await.status,
        202
    );
    until("the head is another patient's", async || {
        let arrival = arrival_of(server, "1.2.3.1").await;
        (arrival["state"] == "case" && !case.ends_with(arrival["case"].as_str()?)).then_some(())
    })
    .await;
    assert_eq!(flairs(server, &case).await, 0);
    until("the FLAIR is no layer", async || {
        let arrival = arrival_of(server, "1.2.3.77").await;
        (arrival["reason"]["name"] == "series-not-t1").then_some(())
    })
    .await;
}

#[tokio::test]
async fn one_image_of_another_patient_stops_the_case_of_images_that_are_forgotten() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let store = server.pacs.cases().store().clone();
    store.forget(Duration::ZERO).await.unwrap();
    let middle = head_slices()[20].clone();
    assert_eq!(neighbour.store(&of_another(&[middle])).await.status, 200);
    assert_eq!(neighbour.settled().await["state"], "nothing");
    assert_eq!(superseded(server, &case).await, "corrected");
    let view = json!({"what": "view", "render": small()});
    assert_eq!(result(server, &case, &view).await.problem(), "superseded");
    let found = launched(&neighbour).await;
    assert_eq!(found["case"], Value::Null, "{found}");
}

#[tokio::test]
async fn a_rejected_series_does_not_speak_for_a_patient_that_was_corrected() {
    let neighbour = Neighbour::start(|_| {}).await;
    let first = identified_case(&neighbour).await;
    assert_eq!(
        neighbour.store(&of_another(&head_slices())).await.status,
        202
    );
    let second = case_after(&neighbour, &first).await;
    assert_eq!(neighbour.store(&identified_head()).await.status, 202);
    assert_eq!(case_after(&neighbour, &second).await, first);
    let rejection = note(KeyObjectTitle::RejectedForSafety);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    assert_eq!(neighbour.store(&other_t1()).await.status, 200);
    let next = case_of_a_link(&neighbour).await;
    assert_ne!(next, first);
}

#[tokio::test]
async fn a_known_image_of_another_class_is_answered_with_a_warning() {
    let neighbour = Neighbour::start(|_| {}).await;
    let lines = Lines::default();
    let _logging = lines.collect();
    let case = identified_case(&neighbour).await;
    let middle = head_slices()[20].clone();
    for (class, superseding) in [
        ("1.2.840.10008.5.1.4.1.1.7", false),
        ("1.2.840.10008.5.1.4.1.1.2", true),
    ] {
        let other = Slice {
            sop_class: class,
            ..middle.clone()
        };
        let stored = neighbour.store(&identified(&[other])).await;
        assert_eq!(
            (stored.status.as_u16(), warnings(&stored)),
            (202, vec![0xB000]),
            "{class}"
        );
        let arrival = arrival_of(&neighbour.server, "1.2.3.1").await;
        assert_eq!(arrival["superseded"], usize::from(superseding), "{class}");
        assert_eq!(arrival["instances"], head_slices().len());
    }
    assert_eq!(superseded(&neighbour.server, &case).await, "newer-version");
}

#[tokio::test]
async fn the_method_of_a_version_is_chosen_for_the_whole_series() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    // Of the first part, the background is not empty.
    let noisy = |slice: &Slice| Slice {
        samples: slice.samples.iter().map(|value| value + 1).collect(),
        ..slice.clone()
    };
    let noisy: Vec<_> = head_slices().iter().map(noisy).collect();
    assert_eq!(neighbour.store(&identified(&noisy)).await.status, 200);
    let first = neighbour.settled().await;
    assert_eq!(first["state"], "case", "{first}");
    let first = format!("/v1/cases/{}", first["case"].as_str().unwrap());
    assert_eq!(neighbour.store(&identified_head()).await.status, 202);
    let next = case_after(&neighbour, &first).await;
    let method = server.get(&next).await.json()["quality"]["method"].clone();
    assert_eq!(method, "volume");
}
