//! Layers, as every renderer must draw them.

use geometry::Grid;
use glam::{DAffine3, DVec3};

use super::{Limits, Phantom, Renderer, aligned, bright, cameras, lit, parameters, request};
use crate::{
    Background, Camera, ColorMap, Frame, KeyedLayer, KeyedLayers, Layer, LayerKey, LayerValues,
    Look, NamedView, OverlayParameters, OverlayStyle, RenderBackend, RenderParameters, Window,
};

pub(super) fn check(renderer: &Renderer, limits: &Limits) {
    an_overlay_shows_on_its_side_alone(renderer);
    an_overlay_that_hides_nothing_changes_nothing(renderer);
    colours_lie_over_the_texture_as_the_formula_says(renderer);
    undefined_is_transparent(renderer);
    a_layer_in_place_of_the_intensities_shows_its_own_values(renderer);
    overlays_agree_with_the_exact_ones(renderer, limits);
}

/// The edge of a layer's voxel, in mm.
const LAYER_MM: f64 = 1.7;

/// Where the layer's own patient space lies in that of the case.
fn case_from_layer() -> DAffine3 {
    DAffine3::from_rotation_y(0.3) * DAffine3::from_translation(DVec3::new(4.0, -9.0, 2.0))
}

/// A layer on an oblique grid around the ellipsoid that is `value` of a position of the case; NaN is undefined.
fn layer(is_coded: bool, value: impl Fn(DVec3) -> f32) -> KeyedLayer {
    let corner = case_from_layer().inverse().transform_point3(super::CENTRE) - DVec3::splat(52.0);
    let grid = Grid::aligned([62; 3], [LAYER_MM; 3], corner).unwrap();
    let from_voxel = case_from_layer() * grid.patient_from_voxel();
    let values: Vec<f32> = (0..grid.voxel_count())
        .map(|index| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            value(from_voxel.transform_point3(voxel))
        })
        .collect();
    let values = if is_coded {
        let code = |value: &f32| match value.is_nan() {
            true => 0,
            false => ((value + 12.7) / 0.1 + 1.5).clamp(1.0, 255.0) as u8,
        };
        LayerValues::Codes {
            codes: values.iter().map(code).collect(),
            least: -12.7,
            step: 0.1,
        }
    } else {
        LayerValues::Numbers(values)
    };
    let layer = Layer::new(["made up", "z"], &grid, case_from_layer(), values).unwrap();
    KeyedLayer {
        key: LayerKey(super::next_key().0),
        layer: std::sync::Arc::new(layer),
    }
}

fn style(colormap: ColorMap, threshold: Option<f64>, opacity: f64) -> OverlayStyle {
    let parameters = OverlayParameters {
        window: [2.0, 8.0],
        colormap,
        threshold,
        opacity,
    };
    OverlayStyle::new(parameters).unwrap()
}

fn over(overlay: KeyedLayer, style: OverlayStyle) -> KeyedLayers {
    KeyedLayers {
        base: None,
        overlay: Some((overlay, style)),
    }
}

fn seen_from(view: NamedView) -> RenderParameters {
    RenderParameters {
        depth_mm: 6.0,
        camera: Camera::named(view),
        ..parameters()
    }
}

/// How many pixels have a colour.
fn coloured(frame: &Frame) -> usize {
    let pixels = frame.bytes().chunks_exact(3);
    pixels
        .filter(|pixel| pixel[0].abs_diff(pixel[2]) > 20)
        .count()
}

fn an_overlay_shows_on_its_side_alone(renderer: &Renderer) {
    let case = bright();
    let side = |sign: f64| {
        move |position: DVec3| {
            if sign * (position.x - 5.0) > 3.0 {
                8.0
            } else {
                0.0
            }
        }
    };
    for (is_coded, sign, shows, hides) in [
        (true, 1.0, NamedView::Left, NamedView::Right),
        (false, -1.0, NamedView::Right, NamedView::Left),
    ] {
        let layers = over(
            layer(is_coded, side(sign)),
            style(ColorMap::VermilionYellow, Some(2.5), 1.0),
        );
        let renderer = renderer.with_layers(layers);
        let [shown, hidden] =
            [shows, hides].map(|view| coloured(&renderer.draw(&case, &request(seen_from(view)))));
        assert!(shown > 2000, "{shows:?} {shown}");
        assert_eq!(hidden, 0, "{hides:?}");
        // Facing the patient, the left is at the right of the picture.
        let front = renderer.draw(&case, &request(seen_from(NamedView::Anterior)));
        for (y, x) in (0..96).flat_map(|y| (0..96).map(move |x| (y, x))) {
            let pixel = front.pixel(x, y).unwrap();
            let is_at_the_right = x >= 48;
            if pixel[0].abs_diff(pixel[2]) > 20 {
                assert_eq!(is_at_the_right, sign > 0.0, "({x}, {y})");
            }
        }
    }
}

fn an_overlay_that_hides_nothing_changes_nothing(renderer: &Renderer) {
    let case = bright();
    let plain = renderer.draw(&case, &request(seen_from(NamedView::Left)));
    for (value, opacity) in [(8.0, 0.0), (2.4, 1.0), (f32::NAN, 1.0)] {
        let layers = over(
            layer(true, |_| value),
            style(ColorMap::Hot, Some(2.5), opacity),
        );
        let frame = renderer
            .with_layers(layers)
            .draw(&case, &request(seen_from(NamedView::Left)));
        let same = frame.bytes().chunks_exact(3).zip(plain.bytes());
        for (pixel, &grey) in same {
            assert_eq!(pixel, [grey; 3], "{value} {opacity}");
        }
    }
}

/// One value everywhere, on a texture of brightness 200, without shading.
fn colours_lie_over_the_texture_as_the_formula_says(renderer: &Renderer) {
    let case = bright();
    for colormap in [
        ColorMap::VermilionYellow,
        ColorMap::BlueOrange,
        ColorMap::Viridis,
    ] {
        for (value, threshold, opacity) in [
            (5.0_f32, None, 1.0),
            (5.0, Some(2.5), 0.6),
            (2.8, Some(2.5), 0.7),
            (-6.0, Some(2.5), 1.0),
            (9.5, Some(2.5), 0.35),
        ] {
            let layers = over(layer(false, |_| value), style(colormap, threshold, opacity));
            let frame = renderer
                .with_layers(layers)
                .draw(&case, &request(seen_from(NamedView::Superior)));
            let value = f64::from(value);
            let size = if colormap == ColorMap::BlueOrange {
                value.abs()
            } else {
                value
            };
            let rise = threshold.map_or(1.0, |least| ((size - least) / 0.6).clamp(0.0, 1.0));
            let share = opacity * rise * rise * (3.0 - 2.0 * rise);
            let level = (255.0 * (value - 2.0) / 6.0).clamp(0.0, 255.0).round();
            let above = colormap.table()[level as usize];
            let found = frame.pixel(48, 48).unwrap();
            for channel in 0..3 {
                let expected = 200.0 + share * (f64::from(above[channel]) - 200.0);
                assert!(
                    (f64::from(found[channel]) - expected).abs() <= 1.0,
                    "{colormap:?} {value}: {found:?}, {expected} for {channel}"
                );
            }
        }
    }
}

fn undefined_is_transparent(renderer: &Renderer) {
    let case = bright();
    // Defined at the front alone.
    let value = |position: DVec3| {
        if position.y < super::CENTRE.y {
            8.0
        } else {
            f32::NAN
        }
    };
    for is_coded in [true, false] {
        let layers = over(
            layer(is_coded, value),
            style(ColorMap::VermilionYellow, None, 1.0),
        );
        let frame = renderer
            .with_layers(layers)
            .draw(&case, &request(seen_from(NamedView::Left)));
        // Seen from the left, anterior is at the left.
        assert_eq!(frame.pixel(30, 48), Some(&[240, 228, 66][..]));
        assert_eq!(frame.pixel(66, 48), Some(&[200; 3][..]));
        for index in 0..96 * 96 {
            let [x, y] = [index % 96, index / 96];
            let pixel = &frame.bytes()[3 * index..][..3];
            // No colour of a smaller value stands at the rim of what is defined.
            let is_whole = pixel[0] >= 195 && pixel[1] >= 195;
            assert!(
                pixel[0] == 0 || is_whole || super::is_beside_black(&frame, x, y),
                "{pixel:?} at ({x}, {y})"
            );
        }
    }
}

fn a_layer_in_place_of_the_intensities_shows_its_own_values(renderer: &Renderer) {
    let case = bright();
    let value = |position: DVec3| (0.1 * (position.x - super::CENTRE.x) + 0.05 * position.z) as f32;
    for is_coded in [true, false] {
        let base = layer(is_coded, value);
        let renderer = renderer.with_layers(KeyedLayers {
            base: Some(base),
            overlay: None,
        });
        for slab_mm in [0.0, 2.0] {
            let request = request(RenderParameters {
                window: Window::between(-5.0, 5.0),
                look: Look { slab_mm, ..lit() },
                ..seen_from(NamedView::Anterior)
            });
            let frame = renderer.draw(&case, &request);
            let hits = renderer.hits(&case, &request);
            let mut covered = 0;
            for (x, y) in (8..88).flat_map(|y| (8..88).map(move |x| (x, y))) {
                let Some(position) = hits.position_in_patient(x, y) else {
                    continue;
                };
                let expected = 25.5 * f64::from(value(position) + 5.0);
                let found = f64::from(frame.pixel(x, y).unwrap()[0]);
                if is_at_rim(&frame, [x, y]) {
                    continue;
                }
                assert!(
                    (found - expected).abs() < 4.0,
                    "{found} for {expected} at ({x}, {y}), slab {slab_mm}"
                );
                covered += 1;
            }
            assert!(covered > 1000, "{covered}");
        }
    }
    let nothing = renderer.with_layers(KeyedLayers {
        base: Some(layer(true, |_| f32::NAN)),
        overlay: None,
    });
    let frame = nothing.draw(&case, &request(seen_from(NamedView::Left)));
    assert!(frame.bytes().iter().all(|&byte| byte == 0));
}

/// Whether a pixel of a grey picture is black, or beside one that is, two pixels around.
fn is_at_rim(frame: &Frame, [x, y]: [u32; 2]) -> bool {
    let around = (y - 2..=y + 2).flat_map(|y| (x - 2..=x + 2).map(move |x| [x, y]));
    around
        .into_iter()
        .any(|[x, y]| frame.pixel(x, y).is_none_or(|pixel| pixel[0] == 0))
}

/// The same picture as the exact renderer's, in colours, with shading, and with a layer below.
fn overlays_agree_with_the_exact_ones(renderer: &Renderer, limits: &Limits) {
    let case = Phantom::new(aligned(), |position| {
        (3.0 * position.x - 2.0 * position.y + position.z + 300.0) as u16
    });
    let waves =
        |position: DVec3| (8.0 * (position.y / 9.0).sin() * (position.z / 7.0).cos()) as f32;
    let some = move |position: DVec3| {
        if position.z > 20.0 {
            f32::NAN
        } else {
            waves(position)
        }
    };
    for (base, colormap) in [
        (None, ColorMap::VermilionYellow),
        (None, ColorMap::BlueOrange),
        (Some(layer(true, waves)), ColorMap::BlueOrange),
    ] {
        let window = match base {
            None => Window::between(100.0, 500.0),
            Some(_) => Window::between(-9.0, 9.0),
        };
        let layers = KeyedLayers {
            base,
            overlay: Some((layer(true, some), style(colormap, Some(2.5), 0.8))),
        };
        let judge = Renderer::new(RenderBackend::Trace).with_layers(layers.clone());
        let renderer = renderer.with_layers(layers);
        for camera in cameras() {
            let request = request(RenderParameters {
                depth_mm: 8.0,
                camera,
                look: Background::Transparent.into(),
                window,
                ..parameters()
            });
            let [found, exact] = [&renderer, &judge].map(|renderer| renderer.draw(&case, &request));
            assert_eq!(found.format(), exact.format());
            let [mut sum, mut both] = [0.0; 2];
            for index in 0..96 * 96 {
                let [x, y] = [index % 96, index / 96];
                let [a, b] = [&found, &exact].map(|frame| frame.pixel(x, y).unwrap());
                if a[3] > 0 && b[3] > 0 && !is_at_alpha_edge(&exact, [x, y]) {
                    both += 1.0;
                    let apart = |channel: usize| f64::from(a[channel].abs_diff(b[channel]));
                    sum += (apart(0) + apart(1) + apart(2)) / 3.0;
                }
            }
            assert!(both > 500.0, "{camera:?}");
            let mean = sum / both;
            // Colours change faster from place to place than the grey of the other checks.
            let most = 2.0 * limits.mean_difference;
            assert!(mean <= most, "{mean} levels off, {colormap:?} {camera:?}");
        }
    }
}

/// Whether the pixels around a pixel of a picture in colours with alpha differ in that they show something.
fn is_at_alpha_edge(frame: &Frame, [x, y]: [u32; 2]) -> bool {
    let shown = |x, y| frame.pixel(x, y).is_some_and(|pixel| pixel[3] > 0);
    let around = (y.saturating_sub(1)..=y + 1)
        .flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| shown(x, y)));
    let around: Vec<bool> = around.collect();
    around.contains(&true) && around.contains(&false)
}
