//! Slices through a ball whose contours are circles.

use geometry::{BoundingSphere, Cut, Envelope, Face, Grid, phantom};
use glam::{DAffine3, DVec3};

use super::*;
use crate::{Layer, LayerValues, Layers, Overlay, OverlayParameters, OverlayStyle};

/// A ball of radius 25 mm about the origin, cut through its middle.
fn draw(plane: SlicePlane, depths_mm: Vec<f64>) -> Frame {
    draw_shape(
        |position| position.length() <= 25.0,
        SliceParameters {
            depths_mm,
            ..parameters(plane, 0.0)
        },
    )
}

/// A slice of 160 pixels along each side.
fn parameters(plane: SlicePlane, position_mm: f64) -> SliceParameters {
    SliceParameters {
        size: FrameSize::new(160, 160).unwrap(),
        ..SliceParameters::new(plane, position_mm, Window::between(0.0, 255.0))
    }
}

/// A shape at 1 mm, and a volume around it, bright where the patient's left is.
fn draw_shape(is_inside: impl Fn(DVec3) -> bool, parameters: SliceParameters) -> Frame {
    let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
    let envelope = phantom::envelope(&grid, is_inside);
    draw_envelope(envelope, parameters)
}

/// An envelope at 1 mm, and the same volume around it.
fn draw_envelope(envelope: Envelope, parameters: SliceParameters) -> Frame {
    let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
    // Brighter to the left (+100), to posterior (+40) and to superior (+20).
    let volume = phantom::volume(grid, |position| {
        let [left, posterior, superior] = position
            .to_array()
            .map(|coordinate| f64::from(coordinate > 0.0));
        (10.0 + 100.0 * left + 40.0 * posterior + 20.0 * superior) as u16
    });
    let model = phantom::model(volume, envelope).model;
    let scene = Scene {
        normals: model.field(),
        bounds: BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 40.0,
        },
        ..Scene::from(&model)
    };
    draw_slice(&scene, &SliceRequest::new(parameters).unwrap())
}

#[test]
fn beside_a_cut_there_is_no_contour_where_its_depth_is_unknown() {
    let cut = Cut {
        face: Face::Left,
        inward: DVec3::NEG_X,
        offset_mm: -10.0,
    };
    let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
    let is_seen = |position: DVec3| position.length() <= 25.0 && cut.distance_mm(position) >= 0.0;
    let of_cut_ball = |cuts: Vec<Cut>, depth_mm: f64| {
        let envelope = phantom::envelope(&grid, is_seen).with_cuts(cuts);
        let parameters = SliceParameters {
            depths_mm: vec![depth_mm],
            ..parameters(SlicePlane::Axial, 0.0)
        };
        draw_envelope(envelope, parameters)
    };
    // Pixels of 0.5 mm, the patient's left on the right: the contour of 8 mm is known up to 2 - 0.98 mm left of the middle, less
    // the 1.1 pixels that it reaches.
    let colored = |frame: &Frame| {
        let pixels = frame.bytes().as_chunks::<3>().0.iter();
        let colored = pixels.map(|[red, green, blue]| red != green || green != blue);
        colored.collect::<Vec<_>>()
    };
    let [known, every] = [vec![cut], Vec::new()].map(|cuts| colored(&of_cut_ball(cuts, 8.0)));
    let column_of = |index: usize| index % 160;
    let rightmost = |pixels: &[bool]| {
        let columns = (0..pixels.len())
            .filter(|&index| pixels[index])
            .map(column_of);
        columns.max().unwrap()
    };
    assert!(
        (79..=81).contains(&rightmost(&known)),
        "{}",
        rightmost(&known)
    );
    assert!(rightmost(&every) >= 83, "{}", rightmost(&every));
    // Elsewhere it is the same.
    for index in (0..known.len()).filter(|&index| column_of(index) < 80) {
        assert_eq!(known[index], every[index], "{index}");
    }
    assert!(known.iter().filter(|&&is_colored| is_colored).count() > 80);
}

#[test]
fn a_slice_without_a_model_is_that_with_one_without_contours() {
    let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
    let envelope = phantom::envelope(&grid, |position| position.length() <= 25.0);
    let volume = phantom::volume(grid, |position| {
        (100.0 + position.x + 2.0 * position.y - position.z) as u16
    });
    let bounds = BoundingSphere::of_grid(volume.grid());
    let model = phantom::model(volume.clone(), envelope).model;
    for (plane, colormap) in [
        (SlicePlane::Axial, ColorMap::Grey),
        (SlicePlane::Coronal, ColorMap::Hot),
        (SlicePlane::Sagittal, ColorMap::Grey),
    ] {
        let request = SliceRequest::new(SliceParameters {
            colormap,
            ..parameters(plane, 3.0)
        })
        .unwrap();
        let scene = Scene {
            volume: &volume,
            bounds,
            ..Scene::from(&model)
        };
        let acquired = draw_acquired_slice(&volume, &bounds, &request);
        assert_eq!(acquired, draw_slice(&scene, &request), "{plane:?}");
    }
}

/// The grey levels at upper left, upper right, lower left and lower right.
fn corners(frame: &Frame) -> [u8; 4] {
    assert_eq!(frame.format(), PixelFormat::Grey8);
    [(60, 60), (100, 60), (60, 100), (100, 100)].map(|(x, y)| frame.pixel(x, y).unwrap()[0])
}

#[test]
fn in_the_neurological_convention_left_is_at_the_left() {
    let is_inside = |position: DVec3| position.length() <= 25.0;
    let corners = |plane| {
        let parameters = SliceParameters {
            convention: SliceConvention::Neurological,
            ..parameters(plane, 0.0)
        };
        corners(&draw_shape(is_inside, parameters))
    };
    assert_eq!(corners(SlicePlane::Axial), [110, 10, 150, 50]);
    assert_eq!(corners(SlicePlane::Coronal), [130, 30, 110, 10]);
    assert_eq!(corners(SlicePlane::Sagittal), [30, 70, 10, 50]);
}

#[test]
fn slices_lie_as_radiologists_want_them() {
    let corners = |plane| corners(&draw(plane, Vec::new()));
    // Anterior up, the patient's left at the right.
    assert_eq!(corners(SlicePlane::Axial), [10, 110, 50, 150]);
    assert_eq!(corners(SlicePlane::Coronal), [30, 130, 10, 110]);
    // Anterior at the left.
    assert_eq!(corners(SlicePlane::Sagittal), [30, 70, 10, 50]);
}

#[test]
fn outside_of_the_volume_a_slice_is_black() {
    let frame = draw(SlicePlane::Axial, Vec::new());
    assert_eq!(frame.pixel(2, 80), Some(&[0][..]));
    assert_eq!(frame.pixel(157, 157), Some(&[0][..]));
}

#[test]
fn contours_are_where_the_depth_is() {
    // Half a millimetre a pixel: the circles of 5 and 15 mm depth have radii of about 39.5 and 19.5 pixels.
    let frame = draw(SlicePlane::Axial, vec![5.0, 15.0]);
    assert_eq!(frame.format(), PixelFormat::Rgb8);
    let is_colored = |x: u32, y: u32| {
        let pixel = frame.pixel(x, y).unwrap();
        pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 60
    };
    for y in 0..160 {
        for x in 0..160 {
            let radius_px = (f64::from(x) - 79.5).hypot(f64::from(y) - 79.5);
            let nearest_px = (radius_px - 39.5).abs().min((radius_px - 19.5).abs());
            assert!(!is_colored(x, y) || nearest_px < 3.0, "{x} {y}");
        }
    }
    let lit = (0..160).filter(|&x| is_colored(x, 80)).count();
    assert!((4..=12).contains(&lit), "{lit} pixels of four crossings");
}

#[test]
fn a_flat_piece_on_a_level_is_outlined_and_not_filled() {
    // 10 mm above the cube's bottom the depth is 10 mm throughout, but for 10 mm along its sides.
    let cube = |position: DVec3| position.abs().max_element() <= 25.0;
    let parameters = SliceParameters {
        depths_mm: vec![10.0],
        ..parameters(SlicePlane::Axial, -15.0)
    };
    let frame = draw_shape(cube, parameters);
    let is_colored = |x: u32, y: u32| {
        let pixel = frame.pixel(x, y).unwrap();
        pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 60
    };
    // Half a millimetre a pixel: the outline is a square of 60 pixels a side.
    for y in 0..160 {
        for x in 0..160 {
            let [across, down] = [x, y].map(|place| (f64::from(place) - 79.5).abs());
            assert!(
                !is_colored(x, y) || (across.max(down) - 30.0).abs() < 3.0,
                "{x} {y}"
            );
        }
    }
    let lit = (0..160).filter(|&x| is_colored(x, 80)).count();
    assert!((2..=8).contains(&lit), "{lit} pixels of two crossings");
}

#[test]
fn impossible_slices_are_refused() {
    let good = SliceParameters::new(SlicePlane::Axial, 0.0, Window::between(0.0, 1.0));
    assert!(SliceRequest::new(good.clone()).is_ok());
    for bad in [
        SliceParameters {
            position_mm: f64::NAN,
            ..good.clone()
        },
        SliceParameters {
            depths_mm: vec![-1.0],
            ..good.clone()
        },
        SliceParameters {
            depths_mm: vec![1.0; MAX_CONTOURS + 1],
            ..good.clone()
        },
        SliceParameters {
            zoom: 0.0,
            ..good.clone()
        },
    ] {
        assert!(SliceRequest::new(bad).is_err());
    }
}

/// An axial slice of 0.5 mm a pixel, with the edges of a layer over a ball of 25 mm. The layer has voxels of 2 mm, and values of 0 to
/// 100 and back over 2 mm about a circle of 15 mm, in the middle of `case_from_layer`; it is undefined beyond 24 mm to the right.
fn draw_edges(shift: DVec3, window: [f64; 2]) -> Frame {
    let grid = Grid::aligned([31; 3], [2.0; 3], DVec3::splat(-30.0)).unwrap();
    let mut values = Vec::new();
    for z in 0..31 {
        for y in 0..31 {
            for x in 0..31 {
                let position = DVec3::new(x.into(), y.into(), z.into()) * 2.0 - 30.0;
                let value = ((15.0 - position.length()) / 2.0 + 0.5).clamp(0.0, 1.0) * 100.0;
                values.push(if position.x < -24.0 {
                    f32::NAN
                } else {
                    value as f32
                });
            }
        }
    }
    let moved = DAffine3::from_translation(shift);
    let layer = Layer::new(["T2", ""], &grid, moved, LayerValues::Numbers(values)).unwrap();
    let style = OverlayStyle::new(OverlayParameters {
        window,
        colormap: ColorMap::Hot,
        threshold: Some(1e6),
        opacity: 0.0,
    });
    let volume = phantom::volume(
        Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap(),
        |_| 40,
    );
    let envelope = phantom::envelope(volume.grid(), |position| position.length() <= 25.0);
    let model = phantom::model(volume, envelope).model;
    let scene = Scene {
        bounds: BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 40.0,
        },
        ..Scene::from(&model)
    };
    let scene = scene.with_layers(Layers {
        base: None,
        overlay: Some(Overlay {
            layer: &layer,
            style: style.unwrap(),
        }),
    });
    let parameters = SliceParameters {
        has_edges: true,
        ..parameters(SlicePlane::Axial, 0.0)
    };
    draw_slice(&scene, &SliceRequest::new(parameters).unwrap())
}

/// The places of the pixels that an edge covers by more than half.
fn edge_pixels(frame: &Frame) -> Vec<[f64; 2]> {
    let places = (0..160).flat_map(|y| (0..160).map(move |x| [x, y]));
    let is_edge = |[x, y]: &[u32; 2]| {
        let pixel = frame.pixel(*x, *y).unwrap();
        pixel[0] > 148 && pixel[0] > pixel[1] + 80
    };
    let edges = places.filter(is_edge);
    edges
        .map(|place| place.map(|side| f64::from(side) - 79.5))
        .collect()
}

#[test]
fn edges_are_thin_lines_where_a_layer_is_steepest() {
    // The patient's left is at the right, posterior is down: the circle of 30 pixels lies 8 pixels to the right and 4 up.
    let edges = edge_pixels(&draw_edges(DVec3::new(4.0, -2.0, 0.0), [0.0, 100.0]));
    for [x, y] in &edges {
        let radius_px = (x - 8.0).hypot(y + 4.0);
        assert!((radius_px - 30.0).abs() < 3.0, "{x} {y}: {radius_px}");
    }
    let length_px = std::f64::consts::TAU * 30.0;
    let width_px = edges.len() as f64 / length_px;
    assert!((0.8..2.0).contains(&width_px), "{width_px}");
    // Every direction has some.
    for eighth in 0..8 {
        let is_there = |[x, y]: &[f64; 2]| {
            let angle = (y + 4.0).atan2(x - 8.0) / std::f64::consts::TAU + 0.5;
            (angle * 8.0) as i32 % 8 == eighth
        };
        assert!(edges.iter().any(is_there), "{eighth}");
    }
}

#[test]
fn a_rise_that_is_slight_in_the_window_is_no_edge() {
    // 100 in 2 mm are 6 of 255 colours per mm.
    assert_eq!(
        edge_pixels(&draw_edges(DVec3::ZERO, [0.0, 2000.0])),
        Vec::<[f64; 2]>::new()
    );
}

/// A ball painted on the patient's left, seen in planes of many directions: it is where the projection and the letters say.
#[test]
fn a_ball_on_the_left_is_where_the_letters_of_an_oblique_slice_say() {
    let ball = DVec3::new(14.0, -4.0, 6.0);
    let grid = Grid::aligned([61; 3], [1.0; 3], DVec3::splat(-30.0)).unwrap();
    let envelope = phantom::envelope(&grid, |position| position.length() <= 25.0);
    let painted = |position: DVec3| 10 + 240 * u16::from(position.distance(ball) <= 4.0);
    let model = phantom::model(phantom::volume(grid, painted), envelope).model;
    let scene = Scene {
        bounds: BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 40.0,
        },
        ..Scene::from(&model)
    };
    let mut seen = [0; 2];
    for convention in [SliceConvention::Radiological, SliceConvention::Neurological] {
        for number in 0..24 {
            // Planes that hold the middle of the ball, turned about its direction from the origin.
            let (sin, cos) = (f64::from(number) * 7.5).to_radians().sin_cos();
            let (x, y) = ball.normalize().any_orthonormal_pair();
            let oblique = Oblique::new([0.0; 3], (x * cos + y * sin).to_array()).unwrap();
            let parameters = SliceParameters {
                convention,
                oblique: Some(oblique),
                ..parameters(SlicePlane::Axial, 0.0)
            };
            let request = SliceRequest::new(parameters).unwrap();
            let frame = draw_slice(&scene, &request);
            let bright: Vec<_> = (0..160 * 160)
                .filter(|&at| frame.bytes()[at] > 128)
                .collect();
            let mean = |of: fn(usize) -> usize| {
                bright.iter().map(|&at| of(at) as f64 + 0.5).sum::<f64>() / bright.len() as f64
            };
            let [column, row] = [mean(|at| at % 160), mean(|at| at / 160)];
            let projection = request.projection(&scene.bounds);
            let expected = projection.frame_from_patient().transform_point3(ball);
            assert!(
                (column - expected.x).hypot(row - expected.y) < 0.5,
                "{column} {row} {expected}"
            );
            assert!(expected.z.abs() < 1e-9);
            // The edge with an L is the one that the ball is nearer to.
            let letters = crate::edge_letters(request.camera().orientation());
            let towards = [80.0 - column, column - 80.0, 80.0 - row, row - 80.0];
            for (letters, towards) in letters.iter().zip(towards) {
                if letters.starts_with('L') {
                    assert!(towards > 0.0, "{letters} {towards}");
                    seen[usize::from(convention == SliceConvention::Neurological)] += 1;
                } else if letters.starts_with('R') {
                    assert!(towards < 0.0, "{letters} {towards}");
                }
            }
            let at_right = letters[1].starts_with('L');
            let at_left = letters[0].starts_with('L');
            match convention {
                SliceConvention::Radiological => assert!(!at_left, "{letters:?}"),
                SliceConvention::Neurological => assert!(!at_right, "{letters:?}"),
            }
        }
    }
    assert!(seen.iter().all(|&count| count > 12), "{seen:?}");
}
