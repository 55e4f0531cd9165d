//! Pictures that answer the figures of the paper, each named by its figure.

mod distances;
mod envelope;
mod lesion;
mod meshes;
mod sheet;
mod wireframe;

use geometry::BoundingSphere;
use glam::{DQuat, DVec3};
use render::{
    Camera, Frame, FrameSize, Look, NamedView, RenderBackend, RenderParameters, RenderRequest,
    SizedMesh, Window,
};

use crate::{BenchError, PreparedHead};

/// A picture of the paper's kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// The name of its file, without extension.
    pub name: &'static str,
    /// The picture as PNG.
    pub png: Vec<u8>,
}

/// Draws the pictures for Figures 1 to 4, 7 and 8, and for the two poles. `progress` receives the name of the next one.
///
/// Figure 7 is omitted, with the reason in `progress`, if the head has no tissue scale and thus no place for a lesion.
///
/// # Errors
/// If a picture cannot be drawn or a mesh cannot be made.
pub fn pictures(head: &PreparedHead, progress: &dyn Fn(&str)) -> Result<Vec<Picture>, BenchError> {
    let mut pictures = Vec::new();
    progress("pictures: Figure 1, the envelope");
    pictures.push(envelope::figure_1(head)?);
    progress("pictures: Figure 2, its meshes");
    pictures.push(meshes::figure_2(head)?);
    progress("pictures: Figure 3, distances and paths");
    pictures.push(distances::figure_3(head)?);
    progress("pictures: Figure 4, shrunk meshes");
    pictures.push(meshes::figure_4(head)?);
    progress("pictures: Figure 7, a synthetic lesion");
    match lesion::figure_7(head) {
        Ok(lesions) => pictures.extend(lesions),
        Err(BenchError::Maps(reason)) => progress(&format!("Figure 7 is not drawn: {reason}")),
        Err(error) => return Err(error),
    }
    progress("pictures: Figure 8 and the poles");
    pictures.push(envelope::figure_8(head)?);
    pictures.push(envelope::poles(head)?);
    Ok(pictures)
}

/// A square picture of `side` pixels.
fn square(side: u32) -> Result<FrameSize, BenchError> {
    Ok(FrameSize::new(side, side)?)
}

/// A camera that looks at the left side from in front and from above.
fn oblique(zoom: f64) -> Result<Camera, BenchError> {
    let turned = NamedView::Left.orientation() * DQuat::from_rotation_z(-0.6);
    let tilted = DQuat::from_rotation_x(0.35) * turned;
    Ok(Camera::new(tilted.to_array(), zoom, [0.0; 2])?)
}

/// The same camera with a point of the patient in the middle of the picture.
fn looking_at(
    camera: Camera,
    bounds: &BoundingSphere,
    position_in_patient: DVec3,
) -> Result<Camera, BenchError> {
    let in_view = camera.orientation() * (position_in_patient - bounds.centre_in_patient);
    Ok(camera.with_pan_mm([-in_view.x, -in_view.y])?)
}

/// A picture of the plain surface at a depth, without intensities.
fn plain(
    head: &PreparedHead,
    camera: Camera,
    size: FrameSize,
    depth_mm: f64,
) -> Result<RenderRequest, BenchError> {
    let [low, _] = head.model().volume().intensity_range();
    Ok(RenderRequest::new(RenderParameters {
        depth_mm,
        camera,
        size,
        look: Look {
            ambient: 0.1,
            ..Look::default()
        },
        // All intensities are above it, so the light alone decides.
        ..RenderParameters::new(Window::between(low - 2.0, low - 1.0))
    })?)
}

fn drawn(
    head: &PreparedHead,
    backend: &RenderBackend,
    request: RenderRequest,
    mesh: Option<SizedMesh>,
) -> Result<Frame, BenchError> {
    Ok(backend.draw(&head.job(request, mesh))?.frame)
}

#[cfg(test)]
mod tests;
