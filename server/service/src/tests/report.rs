//! The report of a reading: what a reader wrote, as text, with pictures and nothing from elsewhere.

use axum::http::Method;
use serde_json::json;

use super::server::{Server, head};

#[tokio::test]
async fn the_report_shows_what_was_marked_and_runs_nothing() {
    let (server, case) = Server::with_case().await;
    let none = server.get(&format!("{case}/findings")).await;
    let centre = server.get(&case).await.json()["envelope_sphere"]["center_in_patient"].clone();
    let at = |left_mm: f64| {
        let [x, y, z] = [0, 1, 2].map(|axis| centre[axis].as_f64().unwrap());
        json!([x + left_mm, y, z])
    };
    let finding = |id: &str, left_mm: f64, label: &str| {
        json!({
            "id": id, "kind": "point", "points_in_patient": [at(left_mm)], "depth_mm": 6.0, "label": label,
            "note": "</style></table><img src=x onerror=alert(1)>", "certainty": "probable",
        })
    };
    let mut dismissed = finding("c", -10.0, "nothing here");
    dismissed["is_dismissed"] = json!(true);
    let list = json!({ "findings": [
        finding("a", 25.0, "<script>alert(1)</script>"), finding("b", -25.0, "second"), dismissed,
    ] });
    let tag = [("if-match", none.header("etag"))];
    let address = format!("{case}/findings");
    let stored = server.ask(Method::PUT, &address, &tag, list.to_string());
    assert_eq!(stored.await.status, 200);

    let report = server.get(&format!("{case}/report")).await;
    assert_eq!(report.status, 200, "{:?}", report.headers);
    assert_eq!(report.header("content-type"), "text/html; charset=utf-8");
    assert!(
        report
            .header("content-security-policy")
            .starts_with("default-src 'none'; img-src data:")
    );
    let html = String::from_utf8(report.body.to_vec()).unwrap();
    assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
    for forbidden in ["<script", "<img src=x", "http://", "https://", "src=\"/"] {
        assert!(!html.contains(forbidden), "{forbidden}");
    }
    assert_eq!(html.matches("class=\"page finding\"").count(), 2);
    assert!(html.contains("<strong>left</strong>") && html.contains("<strong>right</strong>"));
    assert!(html.contains("left, as acquired") && html.contains("right, flipped"));
    assert!(html.contains("Looked at and dismissed") && html.contains("nothing here"));
    // What is flipped says so by its letters: a letter for each edge of each picture.
    assert_eq!(
        html.matches("</text>").count(),
        4 * html.matches("<image").count()
    );
    assert_eq!(
        html.matches("scale(-1 1)").count(),
        html.matches(", flipped</figcaption>").count()
    );
    // Each finding has its cut, the other side, three slices and the one across the sulcus; the overview has six views at four depths.
    let maps = if html.contains("There are no maps") {
        0
    } else {
        1
    };
    let pictures = html.matches("<image").count();
    assert_eq!(pictures, 2 * (2 + 2 * maps + 4) + 24 * (1 + maps));
    assert!(html.len() < 3_000_000, "{}", html.len());
    let known = [("if-none-match", report.header("etag"))];
    assert_eq!(
        server
            .get_with(&format!("{case}/report"), &known)
            .await
            .status,
        304
    );

    let portuguese = server.get(&format!("{case}/report?language=pt-BR")).await;
    let html = String::from_utf8(portuguese.body.to_vec()).unwrap();
    assert!(html.contains("lang=\"pt-BR\"") && html.contains("Examinados e descartados"));
    assert!(html.contains("Somente para pesquisa."));
}

#[tokio::test]
async fn a_report_that_cannot_be_made_says_why() {
    let server = Server::start().await;
    let (volume, mask) = head();
    let answer = server.upload(&[("volume", volume), ("mask", mask)]).await;
    let case = answer.header("location").to_owned();
    for (query, status, kind) in [
        ("", 409, "case-not-ready"),
        ("?language=fr", 400, "query-value-unreadable"),
        ("?patient=yes", 400, "query-value-unreadable"),
        ("?fruit=1", 400, "query-unknown-key"),
    ] {
        let answer = server.get(&format!("{case}/report{query}")).await;
        assert_eq!(answer.refusal(), (status, kind.to_owned()), "{query}");
    }
}
