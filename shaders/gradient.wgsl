// The gradient of the smoothed depth field.

// The unit vector into the brain: the texture holds the differences at voxel centres, over a voxel to either side.
fn inward_at(position: vec3<f32>) -> vec3<f32> {
    let place = (position + 0.5) / picture.field_size;
    let gradient = textureSampleLevel(normals, linear, place, 0.0).xyz;
    return gradient / max(length(gradient), 1e-6);
}
