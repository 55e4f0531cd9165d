//! Pictures of the made-up head by every renderer, held to those that are kept beside the tests.
//!
//! `ISOCORTEX_WRITE_GOLDEN=1` draws them anew: look at them before they are committed. On a failure the new picture and the
//! difference (32 levels and more are white) are in `target/golden/`.

use std::path::{Path, PathBuf};

use render::conformance::{Agreement, difference_picture};
use render::{Frame, FrameSize, NamedView, PixelFormat, RenderBackend, encode_png};

use crate::scenes::{Head, device};

const SIDE: u32 = 128;
const DEPTHS_MM: [f64; 2] = [4.0, 14.0];

/// At least this share of the covered pixels is within 2 levels of what is kept, and none of the silhouette a pixel off it.
///
/// Pictures of the processor are the same everywhere. Graphics devices differ in how they filter and round, and so in how much of a
/// pixel at the edge is covered by facets: the small picture of a mesh by an NVIDIA H200 has 98.8 %, since those kept are lavapipe's.
const WITHIN_2_LEVELS: f64 = 0.98;

fn kept(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden");
    folder.join(format!("{name}.png"))
}

/// The folder for what a failed test shows: `golden` in the folder of build products, which the test program is in.
fn shown(name: &str) -> PathBuf {
    let program = std::env::current_exe().expect("the path of this program");
    let target = program.ancestors().nth(3).expect("target/PROFILE/deps");
    let folder = target.join("golden");
    std::fs::create_dir_all(&folder).expect("a folder for what failed");
    folder.join(format!("{name}.png"))
}

fn write(path: &Path, frame: &Frame) {
    let bytes = encode_png(frame, &[]).expect("a PNG");
    std::fs::write(path, bytes).expect("a written PNG");
}

fn read(path: &Path) -> Option<Frame> {
    let picture = image::open(path).ok()?.into_luma_alpha8();
    let size = FrameSize::new(picture.width(), picture.height()).ok()?;
    Some(Frame::new(
        size,
        PixelFormat::GreyAlpha8,
        picture.into_raw(),
    ))
}

/// Compares a picture with the one that is kept.
///
/// # Panics
/// When they differ, or none is kept.
fn hold(name: &str, found: &Frame) {
    let kept = kept(name);
    if std::env::var_os("ISOCORTEX_WRITE_GOLDEN").is_some() {
        return write(&kept, found);
    }
    let Some(expected) = read(&kept) else {
        panic!("tests/golden/{name}.png is missing: ISOCORTEX_WRITE_GOLDEN=1 draws it");
    };
    let agreement = Agreement::of(found, &expected);
    let within = agreement.share_within(2);
    if within >= WITHIN_2_LEVELS && agreement.beyond_edge() == 0 {
        return;
    }
    write(&shown(name), found);
    let difference = shown(&format!("{name}-difference"));
    write(&difference, &difference_picture(found, &expected));
    panic!(
        "{name}: {within} of the pixels within 2 levels, {} beyond the silhouette's edge; see {}",
        agreement.beyond_edge(),
        difference.display()
    );
}

/// Draws the made-up head and compares.
fn hold_all(backends: &[(&str, RenderBackend)]) {
    let head = Head::phantom();
    let table = head.table([80, 50]);
    for depth_mm in DEPTHS_MM {
        let request = head.request(NamedView::Left, depth_mm, SIDE);
        for (name, backend) in backends {
            let picture = head.draw_mesh(backend, &table, &request);
            hold(&format!("{name}-{depth_mm}mm"), &picture);
        }
    }
}

#[test]
fn the_processor_draws_the_pictures_that_are_kept() {
    hold_all(&[
        ("mesh", RenderBackend::Mesh),
        ("splat", RenderBackend::Splat),
        ("trace", RenderBackend::Trace),
    ]);
}

#[test]
fn the_graphics_device_draws_the_pictures_that_are_kept() {
    let Some(pool) = device() else { return };
    hold_all(&[
        ("gpu-mesh", RenderBackend::GpuMesh(pool.clone())),
        ("gpu-trace", RenderBackend::GpuTrace(pool)),
    ]);
}
