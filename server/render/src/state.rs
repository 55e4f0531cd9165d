//! The state of a picture, to be kept with it.

use crate::{Background, RenderRequest};

/// All that is needed to draw a picture again, as PNG texts (keyword, value) for [`crate::encode_png`], which adds the notice itself.
///
/// `case` is the case's id, which holds nothing of the patient; `renderer` the name of the one that drew. Lengths are in mm, the
/// orientation is the quaternion x,y,z,w from patient to view space, the window its centre and width.
pub fn state_texts(
    case: &str,
    renderer: &str,
    request: &RenderRequest,
) -> Vec<(&'static str, String)> {
    let parameters = request.parameters();
    let camera = &parameters.camera;
    let [x, y, z, w] = camera.orientation().to_array();
    let [right, up] = camera.pan_mm();
    let (centre, width) = (parameters.window.centre(), parameters.window.width());
    let background = match parameters.background {
        Background::Black => "black",
        Background::Transparent => "transparent",
    };
    let software = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));
    vec![
        ("Software", software.to_owned()),
        ("case", case.to_owned()),
        ("renderer", renderer.to_owned()),
        ("depth_mm", parameters.depth_mm.to_string()),
        ("orientation", format!("{x},{y},{z},{w}")),
        ("zoom", camera.zoom().to_string()),
        ("pan", format!("{right},{up}")),
        ("window", format!("{centre},{width}")),
        ("colormap", parameters.colormap.name().to_owned()),
        ("slab_mm", parameters.slab_mm.to_string()),
        ("ambient", parameters.light.ambient().to_string()),
        ("background", background.to_owned()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, RenderParameters, Window};

    #[test]
    fn a_camera_comes_back_from_the_texts() {
        let camera = Camera::new([0.1, -0.2, 0.3, 0.9], 1.7, [3.25, -4.5]).unwrap();
        let parameters = RenderParameters {
            depth_mm: 8.125,
            camera,
            ..RenderParameters::new(Window::new(50.5, 81.0).unwrap())
        };
        let texts = state_texts("abc", "trace", &RenderRequest::new(parameters).unwrap());
        let numbers = |keyword: &str| -> Vec<f64> {
            let (_, value) = texts.iter().find(|text| text.0 == keyword).unwrap();
            value
                .split(',')
                .map(|number| number.parse().unwrap())
                .collect()
        };
        assert_eq!(
            numbers("orientation"),
            camera.orientation().to_array().to_vec()
        );
        assert_eq!(numbers("zoom"), [1.7]);
        assert_eq!(numbers("pan"), [3.25, -4.5]);
        assert_eq!(numbers("depth_mm"), [8.125]);
        assert_eq!(numbers("window"), [50.5, 81.0]);
    }
}
