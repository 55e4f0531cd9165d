//! What named readers conclude: nobody sees it before both have signed, and nobody changes what is signed.

use access::auth::{Access, unnamed};
use access::scopes::Scope;
use access::tokens::{Holder, NamedToken};
use axum::http::Method;
use case::CaseId;
use serde_json::{Value, json};

use super::findings::{place, point};
use super::server::{Answer, Server};

pub(super) const ANA: &str = "Bearer token-of-ana-000";
pub(super) const BEN: &str = "Bearer token-of-ben-000";
pub(super) const VIEWER: &str = "Bearer token-of-viewer-";
pub(super) const NOBODY: &str = "Bearer token-of-nobody-";

/// A server with a case for two readers, one who may only look, and those who share a token without a name; and a finding on the left.
pub(super) async fn with_readers() -> (Server, String, Value) {
    let (server, case) = Server::with_case().await;
    let at = place(&server, &case, 20.0).await;
    let named = |name: &str, bearer: &str, scopes: &[Scope]| NamedToken {
        holder: Holder {
            name: name.into(),
            scopes: scopes.iter().copied().collect(),
        },
        ..unnamed(&bearer["Bearer ".len()..]).unwrap()
    };
    let tokens = vec![
        named("ana", ANA, &[Scope::Read, Scope::Write]),
        named("ben", BEN, &[Scope::Read, Scope::Write]),
        named("viewer", VIEWER, &[Scope::Read]),
        unnamed(&NOBODY["Bearer ".len()..]).unwrap(),
    ];
    let server = server.opened_to(Access::with_tokens(tokens));
    (server, case, point("a", &at))
}

pub(super) async fn get(server: &Server, who: &str, address: &str) -> Answer {
    server.get_with(address, &[("authorization", who)]).await
}

async fn put(server: &Server, who: &str, case: &str, tag: &str, reading: &Value) -> Answer {
    let address = format!("{case}/readings/mine");
    let headers = [("authorization", who), ("if-match", tag)];
    let body = reading.to_string();
    server.ask(Method::PUT, &address, &headers, body).await
}

async fn sign(server: &Server, who: &str, case: &str, tag: &str) -> Answer {
    let address = format!("{case}/readings/mine/signature");
    let headers = [("authorization", who), ("if-match", tag)];
    server.ask(Method::POST, &address, &headers, "").await
}

/// Closes a case, as a correction of its images does.
async fn close(server: &Server, case: &str) {
    let id = CaseId::parse(case.rsplit('/').next().unwrap()).unwrap();
    let (mut transaction, _) = server.cases.store().write().await.unwrap();
    let close = "UPDATE cases SET closed = 1 WHERE id = $1";
    let closed = transaction.execute(close, storage::args![id.to_string()]);
    closed.await.unwrap();
    transaction.commit().await.unwrap();
}

/// Keeps a reading that was not begun.
async fn begun(server: &Server, who: &str, case: &str, reading: &Value) -> Answer {
    let none = get(server, who, &format!("{case}/readings/mine")).await;
    assert_eq!(none.status, 200, "{none:?}");
    assert_eq!(none.json()["conclusion"], "");
    let kept = put(server, who, case, none.header("etag"), reading).await;
    assert_eq!(kept.status, 200, "{kept:?}");
    kept
}

#[tokio::test]
async fn a_signed_version_stays_and_a_correction_is_the_next() {
    let (server, case, finding) = with_readers().await;
    let address = format!("{case}/readings/mine");
    let reading =
        json!({ "conclusion": "Thick gyrus <left>\nelse nothing", "findings": [finding] });
    let kept = begun(&server, ANA, &case, &reading).await;
    let shown = kept.json();
    assert_eq!(
        (&shown["reader"], &shown["version"], &shown["state"]),
        (&json!("ana"), &json!(1), &json!("open"))
    );
    assert_eq!(shown["conclusion"], reading["conclusion"]);
    assert_eq!(shown["findings"][0]["side"], "left");
    let read = get(&server, ANA, &address).await;
    assert_eq!(
        (read.json(), read.header("etag")),
        (shown, kept.header("etag"))
    );

    let late = put(
        &server,
        ANA,
        &case,
        "\"00000000000000000000000000000000\"",
        &reading,
    )
    .await;
    assert_eq!(late.refusal(), (412, "reading-changed".to_owned()));
    assert_eq!(late.json()["conclusion"], reading["conclusion"]);
    assert_eq!(late.header("etag"), kept.header("etag"));

    let signed = sign(&server, ANA, &case, kept.header("etag")).await;
    assert_eq!(signed.status, 200, "{signed:?}");
    assert_eq!(
        (&signed.json()["version"], &signed.json()["state"]),
        (&json!(1), &json!("signed"))
    );
    assert!(signed.json()["signed_at"].is_string());
    assert_ne!(signed.header("etag"), kept.header("etag"));
    let again = sign(&server, ANA, &case, signed.header("etag")).await;
    assert_eq!(again.refusal(), (409, "reading-signed".to_owned()));
    // Who does not know that it is signed changes nothing.
    let other = json!({ "conclusion": "Nothing", "findings": [] });
    let late = put(&server, ANA, &case, kept.header("etag"), &other).await;
    assert_eq!(late.refusal(), (412, "reading-changed".to_owned()));

    let next = put(&server, ANA, &case, signed.header("etag"), &other).await;
    assert_eq!(
        (&next.json()["version"], &next.json()["state"]),
        (&json!(2), &json!("open"))
    );
    let first = get(&server, ANA, &format!("{case}/readings/by/ana?version=1")).await;
    assert_eq!(first.json(), signed.json());
    let list = get(&server, ANA, &format!("{case}/readings")).await.json();
    let states: Vec<_> = (0..2)
        .map(|at| list["readings"][at]["state"].clone())
        .collect();
    assert_eq!(states, ["signed", "open"]);
}

#[tokio::test]
async fn a_second_reader_sees_the_first_ones_reading_once_both_have_signed() {
    let (server, case, finding) = with_readers().await;
    let reading = json!({ "conclusion": "A secret conclusion", "findings": [finding] });
    let of_ana = begun(&server, ANA, &case, &reading).await;
    let address = format!("{case}/readings/by/ana");
    let hidden = (409, "reading-hidden".to_owned());
    assert_eq!(get(&server, BEN, &address).await.refusal(), hidden);
    let signed = sign(&server, ANA, &case, of_ana.header("etag")).await;
    let list_address = format!("{case}/readings");
    for who in [BEN, VIEWER, NOBODY] {
        let list = get(&server, who, &list_address).await;
        let listed = &list.json()["readings"][0];
        assert_eq!(
            (&listed["reader"], &listed["state"]),
            (&json!("ana"), &json!("signed"))
        );
        assert_eq!(
            (&listed["is_mine"], &listed["is_shown"]),
            (&json!(false), &json!(false))
        );
        assert!(!String::from_utf8_lossy(&list.body).contains("secret"));
        for address in [&address, &format!("{address}?version=1")] {
            assert_eq!(get(&server, who, address).await.refusal(), hidden, "{who}");
        }
    }
    // Its reading alone is not enough.
    let own = json!({ "conclusion": "Another one", "findings": [] });
    let of_ben = begun(&server, BEN, &case, &own).await;
    assert_eq!(get(&server, BEN, &address).await.refusal(), hidden);
    sign(&server, BEN, &case, of_ben.header("etag")).await;
    assert_eq!(get(&server, BEN, &address).await.json(), signed.json());
    // What Ana has not signed is hers alone.
    let correction = json!({ "conclusion": "A draft", "findings": [] });
    put(&server, ANA, &case, signed.header("etag"), &correction).await;
    assert_eq!(get(&server, BEN, &address).await.json(), signed.json());
    let draft = get(&server, BEN, &format!("{address}?version=2")).await;
    assert_eq!(draft.refusal(), (404, "no-such-reading".to_owned()));
    let unknown = get(&server, BEN, &format!("{case}/readings/by/carla")).await;
    assert_eq!(unknown.refusal(), (404, "no-such-reading".to_owned()));
}

#[tokio::test]
async fn a_report_of_a_reading_is_shown_to_whoever_is_shown_the_reading() {
    let (server, case, finding) = with_readers().await;
    let report = format!("{case}/report");
    let before = get(&server, ANA, &report).await;
    assert_eq!(before.status, 200, "{before:?}");
    let reading = json!({ "conclusion": "Thick\n<b>left</b>", "findings": [finding] });
    let kept = begun(&server, ANA, &case, &reading).await;
    let of_ana = format!("{report}?reading=ana");
    let open = get(&server, ANA, &of_ana).await;
    let open = String::from_utf8_lossy(&open.body).into_owned();
    for text in [
        "<bdi>Thick</bdi>",
        "<bdi>&lt;b&gt;left&lt;/b&gt;</bdi>",
        "<h2>Finding 1: ",
    ] {
        assert!(open.contains(text), "{text}");
    }
    assert!(!open.contains("Signed by"));
    sign(&server, ANA, &case, kept.header("etag")).await;
    let signed = get(&server, ANA, &of_ana).await;
    let signed = String::from_utf8_lossy(&signed.body).into_owned();
    assert!(signed.contains("Signed by <bdi>ana</bdi> on 20"));
    for who in [BEN, VIEWER, NOBODY] {
        let hidden = get(&server, who, &of_ana).await;
        assert_eq!(hidden.refusal(), (409, "reading-hidden".to_owned()));
        let file = get(&server, who, &format!("{case}/share?reading=ana")).await;
        assert_eq!(file.refusal(), (409, "reading-hidden".to_owned()));
    }
    let file = get(&server, ANA, &format!("{case}/share?reading=ana")).await;
    assert_eq!(file.status, 200);
    let file = String::from_utf8_lossy(&file.body).into_owned();
    assert!(file.contains("Signed by <bdi>ana</bdi> on "));
    // The report of the case knows nothing of it.
    let after = get(&server, BEN, &report).await;
    assert_eq!((after.status, after.body), (200, before.body));
}

#[tokio::test]
async fn who_has_no_name_keeps_and_signs_nothing() {
    let (server, case, _) = with_readers().await;
    let reading = json!({ "conclusion": "Somebody's", "findings": [] });
    let unnamed = (403, "reader-unnamed".to_owned());
    let mine = get(&server, NOBODY, &format!("{case}/readings/mine")).await;
    assert_eq!(mine.refusal(), unnamed);
    let kept = put(&server, NOBODY, &case, "\"a\"", &reading).await;
    assert_eq!(kept.refusal(), unnamed);
    assert_eq!(
        sign(&server, NOBODY, &case, "\"a\"").await.refusal(),
        unnamed
    );
    assert_eq!(
        get(&server, NOBODY, &format!("{case}/findings"))
            .await
            .status,
        200
    );
    let viewed = put(&server, VIEWER, &case, "\"a\"", &reading).await;
    assert_eq!(viewed.refusal().0, 403);
    let list = get(&server, NOBODY, &format!("{case}/readings")).await;
    assert_eq!(list.json(), json!({ "readings": [] }));
}

#[tokio::test]
async fn a_reading_that_is_emptied_leaves_the_case_as_it_was() {
    let (server, case, finding) = with_readers().await;
    let status = async || {
        let headers = [("authorization", ANA)];
        let body = json!({ "patients": false }).to_string();
        let found = server
            .ask(Method::POST, "/v1/cases/search", &headers, body)
            .await;
        found.json()["cases"][0]["status"].clone()
    };
    let full = json!({ "conclusion": "Thick", "findings": [finding] });
    let empty = json!({ "conclusion": " \n", "findings": [] });
    let kept = begun(&server, ANA, &case, &full).await;
    assert_eq!(status().await, "begun");
    let emptied = put(&server, ANA, &case, kept.header("etag"), &empty).await;
    assert_eq!(emptied.json()["conclusion"], "");
    assert_eq!(status().await, "new");
    let kept = put(&server, ANA, &case, emptied.header("etag"), &full).await;
    let signed = sign(&server, ANA, &case, kept.header("etag")).await;
    let correction = put(&server, ANA, &case, signed.header("etag"), &full).await;
    assert_eq!(status().await, "begun");
    let emptied = put(&server, ANA, &case, correction.header("etag"), &empty).await;
    assert_eq!(status().await, "signed");
    // The signed version counts again, and the correction is still there to be written.
    let counts = get(&server, ANA, &format!("{case}/readings/by/ana")).await;
    assert_eq!(counts.json(), signed.json());
    let report = get(&server, ANA, &format!("{case}/report?reading=ana")).await;
    let report = String::from_utf8_lossy(&report.body).into_owned();
    assert!(report.contains("<bdi>Thick</bdi>") && report.contains("Signed by <bdi>ana</bdi>"));
    let mine = get(&server, ANA, &format!("{case}/readings/mine")).await;
    assert_eq!(
        (mine.json(), mine.header("etag")),
        (emptied.json(), emptied.header("etag"))
    );
}

#[tokio::test]
async fn a_template_is_kept_reported_and_written_as_a_row() {
    let (server, case, _) = with_readers().await;
    let template =
        json!({ "side": "left", "lobe": "temporal", "blur": "present", "certainty": "probable" });
    let reading = json!({ "conclusion": "Thick, \"left\"", "findings": [], "template": template });
    let kept = begun(&server, ANA, &case, &reading).await;
    assert_eq!(kept.json()["template"], template);
    let headers = [("authorization", ANA), ("accept", "text/csv")];
    let address = format!("{case}/readings/by/ana");
    let row = server.get_with(&address, &headers).await;
    assert_eq!(row.header("content-type"), "text/csv; charset=utf-8");
    assert_eq!(
        String::from_utf8_lossy(&row.body),
        "reader,version,signed_at,conclusion,side,lobe,gyrus,blur,thickening,transmantle,flair,sulcal_bottom,certainty\r\n\
         \"ana\",1,,\"Thick, \"\"left\"\"\",left,temporal,,present,,,,,probable\r\n"
    );
    // Fixed words alone are a conclusion, too.
    let alone = json!({ "conclusion": "", "findings": [], "template": { "side": "right" } });
    let kept = put(&server, ANA, &case, kept.header("etag"), &alone).await;
    let signed = sign(&server, ANA, &case, kept.header("etag")).await;
    assert_eq!(signed.status, 200, "{signed:?}");
    let report = format!("{case}/report?reading=ana&language=pt-BR");
    let report = get(&server, ANA, &report).await;
    let report = String::from_utf8_lossy(&report.body).into_owned();
    assert!(report.contains("<th>Lateralidade</th><td>Direita</td>"));
    let wrong = json!({ "conclusion": "", "findings": [], "template": { "side": "middle" } });
    let wrong = put(&server, ANA, &case, signed.header("etag"), &wrong).await;
    assert_eq!(wrong.refusal(), (400, "body-unreadable".to_owned()));
}

#[tokio::test]
async fn nobody_writes_into_the_reading_of_another_one_on_the_same_page() {
    let (server, case, _) = with_readers().await;
    let address = format!("{case}/readings/mine");
    let of_ana = get(&server, ANA, &address).await;
    let reading = json!({ "conclusion": "of Ana", "findings": [] });
    let refused = put(&server, BEN, &case, of_ana.header("etag"), &reading).await;
    assert_eq!(refused.refusal(), (412, "reading-changed".to_owned()));
}

#[tokio::test]
async fn whose_name_nobody_can_read_signs_nothing() {
    let (server, case, _) = with_readers().await;
    let digest = "proxy:0123456789abcdef0123456789abcdef";
    let bearer = "Bearer token-of-digest-";
    let token = NamedToken {
        holder: Holder {
            name: digest.into(),
            scopes: [Scope::Read, Scope::Write].into(),
        },
        ..unnamed(&bearer["Bearer ".len()..]).unwrap()
    };
    let server = server.opened_to(Access::with_tokens(vec![token]));
    let reading = json!({ "conclusion": "Thick", "findings": [] });
    let kept = begun(&server, bearer, &case, &reading).await;
    let signed = sign(&server, bearer, &case, kept.header("etag")).await;
    assert_eq!(signed.refusal(), (403, "reader-unnamed".to_owned()));
    let detail = signed.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("proxy.user_header"), "{detail}");
}

#[tokio::test]
async fn what_cannot_be_signed_is_refused() {
    let (server, case, finding) = with_readers().await;
    let none = get(&server, ANA, &format!("{case}/readings/mine")).await;
    let tag = none.header("etag");
    let nothing = sign(&server, ANA, &case, tag).await;
    assert_eq!(nothing.refusal(), (400, "reading-invalid".to_owned()));
    let headers = [("authorization", ANA)];
    let address = format!("{case}/readings/mine/signature");
    let blind = server.ask(Method::POST, &address, &headers, "").await;
    assert_eq!(blind.refusal(), (428, "if-match-missing".to_owned()));
    let mut elsewhere = finding.clone();
    elsewhere["points_in_patient"] = json!([[1e9, 0, 0]]);
    for (reading, parameter) in [
        (
            json!({ "conclusion": "x".repeat(10_001), "findings": [] }),
            "conclusion",
        ),
        (
            json!({ "conclusion": "\u{7}", "findings": [] }),
            "conclusion",
        ),
        (
            json!({ "conclusion": "", "findings": [elsewhere] }),
            "findings[0].points_in_patient[0]",
        ),
    ] {
        let refused = put(&server, ANA, &case, tag, &reading).await;
        assert_eq!(refused.refusal(), (400, "reading-invalid".to_owned()));
        assert_eq!(refused.parameter(), parameter);
    }
    let unread = put(&server, ANA, &case, tag, &json!({ "findings": [] })).await;
    assert_eq!(unread.refusal(), (400, "body-unreadable".to_owned()));
    let blank = json!({ "conclusion": " \n", "findings": [] });
    let blank = begun(&server, ANA, &case, &blank).await;
    let signed = sign(&server, ANA, &case, blank.header("etag")).await;
    assert_eq!(signed.refusal(), (400, "reading-invalid".to_owned()));

    // A closed case is read and written about, and nobody signs it.
    let reading = json!({ "conclusion": "Nothing", "findings": [] });
    let kept = put(&server, ANA, &case, blank.header("etag"), &reading).await;
    close(&server, &case).await;
    let signed = sign(&server, ANA, &case, kept.header("etag")).await;
    assert_eq!(signed.refusal(), (409, "closed".to_owned()));
    let read = get(&server, ANA, &format!("{case}/readings/mine")).await;
    assert_eq!(read.json(), kept.json());
}

#[tokio::test]
async fn what_is_signed_of_a_closed_case_is_not_corrected() {
    let (server, case, _) = with_readers().await;
    let reading = json!({ "conclusion": "Thick", "findings": [] });
    let kept = begun(&server, ANA, &case, &reading).await;
    let signed = sign(&server, ANA, &case, kept.header("etag")).await;
    close(&server, &case).await;
    let correction = put(&server, ANA, &case, signed.header("etag"), &reading).await;
    assert_eq!(correction.refusal(), (409, "closed".to_owned()));
    let read = get(&server, ANA, &format!("{case}/readings/mine")).await;
    assert_eq!(read.json(), signed.json());
}
