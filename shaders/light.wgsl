// The head light.

// Brightness, 0 to 1, of a face whose outward normal has the cosine `facing` with the direction to the viewer.
fn light_on(facing: f32) -> f32 {
    return picture.ambient + (1.0 - picture.ambient) * clamp(facing, 0.0, 1.0);
}
