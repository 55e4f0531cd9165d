// The mesh from a depth buffer of its own for the pane, as large as the pane or twice as large: where depth buffers of several
// samples cannot be read. Its rows go up.

@group(1) @binding(3) var depths: texture_2d<f32>;

@fragment
fn mesh_reduced(pixel: OnScreen) -> @location(0) vec4<f32> {
    let side = vec2<i32>(textureDimensions(depths)) / vec2<i32>(picture.size);
    let place = vec2<i32>(pixel.place_in_frame);
    let low = vec2<i32>(place.x, i32(picture.size.y) - 1 - place.y) * side;
    let high = low + side - 1;
    return resolved(pixel.place_in_frame, vec4<f32>(
        textureLoad(depths, low, 0).x,
        textureLoad(depths, vec2<i32>(high.x, low.y), 0).x,
        textureLoad(depths, vec2<i32>(low.x, high.y), 0).x,
        textureLoad(depths, high, 0).x,
    ));
}
