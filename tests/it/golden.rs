//! Pictures of the made-up head by every renderer, held to those that are kept beside the tests.
//!
//! `ISOCORTEX_WRITE_GOLDEN=1` draws them anew: look at them before they are committed. On a failure the new picture and the
//! difference (32 levels and more are white) are in `target/golden/`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use render::agreement::{Agreement, difference_picture};
use render::gpu::{GpuCase, GpuJob, GpuSurface};
use render::{
    Facets, Frame, FrameSize, NamedView, PixelFormat, draw_mesh, draw_splat, draw_trace, encode_png,
};

use crate::scenes::{Head, device};

const SIDE: u32 = 128;
const DEPTHS_MM: [f64; 2] = [4.0, 14.0];

/// At least this share of the covered pixels is within 2 levels of what is kept, and none of the silhouette a pixel off it.
///
/// Pictures of the processor are the same everywhere; graphics devices differ in how they filter and round.
const WITHIN_2_LEVELS: f64 = 0.99;

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

#[test]
fn the_processor_draws_the_pictures_that_are_kept() {
    let head = Head::phantom();
    let table = head.table([80, 50]);
    for depth_mm in DEPTHS_MM {
        let request = head.request(NamedView::Left, depth_mm, SIDE);
        let shrunk = table.shrink(depth_mm as f32);
        let mesh = draw_mesh(&head.scene(), &request, Facets::new(table.size, &shrunk));
        hold(&format!("mesh-{depth_mm}mm"), &mesh);
        let splat = draw_splat(&head.scene(), &request);
        hold(&format!("splat-{depth_mm}mm"), &splat);
        let trace = draw_trace(&head.scene(), &request);
        hold(&format!("trace-{depth_mm}mm"), &trace);
    }
}

#[test]
fn the_graphics_device_draws_the_pictures_that_are_kept() {
    let head = Head::phantom();
    let table = head.table([80, 50]);
    let Some(pool) = device() else { return };
    for depth_mm in DEPTHS_MM {
        let request = head.request(NamedView::Left, depth_mm, SIDE);
        let mesh = GpuSurface::Mesh {
            size: table.size,
            mesh: table.shrink(depth_mm as f32),
        };
        for (name, surface) in [("gpu-mesh", mesh), ("gpu-trace", GpuSurface::Trace)] {
            let case = Arc::clone(&head) as Arc<dyn GpuCase>;
            let job = GpuJob {
                case,
                request,
                surface,
            };
            let drawn = pool.draw(job).expect("a picture");
            hold(&format!("{name}-{depth_mm}mm"), &drawn.frame);
        }
    }
}
