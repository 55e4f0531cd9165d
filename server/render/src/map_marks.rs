//! What is written on request into a picture of the flat map.

use glam::Vec3;

use crate::annotate::{Caption, Corner, color_bar, depth_words, letter_of, lines, short};
use crate::canvas::Canvas;
use crate::{
    Frame, FrameSize, Hemisphere, Layers, MAP_MARGIN, MAP_RIM, MapDisc, MapFace, MapProjection,
    RenderRequest, SHORT_NOTICE,
};

/// The distance of the lines of the graticule, in mm.
const GRATICULE_MM: f32 = 20.0;

/// How much a line of the graticule covers.
const GRATICULE_SHARE: f32 = 0.35;

/// Neighbouring pixels whose points are farther apart than this many typical pixels lie on different folds.
const FOLD: f32 = 4.0;

/// The length of the scale bar, in mm.
const BAR_MM: f64 = 20.0;

/// Where the letters of the directions lie between the rim and the end of the margin.
const LETTERS_AT: f64 = 0.5 * (MAP_RIM + MAP_MARGIN);

/// A map that was drawn.
#[derive(Debug, Clone, Copy)]
pub struct DrawnMap<'a> {
    /// Its discs.
    pub discs: &'a [MapDisc],
    /// The position in LPS mm of what each pixel shows, row by row; NaN if that is nothing.
    pub positions: &'a [[f32; 3]],
}

/// How many mm of the isosurface a pixel of a map is wide, as the side of a square of its area: a tenth of the pixels within the
/// rims have less than the first and a tenth more than the last number, half of them less than the second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapScale {
    /// mm per pixel.
    pub mm_per_pixel: [f64; 3],
}

impl MapScale {
    /// The scale of a map; `None` if it shows nothing.
    pub fn of(map: &DrawnMap<'_>, request: &RenderRequest) -> Option<Self> {
        let pixels = Pixels::new(map, request);
        let mut scales = pixels.scales();
        scales.sort_unstable_by(f32::total_cmp);
        let last = scales.len().checked_sub(1)?;
        let part = |tenths: usize| f64::from(scales[last * tenths / 10]);
        Some(Self {
            mm_per_pixel: [part(1), part(5), part(9)],
        })
    }
}

/// Writes depth, window, the sides of the head, its directions at the rims, a graticule every 20 mm of the patient along P and S, a
/// scale bar and the notice of research use into a picture of a map; layers as [`crate::annotate`] does.
pub fn annotate_map(
    frame: Frame,
    request: &RenderRequest,
    map: &DrawnMap<'_>,
    layers: &Layers<'_>,
    caption: Caption<'_>,
) -> Frame {
    let parameters = request.parameters();
    let side = frame.size().width().min(frame.size().height());
    let mut canvas = Canvas::new(frame, side);
    let pixels = Pixels::new(map, request);
    pixels.draw_graticule(&mut canvas);
    let mut lines = lines(depth_words(parameters), parameters.window, layers);
    let surface = caption.surface.into_iter().map(str::to_owned);
    lines.splice(1..1, surface.chain(["equal-area map".to_owned()]));
    // A disc leaves less of the corner free than a head does.
    let mut small = Canvas::new(canvas.into_frame(), side / 2);
    let corner = Corner::new(&small, caption.named, lines);
    let small_line = small.line_height();
    for (number, text) in corner.lines.iter().enumerate() {
        small.write(
            text,
            small_line / 2,
            small_line / 2 + number as i32 * small_line,
        );
    }
    // The name of the case may be as wide as the picture.
    let below_name = i32::from(caption.named.is_some()) * (small_line / 2 + small_line);
    let mut canvas = Canvas::new(small.into_frame(), side);
    for disc in map.discs {
        let projection = disc.projection(&parameters.camera, parameters.size);
        write_directions(&mut canvas, &projection, below_name);
    }
    write_foot(&mut canvas, MapScale::of(map, request));
    color_bar(&mut canvas, layers, parameters.size);
    let below_letter = below_name + 2 * canvas.line_height();
    for disc in map.discs.iter().filter(|disc| disc.face == MapFace::Inner) {
        write_beside(&mut canvas, "inner", below_letter, disc, request);
    }
    let mut large = Canvas::new(canvas.into_frame(), 2 * side);
    for disc in map.discs {
        let letter = disc.hemisphere.letter();
        write_beside(&mut large, letter, below_name, disc, request);
    }
    large.into_frame()
}

/// Writes the patient's directions into the margin of a disc, none higher than `highest`.
fn write_directions(canvas: &mut Canvas, projection: &MapProjection, highest: i32) {
    let axes = projection.axes();
    let [x, y] = projection.centre();
    let radius = LETTERS_AT * projection.pixels_per_unit();
    let [width, height] = [canvas.size().width(), canvas.size().height()].map(f64::from);
    for (direction, [right, down]) in [
        (axes.x_axis, [1.0, 0.0]),
        (-axes.x_axis, [-1.0, 0.0]),
        (axes.y_axis, [0.0, -1.0]),
        (-axes.y_axis, [0.0, 1.0]),
    ] {
        let [x, y] = [x + right * radius, y + down * radius];
        if (0.0..width).contains(&x) && (0.0..height).contains(&y) {
            write_at(canvas, &letter_of(direction).to_string(), [x, y], highest);
        }
    }
}

/// Writes a text around a place, or so far below it that it is not higher than `highest`.
fn write_at(canvas: &mut Canvas, text: &str, [x, y]: [f64; 2], highest: i32) {
    let left = x.round() as i32 - canvas.text_width(text) / 2;
    let top = (y.round() as i32 - canvas.line_height() / 2).max(highest);
    canvas.write(text, left, top);
}

/// Writes a text beside a disc, so far below its upper corner towards the middle of the map, or within the picture.
fn write_beside(
    canvas: &mut Canvas,
    text: &str,
    below: i32,
    disc: &MapDisc,
    request: &RenderRequest,
) {
    let parameters = request.parameters();
    let projection = disc.projection(&parameters.camera, parameters.size);
    let [x, y] = projection.centre();
    let radius = MAP_MARGIN * projection.pixels_per_unit();
    let size = [canvas.size().width(), canvas.size().height()].map(f64::from);
    let is_seen = (0..2).all(|axis| {
        let centre = [x, y][axis];
        centre + radius > 0.0 && centre - radius < size[axis]
    });
    if !is_seen {
        return;
    }
    let margin = canvas.line_height() / 4;
    let [width, height] = [canvas.text_width(text), canvas.line_height()];
    let left = match disc.hemisphere {
        Hemisphere::Left => (x + radius) as i32 - width,
        Hemisphere::Right if disc.is_alone_in_its_row() => (x + radius) as i32 - width,
        Hemisphere::Right => (x - radius) as i32,
    };
    let left = left.clamp(margin, (size[0] as i32 - margin - width).max(margin));
    let [highest, lowest] = [margin + below, size[1] as i32 - margin - height];
    let top = ((y - radius) as i32 + below).clamp(highest, lowest.max(highest));
    canvas.write(text, left, top);
}

/// Writes the scale bar and the notice into the last lines.
fn write_foot(canvas: &mut Canvas, scale: Option<MapScale>) {
    let [width, height] = [canvas.size().width() as i32, canvas.size().height() as i32];
    let line = canvas.line_height();
    let margin = line / 2;
    let foot = height - margin - line;
    let at = (width - canvas.text_width(SHORT_NOTICE)) / 2;
    canvas.write(SHORT_NOTICE, at, foot);
    let Some(MapScale {
        mm_per_pixel: [least, middle, most],
    }) = scale
    else {
        return;
    };
    let pixels = (BAR_MM / middle).round() as i32;
    if pixels > width / 2 {
        return;
    }
    let mm = |mm_per_pixel: f64| short((mm_per_pixel * f64::from(pixels)).round());
    let words = format!("{} mm ({} to {})", mm(middle), mm(least), mm(most));
    canvas.bar(margin, foot - line / 2, pixels, (line / 5).max(2));
    canvas.write(&words, margin, foot - line / 2 - line);
}

/// The points that the pixels of a map show within the rims.
struct Pixels<'a> {
    size: FrameSize,
    positions: &'a [[f32; 3]],
    /// For each pixel whether it lies within a rim.
    within: Vec<bool>,
}

impl<'a> Pixels<'a> {
    fn new(map: &DrawnMap<'a>, request: &RenderRequest) -> Self {
        let parameters = request.parameters();
        let size = parameters.size;
        let mut within = vec![false; size.pixel_count()];
        for disc in map.discs {
            let projection = disc.projection(&parameters.camera, size);
            for (index, within) in within.iter_mut().enumerate() {
                let width = size.width() as usize;
                let place = [index % width, index / width].map(|place| place as f64 + 0.5);
                *within |= projection.radius_at(place) < MAP_RIM;
            }
        }
        Self {
            size,
            positions: map.positions,
            within,
        }
    }

    /// The position of a pixel within a rim.
    fn at(&self, x: u32, y: u32) -> Option<Vec3> {
        let is_inside = x < self.size.width() && y < self.size.height();
        let index = y as usize * self.size.width() as usize + x as usize;
        let position = is_inside.then(|| self.positions.get(index)).flatten()?;
        (self.within[index] && !position[0].is_nan()).then(|| Vec3::from_array(*position))
    }

    /// Each pixel with a point, with the way to the points of its right and its lower neighbours.
    fn with_steps(&self) -> impl Iterator<Item = ([u32; 2], Vec3, [Option<Vec3>; 2])> {
        let rows = 0..self.size.height();
        let places = rows.flat_map(|y| (0..self.size.width()).map(move |x| [x, y]));
        places.filter_map(|[x, y]| {
            let here = self.at(x, y)?;
            let beside = [self.at(x + 1, y), self.at(x, y + 1)];
            Some(([x, y], here, beside.map(|there| Some(there? - here))))
        })
    }

    /// The mm per pixel at each pixel beside which no fold hides a part.
    fn scales(&self) -> Vec<f32> {
        let areas = self.with_steps().filter_map(|(_, _, steps)| {
            let [Some(right), Some(down)] = steps else {
                return None;
            };
            let scale = right.cross(down).length().sqrt();
            let is_smooth = right.length().max(down.length()) < FOLD * scale;
            is_smooth.then_some(scale)
        });
        areas.collect()
    }

    /// The length of a step between neighbouring pixels that is no fold.
    fn longest_step(&self) -> f32 {
        let mut lengths: Vec<f32> = self
            .with_steps()
            .filter_map(|(_, _, [right, _])| Some(right?.length()))
            .collect();
        let middle = lengths.len() / 2;
        if lengths.is_empty() {
            return 0.0;
        }
        let (_, median, _) = lengths.select_nth_unstable_by(middle, f32::total_cmp);
        FOLD * *median
    }

    /// Draws the curves of equal P and of equal S.
    fn draw_graticule(&self, canvas: &mut Canvas) {
        let longest = self.longest_step();
        for ([x, y], here, steps) in self.with_steps() {
            let is_crossed = steps.into_iter().flatten().any(|step| {
                let there = here + step;
                let crosses = |axis: usize| {
                    let band = |at: Vec3| (at[axis] / GRATICULE_MM).floor();
                    band(here) != band(there)
                };
                step.length() < longest && (crosses(1) || crosses(2))
            });
            if is_crossed {
                canvas.blend(x as i32, y as i32, (u8::MAX, GRATICULE_SHARE));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::{Camera, MapSides, PixelFormat, RenderParameters, Window};

    fn request(size: FrameSize) -> RenderRequest {
        let parameters = RenderParameters {
            camera: Camera::new([0.0, 0.0, 0.0, 1.0], 1.0, [0.0; 2]).unwrap(),
            size,
            depth_mm: 10.0,
            ..RenderParameters::new(Window::new(50.0, 100.0).unwrap())
        };
        RenderRequest::new(parameters).unwrap()
    }

    fn discs(sides: MapSides) -> Vec<MapDisc> {
        let centre = |hemisphere| match hemisphere {
            Hemisphere::Left => DVec3::new(30.0, 0.0, 0.0),
            Hemisphere::Right => DVec3::new(-30.0, 0.0, 0.0),
        };
        MapDisc::of_map(&Hemisphere::ALL, sides, DVec3::X, |hemisphere| {
            Some(centre(hemisphere))
        })
        .unwrap()
    }

    /// The positions of a ball of 60 mm around the centre of each disc.
    fn balls(discs: &[MapDisc], request: &RenderRequest) -> Vec<[f32; 3]> {
        let parameters = request.parameters();
        let mut positions = vec![[f32::NAN; 3]; parameters.size.pixel_count()];
        for disc in discs {
            let projection = disc.projection(&parameters.camera, parameters.size);
            for (index, position) in positions.iter_mut().enumerate() {
                let width = parameters.size.width() as usize;
                let place = [index % width, index / width].map(|place| place as f64 + 0.5);
                if let Some(there) = projection.position_in_patient(place, 60.0) {
                    *position = there.as_vec3().to_array();
                }
            }
        }
        positions
    }

    #[test]
    fn the_scale_of_a_ball_is_its_radius_everywhere() {
        let request = request(FrameSize::new(700, 350).unwrap());
        let discs = discs(MapSides::Outer);
        let positions = balls(&discs, &request);
        let map = DrawnMap {
            discs: &discs,
            positions: &positions,
        };
        let scale = MapScale::of(&map, &request).unwrap();
        // 100 pixels are a radius.
        for mm_per_pixel in scale.mm_per_pixel {
            assert!((mm_per_pixel / 0.6 - 1.0).abs() < 2e-3, "{scale:?}");
        }
    }

    #[test]
    fn the_graticule_of_a_ball_is_where_p_and_s_are_whole_multiples_of_20_mm() {
        let size = FrameSize::new(700, 350).unwrap();
        let request = request(size);
        let discs = discs(MapSides::Outer);
        let positions = balls(&discs, &request);
        let map = DrawnMap {
            discs: &discs,
            positions: &positions,
        };
        let empty = Frame::new(size, PixelFormat::Grey8, vec![0; size.pixel_count()]);
        let mut canvas = Canvas::new(empty, 350);
        Pixels::new(&map, &request).draw_graticule(&mut canvas);
        let frame = canvas.into_frame();
        let mut drawn = 0;
        for (index, position) in positions.iter().enumerate() {
            if frame.bytes()[index] > 0 {
                let off = |mm: f32| (mm / GRATICULE_MM - (mm / GRATICULE_MM).round()).abs();
                let nearest = GRATICULE_MM * off(position[1]).min(off(position[2]));
                assert!(nearest < 0.9, "{position:?}");
                drawn += 1;
            }
        }
        // Six lines either way of each disc, and no filled areas.
        assert!((2000..9000).contains(&drawn), "{drawn}");
    }

    #[test]
    fn left_is_written_beside_the_left_disc_and_right_beside_the_right_one() {
        let size = FrameSize::new(700, 350).unwrap();
        let request = request(size);
        for (number, columns) in [(0, 280..350), (1, 350..420)] {
            let disc = discs(MapSides::Outer)[number];
            let empty = Frame::new(size, PixelFormat::Grey8, vec![0; size.pixel_count()]);
            let mut canvas = Canvas::new(empty, 700);
            write_beside(&mut canvas, disc.hemisphere.letter(), 0, &disc, &request);
            let frame = canvas.into_frame();
            let lit = frame.bytes().iter().enumerate();
            let lit = lit
                .filter(|&(_, &level)| level > 128)
                .map(|(index, _)| index % 700);
            let lit: Vec<_> = lit.collect();
            assert!(!lit.is_empty());
            assert!(
                lit.iter().all(|column| columns.contains(column)),
                "{number}"
            );
        }
    }
}
