// A slice through the volume with the contours of isosurfaces: `render::slice`.

struct Contours {
    // Their depths in pixels, four in a row.
    levels: array<vec4<f32>, 4>,
    count: u32,
    // Pixels of depth in a texel of 1 of the depth field.
    depth_px: f32,
    // Pixels in 1 mm, and the depth of the isosurface of which `picture.cuts` are, in pixels.
    px_per_mm: f32,
    cuts_px: f32,
    // 1 if the overlay is drawn as its edges alone.
    has_edges: u32,
}

@group(1) @binding(0) var<uniform> contours: Contours;

// The colours of the contours, in turn: `render::slice::contour`.
const CONTOUR_COLORS = array<vec3<f32>, 8>(
    vec3<f32>(255.0, 225.0, 60.0),
    vec3<f32>(80.0, 170.0, 255.0),
    vec3<f32>(255.0, 140.0, 40.0),
    vec3<f32>(90.0, 220.0, 110.0),
    vec3<f32>(200.0, 120.0, 255.0),
    vec3<f32>(60.0, 230.0, 230.0),
    vec3<f32>(255.0, 90.0, 90.0),
    vec3<f32>(255.0, 255.0, 255.0),
);
// How far a contour reaches from its middle, in pixels; the last pixel fades out.
const REACH: f32 = 1.1;
// The least slope of the depth; near a ridge, a contour would become a blot.
const LEAST_SLOPE: f32 = 0.2;
// A depth equal to a level counts as below it, because the samples of a flat piece differ by rounding.
const LEVEL_MARGIN: f32 = 1e-3;
// More than the difference between the depths of a pixel and of its neighbours, in pixels.
const FAR: f32 = 3.0;

// The depth at a place of the frame, in pixels.
fn depth_at(place_in_frame: vec2<f32>) -> f32 {
    let place = (foot_of(place_in_frame) + 0.5) / picture.field_size;
    return textureSampleLevel(field, linear, place, 0.0).r * contours.depth_px;
}

// The depths in the row above or below a pixel, and in it.
fn depths_beside(place: vec2<f32>) -> vec3<f32> {
    return vec3<f32>(
        depth_at(place - vec2<f32>(1.0, 0.0)),
        depth_at(place),
        depth_at(place + vec2<f32>(1.0, 0.0)),
    );
}

// A colour, 0 to 255 for red, green and blue, with the contours over it. A contour is drawn where its depth is known and
// the depth passes its level, not if it stays on the level.
fn under_contours(color: vec3<f32>, place: vec2<f32>) -> vec3<f32> {
    let depth = depth_at(place);
    var nearest = FAR;
    for (var index = 0u; index < contours.count; index++) {
        nearest = min(nearest, abs(depth - contours.levels[index / 4u][index % 4u]));
    }
    if nearest >= FAR {
        return color;
    }
    let above = depths_beside(place - vec2<f32>(0.0, 1.0));
    let level = depths_beside(place);
    let under = depths_beside(place + vec2<f32>(0.0, 1.0));
    let slope = max(0.5 * length(vec2<f32>(level.z - level.x, under.y - above.y)), LEAST_SLOPE);
    let lows = min(min(above, level), under);
    let highs = max(max(above, level), under);
    let least = min(min(lows.x, lows.y), lows.z);
    let greatest = max(max(highs.x, highs.y), highs.z);
    let foot = foot_of(place);
    let known = known_mm(foot) * contours.px_per_mm + contours.cuts_px;
    let is_unfenced = unfenced_of(around(foot)) > 0.0;
    var result = color;
    for (var index = 0u; index < contours.count; index++) {
        let wanted = contours.levels[index / 4u][index % 4u];
        let passed = wanted - LEVEL_MARGIN;
        let cover = clamp(REACH - abs(depth - wanted) / slope, 0.0, 1.0);
        let is_drawn = is_unfenced && least <= passed && passed <= greatest && wanted + REACH <= known;
        let share = select(0.0, cover, is_drawn);
        result = floor(mix(result, CONTOUR_COLORS[index % 8u], share) + 0.5);
    }
    return result;
}

@fragment
fn slice_shaded(pixel: OnScreen) -> @location(0) vec4<f32> {
    let foot = foot_of(pixel.place_in_frame);
    let position = (picture.volume_from_field * vec4<f32>(foot, 1.0)).xyz;
    let stored = stored_at(position);
    let is_there = is_in_volume(position) && stored.y >= 0.5;
    let shown = select(vec3<f32>(0.0), color_in(picture.color_row, brightness(stored.x)), is_there);
    var color = shown;
    if contours.has_edges > 0u {
        color = under_edges(shown, pixel.place_in_frame);
    } else {
        color = under_overlay(shown, foot);
    }
    color = floor(color + 0.5);
    return vec4<f32>(under_contours(color, pixel.place_in_frame) / 255.0, 1.0);
}
