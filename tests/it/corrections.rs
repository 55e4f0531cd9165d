//! A PACS corrects and rejects images: what was made of them is closed.

use std::time::Duration;

use axum::http::{Method, Request};
use imaging::dicom::Attributes;
use imaging::dicom::write::{Head, KeyObjectTitle, Listed, key_object};
use serde_json::{Value, json};
use storage::upkeep::Removal;

use crate::dicom::{head_slices, zipped};
use crate::head::plain_head;
use crate::maps::{settled, until_maps};
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
        found["case"]
            .as_str()
            .map(|case| format!("/v1/cases/{case}"))
    })
    .await;
    neighbour.server.until_ready(&case).await;
    case
}

/// Whether a link to the study opens a case.
async fn is_found(neighbour: &Neighbour) -> bool {
    launched(neighbour).await["case"].is_string()
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

/// Why a case is closed: by its own address, by the list, and by the header of whatever shows it.
async fn closed(server: &Server, case: &str) -> Value {
    let answer = server.get(case).await;
    let alone = answer.json();
    let list = server.get("/v1/cases").await.json();
    let mut listed = list["cases"].as_array().unwrap().iter();
    let listed = listed.find(|each| each["id"] == alone["id"]).unwrap();
    assert_eq!(alone["closed"], listed["closed"]);
    let findings = server.get(&format!("{case}/findings")).await;
    let events = server.get(&format!("{case}/events")).await;
    for answer in [answer, findings, events] {
        let header = answer.header("x-isocortex-closed");
        assert_eq!(header, alone["closed"].as_str().unwrap_or_default());
    }
    alone["closed"].clone()
}

/// Asks for a small view of a case, for a node or as the answer, perhaps with a layer.
fn view(node: Option<&str>, layer: Option<&Value>) -> Value {
    let mut render = small();
    if let Some(layer) = layer {
        render["layer"] = layer.clone();
    }
    json!({"what": "view", "render": render, "node": node})
}

/// The type of the problem with which a view is refused, all of which are conflicts.
async fn refusal(server: &Server, case: &str) -> String {
    let refused = result(server, case, &view(None, None)).await;
    assert_eq!(refused.status, 409, "{refused:?}");
    refused.problem()
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

/// Why each of these results, which wait, is never sent.
async fn never_sent(server: &Server, waiting: &[Value]) -> Vec<Value> {
    let background = pacs::start_transfers(server.pacs.clone());
    let mut reasons = Vec::new();
    for waiting in waiting {
        let address = format!("/v1/dicom-results/{}", waiting["id"].as_str().unwrap());
        let failed = ended(server, &address).await;
        assert_eq!(failed["state"], "failed", "{failed}");
        reasons.push(failed["reason"]["name"].clone());
    }
    background.shut_down(Duration::from_secs(5)).await;
    reasons
}

async fn with_node() -> Neighbour {
    Neighbour::start(|config| add_node(config, "away", "http://127.0.0.1:1/rs".to_owned())).await
}

/// The files of slices of the patient of [`identified_head`].
fn identified(slices: &[Slice]) -> Vec<Vec<u8>> {
    let identified = slices.iter().map(|slice| with_texts(slice, &IDENTITY));
    identified.collect()
}

/// The head with half the brightness.
fn darker_slices() -> Vec<Slice> {
    let darker = |slice: &Slice| Slice {
        samples: slice.samples.iter().map(|sample| sample / 2).collect(),
        ..slice.clone()
    };
    head_slices().iter().map(darker).collect()
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

/// The arrival of a series.
async fn arrival_of(server: &Server, series: &str) -> Value {
    let list = server.get("/v1/arrivals").await.json();
    let mut arrivals = list["arrivals"].as_array().unwrap().iter();
    let found = arrivals.find(|each| each["series"] == series);
    found.cloned().unwrap_or_default()
}

/// The arrival of a series once it was read.
async fn read(neighbour: &Neighbour, series: &str) -> Value {
    neighbour.all_has_come();
    until(&format!("{series} is read"), async || {
        let arrival = arrival_of(&neighbour.server, series).await;
        let is_read = arrival["state"].is_string() && arrival["state"] != "receiving";
        is_read.then_some(arrival)
    })
    .await
}

/// The series of the head.
const SERIES: &str = "1.2.3.1";

/// A series of the same study that is a layer of the head.
const FLAIR: &str = "1.2.3.77";

fn flair_slices() -> Vec<Slice> {
    let of = |slice: Slice| Slice {
        description: "FLAIR",
        sop_uid: format!("{FLAIR}.{}", slice.instance),
        series_uid: FLAIR.to_owned(),
        series_number: 7,
        ..slice
    };
    head_slices().into_iter().map(of).collect()
}

/// The files of a FLAIR of the patient of [`identified_head`] in another study.
fn flair_of_study(study: &str, patient: &str) -> Vec<Vec<u8>> {
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
    flair_slices().iter().map(file).collect()
}

/// The images of the head under other UIDs in the same study.
fn renamed(slices: &[Slice], series: &str, further: &[([u16; 2], &str, &str)]) -> Vec<Vec<u8>> {
    let file = |slice: &Slice| {
        let sop = format!("1.2.3.45.{}", slice.instance);
        let texts = [
            ([0x08, 0x18], "UI", sop.as_str()),
            ([0x20, 0x0E], "UI", series),
        ];
        with_texts(slice, &[&IDENTITY[..], &texts, further].concat())
    };
    slices.iter().map(file).collect()
}

/// The FLAIR among the layers of a case, beside the maps, with whether the list has a map of it.
async fn flairs(server: &Server, case: &str) -> (Vec<Value>, bool) {
    let list = server.get(&format!("{case}/layers")).await.json();
    let layers = list["layers"].as_array().unwrap();
    let is_flair = |layer: &&Value| layer["name"].as_str().unwrap().starts_with("FLAIR");
    let flairs = layers.iter().filter(is_flair).cloned().collect();
    (flairs, layers.iter().any(|layer| layer["id"] == "flair"))
}

/// The id of the newest FLAIR of a case, once so many are there and it is ready.
async fn ready_flair(server: &Server, case: &str, count: usize) -> Value {
    until("the layer is ready", async || {
        let (flairs, _) = flairs(server, case).await;
        let newest = flairs.last().filter(|_| flairs.len() == count)?;
        (newest["state"] == "ready").then(|| newest["id"].clone())
    })
    .await
}

/// Adds the files of a volume to a case as a layer.
async fn add_layer(server: &Server, case: &str, files: &[Vec<u8>]) -> Answer {
    let form = form(&[("volume", &zipped(files))]);
    let request = axum::http::Request::post(format!("{case}/layers"))
        .header("content-type", form_type())
        .body(form.into());
    server.send(request.unwrap()).await
}

/// Takes a queued result as sent.
async fn sent(server: &Server) {
    let store = server.pacs.cases().store();
    let send = case::JobKind::new("send", "delivery");
    let leased = store.claim(send, 3).await.unwrap().expect("a result");
    assert!(store.finish(&leased, Ok(())).await.unwrap());
}

#[tokio::test]
async fn a_corrected_patient_closes_the_case_and_nothing_more_of_it_is_sent() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = with_node().await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    let old = other_mask(server, &first).await;
    crate::findings::mark(server, &old).await;
    let report = result(server, &old, &json!({"what": "findings"})).await;
    assert_eq!(report.status, 200, "{report:?}");
    let waiting = result(server, &old, &view(Some("away"), None)).await;
    assert_eq!(waiting.status, 202, "{waiting:?}");
    let waiting = waiting.json();
    assert_eq!(closed(server, &old).await, Value::Null);
    let corrected = corrected_head();
    let stored = neighbour.store(&corrected).await;
    assert_eq!(stored.status, 202, "{stored:?}");
    assert_eq!(warnings(&stored), vec![0xB000; corrected.len()]);
    // From now on, neither version is opened or sent anywhere, even if there is no new case yet.
    for case in [&first, &old] {
        assert_eq!(closed(server, case).await, "corrected");
        assert_eq!(refusal(server, case).await, "closed");
    }
    let found = launched(&neighbour).await;
    let found = found["case"].as_str().unwrap_or("none");
    assert!(!old.ends_with(found) && !first.ends_with(found));
    // Nor is what waits already: its node may answer again at any time.
    assert_eq!(
        never_sent(server, std::slice::from_ref(&waiting)).await,
        ["closed"]
    );
    // What was sent is withdrawn by a note of the old patient; images of the PACS are not ours to withdraw.
    let withdraw = |uid: &Value| {
        let list = json!({"instances": [uid], "title": "rejected-for-safety"});
        json!({"what": "key-object", "key_object": list})
    };
    let note = result(server, &old, &withdraw(&waiting["instance"])).await;
    assert_eq!(note.status, 200, "{note:?}");
    let has = |text: &str| memchr::memmem::find(&note.body, text.as_bytes()).is_some();
    assert!(has("113037") && has("P-77") && has(waiting["instance"].as_str().unwrap()));
    let refused = result(server, &old, &withdraw(&json!("1.2.3.4.20"))).await;
    assert_eq!(refused.problem(), "no-such-instance");
    // The same correction again changes nothing.
    assert_eq!(neighbour.store(&corrected).await.status, 200);
    let new = case_of_a_link(&neighbour).await;
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["corrected"], corrected.len());
    // Nothing is inherited: neither parameters nor findings, nor are they taken from a report.
    assert_eq!(closed(server, &new).await, Value::Null);
    assert_eq!(closed(server, &old).await, "corrected");
    let [first, case] = [
        server.get(&first).await.json(),
        server.get(&new).await.json(),
    ];
    assert_eq!(case["previous"], Value::Null);
    assert_eq!(case["parameters"], first["parameters"]);
    assert_eq!(findings_of(server, &new).await, json!([]));
    let refused = put_report(server, &new, &report.body).await;
    assert_eq!(refused.problem(), "findings-elsewhere");
    let made = result(server, &new, &view(None, None)).await;
    let has = |text: &str| memchr::memmem::find(&made.body, text.as_bytes()).is_some();
    assert!(has("PAT-RIGHT") && !has("P-77"));
    // One line for the request, which names nobody.
    let text = lines.text();
    assert_eq!(text.matches("have come with other contents").count(), 1);
    assert!(!text.contains("PAT-RIGHT") && !text.contains("Right^Patient"));
}

#[tokio::test]
async fn other_pixels_close_the_case_and_another_encoding_is_the_same_image() {
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
    let upload = server.prepared(&[("volume", &zipped(&sound))]).await;
    assert_eq!(upload, first);
    for syntax in [Syntax::Implicit, Syntax::BigEndian, Syntax::Rle] {
        let again = neighbour.store(&files(&slices[..3], syntax)).await;
        assert_eq!(
            (again.status.as_u16(), warnings(&again)),
            (200, vec![]),
            "{syntax:?}"
        );
    }
    assert_eq!(neighbour.settled().await["case"], arrival["case"]);
    assert_eq!(closed(server, &first).await, Value::Null);
    let darker = files(&darker_slices(), Syntax::Explicit);
    assert_eq!(neighbour.store(&darker).await.status, 202);
    assert_eq!(closed(server, &first).await, "corrected");
    let second = case_after(&neighbour, &first).await;
    assert_eq!(server.get(&second).await.json()["previous"], Value::Null);
    assert_eq!(case_of_a_link(&neighbour).await, second);
    // If the correction is taken back, the first case is open again, although it is the older one.
    assert_eq!(neighbour.store(&sound).await.status, 202);
    assert_eq!(case_after(&neighbour, &second).await, first);
    assert_eq!(closed(server, &first).await, Value::Null);
    assert_eq!(closed(server, &second).await, "corrected");
    assert_eq!(case_of_a_link(&neighbour).await, first);
    // What was corrected does not come back when the correction is deleted.
    assert_eq!(neighbour.store(&darker).await.status, 202);
    assert_eq!(case_after(&neighbour, &first).await, second);
    assert_eq!(server.method(Method::DELETE, &second).await.status, 204);
    assert_eq!(closed(server, &first).await, "corrected");
    assert_eq!(launched(&neighbour).await["state"], "absent");
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
        (&of(SERIES)["corrected"], &of(SERIES)["ignored"]),
        (&json!(1), &json!(0))
    );
    // So is a known image that comes as an object of a class of which nothing is kept.
    let capture = Slice {
        sop_class: "1.2.840.10008.5.1.4.1.1.7",
        ..head_slices().remove(0)
    };
    let stored = neighbour.store(&identified(&[capture])).await;
    assert_eq!(
        (stored.status.as_u16(), warnings(&stored)),
        (202, vec![0xB000])
    );
    let arrival = arrival_of(&neighbour.server, SERIES).await;
    assert_eq!(
        (&arrival["corrected"], &arrival["instances"]),
        (&json!(1), &json!(1))
    );
}

#[tokio::test]
async fn what_is_closed_says_so_wherever_it_is_shown() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    until_maps(server, &case).await;
    let pictures = async || {
        let mut pictures = Vec::new();
        for annotate in [false, true] {
            let address = format!("{case}/render?width=640&height=480&annotate={annotate}");
            let picture = server.get(&address).await;
            assert_eq!(picture.status, 200, "{picture:?}");
            let header = picture.header("x-isocortex-closed").to_owned();
            pictures.push((picture.header("etag").to_owned(), picture.body, header));
        }
        pictures
    };
    let written = async |name: &str, language: &str| {
        let file = server
            .get(&format!("{case}/{name}?language={language}"))
            .await;
        let text = String::from_utf8_lossy(&file.body).into_owned();
        (file.header("x-isocortex-closed").to_owned(), text)
    };
    let open = pictures().await;
    let (header, text) = written("report", "en").await;
    assert!(header.is_empty() && !text.contains("CLOSED"));
    let slices = head_slices();
    let moved = identified(&[exchanged(&slices[3])]);
    let rejection = note_of(
        KeyObjectTitle::RejectedForQuality,
        std::slice::from_ref(&slices[0].sop_uid),
    );
    let mut shown = vec![open];
    for (file, why, [english, portuguese]) in [
        (
            rejection,
            "rejected",
            ["has rejected these images", "rejeitou"],
        ),
        (
            moved.concat(),
            "corrected",
            ["has sent other images", "enviou outras imagens"],
        ),
    ] {
        assert!(neighbour.store(&[file]).await.status.is_success());
        assert_eq!(closed(server, &case).await, why);
        let now = pictures().await;
        let [before, ..] = &shown[..] else {
            panic!("it was shown")
        };
        // The picture itself stays as it is.
        assert_eq!((&before[0].0, &before[0].1), (&now[0].0, &now[0].1));
        for before in &shown {
            assert_ne!(before[1].0, now[1].0);
            assert_ne!(before[1].1, now[1].1);
        }
        assert!(now.iter().all(|(_, _, header)| header == why));
        shown.push(now);
        for (language, words) in [
            ("en", ["CLOSED:", english]),
            ("pt-BR", ["ENCERRADO:", portuguese]),
        ] {
            for name in ["report", "share"] {
                let (header, text) = written(name, language).await;
                assert_eq!(header, why, "{name}");
                assert!(words.iter().all(|word| text.contains(word)), "{words:?}");
            }
        }
    }
}

#[tokio::test]
async fn a_partial_correction_says_how_much_came_again_and_can_be_taken() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    let darker = identified(&darker_slices());
    let count = darker.len();
    // One image is corrected, one is rejected, and one comes again as it was.
    assert_eq!(neighbour.store(&darker[20..21]).await.status, 202);
    let uid = head_slices()[count - 1].sop_uid.clone();
    let rejection = note_of(KeyObjectTitle::RejectedForQuality, &[uid]);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    assert_eq!(
        neighbour.store(&identified_head()[22..23]).await.status,
        200
    );
    let is_incomplete = async |again: usize| {
        let arrival = read(&neighbour, SERIES).await;
        assert_eq!(
            (&arrival["state"], &arrival["reason"]["name"]),
            (&json!("nothing"), &json!("incomplete-correction")),
            "{arrival}"
        );
        let detail = arrival["reason"]["detail"].as_str().unwrap();
        let words = format!("{again} of its {count} images came again");
        assert!(
            detail.contains(&words) && detail.contains("send the whole series"),
            "{detail}"
        );
        assert!(!is_found(&neighbour).await);
        arrival
    };
    is_incomplete(3).await;
    assert_eq!(neighbour.store(&darker[23..24]).await.status, 202);
    let arrival = is_incomplete(4).await;
    // Somebody takes what is here.
    let address = format!("/v1/arrivals/{}", arrival["id"].as_str().unwrap());
    let take = Request::post(&address).body(r#"{"as": "case"}"#.into());
    let taken = server.send(take.unwrap()).await;
    assert_eq!(taken.status, 202, "{taken:?}");
    let second = case_of_a_link(&neighbour).await;
    assert_ne!(first, second);
    let case = server.get(&second).await.json();
    assert_eq!(
        (&case["previous"], &case["closed"]),
        (&Value::Null, &Value::Null)
    );
    let known = server.get(&format!("{second}/dicom")).await.json();
    assert_eq!(known["instances"].as_array().unwrap().len(), count - 1);
    // The rest of the correction closes that one, too, and is a case without being taken.
    assert_eq!(neighbour.store(&darker).await.status, 202);
    assert_eq!(closed(server, &second).await, "corrected");
    let third = read(&neighbour, SERIES).await;
    let case = third["case"].as_str().unwrap();
    assert!(!first.ends_with(case) && !second.ends_with(case));
}

#[tokio::test]
async fn a_rejection_note_closes_keeps_and_is_lifted() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let count = head_slices().len();
    // The title "Of Interest" (113000) in place of a reason.
    let mut list = note(KeyObjectTitle::RetentionExpired);
    let at = memchr::memmem::find(&list, b"113039").unwrap();
    list[at..at + 6].copy_from_slice(b"113000");
    let stored = neighbour.store(&[list]).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    assert_eq!(closed(server, &case).await, Value::Null);
    let none = server.get("/v1/rejections").await.json();
    assert_eq!(none, json!({"rejections": []}));
    let rejection = note(KeyObjectTitle::RejectedForQuality);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    assert!(!is_found(&neighbour).await);
    assert_eq!(refusal(server, &case).await, "closed");
    assert_eq!(closed(server, &case).await, "rejected");
    // The images are kept and not read, also if they come again, and whoever takes them takes nothing.
    let is_kept = async || {
        let arrival = read(&neighbour, SERIES).await;
        assert_eq!(
            (
                &arrival["state"],
                &arrival["reason"]["name"],
                &arrival["instances"]
            ),
            (&json!("nothing"), &json!("rejected"), &json!(count))
        );
        arrival
    };
    is_kept().await;
    assert_eq!(neighbour.store(&identified_head()).await.status, 200);
    let arrival = is_kept().await;
    let address = format!("/v1/arrivals/{}", arrival["id"].as_str().unwrap());
    let take = Request::post(&address).body(r#"{"as": "case"}"#.into());
    assert_eq!(server.send(take.unwrap()).await.status, 202);
    is_kept().await;
    // It is listed, and whoever may lifts it.
    let list = server.get("/v1/rejections").await.json();
    let [listed] = &list["rejections"].as_array().unwrap()[..] else {
        panic!("one note came: {list}");
    };
    assert_eq!(
        (
            &listed["study"],
            &listed["series"],
            &listed["images"],
            &listed["may_return"]
        ),
        (
            &json!("1.2.3"),
            &json!(SERIES),
            &json!(count),
            &json!(false)
        )
    );
    assert!(!listed["by"].as_str().unwrap().is_empty() && listed["at"].is_string());
    let address = format!("/v1/rejections/{}", listed["id"].as_str().unwrap());
    assert_eq!(server.method(Method::DELETE, &address).await.status, 204);
    let again = server.method(Method::DELETE, &address).await;
    assert_eq!(
        (again.status.as_u16(), again.problem().as_str()),
        (404, "no-such-rejection")
    );
    assert_eq!(closed(server, &case).await, Value::Null);
    assert_eq!(case_of_a_link(&neighbour).await, case);
    let arrival = read(&neighbour, SERIES).await;
    assert!(
        case.ends_with(arrival["case"].as_str().unwrap()),
        "{arrival}"
    );
    assert_eq!(result(server, &case, &view(None, None)).await.status, 200);
}

#[tokio::test]
async fn what_was_kept_long_enough_counts_when_it_comes_again() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let other_mask = other_mask(server, &case).await;
    let uids: Vec<_> = head_slices()
        .into_iter()
        .map(|slice| slice.sop_uid)
        .collect();
    let half = uids.len() / 2;
    let head = identified_head();
    for images in [..uids.len(), ..half] {
        let rejection = note_of(KeyObjectTitle::RetentionExpired, &uids[images]);
        assert_eq!(neighbour.store(&[rejection]).await.status, 200);
        for version in [&case, &other_mask] {
            assert_eq!(closed(server, version).await, "rejected");
        }
        assert!(!is_found(&neighbour).await);
        assert_eq!(read(&neighbour, SERIES).await["state"], "nothing");
        assert_eq!(neighbour.store(&head[images]).await.status, 200);
        for version in [&case, &other_mask] {
            assert_eq!(closed(server, version).await, Value::Null);
        }
        // Its newest version, as before.
        assert_eq!(case_of_a_link(&neighbour).await, other_mask);
        neighbour.all_has_come();
        until("the series is a case again", async || {
            let arrival = arrival_of(server, SERIES).await;
            (arrival["state"] == "case").then_some(())
        })
        .await;
    }
}

#[tokio::test]
async fn an_image_that_comes_under_another_study_closes_the_case_of_its_own() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    crate::findings::mark(server, &case).await;
    let study = [
        ([0x20, 0x000D], "UI", "1.2.30"),
        ([0x20, 0x000E], "UI", "1.2.30.1"),
    ];
    let texts = [&IDENTITY[..], &study].concat();
    let moved: Vec<_> = (head_slices().iter())
        .map(|slice| with_texts(slice, &texts))
        .collect();
    let stored = neighbour.store(&moved).await;
    assert_eq!(
        (stored.status.as_u16(), warnings(&stored)),
        (202, vec![0xB000; moved.len()])
    );
    assert!(!is_found(&neighbour).await);
    assert_eq!(refusal(server, &case).await, "closed");
    assert_eq!(closed(server, &case).await, "corrected");
    let old = arrival_of(server, SERIES).await;
    assert_eq!(
        (&old["state"], &old["reason"]["name"], &old["instances"]),
        (&json!("nothing"), &json!("moved"), &json!(0))
    );
    let new = read(&neighbour, "1.2.30.1").await;
    assert_eq!(new["state"], "case", "{new}");
    let new = format!("/v1/cases/{}", new["case"].as_str().unwrap());
    server.until_ready(&new).await;
    assert_eq!(findings_of(server, &new).await, json!([]));
}

#[tokio::test]
async fn a_closed_layer_is_listed_and_neither_drawn_nor_sent_and_has_no_map() {
    let neighbour = with_node().await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = identified(&flair_slices());
    assert_eq!(neighbour.store(&flair).await.status, 200);
    let layer = ready_flair(server, &case, 1).await;
    let mut results = Vec::new();
    for shown in [None, Some(&layer)] {
        let queued = result(server, &case, &view(Some("away"), shown)).await;
        assert_eq!(queued.status, 202, "{queued:?}");
        results.push(queued.json()["instance"].clone());
        sent(server).await;
    }
    let mut later = view(Some("away"), Some(&layer));
    later["render"]["depth_mm"] = json!(6);
    let waiting = result(server, &case, &later).await.json();
    let not_valid = async || {
        let id = case.rsplit('/').next().unwrap();
        let list = server
            .get(&format!("/v1/dicom-results?case={id}"))
            .await
            .json();
        let list = list["results"].as_array().unwrap().clone();
        let of = |uid: &Value| {
            let result = list.iter().find(|result| result["instance"] == *uid);
            result.unwrap()["not_valid"].clone()
        };
        [of(&results[0]), of(&results[1])]
    };
    let drawn = format!(
        "{case}/render?width=64&height=48&layer={}",
        layer.as_str().unwrap()
    );
    let places = format!("{case}/candidates?map=flair");
    assert_eq!(server.get(&drawn).await.status, 200);
    let before = settled(server, &places).await;
    assert_eq!(not_valid().await, [Value::Null, Value::Null]);
    assert!(flairs(server, &case).await.1, "a FLAIR has a map");
    // The FLAIR was another patient's, from its first image on.
    let corrected = of_another(&flair_slices());
    assert_eq!(neighbour.store(&corrected[..1]).await.status, 202);
    let (listed, has_map) = flairs(server, &case).await;
    assert_eq!(
        (listed.len(), &listed[0]["closed"], has_map),
        (1, &json!("corrected"), false)
    );
    let refused = server.get(&drawn).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "closed")
    );
    let no_places = settled(server, &places).await;
    assert_eq!(no_places.status, 409, "{no_places:?}");
    assert_ne!(no_places.body, before.body);
    let detail = no_places.json().to_string();
    assert!(
        detail.contains("no layer of this case is a FLAIR"),
        "{detail}"
    );
    let refused = result(server, &case, &view(None, Some(&layer))).await;
    assert_eq!(refused.problem(), "closed");
    // What shows the head alone stays valid; what shows the layer is withdrawn by a note.
    assert_eq!(closed(server, &case).await, Value::Null);
    assert_eq!(not_valid().await, [Value::Null, json!("closed")]);
    assert_eq!(never_sent(server, &[waiting]).await, ["closed"]);
    // The report does not show it, and is sent.
    let report = json!({"what": "report", "node": "away"});
    let report = result(server, &case, &report).await;
    assert_eq!(report.status, 202, "{report:?}");
    assert_eq!(report.json()["not_valid"], Value::Null);
    sent(server).await;
    let note = json!({"what": "key-object", "node": "away",
        "key_object": {"instances": [results[1]], "title": "rejected-for-safety"}});
    let noted = result(server, &case, &note).await;
    assert_eq!(noted.status, 202, "{noted:?}");
    assert_eq!(not_valid().await, [Value::Null, json!("withdrawn")]);
    // All of it is another patient's: it is a layer of nothing. When that is taken back, the layer is open again.
    assert_eq!(neighbour.store(&corrected[1..]).await.status, 202);
    assert_eq!(read(&neighbour, FLAIR).await["state"], "nothing");
    assert_eq!(neighbour.store(&flair).await.status, 202);
    assert_eq!(read(&neighbour, FLAIR).await["state"], "layer");
    let (listed, _) = flairs(server, &case).await;
    assert_eq!((listed.len(), &listed[0]["closed"]), (1, &Value::Null));
    assert_eq!(server.get(&drawn).await.status, 200);
    // A note closes it, and a lift opens it.
    let uids: Vec<_> = (flair_slices().into_iter())
        .map(|slice| slice.sop_uid)
        .collect();
    let title = KeyObjectTitle::RejectedForSafety;
    let rejection = note_naming(("1.2.3", FLAIR, title, &uids));
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    assert_eq!(flairs(server, &case).await.0[0]["closed"], "rejected");
    assert_eq!(server.get(&drawn).await.problem(), "closed");
    let list = server.get("/v1/rejections").await.json();
    let rejections = list["rejections"].as_array().unwrap().iter();
    let mut of_flair = rejections.filter(|each| each["series"] == FLAIR);
    let id = of_flair.next().unwrap()["id"].as_str().unwrap().to_owned();
    let lifted = server
        .method(Method::DELETE, &format!("/v1/rejections/{id}"))
        .await;
    assert_eq!(lifted.status, 204);
    assert_eq!(server.get(&drawn).await.status, 200);
}

#[tokio::test]
async fn a_series_that_was_a_layer_is_read_again_for_the_head_of_its_patient() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let first = identified_case(&neighbour).await;
    assert_eq!(
        neighbour.store(&identified(&flair_slices())).await.status,
        200
    );
    ready_flair(server, &first, 1).await;
    let layer_of = async |case: &str| {
        until("the FLAIR is a layer of the other head", async || {
            let arrival = arrival_of(server, FLAIR).await;
            let is_layer = arrival["state"] == "layer";
            (is_layer && case.ends_with(arrival["case"].as_str()?)).then_some(())
        })
        .await;
    };
    assert_eq!(
        neighbour.store(&identified(&darker_slices())).await.status,
        202
    );
    let second = case_of_a_link(&neighbour).await;
    neighbour.all_has_come();
    layer_of(&second).await;
    ready_flair(server, &second, 1).await;
    // The layer of the closed case is as it was.
    assert_eq!(flairs(server, &first).await.0[0]["closed"], Value::Null);
    // There is no head any more, then another series.
    let rejection = note(KeyObjectTitle::RejectedForQuality);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    let refused = read(&neighbour, FLAIR).await;
    assert_eq!(refused["reason"]["name"], "series-not-t1", "{refused}");
    let other = renamed(&darker_slices(), "1.2.3.66", &[]);
    assert_eq!(neighbour.store(&other).await.status, 200);
    let third = case_of_a_link(&neighbour).await;
    assert!(third != first && third != second);
    neighbour.all_has_come();
    layer_of(&third).await;
    // That one was another patient's, and the FLAIR is not.
    let right = [
        ([0x10, 0x0010], "PN", "Right^Patient"),
        ([0x10, 0x0020], "LO", "PAT-RIGHT"),
    ];
    let corrected = renamed(&darker_slices(), "1.2.3.66", &right);
    assert_eq!(neighbour.store(&corrected).await.status, 202);
    let fourth = read(&neighbour, "1.2.3.66").await;
    assert_eq!(fourth["state"], "case", "{fourth}");
    let fourth = format!("/v1/cases/{}", fourth["case"].as_str().unwrap());
    let refused = read(&neighbour, FLAIR).await;
    assert_eq!(refused["reason"]["name"], "series-not-t1", "{refused}");
    assert_eq!(flairs(server, &fourth).await.0, [] as [Value; 0]);
}

#[tokio::test]
async fn a_layer_that_a_user_added_is_closed_as_any_other() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let reasons = async || -> Vec<Value> {
        let (flairs, _) = flairs(server, &case).await;
        flairs.iter().map(|layer| layer["closed"].clone()).collect()
    };
    let add = async |files: &[Vec<u8>]| {
        let added = add_layer(server, &case, files).await;
        assert!(added.status.is_success(), "{added:?}");
    };
    // The PACS sends one image for the first time, as another patient's, although it makes nothing of it.
    add(&flair_of_study("1.2.31", "P-77")).await;
    assert_eq!(reasons().await, [Value::Null]);
    let other = flair_of_study("1.2.31", "PAT-RIGHT");
    assert_eq!(neighbour.store(&other[..1]).await.status, 200);
    assert_eq!(reasons().await, [json!("corrected")]);
    // It sends what the user added, and rejects it.
    let same = flair_of_study("1.2.32", "P-77");
    assert_eq!(neighbour.store(&same).await.status, 200);
    add(&same).await;
    assert_eq!(reasons().await, [json!("corrected"), Value::Null]);
    let uids = |study: &str| -> Vec<_> {
        (flair_slices().iter())
            .map(|slice| format!("{study}.1.{}", slice.instance))
            .collect()
    };
    for study in ["1.2.32", "1.2.33"] {
        let series = format!("{study}.1");
        let title = KeyObjectTitle::RejectedForSafety;
        let rejection = note_naming((study, &series, title, &uids(study)));
        assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    }
    assert_eq!(reasons().await, [json!("corrected"), json!("rejected")]);
    // Files from before a correction, and of a series that was rejected before.
    add(&flair_of_study("1.2.33", "P-77")).await;
    assert_eq!(reasons().await[2], "rejected");
    add(&flair_of_study("1.2.31", "P-77")).await;
    assert_eq!(
        reasons().await.iter().filter(|why| why.is_null()).count(),
        0
    );
}

#[tokio::test]
async fn an_upload_is_closed_if_the_pacs_has_sent_its_images_otherwise_or_rejected_them() {
    let neighbour = with_node().await;
    let server = &neighbour.server;
    let upload = async |slices: &[Slice], closing: u32| {
        let volume = zipped(&identified(slices));
        let parameters = json!({"closing_radius_mm": closing}).to_string();
        let parts: [Part<'_>; 2] = [("volume", &volume), ("parameters", parameters.as_bytes())];
        server.prepared(&parts).await
    };
    // No PACS has sent them, so they are open, and results leave.
    let other: Vec<_> = head_slices().iter().map(exchanged).collect();
    let before = upload(&other, 10).await;
    assert_eq!(closed(server, &before).await, Value::Null);
    let waiting = result(server, &before, &view(Some("away"), None)).await;
    assert_eq!(waiting.status, 202, "{waiting:?}");
    // The PACS has exchanged left and right.
    let case = identified_case(&neighbour).await;
    assert_eq!(result(server, &case, &view(None, None)).await.status, 200);
    let after = upload(&other, 9).await;
    for upload in [&before, &after] {
        assert_eq!(closed(server, upload).await, "corrected");
        assert_eq!(refusal(server, upload).await, "closed");
    }
    assert_eq!(never_sent(server, &[waiting.json()]).await, ["closed"]);
    let same = upload(&head_slices(), 9).await;
    assert_eq!(closed(server, &same).await, Value::Null);
    let rejection = note(KeyObjectTitle::RejectedForSafety);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    let later = upload(&head_slices(), 8).await;
    for upload in [&case, &same, &later] {
        assert_eq!(closed(server, upload).await, "rejected");
        assert_eq!(refusal(server, upload).await, "closed");
    }
    assert!(!is_found(&neighbour).await);
}

#[tokio::test]
async fn a_closed_upload_does_not_hold_back_the_series_of_the_pacs() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let head = identified_head();
    let (late, early) = head.split_last().unwrap();
    assert_eq!(neighbour.store(early).await.status, 200);
    let arrival = neighbour.settled().await;
    let first = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&first).await;
    let darker = identified(&darker_slices());
    // Half of the images are those of the PACS.
    let half = early.len() / 2;
    let mixed = [&early[..half], &darker[half..early.len()]].concat();
    let upload = server.prepared(&[("volume", &zipped(&mixed))]).await;
    assert_eq!(closed(server, &upload).await, "corrected");
    assert_eq!(
        neighbour.store(std::slice::from_ref(late)).await.status,
        200
    );
    let arrival = read(&neighbour, SERIES).await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let second = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    let version = server.get(&second).await.json();
    assert!(
        first.ends_with(version["previous"].as_str().unwrap()),
        "{version}"
    );
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
    let arrival = arrival_of(server, SERIES).await;
    assert_eq!(
        (&arrival["state"], &arrival["corrected"]),
        (&json!("case"), &json!(0))
    );
    assert_eq!(closed(server, &case).await, Value::Null);
}

#[tokio::test]
async fn deleting_a_case_keeps_what_was_corrected_since() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let flair = flair_slices();
    assert_eq!(neighbour.store(&identified(&flair)).await.status, 200);
    ready_flair(server, &case, 1).await;
    // The FLAIR was another patient's, and leads to the case of this one no longer.
    assert_eq!(neighbour.store(&of_another(&flair)).await.status, 202);
    let arrival = arrival_of(server, FLAIR).await;
    assert_eq!(arrival["case"], Value::Null, "{arrival}");
    // Every image of the head comes with other pixels, and the user deletes the case that shows the old ones.
    let darker = identified(&darker_slices());
    assert_eq!(neighbour.store(&darker).await.status, 202);
    let deleted = server.method(Method::DELETE, &case).await;
    assert_eq!(deleted.status, 204, "{deleted:?}");
    for series in [FLAIR, SERIES] {
        let arrival = arrival_of(server, series).await;
        assert_eq!(arrival["instances"], flair.len(), "{series}: {arrival}");
    }
    let next = read(&neighbour, SERIES).await;
    assert_eq!(next["state"], "case", "{next}");
    assert!(!case.ends_with(next["case"].as_str().unwrap()));
}

#[tokio::test]
async fn one_image_of_another_patient_closes_the_case_of_images_that_are_forgotten() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    assert_eq!(
        neighbour.store(&identified(&flair_slices())).await.status,
        200
    );
    ready_flair(server, &case, 1).await;
    let store = server.pacs.store().clone();
    store
        .forget(Duration::ZERO, Removal::Confirmed)
        .await
        .unwrap();
    assert_eq!(arrival_of(server, SERIES).await, Value::Null);
    for (slices, series) in [(flair_slices(), FLAIR), (head_slices(), SERIES)] {
        assert_eq!(closed(server, &case).await, Value::Null);
        let one = neighbour.store(&of_another(&slices[20..21])).await;
        assert_eq!((one.status.as_u16(), warnings(&one)), (202, vec![0xB000]));
        assert_eq!(read(&neighbour, series).await["state"], "nothing");
        assert_eq!(flairs(server, &case).await.0[0]["closed"], "corrected");
    }
    assert_eq!(closed(server, &case).await, "corrected");
    assert_eq!(refusal(server, &case).await, "closed");
    assert!(!is_found(&neighbour).await);
}

#[tokio::test]
async fn a_note_may_come_before_its_images_and_counts_in_its_own_study_alone() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let uids: Vec<_> = (head_slices().into_iter())
        .map(|slice| slice.sop_uid)
        .collect();
    let title = KeyObjectTitle::RejectedForQuality;
    let foreign = note_in("1.2.30", title, &uids);
    assert_eq!(
        neighbour.store(std::slice::from_ref(&foreign)).await.status,
        200
    );
    // One image of the head is rejected before it comes, and another one that never comes.
    let own = [uids[0].clone(), "1.2.3.4.9999".to_owned()];
    let own = note_of(KeyObjectTitle::RejectedForSafety, &own);
    assert_eq!(neighbour.store(&[own]).await.status, 200);
    let stored = neighbour.store(&identified_head()).await;
    assert_eq!((stored.status.as_u16(), warnings(&stored)), (200, vec![]));
    let arrival = read(&neighbour, SERIES).await;
    assert_eq!(
        (&arrival["state"], &arrival["instances"]),
        (&json!("case"), &json!(uids.len()))
    );
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&case).await;
    let known = server.get(&format!("{case}/dicom")).await.json();
    assert_eq!(known["instances"].as_array().unwrap().len(), uids.len() - 1);
    assert_eq!(neighbour.store(&[foreign]).await.status, 200);
    assert_eq!(closed(server, &case).await, Value::Null);
    assert_eq!(case_of_a_link(&neighbour).await, case);
}

#[tokio::test]
async fn images_that_were_rejected_do_not_speak_for_the_patient_of_their_series() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    // Of the wrong patient, by an incorrect entry of the worklist; the right images come under new UIDs.
    let wrong = of_another(&head_slices());
    assert_eq!(neighbour.store(&wrong).await.status, 200);
    let first = case_of_a_link(&neighbour).await;
    crate::findings::mark(server, &first).await;
    let rejection = note(KeyObjectTitle::IncorrectWorklistEntry);
    assert_eq!(neighbour.store(&[rejection]).await.status, 200);
    let right = renamed(&head_slices(), SERIES, &[]);
    assert_eq!(neighbour.store(&right).await.status, 200);
    let arrival = read(&neighbour, SERIES).await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let second = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&second).await;
    assert_ne!(first, second);
    assert_eq!(findings_of(server, &second).await, json!([]));
    assert_eq!(server.get(&second).await.json()["previous"], Value::Null);
    let found = launched(&neighbour).await;
    let made = result(server, &second, &view(None, None)).await;
    assert_eq!(
        (&found["state"], made.status.as_u16()),
        (&json!("ready"), 200),
        "{found} {made:?}"
    );
}

#[tokio::test]
async fn a_result_that_was_withdrawn_is_not_drawn_either() {
    let neighbour = with_node().await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let queued = result(server, &case, &view(Some("away"), None))
        .await
        .json();
    assert_eq!(result(server, &case, &view(None, None)).await.status, 200);
    let note = json!({"what": "key-object", "node": "away",
        "key_object": {"instances": [queued["instance"]], "title": "rejected-for-quality"}});
    assert_eq!(result(server, &case, &note).await.status, 202);
    assert_eq!(refusal(server, &case).await, "withdrawn");
}

#[tokio::test]
async fn an_upload_makes_no_results_if_the_pacs_has_its_series_as_another_patients_without_a_case()
{
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let upload = server
        .prepared(&[("volume", &zipped(&identified_head()))])
        .await;
    assert_eq!(result(server, &upload, &view(None, None)).await.status, 200);
    // Under other UIDs than those of the upload.
    let other = [([0x10, 0x0020], "LO", "PAT-RIGHT")];
    let few = renamed(&head_slices()[20..23], SERIES, &other);
    assert_eq!(neighbour.store(&few).await.status, 200);
    assert_eq!(neighbour.settled().await["state"], "nothing");
    assert_eq!(closed(server, &upload).await, Value::Null);
    assert_eq!(refusal(server, &upload).await, "several-patients");
}

#[tokio::test]
async fn a_result_that_names_its_study_is_of_the_patient_of_that_study() {
    let neighbour = with_node().await;
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
    assert_eq!(
        never_sent(server, &[waiting.json()]).await,
        ["several-patients"]
    );
}
