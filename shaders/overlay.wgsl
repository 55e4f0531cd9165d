// A layer above the texture: source-over, transparent if it is undefined.

// How much a value hides of what is below it, 0 to 1.
fn overlay_share(value: f32) -> f32 {
    let size = select(value, abs(value), picture.overlay_is_diverging > 0u);
    let rise = clamp((size - picture.overlay_threshold) * picture.overlay_steepness, 0.0, 1.0);
    return picture.overlay_opacity * (rise * rise * (3.0 - 2.0 * rise));
}

// A colour, 0 to 255 for red, green and blue, with the overlay above it at a position in voxel coordinates of the depth field.
fn under_overlay(color: vec3<f32>, position_in_field: vec3<f32>) -> vec3<f32> {
    if picture.overlay_opacity <= 0.0 {
        return color;
    }
    let position = (picture.overlay_from_field * vec4<f32>(position_in_field, 1.0)).xyz;
    let is_inside = all(clamp(position, vec3<f32>(-0.5), picture.overlay_size - 0.5) == position);
    let nearest = clamp(floor(position + 0.5), vec3<f32>(0.0), picture.overlay_size - 1.0);
    let place = (select(position, nearest, picture.overlay_is_nearest > 0u) + 0.5) / picture.overlay_size;
    let found = defined_part(textureSampleLevel(overlay, linear, place, 0.0).rg);
    let value = found.x * picture.overlay_scale + picture.overlay_offset;
    let level = clamp((value - picture.overlay_low) * picture.overlay_factor, 0.0, 255.0);
    let share = select(0.0, found.y, is_inside) * overlay_share(value);
    return color + share * (color_in(picture.overlay_color_row, level) - color);
}
