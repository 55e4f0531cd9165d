//! Findings as voxels: for programs that know labels and masks, not points.

use case::findings::{Finding, FindingKind};
use geometry::{Grid, Mask};
use glam::{DMat3, DVec3};

/// How far from a finding a voxel's centre belongs to it, in mm: half a brush of 3 mm.
pub const BRUSH_RADIUS_MM: f64 = 1.5;

/// The distance between neighbouring dabs of the brush, in mm: so little that their balls make a tube.
const STEP_MM: f64 = 0.5;

/// The most corners of a polygon that decide what is within it; of more, some in even steps. Its outline has them all.
const MAX_CORNERS: usize = 256;

/// The voxels of a finding on a block of a grid; `None` if it has none.
///
/// They are the voxels whose centre lies within [`BRUSH_RADIUS_MM`] of its points and of the lines between them; of a polygon
/// also those within it. What is within a polygon is decided in its mean plane, and its height above that plane is that of its
/// corners, the near ones most. The voxel nearest to each point is always one of them.
pub fn voxels_of(finding: &Finding, grid: &Grid) -> Option<Mask> {
    let points = points_of(finding);
    let (first, size) = block_around(&points, grid)?;
    let block = grid.block(first.map(|index| index as i64), size).ok()?;
    let mut canvas = Canvas {
        voxels: vec![false; block.voxel_count()],
        block,
    };
    for (from, to) in lines_between(finding.kind, &points) {
        let steps = (from.distance(to) / STEP_MM).ceil().max(1.0);
        for step in 0..=steps as u32 {
            canvas.dab(from.lerp(to, f64::from(step) / steps));
        }
    }
    for &point in &points {
        canvas.dab(point);
        if let Some((index, _)) = canvas.holding(point) {
            canvas.voxels[index] = true;
        }
    }
    if finding.kind == FindingKind::Polygon {
        canvas.fill(&points);
    }
    let is_any = canvas.voxels.contains(&true);
    Mask::new(canvas.block, canvas.voxels)
        .ok()
        .filter(|_| is_any)
}

pub(crate) fn points_of(finding: &Finding) -> Vec<DVec3> {
    let points = finding.points_in_patient.iter();
    points.map(|&point| DVec3::from_array(point)).collect()
}

/// The lines between the points of a finding, in their order; those of a polygon lead back to its first point.
pub(crate) fn lines_between(
    kind: FindingKind,
    points: &[DVec3],
) -> impl Iterator<Item = (DVec3, DVec3)> {
    let back = points.first().filter(|_| kind == FindingKind::Polygon);
    let next = points.iter().skip(1).chain(back);
    points.iter().copied().zip(next.copied())
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

/// A block that is painted.
struct Canvas {
    block: Grid,
    voxels: Vec<bool>,
}

impl Canvas {
    /// Paints the voxels whose centre the brush covers.
    fn dab(&mut self, at: DVec3) {
        let spacing = DVec3::from_array(self.block.spacing_mm());
        let reach = DVec3::splat(BRUSH_RADIUS_MM) / spacing;
        let middle = self.block.voxel_from_patient().transform_point3(at);
        let last = self.block.size().map(|size| size as f64 - 1.0);
        let from = (middle - reach).ceil().max(DVec3::ZERO).to_array();
        let to = (middle + reach)
            .floor()
            .min(DVec3::from_array(last))
            .to_array();
        let range = |axis: usize| from[axis] as i64..=to[axis] as i64;
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let voxel = [x, y, z].map(|index| index as usize);
                    let centre = DVec3::from_array(voxel.map(|index| index as f64));
                    let centre = self.block.patient_from_voxel().transform_point3(centre);
                    if centre.distance(at) <= BRUSH_RADIUS_MM {
                        self.voxels[self.block.index(voxel)] = true;
                    }
                }
            }
        }
    }

    /// The voxel that holds a point, and its centre in the patient; `None` outside the block.
    fn holding(&self, at: DVec3) -> Option<(usize, DVec3)> {
        let voxel = self.block.voxel_from_patient().transform_point3(at);
        let index = self.block.nearest(voxel)?;
        let centre = self
            .block
            .patient_from_voxel()
            .transform_point3(voxel.round());
        Some((index, centre))
    }

    /// Paints what is within a polygon, as thick as the brush.
    fn fill(&mut self, points: &[DVec3]) {
        let plane_from_patient = plane(points);
        let patient_from_plane = plane_from_patient.transpose();
        let stride = points.len().div_ceil(MAX_CORNERS);
        let corners = points.iter().step_by(stride);
        let corners: Vec<_> = corners.map(|&point| plane_from_patient * point).collect();
        let least = corners.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let most = corners
            .iter()
            .copied()
            .fold(DVec3::NEG_INFINITY, DVec3::max);
        // No voxel is passed over.
        let edges = self.block.spacing_mm();
        let step = edges
            .into_iter()
            .fold(STEP_MM, |step, edge| step.min(edge / 2.0));
        let steps = |length: f64| (length / step).ceil() as u32;
        let across = steps(2.0 * BRUSH_RADIUS_MM);
        for row in 0..=steps(most.y - least.y) {
            for column in 0..=steps(most.x - least.x) {
                let x = least.x + f64::from(column) * step;
                let y = least.y + f64::from(row) * step;
                let Some(height) = height_within(&corners, x, y) else {
                    continue;
                };
                for level in 0..=across {
                    let off = (f64::from(level) / f64::from(across) - 0.5) * 2.0 * BRUSH_RADIUS_MM;
                    let at = patient_from_plane * DVec3::new(x, y, height + off);
                    if let Some((index, centre)) = self.holding(at)
                        && ((plane_from_patient * centre).z - height).abs() <= BRUSH_RADIUS_MM
                    {
                        self.voxels[index] = true;
                    }
                }
            }
        }
    }
}

/// The height of a polygon above a point of its plane; `None` outside it.
fn height_within(corners: &[DVec3], x: f64, y: f64) -> Option<f64> {
    let next = corners.iter().cycle().skip(1);
    let is_crossed = |(a, b): &(&DVec3, &DVec3)| {
        (a.y > y) != (b.y > y) && x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    let crossings = corners.iter().zip(next).filter(is_crossed).count();
    if crossings.is_multiple_of(2) {
        return None;
    }
    let (mut weights, mut heights) = (0.0, 0.0);
    for corner in corners {
        let weight = 1.0 / ((corner.x - x).powi(2) + (corner.y - y).powi(2) + 1e-6);
        weights += weight;
        heights += weight * corner.z;
    }
    Some(heights / weights)
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
    fn a_long_finding_takes_no_longer_than_a_reader_waits() {
        // To and fro through a whole head.
        let affine = DAffine3::from_translation(DVec3::splat(-128.0));
        let grid = Grid::new([256; 3], affine).unwrap();
        let points: Vec<_> = (0..2_000)
            .map(|number| {
                let turn = f64::from(number) * 2.4;
                DVec3::new(
                    100.0 * turn.cos(),
                    100.0 * turn.sin(),
                    f64::from(number % 200) - 100.0,
                )
            })
            .collect();
        for kind in ["line", "polygon"] {
            let start = std::time::Instant::now();
            assert!(voxels_of(&finding(kind, &points), &grid).is_some());
            assert!(
                start.elapsed().as_secs() < 20,
                "{kind}: {:?}",
                start.elapsed()
            );
        }
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
