//! Findings handed on: as a measurement report, as segments and as labels, the same for every program that reads them.

use std::path::Path;
use std::process::Command;

use axum::body::Body;
use axum::http::{Method, Request};
use serde_json::{Value, json};

use crate::corrections::{case_after, corrected_head};
use crate::dicom::head_slices;
use crate::head::plain_head;
use crate::interface::gifti_arrays;
use crate::maps::until_maps;
use crate::pacs::{Neighbour, with_texts};
use crate::results::{
    IDENTITY, errors_in, identified_case, identified_head, printed, python_with, result,
};
use crate::server::{Answer, Server};

/// Findings of each kind around the middle of a case. The second polygon is not plane.
pub(crate) async fn mark(server: &Server, case: &str) -> Value {
    let centre = server.get(case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let at = |offset: [f64; 3]| {
        let of_axis = |axis: usize| centre[axis].as_f64().unwrap() + offset[axis];
        json!([of_axis(0), of_axis(1), of_axis(2)])
    };
    let finding = |id: &str, kind: &str, points: &[[f64; 3]]| {
        let points: Vec<_> = points.iter().map(|&point| at(point)).collect();
        json!({"id": id, "kind": kind, "points_in_patient": points, "depth_mm": 6.25, "label": "", "note": "",
               "colour": "#ffb000", "is_dismissed": false})
    };
    let mut list = vec![
        finding("a", "point", &[[12.3, 4.5, -6.7]]),
        finding(
            "b",
            "line",
            &[[-14.0, 0.0, 5.0], [-14.0, 6.0, 8.0], [-12.0, 9.0, 9.0]],
        ),
        finding(
            "c",
            "polygon",
            &[
                [9.0, -9.0, 3.0],
                [9.0, 9.0, 3.0],
                [17.0, 9.0, 3.0],
                [17.0, -9.0, 3.0],
            ],
        ),
        finding(
            "d",
            "polygon",
            &[
                [-9.0, -9.0, 3.0],
                [-9.0, 9.0, 6.0],
                [-17.0, 9.0, 3.0],
                [-17.0, -9.0, 6.0],
            ],
        ),
        finding("e", "trajectory", &[[0.0, 0.0, 22.0], [3.0, 4.0, 5.0]]),
        finding("f", "point", &[[-12.3, 4.5, -6.7]]),
    ];
    list[0]["label"] = json!("Borrão à esquerda \\ 灰白质");
    list[0]["note"] = json!("First line.\nSecond <b>line</b>, 20 % \\ \"quoted\".");
    list[0]["certainty"] = json!("probable");
    list[0]["from_map"] = json!("intensity-asymmetry");
    list[0]["author"] = json!("Dr. Ana Müller");
    list[2]["label"] = json!("Thick?");
    list[2]["colour"] = json!("#00ff7f");
    list[5]["is_dismissed"] = json!(true);
    let body = json!({ "findings": list }).to_string().into_bytes();
    let stored = put(server, case, "application/json", body).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    // A report needs to know whether there are maps.
    until_maps(server, case).await;
    stored.json()
}

/// Replaces the findings that are there.
pub(crate) async fn put(server: &Server, case: &str, kind: &str, body: Vec<u8>) -> Answer {
    let address = format!("{case}/findings");
    let tag = server.get(&address).await.header("etag").to_owned();
    let request = Request::builder().method(Method::PUT).uri(address);
    let request = request.header("if-match", tag).header("content-type", kind);
    server.send(request.body(Body::from(body)).unwrap()).await
}

/// What the reader wrote; points to the precision of a report.
fn of_reader(list: &Value) -> Value {
    let mut list = list["findings"].clone();
    for finding in list.as_array_mut().unwrap() {
        let finding = finding.as_object_mut().unwrap();
        for of_server in ["created_at", "changed_at"] {
            finding.remove(of_server);
        }
        for point in finding["points_in_patient"].as_array_mut().unwrap() {
            for mm in point.as_array_mut().unwrap() {
                *mm = json!(mm.as_f64().unwrap() as f32);
            }
        }
    }
    list
}

async fn made(server: &Server, case: &str, what: &str, folder: &Path) -> Vec<u8> {
    let answer = result(server, case, &json!({ "what": what })).await;
    assert_eq!(answer.status, 200, "{what}: {answer:?}");
    let again = result(server, case, &json!({ "what": what })).await;
    assert_eq!(answer.body, again.body, "{what} is the same each time");
    let file = folder.join(format!("{what}.dcm"));
    std::fs::write(&file, &answer.body).unwrap();
    assert_eq!(errors_in(&file), Vec::<String>::new(), "{what}");
    answer.body.to_vec()
}

#[tokio::test]
async fn a_report_of_findings_is_valid_and_comes_back_as_it_was() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    let folder = tempfile::tempdir().unwrap();
    for what in ["findings", "finding-segments"] {
        let refused = result(server, &case, &json!({ "what": what })).await;
        assert_eq!(refused.problem(), "no-findings", "{what}");
    }
    let stored = mark(server, &case).await;
    let report = made(server, &case, "findings", folder.path()).await;

    let emptied = put(
        server,
        &case,
        "application/json",
        b"{\"findings\": []}".to_vec(),
    )
    .await;
    assert_eq!(emptied.json()["findings"], json!([]));
    let restored = put(server, &case, "application/dicom", report.clone()).await;
    assert_eq!(restored.status, 200, "{restored:?}");
    assert_eq!(of_reader(&restored.json()), of_reader(&stored));

    // Segments bring back what was not dismissed, to the last digit. What was dismissed stays.
    let segments = made(server, &case, "finding-segments", folder.path()).await;
    let from_segments = put(server, &case, "application/dicom", segments.clone()).await;
    assert_eq!(from_segments.status, 200, "{from_segments:?}");
    assert_eq!(of_reader(&from_segments.json()), of_reader(&stored));
    let emptied = put(
        server,
        &case,
        "application/json",
        b"{\"findings\": []}".to_vec(),
    );
    assert_eq!(emptied.await.status, 200);
    let from_segments = put(server, &case, "application/dicom", segments.clone()).await;
    let mut looked_at = stored.clone();
    let list = looked_at["findings"].as_array_mut().unwrap();
    list.retain(|finding| finding["is_dismissed"] == false);
    assert_eq!(of_reader(&from_segments.json()), of_reader(&looked_at));
    // Nor have segments the commissures, which stay, too.
    let mut with_axes = looked_at["findings"].clone();
    let mut axes = with_axes[0].clone();
    let anterior = axes["points_in_patient"][0].clone();
    let posterior = json!([
        anterior[0],
        anterior[1].as_f64().unwrap() + 25.0,
        anterior[2]
    ]);
    axes["id"] = json!("axes");
    axes["kind"] = json!("acpc");
    axes["points_in_patient"] = json!([anterior, posterior]);
    with_axes.as_array_mut().unwrap().push(axes);
    let body = json!({ "findings": with_axes }).to_string().into_bytes();
    let stored_axes = put(server, &case, "application/json", body).await;
    assert_eq!(stored_axes.status, 200, "{stored_axes:?}");
    let from_segments = put(server, &case, "application/dicom", segments.clone()).await;
    assert_eq!(
        of_reader(&from_segments.json()),
        of_reader(&stored_axes.json())
    );
    let mask = made(server, &case, "mask", folder.path()).await;
    let restored = put(server, &case, "application/dicom", report.clone()).await;
    assert_eq!(restored.status, 200, "{restored:?}");

    // Neither another object nor half of one is a report, and nothing changes.
    let slice = identified_head().remove(0);
    for (file, status, kind) in [
        (slice, 422, "dicom-damaged"),
        (mask, 422, "dicom-damaged"),
        (report[..report.len() / 2].to_vec(), 422, "dicom-damaged"),
        (b"{\"findings\": []}".to_vec(), 415, "dicom-none"),
    ] {
        let refused = put(server, &case, "application/dicom", file).await;
        assert_eq!(refused.status, status, "{refused:?}");
        assert_eq!(refused.problem(), kind);
    }
    let kept = server.get(&format!("{case}/findings")).await.json();
    assert_eq!(of_reader(&kept), of_reader(&stored));

    // Another patient, or the same patient in another examination.
    for (texts, words) in [
        (
            [
                ([0x10, 0x0020], "LO", "P-78"),
                ([0x20, 0x0052], "UI", "1.2.3.9"),
            ],
            "another patient",
        ),
        (
            [
                ([0x10, 0x0020], "LO", "P-77"),
                ([0x20, 0x0052], "UI", "1.2.3.8"),
            ],
            "frame of reference",
        ),
    ] {
        let other = Neighbour::start(|_| {}).await;
        let texts = [&IDENTITY[..], &texts].concat();
        let slices = head_slices();
        let files: Vec<_> = slices
            .iter()
            .map(|slice| with_texts(slice, &texts))
            .collect();
        assert_eq!(other.store(&files).await.status, 200);
        let arrival = other.settled().await;
        let elsewhere = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
        other.server.until_ready(&elsewhere).await;
        for file in [&report, &segments] {
            let refused = put(&other.server, &elsewhere, "application/dicom", file.clone()).await;
            assert_eq!(refused.status, 409, "{refused:?}");
            assert_eq!(refused.problem(), "findings-elsewhere");
            let detail = refused.json()["detail"].as_str().unwrap().to_owned();
            assert!(
                detail.contains(words) && !detail.contains("P-7"),
                "{detail}"
            );
        }
    }
}

/// Takes the findings of a case over into another one, whose findings are known by a tag.
#[tokio::test]
async fn findings_are_labels_of_the_vertices_that_they_cover() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let mesh = format!("{case}/mesh?depth_mm=8");
    let positions = server.get(&mesh).await.positions();
    let address = format!("{mesh}&format=gifti&values=findings");
    let empty = server.get(&address).await;
    let point = |id: &str, vertex: usize| {
        json!({"id": id, "kind": "point", "points_in_patient": [positions[vertex]], "depth_mm": 8,
               "label": "A <&> B", "note": "", "colour": "#00ff7f", "is_dismissed": false})
    };
    let mut list = vec![point("a", 200), point("b", 450), point("c", 700)];
    list[1]["is_dismissed"] = json!(true);
    let body = json!({ "findings": list }).to_string().into_bytes();
    assert_eq!(
        put(&server, &case, "application/json", body).await.status,
        200
    );

    let answer = server.get(&address).await;
    assert_ne!(answer.header("etag"), empty.header("etag"));
    assert_eq!(answer.header("cache-control"), "private, no-cache");
    let name = "attachment; filename=\"whole-8mm.findings.label.gii\"";
    assert_eq!(answer.header("content-disposition"), name);
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    let row = "<Label Key=\"2\" Red=\"0.0000\" Green=\"1.0000\" Blue=\"0.4980\" Alpha=\"1\">A &lt;&amp;&gt; B</Label>";
    assert!(text.contains(row), "{text}");
    assert!(!text.contains("Key=\"3\""));
    let labels = &gifti_arrays(&answer.body)[0].1;
    let before = &gifti_arrays(&empty.body)[0].1;
    assert_eq!(labels.len(), positions.len());
    assert!(before.iter().all(|&label| label == 0));
    assert_eq!([200, 450, 700].map(|vertex| labels[vertex]), [1, 0, 2]);
    let at = |label: u32| (0..labels.len()).filter(move |&vertex| labels[vertex] == label);
    for (label, middle) in [(1, 200), (2, 700)] {
        let middle = glam::Vec3::from(positions[middle]);
        // A brush of 1.5 mm, and the voxel of a vertex.
        assert!(at(label).all(|vertex| middle.distance(positions[vertex].into()) < 6.0));
    }
}

async fn take_over(server: &Server, into: &str, from: &str, tag: Option<&str>) -> Answer {
    let id = from.rsplit('/').next().unwrap();
    let mut request = Request::post(format!("{into}/findings/from/{id}"));
    if let Some(tag) = tag {
        request = request.header("if-match", tag);
    }
    server.send(request.body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn findings_are_taken_over_into_an_open_case_and_are_unconfirmed_there() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let old = identified_case(&neighbour).await;
    let marked = mark(server, &old).await;
    // The images come as those of another patient: their case has inherited nothing.
    assert_eq!(neighbour.store(&corrected_head()).await.status, 202);
    let new = case_after(&neighbour, &old).await;
    let list = async |case: &str| server.get(&format!("{case}/findings")).await;
    let tag_of = async |case: &str| list(case).await.header("etag").to_owned();
    assert_eq!(list(&new).await.json(), json!({"findings": []}));

    let tag = tag_of(&new).await;
    let without = take_over(server, &new, &old, None).await;
    assert_eq!(
        (without.status.as_u16(), without.problem()),
        (428, "if-match-missing".to_owned())
    );
    let stale = take_over(server, &new, &old, Some("\"0123\"")).await;
    assert_eq!(
        (stale.status.as_u16(), stale.problem()),
        (412, "findings-changed".to_owned())
    );
    assert_eq!(
        (&stale.json()["findings"], stale.header("etag")),
        (&json!([]), &*tag)
    );
    for nobody in ["0".repeat(32), "nobody".to_owned()] {
        let missing = take_over(server, &new, &nobody, Some(&tag)).await;
        assert_eq!(missing.status, 404, "{missing:?}");
    }
    let into_old = take_over(server, &old, &new, Some(&tag_of(&old).await)).await;
    assert_eq!(
        (into_old.status.as_u16(), into_old.problem()),
        (409, "closed".to_owned())
    );

    let taken = take_over(server, &new, &old, Some(&tag)).await;
    assert_eq!(taken.status, 200, "{taken:?}");
    assert_eq!(list(&new).await.header("etag"), taken.header("etag"));
    let mut taken = taken.json();
    let unconfirmed = |list: &Value| {
        let list = list["findings"].as_array().unwrap().iter();
        list.filter(|finding| finding["is_unconfirmed"] == true)
            .count()
    };
    assert_eq!(unconfirmed(&taken), 6);
    assert_eq!(list(&new).await.json(), taken);
    assert_eq!(list(&old).await.json(), marked);
    // Nothing of them leaves but for people, who are told.
    for what in ["findings", "finding-segments"] {
        let refused = result(server, &new, &json!({ "what": what })).await;
        assert_eq!(refused.problem(), "no-findings", "{what}");
    }
    let labels = async || {
        let accept = [("accept", "application/gzip")];
        let answer = server.get_with(&format!("{new}/findings"), &accept).await;
        assert_eq!(answer.status, 200, "{answer:?}");
        answer.body
    };
    let no_labels = labels().await;
    until_maps(server, &new).await;
    let report = server.get(&format!("{new}/report")).await;
    let report = String::from_utf8_lossy(&report.body).into_owned();
    assert!(report.contains("its place not confirmed"), "{report}");
    let csv = [("accept", "text/csv")];
    let csv = server.get_with(&format!("{new}/findings"), &csv).await;
    let csv = String::from_utf8_lossy(&csv.body).into_owned();
    assert!(csv.starts_with("finding,") && csv.contains("gyrus,unconfirmed,mni152,"));
    // A row for each point.
    assert_eq!(csv.matches(",true,,,\r\n").count(), 15, "{csv}");

    // A client that confirms a finding sends it without the mark. What is here is not added again.
    let confirmed = taken["findings"][0].as_object_mut().unwrap();
    confirmed.remove("is_unconfirmed");
    let body = taken.to_string().into_bytes();
    let stored = put(server, &new, "application/json", body).await;
    assert_eq!(unconfirmed(&stored.json()), 5);
    let again = take_over(server, &new, &old, Some(stored.header("etag"))).await;
    assert_eq!(again.status, 200);
    assert_eq!(again.json(), stored.json());
    assert_eq!(again.header("etag"), stored.header("etag"));
    assert_ne!(labels().await, no_labels);
    let folder = tempfile::tempdir().unwrap();
    let file = made(server, &new, "findings", folder.path()).await;
    // The file has one finding; the others are of the case alone, and stay.
    let restored = put(server, &new, "application/dicom", file).await;
    assert_eq!(restored.status, 200, "{restored:?}");
    assert_eq!(of_reader(&restored.json()), of_reader(&stored.json()));
    for (points, what) in [("taken over", &taken), ("marked", &marked)] {
        let places = |list: &Value| -> Vec<Value> {
            let list = list["findings"].as_array().unwrap().iter();
            list.map(|one| one["points_in_patient"].clone()).collect()
        };
        assert_eq!(places(&stored.json()), places(what), "{points}");
    }

    // Nothing is taken over that lies outside the volume.
    let mut far = plain_head();
    for row in &mut far.ras_from_voxel {
        row[3] += 500.0;
    }
    let far = server.prepared(&[("volume", &far.bytes())]).await;
    let outside = take_over(server, &far, &old, Some(&tag_of(&far).await)).await;
    assert_eq!(
        (outside.status.as_u16(), outside.problem()),
        (409, "findings-elsewhere".to_owned())
    );
    assert_eq!(list(&far).await.json(), json!({"findings": []}));
}

#[tokio::test]
async fn other_programs_read_the_same_values_and_voxels() {
    let Some(python) = python_with("highdicom") else {
        return;
    };
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    let folder = tempfile::tempdir().unwrap();
    let stored = mark(server, &case).await;
    std::fs::write(folder.path().join("findings.json"), stored.to_string()).unwrap();
    made(server, &case, "findings", folder.path()).await;
    made(server, &case, "finding-segments", folder.path()).await;
    made(server, &case, "report", folder.path()).await;
    let pdf = [("accept", "application/pdf")];
    let pdf = server.get_with(&format!("{case}/report"), &pdf).await;
    assert_eq!(pdf.status, 200, "{pdf:?}");
    std::fs::write(folder.path().join("report.pdf"), &pdf.body).unwrap();
    let accept = [("accept", "application/gzip")];
    let labels = server.get_with(&format!("{case}/findings"), &accept).await;
    assert_eq!(labels.status, 200, "{labels:?}");
    std::fs::write(folder.path().join("labels.nii.gz"), &labels.body).unwrap();
    for (number, file) in identified_head().iter().enumerate() {
        let path = folder.path().join(format!("slice-{number}.dcm"));
        std::fs::write(path, file).unwrap();
    }
    let script = r#"
import glob, gzip, json, struct, sys, warnings, numpy, pydicom, highdicom
warnings.simplefilter("ignore")
folder = sys.argv[1]
wanted = json.load(open(folder + "/findings.json"))["findings"]
wanted_middle = numpy.mean([wanted[i]["points_in_patient"][0][0] for i in (0, 5)])

report = highdicom.sr.srread(folder + "/findings.dcm")
groups = report.content.get_planar_roi_measurement_groups()
assert len(groups) == len(wanted), len(groups)
uids = set()
for group, finding in zip(groups, wanted):
    def values(name):
        return [i for i in group[0].ContentSequence if i.ConceptNameCodeSequence[0].CodeValue == name]
    def text(name):
        return "".join(i.TextValue for i in values(name))
    def word(name):
        return "".join(i.ConceptCodeSequence[0].CodeValue for i in values(name))
    assert group.tracking_identifier == finding["id"]
    uids.add(group.tracking_uid)
    region = group.roi
    points = numpy.array(finding["points_in_patient"], numpy.float32)
    closed = numpy.vstack([points, points[:1]])
    kind = finding["kind"]
    graphic = {"a": "POINT", "b": "POLYLINE", "c": "POLYGON", "d": "POLYLINE", "e": "POLYLINE", "f": "POINT"}[finding["id"]]
    assert region.graphic_type.value == graphic, (finding["id"], region.graphic_type)
    assert numpy.array_equal(region.value.astype(numpy.float32), closed if kind == "polygon" else points), region.value
    assert region.frame_of_reference_uid == "1.2.3.9"
    assert word("form") == kind and text("label") == finding["label"] and text("121106") == finding["note"], group
    assert word("certainty") == finding.get("certainty", "") and text("author") == finding.get("author", "")
    assert text("map") == finding.get("from_map", "") and text("colour") == finding["colour"]
    assert (word("state") == "dismissed") == finding["is_dismissed"]
    measured = values("depth")[0].MeasuredValueSequence[0]
    assert measured.NumericValue == finding["depth_mm"] and measured.MeasurementUnitsCodeSequence[0].CodeValue == "mm"
    exact = numpy.array(finding["points_in_patient"])
    corners = exact - exact[0]
    length = numpy.linalg.norm(numpy.diff(exact, axis=0), axis=1).sum()
    area = numpy.linalg.norm(numpy.cross(corners[:-1], corners[1:]).sum(axis=0)) / 2
    expected = {"point": [], "polygon": [("42798000", area, "mm2")]}.get(kind, [("410668003", length, "mm")])
    measured = [(c, m) for c in ("410668003", "42798000") for i in values(c) for m in i.MeasuredValueSequence]
    assert len(measured) == len(expected), (kind, measured)
    for (code, value, unit), (found, m) in zip(expected, measured):
        assert code == found and abs(m.NumericValue - value) < 1e-6 and m.MeasurementUnitsCodeSequence[0].CodeValue == unit
    side = [m.ConceptCodeSequence[0].CodeMeaning for s in values("363698007") for m in s.get("ContentSequence", [])]
    # The head of the tests is no mirror image of itself, so its sides are in doubt.
    sided = finding["side"] in ("left", "right")
    assert side == ([finding["side"].capitalize()] if sided else []), (side, finding["side"])
assert len(uids) == len(wanted)

seg = highdicom.seg.segread(folder + "/finding-segments.dcm")
names = [s.SegmentLabel for s in seg.SegmentSequence]
assert len(names) == 5 and names[1] == "b" and names[2] == "Thick?", names
assert {s.SegmentAlgorithmType for s in seg.SegmentSequence} == {"MANUAL"}
slices = {s.SOPInstanceUID: s for s in map(pydicom.dcmread, glob.glob(folder + "/slice-*.dcm"))}
uids = sorted(slices, key=lambda uid: slices[uid].ImagePositionPatient[2])
planes = seg.get_pixels_by_source_instance(uids, ignore_spatial_locations=True, assert_missing_frames_are_empty=True)

raw = gzip.open(folder + "/labels.nii.gz").read()
offset = int(struct.unpack("<f", raw[108:112])[0])
assert raw[348] == 1 and offset % 16 == 0
size, code = struct.unpack("<2i", raw[352:360])
comment = raw[360:352 + size].rstrip(b"\0").decode()
assert code == 6 and offset == 352 + size and comment.splitlines()[1:3] == ["2 b", "3 Thick?"], comment
x, y, z = struct.unpack("<3h", raw[42:48])
labels = numpy.frombuffer(raw[offset:], "<u2").reshape(z, y, x)
srow = numpy.vstack([numpy.frombuffer(raw[280:328], "<f4").reshape(3, 4), [0, 0, 0, 1]])
affine = numpy.diag([-1, -1, 1, 1]) @ srow
assert set(numpy.unique(labels)) == {0, 1, 2, 3, 4, 5}
# The frames have the voxels of the labels, each at its place in the patient, whatever the order of slices and rows.
def places(mask, to_patient):
    index = numpy.argwhere(mask)[:, ::-1]
    points = (to_patient @ numpy.c_[index, numpy.ones(len(index))].T).T[:, :3]
    return {tuple(p) for p in numpy.round(points, 2) + 0.0}
frames = {}
for number in range(1, 6):
    frames[number] = of_frames = set()
    for k, uid in enumerate(uids):
        s = slices[uid]
        o = numpy.array(s.ImageOrientationPatient, float)
        m = numpy.eye(4)
        m[:3, 0] = o[:3] * s.PixelSpacing[1]
        m[:3, 1] = o[3:] * s.PixelSpacing[0]
        m[:3, 3] = s.ImagePositionPatient
        of_frames |= places(planes[k, :, :, number - 1][None] > 0, m)
    for point in wanted[number - 1]["points_in_patient"]:
        near = min(numpy.linalg.norm(numpy.array(p) - point) for p in of_frames)
        # The voxel that holds the point: no further than half its diagonal.
        assert near <= numpy.linalg.norm(affine[:3, :3].sum(axis=1)) / 2 + 0.02, (number, near)
    # What was marked on the left is on the left: x grows to the patient's left.
    side = numpy.mean([p[0] for p in of_frames]) - wanted_middle
    marked = numpy.mean([p[0] for p in wanted[number - 1]["points_in_patient"]]) - wanted_middle
    assert abs(marked) < 5 or (marked > 0) == (side > 0), (number, marked, side, wanted[number - 1]["side"])
for number in range(1, 6):
    # Where findings overlap, the later label is seen.
    later = set().union(*(frames[n] for n in frames if n > number))
    assert places(labels == number, affine) == frames[number] - later, number

document = pydicom.dcmread(folder + "/report.dcm")
assert document.file_meta.MediaStorageSOPClassUID == document.SOPClassUID == pydicom.uid.EncapsulatedPDFStorage
assert document.Modality == "DOC" and document.MIMETypeOfEncapsulatedDocument == "application/pdf"
assert document.EncapsulatedDocument[:document.EncapsulatedDocumentLength] == open(folder + "/report.pdf", "rb").read()
assert len(document.EncapsulatedDocument) - document.EncapsulatedDocumentLength in (0, 1)
assert {s.ReferencedSOPInstanceUID for s in document.SourceInstanceSequence} == set(uids)
assert document.StudyInstanceUID == "1.2.3" and document.PatientID == "P-77" and document.BurnedInAnnotation == "YES"
print("compared", len(groups))
"#;
    let output = Command::new(python)
        .args(["-c", script])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(String::from_utf8_lossy(&output.stdout).contains("compared 6"));
}

/// The patient's name is on the report only where it was asked for, and never in what was not.
#[tokio::test]
async fn a_report_names_the_patient_on_request_alone() {
    let neighbour = Neighbour::start(|_| {}).await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    mark(server, &case).await;
    let report = async |query: &str, kind: &str| {
        let accept = [("accept", kind)];
        let address = format!("{case}/report?{query}");
        let answer = server.get_with(&address, &accept).await;
        assert_eq!(answer.status, 200, "{answer:?}");
        // No cache may store a patient.
        let cached = match query {
            "patient=true" => "no-store",
            _ => "private, no-cache",
        };
        assert_eq!(answer.header("cache-control"), cached, "{address}");
        answer.body
    };
    let identity = ["Müller, Änne", "P-77", "1967-03-12", "A-1"];
    let [plain, named] = [
        report("patient=false", "text/html").await,
        report("patient=true", "text/html").await,
    ]
    .map(|body| String::from_utf8(body.to_vec()).unwrap());
    // Line, polygon and trajectory.
    for measure in ["10.4 mm<", "144 mm²<", "17.7 mm<"] {
        assert!(plain.contains(measure), "{measure}");
    }
    for text in identity {
        assert!(!plain.contains(text), "{text}");
        assert_eq!(named.matches(text).count(), 1, "{text}");
    }
    let [plain, named] = [
        report("", "application/pdf").await,
        report("patient=true", "application/pdf").await,
    ];
    assert_ne!(plain, named);
    let folder = tempfile::tempdir().unwrap();
    let text = |name: &str, pdf: &[u8]| {
        let file = folder.path().join(name);
        std::fs::write(&file, pdf).unwrap();
        printed("pdftotext", &[Path::new("-layout"), &file, Path::new("-")])
    };
    let (Some(plain), Some(named)) = (text("plain.pdf", &plain), text("named.pdf", &named)) else {
        return;
    };
    for text in identity {
        assert!(
            !plain.contains(text) && named.contains(text),
            "{text}: {named}"
        );
    }
    let pages = named.split_terminator('\u{c}');
    for page in pages.clone() {
        assert!(
            page.contains("For research use only. Not for diagnosis."),
            "{page}"
        );
    }
    let count = pages.count();
    // pdftotext takes a number that is divided by one as a word.
    let numbered = named.replace(' ', "");
    assert!(numbered.contains(&format!("{count}/{count}")), "{named}");
    // What a reader wrote in letters that the font has, and in others.
    assert!(
        named.contains("Borrão à esquerda \\ ‹U+7070›‹U+767D›‹U+8D28›"),
        "{named}"
    );
    assert!(
        named.contains("A character that the font of this file lacks"),
        "{named}"
    );
}

/// The triangles of a binary STL.
fn facets(file: &[u8]) -> Vec<[glam::DVec3; 3]> {
    let number = |at: usize| f32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let corner = |at: usize| glam::vec3(number(at), number(at + 4), number(at + 8)).as_dvec3();
    let count = u32::from_le_bytes(file[80..84].try_into().unwrap()) as usize;
    assert_eq!(file.len(), 84 + 50 * count);
    let starts = (0..count).map(|facet| 84 + 50 * facet);
    starts
        .map(|at| [12, 24, 36].map(|offset| corner(at + offset)))
        .collect()
}

#[tokio::test]
async fn findings_are_balls_and_tubes_where_they_were_marked() {
    let server = Server::start().await;
    let case = server.plain_case().await;
    let address = format!("{case}/findings");
    let accept = [("accept", "model/stl")];
    let empty = server.get_with(&address, &accept).await;
    assert_eq!(
        (empty.status.as_u16(), empty.problem()),
        (409, "no-findings".to_owned())
    );
    let stored = mark(&server, &case).await;
    let answer = server.get_with(&address, &accept).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    assert_eq!(answer.header("content-type"), "model/stl");
    let name = "attachment; filename=\"findings.stl\"";
    assert_eq!(answer.header("content-disposition"), name);
    let header = String::from_utf8_lossy(&answer.body[..80]).into_owned();
    assert!(
        header.contains("SPACE=LPS;UNIT=mm;RADIUS=1.500"),
        "{header}"
    );

    // What was dismissed is left out: it is the mirror image of the first finding.
    let list = stored["findings"].as_array().unwrap();
    let points = |finding: &Value| -> Vec<glam::DVec3> {
        let points: Vec<[f64; 3]> =
            serde_json::from_value(finding["points_in_patient"].clone()).unwrap();
        points.into_iter().map(glam::DVec3::from_array).collect()
    };
    let mut lines = Vec::new();
    for finding in list.iter().filter(|one| one["is_dismissed"] == false) {
        let mut points = points(finding);
        if finding["kind"] == "polygon" {
            points.push(points[0]);
        }
        lines.extend(match points[..] {
            [point] => vec![[point, point]],
            _ => points.windows(2).map(|pair| [pair[0], pair[1]]).collect(),
        });
    }
    let distance = |[from, to]: &[glam::DVec3; 2], at: glam::DVec3| {
        let along = *to - *from;
        let share = (at - *from).dot(along) / along.length_squared().max(1e-9);
        (*from + along * share.clamp(0.0, 1.0)).distance(at)
    };
    let facets = facets(&answer.body);
    for &corner in facets.iter().flatten() {
        let distances = lines.iter().map(|line| distance(line, corner));
        let nearest = distances.fold(f64::INFINITY, f64::min);
        assert!(nearest < 1.501, "{corner:?} is {nearest} mm off");
    }
    for line in &lines {
        let is_around = |facet: &[glam::DVec3; 3]| {
            let far = facet.map(|corner| distance(line, corner));
            far.iter().all(|far| (far - 1.5).abs() < 0.001)
        };
        assert!(facets.iter().any(is_around), "{line:?}");
    }
    let dismissed = points(&list[5])[0];
    let mut corners = facets.iter().flatten();
    assert!(corners.all(|corner| corner.distance(dismissed) > 3.0));
}
