//! The scene and the request for a picture.

use geometry::{BoundingSphere, DeformableModel, DepthField, ShellIndex, Volume};

use crate::error::checked;
use crate::rays::View;
use crate::{
    Camera, FrameSize, Layers, Look, MapDisc, MapProjection, NamedView, Projection, RenderError,
    Window,
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
    /// What it looks like.
    pub look: Look,
}

impl RenderParameters {
    /// The left side at depth 0, 512 × 512 pixels.
    pub fn new(window: Window) -> Self {
        Self {
            depth_mm: 0.0,
            camera: Camera::named(NamedView::Left),
            map: None,
            size: FrameSize::default(),
            window,
            look: Look::default(),
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
    /// If `depth_mm` is not in 0..=1000, or as [`Look::checked`].
    pub fn new(parameters: RenderParameters) -> Result<Self, RenderError> {
        checked(
            "depth_mm",
            parameters.depth_mm,
            0.0..=1000.0,
            "within 0 to 1000",
        )?;
        parameters.look.checked()?;
        Ok(Self(parameters))
    }

    /// The request with the nearest accepted depth, for a look that is checked already.
    pub fn at_nearest_depth(parameters: RenderParameters) -> Self {
        Self(RenderParameters {
            depth_mm: parameters.depth_mm.clamp(0.0, 1000.0),
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
    pub(crate) fn view(&self, scene: &Scene<'_>) -> View {
        match self.map_projection() {
            Some(projection) => View::Map(projection),
            None => View::Parallel(self.projection(scene)),
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
    }
}
