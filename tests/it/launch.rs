//! A link from a PACS opens the head of the right patient, the same one every time, or offers a choice.

use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::dicom::{head_slices, zipped};
use crate::pacs::{Neighbour, with_texts};
use crate::results::{add_node, result, small};
use crate::series_builder::Slice;
use crate::server::{form, form_type};
use crate::until::until;

/// What differs between series of the same head.
pub(crate) struct Series<'a> {
    pub(crate) study: &'a str,
    pub(crate) uid: &'a str,
    pub(crate) texts: &'a [([u16; 2], &'a str, &'a str)],
}

impl Series<'_> {
    fn files(&self) -> Vec<Vec<u8>> {
        self.files_of(self.uid)
    }

    /// Its files, each image with a UID below this one.
    fn files_of(&self, instances: &str) -> Vec<Vec<u8>> {
        let file = |slice: Slice| {
            let sop = format!("{instances}.{}", slice.instance);
            let mut texts = vec![
                ([0x08, 0x18], "UI", sop.as_str()),
                ([0x20, 0x0D], "UI", self.study),
                ([0x20, 0x0E], "UI", self.uid),
            ];
            texts.extend(self.texts);
            with_texts(&slice, &texts)
        };
        head_slices().into_iter().map(file).collect()
    }

    /// Stores it; the case that it becomes, ready.
    pub(crate) async fn becomes(&self, neighbour: &Neighbour) -> String {
        assert_eq!(neighbour.store(&self.files()).await.status, 200);
        neighbour.all_has_come();
        let case = until(&format!("a case comes of {}", self.uid), async || {
            let list = neighbour.server.get("/v1/arrivals").await.json();
            let mut arrivals = list["arrivals"].as_array().unwrap().iter();
            let ours = arrivals.find(|arrival| arrival["series"] == self.uid)?;
            Some(ours["case"].as_str()?.to_owned())
        })
        .await;
        let address = format!("/v1/cases/{case}");
        neighbour.server.until_ready(&address).await;
        case
    }
}

async fn launched(neighbour: &Neighbour, query: &str) -> Value {
    let body = Body::from(json!({ "query": query }).to_string());
    let request = Request::post("/v1/launch").body(body).unwrap();
    let answer = neighbour.server.send(request).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    answer.json()
}

#[tokio::test]
async fn an_accession_number_of_two_patients_opens_neither_and_a_patient_must_agree() {
    let neighbour = Neighbour::start(|_| {}).await;
    let accession = ([0x08, 0x50], "SH", "ACC-1");
    let first = Series {
        study: "1.2.3",
        uid: "1.2.3.4",
        texts: &[
            accession,
            ([0x08, 0x20], "DA", "20261101"),
            ([0x10, 0x20], "LO", "PAT-A"),
        ],
    };
    let first = first.becomes(&neighbour).await;
    let alone = launched(
        &neighbour,
        "?requestType=STUDY&accessionNumber=ACC-1&viewerType=x",
    )
    .await;
    assert_eq!(
        (&alone["state"], &alone["case"]),
        (&json!("ready"), &json!(first))
    );
    assert_eq!(alone["ignored"], json!(["viewertype"]));
    let second = Series {
        study: "1.2.9",
        uid: "1.2.9.4",
        texts: &[
            accession,
            ([0x10, 0x20], "LO", "PAT-Q"),
            ([0x10, 0x21], "LO", "HOSP"),
        ],
    };
    let second = second.becomes(&neighbour).await;
    assert_ne!(first, second);
    let choice = launched(&neighbour, "accessionNumber=ACC-1").await;
    assert_eq!(
        (&choice["state"], &choice["case"]),
        (&json!("choice"), &Value::Null)
    );
    let candidates = choice["candidates"].as_array().unwrap();
    let cases: Vec<_> = candidates
        .iter()
        .map(|each| each["case"].as_str().unwrap())
        .collect();
    assert!(
        cases.len() == 2 && cases.contains(&first.as_str()) && cases.contains(&second.as_str())
    );
    let of_first = candidates
        .iter()
        .find(|each| each["case"] == *first)
        .unwrap();
    assert_eq!(of_first["study_date"], "20261101");
    assert!(
        of_first["series"].as_str().unwrap().contains("t1 mprage"),
        "{of_first}"
    );
    let text = choice.to_string();
    assert!(
        !text.contains("PAT-") && !text.contains("Somebody"),
        "{text}"
    );
    let [first, second] = [json!(first), json!(second)];
    for (query, state, case) in [
        ("accessionNumber=ACC-1&patientID=PAT-A", "ready", &first),
        (
            "accessionNumber=ACC-1&patientID=PAT-Q^^^HOSP",
            "ready",
            &second,
        ),
        ("accessionNumber=ACC-1&issuer=HOSP", "ready", &second),
        (
            "accessionNumber=ACC-1&patientID=PAT-X",
            "mismatch",
            &Value::Null,
        ),
        (
            "accessionNumber=ACC-1&patientID=PAT-A&issuer=HOSP",
            "mismatch",
            &Value::Null,
        ),
        ("study=1.2.3&patientID=PAT-Q", "mismatch", &Value::Null),
        (
            "study=1.2.3&accessionNumber=ACC-2",
            "mismatch",
            &Value::Null,
        ),
        ("study=1.2.3&accessionNumber=ACC-1", "ready", &first),
        ("study=1.2.3,1.2.9", "choice", &Value::Null),
        ("study=1.2.3,1.2.99", "ready", &first),
    ] {
        let found = launched(&neighbour, query).await;
        assert_eq!(
            (&found["state"], &found["case"]),
            (&json!(state), case),
            "{query}"
        );
    }
}

#[tokio::test]
async fn a_study_opens_the_same_head_whatever_comes_later_and_lists_the_others() {
    let neighbour = Neighbour::start(|config| config.page.patient_banner = Some(true)).await;
    let original = Series {
        study: "1.2.3",
        uid: "1.2.3.4",
        texts: &[
            ([0x08, 0x08], "CS", r"ORIGINAL\PRIMARY\M"),
            ([0x10, 0x21], "LO", "HOSP"),
            ([0x10, 0x30], "DA", "19670312"),
        ],
    };
    let first = original.becomes(&neighbour).await;
    let query = "StudyInstanceUIDs=1.2.3";
    assert_eq!(launched(&neighbour, query).await["case"], first);
    let after_contrast = Series {
        uid: "1.2.3.5",
        texts: &[
            ([0x08, 0x08], "CS", r"ORIGINAL\PRIMARY\M"),
            ([0x18, 0x10], "LO", "Gadovist"),
            ([0x10, 0x21], "LO", "HOSP"),
            ([0x10, 0x30], "DA", "19670312"),
        ],
        ..original
    };
    let reformat = Series {
        uid: "1.2.3.6",
        texts: &[
            ([0x08, 0x08], "CS", r"DERIVED\SECONDARY\MPR"),
            ([0x10, 0x21], "LO", "HOSP"),
            ([0x10, 0x30], "DA", "19670312"),
        ],
        ..original
    };
    let second = after_contrast.becomes(&neighbour).await;
    let third = reformat.becomes(&neighbour).await;
    let found = launched(&neighbour, query).await;
    assert_eq!(
        (&found["state"], &found["case"]),
        (&json!("ready"), &json!(first))
    );
    let candidates = found["candidates"].as_array().unwrap();
    let order: Vec<_> = candidates.iter().map(|each| &each["case"]).collect();
    assert_eq!(order, [&first, &second, &third]);
    let flags = |each: &Value| [each["is_derived"].clone(), each["has_contrast"].clone()];
    assert_eq!(
        candidates.iter().map(flags).collect::<Vec<_>>(),
        [[false, false], [false, true], [true, false]].map(|each| each.map(Value::from))
    );
    // Where the page shows the patient, so does the choice.
    let patient = candidates[0]["patient"].as_str().unwrap();
    assert_eq!(patient, "Somebody, Secret · P-77 (HOSP) · * 1967-03-12");
    // A series that is named is opened.
    let named = launched(&neighbour, "study=1.2.3&series=1.2.3.5").await;
    assert_eq!(named["case"], second);
    // Pictures of the study are those of the same head.
    let server = &neighbour.server;
    let picture = |address: String| async move { server.get(&address).await.body };
    let keys = "rendered3D?depth_mm=5&viewport=64,48";
    let of_study = picture(format!("/dicomweb/studies/1.2.3/{keys}")).await;
    let of_series = picture(format!("/dicomweb/studies/1.2.3/series/1.2.3.4/{keys}")).await;
    assert!(of_study.len() > 500 && of_study == of_series);
}

#[tokio::test]
async fn two_patients_of_nearly_the_same_name_and_one_accession_number_keep_their_own_results() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let accession = ([0x08, 0x50], "SH", "ACC-7");
    // One letter of the name and the order of the id's digits differ; labels and dates are the same. UIDs have digits alone.
    let people = [
        ("1.2.70", "1.2.70.1", "Souza^Maria", "P10045"),
        ("1.2.71", "1.2.71.1", "Sousa^Maria", "P10054"),
    ];
    let mut cases = Vec::new();
    for (study, uid, name, patient) in people {
        let series = Series {
            study,
            uid,
            texts: &[
                accession,
                ([0x08, 0x20], "DA", "20261101"),
                ([0x10, 0x10], "PN", name),
                ([0x10, 0x20], "LO", patient),
            ],
        };
        cases.push(series.becomes(&neighbour).await);
    }
    let list = server.get("/v1/cases").await.json();
    let listed = list["cases"].as_array().unwrap().iter();
    let labels: Vec<_> = listed.map(|case| &case["name"]).collect();
    assert_eq!(labels[0], labels[1]);
    let choice = launched(&neighbour, "accessionNumber=ACC-7").await;
    let offered = choice["candidates"].as_array().unwrap();
    assert_eq!((&choice["case"], offered.len()), (&Value::Null, 2));
    for (at, (study, _, name, patient)) in people.into_iter().enumerate() {
        let (_, _, other_name, other_patient) = people[1 - at];
        let query = format!("accessionNumber=ACC-7&patientID={patient}");
        let opened = launched(&neighbour, &query).await;
        assert_eq!(opened["case"], cases[at], "{opened}");
        let opened = format!("/v1/cases/{}", opened["case"].as_str().unwrap());
        let shown = server.get(&format!("{opened}/dicom")).await.json();
        assert_eq!(shown["attributes"]["PatientName"], name);
        let what = json!({"what": "view", "render": crate::results::small()});
        let made = crate::results::result(server, &opened, &what).await;
        assert_eq!(made.status, 200, "{made:?}");
        let has = |text: &str| memchr::memmem::find(&made.body, text.as_bytes()).is_some();
        assert!(has(name) && has(patient) && has(study));
        assert!(!has(other_name) && !has(other_patient));
    }
}

/// What became of a series.
async fn arrival(neighbour: &Neighbour, series: &str) -> Value {
    let list = neighbour.server.get("/v1/arrivals").await.json();
    let mut arrivals = list["arrivals"].as_array().unwrap().iter();
    let found = arrivals.find(|arrival| arrival["series"] == series);
    found.cloned().unwrap_or_default()
}

#[tokio::test]
async fn a_number_of_two_patients_opens_neither_also_if_one_of_them_makes_no_case() {
    let neighbour = Neighbour::start(|config| config.page.patient_banner = Some(true)).await;
    let accession = ([0x08, 0x50], "SH", "ACC-5");
    let head = Series {
        study: "1.2.50",
        uid: "1.2.50.1",
        texts: &[accession, ([0x10, 0x20], "LO", "PAT-A")],
    };
    let case = head.becomes(&neighbour).await;
    let query = "accessionNumber=ACC-5";
    let state = async |query: &str| {
        let found = launched(&neighbour, query).await;
        (found["state"].as_str().unwrap().to_owned(), found)
    };
    // Further series of the same patient make nothing ambiguous, nor does another study of theirs.
    for (study, uid) in [("1.2.50", "1.2.50.2"), ("1.2.51", "1.2.51.1")] {
        let texts = &[accession, ([0x10, 0x20], "LO", "PAT-A")];
        let scout = Series { study, uid, texts };
        assert_eq!(neighbour.store(&scout.files()[..1]).await.status, 200);
        assert_eq!(state(query).await.0, "ready", "{uid}");
    }
    let other = Series {
        study: "1.2.52",
        uid: "1.2.52.1",
        texts: &[accession, ([0x10, 0x20], "LO", "PAT-B")],
    };
    assert_eq!(neighbour.store(&other.files()[..1]).await.status, 200);
    // Whether it is still received or was refused.
    let (choice, found) = state(query).await;
    assert_eq!((&*choice, &found["case"]), ("choice", &Value::Null));
    until("the one image makes nothing", async || {
        (arrival(&neighbour, other.uid).await["state"] == "nothing").then_some(())
    })
    .await;
    let (choice, found) = state(query).await;
    assert_eq!((&*choice, &found["case"]), ("choice", &Value::Null));
    let candidates = found["candidates"].as_array().unwrap();
    let [first, second] = &candidates[..] else {
        panic!("{found}");
    };
    assert_eq!(first["case"], case);
    assert_eq!(
        (&second["case"], &second["state"]),
        (&Value::Null, &json!("nothing"))
    );
    assert!(second["patient"].as_str().unwrap().contains("PAT-B") && second["reason"].is_object());
    assert_eq!(
        state("accessionNumber=ACC-5&patientID=PAT-A").await.1["case"],
        case
    );
    assert_eq!(
        state("accessionNumber=ACC-5&patientID=PAT-B").await.0,
        "nothing"
    );
    assert_eq!(
        state("accessionNumber=ACC-5&patientID=PAT-C").await.0,
        "mismatch"
    );
    assert_eq!(state("study=1.2.50").await.1["case"], case);
}

#[tokio::test]
async fn a_study_of_two_patients_gives_no_picture() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let mut cases = Vec::new();
    for (uid, patient) in [("1.2.60.1", "PAT-A"), ("1.2.60.2", "PAT-B")] {
        let series = Series {
            study: "1.2.60",
            uid,
            texts: &[([0x10, 0x20], "LO", patient)],
        };
        cases.push(series.becomes(&neighbour).await);
    }
    let found = launched(&neighbour, "study=1.2.60").await;
    assert_eq!(
        (&found["state"], &found["case"]),
        (&json!("choice"), &Value::Null)
    );
    let keys = "rendered3D?depth_mm=5&viewport=64,48";
    let refused = server
        .get(&format!("/dicomweb/studies/1.2.60/{keys}"))
        .await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "several-patients")
    );
    let drawn = server
        .get(&format!("/dicomweb/studies/1.2.60/series/1.2.60.2/{keys}"))
        .await;
    assert_eq!(drawn.status, 200, "{drawn:?}");
}

/// Uploads the files of a series as a case, as a user does with an old export, whose images have UIDs of their own; its id, once it is ready.
async fn uploaded(neighbour: &Neighbour, series: &Series<'_>) -> String {
    let files = series.files_of(&format!("{}.9", series.uid));
    let answer = neighbour
        .server
        .upload(&[("volume", &zipped(&files))])
        .await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let case = answer.json()["id"].as_str().unwrap().to_owned();
    neighbour
        .server
        .until_ready(&format!("/v1/cases/{case}"))
        .await;
    case
}

#[tokio::test]
async fn an_upload_with_the_series_of_another_patient_opens_in_the_place_of_nothing() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    // Whichever comes first.
    for (study, uid, is_upload_first) in
        [("1.2.80", "1.2.80.1", false), ("1.2.81", "1.2.81.1", true)]
    {
        let right = Series {
            study,
            uid,
            texts: &[
                ([0x08, 0x20], "DA", "20261101"),
                ([0x10, 0x20], "LO", "P-100"),
            ],
        };
        let wrong = Series {
            texts: &[
                ([0x08, 0x20], "DA", "20261101"),
                ([0x10, 0x20], "LO", "P-999"),
            ],
            ..right
        };
        let (case, upload) = match is_upload_first {
            true => {
                let upload = uploaded(&neighbour, &wrong).await;
                // While it is received, nobody knows what it will be.
                assert_eq!(neighbour.store(&right.files()[..1]).await.status, 200);
                let early = launched(&neighbour, &format!("study={study}")).await;
                assert_eq!(
                    (&early["state"], &early["case"]),
                    (&json!("choice"), &Value::Null)
                );
                (right.becomes(&neighbour).await, upload)
            }
            false => {
                let case = right.becomes(&neighbour).await;
                (case, uploaded(&neighbour, &wrong).await)
            }
        };
        for query in [
            format!("study={study}"),
            format!("study={study}&series={uid}"),
        ] {
            let choice = launched(&neighbour, &query).await;
            assert_eq!(
                (&choice["state"], &choice["case"]),
                (&json!("choice"), &Value::Null)
            );
            assert_eq!(
                choice["candidates"].as_array().unwrap().len(),
                2,
                "{choice}"
            );
        }
        for (patient, case) in [("P-100", &case), ("P-999", &upload)] {
            let query = format!("study={study}&patientID={patient}");
            let found = launched(&neighbour, &query).await;
            assert_eq!(
                (&found["state"], &found["case"]),
                (&json!("ready"), &json!(case))
            );
        }
        // The upload is open, and no result of it goes to the study of the other patient.
        let view = json!({"what": "view", "render": small()});
        for (case, status) in [(&case, 200), (&upload, 409)] {
            let address = format!("/v1/cases/{case}");
            let shown = server.get(&address).await.json();
            assert_eq!(shown["closed"], Value::Null);
            let made = result(server, &address, &view).await;
            assert_eq!(made.status, status, "{made:?}");
            if status == 409 {
                assert_eq!(made.problem(), "several-patients");
            }
        }
        let keys = "rendered3D?depth_mm=5&viewport=64,48";
        for of in ["", &format!("/series/{uid}")] {
            let refused = server
                .get(&format!("/dicomweb/studies/{study}{of}/{keys}"))
                .await;
            let found = (refused.status.as_u16(), refused.problem());
            assert_eq!(found, (409, "several-patients".to_owned()), "{of}");
        }
    }
}

#[tokio::test]
async fn a_result_that_waits_is_not_sent_once_the_pacs_has_sent_another_patient_in_its_series() {
    let neighbour = Neighbour::start(|config| {
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let wrong = Series {
        study: "1.2.87",
        uid: "1.2.87.1",
        texts: &[([0x10, 0x20], "LO", "P-999")],
    };
    let upload = format!("/v1/cases/{}", uploaded(&neighbour, &wrong).await);
    let view = json!({"what": "view", "render": small(), "node": "away"});
    let waiting = result(server, &upload, &view).await.json();
    let right = Series {
        texts: &[([0x10, 0x20], "LO", "P-100")],
        ..wrong
    };
    right.becomes(&neighbour).await;
    let background = pacs::start_transfers(server.pacs.clone());
    let address = format!("/v1/dicom-results/{}", waiting["id"].as_str().unwrap());
    let ended = until("the result ends", async || {
        let result = server.get(&address).await.json();
        (result["state"] == "failed").then_some(result)
    })
    .await;
    background.shut_down(Duration::from_secs(5)).await;
    assert_eq!(ended["reason"]["name"], "several-patients", "{ended}");
}

#[tokio::test]
async fn of_one_patient_the_images_from_the_pacs_come_before_an_upload() {
    let neighbour = Neighbour::start(|_| {}).await;
    let texts = &[([0x10, 0x20], "LO", "P-100")];
    let sent = Series {
        study: "1.2.82",
        uid: "1.2.82.1",
        texts,
    };
    let case = sent.becomes(&neighbour).await;
    // The export has other images.
    let mut fewer = sent.files();
    fewer.pop();
    let answer = neighbour
        .server
        .upload(&[("volume", &zipped(&fewer))])
        .await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let upload = answer.json()["id"].as_str().unwrap().to_owned();
    let address = format!("/v1/cases/{upload}");
    neighbour.server.until_ready(&address).await;
    assert_ne!(case, upload);
    let found = launched(&neighbour, "study=1.2.82").await;
    assert_eq!(
        (&found["state"], &found["case"]),
        (&json!("ready"), &json!(case))
    );
}

#[tokio::test]
async fn late_images_of_another_patient_in_the_same_series_make_a_link_a_choice() {
    let neighbour = Neighbour::start(|_| {}).await;
    let first = Series {
        study: "1.2.85",
        uid: "1.2.85.1",
        texts: &[([0x10, 0x20], "LO", "P-100")],
    };
    first.becomes(&neighbour).await;
    let opens = launched(&neighbour, "study=1.2.85").await;
    assert_eq!(opens["state"], "ready");
    // As if a modality had kept the series open for the next patient.
    let late = |slice: Slice| {
        let sop = format!("1.2.85.9.{}", slice.instance);
        let texts = [
            ([0x08, 0x18], "UI", sop.as_str()),
            ([0x10, 0x20], "LO", "P-200"),
            ([0x20, 0x0D], "UI", "1.2.85"),
            ([0x20, 0x0E], "UI", "1.2.85.1"),
        ];
        with_texts(&slice, &texts)
    };
    let late: Vec<_> = head_slices().into_iter().take(3).map(late).collect();
    assert_eq!(neighbour.store(&late).await.status, 200);
    let is_choice = async || {
        let found = launched(&neighbour, "study=1.2.85").await;
        assert_eq!(
            (&found["state"], &found["case"]),
            (&json!("choice"), &Value::Null)
        );
    };
    is_choice().await;
    until("the series is refused", async || {
        let arrival = arrival(&neighbour, "1.2.85.1").await;
        (arrival["reason"]["name"] == "dicom-mixed-patients").then_some(())
    })
    .await;
    is_choice().await;
    let keys = "rendered3D?depth_mm=5&viewport=64,48";
    let address = format!("/dicomweb/studies/1.2.85/{keys}");
    let refused = neighbour.server.get(&address).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (409, "several-patients")
    );
}

#[tokio::test]
async fn files_of_another_patient_are_no_layer() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let head = Series {
        study: "1.2.83",
        uid: "1.2.83.1",
        texts: &[([0x10, 0x20], "LO", "P-100")],
    };
    let case = head.becomes(&neighbour).await;
    let files = |uid: &str, patient: &str| {
        let texts = &[
            ([0x10, 0x20], "LO", patient),
            ([0x08, 0x103E], "LO", "FLAIR"),
        ];
        let study = head.study;
        Series { study, uid, texts }.files()
    };
    let add = async |uid, patient| {
        let archive = zipped(&files(uid, patient));
        let request = Request::post(format!("/v1/cases/{case}/layers"))
            .header("content-type", form_type())
            .body(Body::from(form(&[("volume", &archive)])));
        server.send(request.unwrap()).await
    };
    let refused = add("1.2.83.2", "P-999").await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem()),
        (422, "layer-of-another-patient".to_owned())
    );
    assert!(!String::from_utf8_lossy(&refused.body).contains("P-999"));
    assert_eq!(add("1.2.83.3", "P-100").await.status, 202);
    // A series that arrives is refused for the same reason, also if somebody takes it as a layer.
    let arrived = files("1.2.83.4", "P-999");
    assert_eq!(neighbour.store(&arrived).await.status, 200);
    let nothing = async |name: &str| {
        until("the series becomes nothing", async || {
            let arrival = arrival(&neighbour, "1.2.83.4").await;
            (arrival["reason"]["name"] == *name).then_some(arrival)
        })
        .await
    };
    let found = nothing("series-not-t1").await;
    let detail = "the case of its study is of another patient";
    let says = |found: &Value| found["reason"]["detail"].as_str().unwrap().contains(detail);
    assert!(says(&found), "{found}");
    let take = Request::post(format!("/v1/arrivals/{}", found["id"].as_str().unwrap()));
    let take = take.body(Body::from(r#"{"as": "layer"}"#)).unwrap();
    assert_eq!(server.send(take).await.status, 202);
    let found = nothing("no-case-of-study").await;
    assert!(says(&found), "{found}");
}
