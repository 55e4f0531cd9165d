use std::cell::RefCell;
use std::collections::HashMap;

use geometry::{MeshSize, Paths};
use render::Background;

use super::wireframe::{Drawing, Edges};
use super::*;
use crate::Head;
use crate::paper::sentences::degenerate_count;

fn head(spacing_mm: f64) -> PreparedHead {
    let head = Head::phantom(spacing_mm).unwrap();
    PreparedHead::prepare(&head, 10.0).unwrap().0
}

/// Whether a picture encloses background: pixels that a walk from its border over background does not reach.
fn has_hole(frame: &Frame) -> bool {
    let [width, height] = [frame.size().width(), frame.size().height()];
    let length = frame.format().bytes_per_pixel();
    let pixels = frame.bytes().chunks_exact(length);
    let mut is_empty: Vec<bool> = pixels.map(|pixel| pixel[length - 1] == 0).collect();
    let mut next: Vec<[u32; 2]> = (0..width)
        .flat_map(|x| [[x, 0], [x, height - 1]])
        .chain((0..height).flat_map(|y| [[0, y], [width - 1, y]]))
        .collect();
    while let Some([x, y]) = next.pop() {
        let is_outside = x >= width || y >= height;
        if is_outside || !std::mem::take(&mut is_empty[(y * width + x) as usize]) {
            continue;
        }
        let [left, above] = [x.wrapping_sub(1), y.wrapping_sub(1)];
        next.extend([[left, y], [x + 1, y], [x, above], [x, y + 1]]);
    }
    is_empty.contains(&true)
}

#[test]
fn degenerate_triangles_leave_no_hole() {
    let head = head(3.0);
    let size = MeshSize::new(48, 40).unwrap();
    let paths = Paths::Forest(&head.forest);
    let table = head
        .model()
        .path_table(size, &head.distance, paths)
        .unwrap();
    let mut degenerate = 0;
    for depth_mm in [5.0, 10.0, 20.0] {
        let mesh = table.shrink(depth_mm);
        degenerate += degenerate_count(size, &mesh);
        let request = RenderRequest::new(RenderParameters {
            depth_mm: depth_mm.into(),
            size: square(160).unwrap(),
            camera: oblique(1.2).unwrap(),
            look: Background::Transparent.into(),
            ..RenderParameters::new(head.window)
        });
        let mesh = SizedMesh { size, mesh };
        let frame = drawn(&head, &RenderBackend::Mesh, request.unwrap(), Some(mesh)).unwrap();
        let covered = frame.bytes().chunks_exact(2).filter(|pixel| pixel[1] > 0);
        assert!(covered.count() > 1000, "{depth_mm} mm");
        assert!(!has_hole(&frame), "{depth_mm} mm");
    }
    assert!(degenerate > 100, "{degenerate} degenerate triangles");
}

#[test]
fn a_hole_is_found() {
    let size = square(5).unwrap();
    let covered = |index: usize| {
        let [x, y] = [index % 5, index / 5];
        let is_ring = (1..4).contains(&x) && (1..4).contains(&y);
        [0, 255 * u8::from(is_ring && [x, y] != [2, 2])]
    };
    let bytes = (0..25).flat_map(covered).collect();
    assert!(has_hole(&Frame::new(
        size,
        render::PixelFormat::GreyAlpha8,
        bytes
    )));
}

#[test]
fn a_wireframe_shows_the_near_side_alone() {
    let head = head(4.0);
    let size = MeshSize::new(8, 8).unwrap();
    let (_, table) = head.table(size).unwrap();
    let positions = table.shrink(0.0).positions_in_patient;
    let positions: Vec<DVec3> = positions
        .into_iter()
        .map(|at| glam::Vec3::from_array(at).as_dvec3())
        .collect();
    let request = plain(&head, oblique(1.0).unwrap(), square(64).unwrap(), 0.0).unwrap();
    let projection = request.projection(&head.scene());
    let mut drawing = Drawing::new(projection);
    drawing.mesh(size, &positions, Edges::All);
    let near = drawing.frame();
    let mut lit = HashMap::new();
    for &level in near.bytes() {
        *lit.entry(level).or_insert(0) += 1;
    }
    assert!(lit[&0] > 500 && lit.len() > 20, "background, facets, lines");
    // What lies behind changes nothing.
    let towards_far_side = -projection.towards_viewer_in_patient();
    let furthest = positions
        .iter()
        .max_by(|a, b| a.dot(towards_far_side).total_cmp(&b.dot(towards_far_side)));
    let furthest = *furthest.unwrap();
    let before = drawing.frame();
    drawing.line_between([furthest, furthest], 255);
    assert_eq!(drawing.frame(), before);
}

#[test]
fn a_head_without_maps_has_all_figures_but_the_lesion() {
    let told = RefCell::new(Vec::new());
    let tell = |what: &str| told.borrow_mut().push(what.to_owned());
    let drawn = pictures(&head(4.0), &tell).unwrap();
    let names: Vec<&str> = drawn.iter().map(|picture| picture.name).collect();
    let expected = [
        "figure_1_envelope",
        "figure_2_meshes",
        "figure_3_distances_and_paths",
        "figure_4_shrunk_meshes",
        "figure_8_lowest_part",
        "poles",
    ];
    assert_eq!(names, expected);
    let is_reason = |line: &String| line.starts_with("Figure 7 is not drawn: ");
    assert!(told.borrow().iter().any(is_reason), "{told:?}");
}
