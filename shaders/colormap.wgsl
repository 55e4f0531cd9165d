// Colours for brightness.

// The colour, 0 to 255 for red, green and blue, of a brightness in a row of the table.
fn color_in(row: u32, level: f32) -> vec3<f32> {
    let texel = vec2<i32>(i32(level + 0.5), i32(row));
    return textureLoad(colors, texel, 0).rgb * 255.0;
}
