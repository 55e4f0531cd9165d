//! Encodes a picture as PNG with its state.

use case::{CaseId, SurfaceName};
use render::{Caption, Frame, KeyedLayers, Projection, RenderBackend, RenderJob, RenderRequest};

use super::drawing::DrawnPicture;
use crate::error::Error;

/// The metadata of a picture: its state and its annotation.
#[derive(Debug, Clone)]
pub struct ImageMetadata {
    case: Option<CaseId>,
    /// The line about the case in the picture.
    named: Option<String>,
    surface: SurfaceName,
    request: RenderRequest,
    projection: Projection,
    layers: KeyedLayers,
}

impl ImageMetadata {
    /// The metadata of a picture of a case; `None` for a picture of a file, whose name may be a patient's.
    pub fn of(case: Option<&CaseId>, job: &RenderJob) -> Self {
        Self {
            case: case.copied(),
            named: None,
            surface: SurfaceName::Whole,
            request: job.request,
            projection: job.request.projection(&job.case.scene()),
            layers: job.layers.clone(),
        }
    }

    /// The same, with what is written of the case into the picture: see [`Cases::identity`](crate::Cases::identity).
    #[must_use]
    pub fn named(self, named: Option<String>) -> Self {
        Self { named, ..self }
    }

    /// The same, of a surface.
    #[must_use]
    pub fn of_surface(self, surface: SurfaceName) -> Self {
        Self { surface, ..self }
    }

    /// The projection of the picture.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// The PNG texts of a picture, given its backend.
    pub fn texts(&self, backend: &RenderBackend) -> Vec<(&'static str, String)> {
        let case = self.case.map(|id| id.to_string()).unwrap_or_default();
        let mut texts =
            render::state_texts(&case, backend.name(), &self.request, &self.layers.layers());
        texts.push(("device", backend.device()));
        if !self.surface.is_whole() {
            texts.push(("surface", self.surface.name().to_owned()));
        }
        texts.retain(|(_, text)| !text.is_empty());
        texts
    }
}

/// An encoded picture.
#[derive(Debug)]
pub struct EncodedImage {
    /// The file.
    pub png: Vec<u8>,
    /// The backend that drew it.
    pub backend: RenderBackend,
    /// How many native voxels along x, y and z became one, if the volume is too large for the device.
    pub reduction: Option<[usize; 3]>,
}

/// Annotates a picture on request, and encodes it.
///
/// # Errors
/// If it cannot be encoded.
pub fn encode(
    drawn: DrawnPicture,
    metadata: &ImageMetadata,
    annotate: bool,
) -> Result<EncodedImage, Error> {
    let frame = annotated(drawn.rendered.frame, metadata, annotate);
    let png = render::encode_png(&frame, &metadata.texts(&drawn.backend))?;
    Ok(EncodedImage {
        png,
        backend: drawn.backend,
        reduction: drawn.rendered.reduction,
    })
}

/// The picture, annotated on request.
pub fn annotated(frame: Frame, metadata: &ImageMetadata, annotate: bool) -> Frame {
    if annotate {
        render::annotate(
            frame,
            &metadata.request,
            &metadata.projection,
            &metadata.layers.layers(),
            Caption {
                named: metadata.named.as_deref(),
                surface: metadata.surface.words(),
            },
        )
    } else {
        frame
    }
}

/// The picture with nothing but the patient's left and right, if they lie in it.
pub fn marked(frame: Frame, metadata: &ImageMetadata) -> Frame {
    render::mark_sides(frame, &metadata.request)
}
