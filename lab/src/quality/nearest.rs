//! The nearest triangle of a mesh.

use glam::Vec3;

/// Triangles in a leaf.
const LEAF: usize = 8;

/// A bounding-volume hierarchy of the triangles of a mesh.
#[derive(Debug)]
pub(super) struct Nearest {
    triangles: Vec<[Vec3; 3]>,
    nodes: Vec<Node>,
}

/// A box around some triangles.
#[derive(Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// The range of triangles.
    Leaf(usize, usize),
    /// The indices of two nodes.
    Halves(usize, usize),
}

impl Nearest {
    /// The box around at least one triangle.
    pub(super) fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let end = triangles.len();
        let mut tree = Self {
            triangles,
            nodes: Vec::new(),
        };
        tree.split(0, end);
        tree
    }

    /// Builds the node of the triangles in `first..end`, and the nodes below it.
    fn split(&mut self, first: usize, end: usize) -> usize {
        let triangles = &mut self.triangles[first..end];
        let corners = triangles.iter().flatten();
        let (low, high) = corners.fold(
            (Vec3::INFINITY, Vec3::NEG_INFINITY),
            |(low, high), &corner| (low.min(corner), high.max(corner)),
        );
        let node = self.nodes.len();
        let content = Content::Leaf(first, end);
        self.nodes.push(Node { low, high, content });
        if end - first > LEAF {
            let extent = high - low;
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b]));
            let axis = axis.unwrap_or(0);
            let middle =
                |triangle: &[Vec3; 3]| triangle.iter().map(|corner| corner[axis]).sum::<f32>();
            let half = (end - first) / 2;
            triangles.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
            let near = self.split(first, first + half);
            let far = self.split(first + half, end);
            self.nodes[node].content = Content::Halves(near, far);
        }
        node
    }

    /// The distance of a point from the nearest triangle.
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        self.least(0, point, f32::INFINITY).sqrt()
    }

    /// The least squared distance below a node, or `best` if none is less.
    fn least(&self, node: usize, point: Vec3, best: f32) -> f32 {
        let apart = |node: usize| {
            let Node { low, high, .. } = self.nodes[node];
            point.distance_squared(point.clamp(low, high))
        };
        match self.nodes[node].content {
            Content::Leaf(first, end) => {
                let squared =
                    |triangle: &[Vec3; 3]| point.distance_squared(closest_point(triangle, point));
                let triangles = &self.triangles[first..end];
                triangles.iter().map(squared).fold(best, f32::min)
            }
            Content::Halves(a, b) => {
                let mut halves = [(apart(a), a), (apart(b), b)];
                halves.sort_by(|(a, _), (b, _)| a.total_cmp(b));
                halves.into_iter().fold(best, |best, (apart, node)| {
                    if apart < best {
                        self.least(node, point, best)
                    } else {
                        best
                    }
                })
            }
        }
    }
}

/// The point of a triangle closest to `point`: its projection if that lies inside, otherwise a point on an edge.
fn closest_point(&[a, b, c]: &[Vec3; 3], point: Vec3) -> Vec3 {
    let normal = (b - a).cross(c - a);
    let area_squared = normal.length_squared();
    if area_squared > 0.0 {
        // The projection is inside if it is on the inner side of all three edges.
        let is_inside = |from: Vec3, to: Vec3| (to - from).cross(point - from).dot(normal) >= 0.0;
        if is_inside(a, b) && is_inside(b, c) && is_inside(c, a) {
            return point - normal * ((point - a).dot(normal) / area_squared);
        }
    }
    let on_edges = [(a, b), (b, c), (c, a)].map(|(from, to)| on_segment(from, to, point));
    let nearer = |x: Vec3, y: Vec3| {
        if point.distance_squared(y) < point.distance_squared(x) {
            y
        } else {
            x
        }
    };
    nearer(nearer(on_edges[0], on_edges[1]), on_edges[2])
}

fn on_segment(from: Vec3, to: Vec3, point: Vec3) -> Vec3 {
    let along = to - from;
    let length_squared = along.length_squared();
    if length_squared == 0.0 {
        return from;
    }
    let place = (point - from).dot(along) / length_squared;
    from + along * place.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [Vec3; 3] = [
        Vec3::ZERO,
        Vec3::new(4.0, 0.0, 0.0),
        Vec3::new(0.0, 3.0, 0.0),
    ];

    #[test]
    fn the_closest_point_is_a_face_an_edge_or_a_corner() {
        let cases = [
            (Vec3::new(1.0, 1.0, 5.0), Vec3::new(1.0, 1.0, 0.0)),
            (Vec3::new(2.0, -2.0, 0.0), Vec3::new(2.0, 0.0, 0.0)),
            (Vec3::new(-1.0, -1.0, 1.0), Vec3::ZERO),
            (Vec3::new(9.0, 0.0, 0.0), Vec3::new(4.0, 0.0, 0.0)),
        ];
        for (point, closest) in cases {
            assert!(
                closest_point(&TRIANGLE, point).distance(closest) < 1e-6,
                "{point}"
            );
        }
    }

    #[test]
    fn a_triangle_without_area_is_its_longest_edge() {
        let flat = [Vec3::ZERO, Vec3::X, Vec3::X * 3.0];
        assert_eq!(
            closest_point(&flat, Vec3::new(2.0, 1.0, 0.0)),
            Vec3::X * 2.0
        );
        let point = [Vec3::ONE; 3];
        assert_eq!(closest_point(&point, Vec3::ZERO), Vec3::ONE);
    }

    #[test]
    fn the_tree_finds_what_looking_at_every_triangle_finds() {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut point = |scale: f32| Vec3::new(random(), random(), random()) * scale;
        let triangles: Vec<[Vec3; 3]> = (0..300)
            .map(|_| {
                let at = point(20.0);
                [at, at + point(2.0), at + point(2.0)]
            })
            .collect();
        let tree = Nearest::new(triangles.clone());
        for _ in 0..200 {
            let from = point(24.0);
            let each = triangles
                .iter()
                .map(|t| closest_point(t, from).distance(from));
            let least = each.fold(f32::INFINITY, f32::min);
            assert!((tree.distance(from) - least).abs() < 1e-5);
        }
    }
}
