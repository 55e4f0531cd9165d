//! Triangles around the envelope, from contours on parallel planes.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::contour::{Contour, ContourPlanes};
use crate::{DepthField, GeometryError};

/// The number of points of a contour that are compared with its neighbour to find its start.
const MATCHED_POINTS: usize = 64;
/// The number of starts that are tried per such point.
const STARTS_PER_POINT: usize = 4;

/// The depth tolerance of the vertices of the mesh, in mm.
const SETTLED_MM: f32 = 0.01;

/// The size of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MeshSize {
    contour_count: u16,
    points_per_contour: u16,
}

impl MeshSize {
    /// The size that the paper considers of reasonable quality: 30 contours of 30 points, 1,800 triangles.
    pub const STANDARD: Self = Self {
        contour_count: 30,
        points_per_contour: 30,
    };

    /// A mesh of `contour_count` contours (the paper's N_F) of `points_per_contour` points (its N_P).
    ///
    /// # Errors
    /// If `contour_count` is not in 3..=512 or `points_per_contour` not in 3..=1024.
    pub fn new(contour_count: usize, points_per_contour: usize) -> Result<Self, GeometryError> {
        let error = |name, value: usize, range| GeometryError::Parameter {
            name,
            value: value as f64,
            range,
        };
        if !(3..=512).contains(&contour_count) {
            return Err(error("contours", contour_count, "from 3 to 512"));
        }
        if !(3..=1024).contains(&points_per_contour) {
            return Err(error("points", points_per_contour, "from 3 to 1024"));
        }
        Ok(Self {
            contour_count: contour_count as u16,
            points_per_contour: points_per_contour as u16,
        })
    }

    /// Number of contours, N_F.
    pub fn contour_count(self) -> usize {
        usize::from(self.contour_count)
    }

    /// Number of points on each contour, N_P.
    pub fn points_per_contour(self) -> usize {
        usize::from(self.points_per_contour)
    }

    /// `contour_count * points_per_contour + 2`: the points of the contours, contour by contour from the patient's
    /// right to the left (coronal ones: from the front to the back), then the centres of the first and the last cap.
    pub fn vertex_count(self) -> usize {
        self.contour_count() * self.points_per_contour() + 2
    }

    /// `2 * contour_count * points_per_contour`.
    pub fn triangle_count(self) -> usize {
        2 * self.contour_count() * self.points_per_contour()
    }

    /// The triangles of every mesh of this size, at every depth: vertex indices, counter-clockwise seen from outside.
    ///
    /// First the strips between neighbouring contours, two triangles for each pair of points, then the first cap and
    /// the last.
    pub fn triangles(self) -> Vec<[u32; 3]> {
        let (contours, points) = (
            u32::from(self.contour_count),
            u32::from(self.points_per_contour),
        );
        let [first_centre, last_centre] = [contours * points, contours * points + 1];
        let mut triangles = Vec::with_capacity(self.triangle_count());
        for contour in 0..contours - 1 {
            let (near, far) = (contour * points, (contour + 1) * points);
            for point in 0..points {
                let next = (point + 1) % points;
                triangles.push([near + point, near + next, far + point]);
                triangles.push([near + next, far + next, far + point]);
            }
        }
        let last = (contours - 1) * points;
        triangles.extend((0..points).map(|point| [(point + 1) % points, point, first_centre]));
        triangles.extend(
            (0..points).map(|point| [last + point, last + (point + 1) % points, last_centre]),
        );
        triangles
    }
}

/// The mesh of the envelope: depth 0 of every shrunk mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvelopeMesh {
    /// Its size.
    pub size: MeshSize,
    /// Vertices in voxel coordinates of the working grid, in the order of [`MeshSize::vertex_count`].
    pub positions_in_voxel: Vec<Vec3>,
}

/// [`envelope_mesh_across`] sagittal planes, as in the paper.
///
/// # Errors
/// If the envelope is too small.
pub fn envelope_mesh(field: &DepthField, size: MeshSize) -> Result<EnvelopeMesh, GeometryError> {
    envelope_mesh_across(field, size, ContourPlanes::Sagittal)
}

/// Cuts the envelope into equally spaced contours and joins their points to a closed mesh.
///
/// On each plane the largest contour of depth 0 is sampled at equal distances. The outermost planes are half a voxel
/// inside the extent of the envelope, so that the contour has an area there; the centres of the two caps are on the
/// envelope itself. Each contour, from the middle outwards, starts where its points are nearest to those of the contour
/// before, so that the strips do not twist.
///
/// Source: the paper, section 3.1, for sagittal planes.
///
/// # Errors
/// If the envelope is too small.
pub fn envelope_mesh_across(
    field: &DepthField,
    size: MeshSize,
    across: ContourPlanes,
) -> Result<EnvelopeMesh, GeometryError> {
    let (planes, contours) = planes(field, across, size.contour_count())?;
    let starts = matching_starts(&contours);
    let points = size.points_per_contour();
    let mut positions = Vec::with_capacity(size.vertex_count());
    for ((contour, &start), &along) in contours.iter().zip(&starts).zip(&planes) {
        let sampled = contour.sample(points, start);
        let on_plane = sampled
            .into_iter()
            .map(|point| across.position(along, point));
        positions.extend(on_plane.map(|point| settled(field, point)));
    }
    for (end, outward) in [(0, -1.0), (contours.len() - 1, 1.0)] {
        let centre = contours[end].centre();
        positions.push(on_envelope(
            field,
            across.position(planes[end], centre),
            across.position(outward, Vec2::ZERO),
        ));
    }
    Ok(EnvelopeMesh {
        size,
        positions_in_voxel: positions,
    })
}

/// The places of equally spaced planes, in voxels, and the contour of each: the middles of `count` slabs of one thickness.
///
/// The outer ones are half a voxel inside the extent, or more if the tip, or a layer of a flat side, is too thin for a contour.
fn planes(
    field: &DepthField,
    across: ContourPlanes,
    count: usize,
) -> Result<(Vec<f32>, Vec<Contour>), GeometryError> {
    let [first, last] = extent_along(field, across.axis()).map(|place| place as f32);
    let contour = |place| Contour::largest(field, across, place);
    let half_slab = (last - first) / (2 * count) as f32;
    for half_voxels in 1..=8 {
        let inset = half_slab.max(half_voxels as f32 / 2.0);
        let (start, end) = (first + inset, last - inset);
        let has_contour = |place| contour(place).is_some();
        if end > start && has_contour(start) && has_contour(end) {
            let step = (end - start) / (count - 1) as f32;
            let planes: Vec<f32> = (0..count).map(|i| start + step * i as f32).collect();
            let contours = planes.par_iter().map(|&place| contour(place));
            if let Some(contours) = contours.collect() {
                return Ok((planes, contours));
            }
        }
    }
    Err(GeometryError::TooSmall {
        what: "not each of so many planes has a contour; fewer contours may do",
    })
}

/// First and last place along an axis with a voxel inside.
fn extent_along(field: &DepthField, axis: usize) -> [usize; 2] {
    let size = field.grid().size();
    let mut has_inside = vec![false; size[axis]];
    for (row, depths) in field.values().chunks_exact(size[0]).enumerate() {
        let place = [0, row % size[1], row / size[1]][axis];
        if axis == 0 {
            for (has_inside, &depth) in has_inside.iter_mut().zip(depths) {
                *has_inside |= depth >= 0;
            }
        } else {
            has_inside[place] |= depths.iter().any(|&depth| depth >= 0);
        }
    }
    let first = has_inside.iter().position(|&is| is);
    let last = has_inside.iter().rposition(|&is| is);
    [first.unwrap_or_default(), last.unwrap_or_default()]
}

/// The start of each contour, as a fraction of its length.
///
/// The middle contour starts at its uppermost point, or in coronal planes at the leftmost one. Each other one starts so that the sum of squared distances between
/// its points and those of its neighbour towards the middle is least.
fn matching_starts(contours: &[Contour]) -> Vec<f32> {
    let mut starts = vec![0.0; contours.len()];
    let middle = contours.len() / 2;
    let tried = MATCHED_POINTS * STARTS_PER_POINT;
    let candidates = contours[middle].sample(tried, 0.0);
    let uppermost = (0..tried).max_by(|&a, &b| candidates[a].y.total_cmp(&candidates[b].y));
    starts[middle] = uppermost.unwrap_or_default() as f32 / tried as f32;
    for i in middle + 1..contours.len() {
        starts[i] = matching_start(
            &contours[i],
            &contours[i - 1].sample(MATCHED_POINTS, starts[i - 1]),
        );
    }
    for i in (0..middle).rev() {
        starts[i] = matching_start(
            &contours[i],
            &contours[i + 1].sample(MATCHED_POINTS, starts[i + 1]),
        );
    }
    starts
}

fn matching_start(contour: &Contour, neighbour: &[Vec2]) -> f32 {
    let tried = neighbour.len() * STARTS_PER_POINT;
    let points = contour.sample(tried, 0.0);
    let mismatch = |start: usize| -> f32 {
        let turned = (0..neighbour.len()).map(|i| points[(start + i * STARTS_PER_POINT) % tried]);
        turned
            .zip(neighbour)
            .map(|(point, &other)| point.distance_squared(other))
            .sum()
    };
    let mismatches: Vec<f32> = (0..tried).map(mismatch).collect();
    let best = (0..tried)
        .min_by(|&a, &b| mismatches[a].total_cmp(&mismatches[b]))
        .unwrap_or_default();
    best as f32 / tried as f32
}

/// A point of a contour, moved along the gradient to depth 0, because the edges of the polygon are slightly off.
fn settled(field: &DepthField, point: Vec3) -> Vec3 {
    let mut here = point;
    for _ in 0..4 {
        let depth = field.depth_mm(here);
        if depth.abs() <= SETTLED_MM {
            return here;
        }
        let gradient = field.gradient(here);
        let slope = gradient.length_squared().max(0.25) * field.spacing_mm();
        let next = here - gradient * (depth / slope);
        if field.depth_mm(next).abs() >= depth.abs() || next.distance(point) > 0.5 {
            return here;
        }
        here = next;
    }
    here
}

/// The point of depth 0 near the centre of a cap: outwards across its plane, or inwards if the contour is hollow and its centre
/// is outside.
fn on_envelope(field: &DepthField, centre: Vec3, outward: Vec3) -> Vec3 {
    let is_inside = |along: f32| field.depth_mm(centre + outward * along) >= 0.0;
    let towards = if is_inside(0.0) { 1.0 } else { -1.0 };
    let longest = field.grid().size().into_iter().max().unwrap_or_default();
    let steps = (1..4 * longest).map(|quarter| towards * quarter as f32 / 4.0);
    let Some(beyond) = steps
        .into_iter()
        .find(|&along| is_inside(along) != is_inside(0.0))
    else {
        return centre;
    };
    let (mut here, mut there) = (beyond - towards / 4.0, beyond);
    for _ in 0..20 {
        let middle = (here + there) / 2.0;
        if is_inside(middle) == is_inside(here) {
            here = middle;
        } else {
            there = middle;
        }
    }
    centre + outward * if is_inside(here) { here } else { there }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::{distance_map, envelope, phantom};

    fn mesh_of(brain: &crate::BrainMask, size: MeshSize) -> (DepthField, EnvelopeMesh) {
        let field = DepthField::new(&distance_map(&envelope(brain, 3.0).unwrap()));
        let mesh = envelope_mesh(&field, size).unwrap();
        (field, mesh)
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for (contours, points) in [(2, 30), (513, 30), (30, 2), (30, 1025), (0, 0)] {
            assert!(
                MeshSize::new(contours, points).is_err(),
                "{contours} {points}"
            );
        }
        assert_eq!(MeshSize::new(30, 30), Ok(MeshSize::STANDARD));
    }

    #[test]
    fn the_triangles_close_a_sphere() {
        for (contours, points) in [(3, 3), (8, 30), (30, 30), (7, 64)] {
            let size = MeshSize::new(contours, points).unwrap();
            let triangles = size.triangles();
            assert_eq!(triangles.len(), 2 * contours * points);
            let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
            for triangle in &triangles {
                for i in 0..3 {
                    *edges
                        .entry((triangle[i], triangle[(i + 1) % 3]))
                        .or_default() += 1;
                }
            }
            // Each edge occurs once in each direction: the mesh is closed, two-sided and consistently oriented.
            assert!(
                edges
                    .iter()
                    .all(|(&(a, b), &count)| count == 1 && edges.contains_key(&(b, a)))
            );
            let euler =
                size.vertex_count() as i64 - edges.len() as i64 / 2 + triangles.len() as i64;
            assert_eq!(euler, 2);
        }
    }

    #[test]
    fn the_meshes_of_a_ball_lie_on_it_and_face_outwards() {
        let (field, mesh) = mesh_of(&phantom::ball(25.0), MeshSize::STANDARD);
        check_ball(&field, &mesh);
        let coronal = envelope_mesh_across(&field, MeshSize::STANDARD, ContourPlanes::Coronal);
        check_ball(&field, &coronal.unwrap());
    }

    fn check_ball(field: &DepthField, mesh: &EnvelopeMesh) {
        let centre = Vec3::from_array(field.grid().size().map(|side| (side - 1) as f32 / 2.0));
        for &position in &mesh.positions_in_voxel {
            assert!(
                (23.5..=25.6).contains(&position.distance(centre)),
                "{position}"
            );
        }
        let mut volume = 0.0;
        for [a, b, c] in mesh.size.triangles() {
            let corner = |vertex: u32| mesh.positions_in_voxel[vertex as usize] - centre;
            let six_times = corner(a).dot(corner(b).cross(corner(c)));
            assert!(six_times > 0.0, "a triangle faces inwards");
            volume += six_times / 6.0;
        }
        let ball = 4.0 / 3.0 * std::f32::consts::PI * 24.5f32.powi(3);
        assert!((volume / ball - 1.0).abs() < 0.06, "{volume} {ball}");
    }

    #[test]
    fn every_vertex_is_at_depth_zero() {
        for brain in [
            phantom::ellipsoid([30.0, 22.0, 18.0], 0.8),
            phantom::two_lobes([16.0, 13.0], 24.0, 8.0),
        ] {
            for size in [(3, 3), (12, 20), (80, 50)] {
                let (field, mesh) = mesh_of(&brain, MeshSize::new(size.0, size.1).unwrap());
                for &position in &mesh.positions_in_voxel {
                    let depth = field.depth_mm(position);
                    assert!(depth.abs() <= 0.05, "{depth} at {position}");
                }
            }
        }
    }

    /// The distance between the points of neighbouring contours if one is rotated by a number of points.
    fn mismatch(mesh: &EnvelopeMesh, contour: usize, turn: usize) -> f32 {
        let points = mesh.size.points_per_contour();
        let at = |contour: usize, point: usize| {
            mesh.positions_in_voxel[contour * points + point % points]
        };
        (0..points)
            .map(|point| at(contour, point).distance_squared(at(contour + 1, point + turn)))
            .sum()
    }

    #[test]
    fn strips_do_not_twist() {
        for brain in [
            phantom::ball(25.0),
            phantom::ellipsoid([40.0, 30.0, 20.0], 1.0),
        ] {
            let (_, mesh) = mesh_of(&brain, MeshSize::STANDARD);
            for contour in 0..29 {
                let straight = mismatch(&mesh, contour, 0);
                let turned = (1..30)
                    .map(|turn| mismatch(&mesh, contour, turn))
                    .fold(f32::INFINITY, f32::min);
                assert!(
                    straight <= turned,
                    "between contours {contour} and the next"
                );
            }
        }
    }

    #[test]
    fn what_is_too_thin_to_be_cut_is_refused() {
        for brain in [phantom::ball(0.4), phantom::ellipsoid([0.4, 6.0, 6.0], 1.0)] {
            let field = DepthField::new(&distance_map(&envelope(&brain, 0.0).unwrap()));
            assert!(matches!(
                envelope_mesh(&field, MeshSize::STANDARD),
                Err(GeometryError::TooSmall { .. })
            ));
        }
    }
}
