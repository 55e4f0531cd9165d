// A layer above the texture: source-over, transparent if it is undefined.

// How much a value hides of what is below it, 0 to 1.
fn overlay_share(value: f32) -> f32 {
    let size = select(value, abs(value), picture.overlay_is_diverging > 0u);
    let rise = clamp((size - picture.overlay_threshold) * picture.overlay_steepness, 0.0, 1.0);
    return picture.overlay_opacity * (rise * rise * (3.0 - 2.0 * rise));
}

// The overlay's value at a position in voxel coordinates of the depth field, and which share of it is defined.
fn overlay_at(position_in_field: vec3<f32>) -> vec2<f32> {
    let position = (picture.overlay_from_field * vec4<f32>(position_in_field, 1.0)).xyz;
    let is_inside = all(clamp(position, vec3<f32>(-0.5), picture.overlay_size - 0.5) == position);
    let nearest = clamp(floor(position + 0.5), vec3<f32>(0.0), picture.overlay_size - 1.0);
    let place = (select(position, nearest, picture.overlay_is_nearest > 0u) + 0.5) / picture.overlay_size;
    let found = defined_part(textureSampleLevel(overlay, linear, place, 0.0).rg);
    return vec2<f32>(found.x * picture.overlay_scale + picture.overlay_offset, select(0.0, found.y, is_inside));
}

// The number of the colour of a value, 0 to 255.
fn overlay_level(value: f32) -> f32 {
    return clamp((value - picture.overlay_low) * picture.overlay_factor, 0.0, 255.0);
}

// A colour, 0 to 255 for red, green and blue, with the overlay above it at a position in voxel coordinates of the depth field.
fn under_overlay(color: vec3<f32>, position_in_field: vec3<f32>) -> vec3<f32> {
    if picture.overlay_opacity <= 0.0 {
        return color;
    }
    let found = overlay_at(position_in_field);
    let share = found.y * overlay_share(found.x);
    return color + share * (color_in(picture.overlay_color_row, overlay_level(found.x)) - color);
}
