//! Draws the pictures of a result.

use std::fmt::Display;

use case::{Case, CaseFacts, CaseId};
use cases::pictures::{
    CheckedPicture, Layout, Numbers, PicturePlan, PictureRequest, PictureSeries, SeriesPicture,
    marked, window_of,
};
use cases::{Cases, Error};
use imaging::dicom::write::{self, Picture};
use render::{Frame, PixelFormat, Sheet, WindowFunction};

use super::directions;
use super::outline::{COMMENT, Outline};
use super::request::What;

/// The pictures of a plan, with what draws them.
#[derive(Debug)]
pub(crate) struct Drawing {
    plan: PicturePlan,
    series: PictureSeries,
}

impl Drawing {
    /// Finds the layers and the renderer of a plan.
    pub(crate) async fn of(cases: &Cases, id: &CaseId, plan: PicturePlan) -> Result<Self, Error> {
        Ok(Self {
            series: PictureSeries::of(cases, id, plan.pictures.iter().cloned()).await?,
            plan,
        })
    }

    pub(super) fn outline(&self, what: What, case: &Case, facts: &CaseFacts) -> Outline {
        Outline {
            derivation: self.derivation(case, facts),
            is_annotated: self.series.identity().is_some(),
            depth_mm: self.ends()[0].depth_mm,
            layers: self.series.layers(),
            made_by: self.made_by(),
            ..Outline::new(write::PICTURE, self.shown(what))
        }
    }

    /// The first and the last picture.
    fn ends(&self) -> [&PictureRequest; 2] {
        let pictures = &self.plan.pictures;
        [&pictures[0].asked, &pictures[pictures.len() - 1].asked]
    }

    /// What viewers show in their list.
    fn shown(&self, what: What) -> String {
        let [first, last] = self.ends();
        let depths = range(first.depth_mm, last.depth_mm);
        let view = first.view.map_or("", |view| view.name());
        match what {
            What::View if view.is_empty() => format!("view at {depths} mm"),
            What::View => format!("{view} view at {depths} mm"),
            _ => format!("{} at {depths} mm", what.name()),
        }
    }

    /// How the pixels are made.
    fn derivation(&self, case: &Case, facts: &CaseFacts) -> String {
        let [first, last] = self.ends();
        let [width, height] = [first.width, first.height];
        let depth = range(first.depth_mm, last.depth_mm);
        let radius = case.parameters.closing_radius_mm;
        let mut text = format!(
            "Isosurface {depth} mm below the envelope of the {} (closing radius {radius} mm), {width} x {height} pixels, renderer {}, ",
            first.surface.words().unwrap_or("brain"),
            self.series.renderer(),
        );
        text += &match &self.plan.layout {
            Layout::Sheet { .. } => "a row for each depth and a column for each view, ".to_owned(),
            Layout::Separate | Layout::Animation { .. } => format!("view {}, ", first.direction()),
        };
        text += &match first.window {
            Some(Numbers([centre, width])) => {
                let function = match first.window_function {
                    Some(WindowFunction::Sigmoid) => "sigmoid ",
                    Some(WindowFunction::Linear) | None => "",
                };
                format!("{function}window centre {centre} and width {width}, ")
            }
            None if first.layer.is_some() => "window of the layer, ".to_owned(),
            None => {
                let shown = window_of(facts);
                format!(
                    "window centre {} and width {}, ",
                    shown.centre(),
                    shown.width()
                )
            }
        };
        text += &format!("{}. ", first.look().words());
        if let Some(layer) = &first.layer {
            text += &format!("Texture: layer {layer}. ");
        }
        if let Some(overlay) = &first.overlay {
            text += &format!("Overlay: layer {overlay}. ");
        }
        text + "Intensities are not resampled. " + &COMMENT
    }

    /// Everything besides the request that the pixels depend on.
    fn made_by(&self) -> String {
        let backends = self.series.backends();
        let versions = self.series.versions().unwrap_or_default();
        let identity = self.series.identity().unwrap_or_default();
        format!("{backends}; {versions}; {identity}")
    }

    /// The picture, or all of a sheet, as the pixels of an object.
    pub(crate) async fn draw(self, cases: &Cases) -> Result<Picture, Error> {
        let page = Page::new(&self.plan);
        let add = |page: &mut Page, picture: SeriesPicture| {
            let number = picture.number;
            // Whatever is asked, no picture leaves without its sides.
            let frame = match picture.request.annotate {
                true => picture.into_frame(),
                false => marked(picture.drawn.rendered.frame, &picture.metadata),
            };
            page.add(number, &frame);
            Ok(())
        };
        let page = self.series.draw_each(cases, page, add).await?;
        let first = self.plan.pictures.first().ok_or(Error::Internal)?;
        page.finish(first, &self.plan)
    }
}

/// One number, or two that differ.
fn range<T: Display + PartialEq>(from: T, to: T) -> String {
    match from == to {
        true => from.to_string(),
        false => format!("{from} to {to}"),
    }
}

/// Pixels so far.
struct Page {
    layout: Layout,
    sheet: Option<Sheet>,
    rgb: Vec<u8>,
}

impl Page {
    fn new(plan: &PicturePlan) -> Self {
        Self {
            layout: plan.layout.clone(),
            sheet: None,
            rgb: Vec::new(),
        }
    }

    fn add(&mut self, number: usize, frame: &Frame) {
        match &self.layout {
            Layout::Separate | Layout::Animation { .. } => extend_with_rgb(&mut self.rgb, frame),
            Layout::Sheet { plan, cells } => {
                let begin = || plan.clone().begin(frame.format());
                let sheet = self.sheet.get_or_insert_with(begin);
                let [row, column] = cells[number];
                sheet.put(frame, row, column);
            }
        }
    }

    fn finish(mut self, first: &CheckedPicture, plan: &PicturePlan) -> Result<Picture, Error> {
        let mut size = [first.asked.width, first.asked.height];
        if let Some(sheet) = self.sheet {
            let frame = sheet.finish();
            size = [frame.size().width(), frame.size().height()];
            extend_with_rgb(&mut self.rgb, &frame);
        }
        let side = |pixels: u32| u16::try_from(pixels).map_err(|_| Error::Internal);
        Ok(Picture {
            width: side(size[0])?,
            height: side(size[1])?,
            rgb: self.rgb,
            orientation: directions::of_rows_and_columns(&plan.pictures),
            laterality: directions::laterality(&plan.pictures),
        })
    }
}

/// Adds the colours of a picture, over black where it is transparent.
fn extend_with_rgb(rgb: &mut Vec<u8>, frame: &Frame) {
    let over_black = |value: u8, alpha: u8| {
        let product = u16::from(value) * u16::from(alpha);
        ((product + 127) / 255) as u8
    };
    let format = frame.format();
    rgb.reserve(frame.size().pixel_count() * 3);
    for pixel in frame.bytes().chunks_exact(format.bytes_per_pixel()) {
        rgb.extend(match (format, pixel) {
            (PixelFormat::Grey8, &[grey]) => [grey; 3],
            (PixelFormat::GreyAlpha8, &[grey, alpha]) => [over_black(grey, alpha); 3],
            (PixelFormat::Rgba8, &[r, g, b, alpha]) => {
                [r, g, b].map(|value| over_black(value, alpha))
            }
            (_, &[r, g, b, ..]) => [r, g, b],
            _ => [0; 3],
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use render::FrameSize;

    #[test]
    fn every_format_becomes_colours_over_black() {
        let size = FrameSize::new(1, 1).unwrap();
        for (format, bytes, expected) in [
            (PixelFormat::Grey8, vec![7], [7; 3]),
            (PixelFormat::GreyAlpha8, vec![200, 51], [40; 3]),
            (PixelFormat::GreyAlpha8, vec![200, 255], [200; 3]),
            (PixelFormat::Rgb8, vec![1, 2, 3], [1, 2, 3]),
            (PixelFormat::Rgba8, vec![255, 2, 3, 0], [0; 3]),
        ] {
            let mut rgb = Vec::new();
            extend_with_rgb(&mut rgb, &Frame::new(size, format, bytes));
            assert_eq!(rgb, expected, "{format:?}");
        }
    }
}
