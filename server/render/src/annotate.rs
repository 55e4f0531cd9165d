//! Writes text into a picture on request.

use glam::{DQuat, DVec3};

use crate::canvas::Canvas;
use crate::slice::{EDGE_COLOR, contour_color};
use crate::{
    ColorMap, Frame, FrameSize, Layer, LayerValues, Layers, Overlay, Projection, RenderParameters,
    RenderRequest, SHORT_NOTICE, SlicePlane, SliceRequest, Window, WindowFunction,
};

/// The smallest side of an annotated picture, in pixels: the notice needs this much.
pub const MIN_ANNOTATED_SIDE: u32 = 128;

/// The length of a day and the first digits of an id with their separators: ` 2026-01-01 · 01234567`.
const DAY_AND_ID: usize = 22;

/// Possible lengths of a scale bar, in mm.
const BARS_MM: [f64; 9] = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];

/// The patient's directions along +L, +P, +S and against them.
const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['S', 'I']];

/// The length of the colours in a legend, in lines of text.
const BAR_LINES: i32 = 4;

/// The grey under the colours of a legend, between dark and bright tissue.
const BAR_GREY: u8 = 96;

/// A second letter is written where its axis is at least 30° off the perpendicular.
const SECOND_LETTER: f64 = 0.5;

/// What an annotated picture says of its case.
#[derive(Debug, Clone, Copy, Default)]
pub struct Caption<'a> {
    /// The first line.
    pub named: Option<&'a str>,
    /// The surface below which depth is measured, unless it is that of the whole brain.
    pub surface: Option<&'a str>,
}

/// Writes depth, window, a scale bar, the patient's directions at the edges and the notice of research use into a
/// picture; with layers also the name of the texture, and the colours of the overlay with their values.
///
/// A picture smaller than [`MIN_ANNOTATED_SIDE`] has room for only a part.
pub fn annotate(
    frame: Frame,
    request: &RenderRequest,
    projection: &Projection,
    layers: &Layers<'_>,
    caption: Caption<'_>,
) -> Frame {
    let parameters = request.parameters();
    let mut canvas = canvas_of(frame);
    let mut lines = lines(depth_words(parameters), parameters.window, layers);
    if let Some(surface) = caption.surface {
        lines.insert(1, surface.to_owned());
    }
    let corner = Corner::new(&canvas, caption.named, lines);
    let orientation = parameters.camera.orientation();
    write_over(&mut canvas, &corner, (orientation, projection));
    color_bar(&mut canvas, layers, projection.size());
    canvas.into_frame()
}

/// The depth, and over how much of it intensities are averaged.
pub(crate) fn depth_words(parameters: &RenderParameters) -> String {
    let depth = format!("{} mm", short(parameters.depth_mm));
    match parameters.look.slab_mm {
        0.0 => depth,
        slab_mm => format!("{depth} ± {} mm", short(slab_mm)),
    }
}

/// Writes place, window, a scale bar, the depths of the contours beside their colours, the patient's directions at the
/// edges and the notice of research use into a slice; with layers also the name of the texture, and the colours of the
/// overlay with their values, or the colour of its edges with the values of its window. `named` is the first line.
///
/// A picture smaller than [`MIN_ANNOTATED_SIDE`] has room for only a part. If more contours are drawn than fit above
/// the middle, the last line states how many more there are.
pub fn annotate_slice(
    frame: Frame,
    request: &SliceRequest,
    projection: &Projection,
    layers: &Layers<'_>,
    named: Option<&str>,
) -> Frame {
    let parameters = request.parameters();
    let (plane, position_mm) = (parameters.plane, parameters.position_mm);
    let place = match parameters.oblique {
        Some(oblique) => oblique.angles(),
        None => format!(
            "{} {} {} mm",
            plane.name(),
            letter_at(plane, position_mm),
            short(position_mm.abs())
        ),
    };
    let mut canvas = canvas_of(frame);
    let lines = lines(place, parameters.window, layers);
    let corner = Corner::new(&canvas, named, lines);
    let orientation = request.camera().orientation();
    write_over(&mut canvas, &corner, (orientation, projection));
    let size = projection.size();
    let right = [size.width() as i32, size.height() as i32 / 2];
    legend(&mut canvas, &parameters.depths_mm, &corner, right);
    if parameters.has_edges {
        edge_line(&mut canvas, layers, size);
    } else {
        color_bar(&mut canvas, layers, size);
    }
    canvas.into_frame()
}

fn canvas_of(frame: Frame) -> Canvas {
    let side = frame.size().width().min(frame.size().height());
    Canvas::new(frame, side)
}

/// The lines in the corner of a picture: its place, its window, and the texture if that is a layer.
pub(crate) fn lines(place: String, window: Window, layers: &Layers<'_>) -> Vec<String> {
    let function = match window.function() {
        WindowFunction::Linear => "",
        WindowFunction::Sigmoid => " sigmoid",
    };
    let [centre, width] = [window.centre(), window.width()].map(short);
    let window = format!("C {centre} W {width}{function}");
    let base = layers.base.map(Layer::title);
    [place, window].into_iter().chain(base).collect()
}

/// The text in the upper left corner.
pub(crate) struct Corner {
    pub(crate) lines: Vec<String>,
    /// Whether the first line names the case; it may be as wide as the picture.
    is_named: bool,
}

impl Corner {
    /// The lines, headed by as much of the name of the case as fits.
    pub(crate) fn new(canvas: &Canvas, named: Option<&str>, others: Vec<String>) -> Self {
        let room = canvas.size().width() as i32 - canvas.line_height();
        let first = named.map(|words| fitting(canvas, words, room));
        Self {
            is_named: first.is_some(),
            lines: first.into_iter().chain(others).collect(),
        }
    }
}

/// The text, or its beginning and its last 22 letters (day and id) if it is too long. Letters that the font lacks
/// become `?`.
fn fitting(canvas: &Canvas, text: &str, room: i32) -> String {
    let is_drawn = |letter: char| matches!(letter, ' '..='~' | '\u{a1}'..='\u{ff}');
    let known = |letter: char| if is_drawn(letter) { letter } else { '?' };
    let mut letters: Vec<char> = text.chars().map(known).collect();
    let fits = |letters: &[char]| {
        let text: String = letters.iter().collect();
        canvas.text_width(&text) <= room
    };
    let end = letters.len().saturating_sub(DAY_AND_ID);
    if fits(&letters) || end == 0 {
        return letters.into_iter().collect();
    }
    for kept in (0..end).rev() {
        let mut shorter = letters[..kept].to_vec();
        shorter.extend("... ".chars());
        shorter.extend(&letters[end..]);
        if fits(&shorter) {
            return shorter.into_iter().collect();
        }
    }
    letters.split_off(end).into_iter().collect()
}

/// The colours of an overlay on grey between the values of their ends, below its name and its threshold, in the lower
/// right corner: a head leaves the corners free. Labels are listed in the lower right quarter.
pub(crate) fn color_bar(canvas: &mut Canvas, layers: &Layers<'_>, size: FrameSize) {
    let Some(Overlay { layer, style }) = layers.overlay else {
        return;
    };
    let parameters = style.parameters();
    let [low, high] = parameters.window;
    let [width, height] = [size.width() as i32, size.height() as i32];
    let line = canvas.line_height();
    let margin = line / 2;
    let put = |canvas: &mut Canvas, text: &str, top: i32| {
        let left = width - margin - canvas.text_width(text);
        canvas.write(text, left, top);
        left
    };
    if let LayerValues::Labels { names, .. } = layer.values() {
        let title = height / 2 + line;
        put(canvas, &layer.title(), title);
        // The notice has the last line.
        let bottom = height - margin - line - margin;
        return label_list(canvas, names, [title + line, bottom, width]);
    }
    let [low_text, high_text] = [low, high].map(short);
    let length = BAR_LINES * line;
    let left =
        width - 3 * margin - canvas.text_width(&low_text) - length - canvas.text_width(&high_text);
    // In a narrow picture the notice needs the last line.
    let notice_end = (width + canvas.text_width(SHORT_NOTICE)) / 2;
    let rows = if left < notice_end + line { 2 } else { 1 };
    let row = height - margin - rows * line;
    let end = put(canvas, &high_text, row) - margin;
    canvas.write(&low_text, left, row);
    let ramp = style.ramp();
    let colors = parameters.colormap.table();
    for x in 0..length {
        let part = (f64::from(x) + 0.5) / f64::from(length);
        let value = (low + part * (high - low)) as f32;
        let above = colors[usize::from((ramp.level(value) + 0.5) as u8)];
        let share = ramp.share(value);
        let color = above.map(|level| {
            let below = f32::from(BAR_GREY);
            (below + share * (f32::from(level) - below) + 0.5) as u8
        });
        canvas.swatch([end - length + x, row + line / 6], [1, 2 * line / 3], color);
    }
    let threshold = parameters.threshold.map(|threshold| {
        let word = if parameters.colormap.is_diverging() {
            "beyond ±"
        } else {
            "above "
        };
        format!("{word}{}", short(threshold))
    });
    let words = threshold.into_iter().chain([layer.title()]);
    for (number, text) in words.enumerate() {
        put(canvas, &text, row - (number as i32 + 1) * line);
    }
}

/// The name of a layer beside the colour of its edges, and its window, in the lower right quarter.
fn edge_line(canvas: &mut Canvas, layers: &Layers<'_>, size: FrameSize) {
    let Some(Overlay { layer, style }) = layers.overlay else {
        return;
    };
    let [low, high] = style.parameters().window.map(short);
    let [width, height] = [size.width() as i32, size.height() as i32];
    let line = canvas.line_height();
    let margin = line / 2;
    let top = height / 2 + line;
    let title = format!("edges: {}", layer.title());
    for (row, text) in [title, format!("{low} to {high}")].iter().enumerate() {
        let top = top + row as i32 * line;
        let left = width - margin - canvas.text_width(text);
        canvas.write(text, left, top);
        if row == 0 {
            let place = [left - 2 * line, top + line / 3];
            canvas.swatch(place, [line + line / 2, line / 3], EDGE_COLOR);
        }
    }
}

/// The labels of an overlay with their colours, as many as fit.
fn label_list(canvas: &mut Canvas, names: &[(u8, String)], [top, bottom, width]: [i32; 3]) {
    let line = canvas.line_height();
    let margin = line / 2;
    let room = usize::try_from((bottom - top) / line).unwrap_or(0);
    let shown = if names.len() > room {
        room.saturating_sub(1)
    } else {
        names.len()
    };
    let colors = ColorMap::Labels.table();
    let mut row = top;
    for (code, name) in &names[..shown] {
        let name = fitting(canvas, name, width / 3);
        let left = width - margin - canvas.text_width(&name);
        canvas.write(&name, left, row);
        let place = [left - line - margin, row + line / 4];
        canvas.swatch(place, [line, line / 2], colors[usize::from(*code)]);
        row += line;
    }
    if shown < names.len() {
        let more = format!("{} more", names.len() - shown);
        let left = width - margin - canvas.text_width(&more);
        canvas.write(&more, left, row);
    }
}

/// Writes the common annotations: two or three lines in the corner, a scale bar, the patient's directions and the
/// notice.
fn write_over(
    canvas: &mut Canvas,
    Corner { lines, is_named }: &Corner,
    (orientation, projection): (DQuat, &Projection),
) {
    let size = projection.size();
    let side = size.width().min(size.height());
    let [width, height] = [size.width() as i32, size.height() as i32];
    let line = canvas.line_height();
    let margin = line / 2;
    for (number, text) in lines.iter().enumerate() {
        canvas.write(text, margin, margin + number as i32 * line);
    }
    // In a narrow picture, the lines in the corner need the whole top.
    let top = if side < 320 || *is_named {
        margin + lines.len() as i32 * line
    } else {
        margin
    };
    let foot = height - margin - line;
    write_directions(canvas, &edge_letters(orientation), [top, foot - 3 * line]);
    let centred = |canvas: &Canvas, text: &str| (width - canvas.text_width(text)) / 2;
    let at = centred(canvas, SHORT_NOTICE);
    canvas.write(SHORT_NOTICE, at, foot);
    scale_bar(
        canvas,
        projection.mm_per_pixel(),
        [width, foot - line, margin],
    );
}

/// Writes the directions to the left and to the right at half height, and those up and down at `top` and `foot`.
fn write_directions(
    canvas: &mut Canvas,
    [left, right, up, down]: &[String; 4],
    [top, foot]: [i32; 2],
) {
    let [width, height] = [canvas.size().width() as i32, canvas.size().height() as i32];
    let line = canvas.line_height();
    let margin = line / 2;
    let middle = (height - line) / 2;
    canvas.write(left, margin, middle);
    let end = width - margin - canvas.text_width(right);
    canvas.write(right, end, middle);
    let centred = |canvas: &Canvas, text: &str| (width - canvas.text_width(text)) / 2;
    let at = centred(canvas, up);
    canvas.write(up, at, top);
    let at = centred(canvas, down);
    canvas.write(down, at, foot);
}

/// Writes the patient's left and right at the edges of a picture where they lie, and nothing else.
pub fn mark_sides(frame: Frame, request: &RenderRequest) -> Frame {
    let mut canvas = canvas_of(frame);
    let mut letters = edge_letters(request.parameters().camera.orientation());
    for text in &mut letters {
        text.retain(|letter| letter == 'L' || letter == 'R');
    }
    let margin = canvas.line_height() / 2;
    let foot = canvas.size().height() as i32 - margin - canvas.line_height();
    write_directions(&mut canvas, &letters, [margin, foot]);
    canvas.into_frame()
}

/// The depths of contours with their colours, from the upper right corner down to the middle.
///
/// They begin below the lines of the other corner, which may be as wide as the picture.
fn legend(canvas: &mut Canvas, depths_mm: &[f64], corner: &Corner, [width, middle]: [i32; 2]) {
    let line = canvas.line_height();
    let margin = line / 2;
    let first = margin + if corner.is_named { 3 } else { 2 } * line;
    let room = ((middle - line - first) / line).max(1) as usize;
    let shown = if depths_mm.len() > room {
        room - 1
    } else {
        depths_mm.len()
    };
    let row = |number: usize| first + number as i32 * line;
    for (number, &depth_mm) in depths_mm.iter().take(shown).enumerate() {
        let text = format!("{} mm", short(depth_mm));
        let left = width - margin - canvas.text_width(&text);
        canvas.write(&text, left, row(number));
        canvas.swatch(
            [left - 2 * line, row(number) + line / 3],
            [line + line / 2, line / 3],
            contour_color(number),
        );
    }
    if shown < depths_mm.len() {
        let text = format!("+ {}", depths_mm.len() - shown);
        let left = width - margin - canvas.text_width(&text);
        canvas.write(&text, left, row(shown));
    }
}

/// The side of the scanner's origin on which a slice lies.
pub(crate) fn letter_at(plane: SlicePlane, position_mm: f64) -> char {
    let [towards, against] = LETTERS[plane.axis()];
    if position_mm < 0.0 { against } else { towards }
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

/// The letters of the patient's directions to the left, to the right, up and down in a picture.
pub fn edge_letters(orientation: DQuat) -> [String; 4] {
    let patient_from_view = orientation.inverse();
    [-DVec3::X, DVec3::X, DVec3::Y, -DVec3::Y]
        .map(|direction| letters(patient_from_view * direction))
}

/// The letters of a patient direction: the nearest axis, and a second one if the direction is oblique.
fn letters(direction: DVec3) -> String {
    let axes = nearest_axes(direction);
    let letter = |(along, [towards, against]): (f64, [char; 2])| {
        if along > 0.0 { towards } else { against }
    };
    let mut text = String::from(letter(axes[0]));
    if axes[1].0.abs() >= SECOND_LETTER {
        text.push(letter(axes[1]));
    }
    text
}

/// The letter of the axis nearest to a patient direction.
pub(crate) fn letter_of(direction: DVec3) -> char {
    let [(along, [towards, against]), ..] = nearest_axes(direction);
    if along > 0.0 { towards } else { against }
}

/// The components of a direction with the letters along and against their axes, the greatest first.
fn nearest_axes(direction: DVec3) -> [(f64, [char; 2]); 3] {
    let mut axes = [0, 1, 2].map(|axis| (direction[axis], LETTERS[axis]));
    axes.sort_by(|(a, _), (b, _)| b.abs().total_cmp(&a.abs()));
    axes
}

/// A number with at most two decimals.
pub(crate) fn short(number: f64) -> String {
    let rounded = (number * 100.0).round() / 100.0;
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use geometry::BoundingSphere;

    use super::*;
    use crate::{Camera, NamedView, PixelFormat, RenderParameters, SliceParameters};

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
        annotate(
            black,
            &request,
            &projection,
            &Layers::default(),
            Caption::default(),
        )
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
    fn sides_are_marked_where_left_and_right_lie_in_the_picture() {
        let marked = |view: NamedView| {
            let size = FrameSize::new(128, 128).unwrap();
            let request = RenderRequest::new(RenderParameters {
                camera: Camera::named(view),
                size,
                ..RenderParameters::new(Window::between(0.0, 100.0))
            });
            let black = Frame::new(size, PixelFormat::Grey8, vec![0; size.pixel_count()]);
            mark_sides(black, &request.unwrap())
        };
        let [left, right] = edges(&marked(NamedView::Superior));
        assert!(left.contains(&255) && right.contains(&255) && left != right);
        // From below, the sides are exchanged; from the side there are none.
        assert_ne!(edges(&marked(NamedView::Inferior))[0], left);
        assert_eq!(edges(&marked(NamedView::Posterior))[0], left);
        assert!(
            marked(NamedView::Left)
                .bytes()
                .iter()
                .all(|&level| level == 0)
        );
    }

    #[test]
    fn every_size_is_written_into_without_harm() {
        for side in [1, 17, 128, 320, 4096] {
            let frame = annotated(NamedView::Left, side);
            assert_eq!(frame.size().width(), side);
        }
    }

    fn annotated_slice(plane: SlicePlane, depths_mm: Vec<f64>, side: u32) -> Frame {
        let size = FrameSize::new(side, side).unwrap();
        let window = Window::between(0.0, 100.0);
        let request = SliceRequest::new(SliceParameters {
            depths_mm,
            size,
            ..SliceParameters::new(plane, -20.0, window)
        })
        .unwrap();
        let sphere = BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 100.0,
        };
        let projection = request.projection(&sphere);
        let black = Frame::new(size, PixelFormat::Rgb8, vec![0; 3 * size.pixel_count()]);
        annotate_slice(black, &request, &projection, &Layers::default(), None)
    }

    #[test]
    fn a_slice_has_the_letters_of_the_view_that_it_is_seen_from() {
        for (plane, view) in [
            (SlicePlane::Axial, NamedView::Inferior),
            (SlicePlane::Coronal, NamedView::Anterior),
            (SlicePlane::Sagittal, NamedView::Left),
        ] {
            let found = edges(&annotated_slice(plane, Vec::new(), 512));
            assert_eq!(found, edges(&annotated(view, 512)), "{plane:?}");
        }
    }

    #[test]
    fn every_contour_of_a_slice_is_named_beside_its_colour() {
        let depths: Vec<_> = (1..=8).map(f64::from).collect();
        let frame = annotated_slice(SlicePlane::Axial, depths, 640);
        let shows = |frame: &Frame, number| {
            let color = contour_color(number);
            (0..640).any(|y| (320..640).any(|x| frame.pixel(x, y) == Some(&color)))
        };
        for number in 0..7 {
            assert!(shows(&frame, number), "contour {number}");
        }
        let none = annotated_slice(SlicePlane::Axial, Vec::new(), 640);
        assert!((0..7).all(|number| !shows(&none, number)));
    }

    #[test]
    fn slices_of_every_size_are_written_into_without_harm() {
        for side in [1, 17, 128, 320, 4096] {
            let frame = annotated_slice(SlicePlane::Coronal, vec![3.0; 16], side);
            assert_eq!(frame.size().width(), side);
        }
    }

    #[test]
    fn a_case_is_named_and_its_day_and_id_stay_where_the_label_has_no_room() {
        let size = FrameSize::new(256, 256).unwrap();
        let black = Frame::new(size, PixelFormat::Grey8, vec![0; size.pixel_count()]);
        let canvas = canvas_of(black.clone());
        let named = "A head · 2026-03-01 · 01234567";
        assert_eq!(fitting(&canvas, named, 1000), named);
        let long = format!("{}{named}", "long ".repeat(40));
        let short = fitting(&canvas, &long, 250);
        assert!(
            short.starts_with("long") && short.ends_with("...  2026-03-01 · 01234567"),
            "{short}"
        );
        assert!(canvas.text_width(&short) <= 250);
        assert_eq!(fitting(&canvas, "頭 · 2026", 1000), "? · 2026");
        let request = RenderRequest::new(RenderParameters {
            size,
            ..RenderParameters::new(Window::between(0.0, 100.0))
        });
        let request = request.unwrap();
        let sphere = BoundingSphere {
            centre_in_patient: DVec3::ZERO,
            radius_mm: 100.0,
        };
        let projection = request.parameters().camera.projection(&sphere, size);
        let lit = |named, surface| {
            let frame = annotate(
                black.clone(),
                &request,
                &projection,
                &Layers::default(),
                Caption { named, surface },
            );
            // The third line of the corner.
            let line = canvas.line_height() as u32;
            let rows = 5 * line / 2..7 * line / 2;
            let places = rows.flat_map(|y| (0..100).map(move |x| (x, y)));
            places
                .filter(|&(x, y)| frame.pixel(x, y).unwrap()[0] == 255)
                .count()
        };
        assert_eq!(lit(None, None), 0);
        assert!(lit(Some(named), None) > 20);
        assert!(lit(None, Some("left hemisphere")) > 20);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(8.0), "8");
        assert_eq!(short(8.256), "8.26");
        assert_eq!(short(-0.5), "-0.5");
    }
}
