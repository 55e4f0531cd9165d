//! Cells with labels on one sheet.

use render::{Frame, PixelFormat, SheetPlan, encode_png};

use super::Picture;
use crate::BenchError;

/// A cell and the label above it.
pub(super) type Cell = (String, Frame);

/// The cells of a sheet with several rows, and the labels of rows and columns.
pub(super) struct Cells {
    pub(super) rows: Vec<String>,
    pub(super) columns: Vec<String>,
    /// Row by row.
    pub(super) frames: Vec<Frame>,
}

impl Cells {
    /// One row without a label.
    pub(super) fn row(cells: Vec<Cell>) -> Self {
        let (columns, frames) = cells.into_iter().unzip();
        Self {
            rows: vec![String::new()],
            columns,
            frames,
        }
    }

    /// The sheet as a PNG. Levels are rounded to multiples of `level`, so that the file is small.
    ///
    /// # Panics
    /// If there is no cell.
    pub(super) fn picture(self, name: &'static str, level: u8) -> Result<Picture, BenchError> {
        let has_color = |frame: &Frame| frame.format() == PixelFormat::Rgb8;
        let format = if self.frames.iter().any(has_color) {
            PixelFormat::Rgb8
        } else {
            PixelFormat::Grey8
        };
        let columns = self.columns.len();
        let plan = SheetPlan::new(self.frames[0].size(), self.rows, self.columns)?;
        let mut sheet = plan.begin(format);
        for (index, frame) in self.frames.iter().enumerate() {
            sheet.put(&as_format(frame, format), index / columns, index % columns);
        }
        let sheet = rounded(&sheet.finish(), level);
        Ok(Picture {
            name,
            png: encode_png(&sheet, &[])?,
        })
    }
}

/// A grey picture in colour, if that is the format.
fn as_format(frame: &Frame, format: PixelFormat) -> Frame {
    if frame.format() == format {
        return frame.clone();
    }
    let grey = frame.bytes().iter();
    let colors = grey.flat_map(|&grey| [grey; 3]).collect();
    Frame::new(frame.size(), format, colors)
}

/// The picture with levels rounded to multiples of `level`, at most 255.
fn rounded(frame: &Frame, level: u8) -> Frame {
    let round = |&byte: &u8| {
        let steps = (u16::from(byte) + u16::from(level) / 2) / u16::from(level);
        (steps * u16::from(level)).min(255) as u8
    };
    let bytes = frame.bytes().iter().map(round).collect();
    Frame::new(frame.size(), frame.format(), bytes)
}
