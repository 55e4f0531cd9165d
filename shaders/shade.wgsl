// From a point of the surface to its pixel.

// The mean of the stored intensities over the slab: x, and in y whether any of it lies in the volume and is defined.
fn stored_on(position: vec3<f32>, inward: vec3<f32>) -> vec2<f32> {
    let along = (picture.volume_from_field * vec4<f32>(inward, 0.0)).xyz / picture.voxel_mm;
    var sum = 0.0;
    var count = 0.0;
    var index = 0u;
    // Left at its end: where software draws, all that follows a loop's exit is worked out once more for nothing.
    loop {
        let offset_mm = picture.slab_first + f32(index) * picture.slab_step;
        let sample = position + offset_mm * along;
        let stored = stored_at(sample);
        let is_there = select(0.0, 1.0, is_in_volume(sample) && stored.y >= 0.5);
        sum += is_there * stored.x;
        count += is_there;
        index++;
        if index >= picture.slab_count {
            break;
        }
    }
    return vec2<f32>(sum / max(count, 1.0), min(count, 1.0));
}

// How far a point is from where the isosurface is unknown, in mm: beside a face that cuts the brain. Negative: it is unknown.
fn known_mm(position_in_field: vec3<f32>) -> f32 {
    let place = vec4<f32>(position_in_field, 1.0);
    var least = dot(picture.cuts[0], place);
    for (var index = 1; index < 6; index++) {
        least = min(least, dot(picture.cuts[index], place));
    }
    return least;
}

// Whether a point of the isosurface is known, 1 or 0.
fn known_at(position_in_field: vec3<f32>, around: vec4<f32>) -> f32 {
    return select(0.0, 1.0, known_mm(position_in_field) >= 0.0) * unfenced_of(around);
}

// The pixel of a surface point in voxel coordinates of the depth field, seen from the direction `towards`: background where the volume holds nothing or the isosurface is unknown.
fn shaded(position_in_field: vec3<f32>, towards: vec3<f32>) -> vec4<f32> {
    let surroundings = around(position_in_field);
    let inward = inward_of(surroundings);
    let position = (picture.volume_from_field * vec4<f32>(position_in_field, 1.0)).xyz;
    let stored = stored_on(position, inward);
    let facing = -dot(inward, towards);
    let texture_color = color_in(picture.color_row, brightness(stored.x));
    let lit = under_overlay(texture_color, position_in_field) * light_on(facing);
    return vec4<f32>(floor(lit + 0.5) / 255.0, 1.0) * stored.y * known_at(position_in_field, surroundings);
}
