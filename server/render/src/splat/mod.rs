//! The voxel-splat renderer: the shell's voxels into a coarse z-buffer, then every pixel onto the isosurface.
//!
//! 1. [`seeds`]: the voxels of the shell [D, D + δ), found by binary search, are projected into a z-buffer whose
//!    cells are about as large as a voxel (the paper's section 3.3).
//! 2. [`nodes`]: at each cell the line of sight is followed from there to the isosurface, and the normal is taken.
//! 3. [`pixels`]: each pixel starts from the height between its four nodes and steps onto the isosurface; where the
//!    nodes disagree (at an edge), its own line of sight is followed.

mod nodes;
mod pixels;
mod seeds;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use crate::isosurface::Isosurface;
use crate::rays::Rays;
use crate::shade::Shade;
use crate::{Frame, Hits, RenderRequest, Scene};
pub(crate) use pixels::Surface;

/// Thickness of the shell in voxels: the eight voxels around a point of the isosurface have depths no further apart.
const SHELL_THICKNESS: f64 = 2.0;

/// Rows that a thread takes at once.
const BAND: usize = 16;

/// Draws the isosurface {depth = D}: on grey maps a byte a pixel (two with a transparent background), else three (four).
///
/// A pixel that shows no tissue (beside the isosurface, or where it lies outside of the volume) is background.
pub fn draw_splat(scene: &Scene<'_>, request: &RenderRequest) -> Frame {
    let surface = surface(scene, request);
    let projection = request
        .parameters()
        .camera
        .projection(&scene.bounds, request.parameters().size);
    let shade = Shade::new(scene.volume, &projection, request, voxel_mm(scene));
    let size = projection.size();
    let row_bytes = size.width() as usize * shade.format().bytes_per_pixel();
    let mut bytes = vec![0; row_bytes * size.height() as usize];
    bytes
        .par_chunks_mut(row_bytes * BAND)
        .enumerate()
        .for_each(|(band, rows)| {
            for (row, pixels) in rows.chunks_exact_mut(row_bytes).enumerate() {
                shade.row(&surface, band * BAND + row, pixels);
            }
        });
    Frame::new(size, shade.format(), bytes)
}

/// Finds what each pixel of [`draw_splat`] shows, without drawing it: points at most 0.1 voxel off the
/// isosurface, and at most 1 voxel within 4 voxels of the envelope, whose terraces are smoothed away.
pub fn splat_hits(scene: &Scene<'_>, request: &RenderRequest) -> Hits {
    let surface = surface(scene, request);
    let projection = request
        .parameters()
        .camera
        .projection(&scene.bounds, request.parameters().size);
    let voxel_mm = voxel_mm(scene) as f32;
    let width = projection.size().width() as usize;
    let mut heights_mm = vec![f32::NEG_INFINITY; projection.size().pixel_count()];
    heights_mm
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, heights)| {
            surface.row(row, width, |column, point| {
                heights[column] = point.height * voxel_mm;
            });
        });
    Hits::new(projection, heights_mm)
}

/// What the picture's pixels can see.
fn surface<'a>(scene: &Scene<'a>, request: &RenderRequest) -> Surface<'a> {
    let parameters = request.parameters();
    let projection = parameters.camera.projection(&scene.bounds, parameters.size);
    let voxel_mm = voxel_mm(scene);
    let shell = scene.shell.shell(
        parameters.depth_mm as f32,
        (SHELL_THICKNESS * voxel_mm) as f32,
    );
    let isosurface = Isosurface::new(scene.field, scene.normals, parameters.depth_mm);
    let rays = Rays::new(&projection, scene.field.grid(), voxel_mm);
    let lowest = -(scene.bounds.radius_mm / voxel_mm) as f32 - 2.0;
    let seeds = seeds::splat(shell, scene.shell.grid(), &projection, voxel_mm);
    Surface::new(isosurface, rays, seeds, lowest)
}

/// Edge of a working voxel, in mm.
fn voxel_mm(scene: &Scene<'_>) -> f64 {
    scene.field.grid().spacing_mm()[0]
}
