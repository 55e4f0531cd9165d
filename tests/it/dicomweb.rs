//! What is here, searched and retrieved as viewers do: QIDO-RS and WADO-RS.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::{Value, json};

use crate::dicom::head_slices;
use crate::pacs::Neighbour;
use crate::results::{add_node, identified_case, identified_head, python_with, result, small};
use crate::series_builder::{Syntax, files};
use crate::server::{Answer, Server};

const ANY_FRAME: &str = r#"multipart/related; type="application/octet-stream"; transfer-syntax=*"#;
const FILES: &str = r#"multipart/related; type="application/dicom""#;

/// A server with the head and a result of it, whose node is away.
async fn held(keep_source: bool) -> (Neighbour, String) {
    let neighbour = Neighbour::start(|config| {
        config.pacs.keep_source = keep_source;
        add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let case = identified_case(&neighbour).await;
    let view = json!({"what": "view", "render": small(), "node": "away"});
    let queued = result(&neighbour.server, &case, &view).await;
    assert_eq!(queued.status, 202, "{queued:?}");
    (neighbour, case)
}

async fn list(server: &Server, address: &str) -> Vec<Value> {
    let answer = server.get(&format!("/dicomweb{address}")).await;
    if answer.status == 204 {
        return Vec::new();
    }
    assert_eq!(answer.status, 200, "{address}: {answer:?}");
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    answer.json().as_array().unwrap().clone()
}

fn first<'a>(item: &'a Value, tag: &str) -> &'a Value {
    &item[tag]["Value"][0]
}

/// The parts of an answer, without their heads.
fn parts(answer: &Answer) -> Vec<Vec<u8>> {
    let kind = answer.header("content-type");
    let boundary = format!("--{}", kind.split("boundary=").nth(1).unwrap());
    let mut rest = &answer.body[..];
    let mut parts = Vec::new();
    while let Some(at) = memchr::memmem::find(rest, boundary.as_bytes()) {
        if at > 0 {
            let part = &rest[..at - 2];
            let start = memchr::memmem::find(part, b"\r\n\r\n").unwrap() + 4;
            parts.push(part[start..].to_vec());
        }
        rest = &rest[at + boundary.len()..];
    }
    parts
}

#[tokio::test]
async fn a_viewer_s_list_of_queries_finds_what_is_here() {
    let (neighbour, _case) = held(true).await;
    let server = &neighbour.server;
    // As OHIF asks for its list of studies.
    let page = "limit=101&offset=0&fuzzymatching=false&includefield=00081030%2C00080060";
    for (filter, count) in [
        ("", 1),
        ("&PatientName=*m%C3%BCll*", 1),
        ("&PatientName=*nobody*", 0),
        ("&00100020=*P-7*", 1),
        ("&PatientID=P-7", 0),
        ("&AccessionNumber=*A-1*", 1),
        ("&AccessionNumber=A-1", 1),
        ("&AccessionNumber=A-2", 0),
        ("&StudyDate=20261001-20261130", 1),
        ("&StudyDate=20261102-", 0),
        ("&ModalitiesInStudy=CT,MR", 1),
        ("&ModalitiesInStudy=CT", 0),
        ("&StudyDescription=*brain*", 0),
        ("&StudyInstanceUID=1.2.3", 1),
        ("&StudyInstanceUID=1.2.9,1.2.3", 1),
        ("&IssuerOfPatientID=HOSPITAL", 0),
        ("&00400275.00400009=1", 1),
        ("&multiplevaluematching=true", 1),
        ("&emptyvaluematching=true&StudyDescription=%22%22", 1),
        ("&emptyvaluematching=true&PatientID=%22%22", 0),
        ("&limit=0", 1),
        ("&accept=application/dicom%2Bjson", 1),
    ] {
        let studies = list(server, &format!("/studies?{page}{filter}")).await;
        assert_eq!(studies.len(), count, "{filter}");
    }
    let study = &list(server, &format!("/studies?{page}")).await[0];
    assert_eq!(first(study, "00100010")["Alphabetic"], "Müller^Änne");
    assert_eq!(first(study, "00080050"), "A-1");
    assert_eq!(study["00080061"]["Value"], json!(["MR", "OT"]));
    assert_eq!(first(study, "00201206"), 2);
    assert_eq!(first(study, "00201208"), head_slices().len() + 1);
    assert_eq!(first(study, "0020000D"), "1.2.3");
    assert!(study["00100020"].is_object() && study["00081040"].is_null());

    let series = list(
        server,
        "/studies/1.2.3/series?includefield=00080021,00080031,0008103E,00200011",
    )
    .await;
    let modalities: Vec<_> = series.iter().map(|each| first(each, "00080060")).collect();
    assert_eq!(modalities, ["MR", "OT"]);
    assert_eq!(first(&series[0], "00201209"), head_slices().len());
    assert_eq!(first(&series[1], "00200011"), 9105);
    assert!(
        series[0]["00100010"].is_null(),
        "the address names the study"
    );
    // What is not held is read from an image that is kept.
    assert_eq!(first(&series[0], "00400244"), "20261101");
    assert_eq!(first(&series[0], "00400245"), "101000");
    assert!(series[1]["00400244"].is_null());
    let everywhere = list(server, "/series?Modality=OT").await;
    assert_eq!(first(&everywhere[0], "00100020"), "P-77");
    let of_series = first(&series[0], "0020000E").as_str().unwrap();
    let address = format!("/studies/1.2.3/series/{of_series}/instances");
    let instances = list(server, &address).await;
    assert_eq!(instances.len(), head_slices().len());
    // Pages follow each other without a gap.
    let mut paged = Vec::new();
    for offset in (0..instances.len() + 7).step_by(7) {
        paged.extend(list(server, &format!("{address}?limit=7&offset={offset}")).await);
    }
    assert_eq!(paged, instances);
    let limited = server.get(&format!("/dicomweb{address}?limit=7")).await;
    assert!(limited.header("warning").contains("additional results"));
    let one = first(&instances[3], "00080018").as_str().unwrap();
    assert_eq!(
        list(server, &format!("/instances?SOPInstanceUID={one}"))
            .await
            .len(),
        1
    );
    assert_eq!(
        list(server, "/studies/1.2.3/instances").await.len(),
        instances.len() + 1
    );
    assert_eq!(
        list(server, "/studies/1.2.4/series").await,
        Vec::<Value>::new()
    );
    let all = &list(server, &format!("{address}?includefield=all&limit=1")).await[0];
    assert_eq!(first(all, "00100040"), "F");
    let fuzzy = server.get("/dicomweb/studies?fuzzymatching=true").await;
    assert!(fuzzy.header("warning").contains("fuzzy"));
    for key in ["InstitutionName", "00400275.00400009", "00091001"] {
        let ignored = server.get(&format!("/dicomweb/studies?{key}=x")).await;
        assert_eq!(ignored.status, 200);
        assert!(ignored.header("warning").contains("ignored"));
    }
    let wrong = server
        .get("/dicomweb/studies?StudyDate=20261301")
        .await
        .json();
    assert_eq!(wrong["parameter"], "StudyDate");
}

#[tokio::test]
async fn a_search_looks_at_a_bounded_number_of_studies() {
    let (neighbour, _case) = held(false).await;
    let server = &neighbour.server;
    let named = |others: usize| {
        let others = (0..others).map(|number| format!("2.25.{number}"));
        let uids: Vec<_> = others.chain(["1.2.3".to_owned()]).collect();
        format!("/studies?StudyInstanceUID={}", uids.join(","))
    };
    let found = list(server, &named(1999)).await;
    assert_eq!(first(&found[0], "0020000D"), "1.2.3");
    let refused = server.get(&format!("/dicomweb{}", named(2000))).await;
    assert_eq!(refused.status, 413);
    assert_eq!(refused.problem(), "search-too-broad");
}

#[tokio::test]
async fn what_is_kept_is_retrieved_as_it_was_and_deleted_with_its_case() {
    let (neighbour, case) = held(true).await;
    let server = &neighbour.server;
    let slices = head_slices();
    let series = list(server, "/studies/1.2.3/series").await;
    let uid = |each: &Value| first(each, "0020000E").as_str().unwrap().to_owned();
    let of_series = format!("/dicomweb/studies/1.2.3/series/{}", uid(&series[0]));
    let metadata = server.get(&format!("{of_series}/metadata")).await;
    assert_eq!(metadata.status, 200, "{metadata:?}");
    let metadata = metadata.json();
    assert_eq!(metadata.as_array().unwrap().len(), slices.len());
    for (number, slice) in slices.iter().enumerate() {
        let instance = format!("1.2.3.4.{}", number + 1);
        let known = metadata.as_array().unwrap().iter();
        let mut known = known.filter(|each| first(each, "00080018") == &json!(instance));
        let known = known.next().unwrap();
        assert_eq!(first(known, "00100010")["Alphabetic"], "Müller^Änne");
        assert!(known["7FE00010"].is_null() && known["00280100"].is_object());
        if number % 16 != 0 {
            continue;
        }
        let address = format!("{of_series}/instances/{instance}");
        let frame = server
            .get_with(&format!("{address}/frames/1"), &[("accept", ANY_FRAME)])
            .await;
        assert_eq!(frame.status, 200, "{frame:?}");
        let samples: Vec<u8> = slice
            .samples
            .iter()
            .flat_map(|each| each.to_le_bytes())
            .collect();
        assert!(parts(&frame) == [samples.clone()], "{instance}");
        let bare = ("accept", "application/octet-stream");
        let frame = server
            .get_with(&format!("{address}/frames/1"), &[bare])
            .await;
        assert!(frame.body == samples);
        let bare = ("accept", "application/dicom");
        let file = server.get_with(&address, &[bare]).await;
        assert!(file.body == identified_head()[number], "{instance}");
    }
    let files = server.get_with(&of_series, &[("accept", FILES)]).await;
    let mut kept = parts(&files);
    let mut sent = identified_head();
    kept.sort();
    sent.sort();
    assert!(kept == sent);

    // A result is an object like any other.
    let of_result = format!("/dicomweb/studies/1.2.3/series/{}", uid(&series[1]));
    let known = server.get(&format!("{of_result}/metadata")).await.json();
    assert_eq!(first(&known[0], "00280004"), "RGB");
    let instance = first(&known[0], "00080018").as_str().unwrap();
    let address = format!("{of_result}/instances/{instance}/frames/1");
    let frame = server.get_with(&address, &[("accept", ANY_FRAME)]).await;
    assert_eq!(parts(&frame)[0].len(), 160 * 128 * 3);
    let whole = server.get("/dicomweb/studies/1.2.3").await;
    assert_eq!(parts(&whole).len(), slices.len() + 1);

    let first = format!("{of_series}/instances/1.2.3.4.1");
    for (address, accept, status) in [
        (format!("{first}/frames/2"), ANY_FRAME, 404),
        (format!("{first}/frames/0"), ANY_FRAME, 400),
        (format!("{first}/frames/x"), ANY_FRAME, 400),
        (format!("{first}/frames/1"), "image/jpeg", 406),
        (first.clone(), "text/html", 406),
        (of_series.clone(), "application/dicom", 406),
        (
            format!("{of_series}/metadata"),
            "application/dicom+xml",
            406,
        ),
        ("/dicomweb/studies".to_owned(), "application/dicom+xml", 406),
        ("/dicomweb/studies?Somebody=Secret".to_owned(), "*/*", 400),
        ("/dicomweb/studies?limit=-1".to_owned(), "*/*", 400),
        ("/dicomweb/studies?StudyDate=Secret".to_owned(), "*/*", 400),
        (
            "/dicomweb/studies?accept=application/dicom%2Bxml".to_owned(),
            "*/*",
            406,
        ),
        ("/dicomweb/studies/1.2.9".to_owned(), "*/*", 404),
        ("/dicomweb/studies/Somebody/metadata".to_owned(), "*/*", 404),
        (format!("{of_series}/instances/1.2.99"), "*/*", 404),
    ] {
        let refused = server.get_with(&address, &[("accept", accept)]).await;
        assert_eq!(refused.status.as_u16(), status, "{address} {accept}");
        let text = String::from_utf8_lossy(&refused.body).into_owned();
        assert!(
            !text.contains("Somebody") && !text.contains("Secret"),
            "{text}"
        );
    }
    let deleted = server.method(axum::http::Method::DELETE, &case).await;
    assert_eq!(deleted.status, 204);
    assert_eq!(server.get(&of_series).await.status, 404);
    assert_eq!(list(server, "/studies").await, Vec::<Value>::new());
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn results_and_kept_images_have_pictures_of_their_own() {
    let (neighbour, _case) = held(true).await;
    let server = &neighbour.server;
    for series in list(server, "/studies/1.2.3/series").await {
        let modality = first(&series, "00080060").as_str().unwrap().to_owned();
        let uid = first(&series, "0020000E").as_str().unwrap();
        let of_series = format!("/dicomweb/studies/1.2.3/series/{uid}");
        let instances = list(server, &format!("/studies/1.2.3/series/{uid}/instances")).await;
        // The first slices of the series are outside of the head.
        let middle = &instances[instances.len() / 2];
        let instance = first(middle, "00080018").as_str().unwrap();
        let of_instance = format!("{of_series}/instances/{instance}");
        for (address, most) in [
            (format!("{of_instance}/rendered"), u32::MAX),
            (format!("{of_instance}/frames/1/rendered"), u32::MAX),
            (format!("{of_instance}/thumbnail"), 128),
            (format!("{of_series}/thumbnail"), 128),
        ] {
            let answer = server.get_with(&address, &[("accept", "image/png")]).await;
            assert_eq!(answer.status, 200, "{modality} {address}");
            assert_eq!(answer.header("content-type"), "image/png");
            let picture = image::load_from_memory(&answer.body).unwrap().into_luma8();
            assert!(picture.width().max(picture.height()) <= most, "{address}");
            let lit = picture.pixels().filter(|pixel| pixel.0[0] > 40).count();
            assert!(lit > 100, "{modality} {address}: {lit}");
        }
        let jpeg = server
            .get(&format!("{of_instance}/rendered?quality=50"))
            .await;
        assert_eq!(jpeg.header("content-type"), "image/jpeg");
        for (rest, status) in [
            ("/rendered?quality=0", 400),
            ("/rendered?depth_mm=8", 400),
            ("/frames/2/rendered", 404),
            ("/frames/x/rendered", 400),
        ] {
            let refused = server.get(&format!("{of_instance}{rest}")).await;
            assert_eq!(refused.status, status, "{rest}");
        }
    }
}

#[tokio::test]
async fn without_keep_source_the_attributes_are_known_and_no_pixel_is_served() {
    let (neighbour, _case) = held(false).await;
    let (keeper, _) = held(true).await;
    let of_series = {
        let series = list(&neighbour.server, "/studies/1.2.3/series").await;
        assert!(series[0]["00081190"]["Value"].is_null());
        assert_eq!(first(&series[0], "00080056"), "UNAVAILABLE");
        assert_eq!(first(&series[1], "00080056"), "ONLINE");
        let uid = first(&series[0], "0020000E").as_str().unwrap();
        format!("/dicomweb/studies/1.2.3/series/{uid}")
    };
    let by_uid = |all: Value| -> BTreeMap<String, Value> {
        let all = all.as_array().unwrap().clone().into_iter();
        all.map(|each| (first(&each, "00080018").to_string(), each))
            .collect()
    };
    let address = format!("{of_series}/metadata");
    let known = by_uid(neighbour.server.get(&address).await.json());
    let kept = by_uid(keeper.server.get(&address).await.json());
    assert_eq!(known.len(), head_slices().len());
    // What is computed from the volume is where the images are.
    for (uid, known) in &known {
        let kept = &kept[uid];
        for tag in ["00200032", "00200037", "00280030", "00280010", "00280011"] {
            let numbers = |of: &Value| -> Vec<f64> {
                let values = of[tag]["Value"].as_array().unwrap().iter();
                values.map(|value| value.as_f64().unwrap()).collect()
            };
            for (a, b) in numbers(known).iter().zip(numbers(kept)) {
                assert!((a - b).abs() < 1e-3, "{tag}: {known} {kept}");
            }
        }
        assert_eq!(known["00100010"], kept["00100010"]);
    }
    for rest in ["", "/instances/1.2.3.4.1"] {
        let refused = neighbour.server.get(&format!("{of_series}{rest}")).await;
        assert_eq!(refused.problem(), "images-not-kept");
    }
    let frame = format!("{of_series}/instances/1.2.3.4.1/frames/1");
    let refused = neighbour
        .server
        .get_with(&frame, &[("accept", ANY_FRAME)])
        .await;
    assert_eq!(refused.problem(), "images-not-kept");
    // The result is served nevertheless.
    let whole = neighbour.server.get("/dicomweb/studies/1.2.3").await;
    assert_eq!(parts(&whole).len(), 1);
}

#[tokio::test]
async fn what_is_stored_in_another_syntax_is_sent_in_the_plainest() {
    let neighbour = Neighbour::start(|config| config.pacs.keep_source = true).await;
    let server = &neighbour.server;
    let slices = head_slices();
    let stored = neighbour.store(&files(&slices, Syntax::Implicit)).await;
    assert_eq!(stored.status, 200);
    let arrival = neighbour.settled().await;
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&case).await;
    let series = arrival["series"].as_str().unwrap();
    let address = format!("/dicomweb/studies/1.2.3/series/{series}/instances/1.2.3.4.20");
    let plain = server.get_with(&address, &[("accept", FILES)]).await;
    let head = String::from_utf8_lossy(&plain.body[..200]).into_owned();
    assert!(
        head.contains("transfer-syntax=1.2.840.10008.1.2.1"),
        "{head}"
    );
    let samples: Vec<u8> = slices[19]
        .samples
        .iter()
        .flat_map(|each| each.to_le_bytes())
        .collect();
    let [file] = &parts(&plain)[..] else {
        panic!("one file is expected");
    };
    assert!(file.ends_with(&samples) && *file != slices[19].file(Syntax::Implicit));
    let any = format!("{FILES}; transfer-syntax=*");
    let stored = server.get_with(&address, &[("accept", &any)]).await;
    assert!(parts(&stored) == [slices[19].file(Syntax::Implicit)]);
}

#[tokio::test]
async fn dicomweb_client_lists_and_loads_it() {
    let Some(python) = python_with("dicomweb_client") else {
        return;
    };
    let (neighbour, _case) = held(true).await;
    let socket = neighbour.server.on_a_socket().await;
    let script = r"
import sys
import numpy
from dicomweb_client.api import DICOMwebClient
client = DICOMwebClient(sys.argv[1])
study, = client.search_for_studies(search_filters={'PatientID': 'P-77'})
assert study['0020000D']['Value'] == ['1.2.3'], study
assert client.search_for_studies(search_filters={'PatientID': 'nobody'}) == []
series = client.search_for_series('1.2.3')
uid = series[0]['0020000E']['Value'][0]
instances = client.search_for_instances('1.2.3', uid)
metadata = client.retrieve_series_metadata('1.2.3', uid)
assert len(instances) == len(metadata)
datasets = client.retrieve_series('1.2.3', uid)
assert len(datasets) == len(instances), len(datasets)
one = datasets[7]
assert str(one.PatientName) == 'Müller^Änne', one.PatientName
frame, = client.retrieve_instance_frames('1.2.3', uid, one.SOPInstanceUID, [1])
assert numpy.array_equal(numpy.frombuffer(frame, one.pixel_array.dtype), one.pixel_array.ravel())
again = client.retrieve_instance('1.2.3', uid, one.SOPInstanceUID)
assert again.SOPInstanceUID == one.SOPInstanceUID
result, = client.retrieve_series('1.2.3', series[1]['0020000E']['Value'][0])
assert result.pixel_array.shape == (128, 160, 3), result.pixel_array.shape
print('loaded', len(datasets))
";
    let address = format!("http://{}/dicomweb", socket.address);
    let run = move || Command::new(python).args(["-c", script, &address]).output();
    let output = tokio::task::spawn_blocking(run).await.unwrap().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success(),
        "{said} {}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(said.starts_with("loaded"), "{said}");
}
