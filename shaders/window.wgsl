// The display window, DICOM PS3.3 C.11.2.1.2.1 and C.11.2.1.3.1.

// Brightness, 0 to 255, of a stored intensity.
fn brightness(stored: f32) -> f32 {
    let ramp = (stored - picture.window_black) * picture.window_factor + picture.window_offset;
    if picture.window_is_sigmoid == 1u {
        return 255.0 / (1.0 + exp(-ramp));
    }
    return clamp(ramp, 0.0, 255.0);
}
