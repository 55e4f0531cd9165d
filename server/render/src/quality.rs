//! Nine slices of a head with the contours of its envelope and of the cuts below it, for checking a mask.

use glam::DVec3;

use crate::annotate::{edge_letters, letter_at};
use crate::canvas::Canvas;
use crate::slice::contour_color;
use crate::{
    Frame, FrameSize, PixelFormat, RESEARCH_USE_NOTICE, RenderError, Scene, SheetPlan,
    SliceParameters, SlicePlane, SliceRequest, Window, draw_slice,
};

/// The depths of the contours: the envelope itself, and cuts through the cortex and below it.
const DEPTHS_MM: [f64; 5] = [0.0, 4.0, 8.0, 12.0, 20.0];

/// The positions of the slices, as fractions of the extent of the brain.
const PLACES: [f64; 3] = [0.25, 0.5, 0.75];

/// Side of a slice in pixels.
const CELL: u32 = 384;

/// The zoom, below 1 to show the surroundings of the brain, where a mask may have missed some.
const ZOOM: f64 = 0.78;

/// Draws three axial, three coronal and three sagittal slices, at a quarter, a half and three quarters of the brain's
/// extent, with the contours of the isosurfaces at 0, 4, 8, 12 and 20 mm.
///
/// Each slice shows its position and the directions of the patient. Below the slices are the colours of the contours,
/// `lines` (Latin-1) and the notice. `scene` should hold the volume beyond the envelope too.
///
/// # Errors
/// If the brain lies too far from the scanner's origin.
pub fn draw_quality_sheet(
    scene: &Scene<'_>,
    window: Window,
    lines: &[String],
) -> Result<Frame, RenderError> {
    let cell = FrameSize::new(CELL, CELL)?;
    let rows = SlicePlane::ALL.map(|plane| plane.name().to_owned());
    let plan = SheetPlan::new(cell, rows.to_vec(), vec![String::new(); PLACES.len()])?;
    let plan = plan.with_footer(lines.len() + 2)?;
    let foot = plan.foot();
    let mut sheet = plan.begin(PixelFormat::Rgb8);
    for (row, plane) in SlicePlane::ALL.into_iter().enumerate() {
        for (column, place) in PLACES.into_iter().enumerate() {
            let position_mm = position_mm(scene, plane, place);
            let slice = draw_cell(scene, (plane, position_mm), window)?;
            sheet.put(&slice, row, column);
        }
    }
    let canvas = sheet.canvas();
    let line = canvas.line_height();
    legend(canvas, [line, foot]);
    let notice = std::iter::once(RESEARCH_USE_NOTICE);
    let lines = lines.iter().map(String::as_str).chain(notice);
    for (number, text) in lines.enumerate() {
        canvas.write(text, line, foot + (number as i32 + 1) * line);
    }
    Ok(sheet.finish())
}

/// The coordinate of a slice at a fraction of the extent of the envelope's grid.
fn position_mm(scene: &Scene<'_>, plane: SlicePlane, place: f64) -> f64 {
    let grid = scene.field.grid();
    let last = DVec3::from_array(grid.size().map(|side| (side - 1) as f64));
    let at = grid.patient_from_voxel().transform_point3(last * place);
    at[plane.axis()]
}

fn draw_cell(
    scene: &Scene<'_>,
    (plane, position_mm): (SlicePlane, f64),
    window: Window,
) -> Result<Frame, RenderError> {
    let request = SliceRequest::new(SliceParameters {
        depths_mm: DEPTHS_MM.to_vec(),
        zoom: ZOOM,
        size: FrameSize::new(CELL, CELL)?,
        ..SliceParameters::new(plane, position_mm, window)
    })?;
    let mut canvas = Canvas::new(draw_slice(scene, &request), CELL);
    let side = CELL as i32;
    let line = canvas.line_height();
    let margin = line / 2;
    let place = format!(
        "{} {:.0} mm",
        letter_at(plane, position_mm),
        position_mm.abs()
    );
    canvas.write(&place, margin, margin);
    let [left, right, up, down] = edge_letters(request.camera().orientation());
    let middle = (side - line) / 2;
    let far = side - margin - canvas.text_width(&right);
    for (text, at) in [
        (left, [margin, middle]),
        (right, [far, middle]),
        (up, [side / 2, margin]),
        (down, [side / 2, side - margin - line]),
    ] {
        canvas.write(&text, at[0], at[1]);
    }
    Ok(canvas.into_frame())
}

/// The colours of the contours with their depths, from a place to the right.
fn legend(canvas: &mut Canvas, [mut left, top]: [i32; 2]) {
    let line = canvas.line_height();
    let caption = "depth below the envelope:";
    canvas.write(caption, left, top);
    left += canvas.text_width(caption) + line;
    for (number, depth_mm) in DEPTHS_MM.into_iter().enumerate() {
        canvas.swatch(
            [left, top + line / 3],
            [2 * line, line / 3],
            contour_color(number),
        );
        left += 2 * line + line / 2;
        let text = format!("{depth_mm} mm");
        canvas.write(&text, left, top);
        left += canvas.text_width(&text) + line;
    }
}

#[cfg(test)]
mod tests {
    use geometry::phantom;

    use super::*;

    #[test]
    fn nine_slices_show_every_contour_and_what_lies_around_the_brain() {
        let head = phantom::head(4.0);
        let brain = geometry::BrainMask::from_mask(&head.brain, head.volume.grid()).unwrap();
        let envelope = geometry::envelope(&brain, 10.0).unwrap();
        let built = phantom::model(head.volume.clone(), envelope);
        let scene = Scene::from(&built.model);
        let lines = ["the brain mask was supplied: ok".to_owned()];
        let window = Window::between(0.0, 900.0);
        let sheet = draw_quality_sheet(&scene, window, &lines).unwrap();
        let size = sheet.size();
        assert!(size.width() > 3 * CELL && size.height() > 3 * CELL + 60);
        let pixel = |x, y| <[u8; 3]>::try_from(sheet.pixel(x, y).unwrap()).unwrap();
        let cells = |color: [u8; 3]| {
            (0..9u32)
                .filter(|cell| {
                    let left = size.width() - 3 * CELL + cell % 3 * CELL;
                    let top = cell / 3 * CELL;
                    (0..CELL * CELL)
                        .any(|at| pixel(left + at % CELL, 40 + top + at / CELL) == color)
                })
                .count()
        };
        for number in 0..DEPTHS_MM.len() {
            let found = cells(contour_color(number));
            assert_eq!(found, 9, "contour {number}");
        }
        // The scalp is outside of the envelope's grid.
        let scalp_mm = head.volume.grid().size()[1] as f64 * 4.0 / 2.0 - 16.0;
        assert!(scalp_mm > 86.0);
        let bright = (0..CELL)
            .filter(|x| pixel(size.width() - 3 * CELL + CELL + x, 40 + CELL / 2)[0] > 150)
            .count();
        assert!(bright > 20, "{bright}");
    }
}
