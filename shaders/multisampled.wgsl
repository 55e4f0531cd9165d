// The mesh from a depth buffer of four samples a pixel.

const SAMPLES: i32 = 4;

@group(1) @binding(0) var depths: texture_depth_multisampled_2d;

@fragment
fn mesh_resolved(pixel: OnScreen) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.place_in_frame);
    var samples = vec4<f32>(1.0);
    for (var index = 0; index < SAMPLES; index++) {
        samples[index] = textureLoad(depths, texel, index);
    }
    return resolved(pixel.place_in_frame, samples);
}
