// The display window, DICOM PS3.3 C.11.2.1.2.1.

// Brightness, 0 to 255, of a stored intensity.
fn brightness(stored: f32) -> f32 {
    let ramp = (stored - picture.window_black) * picture.window_factor + picture.window_offset;
    return clamp(ramp, 0.0, 255.0);
}
