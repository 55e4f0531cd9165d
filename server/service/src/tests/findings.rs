//! What readers mark and write: kept as it was sent, and never lost to somebody else's change.

use std::time::Duration;

use axum::http::Method;
use cases::jobs::start_workers;
use serde_json::{Value, json};

use super::server::{Answer, Server, head};

async fn put(server: &Server, case: &str, tag: &str, findings: &Value) -> Answer {
    let address = format!("{case}/findings");
    let body = json!({ "findings": findings }).to_string();
    let tag = [("if-match", tag)];
    server.ask(Method::PUT, &address, &tag, body).await
}

/// A point in the head, `left_mm` to the left of its middle.
pub(super) async fn place(server: &Server, case: &str, left_mm: f64) -> Value {
    let case = server.get(case).await.json();
    let centre = &case["envelope_sphere"]["center_in_patient"];
    let at = |axis: usize| centre[axis].as_f64().unwrap();
    json!([at(0) + left_mm, at(1), at(2)])
}

pub(super) fn point(id: &str, at: &Value) -> Value {
    json!({
        "id": id, "kind": "point", "points_in_patient": [at], "depth_mm": 8.5,
        "label": "thick <b>gyrus</b>", "note": "one\ntwo", "certainty": "possible", "colour": "#00ff00",
        "from_map": "blur", "author": "A. Reader",
    })
}

#[tokio::test]
async fn findings_are_stored_with_their_sides_and_times() {
    let (server, case) = Server::with_case().await;
    let address = format!("{case}/findings");
    let none = server.get(&address).await;
    assert_eq!((none.status, none.json()), (200, json!({ "findings": [] })));
    assert_eq!(none.header("cache-control"), "private, no-cache");

    let left = place(&server, &case, 20.0).await;
    let right = place(&server, &case, -20.0).await;
    let middle = place(&server, &case, 1.0).await;
    let mut sent = json!([point("a", &left), point("b", &right), point("c", &middle)]);
    // A side that a client invents does not count.
    sent[0]["side"] = json!("right");
    let stored = put(&server, &case, none.header("etag"), &sent).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    let list = stored.json()["findings"].clone();
    let sides: Vec<_> = (0..3).map(|index| list[index]["side"].clone()).collect();
    assert_eq!(sides, ["left", "right", "middle"]);
    assert_eq!(list[0]["label"], "thick <b>gyrus</b>");
    assert_eq!(list[0]["points_in_patient"], json!([left]));
    assert_eq!(list[0]["created_at"], list[0]["changed_at"]);

    let read = server.get(&address).await;
    assert_eq!(
        (read.json(), read.header("etag")),
        (stored.json(), stored.header("etag"))
    );
    let known = [("if-none-match", read.header("etag"))];
    assert_eq!(server.get_with(&address, &known).await.status, 304);

    // What has not changed keeps its times; what is sent back as it was read is not refused.
    let mut next = list.clone();
    next[1]["note"] = json!("another note");
    let changed = put(&server, &case, read.header("etag"), &next).await;
    let after = changed.json()["findings"].clone();
    assert_eq!(
        (&after[0], &after[1]["note"]),
        (&list[0], &json!("another note"))
    );
    assert_eq!(after[1]["created_at"], list[1]["created_at"]);
    assert_ne!(after[1]["changed_at"], list[1]["changed_at"]);
}

#[tokio::test]
async fn nobody_undoes_what_somebody_else_wrote() {
    let (server, case) = Server::with_case().await;
    let at = place(&server, &case, 20.0).await;
    let none = server.get(&format!("{case}/findings")).await;
    let first = put(
        &server,
        &case,
        none.header("etag"),
        &json!([point("a", &at)]),
    )
    .await;
    assert_eq!(first.status, 200);
    let second = put(
        &server,
        &case,
        none.header("etag"),
        &json!([point("b", &at)]),
    )
    .await;
    assert_eq!(second.refusal(), (412, "findings-changed".to_owned()));
    assert_eq!(second.json()["findings"], first.json()["findings"]);
    assert_eq!(second.header("etag"), first.header("etag"));
    let both = json!([point("a", &at), point("b", &at)]);
    let merged = put(&server, &case, second.header("etag"), &both).await;
    assert_eq!(merged.status, 200);
    for tag in ["", "*", "nonsense", "W/\"abc"] {
        let answer = put(&server, &case, tag, &json!([])).await;
        assert_eq!(
            answer.refusal(),
            (428, "if-match-missing".to_owned()),
            "{tag}"
        );
    }
    let address = format!("{case}/findings");
    let without = server.ask(Method::PUT, &address, &[], r#"{"findings":[]}"#);
    assert_eq!(without.await.status, 428);
    assert_eq!(server.get(&address).await.json(), merged.json());
}

#[tokio::test]
async fn a_version_begins_with_a_copy() {
    let (server, case) = Server::with_case().await;
    let at = place(&server, &case, 20.0).await;
    let none = server.get(&format!("{case}/findings")).await;
    let stored = put(
        &server,
        &case,
        none.header("etag"),
        &json!([point("a", &at)]),
    )
    .await;
    let mask = format!("{case}/mask?closing_radius_mm=8");
    let made = server.ask(Method::PUT, &mask, &[], Vec::new()).await;
    let version = made.header("location").to_owned();
    let copy = server.get(&format!("{version}/findings")).await;
    assert_eq!(copy.json(), stored.json());
    let workers = start_workers(server.cases.library.clone(), 1);
    assert_eq!(server.settled(&version).await, "ready");
    workers.shut_down(Duration::from_secs(60)).await;
    let emptied = put(&server, &version, copy.header("etag"), &json!([])).await;
    assert_eq!(emptied.status, 200);
    assert_eq!(
        server.get(&format!("{case}/findings")).await.json(),
        stored.json()
    );
}

#[tokio::test]
async fn the_commissures_are_axes_for_findings_and_no_finding() {
    let (server, case) = Server::with_case().await;
    let middle = place(&server, &case, 0.0).await;
    let at = |[left, back, up]: [f64; 3]| {
        let of = |axis: usize| middle[axis].as_f64().unwrap();
        json!([of(0) + left, of(1) + back, of(2) + up])
    };
    let [front, back] = [[0.0, -13.0, 0.0], [0.0, 13.0, 0.0]].map(at);
    let axes = |points: Value| json!({ "id": "x", "kind": "acpc", "points_in_patient": points, "depth_mm": 9 });
    let none = server.get(&format!("{case}/findings")).await;
    for wrong in [
        axes(json!([back, front])),
        axes(json!([front])),
        axes(json!([front, at([0.0, -10.0, 0.0])])),
    ] {
        let refused = put(&server, &case, none.header("etag"), &json!([wrong])).await;
        assert_eq!(refused.refusal(), (400, "findings-invalid".to_owned()));
        assert_eq!(refused.parameter(), "findings[0].points_in_patient");
    }
    let set = axes(json!([front, back]));
    let mut second = set.clone();
    second["id"] = json!("y");
    let twice = json!([set, second]);
    let refused = put(&server, &case, none.header("etag"), &twice).await;
    assert_eq!(refused.parameter(), "findings[1].kind");

    let left = at([20.0, -5.0, 7.0]);
    let both = json!([point("a", &left), set]);
    let stored = put(&server, &case, none.header("etag"), &both).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    let stated = stored.json()["findings"][0]["standard"]["ac_pc"].clone();
    for (axis, mm) in [-20.0, 5.0, 7.0].into_iter().enumerate() {
        assert!(
            (stated[axis].as_f64().unwrap() - mm).abs() < 1.5,
            "{stated}"
        );
    }
    let csv = [("accept", "text/csv")];
    let csv = server.get_with(&format!("{case}/findings"), &csv).await;
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let stated = [0, 1, 2].map(|axis| stated[axis].to_string());
    let row = text.lines().nth(2).unwrap();
    assert!(row.ends_with(&format!(",,,{}", stated.join(" "))), "{text}");
}

#[tokio::test]
async fn findings_come_as_csv_that_no_spreadsheet_computes() {
    let (server, case) = Server::with_case().await;
    let at = place(&server, &case, 20.0).await;
    let none = server.get(&format!("{case}/findings")).await;
    let mut line = point("a", &at);
    line["kind"] = json!("line");
    line["points_in_patient"] = json!([at, place(&server, &case, 22.0).await]);
    line["label"] = json!("=1+\"2\"");
    let mut findings = vec![line];
    // A spreadsheet may compute what is written in full width, too.
    let signs = ["+", "-", "@", "＝", "＋", "－", "＠"];
    for (number, sign) in signs.iter().enumerate() {
        let mut one = point(&format!("b{number}"), &at);
        one["label"] = json!(format!("{sign}1"));
        findings.push(one);
    }
    put(&server, &case, none.header("etag"), &json!(findings)).await;
    let accept = [("accept", "text/csv")];
    let csv = server.get_with(&format!("{case}/findings"), &accept).await;
    assert_eq!(csv.header("content-type"), "text/csv; charset=utf-8");
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let rows: Vec<_> = text.split("\r\n").collect();
    assert_eq!(rows.len(), 11, "{text}");
    for (row, sign) in rows[3..].iter().zip(signs) {
        assert!(row.contains(&format!("\"'{sign}1\"")), "{row}");
    }
    assert!(rows[0].starts_with("finding,kind,point,left_mm,"));
    assert!(rows[2].starts_with("a,line,2,"), "{text}");
    assert!(
        rows[1].contains(",left,possible,false,blur,\"'=1+\"\"2\"\"\",\"one\ntwo\","),
        "{text}"
    );
}

#[tokio::test]
async fn what_cannot_be_a_finding_is_refused_with_its_place() {
    let (server, case) = Server::with_case().await;
    let at = place(&server, &case, 20.0).await;
    let none = server.get(&format!("{case}/findings")).await;
    let tag = none.header("etag");
    let with = |key: &str, value: Value| {
        let mut finding = point("a", &at);
        finding[key] = value;
        json!([finding])
    };
    for (findings, kind, parameter) in [
        (
            with("depth_mm", json!(-1)),
            "findings-invalid",
            "findings[0].depth_mm",
        ),
        (
            with("points_in_patient", json!([[1e9, 0, 0]])),
            "findings-invalid",
            "findings[0].points_in_patient[0]",
        ),
        (
            with("points_in_patient", json!([])),
            "findings-invalid",
            "findings[0].points_in_patient",
        ),
        (
            with("points_in_patient", json!([[0, 0]])),
            "body-unreadable",
            "findings[0].points_in_patient[0]",
        ),
        (
            with("points_in_patient", json!([[null, 0, 0]])),
            "body-unreadable",
            "findings[0].points_in_patient[0][0]",
        ),
        (
            with("kind", json!("circle")),
            "body-unreadable",
            "findings[0].kind",
        ),
        (
            with("certainty", json!("sure")),
            "body-unreadable",
            "findings[0].certainty",
        ),
        (
            with("colour", json!("red")),
            "findings-invalid",
            "findings[0].colour",
        ),
        (
            with("label", json!("\u{202e}abc")),
            "findings-invalid",
            "findings[0].label",
        ),
        (with("fruit", json!(1)), "body-unreadable", "findings[0]"),
        (
            json!([point("a", &at), point("a", &at)]),
            "findings-invalid",
            "findings[1].id",
        ),
        (json!("none"), "body-unreadable", "findings"),
    ] {
        let answer = put(&server, &case, tag, &findings).await;
        assert_eq!(answer.refusal(), (400, kind.to_owned()), "{findings}");
        assert_eq!(answer.parameter(), parameter, "{findings}");
    }
    let infinite = r#"{"findings":[{"id":"a","kind":"point","points_in_patient":[[1e999,0,0]],"depth_mm":1}]}"#;
    let address = format!("{case}/findings");
    let answer = server
        .ask(Method::PUT, &address, &[("if-match", tag)], infinite)
        .await;
    assert_eq!(answer.refusal(), (400, "body-unreadable".to_owned()));
    let large = with("note", json!("x".repeat(5 << 20)));
    let answer = put(&server, &case, tag, &large).await;
    assert_eq!(answer.refusal(), (413, "body-too-large".to_owned()));
    assert_eq!(server.get(&address).await.json(), json!({ "findings": [] }));
}

#[tokio::test]
async fn a_case_that_is_not_ready_has_findings_that_nobody_changes() {
    let server = Server::start().await;
    let (volume, mask) = head();
    let answer = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let case = answer.header("location").to_owned();
    let none = server.get(&format!("{case}/findings")).await;
    assert_eq!(none.json(), json!({ "findings": [] }));
    let refused = put(&server, &case, none.header("etag"), &json!([])).await;
    assert_eq!(refused.refusal(), (409, "case-not-ready".to_owned()));
    let missing = "/v1/cases/00000000000000000000000000000000/findings";
    assert_eq!(
        server.get(missing).await.refusal(),
        (404, "no-such-case".to_owned())
    );
}
