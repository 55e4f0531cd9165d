// The gradient of the smoothed depth field, and where a fence makes the depth unknown.

// What the texture holds around a position: the differences at voxel centres, over a voxel to either side; and the share of it whose
// depth is unknown because a fence is nearer than the dura.
fn around(position: vec3<f32>) -> vec4<f32> {
    let place = (position + 0.5) / picture.field_size;
    return textureSampleLevel(normals, linear, place, 0.0);
}

// The unit vector into the brain, from what is around.
fn inward_of(around: vec4<f32>) -> vec3<f32> {
    let gradient = around.xyz;
    return gradient / max(length(gradient), 1e-6);
}

// Whether a depth is known for a fence, 1 or 0, from what is around.
fn unfenced_of(around: vec4<f32>) -> f32 {
    return select(0.0, 1.0, around.w < 0.5);
}

// The unit vector into the brain.
fn inward_at(position: vec3<f32>) -> vec3<f32> {
    return inward_of(around(position));
}
