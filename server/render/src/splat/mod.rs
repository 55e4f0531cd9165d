//! The voxel-splat renderer: the shell's voxels into a coarse z-buffer, then every pixel onto the isosurface.
//!
//! 1. [`crate::seeds`]: the voxels of the shell [D, D + δ), found by binary search, are projected into a z-buffer whose
//!    cells are about as large as a voxel (section 3.3 of the paper).
//! 2. [`nodes`]: at each cell's corner the line of sight is followed from there to the isosurface, and the normal is
//!    taken.
//! 3. [`pixels`]: a pixel lies on the surface between its four nodes. Where that is slanted, it steps onto the
//!    isosurface; where the nodes disagree (at an edge), its own line of sight is followed.

mod follow;
mod nodes;
mod pixels;

use crate::isosurface::Isosurface;
use crate::seeds::Seeds;
use crate::surface::{self, Wanted, bottom, working_rays};
use crate::{Frame, Hits, Projection, RenderRequest, Scene};
use nodes::Nodes;
use pixels::Pixels;

/// Draws the isosurface {depth = D}: a byte per pixel for grey colour maps (two with a transparent background),
/// otherwise three (four).
///
/// A pixel beside the isosurface, or at a point of it outside the volume, is background; one at its edge is mixed with the
/// background by the share that the isosurface covers.
///
/// `None` soon after the picture is no longer wanted.
pub fn draw_splat(
    scene: &Scene<'_>,
    request: &RenderRequest,
    is_wanted: &Wanted<'_>,
) -> Option<Frame> {
    let projection = request.projection(scene);
    let surface = pixels(scene, request, &projection);
    surface::draw(&surface, scene, request, &projection, is_wanted)
}

/// Finds what each pixel of [`draw_splat`] shows, without drawing it: points at most 1 voxel off the isosurface.
///
/// From a depth of 5 voxels on most are within 0.1 voxel; within 3 voxels of the envelope they lie on the smoothed
/// isosurface.
pub fn splat_hits(scene: &Scene<'_>, request: &RenderRequest) -> Hits {
    let projection = request.projection(scene);
    surface::hits(
        &pixels(scene, request, &projection),
        scene,
        request,
        &projection,
    )
}

/// What the picture's pixels can see.
fn pixels<'a>(scene: &Scene<'a>, request: &RenderRequest, projection: &Projection) -> Pixels<'a> {
    let depth_mm = request.parameters().depth_mm;
    let isosurface = Isosurface::new(scene.field, scene.normals, depth_mm);
    let rays = working_rays(scene, projection);
    let seeds = Seeds::new(scene, request, projection);
    let nodes = Nodes::new(&isosurface, &rays, &seeds);
    let width = projection.size().width() as usize;
    Pixels::new(isosurface, rays, nodes, width, bottom(scene))
}
