// The gradient of the smoothed depth field.

fn smoothed(place: vec3<f32>) -> f32 {
    return textureSampleLevel(normals, linear, place, 0.0).r;
}

// The unit vector into the brain, by differences over a voxel to either side: trilinear between those at voxel centres.
fn inward_at(position: vec3<f32>) -> vec3<f32> {
    let voxel = vec3<f32>(1.0) / picture.field_size;
    let place = (position + 0.5) * voxel;
    let x = vec3<f32>(voxel.x, 0.0, 0.0);
    let y = vec3<f32>(0.0, voxel.y, 0.0);
    let z = vec3<f32>(0.0, 0.0, voxel.z);
    let gradient = vec3<f32>(
        smoothed(place + x) - smoothed(place - x),
        smoothed(place + y) - smoothed(place - y),
        smoothed(place + z) - smoothed(place - z),
    );
    return gradient / max(length(gradient), 1e-9);
}
