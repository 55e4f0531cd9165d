//! Many pictures in one answer.

use std::io::{Cursor, Read as _};

use axum::body::Body;
use axum::http::{Request, StatusCode};
use cases::settings::GpuUse;
use serde_json::{Value, json};

use crate::head::plain_head;
use crate::server::{Answer, Server};

async fn server_and_case() -> (Server, String) {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = server.plain_case().await;
    (server, case)
}

async fn post(server: &Server, case: &str, accept: &str, body: impl Into<Body>) -> Answer {
    let request = Request::post(format!("{case}/renders"))
        .header("accept", accept)
        .header("content-type", "application/json");
    server.send(request.body(body.into()).unwrap()).await
}

async fn ask(server: &Server, case: &str, body: &Value) -> Answer {
    post(server, case, "*/*", body.to_string()).await
}

fn picture(depth_mm: f64, view: &str) -> Value {
    json!({"depth_mm": depth_mm, "view": view, "width": 160, "height": 160})
}

#[tokio::test]
async fn a_list_comes_as_a_zip_of_the_single_pictures() {
    let (server, case) = server_and_case().await;
    let mut splatted = picture(6.0, "right");
    splatted["renderer"] = "splat".into();
    splatted["window"] = json!([300, 400]);
    let body = json!({"renders": [picture(4.0, "left"), splatted]});
    let answer = ask(&server, &case, &body).await;
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    assert_eq!(answer.header("content-type"), "application/zip");
    assert_eq!(
        answer.header("x-isocortex-renderer"),
        "trace on cpu; splat on cpu"
    );
    let mut zip = zip::ZipArchive::new(Cursor::new(&answer.body)).unwrap();
    let singles = [
        ("000-left-4mm.png", "depth_mm=4&view=left"),
        (
            "001-right-6mm.png",
            "depth_mm=6&view=right&renderer=splat&window=300,400",
        ),
    ];
    assert_eq!(zip.len(), 2);
    for (name, query) in singles {
        let mut png = Vec::new();
        zip.by_name(name).unwrap().read_to_end(&mut png).unwrap();
        let single = server
            .get(&format!("{case}/render?{query}&width=160&height=160"))
            .await;
        assert_eq!(single.body, png, "{name}");
    }
}

#[tokio::test]
async fn a_sheet_has_each_picture_in_its_cell() {
    let (server, case) = server_and_case().await;
    let views = ["left", "anterior", "right"];
    let renders: Vec<_> = [2.0, 8.0]
        .into_iter()
        .flat_map(|depth| views.map(|view| picture(depth, view)))
        .collect();
    let answer = ask(&server, &case, &json!({"sheet": true, "renders": renders})).await;
    assert_eq!(answer.header("content-type"), "image/png");
    let sheet = answer.grey();
    let [left, top] = [sheet.width() - 3 * 160, sheet.height() - 2 * 160];
    for (row, depth) in [2, 8].into_iter().enumerate() {
        for (column, view) in views.into_iter().enumerate() {
            let address =
                format!("{case}/render?depth_mm={depth}&view={view}&width=160&height=160");
            let single = server.get(&address).await.grey();
            let [x, y] = [left + 160 * column as u32, top + 160 * row as u32];
            let cell = image::imageops::crop_imm(&sheet, x, y, 160, 160).to_image();
            assert!(cell == single, "{view} at {depth} mm");
        }
    }
    // The patient's right has a bright mark: seen from the front it is at the picture's left, in the sheet as well.
    let front = image::imageops::crop_imm(&sheet, left + 160, top, 160, 160).to_image();
    let bright = |range: std::ops::Range<u32>| -> u64 {
        let pixels = front.enumerate_pixels().filter(|(x, ..)| range.contains(x));
        pixels.map(|(.., pixel)| u64::from(pixel.0[0])).sum()
    };
    assert!(bright(0..80) > bright(80..160), "left is left");
}

#[tokio::test]
async fn a_sheet_holds_the_state_of_each_of_its_pictures() {
    let (server, case) = server_and_case().await;
    let renders = [
        picture(2.0, "left"),
        picture(2.0, "right"),
        picture(8.5, "left"),
    ];
    let answer = ask(&server, &case, &json!({"sheet": true, "renders": renders})).await;
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let reader = png::Decoder::new(Cursor::new(&answer.body))
        .read_info()
        .unwrap();
    let state = |name: &str| -> Value {
        let texts = &reader.info().uncompressed_latin1_text;
        let text = texts.iter().find(|text| text.keyword == name).unwrap();
        serde_json::from_str(&text.text).unwrap()
    };
    for (name, depth) in [
        ("row 1 column 1", "2"),
        ("row 1 column 2", "2"),
        ("row 2 column 1", "8.5"),
    ] {
        assert_eq!(state(name)["depth_mm"], depth, "{name}");
        assert_eq!(state(name)["renderer"], "trace", "{name}");
    }
    let orientation = |name| state(name)["orientation"].clone();
    assert_ne!(orientation("row 1 column 1"), orientation("row 1 column 2"));
}

#[tokio::test]
async fn the_same_pictures_have_the_same_tag_and_others_another() {
    let (server, case) = server_and_case().await;
    let tag = async |body: &Value| {
        let answer = ask(&server, &case, body).await;
        assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
        answer.header("etag").to_owned()
    };
    let one = json!({"renders": [picture(2.0, "left")]});
    let first = tag(&one).await;
    assert!(first.len() > 10);
    let mut spelled = picture(2.0, "left");
    spelled["zoom"] = json!(1.0);
    assert_eq!(tag(&json!({"renders": [spelled]})).await, first);
    let others = [
        json!({"renders": [picture(2.5, "left")]}),
        json!({"sheet": true, "renders": [picture(2.0, "left")]}),
    ];
    for other in others {
        assert_ne!(tag(&other).await, first);
    }
}

/// The pictures of an animated PNG.
fn frames(answer: &Answer) -> Vec<Vec<u8>> {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let mut reader = png::Decoder::new(Cursor::new(&answer.body))
        .read_info()
        .unwrap();
    let count = reader.info().animation_control.unwrap().num_frames;
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    (0..count)
        .map(|_| {
            reader.next_frame(&mut pixels).unwrap();
            pixels.clone()
        })
        .collect()
}

async fn pixels(server: &Server, case: &str, query: &str) -> Vec<u8> {
    let address = format!("{case}/render?{query}&width=96&height=96");
    server.get(&address).await.grey().into_raw()
}

#[tokio::test]
async fn a_swivel_turns_all_the_way_round() {
    let (server, case) = server_and_case().await;
    let render = json!({"view": "anterior", "depth_mm": 3, "width": 96, "height": 96});
    let body = json!({"swivel": {"frames": 4, "delay_ms": 100, "render": render}});
    let answer = ask(&server, &case, &body).await;
    assert_eq!(answer.header("content-type"), "image/apng");
    let turn = frames(&answer);
    assert_eq!(turn.len(), 4);
    for (frame, view) in [(0, "anterior"), (2, "posterior")] {
        let still = pixels(&server, &case, &format!("depth_mm=3&view={view}")).await;
        let off = turn[frame]
            .iter()
            .zip(&still)
            .filter(|(a, b)| a.abs_diff(**b) > 8);
        assert!(off.count() < 96, "{view}");
    }
    assert_ne!(turn[1], turn[3]);
}

#[tokio::test]
async fn a_sweep_goes_from_depth_to_depth() {
    let (server, case) = server_and_case().await;
    let render = json!({"width": 96, "height": 96});
    let body = json!({"sweep": {"from_mm": 2, "to_mm": 10, "frames": 5, "render": render}});
    let answer = ask(&server, &case, &body).await;
    let peel = frames(&answer);
    for (frame, depth) in peel.iter().zip([2, 4, 6, 8, 10]) {
        let still = pixels(&server, &case, &format!("depth_mm={depth}")).await;
        assert!(*frame == still, "{depth} mm");
    }
}

#[tokio::test]
async fn a_sweep_comes_back_if_asked_to_and_shows_neither_end_twice() {
    let (server, case) = server_and_case().await;
    let render = json!({"width": 96, "height": 96});
    let body = json!({"sweep": {"from_mm": 2, "to_mm": 8, "frames": 3, "there_and_back": true, "render": render}});
    let peel = frames(&ask(&server, &case, &body).await);
    assert_eq!(peel.len(), 4);
    for (frame, depth) in peel.iter().zip([2, 5, 8, 5]) {
        let still = pixels(&server, &case, &format!("depth_mm={depth}")).await;
        assert!(*frame == still, "{depth} mm");
    }
    let long = json!({"sweep": {"from_mm": 2, "to_mm": 8, "frames": 130, "there_and_back": true, "render": render}});
    let answer = ask(&server, &case, &long).await;
    assert_eq!(answer.json()["parameter"], "sweep.frames", "{answer:?}");
}

#[tokio::test]
async fn a_sweep_averages_near_the_envelope_if_asked_to() {
    let (server, case) = server_and_case().await;
    let sweep = |slab_mm: f64| {
        let render = json!({"width": 96, "height": 96, "slab_mm": slab_mm});
        json!({"sweep": {"from_mm": 0, "to_mm": 2, "frames": 5, "average_shallow": true, "render": render}})
    };
    let averaged = frames(&ask(&server, &case, &sweep(0.0)).await);
    let stills = [(0.0, 1.0), (0.5, 0.5), (1.0, 0.5), (1.5, 0.25), (2.0, 0.0)];
    for (frame, (depth, slab)) in averaged.iter().zip(stills) {
        let query = format!("depth_mm={depth}&slab_mm={slab}");
        let still = pixels(&server, &case, &query).await;
        assert!(*frame == still, "{depth} mm");
    }
    let own = frames(&ask(&server, &case, &sweep(2.0)).await);
    let still = pixels(&server, &case, "depth_mm=0&slab_mm=2").await;
    assert!(own[0] == still, "a slab of its own stays");
}

#[tokio::test]
async fn what_cannot_be_sent_or_drawn_is_refused() {
    let (server, case) = server_and_case().await;
    let list = json!({"renders": [picture(1.0, "left")]});
    let answer = post(&server, &case, "image/png", list.to_string()).await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (406, "not-acceptable")
    );
    let nobody = format!("/v1/cases/{}", "0".repeat(32));
    let answer = ask(&server, &nobody, &list).await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (404, "no-such-case")
    );
    let waiting = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let uploaded = waiting.upload(&[("volume", &plain_head().bytes())]).await;
    let early = ask(&waiting, uploaded.header("location"), &list).await;
    assert_eq!(
        (early.status.as_u16(), early.problem().as_str()),
        (409, "case-not-ready")
    );
}

#[tokio::test]
async fn the_tag_of_a_list_follows_the_label_if_it_is_drawn() {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let head = crate::head::plain_head().bytes();
    let tags_under = async |label: &str| {
        let parameters = format!(r#"{{"name": "{label}", "keep_name": false}}"#);
        let parts = [("volume", &head[..]), ("parameters", parameters.as_bytes())];
        let case = server.prepared(&parts).await;
        let mut tags = Vec::new();
        for annotate in [false, true] {
            let picture = json!({"width": 128, "height": 128, "annotate": annotate});
            let answer = ask(&server, &case, &json!({"renders": [picture]})).await;
            assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
            tags.push(answer.header("etag").to_owned());
        }
        tags
    };
    let [first, second] = [tags_under("First").await, tags_under("Second").await];
    assert_eq!(first[0], second[0], "without a label nothing has changed");
    assert_ne!(first[1], second[1]);
}

#[tokio::test]
async fn a_long_answer_is_given_up_and_the_next_is_drawn() {
    let server = Server::start_with(|config| {
        config.render.gpu = GpuUse::Off;
        config.http.timeouts.answer = std::time::Duration::from_secs(1);
    })
    .await;
    let case = server.plain_case().await;
    let render = json!({"renderer": "trace", "width": 512, "height": 512, "slab_mm": 20});
    let body = json!({"swivel": {"frames": 256, "render": render}});
    let answer = ask(&server, &case, &body).await;
    assert_eq!(
        (answer.status.as_u16(), answer.problem().as_str()),
        (503, "timed-out")
    );
    let detail = answer.json()["detail"].as_str().unwrap().to_owned();
    assert!(
        detail.contains("fewer") && !detail.contains("again"),
        "{detail}"
    );
    assert!(detail.contains("limit of 1 s"), "{detail}");
    assert_eq!(answer.header("retry-after"), "");
    // Small, because it has one second, too.
    let small = format!("{case}/render?renderer=splat&width=32&height=32");
    assert_eq!(server.get(&small).await.status, StatusCode::OK);
    assert_eq!(
        server.state.cases.queue.waiting(),
        0,
        "nothing is left of it"
    );
}
