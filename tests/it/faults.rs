//! A graphics device that fails while the server uses it, seen over HTTP. Where there is no device, these say so and pass.

use std::sync::Arc;
use std::time::Duration;

use axum::http::StatusCode;
use cases::settings::GpuUse;
use futures_util::future::join_all;
use isocortex::config::Config;
use render::gpu::{Fault, GpuPool};

use crate::scenes;
use crate::server::{Answer, Server};
use crate::until::until;

/// A server that draws with the device whatever it may, and the device.
async fn server_and_device(
    configure: impl FnOnce(&mut Config),
) -> Option<(Server, Arc<GpuPool>, String)> {
    // Fails where tests must not be skipped.
    drop(scenes::device()?);
    let server = Server::start_with(|config| {
        config.render.gpu = GpuUse::Always;
        configure(config);
    })
    .await;
    let case = server.plain_case().await;
    let graphics = server.state.cases.graphics.clone();
    let device = until("a device is found", async || graphics.device()).await;
    Some((server, device, case))
}

async fn drawn(server: &Server, case: &str, renderer: &str) -> Answer {
    let query = "depth_mm=6&width=96&height=96";
    let address = format!("{case}/render?renderer={renderer}&{query}");
    server.get(&address).await
}

/// Whether a picture shows something, and who drew it.
fn by(answer: &Answer) -> (&str, bool) {
    assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    let lit = answer.grey().pixels().any(|pixel| pixel.0[0] > 50);
    assert!(lit, "the picture is black");
    let on_cpu = answer.header("x-isocortex-device") == "cpu";
    (answer.header("x-isocortex-renderer"), on_cpu)
}

#[tokio::test]
async fn a_lost_device_is_opened_anew_and_the_picture_is_drawn_again() {
    let Some((server, device, case)) = server_and_device(|_| {}).await else {
        return;
    };
    for renderer in ["mesh", "trace"] {
        let before = drawn(&server, &case, renderer).await;
        assert_eq!(by(&before), (renderer, false));
        device.break_device(Fault::Loss).unwrap();
        let after = drawn(&server, &case, renderer).await;
        assert_eq!(after.body, before.body, "{renderer}");
    }
}

#[tokio::test]
async fn a_device_that_is_short_of_memory_is_emptied_and_the_picture_is_drawn_again() {
    let Some((server, device, case)) = server_and_device(|_| {}).await else {
        return;
    };
    let before = drawn(&server, &case, "mesh").await;
    device.break_device(Fault::OutOfMemory(1)).unwrap();
    let after = drawn(&server, &case, "mesh").await;
    assert_eq!((by(&after), &after.body), (("mesh", false), &before.body));
}

#[tokio::test]
async fn where_memory_stays_short_the_processor_draws_and_the_answer_says_so() {
    let Some((server, device, case)) = server_and_device(|_| {}).await else {
        return;
    };
    for (asked, on_device, used) in [
        ("auto", "trace", "trace"),
        ("mesh", "mesh", "mesh"),
        ("trace", "trace", "trace"),
    ] {
        let before = drawn(&server, &case, asked).await;
        assert_eq!(by(&before), (on_device, false));
        device.break_device(Fault::OutOfMemory(2)).unwrap();
        let fallen_back = drawn(&server, &case, asked).await;
        assert_eq!(by(&fallen_back), (used, true), "{asked}");
        assert_ne!(fallen_back.header("etag"), before.header("etag"), "{asked}");
        let after = drawn(&server, &case, asked).await;
        assert_eq!(
            (by(&after), &after.body),
            ((on_device, false), &before.body)
        );
    }
}

#[tokio::test]
async fn pictures_that_are_under_way_when_the_device_is_lost_all_come() {
    let configure = |config: &mut Config| config.render.threads = 2;
    let Some((server, device, case)) = server_and_device(configure).await else {
        return;
    };
    let pictures = (0..24).map(|step| {
        let (server, device, case) = (&server, &device, &case);
        async move {
            if step % 8 == 4 {
                // Where too many pictures wait, it is told again.
                while device.break_device(Fault::Loss).is_err() {
                    tokio::time::sleep(Duration::from_millis(1)).await;
                }
            }
            let depth = f64::from(step) / 2.0;
            let address =
                format!("{case}/render?renderer=mesh&depth_mm={depth}&width=96&height=96");
            server.get(&address).await
        }
    });
    for answer in join_all(pictures).await {
        assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
    }
}

/// Voxels of a texture of the plain head.
async fn voxels(texture: &str) -> u64 {
    let server = Server::start_with(|config| config.render.gpu = GpuUse::Off).await;
    let case = server.plain_case().await;
    let answer = server.get(&format!("{case}/{texture}")).await;
    let sides = answer.header("x-isocortex-size").split(',');
    sides
        .map(|side| side.parse::<u64>().expect("a number"))
        .product()
}

#[tokio::test]
async fn a_volume_that_the_device_cannot_hold_is_reduced_and_the_answer_says_so() {
    // All depths in their three forms, and half of the intensities.
    let bytes = 8 * voxels("distance").await + voxels("volume").await;
    let configure = |config: &mut Config| config.render.gpu_case_bytes = bytes;
    let Some((server, _device, case)) = server_and_device(configure).await else {
        return;
    };
    let answer = drawn(&server, &case, "mesh").await;
    assert_eq!(by(&answer), ("mesh", false));
    let reduction = answer.header("x-isocortex-reduction").to_owned();
    let factors: Vec<u32> = reduction
        .split('x')
        .map(|factor| factor.parse().expect("a number"))
        .collect();
    assert!(
        factors.len() == 3 && factors.iter().any(|&factor| factor > 1),
        "{reduction:?}"
    );
    let whole = drawn(&server, &case, "splat").await;
    assert_eq!(whole.header("x-isocortex-reduction"), "");
}

#[tokio::test]
async fn a_case_whose_depths_the_device_cannot_hold_is_drawn_by_the_processor_alone() {
    let configure = |config: &mut Config| config.render.gpu_case_bytes = 1000;
    let Some((server, _device, case)) = server_and_device(configure).await else {
        return;
    };
    assert_eq!(by(&drawn(&server, &case, "auto").await), ("trace", true));
    assert_eq!(by(&drawn(&server, &case, "mesh").await), ("mesh", true));
    assert_eq!(by(&drawn(&server, &case, "trace").await), ("trace", true));
}
