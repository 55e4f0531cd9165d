//! The isosurface on a disc of the flat map: each line of sight comes from outside and ends at the centre of the hemisphere.

use super::find_along;
use super::march::Sight;
use crate::isosurface::Isosurface;
use crate::points::PointRow;
use crate::rays::Rays;
use crate::silhouette::Silhouette;
use crate::surface::{Surface, voxel_mm, working_rays};
use crate::{MapProjection, RenderRequest, Scene};

/// How far beyond the sphere around the envelope a line of sight is begun, in voxels.
const OUTSIDE: f64 = 2.0;

/// How far inside the outermost voxel centres a line of sight is begun, in voxels.
const FACE: f32 = 1.0 / 512.0;

/// The isosurface along the lines of sight of a disc.
#[derive(Debug)]
pub(super) struct Mapped<'a> {
    isosurface: Isosurface<'a>,
    rays: Rays,
    projection: MapProjection,
    /// The sphere around the envelope, in voxels from the centre of the hemisphere.
    sphere_centre: [f32; 3],
    sphere_radius: f32,
    /// How far the faces of the grid are from the centre of the hemisphere along each axis, before and behind it, in voxels.
    faces: [[f32; 2]; 3],
}

impl<'a> Mapped<'a> {
    pub(super) fn new(
        scene: &Scene<'a>,
        request: &RenderRequest,
        projection: &MapProjection,
    ) -> Self {
        let bounds = scene.bounds;
        let voxel_mm = voxel_mm(scene);
        let sphere_centre = bounds.centre_in_patient - projection.centre_in_patient();
        let rays = working_rays(scene, projection);
        let centre = rays.through(0.0, 0.0).at(0.0);
        let size = scene.field.grid().size();
        let faces = [0, 1, 2].map(|axis| {
            let last = (size[axis] - 1) as f32;
            [FACE - centre[axis], last - FACE - centre[axis]]
        });
        Self {
            isosurface: Isosurface::new(scene.field, scene.normals, request.parameters().depth_mm),
            rays,
            faces,
            projection: *projection,
            sphere_centre: (sphere_centre / voxel_mm).as_vec3().to_array(),
            sphere_radius: (bounds.radius_mm / voxel_mm + OUTSIDE) as f32,
        }
    }

    /// The height at which a line of sight enters the sphere around the envelope and the grid.
    fn start(&self, towards_viewer: [f32; 3]) -> f32 {
        let faces = self.faces.iter().zip(towards_viewer);
        let grid = faces.fold(f32::INFINITY, |least, (&[before, behind], along)| {
            let face = if along > 0.0 { behind } else { before };
            least.min(if along == 0.0 { least } else { face / along })
        });
        let [x, y, z] = self.sphere_centre;
        let along = x * towards_viewer[0] + y * towards_viewer[1] + z * towards_viewer[2];
        let aside_squared = x * x + y * y + z * z - along * along;
        let half_squared = self.sphere_radius * self.sphere_radius - aside_squared;
        grid.min(along + half_squared.max(0.0).sqrt())
    }
}

impl Surface for Mapped<'_> {
    fn find_rows(&self, first: usize, rows: &mut [PointRow]) {
        let mut sights = Vec::new();
        for (row, points) in rows.iter_mut().enumerate() {
            points.coverage = self.projection.coverage(first + row).collect();
            let covered = points.coverage.iter().enumerate();
            for (column, _) in covered.filter(|&(_, &share)| share > 0.0) {
                let place = [column, first + row].map(|place| place as f32 + 0.5);
                let ray = self.rays.through(place[0], place[1]);
                sights.push(Sight {
                    pixel: [column as u32, (first + row) as u32],
                    start: self.start(ray.towards_viewer()),
                    end: 0.0,
                });
            }
        }
        find_along(&self.isosurface, &self.rays, &sights, first, rows);
    }

    /// None: a disc is full of surface, and its edge is known without searching.
    fn silhouette(&self) -> Option<Silhouette<'_>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use geometry::{DeformableModel, Grid, phantom};
    use glam::DVec3;

    use crate::{
        Camera, Frame, FrameSize, Hemisphere, MAP_MARGIN, MapDisc, MapSides, RenderParameters,
        RenderRequest, Scene, Window, draw_trace, trace_hits,
    };

    /// A model about the origin on a grid of 1.25 mm whose middle is there.
    fn model(
        is_inside: impl Fn(DVec3) -> bool + Sync,
        intensity: impl Fn(DVec3) -> u16,
    ) -> DeformableModel {
        let size = [64, 72, 56];
        let corner = -0.5 * 1.25 * DVec3::from_array(size.map(|side| f64::from(side) - 1.0));
        let grid = Grid::aligned(size.map(|side| side as usize), [1.25; 3], corner).unwrap();
        let envelope = phantom::envelope(&grid, is_inside);
        phantom::model(phantom::volume(grid, intensity), envelope).model
    }

    /// The discs of a map with the plane x = 0 between the hemispheres, each about the centroid of its side.
    fn discs(model: &DeformableModel, sides: MapSides) -> Vec<MapDisc> {
        let centre_of = |hemisphere: Hemisphere| {
            let is_part = |position: DVec3| hemisphere.has(position.x);
            model.shell().centroid(is_part)
        };
        MapDisc::of_map(&Hemisphere::ALL, sides, DVec3::X, centre_of).unwrap()
    }

    fn request(disc: MapDisc, depth_mm: f64, size: [u32; 2]) -> RenderRequest {
        let parameters = RenderParameters {
            depth_mm,
            camera: Camera::new([0.0, 0.0, 0.0, 1.0], 1.0, [0.0; 2]).unwrap(),
            map: Some(disc),
            size: FrameSize::new(size[0], size[1]).unwrap(),
            ..RenderParameters::new(Window::new(500.0, 1000.0).unwrap())
        };
        RenderRequest::new(parameters).unwrap()
    }

    fn draw(model: &DeformableModel, depth_mm: f64, sides: MapSides, size: [u32; 2]) -> Frame {
        let scene = Scene::from(model);
        let discs = discs(model, sides).into_iter();
        let frames =
            discs.map(|disc| draw_trace(&scene, &request(disc, depth_mm, size), &|| true).unwrap());
        frames.reduce(|all, one| all.joined(&one)).unwrap()
    }

    /// Numbers of 0 to 1 that look random.
    fn numbers(seed: u64) -> impl Iterator<Item = f64> {
        let mut state = seed;
        std::iter::repeat_with(move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005);
            state = state.wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        })
    }

    #[test]
    fn a_thousand_caps_of_a_ball_have_their_areas() {
        let model = model(|position| position.length() <= 33.0, |_| 500);
        let mut disc = discs(&model, MapSides::Outer)[0];
        disc.centre_in_patient = DVec3::ZERO;
        let request = request(disc, 4.0, [1024, 512]);
        let projection = request.map_projection().unwrap();
        let hits = trace_hits(&Scene::from(&model), &request);
        let positions = hits.positions_in_patient();
        let directions: Vec<DVec3> = positions
            .iter()
            .map(|&position| DVec3::from(position.map(f64::from)).normalize())
            .collect();
        let [x, y] = projection.centre();
        let reach = MAP_MARGIN * projection.pixels_per_unit();
        let mut worst: f64 = 0.0;
        let mut numbers = numbers(7);
        let mut next = || numbers.next().unwrap();
        for _ in 0..1000 {
            let angle = (10.0 + 10.0 * next()).to_radians();
            // As a whole within the margin.
            let from_axis = (1.0 - next() * (1.0 - (115_f64.to_radians() - angle).cos())).acos();
            let around = TAU * next();
            let axis = DVec3::new(
                from_axis.cos(),
                from_axis.sin() * around.cos(),
                from_axis.sin() * around.sin(),
            );
            let pixels = (0..512).flat_map(|row| (0..512).map(move |column| [column, row]));
            let near = pixels.filter(|&[column, row]| {
                (f64::from(column) - x).abs() <= reach && (f64::from(row) - y).abs() <= reach
            });
            let inside = near.filter(|&[column, row]| {
                let direction = directions[(row * 1024 + column) as usize];
                direction.dot(axis) > angle.cos()
            });
            let per_pixel = projection.pixels_per_unit().powi(-2);
            let area = inside.count() as f64 * per_pixel;
            let expected = 2.0 * PI * (1.0 - angle.cos());
            worst = worst.max((area / expected - 1.0).abs());
        }
        assert!(worst < 0.01, "{worst}");
    }

    #[test]
    fn a_pixel_comes_back_from_the_position_that_it_shows() {
        let model = lumpy();
        for disc in discs(&model, MapSides::Both) {
            for depth_mm in [0.0, 6.0] {
                let request = request(disc, depth_mm, [300, 300]);
                let projection = request.map_projection().unwrap();
                let hits = trace_hits(&Scene::from(&model), &request);
                let mut seen = 0;
                for (x, y) in (0..300).flat_map(|y| (0..300).map(move |x| (x, y))) {
                    let Some(position) = hits.position_in_patient(x, y) else {
                        continue;
                    };
                    let place = projection.place_of(position).unwrap();
                    let off = (place[0] - f64::from(x) - 0.5).hypot(place[1] - f64::from(y) - 0.5);
                    assert!(off < 0.05, "{off} at {x}, {y}");
                    let depth = model.field();
                    let voxel = depth.grid().voxel_from_patient().transform_point3(position);
                    let off_mm = f64::from(depth.depth_mm(voxel.as_vec3())) - depth_mm;
                    assert!(off_mm.abs() < 1.5, "{off_mm} mm at {x}, {y}");
                    seen += 1;
                }
                assert!(seen > 15_000, "{seen}");
            }
        }
    }

    /// A head with folds, which differ from side to side.
    fn lumpy() -> DeformableModel {
        model(lumpy_shape, lumpy_intensity)
    }

    fn lumpy_shape(position: DVec3) -> bool {
        let [x, y, z] = position.to_array();
        let waves = (0.31 * x + 0.7).sin() + (0.27 * y).sin() + (0.35 * z + 0.2 * x).sin();
        (position / DVec3::new(33.0, 38.0, 29.0)).length() + 0.04 * waves <= 1.0
    }

    fn lumpy_intensity(position: DVec3) -> u16 {
        let [x, y, z] = position.to_array();
        let waves = (0.5 * x).sin() + (0.41 * y + 0.3).sin() + (0.6 * z + 0.1 * x).sin();
        (500.0 + 160.0 * waves + 4.0 * x) as u16
    }

    #[test]
    fn a_mirrored_head_gives_the_mirrored_picture() {
        let mirrored = |position: DVec3| DVec3::new(-position.x, position.y, position.z);
        let [head, twin] = [
            lumpy(),
            model(
                |position| lumpy_shape(mirrored(position)),
                |position| lumpy_intensity(mirrored(position)),
            ),
        ];
        for depth_mm in [0.0, 7.5, 14.0] {
            let size = [400, 400];
            let [picture, other] =
                [&head, &twin].map(|model| draw(model, depth_mm, MapSides::Both, size));
            let rows = other.bytes().chunks_exact(400);
            let flipped: Vec<u8> = rows.flat_map(|row| row.iter().rev().copied()).collect();
            assert!(picture.bytes() == flipped, "at {depth_mm} mm");
            assert_ne!(picture, other, "the head is not symmetric");
        }
    }

    #[test]
    fn what_lies_on_the_left_is_on_the_left_disc_and_anterior_outwards() {
        // Bright in the left anterior superior octant alone.
        let is_bright = |p: DVec3| p.x > 0.0 && p.y < 0.0 && p.z > 0.0;
        let model = model(
            |position| position.length() <= 33.0,
            |position| if is_bright(position) { 1000 } else { 0 },
        );
        let frame = draw(&model, 5.0, MapSides::Outer, [512, 256]);
        let bright: Vec<[u32; 2]> = (0..256_u32)
            .flat_map(|y| (0..512_u32).map(move |x| [x, y]))
            .filter(|&[x, y]| frame.pixel(x, y).unwrap()[0] > 150)
            .collect();
        assert!(bright.len() > 4000, "{}", bright.len());
        // The upper outer quarter of the disc at the left.
        let misplaced = bright.iter().filter(|&&[x, y]| x > 130 || y > 130).count();
        assert!(misplaced == 0, "{misplaced} of {}", bright.len());
    }
}
