//! The mesh renderer on the CPU: the facets of a shrunk mesh, each pixel shaded at its point of the facet.
//!
//! 1. [`triangle`]: the corners go to fixed-point pixels, the facets become edges and planes.
//! 2. [`raster`]: band by band of the picture, the nearest facet at four samples a pixel.
//! 3. Here: a pixel shows the mean of its samples on the nearest piece of the surface, and missing samples make its
//!    edge soft. The graphics devices do the same (`shaders/resolve.wgsl`).

mod facets;
mod raster;
mod triangle;

use crate::isosurface::Isosurface;
use crate::points::PointRow;
use crate::rays::Rays;
use crate::settle::settled;
use crate::silhouette::Silhouette;
use crate::surface::{self, Surface, working_rays};
use crate::{Frame, Hits, Projection, RenderRequest, Scene, Wanted};
use raster::Heights;
use triangle::{Samples, Triangles};

pub use facets::Facets;

/// How far the samples of a pixel may be apart, in pixels, to be of one piece of the surface: a face seen at a steep
/// angle.
const PIECE_PIXELS: f64 = 8.0;

/// Draws the facets of a mesh in the formats of [`crate::draw_splat`], with soft edges.
///
/// Each pixel's intensity, direction and light are those of its own point of the facet. A pixel that a facet covers in
/// part is mixed with the background in quarters.
///
/// `None` soon after the picture is no longer wanted.
pub fn draw_mesh(
    scene: &Scene<'_>,
    request: &RenderRequest,
    facets: Facets<'_>,
    is_wanted: &Wanted<'_>,
) -> Option<Frame> {
    let projection = request.projection(scene);
    let drawn = DrawnMesh::new(scene, request, facets, Samples::FOUR);
    surface::draw(&drawn, scene, request, &projection, is_wanted)
}

/// Finds what the centre of each pixel of [`draw_mesh`] shows, without drawing it: points on the facets.
pub fn mesh_hits(scene: &Scene<'_>, request: &RenderRequest, facets: Facets<'_>) -> Hits {
    let projection = request.projection(scene);
    let drawn = DrawnMesh::new(scene, request, facets, Samples::ONE);
    surface::hits(&drawn, scene, request, &projection)
}

/// A mesh prepared for the pixels of a picture.
#[derive(Debug)]
struct DrawnMesh<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    triangles: Triangles,
    /// How far apart the heights of one piece of the surface are within a pixel, in voxels.
    piece: f32,
}

impl<'a> DrawnMesh<'a> {
    fn new(
        scene: &Scene<'a>,
        request: &RenderRequest,
        facets: Facets<'_>,
        samples: Samples,
    ) -> Self {
        let projection: Projection = request.projection(scene);
        let voxel_mm = scene.field.grid().spacing_mm()[0];
        let mesh = settled(facets.mesh, scene);
        let facets = Facets {
            mesh: &mesh,
            ..facets
        };
        Self {
            isosurface: Isosurface::new(scene.field, scene.normals, request.parameters().depth_mm),
            rays: working_rays(scene, &projection),
            triangles: Triangles::new(&projection, voxel_mm, facets, samples),
            piece: (PIECE_PIXELS * projection.mm_per_pixel() / voxel_mm) as f32,
        }
    }
}

impl Surface for DrawnMesh<'_> {
    fn find_rows(&self, first: usize, rows: &mut [PointRow]) {
        let width = rows.first().map_or(0, |row| row.heights.len());
        let heights = Heights::of(&self.triangles, first..first + rows.len(), width);
        for (row, points) in rows.iter_mut().enumerate() {
            heights.resolve(row, self.piece, points);
            self.isosurface.face(&self.rays, first + row, points);
        }
    }

    fn silhouette(&self) -> Option<Silhouette<'_>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use geometry::{BuiltModel, Grid, MeshSize, PathTable, Paths, phantom};
    use glam::DVec3;

    use super::*;
    use crate::{Background, Camera, FrameSize, Look, RenderParameters, Window};

    /// An even ellipsoid of half axes 30, 38 and 26 mm.
    fn ellipsoid() -> BuiltModel {
        let brain = phantom::ellipsoid([24.0, 30.4, 20.8], 1.25);
        let envelope = geometry::envelope(&brain, 0.0).unwrap();
        let grid = Grid::aligned([45; 3], [2.0; 3], DVec3::splat(-44.0)).unwrap();
        phantom::model(phantom::volume(grid, |_| 200), envelope)
    }

    fn table(built: &BuiltModel, [contours, points]: [usize; 2]) -> PathTable {
        let size = MeshSize::new(contours, points).unwrap();
        let table = built.model.path_table(size, &built.distance, Paths::Flow);
        table.unwrap()
    }

    #[test]
    fn edges_are_soft_in_the_color_of_the_face() {
        let case = ellipsoid();
        let table = table(&case, [30, 30]);
        let mesh = table.shrink(4.0);
        let parameters = RenderParameters {
            depth_mm: 4.0,
            size: FrameSize::new(96, 96).unwrap(),
            look: Look {
                ambient: 1.0,
                ..Look::default()
            },
            ..RenderParameters::new(Window::between(0.0, 255.0))
        };
        let draw = |background| {
            let request = RenderRequest::new(RenderParameters {
                look: Look {
                    background,
                    ..parameters.look
                },
                ..parameters
            });
            draw_mesh(
                &Scene::from(&case.model),
                &request.unwrap(),
                Facets::new(table.size, &mesh),
                &|| true,
            )
            .unwrap()
        };
        let [opaque, clear] = [Background::Black, Background::Transparent].map(draw);
        let mut shares = [0; 5];
        for (level, pixel) in opaque.bytes().iter().zip(clear.bytes().chunks_exact(2)) {
            let quarters = (usize::from(pixel[1]) + 32) / 64;
            shares[quarters] += 1;
            assert_eq!(usize::from(*level), 50 * quarters, "on black");
            assert_eq!(pixel[0], if quarters > 0 { 200 } else { 0 }, "on nothing");
        }
        assert!(shares.iter().all(|&count| count > 10), "{shares:?}");
    }

    /// The greatest height in mm at which a line of sight meets a facet, by each facet's own coordinates; and whether
    /// it passes an edge of one so near that rounding decides.
    fn plainly(triangles: &[[DVec3; 3]], x: f64, y: f64) -> (f64, bool) {
        let mut nearest = f64::NEG_INFINITY;
        let mut is_unsure = false;
        for [a, b, c] in triangles {
            let cross = |u: DVec3, v: DVec3| u.x * v.y - u.y * v.x;
            let at = DVec3::new(x, y, 0.0);
            let area = cross(*b - *a, *c - *a);
            if area.abs() < 1e-3 {
                continue;
            }
            let shares = [(b, c), (c, a), (a, b)].map(|(u, v)| cross(*u - at, *v - at) / area);
            let least = shares.into_iter().fold(f64::INFINITY, f64::min);
            is_unsure |= least.abs() * area.abs().sqrt() < 0.02;
            if least >= 0.0 {
                nearest = nearest.max(shares[0] * a.z + shares[1] * b.z + shares[2] * c.z);
            }
        }
        (nearest, is_unsure)
    }

    #[test]
    fn each_pixel_shows_the_nearest_facet() {
        let case = ellipsoid();
        let table = table(&case, [14, 12]);
        let scene = Scene::from(&case.model);
        for (orientation, zoom, depth_mm) in [
            ([0.0, 0.0, 0.0, 1.0], 1.0, 0.0),
            ([0.3, -0.5, 0.1, 0.8], 1.7, 5.0),
            ([0.7, 0.2, -0.6, 0.3], 0.4, 11.0),
        ] {
            let request = RenderRequest::new(RenderParameters {
                depth_mm,
                camera: Camera::new(orientation, zoom, [3.0, -2.0]).unwrap(),
                size: FrameSize::new(61, 47).unwrap(),
                ..RenderParameters::new(Window::between(0.0, 255.0))
            })
            .unwrap();
            let mesh = table.shrink(depth_mm as f32);
            let drawn = settled(&mesh, &scene);
            let projection = request.projection(&scene);
            let corners: Vec<DVec3> = drawn
                .positions_in_patient
                .iter()
                .map(|position| {
                    let position = DVec3::from(position.map(f64::from));
                    projection.frame_from_patient().transform_point3(position)
                })
                .collect();
            let triangles: Vec<_> = table
                .size
                .triangles()
                .into_iter()
                .map(|triangle| triangle.map(|index| corners[index as usize]))
                .collect();
            let hits = mesh_hits(&scene, &request, Facets::new(table.size, &mesh));
            let mut counts = [0; 2];
            for index in 0..61 * 47 {
                let [x, y] = [index % 61, index / 61];
                let (expected, is_unsure) =
                    plainly(&triangles, f64::from(x) + 0.5, f64::from(y) + 0.5);
                if is_unsure {
                    continue;
                }
                let found = hits
                    .position_in_patient(x, y)
                    .map_or(f64::NEG_INFINITY, |at| {
                        projection.frame_from_patient().transform_point3(at).z
                    });
                let what = format!("({x}, {y}) at {depth_mm} mm: {found} for {expected}");
                assert!(
                    found == expected || (found - expected).abs() < 0.2,
                    "{what}"
                );
                counts[usize::from(expected.is_finite())] += 1;
            }
            assert!(counts.iter().all(|&count| count > 30), "{counts:?}");
        }
    }

    #[test]
    #[should_panic(expected = "vertices")]
    fn a_mesh_of_another_size_is_refused() {
        let mesh = table(&ellipsoid(), [10, 10]).shrink(1.0);
        let _ = Facets::new(MeshSize::STANDARD, &mesh);
    }
}
