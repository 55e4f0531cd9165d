//! Encodes a picture as PNG with its state.

use case::{CaseId, SurfaceName};
use render::{
    Caption, DrawnMap, Frame, KeyedLayers, MapDisc, MapFace, MapSides, Projection, RenderBackend,
    RenderRequest,
};

use super::drawing::{DrawnPicture, PictureJob};
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
    /// The discs of a map.
    discs: Vec<MapDisc>,
    /// What each pixel of a map shows, if it is to be annotated.
    positions: Vec<[f32; 3]>,
}

impl ImageMetadata {
    /// The metadata of a picture of a case; `None` for a picture of a file, whose name may be a patient's.
    ///
    /// # Panics
    /// If it has no part.
    pub fn of(case: Option<&CaseId>, parts: &[PictureJob]) -> Self {
        let job = &parts.first().expect("a picture has a part").job;
        let parameters = parts.iter().map(|part| part.job.request.parameters());
        Self {
            case: case.copied(),
            named: None,
            surface: SurfaceName::Whole,
            request: job.request,
            projection: job.request.projection(&job.case.scene()),
            layers: job.layers.clone(),
            discs: parameters.filter_map(|parameters| parameters.map).collect(),
            positions: Vec::new(),
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

    /// The same, of a map with these positions of its pixels.
    #[must_use]
    pub(super) fn with_positions(self, positions: Vec<[f32; 3]>) -> Self {
        Self { positions, ..self }
    }

    /// The orthographic projection of the picture.
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
        texts.extend(self.map_texts());
        texts.retain(|(_, text)| !text.is_empty());
        texts
    }
}

impl ImageMetadata {
    /// The keys of a map.
    fn map_texts(&self) -> Vec<(&'static str, String)> {
        let faces = [MapFace::Outer, MapFace::Inner];
        let [outer, inner] = faces.map(|face| self.discs.iter().any(|disc| disc.face == face));
        let sides = match (outer, inner) {
            (false, false) => return Vec::new(),
            (true, false) => MapSides::Outer,
            (false, true) => MapSides::Inner,
            (true, true) => MapSides::Both,
        };
        vec![
            ("projection", "map".to_owned()),
            ("sides", sides.name().to_owned()),
        ]
    }
}

#[derive(Debug)]
pub struct EncodedImage {
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
    if !annotate {
        return frame;
    }
    let (request, layers) = (&metadata.request, &metadata.layers.layers());
    let caption = Caption {
        named: metadata.named.as_deref(),
        surface: metadata.surface.words(),
    };
    if metadata.discs.is_empty() {
        return render::annotate(frame, request, &metadata.projection, layers, caption);
    }
    let map = DrawnMap {
        discs: &metadata.discs,
        positions: &metadata.positions,
    };
    render::annotate_map(frame, request, &map, layers, caption)
}

/// The picture with nothing but the patient's left and right, if they lie in it.
pub fn marked(frame: Frame, metadata: &ImageMetadata) -> Frame {
    render::mark_sides(frame, &metadata.request)
}
