//! The largest contour of a cross-section, traced with sub-voxel precision.

use glam::{Vec2, Vec3};

use crate::DepthField;

/// The planes of the contours of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContourPlanes {
    /// Sagittal planes, as in the paper.
    Sagittal,
    /// Coronal planes. The inner side of a hemisphere is nearly sagittal: its sagittal contours change so much from plane to plane that
    /// the triangles between them span hollows.
    Coronal,
}

impl ContourPlanes {
    /// The axis of the working grid across the planes.
    pub(crate) fn axis(self) -> usize {
        match self {
            Self::Sagittal => 0,
            Self::Coronal => 1,
        }
    }

    /// The position of a point of a plane: the first coordinate in the plane is along the next axis after that across the planes.
    pub(crate) fn position(self, along: f32, in_plane: Vec2) -> Vec3 {
        let mut position = Vec3::ZERO;
        for (step, place) in [along, in_plane.x, in_plane.y].into_iter().enumerate() {
            position[(self.axis() + step) % 3] = place;
        }
        position
    }
}

/// A closed polygon in voxel coordinates of its plane: (y, z) in a sagittal one, (z, x) in a coronal one. It is counter-clockwise if
/// the first points right and the second up.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Contour {
    points: Vec<Vec2>,
    /// The length along the polygon from its first point to each point, and finally back to the first.
    lengths: Vec<f32>,
}

impl Contour {
    fn new(points: Vec<Vec2>) -> Self {
        let mut lengths = Vec::with_capacity(points.len() + 1);
        let mut length = 0.0;
        for (i, &point) in points.iter().enumerate() {
            lengths.push(length);
            length += point.distance(points[(i + 1) % points.len()]);
        }
        lengths.push(length);
        Self { points, lengths }
    }

    /// The contour of depth 0 with the greatest area on the plane at `place` voxels; `None` if there is none with an area.
    ///
    /// The cross-section is the trilinear depth on that plane. The contour crosses the grid lines where the depth is 0
    /// (marching squares; Lorensen and Cline, 1987, in two dimensions). If two opposite corners of a cell are inside,
    /// the mean of the cell decides whether they are connected.
    pub(crate) fn largest(field: &DepthField, planes: ContourPlanes, place: f32) -> Option<Self> {
        let section = Section::new(field, planes, place);
        let mut is_traced = vec![false; section.depths.len()];
        let mut largest = (0.0, None);
        for start in 0..section.depths.len() {
            if section.is_lower_crossing(start) && !is_traced[start] {
                let points = section.trace(start, &mut is_traced);
                let area = signed_area(&points);
                if area > largest.0 {
                    largest = (area, Some(points));
                }
            }
        }
        largest.1.map(Self::new)
    }

    /// Its length, in voxels.
    pub(crate) fn length(&self) -> f32 {
        self.lengths[self.points.len()]
    }

    /// The centroid of the enclosed area.
    pub(crate) fn centre(&self) -> Vec2 {
        let mut moment = glam::DVec2::ZERO;
        let mut twice_area = 0.0;
        let origin = self.points[0].as_dvec2();
        for edge in self.points.windows(2) {
            let (a, b) = (edge[0].as_dvec2() - origin, edge[1].as_dvec2() - origin);
            let cross = a.perp_dot(b);
            moment += (a + b) * cross;
            twice_area += cross;
        }
        (origin + moment / (3.0 * twice_area)).as_vec2()
    }

    /// `count` equally spaced points, the first at the fraction `start` of its length (any number of turns).
    pub(crate) fn sample(&self, count: usize, start: f32) -> Vec<Vec2> {
        let total = self.length();
        let mut edge = 0;
        let mut points = Vec::with_capacity(count);
        let start = start.rem_euclid(1.0);
        // At most two turns: from the start to the end, and back to the start.
        let mut turn = 0.0;
        for i in 0..count {
            let mut along = (start + i as f32 / count as f32) * total;
            if along >= total {
                along -= total;
                if turn == 0.0 {
                    (turn, edge) = (1.0, 0);
                }
            }
            while edge + 1 < self.points.len() && self.lengths[edge + 1] <= along {
                edge += 1;
            }
            let (from, to) = (
                self.points[edge],
                self.points[(edge + 1) % self.points.len()],
            );
            let span = self.lengths[edge + 1] - self.lengths[edge];
            let fraction = if span > 0.0 {
                (along - self.lengths[edge]) / span
            } else {
                0.0
            };
            points.push(from.lerp(to, fraction.clamp(0.0, 1.0)));
        }
        points
    }
}

fn signed_area(points: &[Vec2]) -> f32 {
    let origin = points[0];
    let twice: f32 = points
        .windows(2)
        .map(|edge| (edge[0] - origin).perp_dot(edge[1] - origin))
        .sum();
    twice / 2.0
}

/// Depths on a plane, along its first axis fastest. Its border is outside the envelope.
struct Section {
    depths: Vec<f32>,
    width: usize,
}

/// A grid edge between two neighbouring nodes, one inside and one outside, which the contour crosses.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Crossing {
    inside: usize,
    outside: usize,
}

impl Section {
    fn new(field: &DepthField, planes: ContourPlanes, place: f32) -> Self {
        let size = field.grid().size();
        let axis = planes.axis();
        let strides = [1, size[0], size[0] * size[1]];
        let [right, up] = [(axis + 1) % 3, (axis + 2) % 3];
        let low = (place as usize).min(size[axis] - 2);
        let fraction = place - low as f32;
        let mut depths = Vec::with_capacity(size[right] * size[up]);
        for row in 0..size[up] {
            let near = &field.values()[low * strides[axis] + row * strides[up]..];
            let far = near[strides[axis]..].iter().step_by(strides[right]);
            let pairs = near.iter().step_by(strides[right]).zip(far);
            depths.extend(pairs.take(size[right]).map(|(&near, &far)| {
                let (near, far) = (f32::from(near), f32::from(far));
                near + (far - near) * fraction
            }));
        }
        Self {
            depths,
            width: size[right],
        }
    }

    fn is_inside(&self, node: usize) -> bool {
        self.depths[node] >= 0.0
    }

    /// Whether the contour crosses the edge from an inside node down to the node below it (less z).
    fn is_lower_crossing(&self, node: usize) -> bool {
        node >= self.width && self.is_inside(node) && !self.is_inside(node - self.width)
    }

    fn point(&self, crossing: Crossing) -> Vec2 {
        let (inside, outside) = (self.depths[crossing.inside], self.depths[crossing.outside]);
        let node =
            |index: usize| Vec2::new((index % self.width) as f32, (index / self.width) as f32);
        node(crossing.inside).lerp(node(crossing.outside), inside / (inside - outside))
    }

    /// The contour through the lower crossing of `start`, with the inside on its left.
    fn trace(&self, start: usize, is_traced: &mut [bool]) -> Vec<Vec2> {
        let first = Crossing {
            inside: start,
            outside: start - self.width,
        };
        let mut crossing = first;
        let mut points = Vec::new();
        loop {
            if crossing.inside == crossing.outside + self.width {
                is_traced[crossing.inside] = true;
            }
            let point = self.point(crossing);
            if points.last() != Some(&point) {
                points.push(point);
            }
            crossing = self.next(crossing);
            if crossing == first {
                break;
            }
        }
        if points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        points
    }

    /// The next crossing with the inside on the left: through the cell ahead.
    fn next(&self, Crossing { inside, outside }: Crossing) -> Crossing {
        // Seen along the contour, `inside` is on the left and `outside` on the right; ahead of them lie two more nodes.
        let across = outside as isize - inside as isize;
        let ahead = self.turned_left(across);
        let (left, right) = (
            inside.wrapping_add_signed(ahead),
            outside.wrapping_add_signed(ahead),
        );
        match (self.is_inside(left), self.is_inside(right)) {
            (false, false) => Crossing {
                inside,
                outside: left,
            },
            (true, false) => Crossing {
                inside: left,
                outside: right,
            },
            (true, true) => Crossing {
                inside: right,
                outside,
            },
            (false, true) => {
                let corners = [inside, outside, left, right].map(|node| self.depths[node]);
                if corners.iter().sum::<f32>() >= 0.0 {
                    Crossing {
                        inside: right,
                        outside,
                    }
                } else {
                    Crossing {
                        inside,
                        outside: left,
                    }
                }
            }
        }
    }

    /// A step between neighbouring nodes, turned by a quarter to the left: from right-hand side to straight ahead.
    fn turned_left(&self, step: isize) -> isize {
        let width = self.width as isize;
        match step {
            1 => width,
            -1 => -width,
            step if step == width => -1,
            _ => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{distance_map, envelope, phantom};

    fn ball_contour(radius: f64) -> (Contour, f32) {
        let brain = phantom::ball(radius);
        let field = DepthField::new(&distance_map(&envelope(&brain, 0.0).unwrap()));
        let middle = (field.grid().size()[0] / 2) as f32;
        (
            Contour::largest(&field, ContourPlanes::Sagittal, middle).unwrap(),
            middle,
        )
    }

    #[test]
    fn the_contour_of_a_ball_is_a_circle() {
        let (contour, middle) = ball_contour(20.0);
        for point in &contour.points {
            let radius = point.distance(Vec2::splat(middle));
            assert!((18.8..=20.3).contains(&radius), "{radius}");
        }
        assert!(contour.centre().distance(Vec2::splat(middle)) < 1e-3);
    }

    #[test]
    fn samples_are_equally_spaced_from_any_start() {
        let (contour, _) = ball_contour(20.0);
        for start in [0.0, 0.3, 0.999, -0.25, 1.6] {
            let points = contour.sample(200, start);
            let spacing = contour.length() / 200.0;
            for i in 0..200 {
                let chord = points[i].distance(points[(i + 1) % 200]);
                // A chord cuts the corners of the polygon, so that it can be shorter but not longer.
                assert!(
                    chord <= spacing * 1.001 && chord > spacing * 0.6,
                    "{start} {i}: {chord}"
                );
            }
        }
        let shifted = contour.sample(200, 0.5);
        assert!(shifted[0].distance(contour.sample(200, 0.0)[100]) < 1e-3);
    }
}
