//! Positions of the pixels of a picture.

use axum::http::StatusCode;
use cases::settings::GpuUse;
use cases::settings::MapsUse;

use crate::head::SPACING_MM;
use crate::server::{Answer, Server};

const BINARY: [(&str, &str); 1] = [("accept", "application/octet-stream")];

/// A depth at which no surface is smoothed.
const DEPTH_MM: f32 = 22.0;

const SIZE: [usize; 2] = [60, 50];

/// A server whose profiles need no maps.
async fn server() -> Server {
    Server::start_with(|config| {
        config.limits.maps = MapsUse::Off;
        config.render.gpu = GpuUse::Off;
    })
    .await
}

async fn positions(server: &Server, picture: &str) -> (Answer, Vec<[f32; 3]>) {
    let answer = server.get_with(picture, &BINARY).await;
    let positions = answer.positions();
    (answer, positions)
}

#[tokio::test]
async fn each_pixel_lies_where_the_case_has_the_depth_that_was_asked_for() {
    let server = server().await;
    let case = server.plain_case().await;
    let [width, height] = SIZE;
    let view = format!("view=left&depth_mm={DEPTH_MM}&width={width}&height={height}&zoom=1.5");
    for (renderer, most_mm) in [("trace", 0.03), ("splat", SPACING_MM), ("mesh", SPACING_MM)] {
        let picture = format!(
            "{case}/render?{view}&renderer={renderer}&contours=80&points=80&background=transparent"
        );
        let (answer, positions) = positions(&server, &picture).await;
        assert_eq!(answer.header("content-type"), "application/octet-stream");
        assert_eq!(
            answer.header("x-isocortex-size"),
            format!("{width},{height}")
        );
        assert_eq!(answer.header("x-isocortex-renderer"), renderer);
        assert_eq!(answer.header("x-isocortex-depth-mm"), DEPTH_MM.to_string());
        assert_eq!(positions.len(), width * height);
        let shown: Vec<usize> = (0..positions.len())
            .filter(|&pixel| !positions[pixel][0].is_nan())
            .collect();
        assert!(
            shown.len() > 500 && shown.len() < positions.len(),
            "{}",
            shown.len()
        );
        for &pixel in shown.iter().step_by(83) {
            let [x, y, z] = positions[pixel];
            let profile = server
                .get(&format!("{case}/profile?position={x},{y},{z}"))
                .await;
            let depth_mm = profile.json()["own"]["point"]["depth_mm"].as_f64().unwrap();
            let off_mm = (depth_mm - f64::from(DEPTH_MM)).abs();
            assert!(
                off_mm < f64::from(most_mm),
                "{renderer}: {depth_mm} mm at pixel {pixel}"
            );
        }
        assert_pixels_are_on_one_grid(&positions, &shown);
        if renderer == "trace" {
            assert_shown_where_opaque(&server.get(&picture).await, &positions);
        }
    }
}

/// From the left, a column to the right is a fixed step to posterior, and a row down a fixed step to inferior.
fn assert_pixels_are_on_one_grid(positions: &[[f32; 3]], shown: &[usize]) {
    let [width, _] = SIZE;
    let at = |pixel: usize| [pixel % width, pixel / width].map(|place| place as f32);
    let (first, last) = (shown[0], shown[shown.len() - 1]);
    let step_mm = (positions[first][2] - positions[last][2]) / (at(last)[1] - at(first)[1]);
    assert!(step_mm > 0.5, "{step_mm}");
    for &pixel in shown {
        let [column, row] = [0, 1].map(|axis| at(pixel)[axis] - at(first)[axis]);
        let posterior = positions[first][1] + step_mm * column;
        let superior = positions[first][2] - step_mm * row;
        let [_, y, z] = positions[pixel];
        assert!(
            (y - posterior).abs() < 0.01 && (z - superior).abs() < 0.01,
            "pixel {pixel}"
        );
    }
}

fn assert_shown_where_opaque(picture: &Answer, positions: &[[f32; 3]]) {
    let picture = image::load_from_memory(&picture.body)
        .unwrap()
        .into_luma_alpha8();
    for (pixel, position) in picture.pixels().zip(positions) {
        let is_shown = position.iter().all(|coordinate| coordinate.is_finite());
        // At the edge a pixel has a position if at least half of it is covered.
        assert_eq!(pixel.0[1] >= 128, is_shown, "{position:?}");
    }
}

#[tokio::test]
async fn positions_have_a_tag_of_their_own_and_do_not_depend_on_colours() {
    let server = server().await;
    let case = server.plain_case().await;
    let picture = format!("{case}/render?depth_mm=9&width=32&height=24");
    let (plain, _) = positions(&server, &picture).await;
    let tag = plain.header("etag");
    assert_ne!(tag, server.get(&picture).await.header("etag"));
    assert_eq!(plain.header("vary"), "accept");
    let known = [BINARY[0], ("if-none-match", tag)];
    let again = server.get_with(&picture, &known).await;
    assert_eq!(again.status, StatusCode::NOT_MODIFIED);
    let coloured = format!("{picture}&colormap=hot&window=300,100&ambient=1&slab_mm=2");
    assert_eq!(positions(&server, &coloured).await.0.body, plain.body);
}

#[tokio::test]
async fn too_many_positions_are_refused() {
    let server = server().await;
    let case = server.plain_case().await;
    let address = format!("{case}/render?width=4096&height=1025");
    let refused = server.get_with(&address, &BINARY).await;
    assert_eq!(refused.status, StatusCode::BAD_REQUEST);
    assert_eq!(refused.problem(), "query-value-out-of-range");
    let text = server.get_with(&address, &[("accept", "text/plain")]).await;
    assert_eq!(text.status, StatusCode::NOT_ACCEPTABLE);
}
