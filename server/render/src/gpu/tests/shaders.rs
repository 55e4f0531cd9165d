//! The shaders are valid, and have the same constants. No device is needed.

use naga::valid::{Capabilities, ValidationFlags, Validator};

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
