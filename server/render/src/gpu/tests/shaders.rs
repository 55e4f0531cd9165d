//! The shaders are valid, and their twins match. No device is needed.

use std::mem::offset_of;

use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::super::layout::{Paths, Picture};
use super::super::shaders;

/// The module of a shader, and naga's analysis of it.
pub(super) fn validated(source: &str) -> (naga::Module, naga::valid::ModuleInfo) {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    (module, info)
}

/// The names and offsets of a struct's fields, and its size.
pub(super) fn layout(module: &naga::Module, name: &str) -> (Vec<(String, usize)>, usize) {
    let (_, found) = module
        .types
        .iter()
        .find(|(_, found)| found.name.as_deref() == Some(name))
        .unwrap_or_else(|| panic!("no struct {name}"));
    let naga::TypeInner::Struct { members, span } = &found.inner else {
        panic!("{name} is no struct");
    };
    let fields = members.iter().map(|member| {
        (
            member.name.clone().unwrap_or_default(),
            member.offset as usize,
        )
    });
    (fields.collect(), *span as usize)
}

#[test]
fn every_shader_is_valid_and_has_its_entry_points() {
    let expected = [
        (
            shaders::MESH,
            &["mesh_vertex", "mesh_shaded", "mesh_height"][..],
        ),
        (shaders::SHRINK, &["shrunk_vertex"]),
        (
            shaders::TRACE,
            &["screen_vertex", "trace_shaded", "trace_height"],
        ),
        (shaders::RESOLVE, &["screen_vertex", "mesh_resolved"]),
        (shaders::REDUCE, &["screen_vertex", "mesh_reduced"]),
        (shaders::SLICE, &["screen_vertex", "slice_shaded"]),
    ];
    for (source, names) in expected {
        let (module, _) = validated(source);
        let found: Vec<_> = module
            .entry_points
            .iter()
            .map(|point| point.name.as_str())
            .collect();
        assert_eq!(found, names);
    }
}

macro_rules! offsets {
    ($twin:ty: $($field:ident),+) => {
        vec![$((stringify!($field).to_owned(), offset_of!($twin, $field))),+]
    };
}

#[test]
fn the_twins_lie_in_memory_as_the_shaders_want_them() {
    let (module, _) = validated(shaders::SHRINK);
    let twin = offsets!(Picture:
        field_from_frame, volume_from_field, field_from_patient, clip_from_patient,
        volume_size, stored_scale, field_size, stored_offset, towards_viewer, depth_scale,
        box_low, depth, box_high, voxel_mm, sphere_centre, sphere_radius,
        size, ambient, color_row, window_black, window_factor, window_offset, slab_count,
        slab_first, slab_step, clip_reach, clip_piece, smooth_share, window_is_sigmoid, cuts,
        overlay_from_field, overlay_size, overlay_scale, overlay_offset, overlay_low, overlay_factor,
        overlay_threshold, overlay_steepness, overlay_opacity, overlay_color_row, overlay_is_diverging,
        volume_has_gaps, overlay_is_nearest, map_centre, map_units_per_pixel);
    assert_eq!(layout(&module, "Picture"), (twin, size_of::<Picture>()));
    let twin = offsets!(Paths:
        origin_in_patient, step_mm, depth_mm, row_mm, row, vertex_count, first_piece, piece_count);
    assert_eq!(layout(&module, "Paths"), (twin, size_of::<Paths>()));
}

#[test]
fn contours_have_the_same_colours_in_the_shader() {
    let colors = (0..8).map(|number| {
        let [red, green, blue] = crate::slice::contour_color(number);
        format!("    vec3<f32>({red}.0, {green}.0, {blue}.0),\n")
    });
    let listed: String = colors.collect();
    assert!(shaders::SLICE.contains(&listed), "{listed}");
}

#[test]
fn edges_are_the_same_in_the_shader() {
    use crate::slice::{EDGE_COLOR, FULL_RISE, HALF_WIDTH, LEAST_RISE, RISE_REACH};
    let [red, green, blue] = EDGE_COLOR;
    for line in [
        format!("const EDGE_COLOR = vec3<f32>({red}.0, {green}.0, {blue}.0);"),
        format!("const LEAST_RISE: f32 = {LEAST_RISE:?};"),
        format!("const FULL_RISE: f32 = {FULL_RISE:?};"),
        format!("const EDGE_HALF_WIDTH: f32 = {HALF_WIDTH:?};"),
        format!("const RISE_REACH: f32 = {RISE_REACH:?};"),
    ] {
        assert!(shaders::SLICE.contains(&line), "{line}");
    }
}
