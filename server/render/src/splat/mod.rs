//! The voxel-splat renderer.

use crate::{Frame, Hits, RenderRequest, Scene};

/// Draws the isosurface {depth = D}.
pub fn draw_splat(scene: &Scene<'_>, request: &RenderRequest) -> Frame {
    let _ = (scene, request);
    todo!()
}

/// Finds what each pixel of [`draw_splat`] shows, without drawing it.
pub fn splat_hits(scene: &Scene<'_>, request: &RenderRequest) -> Hits {
    let _ = (scene, request);
    todo!()
}
