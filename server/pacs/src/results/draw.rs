//! Draws the pictures of a result.

use case::CaseId;
use cases::pictures::{
    CheckedPicture, ChosenLayers, DrawnPicture, ImageMetadata, annotated, backend_for, marked,
    warm_job,
};
use cases::{Cases, Error};
use imaging::dicom::write::{Cine, Pictures};
use render::{Frame, PixelFormat, RenderBackend, Sheet};

use super::directions;
use super::request::{Layout, PicturePlan};

/// The pictures of a plan, with what draws them.
#[derive(Debug)]
pub(crate) struct Drawing {
    plan: PicturePlan,
    /// The layers of each picture.
    layers: Vec<ChosenLayers>,
    /// The renderer of all pictures, and its device.
    backend: RenderBackend,
    /// What is written of the case into each picture.
    identity: Option<String>,
}

impl Drawing {
    /// Finds the layers and the renderer of a plan.
    pub(crate) async fn of(cases: &Cases, id: &CaseId, plan: PicturePlan) -> Result<Self, Error> {
        let mut layers = Vec::with_capacity(plan.pictures.len());
        for picture in &plan.pictures {
            layers.push(picture.asked.layers().of_case(&cases.library, id).await?);
        }
        let renderer = plan.pictures.first().ok_or(Error::Internal)?;
        let backend = backend_for(renderer.asked.renderer, &cases.graphics).await;
        let is_annotated = renderer.asked.annotate;
        Ok(Self {
            layers,
            backend,
            identity: cases.identity(id, is_annotated).await?,
            plan,
        })
    }

    pub(crate) fn plan(&self) -> &PicturePlan {
        &self.plan
    }

    /// The same, of a cine only the first picture.
    pub(crate) fn first(mut self) -> Self {
        if let Layout::Cine { .. } = self.plan.layout {
            self.plan.pictures.truncate(1);
            self.layers.truncate(1);
        }
        self
    }

    /// The renderer, such as `trace`.
    pub(crate) fn renderer(&self) -> &'static str {
        self.backend.name()
    }

    /// Whether what identifies the case is written into the pictures.
    pub(crate) fn is_annotated(&self) -> bool {
        self.identity.is_some()
    }

    /// Everything besides the request that the pixels depend on.
    pub(crate) fn made_by(&self) -> String {
        let mut versions: Vec<_> = self
            .layers
            .iter()
            .filter_map(ChosenLayers::version)
            .collect();
        versions.dedup();
        let identity = self.identity.as_deref().unwrap_or_default();
        format!("{}; {}; {identity}", self.backend, versions.join("; "))
    }

    /// The pictures, as the pixels of an object.
    pub(crate) async fn draw(self, cases: &Cases, id: &CaseId) -> Result<Pictures, Error> {
        let plan = self.plan.clone();
        let page = Page::new(&plan);
        let add = |page: &mut Page, drawn: Drawn| {
            let frame = drawn.picture.rendered.frame;
            // Whatever is asked, no picture leaves without its sides.
            let frame = match drawn.annotate {
                true => annotated(frame, &drawn.metadata, true),
                false => marked(frame, &drawn.metadata),
            };
            page.add(drawn.number, &frame);
            Ok(())
        };
        let page = self.draw_each(cases, id, page, add).await?;
        let first = plan.pictures.first().ok_or(Error::Internal)?;
        page.finish(first, &plan)
    }

    /// Draws each picture and passes it to `add`, which runs in the same turn. The pictures share one place in the queue;
    /// between them others get their turn.
    pub(crate) async fn draw_each<T: Send + 'static>(
        self,
        cases: &Cases,
        id: &CaseId,
        mut kept: T,
        add: impl Fn(&mut T, Drawn) -> Result<(), Error> + Copy + Send + 'static,
    ) -> Result<T, Error> {
        let model = cases.model(id).await?;
        let queued = cases.queue.enter()?;
        for (number, (picture, layers)) in self.plan.pictures.iter().zip(&self.layers).enumerate() {
            let turn = queued.turn().await?;
            let loaded = layers.load(&cases.library, id).await?;
            let job = warm_job(&model, picture, loaded, self.backend.clone()).await?;
            let drawn = Drawn {
                number,
                metadata: ImageMetadata::of(Some(id), &job.job).named(self.identity.clone()),
                picture: job.draw(&turn).await?,
                annotate: picture.asked.annotate,
            };
            let add_it = move || add(&mut kept, drawn).map(|()| kept);
            kept = turn.run(add_it).await??;
        }
        Ok(kept)
    }
}

/// A drawn picture.
pub(crate) struct Drawn {
    /// Its number, from 0.
    pub(crate) number: usize,
    /// Its pixels.
    pub(crate) picture: DrawnPicture,
    /// Its state.
    pub(crate) metadata: ImageMetadata,
    /// Whether to annotate it.
    pub(crate) annotate: bool,
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
            Layout::One | Layout::Cine { .. } => extend_with_rgb(&mut self.rgb, frame),
            Layout::Sheet { plan, columns } => {
                let begin = || plan.clone().begin(frame.format());
                let sheet = self.sheet.get_or_insert_with(begin);
                sheet.put(frame, number / columns, number % columns);
            }
        }
    }

    fn finish(mut self, first: &CheckedPicture, plan: &PicturePlan) -> Result<Pictures, Error> {
        let mut size = [first.asked.width, first.asked.height];
        if let Some(sheet) = self.sheet {
            let frame = sheet.finish();
            size = [frame.size().width(), frame.size().height()];
            extend_with_rgb(&mut self.rgb, &frame);
        }
        let side = |pixels: u32| u16::try_from(pixels).map_err(|_| Error::Internal);
        Ok(Pictures {
            width: side(size[0])?,
            height: side(size[1])?,
            rgb: self.rgb,
            orientation: directions::of_rows_and_columns(&plan.pictures),
            laterality: directions::laterality(&plan.pictures),
            cine: match &plan.layout {
                Layout::Cine { frame_time_ms } => Some(Cine {
                    frames: plan.pictures.len(),
                    frame_time_ms: *frame_time_ms,
                }),
                _ => None,
            },
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
