//! What is written into a picture on request.

use glam::DVec3;

use crate::canvas::Canvas;
use crate::{Frame, Projection, RenderRequest};

/// The smallest side of a picture that is written into, in pixels: the notice needs so much.
pub const MIN_ANNOTATED_SIDE: u32 = 128;

/// What stands at the foot of a picture.
const NOTICE: &str = "research use only";

/// Lengths that a scale bar may have, in mm.
const BARS_MM: [f64; 9] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];

/// The patient's directions along +L, +P, +S and against them.
const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['S', 'I']];

/// A second letter is written where its axis is at least 30° off the perpendicular.
const SECOND_LETTER: f64 = 0.5;

/// Writes depth, window, a scale bar, the patient's directions at the edges and the notice of research use into a picture.
///
/// A picture smaller than [`MIN_ANNOTATED_SIDE`] holds only part of it.
pub fn annotate(frame: Frame, request: &RenderRequest, projection: &Projection) -> Frame {
    let size = frame.size();
    let side = size.width().min(size.height());
    let [width, height] = [size.width() as i32, size.height() as i32];
    let mut canvas = Canvas::new(frame, side);
    let line = canvas.line_height();
    let margin = line / 2;
    let parameters = request.parameters();
    canvas.write(
        &format!("{} mm", short(parameters.depth_mm)),
        margin,
        margin,
    );
    let window = parameters.window;
    let text = format!("C {} W {}", short(window.centre()), short(window.width()));
    canvas.write(&text, margin, margin + line);
    let view_to_patient = parameters.camera.orientation().inverse();
    let [right, up] = [DVec3::X, DVec3::Y].map(|axis| letters(view_to_patient * axis));
    let [left, down] = [DVec3::X, DVec3::Y].map(|axis| letters(view_to_patient * -axis));
    let middle = (height - line) / 2;
    let centred = |canvas: &Canvas, text: &str| (width - canvas.text_width(text)) / 2;
    canvas.write(&left, margin, middle);
    let end = width - margin - canvas.text_width(&right);
    canvas.write(&right, end, middle);
    // The depth has the first line of its own where the picture is narrow.
    let at = centred(&canvas, &up);
    canvas.write(
        &up,
        at,
        if side < 320 {
            margin + 2 * line
        } else {
            margin
        },
    );
    let foot = height - margin - line;
    let at = centred(&canvas, &down);
    canvas.write(&down, at, foot - 3 * line);
    let at = centred(&canvas, NOTICE);
    canvas.write(NOTICE, at, foot);
    scale_bar(
        &mut canvas,
        projection.mm_per_pixel(),
        [width, foot - line, margin],
    );
    canvas.into_frame()
}

/// A bar of a round length, at most a quarter of the picture, with its length above it.
fn scale_bar(canvas: &mut Canvas, mm_per_pixel: f64, [width, foot, margin]: [i32; 3]) {
    let longest_mm = f64::from(width) / 4.0 * mm_per_pixel;
    let Some(&bar_mm) = BARS_MM.iter().rev().find(|&&mm| mm <= longest_mm) else {
        return;
    };
    let thickness = (canvas.line_height() / 5).max(2);
    let pixels = (bar_mm / mm_per_pixel).round() as i32;
    canvas.bar(margin, foot + canvas.line_height() / 2, pixels, thickness);
    canvas.write(
        &format!("{} mm", short(bar_mm)),
        margin,
        foot - canvas.line_height() / 2,
    );
}

/// The letters of a patient direction: that of the nearest axis, and a second one where it is oblique.
pub(crate) fn letters(direction: DVec3) -> String {
    let mut axes = [0, 1, 2].map(|axis| (direction[axis], LETTERS[axis]));
    axes.sort_by(|(a, _), (b, _)| b.abs().total_cmp(&a.abs()));
    let letter = |(along, [towards, against]): (f64, [char; 2])| {
        if along > 0.0 { towards } else { against }
    };
    let mut text = String::from(letter(axes[0]));
    if axes[1].0.abs() >= SECOND_LETTER {
        text.push(letter(axes[1]));
    }
    text
}

/// A number with at most two digits after its point.
pub(crate) fn short(number: f64) -> String {
    let rounded = (number * 100.0).round() / 100.0;
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        BoundingSphere, Camera, FrameSize, NamedView, PixelFormat, RenderParameters, Window,
    };

    fn annotated(view: NamedView, side: u32) -> Frame {
        let size = FrameSize::new(side, side).unwrap();
        let request = RenderRequest::new(RenderParameters {
            camera: Camera::named(view),
            size,
            ..RenderParameters::new(Window::between(0.0, 100.0))
        })
        .unwrap();
        let sphere = BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 100.0,
        };
        let projection = request.parameters().camera.projection(&sphere, size);
        let black = Frame::new(size, PixelFormat::Grey8, vec![0; size.pixel_count()]);
        annotate(black, &request, &projection)
    }

    /// White pixels in the boxes at the left and right edge, halfway down.
    fn edges(frame: &Frame) -> [Vec<u8>; 2] {
        let side = frame.size().width();
        let of = |range: std::ops::Range<u32>| {
            (side / 2 - 12..side / 2 + 12)
                .flat_map(|y| range.clone().map(move |x| (x, y)))
                .map(|(x, y)| frame.pixel(x, y).unwrap()[0])
                .collect()
        };
        [of(0..24), of(side - 24..side)]
    }

    #[test]
    fn directions_have_their_letters() {
        assert_eq!(letters(DVec3::X), "L");
        assert_eq!(letters(-DVec3::X), "R");
        assert_eq!(letters(-DVec3::Y), "A");
        assert_eq!(letters(DVec3::new(0.0, 0.6, -0.8)), "IP");
        assert_eq!(letters(DVec3::new(0.99, 0.14, 0.0)), "L");
    }

    #[test]
    fn both_sides_of_a_picture_are_named_and_differ() {
        let [left, right] = edges(&annotated(NamedView::Anterior, 512));
        assert!(left.contains(&255) && right.contains(&255));
        assert_ne!(left, right);
        let [other_left, _] = edges(&annotated(NamedView::Posterior, 512));
        assert_ne!(left, other_left);
    }

    #[test]
    fn every_size_is_written_into_without_harm() {
        for side in [1, 17, 128, 320, 4096] {
            let frame = annotated(NamedView::Left, side);
            assert_eq!(frame.size().width(), side);
        }
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(8.0), "8");
        assert_eq!(short(8.256), "8.26");
        assert_eq!(short(-0.5), "-0.5");
    }
}
