//! Many pictures on one sheet.

use crate::canvas::Canvas;
use crate::error::checked;
use crate::{Frame, FrameSize, MAX_SIDE, PixelFormat, RenderError};

/// The layout of a contact sheet: rows and columns of cells of one size, each row and column with its label.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SheetPlan {
    cell: FrameSize,
    rows: Vec<String>,
    columns: Vec<String>,
    /// Where the cells end, from the top.
    foot: u32,
    size: FrameSize,
}

/// A sheet to fill.
#[derive(Debug)]
pub struct Sheet {
    plan: SheetPlan,
    canvas: Canvas,
}

impl SheetPlan {
    /// A sheet of `rows` × `columns` cells, under these labels (Latin-1).
    ///
    /// # Errors
    /// If a side would exceed [`MAX_SIDE`] pixels, or there would be no cell.
    pub fn new(
        cell: FrameSize,
        rows: Vec<String>,
        columns: Vec<String>,
    ) -> Result<Self, RenderError> {
        let [left, top] = gutters(cell, &rows);
        let side = |name, gutter: u32, count: usize, cell: u32| {
            let pixels = u64::from(gutter) + count as u64 * u64::from(cell);
            let accepted = f64::from(gutter) + 1.0..=f64::from(MAX_SIDE);
            checked(
                name,
                pixels as f64,
                accepted,
                "at least one cell and at most 4096 pixels",
            )?;
            Ok::<_, RenderError>(pixels as u32)
        };
        let width = side("sheet width", left, columns.len(), cell.width())?;
        let height = side("sheet height", top, rows.len(), cell.height())?;
        Ok(Self {
            size: FrameSize::new(width, height)?,
            foot: height,
            cell,
            rows,
            columns,
        })
    }

    /// Adds room for lines of text below the cells, and half a line around them.
    ///
    /// # Errors
    /// If the sheet would be too high.
    pub(crate) fn with_footer(self, lines: usize) -> Result<Self, RenderError> {
        let [_, line] = crate::canvas::letter_size(self.cell.width().min(self.cell.height()));
        let lines = u32::try_from(lines).unwrap_or(u32::MAX);
        let height = line.saturating_mul(lines.saturating_add(1));
        let size = FrameSize::new(self.size.width(), self.foot.saturating_add(height))?;
        Ok(Self { size, ..self })
    }

    /// Where the first line below the cells begins, in pixels from the top.
    pub(crate) fn foot(&self) -> i32 {
        let [_, line] = crate::canvas::letter_size(self.cell.width().min(self.cell.height()));
        (self.foot + line / 2) as i32
    }

    /// Pixels of the whole sheet.
    pub fn size(&self) -> FrameSize {
        self.size
    }

    /// A black sheet with its labels.
    pub fn begin(self, format: PixelFormat) -> Sheet {
        let empty = vec![0; self.size.pixel_count() * format.bytes_per_pixel()];
        let side = self.cell.width().min(self.cell.height());
        let mut canvas = Canvas::new(opaque(Frame::new(self.size, format, empty)), side);
        let [left, top] = gutters(self.cell, &self.rows).map(|gutter| gutter as i32);
        let line = canvas.line_height();
        let [width, height] = [self.cell.width() as i32, self.cell.height() as i32];
        for (column, label) in self.columns.iter().enumerate() {
            let centre = left + column as i32 * width + width / 2;
            let at = centre - canvas.text_width(label) / 2;
            canvas.write(label, at, (top - line) / 2);
        }
        for (row, label) in self.rows.iter().enumerate() {
            let middle = top + row as i32 * height + (height - line) / 2;
            canvas.write(label, line / 2, middle);
        }
        Sheet { plan: self, canvas }
    }
}

impl Sheet {
    /// Puts a picture into a cell.
    ///
    /// # Panics
    /// If there is no such cell, or the picture has another size or format than the sheet's.
    pub fn put(&mut self, frame: &Frame, row: usize, column: usize) {
        assert_eq!(frame.size(), self.plan.cell, "a picture fills its cell");
        assert!(row < self.plan.rows.len() && column < self.plan.columns.len());
        let [left, top] = gutters(self.plan.cell, &self.plan.rows);
        let x = left + column as u32 * self.plan.cell.width();
        let y = top + row as u32 * self.plan.cell.height();
        self.canvas.put(frame, x, y);
    }

    /// The canvas, to write below the cells.
    pub(crate) fn canvas(&mut self) -> &mut Canvas {
        &mut self.canvas
    }

    /// The whole sheet.
    pub fn finish(self) -> Frame {
        self.canvas.into_frame()
    }
}

/// Pixels left of the first column and above the first row.
fn gutters(cell: FrameSize, rows: &[String]) -> [u32; 2] {
    let [width, height] = crate::canvas::letter_size(cell.width().min(cell.height()));
    let longest = rows.iter().map(|label| label.chars().count()).max();
    let letters = longest.unwrap_or(0).min(64) as u32;
    [letters * width + height, 2 * height]
}

/// A black picture without holes.
fn opaque(frame: Frame) -> Frame {
    let (size, format) = (frame.size(), frame.format());
    let mut bytes = frame.bytes().to_vec();
    if matches!(format, PixelFormat::GreyAlpha8 | PixelFormat::Rgba8) {
        let length = format.bytes_per_pixel();
        bytes
            .iter_mut()
            .skip(length - 1)
            .step_by(length)
            .for_each(|alpha| *alpha = 255);
    }
    Frame::new(size, format, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(texts: &[&str]) -> Vec<String> {
        texts.iter().map(|&text| text.to_owned()).collect()
    }

    #[test]
    fn pictures_come_to_their_cells() {
        let cell = FrameSize::new(40, 30).unwrap();
        let plan =
            SheetPlan::new(cell, labels(&["0 mm", "8 mm"]), labels(&["left", "right"])).unwrap();
        let size = plan.size();
        let mut sheet = plan.begin(PixelFormat::Grey8);
        for (row, column, grey) in [(0, 0, 10), (0, 1, 20), (1, 0, 30)] {
            sheet.put(
                &Frame::new(cell, PixelFormat::Grey8, vec![grey; 1200]),
                row,
                column,
            );
        }
        let frame = sheet.finish();
        let [left, top] = [size.width() - 80, size.height() - 60];
        let at = |x: u32, y: u32| frame.pixel(left + x, top + y).unwrap()[0];
        assert_eq!(
            [at(0, 0), at(39, 29), at(40, 0), at(79, 29)],
            [10, 10, 20, 20]
        );
        assert_eq!([at(0, 30), at(39, 59), at(40, 30)], [30, 30, 0]);
        let labelled = frame.bytes()[..(top * size.width()) as usize].contains(&255);
        assert!(labelled, "the columns have labels");
    }

    #[test]
    fn sheets_are_bounded_and_not_empty() {
        let cell = FrameSize::new(512, 512).unwrap();
        let many = vec!["8 mm".to_owned(); 8];
        assert!(SheetPlan::new(cell, many.clone(), labels(&["left"])).is_err());
        assert!(SheetPlan::new(cell, many[..7].to_vec(), labels(&["left"])).is_ok());
        assert!(SheetPlan::new(cell, Vec::new(), Vec::new()).is_err());
    }
}
