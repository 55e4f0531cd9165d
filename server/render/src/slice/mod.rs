//! Slices with the contours of the isosurfaces.

use crate::{Camera, ColorMap, Frame, FrameSize, RenderError, Scene, Window};

/// The largest number of contours in a picture.
pub const MAX_CONTOURS: usize = 16;

/// Across which patient axis a slice lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SlicePlane {
    /// Seen from below: anterior up, the patient's left at the right of the picture.
    Axial,
    /// Facing the patient: superior up, the patient's left at the right of the picture.
    Coronal,
    /// Seen from the left: superior up, anterior at the left of the picture.
    Sagittal,
}

/// How a slice is to be drawn, not yet checked: see [`SliceRequest::new`].
#[derive(Debug, Clone, PartialEq)]
pub struct SliceParameters {
    /// Which way the slice lies.
    pub plane: SlicePlane,
    /// Where: its LPS coordinate in mm across the plane (S of an axial slice, P of a coronal, L of a sagittal one).
    pub position_mm: f64,
    /// Depths of the isosurfaces whose contours are drawn, each 0 to 1000 mm, at most [`MAX_CONTOURS`].
    pub depths_mm: Vec<f64>,
    /// 1 shows the slice at the scale at which a [`Camera`] of zoom 1 shows the head.
    pub zoom: f64,
    /// Moves the slice to the right of the picture and up, in mm.
    pub pan_mm: [f64; 2],
    /// Size of the picture.
    pub size: FrameSize,
    /// Which intensities are black and white.
    pub window: Window,
    /// Colours for brightness.
    pub colormap: ColorMap,
}

/// How a slice is to be drawn, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct SliceRequest {
    parameters: SliceParameters,
    camera: Camera,
}

impl SliceRequest {
    /// Checks the parameters.
    ///
    /// # Errors
    /// When a number is out of its range or not finite.
    pub fn new(parameters: SliceParameters) -> Result<Self, RenderError> {
        let _ = parameters;
        todo!()
    }

    /// The parameters, which are right.
    pub fn parameters(&self) -> &SliceParameters {
        &self.parameters
    }
}

/// Draws a slice through the native volume with the contours of the isosurfaces.
pub fn draw_slice(scene: &Scene<'_>, request: &SliceRequest) -> Frame {
    let _ = (scene, &request.camera);
    todo!()
}
