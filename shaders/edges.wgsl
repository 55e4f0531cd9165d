// The edges of a layer over the volume, to check by eye how well the two fit: lines where the layer's values rise steepest.

const EDGE_COLOR = vec3<f32>(255.0, 70.0, 200.0);
// Slopes from which an edge begins to show and from which it shows in full, in numbers of the layer's 255 colours per mm.
const LEAST_RISE: f32 = 10.0;
const FULL_RISE: f32 = 20.0;
// Half the width of an edge, in pixels; half a pixel more fades out.
const EDGE_HALF_WIDTH: f32 = 0.6;
// The distance over which a slope is measured to either side, in mm and in voxels of the layer, whichever is more.
const RISE_REACH: f32 = 0.75;

// The number of the layer's colour at a place of the frame, and which share of it is defined.
fn edge_level(place_in_frame: vec2<f32>) -> vec2<f32> {
    let found = overlay_at(foot_of(place_in_frame));
    return vec2<f32>(overlay_level(found.x), found.y);
}

// How steep the layer is at a place of the frame, in colours per pixel to the right and down, and which share of it is defined.
fn edge_rise(place: vec2<f32>, reach: f32) -> vec3<f32> {
    let right = edge_level(place + vec2<f32>(reach, 0.0));
    let left = edge_level(place - vec2<f32>(reach, 0.0));
    let under = edge_level(place + vec2<f32>(0.0, reach));
    let above = edge_level(place - vec2<f32>(0.0, reach));
    let defined = min(min(right.y, left.y), min(under.y, above.y));
    return vec3<f32>(vec2<f32>(right.x - left.x, under.x - above.x) / (2.0 * reach), defined);
}

// A colour, 0 to 255 for red, green and blue, with the layer's edges over it. The slope is measured at a pixel and to either side along its
// own direction; the line is where a parabola through the three has its peak.
fn under_edges(color: vec3<f32>, place: vec2<f32>) -> vec3<f32> {
    let right = picture.field_from_frame[0];
    let under = picture.field_from_frame[1];
    let mm_per_pixel = length(right.xyz) * picture.voxel_mm;
    // Voxels of the layer in a pixel, along the coarser of the picture's two directions.
    let voxels = min(length((picture.overlay_from_field * right).xyz), length((picture.overlay_from_field * under).xyz));
    let reach = max(RISE_REACH / min(mm_per_pixel, voxels), 1.0);
    let rise = edge_rise(place, reach);
    let here = length(rise.xy);
    if here <= LEAST_RISE * mm_per_pixel {
        return color;
    }
    let across = rise.xy / here * reach;
    let before = length(edge_rise(place - across, reach).xy);
    let after = length(edge_rise(place + across, reach).xy);
    let bend = 2.0 * here - before - after;
    if bend <= 0.0 {
        return color;
    }
    let distance = abs(0.5 * (after - before) / bend) * reach;
    let cover = clamp(EDGE_HALF_WIDTH + 0.5 - distance, 0.0, 1.0);
    let strength = smoothstep(LEAST_RISE, FULL_RISE, here / mm_per_pixel);
    let share = select(0.0, cover * strength, rise.z > 0.5);
    return mix(color, EDGE_COLOR, share);
}
