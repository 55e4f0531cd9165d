//! From a drawn picture to PNG, with its story.

use axum::http::{HeaderMap, HeaderName};
use render::{Frame, Projection, RenderRequest, Scene};

use crate::caching;
use crate::case::CaseId;
use crate::drawing::{Drawer, Drawn};
use crate::problem::AppError;
use crate::routes::render::SOFTWARE;

/// All that is needed to draw a picture again, as texts for PNG.
#[derive(Debug, Clone)]
pub struct Story {
    texts: Vec<(&'static str, String)>,
    request: RenderRequest,
    projection: Projection,
}

impl Story {
    /// The story of a picture of a case; `None` where it is of a file, whose name may be a patient's.
    pub fn of(case: Option<&CaseId>, request: &RenderRequest, scene: &Scene<'_>) -> Self {
        let parameters = request.parameters();
        let camera = &parameters.camera;
        let [x, y, z, w] = camera.orientation().to_array();
        let [right, up] = camera.pan_mm();
        let window = parameters.window;
        let mut texts = vec![
            ("Software", SOFTWARE.to_owned()),
            ("Depth in mm", parameters.depth_mm.to_string()),
            ("Orientation", format!("{x},{y},{z},{w}")),
            ("Zoom", camera.zoom().to_string()),
            ("Pan in mm", format!("{right},{up}")),
            ("Window", format!("{},{}", window.centre(), window.width())),
            ("Colour map", parameters.colormap.name().to_owned()),
            ("Slab in mm", parameters.slab_mm.to_string()),
            ("Ambient", parameters.light.ambient().to_string()),
        ];
        texts.extend(case.map(|id| ("Case", id.to_string())));
        Self {
            texts,
            request: *request,
            projection: request.projection(scene),
        }
    }

    /// The texts of a picture, once it is known who drew it.
    pub fn texts<'a>(&'a self, drawer: &'a Drawer, device: &'a str) -> Vec<(&'a str, &'a str)> {
        let told = self.texts.iter().map(|(name, text)| (*name, text.as_str()));
        told.chain([("Renderer", drawer.name()), ("Device", device)])
            .collect()
    }
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

impl Finished {
    /// Says in headers who drew, on what, and of how much.
    pub fn describe(&self, headers: &mut HeaderMap) {
        let mut insert = |name, text: &str| {
            caching::insert(headers, HeaderName::from_static(name), text);
        };
        insert("x-isocortex-renderer", self.drawer.name());
        insert("x-isocortex-device", &self.drawer.device());
        if let Some([x, y, z]) = self.reduction {
            insert("x-isocortex-reduction", &format!("{x}x{y}x{z}"));
        }
    }
}

/// Annotates a picture where that is wished, and encodes it.
///
/// # Errors
/// When it cannot be encoded.
pub fn finish(drawn: Drawn, story: &Story, annotate: bool) -> Result<Finished, AppError> {
    let frame = dressed(drawn.frame, story, annotate);
    let device = drawn.drawer.device();
    let png = render::encode_png(&frame, &story.texts(&drawn.drawer, &device))?;
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
