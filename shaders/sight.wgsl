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

// A line of sight, in voxel coordinates of the depth field: its position at height 0, and the unit vector towards the viewer.
struct Sight {
    foot: vec3<f32>,
    towards: vec3<f32>,
}

fn along(sight: Sight, height: f32) -> vec3<f32> {
    return sight.foot + height * sight.towards;
}

fn is_map() -> bool {
    return picture.map_units_per_pixel > 0.0;
}

// Where a place lies on its disc: to the right and up from the centre, in radii of the sphere of directions.
fn on_disc(place_in_frame: vec2<f32>) -> vec2<f32> {
    let offset = place_in_frame - picture.map_centre;
    return vec2<f32>(offset.x, -offset.y) * picture.map_units_per_pixel;
}

// The line of sight of a place. On a disc of the flat map, all of them end in the middle of the hemisphere: `render::map`.
fn sight_of(place_in_frame: vec2<f32>) -> Sight {
    if !is_map() {
        return Sight(foot_of(place_in_frame), picture.towards_viewer);
    }
    let place = on_disc(place_in_frame);
    let squared = dot(place, place);
    let stretch = sqrt(max(1.0 - 0.25 * squared, 0.0));
    let direction = vec4<f32>(place * stretch, 1.0 - 0.5 * squared, 0.0);
    return Sight(picture.field_from_frame[3].xyz, (picture.field_from_frame * direction).xyz);
}

// Radii of the rim of a disc and of the end of its margin, and the share of the surface in the margin.
const MAP_RIM: f32 = 1.4142135;
const MAP_MARGIN: f32 = 1.6867829;
const MARGIN_SHARE: f32 = 0.5;

// The share of a pixel that its disc covers; 1 where there is no map.
fn share_on_map(place_in_frame: vec2<f32>) -> f32 {
    if !is_map() {
        return 1.0;
    }
    let radius = length(on_disc(place_in_frame));
    let within = clamp(0.5 + (vec2<f32>(MAP_RIM, MAP_MARGIN) - radius) / picture.map_units_per_pixel, vec2<f32>(0.0), vec2<f32>(1.0));
    return mix(MARGIN_SHARE, 1.0, within.x) * within.y;
}
