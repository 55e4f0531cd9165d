// Lines of sight, one for each pixel.

struct OnScreen {
    @builtin(position) position: vec4<f32>,
    @location(0) place_in_frame: vec2<f32>,
}

// A triangle over the whole picture.
@vertex
fn screen_vertex(@builtin(vertex_index) vertex: u32) -> OnScreen {
    let corner = vec2<f32>(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0);
    let place = vec2<f32>(0.5 + 0.5 * corner.x, 0.5 - 0.5 * corner.y) * picture.size;
    return OnScreen(vec4<f32>(corner, 0.0, 1.0), place);
}

// The position at height 0, in voxel coordinates of the depth field. A unit of height is a unit of length.
fn foot_of(place_in_frame: vec2<f32>) -> vec3<f32> {
    return (picture.field_from_frame * vec4<f32>(place_in_frame, 0.0, 1.0)).xyz;
}

fn at_height(foot: vec3<f32>, height: f32) -> vec3<f32> {
    return foot + height * picture.towards_viewer;
}
