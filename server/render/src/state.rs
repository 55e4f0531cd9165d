//! The state of a picture, stored in its file.

use glam::{DQuat, DVec3};

use crate::annotate::edge_letters;
use crate::{Camera, Layers, RenderRequest, SliceRequest, Window, WindowFunction};

/// The name of the program in each picture.
pub const SOFTWARE: &str = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));

/// The state needed to draw a picture again, as PNG texts (keyword, value) for [`crate::encode_png`], which adds the
/// notice itself.
///
/// `case` is the id of the case, which reveals nothing about the patient; `renderer` is the name of the renderer.
/// Lengths are in mm, the orientation is the quaternion x,y,z,w from patient to view space, the window its centre and
/// width.
pub fn state_texts(
    case: &str,
    renderer: &str,
    request: &RenderRequest,
    layers: &Layers<'_>,
) -> Vec<(&'static str, String)> {
    let parameters = request.parameters();
    let mut texts = vec![
        ("Software", SOFTWARE.to_owned()),
        ("case", case.to_owned()),
        ("renderer", renderer.to_owned()),
        ("depth_mm", parameters.depth_mm.to_string()),
    ];
    let camera = camera_texts(&parameters.camera).into_iter();
    // A map does not turn.
    texts.extend(camera.filter(|(key, _)| parameters.map.is_none() || *key != "orientation"));
    texts.push(("window", window_text(parameters.window)));
    texts.extend(parameters.look.texts());
    if parameters.window.function() == WindowFunction::Sigmoid {
        texts.push(("window_function", "sigmoid".to_owned()));
    }
    texts.extend(layer_texts(layers));
    texts
}

/// The state needed to draw a slice again and to read it: see [`state_texts`].
///
/// `position_mm` is the LPS coordinate across the `plane`, `depth_mm` the depths of the contours with commas (empty if
/// there are none), and `convention` states the directions of the patient: `left R, right L, up A, down P`.
pub fn slice_texts(
    case: &str,
    request: &SliceRequest,
    layers: &Layers<'_>,
) -> Vec<(&'static str, String)> {
    let parameters = request.parameters();
    let depths: Vec<_> = parameters.depths_mm.iter().map(f64::to_string).collect();
    let mut texts = vec![("Software", SOFTWARE.to_owned()), ("case", case.to_owned())];
    match parameters.oblique {
        Some(oblique) => {
            let numbers = |vector: DVec3| vector.to_array().map(|each| each.to_string()).join(",");
            texts.extend([
                ("plane", "oblique".to_owned()),
                ("position", numbers(oblique.centre_in_patient())),
                ("normal", numbers(oblique.normal())),
            ]);
        }
        None => texts.extend([
            ("plane", parameters.plane.name().to_owned()),
            ("position_mm", parameters.position_mm.to_string()),
        ]),
    }
    texts.extend([
        ("depth_mm", depths.join(",")),
        ("convention", convention(request.camera().orientation())),
    ]);
    texts.extend(camera_texts(request.camera()));
    texts.extend([
        ("window", window_text(parameters.window)),
        ("colormap", parameters.colormap.name().to_owned()),
    ]);
    if parameters.has_edges {
        texts.push(("edges", true.to_string()));
    }
    texts.extend(layer_texts(layers));
    texts
}

/// The layers of a picture, under the keys of its request; empty without layers.
fn layer_texts(layers: &Layers<'_>) -> Vec<(&'static str, String)> {
    let mut texts = Vec::new();
    if let Some(base) = layers.base {
        texts.push(("layer", base.name().to_owned()));
        if !base.origin().is_empty() {
            texts.push(("layer_unit", base.unit().to_owned()));
            texts.push(("layer_place", base.origin().to_owned()));
        }
    }
    if let Some(overlay) = layers.overlay {
        let parameters = overlay.style.parameters();
        let [low, high] = parameters.window;
        let threshold = parameters.threshold.map(|threshold| threshold.to_string());
        texts.extend([
            ("overlay", overlay.layer.name().to_owned()),
            ("overlay_window", format!("{low},{high}")),
            ("overlay_colormap", parameters.colormap.name().to_owned()),
            ("overlay_threshold", threshold.unwrap_or_default()),
            ("overlay_opacity", parameters.opacity.to_string()),
        ]);
        if !overlay.layer.origin().is_empty() {
            texts.push(("overlay_unit", overlay.layer.unit().to_owned()));
            texts.push(("overlay_place", overlay.layer.origin().to_owned()));
        }
    }
    texts
}

fn camera_texts(camera: &Camera) -> [(&'static str, String); 3] {
    let [x, y, z, w] = camera.orientation().to_array();
    let [right, up] = camera.pan_mm();
    [
        ("orientation", format!("{x},{y},{z},{w}")),
        ("zoom", camera.zoom().to_string()),
        ("pan", format!("{right},{up}")),
    ]
}

/// A window in the syntax of the interfaces: `c,w`.
fn window_text(window: Window) -> String {
    format!("{},{}", window.centre(), window.width())
}

/// The directions of the patient in a picture.
fn convention(orientation: DQuat) -> String {
    let [left, right, up, down] = edge_letters(orientation);
    format!("left {left}, right {right}, up {up}, down {down}")
}

/// The state of a quality sheet: see [`state_texts`].
pub fn sheet_texts(case: &str, window: Window) -> Vec<(&'static str, String)> {
    vec![
        ("Software", SOFTWARE.to_owned()),
        ("case", case.to_owned()),
        ("window", window_text(window)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RenderParameters, SliceParameters, SlicePlane};

    #[test]
    fn a_camera_comes_back_from_the_texts() {
        let camera = Camera::new([0.1, -0.2, 0.3, 0.9], 1.7, [3.25, -4.5]).unwrap();
        let parameters = RenderParameters {
            depth_mm: 8.125,
            camera,
            ..RenderParameters::new(Window::new(50.5, 81.0).unwrap())
        };
        let texts = state_texts(
            "abc",
            "trace",
            &RenderRequest::new(parameters).unwrap(),
            &Layers::default(),
        );
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
    #[test]
    fn a_slice_says_where_it_lies_and_which_way_the_patient_does() {
        for (plane, convention) in [
            (SlicePlane::Axial, "left R, right L, up A, down P"),
            (SlicePlane::Coronal, "left R, right L, up S, down I"),
            (SlicePlane::Sagittal, "left A, right P, up S, down I"),
        ] {
            let parameters = SliceParameters {
                depths_mm: vec![5.0, 7.5],
                zoom: 2.0,
                pan_mm: [1.5, -3.0],
                ..SliceParameters::new(plane, -20.25, Window::new(50.5, 81.0).unwrap())
            };
            let texts = slice_texts(
                "abc",
                &SliceRequest::new(parameters).unwrap(),
                &Layers::default(),
            );
            for (keyword, value) in [
                ("case", "abc"),
                ("plane", plane.name()),
                ("position_mm", "-20.25"),
                ("depth_mm", "5,7.5"),
                ("convention", convention),
                ("zoom", "2"),
                ("pan", "1.5,-3"),
                ("window", "50.5,81"),
                ("colormap", "grey"),
            ] {
                let text = texts.iter().find(|text| text.0 == keyword).unwrap();
                assert_eq!(text.1, value, "{keyword}");
            }
        }
    }
}
