//! Slices with the contours of the isosurfaces.

mod contour;
mod edges;
mod oblique;
#[cfg(test)]
mod tests;

use std::str::FromStr;

use geometry::{BoundingSphere, Volume};
use rayon::prelude::*;

use crate::error::checked;
use crate::rays::Rays;
use crate::shade::{OverlayPaint, Texture, nearest, texture_from_patient, texture_rescale};
use crate::{
    Camera, ColorMap, Frame, FrameSize, NamedView, PixelFormat, Projection, RenderError, Scene,
    Window,
};
use contour::Contours;
pub(crate) use contour::color as contour_color;
pub(crate) use edges::COLOR as EDGE_COLOR;
use edges::Edges;
#[cfg(test)]
pub(crate) use edges::{FULL_RISE, HALF_WIDTH, LEAST_RISE, RISE_REACH};
pub use oblique::Oblique;
use strum::IntoStaticStr;

/// The largest number of contours in a picture.
pub const MAX_CONTOURS: usize = 16;

/// On which side of axial and coronal slices the patient's left is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum SliceConvention {
    /// At the right: axial slices are seen from below, coronal ones from the front.
    #[default]
    Radiological,
    /// At the left: axial slices are seen from above, coronal ones from behind.
    Neurological,
}

impl SliceConvention {
    /// Whether it is the default.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Across which patient axis a slice lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Plane))]
pub enum SlicePlane {
    /// Anterior up; in the radiological convention the patient's left at the right of the picture.
    Axial,
    /// Superior up; in the radiological convention the patient's left at the right of the picture.
    Coronal,
    /// Seen from the left: superior up, anterior at the left of the picture.
    Sagittal,
}

impl SlicePlane {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Axial, Self::Coronal, Self::Sagittal];

    /// The name in the interfaces: `axial`, `coronal`, `sagittal`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The position of the slice through the middle of the envelope: an LPS coordinate in mm.
    pub fn middle_mm(self, bounds: &BoundingSphere) -> f64 {
        bounds.centre_in_patient[self.axis()]
    }

    /// The patient axis across the plane: 0 for L, 1 for P, 2 for S.
    pub fn axis(self) -> usize {
        match self {
            Self::Sagittal => 0,
            Self::Coronal => 1,
            Self::Axial => 2,
        }
    }

    /// The direction from which a slice is seen.
    pub fn view(self, convention: SliceConvention) -> NamedView {
        use SliceConvention::{Neurological, Radiological};
        match (self, convention) {
            (Self::Axial, Radiological) => NamedView::Inferior,
            (Self::Axial, Neurological) => NamedView::Superior,
            (Self::Coronal, Radiological) => NamedView::Anterior,
            (Self::Coronal, Neurological) => NamedView::Posterior,
            (Self::Sagittal, _) => NamedView::Left,
        }
    }
}

impl FromStr for SlicePlane {
    type Err = RenderError;

    fn from_str(name: &str) -> Result<Self, RenderError> {
        Self::ALL
            .into_iter()
            .find(|plane| plane.name() == name)
            .ok_or(RenderError::UnknownName {
                name: "plane",
                known: "axial, coronal, sagittal",
            })
    }
}

/// Unchecked parameters of a [`SliceRequest`].
#[derive(Debug, Clone, PartialEq)]
pub struct SliceParameters {
    /// The orientation of the slice.
    pub plane: SlicePlane,
    /// On which side the patient's left is.
    pub convention: SliceConvention,
    /// The LPS coordinate in mm across the plane (S of an axial slice, P of a coronal, L of a sagittal one).
    pub position_mm: f64,
    /// Another plane instead, in any direction.
    pub oblique: Option<Oblique>,
    /// Depths of the isosurfaces whose contours are drawn, each 0 to 1000 mm, at most [`MAX_CONTOURS`].
    pub depths_mm: Vec<f64>,
    /// 1 shows the slice at the scale at which a [`Camera`] of zoom 1 shows the head.
    pub zoom: f64,
    /// Moves the slice to the right of the picture and up, in mm.
    pub pan_mm: [f64; 2],
    /// Size of the picture.
    pub size: FrameSize,
    /// The display window.
    pub window: Window,
    /// The colour map.
    pub colormap: ColorMap,
    /// Whether the overlay is drawn as its edges alone.
    pub has_edges: bool,
}

impl SliceParameters {
    /// The slice at `position_mm`, radiological, grey, without contours or edges, 512 × 512 pixels.
    pub fn new(plane: SlicePlane, position_mm: f64, window: Window) -> Self {
        Self {
            plane,
            convention: SliceConvention::default(),
            position_mm,
            oblique: None,
            depths_mm: Vec::new(),
            zoom: 1.0,
            pan_mm: [0.0; 2],
            size: FrameSize::default(),
            window,
            colormap: ColorMap::Grey,
            has_edges: false,
        }
    }
}

/// A checked request for a slice.
#[derive(Debug, Clone, PartialEq)]
pub struct SliceRequest {
    parameters: SliceParameters,
    camera: Camera,
}

impl SliceRequest {
    /// Checks the parameters.
    ///
    /// # Errors
    /// If there are too many depths, or a number is not finite or out of its range (`position_mm` within ±10,000, a
    /// depth in 0..=1000, zoom and pan as of a [`Camera`]).
    pub fn new(parameters: SliceParameters) -> Result<Self, RenderError> {
        checked(
            "position_mm",
            parameters.position_mm,
            -1e4..=1e4,
            "within -10000 to 10000",
        )?;
        let count = parameters.depths_mm.len();
        if count > MAX_CONTOURS {
            return Err(RenderError::TooManyContours {
                count,
                limit: MAX_CONTOURS,
            });
        }
        for &depth_mm in &parameters.depths_mm {
            checked("depth_mm", depth_mm, 0.0..=1000.0, "within 0 to 1000")?;
        }
        let camera = Camera::named(parameters.plane.view(parameters.convention))
            .with_zoom(parameters.zoom)?
            .with_pan_mm(parameters.pan_mm)?;
        let oblique = parameters.oblique;
        let request = Self { parameters, camera };
        Ok(match oblique {
            Some(oblique) => request.across(oblique),
            None => request,
        })
    }

    /// The request with another plane, position within ±10,000 mm, and window.
    #[must_use]
    pub fn shown(self, plane: SlicePlane, position_mm: f64, window: Window) -> Self {
        Self {
            camera: self
                .camera
                .turned_to(plane.view(self.parameters.convention)),
            parameters: SliceParameters {
                plane,
                position_mm: position_mm.clamp(-1e4, 1e4),
                window,
                ..self.parameters
            },
        }
    }

    /// The request with a plane in any direction.
    #[must_use]
    pub fn across(self, oblique: Oblique) -> Self {
        let orientation = oblique.orientation(self.parameters.convention);
        Self {
            camera: self.camera.oriented(orientation),
            parameters: SliceParameters {
                oblique: Some(oblique),
                ..self.parameters
            },
        }
    }

    /// The checked parameters.
    pub fn parameters(&self) -> &SliceParameters {
        &self.parameters
    }

    /// The direction of view.
    pub(crate) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The projection of the slice, whose pixels are at frame-space z 0.
    pub fn projection(&self, bounds: &BoundingSphere) -> Projection {
        let mut centre_in_patient = bounds.centre_in_patient;
        match self.parameters.oblique {
            Some(oblique) => centre_in_patient = oblique.centre_in_patient(),
            None => {
                centre_in_patient[self.parameters.plane.axis()] = self.parameters.position_mm;
            }
        }
        let target = BoundingSphere {
            centre_in_patient,
            ..*bounds
        };
        self.camera.projection(&target, self.parameters.size)
    }
}

/// Draws a slice through the native volume with the contours of the isosurfaces.
///
/// Each pixel is sampled once, through the affine; outside of the volume, and if a layer is undefined there, it is
/// black. The n-th depth's contour has the n-th of eight colours (yellow, sky blue, orange, green, violet, cyan, red,
/// white), repeatedly. The overlay is drawn in its colours or, on request, as the lines where its values rise steepest.
/// The picture is grey, one byte per pixel, if it has neither contours nor colours nor an overlay.
pub fn draw_slice(scene: &Scene<'_>, request: &SliceRequest) -> Frame {
    let parameters = request.parameters();
    let projection = request.projection(&scene.bounds);
    let slice = Slice {
        texture: Texture::of(scene),
        rays: Rays::through_voxels(&projection, texture_from_patient(scene), 1.0),
        request,
        rescale: texture_rescale(scene),
        colors: parameters.colormap.table(),
        overlay: scene
            .layers
            .overlay
            .map(|overlay| match parameters.has_edges {
                true => Above::Edges(Box::new(Edges::new(overlay, &projection))),
                false => Above::Colors(Box::new(OverlayPaint::new(overlay, &projection, 1.0))),
            }),
    };
    let size = parameters.size;
    let is_plain = parameters.depths_mm.is_empty() && slice.overlay.is_none();
    if is_plain && parameters.colormap.is_grey() {
        let bytes = slice.rows(|_, _, [grey, ..]| [grey]);
        return Frame::new(size, PixelFormat::Grey8, bytes);
    }
    let contours = Contours::new(scene.field, &projection, &parameters.depths_mm);
    let bytes = slice.rows(|column, row, color| contours.over(column, row, color));
    Frame::new(size, PixelFormat::Rgb8, bytes)
}

/// Draws a slice through a volume alone, for which there is no model yet: without contours, as [`draw_slice`] otherwise.
///
/// A camera of zoom 1 shows `bounds`.
pub fn draw_acquired_slice(
    volume: &Volume,
    bounds: &BoundingSphere,
    request: &SliceRequest,
) -> Frame {
    let parameters = request.parameters();
    let projection = request.projection(bounds);
    let slice = Slice {
        texture: Texture::of_volume(volume),
        rays: Rays::through_voxels(&projection, volume.grid().voxel_from_patient(), 1.0),
        request,
        rescale: volume.rescale(),
        colors: parameters.colormap.table(),
        overlay: None,
    };
    if parameters.colormap.is_grey() {
        let bytes = slice.rows(|_, _, [grey, ..]| [grey]);
        return Frame::new(parameters.size, PixelFormat::Grey8, bytes);
    }
    let bytes = slice.rows(|_, _, color| color);
    Frame::new(parameters.size, PixelFormat::Rgb8, bytes)
}

/// What the pixels of a slice show.
struct Slice<'a> {
    texture: Texture<'a>,
    rays: Rays,
    request: &'a SliceRequest,
    rescale: geometry::Rescale,
    colors: [[u8; 3]; 256],
    overlay: Option<Above<'a>>,
}

/// What of the overlay is drawn over the texture.
enum Above<'a> {
    Colors(Box<OverlayPaint<'a>>),
    Edges(Box<Edges<'a>>),
}

impl Above<'_> {
    /// A colour at a place of the picture, in pixels, with the overlay above it.
    fn over(&self, color: [u8; 3], place: [f32; 2]) -> [u8; 3] {
        let color = match self {
            Self::Colors(colors) => colors.over(color, place, 0.0),
            Self::Edges(edges) => edges.over(color, place),
        };
        color.map(nearest)
    }
}

impl Slice<'_> {
    /// The bytes of all pixels; `encode` makes them from column, row and colour.
    fn rows<const BYTES: usize>(
        &self,
        encode: impl Fn(usize, usize, [u8; 3]) -> [u8; BYTES] + Sync,
    ) -> Vec<u8> {
        let size = self.request.parameters().size;
        let window = self.request.parameters().window.line(self.rescale);
        let mut bytes = vec![0; size.pixel_count() * BYTES];
        bytes
            .par_chunks_mut(size.width() as usize * BYTES)
            .enumerate()
            .for_each(|(row, pixels)| {
                let (pixels, _) = pixels.as_chunks_mut::<BYTES>();
                for (column, pixel) in pixels.iter_mut().enumerate() {
                    let [x, y] = [column as f32 + 0.5, row as f32 + 0.5];
                    let value = self.texture.at(self.rays.place_on_slice(x, y));
                    let color = value.map_or([0; 3], |value| {
                        self.colors[usize::from((window.brightness(value) + 0.5) as u8)]
                    });
                    let color = match &self.overlay {
                        Some(overlay) => overlay.over(color, [x, y]),
                        None => color,
                    };
                    *pixel = encode(column, row, color);
                }
            });
        bytes
    }
}
