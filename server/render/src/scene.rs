//! The scene and the request for a picture.

use geometry::{BoundingSphere, DeformableModel, DepthField, ShellIndex, Volume};

use crate::error::checked;
use crate::rays::Look;
use crate::{
    Camera, ColorMap, FrameSize, Layers, Light, MapDisc, MapProjection, NamedView, Projection,
    RenderError, Window,
};

/// The data of a case that a renderer needs. Cheap to make, because it borrows everything.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// Intensities on their native grid, which may be cropped around the envelope.
    pub volume: &'a Volume,
    /// Depth below the envelope.
    pub field: &'a DepthField,
    /// The same, smoothed, for normals (a Gaussian of 1.5 voxels hides the voxel staircase).
    pub normals: &'a DepthField,
    /// The envelope's voxels by depth.
    pub shell: &'a ShellIndex,
    /// The sphere that the camera looks at.
    pub bounds: BoundingSphere,
    /// Layers to show in addition to the intensities of the volume, or instead of them.
    pub layers: Layers<'a>,
}

impl<'a> Scene<'a> {
    /// The same scene with layers.
    pub fn with_layers(self, layers: Layers<'a>) -> Self {
        Self { layers, ..self }
    }
}

impl<'a> From<&'a DeformableModel> for Scene<'a> {
    fn from(model: &'a DeformableModel) -> Self {
        Self {
            volume: model.volume(),
            field: model.field(),
            normals: model.normals(),
            shell: model.shell(),
            bounds: model.bounds(),
            layers: Layers::default(),
        }
    }
}

/// The background.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub enum Background {
    /// Opaque black.
    #[default]
    Black,
    /// Nothing: alpha 0.
    Transparent,
}

/// Unchecked parameters of a [`RenderRequest`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderParameters {
    /// Depth of the isosurface below the envelope, 0 to 1000 mm; beyond the deepest point there is nothing to see.
    pub depth_mm: f64,
    /// The camera.
    pub camera: Camera,
    /// A disc of the flat map instead of the orthographic picture. Zoom and pan of the camera move the map.
    pub map: Option<MapDisc>,
    /// Size of the picture.
    pub size: FrameSize,
    /// The display window.
    pub window: Window,
    /// The colour map.
    pub colormap: ColorMap,
    /// Intensities are averaged over this depth to either side of the isosurface, 0 to 20 mm, but never beyond the
    /// envelope.
    pub slab_mm: f64,
    /// The light.
    pub light: Light,
    /// The background.
    pub background: Background,
}

impl RenderParameters {
    /// The left side at depth 0, grey, lit, 512 × 512 pixels on black.
    pub fn new(window: Window) -> Self {
        Self {
            depth_mm: 0.0,
            camera: Camera::named(NamedView::Left),
            map: None,
            size: FrameSize::default(),
            window,
            colormap: ColorMap::Grey,
            slab_mm: 0.0,
            light: Light::default(),
            background: Background::Black,
        }
    }
}

/// A checked request for a picture of an isosurface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderRequest(RenderParameters);

impl RenderRequest {
    /// Checks the parameters.
    ///
    /// # Errors
    /// If `depth_mm` is not in 0..=1000 or `slab_mm` not in 0..=20.
    pub fn new(parameters: RenderParameters) -> Result<Self, RenderError> {
        checked(
            "depth_mm",
            parameters.depth_mm,
            0.0..=1000.0,
            "within 0 to 1000",
        )?;
        Self::check_slab(parameters.slab_mm)?;
        Ok(Self(parameters))
    }

    /// Checks `slab_mm` of the parameters.
    ///
    /// # Errors
    /// If it is not in 0..=20.
    pub fn check_slab(slab_mm: f64) -> Result<(), RenderError> {
        checked("slab_mm", slab_mm, 0.0..=20.0, "within 0 to 20").map(|_| ())
    }

    /// The request with the nearest accepted depth and slab.
    pub fn within_limits(parameters: RenderParameters) -> Self {
        Self(RenderParameters {
            depth_mm: parameters.depth_mm.clamp(0.0, 1000.0),
            slab_mm: parameters.slab_mm.clamp(0.0, 20.0),
            ..parameters
        })
    }

    /// The checked parameters.
    pub fn parameters(&self) -> &RenderParameters {
        &self.0
    }

    /// The projection of the disc, if the request is for a disc of a map.
    pub fn map_projection(&self) -> Option<MapProjection> {
        let disc = self.0.map?;
        Some(disc.projection(&self.0.camera, self.0.size))
    }

    /// How the picture sees `scene`.
    pub(crate) fn look(&self, scene: &Scene<'_>) -> Look {
        match self.map_projection() {
            Some(projection) => Look::Map(projection),
            None => Look::Parallel(self.projection(scene)),
        }
    }

    /// The orthographic projection of `scene` by the camera of the request.
    pub fn projection(&self, scene: &Scene<'_>) -> Projection {
        self.0.camera.projection(&scene.bounds, self.0.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_depths_are_refused() {
        let good = RenderParameters::new(Window::between(0.0, 100.0));
        assert!(RenderRequest::new(good).is_ok());
        for depth_mm in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(RenderRequest::new(RenderParameters { depth_mm, ..good }).is_err());
        }
        for slab_mm in [-0.5, 21.0, f64::NAN] {
            assert!(RenderRequest::new(RenderParameters { slab_mm, ..good }).is_err());
        }
    }
}
