//! From a drawn picture to PNG, with its story.

use render::{Frame, Projection, RenderRequest, Scene};

use super::drawing::{Drawer, Drawn};
use crate::error::Error;
use case::CaseId;

/// All that is needed to draw a picture again, and to write into it.
#[derive(Debug, Clone)]
pub struct Story {
    case: Option<CaseId>,
    request: RenderRequest,
    projection: Projection,
}

impl Story {
    /// The story of a picture of a case; `None` where it is of a file, whose name may be a patient's.
    pub fn of(case: Option<&CaseId>, request: &RenderRequest, scene: &Scene<'_>) -> Self {
        Self {
            case: case.copied(),
            request: *request,
            projection: request.projection(scene),
        }
    }

    /// The texts of a picture, once it is known who drew it.
    pub fn texts(&self, drawer: &Drawer) -> Vec<(&'static str, String)> {
        let case = self.case.map(|id| id.to_string()).unwrap_or_default();
        let mut texts = render::state_texts(&case, drawer.name(), &self.request);
        texts.push(("device", drawer.device()));
        texts.retain(|(_, text)| !text.is_empty());
        texts
    }
}

/// Texts as the encoders take them.
pub fn borrowed<'a>(texts: &'a [(&'static str, String)]) -> Vec<(&'a str, &'a str)> {
    texts
        .iter()
        .map(|(name, text)| (*name, text.as_str()))
        .collect()
}

/// A picture as it is sent.
#[derive(Debug)]
pub struct Finished {
    /// The file.
    pub png: Vec<u8>,
    /// Who drew it.
    pub drawer: Drawer,
    /// How many native voxels along x, y and z became one, where the volume is too large for the device.
    pub reduction: Option<[usize; 3]>,
}

/// Annotates a picture where that is wished, and encodes it.
///
/// # Errors
/// When it cannot be encoded.
pub fn finish(drawn: Drawn, story: &Story, annotate: bool) -> Result<Finished, Error> {
    let frame = dressed(drawn.frame, story, annotate);
    let texts = story.texts(&drawn.drawer);
    let png = render::encode_png(&frame, &borrowed(&texts))?;
    Ok(Finished {
        png,
        drawer: drawn.drawer,
        reduction: drawn.reduction,
    })
}

/// The picture, with what is written into it on request.
pub fn dressed(frame: Frame, story: &Story, annotate: bool) -> Frame {
    if annotate {
        render::annotate(frame, &story.request, &story.projection)
    } else {
        frame
    }
}
