//! Findings as voxels: for programs that know labels and masks, not points.

use case::findings::{Finding, FindingKind};
use geometry::{Grid, Mask};
use glam::{DMat3, DVec3};

/// How far from a finding a voxel's centre belongs to it, in mm: half a brush of 3 mm.
pub const BRUSH_RADIUS_MM: f64 = 1.5;

/// The voxels of a finding on a block of a grid; `None` if it has none.
///
/// They are the voxels whose centre lies within [`BRUSH_RADIUS_MM`] of its points and of the lines between them; of a polygon
/// also those within it. What is within a polygon is decided in its mean plane, and its height above that plane is
/// that of its corners, the near ones most. The voxel nearest to each point is always one of them.
pub fn voxels_of(finding: &Finding, grid: &Grid) -> Option<Mask> {
    let points: Vec<DVec3> = finding
        .points_in_patient
        .iter()
        .map(|&point| DVec3::from_array(point))
        .collect();
    let (first, size) = block_around(&points, grid)?;
    let block = grid.block(first.map(|index| index as i64), size).ok()?;
    let mut voxels = vec![false; block.voxel_count()];
    let shape = Shape::of(finding.kind, &points);
    for (index, voxel) in voxels.iter_mut().enumerate() {
        let at = DVec3::from_array(block.voxel(index).map(|index| index as f64));
        *voxel = shape.has(block.patient_from_voxel().transform_point3(at));
    }
    for &point in &points {
        let at = block.voxel_from_patient().transform_point3(point).round();
        let is_in = |axis: usize| at[axis] >= 0.0 && at[axis] < size[axis] as f64;
        if (0..3).all(is_in) {
            voxels[block.index(at.to_array().map(|index| index as usize))] = true;
        }
    }
    let is_any = voxels.contains(&true);
    Mask::new(block, voxels).ok().filter(|_| is_any)
}

/// The first voxel and the size of the block that holds the points and the brush around them; `None` outside the grid.
fn block_around(points: &[DVec3], grid: &Grid) -> Option<([usize; 3], [usize; 3])> {
    let spacing = DVec3::from_array(grid.spacing_mm());
    // The height of a polygon between its corners is never beyond theirs.
    let margin = (DVec3::splat(BRUSH_RADIUS_MM) / spacing).ceil() + 1.0;
    let at = |&point: &DVec3| grid.voxel_from_patient().transform_point3(point);
    let low = points.iter().map(at).reduce(DVec3::min)? - margin;
    let high = points.iter().map(at).reduce(DVec3::max)? + margin;
    let size = DVec3::from_array(grid.size().map(|size| size as f64));
    let low = low.floor().clamp(DVec3::ZERO, size);
    let high = (high.ceil() + 1.0).clamp(DVec3::ZERO, size);
    let extent = (high - low).to_array().map(|side| side as usize);
    let low = low.to_array().map(|index| index as usize);
    (!extent.contains(&0)).then_some((low, extent))
}

/// What the voxels of a finding are near to.
struct Shape<'p> {
    points: &'p [DVec3],
    is_closed: bool,
    /// The points of a polygon in its mean plane, with their heights above it, and what turns the patient into that
    /// plane.
    area: Option<(DMat3, Vec<DVec3>)>,
}

impl<'p> Shape<'p> {
    fn of(kind: FindingKind, points: &'p [DVec3]) -> Self {
        let is_closed = kind == FindingKind::Polygon;
        let area = is_closed.then(|| {
            let plane_from_patient = plane(points);
            let corners = points.iter().map(|&point| plane_from_patient * point);
            (plane_from_patient, corners.collect())
        });
        Self {
            points,
            is_closed,
            area,
        }
    }

    fn has(&self, at: DVec3) -> bool {
        self.is_near_its_lines(at) || self.is_within(at)
    }

    fn is_near_its_lines(&self, at: DVec3) -> bool {
        let ends = match self.is_closed {
            true => self.points.len(),
            false => self.points.len().saturating_sub(1),
        };
        let next = |number: usize| self.points[(number + 1) % self.points.len()];
        let near = |from: DVec3, to: DVec3| distance(at, from, to) <= BRUSH_RADIUS_MM;
        match self.points {
            [point] => near(*point, *point),
            points => (0..ends).any(|number| near(points[number], next(number))),
        }
    }

    fn is_within(&self, at: DVec3) -> bool {
        let Some((plane_from_patient, corners)) = &self.area else {
            return false;
        };
        let at = *plane_from_patient * at;
        let is_crossed = |number: &usize| {
            let [a, b] = [corners[*number], corners[(*number + 1) % corners.len()]];
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        };
        let crossings = (0..corners.len()).filter(is_crossed).count();
        if crossings.is_multiple_of(2) {
            return false;
        }
        let (mut weights, mut heights) = (0.0, 0.0);
        for corner in corners {
            let weight = 1.0 / ((*corner - at).truncate().length_squared() + 1e-6);
            weights += weight;
            heights += weight * corner.z;
        }
        (at.z - heights / weights).abs() <= BRUSH_RADIUS_MM
    }
}

/// The distance of a point from a line between two others, in mm.
fn distance(at: DVec3, from: DVec3, to: DVec3) -> f64 {
    let along = to - from;
    let length = along.length_squared();
    let share = match length > 0.0 {
        true => ((at - from).dot(along) / length).clamp(0.0, 1.0),
        false => 0.0,
    };
    at.distance(from + along * share)
}

/// A rotation whose third axis is the normal of a polygon, by Newell's method.
fn plane(points: &[DVec3]) -> DMat3 {
    let origin = points[0];
    let next = points.iter().cycle().skip(1);
    let area = |(a, b): (&DVec3, &DVec3)| (*a - origin).cross(*b - origin);
    let normal: DVec3 = points.iter().zip(next).map(area).sum();
    let normal = normal.try_normalize().unwrap_or(DVec3::Z);
    let (x, y) = normal.any_orthonormal_pair();
    DMat3::from_cols(x, y, normal).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DAffine3;

    fn grid() -> Grid {
        // Half a millimetre along the first axis; turned, and away from the origin.
        let scale = DAffine3::from_scale(DVec3::new(0.5, 1.0, 2.0));
        let turn = DAffine3::from_rotation_z(0.3);
        let place = DAffine3::from_translation(DVec3::new(-20.0, 5.0, -30.0));
        Grid::new([120, 60, 30], place * turn * scale).unwrap()
    }

    fn finding(kind: &str, points: &[DVec3]) -> Finding {
        let points: Vec<_> = points.iter().map(DVec3::to_array).collect();
        let json = serde_json::json!({
            "id": "a", "kind": kind, "points_in_patient": points, "depth_mm": 5.0,
        });
        serde_json::from_value(json).unwrap()
    }

    fn at(voxel: [f64; 3]) -> DVec3 {
        let point = DVec3::from_array(voxel);
        grid().patient_from_voxel().transform_point3(point)
    }

    fn volume_mm3(mask: &Mask) -> f64 {
        mask.volume_ml() * 1000.0
    }

    #[test]
    fn a_point_is_a_ball_around_it() {
        let mask = voxels_of(&finding("point", &[at([60.0, 30.0, 15.0])]), &grid()).unwrap();
        // The voxels within 1.5 mm: 7, 5 and 5 in the rows of the plane of the point; 2 mm above there are none.
        assert_eq!(mask.voxels().iter().filter(|&&is| is).count(), 17);
        let middle = mask.grid().patient_from_voxel();
        for index in 0..mask.voxels().len() {
            let voxel = mask.grid().voxel(index).map(|index| index as f64);
            let far = middle.transform_point3(DVec3::from_array(voxel));
            let is_near = far.distance(at([60.0, 30.0, 15.0])) <= BRUSH_RADIUS_MM;
            assert_eq!(mask.voxels()[index], is_near);
        }
    }

    #[test]
    fn a_polygon_is_filled_also_if_it_is_bent_or_has_a_notch() {
        let square = [
            [40.0, 20.0, 15.0],
            [80.0, 20.0, 15.0],
            [80.0, 40.0, 15.0],
            [40.0, 40.0, 15.0],
        ];
        let filled = finding("polygon", &square.map(at));
        let mask = voxels_of(&filled, &grid()).unwrap();
        // 20 mm by 20 mm, and the brush around it.
        let expected = (20.0 * 20.0 + 80.0 * 1.5) * 2.0;
        assert!((volume_mm3(&mask) / expected - 1.0).abs() < 0.1);
        let outline = finding("line", &square.map(at));
        let line = voxels_of(&outline, &grid()).unwrap();
        assert!(volume_mm3(&line) < 0.6 * volume_mm3(&mask));
        // A notch is left out.
        let notched = [
            square[0],
            square[1],
            [60.0, 30.0, 15.0],
            square[2],
            square[3],
        ];
        let notched = voxels_of(&finding("polygon", &notched.map(at)), &grid()).unwrap();
        assert!(volume_mm3(&notched) < 0.95 * volume_mm3(&mask));
        // Bent by 8 mm, the middle lies between its corners.
        let mut bent = square;
        bent[0][2] += 4.0;
        bent[2][2] += 4.0;
        assert!(voxels_of(&finding("polygon", &bent.map(at)), &grid()).is_some());
    }

    #[test]
    fn what_lies_outside_the_grid_has_no_voxels() {
        let outside = finding("point", &[at([-40.0, 30.0, 15.0])]);
        assert!(voxels_of(&outside, &grid()).is_none());
        // At the edge, the voxels within the grid.
        let edge = finding("point", &[at([0.0, 0.0, 0.0])]);
        assert!(voxels_of(&edge, &grid()).is_some());
    }
}
