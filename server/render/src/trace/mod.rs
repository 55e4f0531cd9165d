//! The exact renderer: every pixel's line of sight is followed to {depth = D} itself, with no mesh and no interpolation
//! between pixels.
//!
//! A coarse z-buffer of the shell's voxels ([`crate::seeds`]) gives the start of each line of sight; from there, many
//! are followed at once by sphere tracing ([`march`]).

mod map;
mod march;

use std::ops::Range;

use crate::isosurface::Isosurface;
use crate::points::PointRow;
use crate::rays::{Rays, View};
use crate::seeds::{Lattice, Seeds};
use crate::silhouette::Silhouette;
use crate::surface::{self, Surface, Wanted, bottom, working_rays};
use crate::{Frame, Hits, Projection, RenderRequest, Scene};
use map::Mapped;
use march::{Sight, first_hits};

/// Draws the isosurface {depth = D} exactly; pixels have the formats and soft edges of [`crate::draw_splat`]. The only renderer of
/// the flat map.
///
/// `None` soon after the picture is no longer wanted.
pub fn draw_trace(
    scene: &Scene<'_>,
    request: &RenderRequest,
    is_wanted: &Wanted<'_>,
) -> Option<Frame> {
    let (surface, view) = seen(scene, request);
    surface::draw(&*surface, scene, request, view, is_wanted)
}

/// Finds what each pixel of [`draw_trace`] shows, without drawing it: points within 0.01 voxel of depth of the
/// isosurface.
///
/// Within 5 voxels of the envelope that is the isosurface without the terraces of the envelope's voxels, at most about
/// a voxel off the raw one.
pub fn trace_hits(scene: &Scene<'_>, request: &RenderRequest) -> Hits {
    let (surface, view) = seen(scene, request);
    surface::hits(&*surface, scene, request, view)
}

/// What the picture's pixels can see, and from where.
fn seen<'a>(scene: &Scene<'a>, request: &RenderRequest) -> (Box<dyn Surface + 'a>, View) {
    let view = request.view(scene);
    let surface: Box<dyn Surface + 'a> = match &view {
        View::Parallel(projection) => Box::new(Traced::new(scene, request, projection)),
        View::Map(projection) => Box::new(Mapped::new(scene, request, projection)),
    };
    (surface, view)
}

/// The isosurface along the lines of sight of a picture.
#[derive(Debug)]
struct Traced<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    lattice: Lattice,
    /// The column of the lattice's cells that each column of pixels lies in.
    cells: Vec<usize>,
    /// The start of the lines of sight in each cell of the lattice; −∞ if they meet nothing.
    starts: Vec<f32>,
    /// The height below which they meet nothing.
    ends: Vec<f32>,
    bottom: f32,
}

impl<'a> Traced<'a> {
    fn new(scene: &Scene<'a>, request: &RenderRequest, projection: &Projection) -> Self {
        let seeds = Seeds::new(scene, request, projection);
        let columns = 0..projection.size().width() as usize;
        Self {
            isosurface: Isosurface::new(scene.field, scene.normals, request.parameters().depth_mm),
            rays: working_rays(scene, projection),
            lattice: seeds.lattice,
            cells: columns
                .map(|column| seeds.lattice.place(column).0)
                .collect(),
            starts: seeds.starts_in_cells(),
            ends: seeds.ends_in_cells(),
            bottom: bottom(scene),
        }
    }

    /// The lines of sight of some rows of pixels that may meet something.
    fn sights(&self, rows: Range<usize>) -> Vec<Sight> {
        let columns = self.lattice.columns;
        let mut sights = Vec::with_capacity(rows.len() * self.cells.len());
        for row in rows {
            let (top, _) = self.lattice.place(row);
            let starts = &self.starts[top * columns..][..columns];
            let ends = &self.ends[top * columns..][..columns];
            for (column, &cell) in self.cells.iter().enumerate() {
                if starts[cell] > f32::NEG_INFINITY {
                    sights.push(Sight {
                        pixel: [column as u32, row as u32],
                        start: starts[cell],
                        end: ends[cell],
                    });
                }
            }
        }
        sights
    }
}

/// Finds the isosurface along lines of sight of some rows of pixels, the first of which has this number.
fn find_along(
    isosurface: &Isosurface<'_>,
    rays: &Rays,
    sights: &[Sight],
    first: usize,
    rows: &mut [PointRow],
) {
    let mut hits = vec![f32::NEG_INFINITY; sights.len()];
    first_hits(isosurface, rays, sights, &mut hits);
    for (sight, height) in sights.iter().zip(hits) {
        let [column, row] = sight.pixel.map(|place| place as usize);
        rows[row - first].heights[column] = height;
    }
    for (row, points) in rows.iter_mut().enumerate() {
        isosurface.face(rays, first + row, points);
    }
}

impl Surface for Traced<'_> {
    fn find_rows(&self, first: usize, rows: &mut [PointRow]) {
        let sights = self.sights(first..first + rows.len());
        find_along(&self.isosurface, &self.rays, &sights, first, rows);
    }

    fn silhouette(&self) -> Option<Silhouette<'_>> {
        Some(Silhouette::new(&self.isosurface, &self.rays, self.bottom))
    }
}
