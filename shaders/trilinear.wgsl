// Values between voxel centres; beyond the outermost centres they are constant.

// A texel's value, and which share of it is defined: both are filtered between voxels, and undefined voxels do not contribute.
fn defined_part(texel: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(texel.x / max(texel.y, 1e-6), texel.y);
}

// The stored intensity at a position in voxel coordinates of the volume, and which share of it is defined.
fn stored_at(position: vec3<f32>) -> vec2<f32> {
    let place = (position + 0.5) / picture.volume_size;
    var texel = textureSampleLevel(volume, linear, place, 0.0).rg;
    if picture.volume_has_gaps == 0u {
        texel.y = 1.0;
    }
    let found = defined_part(texel);
    return vec2<f32>(found.x * picture.stored_scale + picture.stored_offset, found.y);
}

// Whether a position lies in a voxel of the volume: within half a voxel of a centre.
fn is_in_volume(position: vec3<f32>) -> bool {
    return all(clamp(position, vec3<f32>(-0.5), picture.volume_size - 0.5) == position);
}

// How far a position lies below the isosurface, in voxels; negative above it.
fn below(position: vec3<f32>) -> f32 {
    let place = (position + 0.5) / picture.field_size;
    var texel = 0.0;
    if picture.smooth_share < 1.0 {
        texel = textureSampleLevel(field, linear, place, 0.0).r;
    }
    if picture.smooth_share > 0.0 {
        texel = mix(texel, textureSampleLevel(smoothed, linear, place, 0.0).r, picture.smooth_share);
    }
    return texel * picture.depth_scale - picture.depth;
}
