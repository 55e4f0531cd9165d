//! The exact renderer: every pixel's line of sight is followed to {depth = D} itself, with no mesh and no interpolation between pixels.
//!
//! A coarse z-buffer of the shell's voxels ([`crate::seeds`]) says where a line of sight begins; from there it is followed by
//! sphere tracing ([`march`]).

mod march;

use crate::isosurface::Isosurface;
use crate::rays::Rays;
use crate::seeds::{Lattice, Seeds};
use crate::surface::{self, PointRow, Surface, Wanted, working_rays};
use crate::{Frame, Hits, Projection, RenderRequest, Scene};
use march::first_hit;

/// Draws the isosurface {depth = D} exactly; pixels are as those of [`crate::draw_splat`].
pub fn draw_trace(scene: &Scene<'_>, request: &RenderRequest) -> Frame {
    let projection = request.projection(scene);
    surface::draw(
        &Traced::new(scene, request, &projection),
        scene,
        request,
        &projection,
    )
}

/// As [`draw_trace`], but given up, with `None`, soon after it is no longer wanted.
pub fn draw_trace_while(
    scene: &Scene<'_>,
    request: &RenderRequest,
    is_wanted: &Wanted<'_>,
) -> Option<Frame> {
    let surface = Traced::new(scene, request, &request.projection(scene));
    surface::draw_while(&surface, scene, request, is_wanted)
}

/// Finds what each pixel of [`draw_trace`] shows, without drawing it: points within 0.01 voxel of depth of the isosurface.
///
/// Within 5 voxels of the envelope that is the isosurface without the terraces of the envelope's voxels, at most about a voxel off the raw one.
pub fn trace_hits(scene: &Scene<'_>, request: &RenderRequest) -> Hits {
    let projection = request.projection(scene);
    surface::hits(
        &Traced::new(scene, request, &projection),
        scene,
        &projection,
    )
}

/// The isosurface along the lines of sight of a picture.
#[derive(Debug)]
struct Traced<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    lattice: Lattice,
    /// For each cell of the lattice where its lines of sight begin; −∞ where they meet nothing.
    starts: Vec<f32>,
    /// And where they have passed everything.
    ends: Vec<f32>,
}

impl<'a> Traced<'a> {
    fn new(scene: &Scene<'a>, request: &RenderRequest, projection: &Projection) -> Self {
        let seeds = Seeds::new(scene, request, projection);
        Self {
            isosurface: Isosurface::new(scene.field, scene.normals, request.parameters().depth_mm),
            rays: working_rays(scene, projection),
            lattice: seeds.lattice,
            starts: seeds.starts_in_cells(),
            ends: seeds.ends_in_cells(),
        }
    }
}

impl Surface for Traced<'_> {
    fn find_row(&self, row: usize, points: &mut PointRow) {
        let (top, _) = self.lattice.place(row);
        let starts = &self.starts[top * self.lattice.columns..][..self.lattice.columns];
        let ends = &self.ends[top * self.lattice.columns..][..self.lattice.columns];
        for column in 0..points.heights.len() {
            let (cell, _) = self.lattice.place(column);
            let start = starts[cell];
            if start > f32::NEG_INFINITY {
                let ray = self.rays.through(column as f32 + 0.5, row as f32 + 0.5);
                if let Some(height) = first_hit(&self.isosurface, &ray, start, ends[cell]) {
                    points.set(column, self.isosurface.point(&ray, height));
                }
            }
        }
    }
}
