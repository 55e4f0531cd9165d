// The mesh from its depth buffer: each pixel is shaded once, and its edges are soft.

// The depth buffer holds 0 at the height `clip_reach` and 1 at minus that.
fn height_of(depth: f32) -> f32 {
    return (1.0 - 2.0 * depth) * picture.clip_reach;
}

// Shades the mean of a pixel's four samples that are on one piece of the surface with the nearest; alpha is the share that
// is covered.
fn resolved(place_in_frame: vec2<f32>, samples: vec4<f32>) -> vec4<f32> {
    let nearest = min(min(samples.x, samples.y), min(samples.z, samples.w));
    if nearest >= 1.0 {
        return vec4<f32>(0.0);
    }
    // One piece: within some pixels, so that a face seen from the side is.
    let is_near = select(vec4<f32>(0.0), vec4<f32>(1.0), samples <= vec4<f32>(nearest + picture.clip_piece));
    let height = height_of(dot(samples, is_near) / dot(is_near, vec4<f32>(1.0)));
    let coverage = dot(select(vec4<f32>(0.0), vec4<f32>(0.25), samples < vec4<f32>(1.0)), vec4<f32>(1.0));
    return shaded(at_height(foot_of(place_in_frame), height), picture.towards_viewer) * coverage;
}
