//! The isosurface as a closed mesh of triangles.

use crate::Grid;

/// The least distance of a vertex from a voxel centre, in voxels, so that vertices never coincide and every triangle has an area.
const LEAST_FRACTION: f32 = 1.0 / 512.0;

/// No vertex, or no edge.
const NONE: u32 = u32::MAX;

/// A closed mesh: each edge belongs to two triangles, which run along it in opposite directions, and each triangle has an area.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solid {
    /// The vertices in LPS mm.
    pub positions_in_patient: Vec<[f32; 3]>,
    /// Vertex numbers, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// The border of where values on a working grid are 0 or more. `value` is of the voxel with an index, and negative on the faces of
/// the grid.
///
/// Vertices lie between neighbouring voxel centres, where the value is 0. Each cell of eight voxels closes the polygons that its faces
/// cut out. If two opposite corners of a face are inside, its saddle decides whether they are connected, for both cells alike. In a cell
/// with such a face, a polygon is filled from its middle: any other edge might lie in the face, and be one of the next cell, too.
///
/// Sources: Lorensen and Cline, "Marching Cubes", 1987; for the saddle, Nielson and Hamann, "The Asymptotic Decider", 1991.
pub fn solid(grid: &Grid, value: impl Fn(usize) -> f32) -> Solid {
    let [nx, ny, nz] = grid.size();
    let slice = |z: usize| (nx * ny * z..nx * ny * (z + 1)).map(&value);
    let mut slab = Slab {
        grid,
        values: [slice(0).collect(), Vec::new()],
        vertices: [vec![[NONE; 3]; nx * ny], vec![[NONE; 3]; nx * ny]],
        solid: Solid::default(),
    };
    for z in 1..nz {
        slab.values[1].clear();
        slab.values[1].extend(slice(z));
        slab.close_cells(z - 1);
        slab.values.swap(0, 1);
        slab.vertices.swap(0, 1);
        slab.vertices[1].fill([NONE; 3]);
    }
    slab.solid
}

/// The cells between two slices. The corners of a cell are numbered by their places along x, y and z, one bit each.
struct Slab<'a> {
    grid: &'a Grid,
    /// Of the voxels of the two slices.
    values: [Vec<f32>; 2],
    /// The vertices after each voxel of the two slices, along each axis.
    vertices: [Vec<[u32; 3]>; 2],
    solid: Solid,
}

impl Slab<'_> {
    fn close_cells(&mut self, z: usize) {
        let [nx, ny, _] = self.grid.size();
        for y in 0..ny - 1 {
            // Whether the voxels of the four rows at x are inside.
            let is_inside = |slab: &Self, x: usize| {
                let rows = [[0, y], [0, y + 1], [1, y], [1, y + 1]];
                rows.map(|[slice, y]| slab.values[slice][x + nx * y] >= 0.0)
            };
            let mut before = is_inside(self, 0);
            for x in 1..nx {
                let after = is_inside(self, x);
                if before != after || before != [before[0]; 4] {
                    self.close_cell([x - 1, y, z]);
                }
                before = after;
            }
        }
    }

    fn close_cell(&mut self, first: [usize; 3]) {
        let [nx, _, _] = self.grid.size();
        let start = first[0] + nx * first[1];
        let place = |corner: usize| (corner >> 2, start + (corner & 1) + nx * (corner >> 1 & 1));
        let values: [f32; 8] = std::array::from_fn(|corner| {
            let (slice, voxel) = place(corner);
            self.values[slice][voxel]
        });
        let outline = Outline::of(&values);
        let mut next = outline.next;
        for start in 0..next.len() {
            let mut polygon = Vec::with_capacity(12);
            let mut edge = start;
            while next[edge] != NONE {
                let (slice, voxel) = place(edge % 8);
                let known = self.vertices[slice][voxel][edge / 8];
                let vertex = if known == NONE {
                    let position = on_edge(edge, &values);
                    self.add([0, 1, 2].map(|axis| first[axis] as f32 + position[axis]))
                } else {
                    known
                };
                self.vertices[slice][voxel][edge / 8] = vertex;
                polygon.push(vertex);
                edge = std::mem::replace(&mut next[edge], NONE) as usize;
            }
            self.fill(&polygon, outline.has_saddle);
        }
    }

    fn fill(&mut self, polygon: &[u32], is_from_middle: bool) {
        let Some((&last, others)) = polygon.split_last() else {
            return;
        };
        if is_from_middle && polygon.len() > 3 {
            let places = polygon.iter().map(|&vertex| {
                glam::Vec3::from_array(self.solid.positions_in_patient[vertex as usize])
            });
            let middle = places.sum::<glam::Vec3>() / polygon.len() as f32;
            let middle_vertex = self.solid.positions_in_patient.len() as u32;
            self.solid.positions_in_patient.push(middle.to_array());
            let mut before = last;
            for &vertex in polygon {
                self.solid.triangles.push([before, vertex, middle_vertex]);
                before = vertex;
            }
        } else {
            let pairs = others.windows(2).map(|pair| [last, pair[0], pair[1]]);
            self.solid.triangles.extend(pairs);
        }
    }

    fn add(&mut self, position_in_voxel: [f32; 3]) -> u32 {
        let position = glam::Vec3::from_array(position_in_voxel).as_dvec3();
        let position = self.grid.patient_from_voxel().transform_point3(position);
        let positions = &mut self.solid.positions_in_patient;
        positions.push(position.as_vec3().to_array());
        positions.len() as u32 - 1
    }
}

/// Where the value is 0 between the ends of an edge of a cell, in voxels from its first corner.
fn on_edge(edge: usize, values: &[f32; 8]) -> [f32; 3] {
    let (corner, axis) = (edge % 8, edge / 8);
    let [near, far] = [values[corner], values[corner | 1 << axis]];
    let fraction = (near / (near - far)).clamp(LEAST_FRACTION, 1.0 - LEAST_FRACTION);
    let mut position = [0, 1, 2].map(|axis| (corner >> axis & 1) as f32);
    position[axis] += fraction;
    position
}

/// What the faces of a cell cut out.
struct Outline {
    /// For each edge, first corner + 8 · axis, the edge to which its polygon continues.
    next: [u32; 24],
    /// Whether two opposite corners of a face are inside, and the others not.
    has_saddle: bool,
}

impl Outline {
    fn of(values: &[f32; 8]) -> Self {
        let mut outline = Self {
            next: [NONE; 24],
            has_saddle: false,
        };
        for axis in 0..3 {
            let [right, up] = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
            outline.add_face(values, [0, up, right | up, right]);
            let far = 1 << axis;
            outline.add_face(values, [far, far | right, far | right | up, far | up]);
        }
        outline
    }

    /// Adds what crosses a face, whose corners come counter-clockwise seen from outside the cell.
    fn add_face(&mut self, values: &[f32; 8], face: [usize; 4]) {
        let is_inside = |place: usize| values[face[place % 4]] >= 0.0;
        let edge = |place: usize| edge_between(face[place % 4], face[(place + 1) % 4]);
        for entry in (0..4).filter(|&place| !is_inside(place) && is_inside(place + 1)) {
            let is_saddle = !is_inside(entry + 2) && is_inside(entry + 3);
            self.has_saddle |= is_saddle;
            let [a, b, c, d] = [0, 1, 2, 3].map(|step| values[face[(entry + step) % 4]]);
            let exit = if is_saddle && b * d >= a * c {
                entry + 3
            } else {
                let after = (entry + 1..entry + 4).find(|&place| !is_inside(place + 1));
                after.expect("what enters a face leaves it")
            };
            self.next[edge(entry)] = edge(exit) as u32;
        }
    }
}

/// The number of the edge between two neighbouring corners.
fn edge_between(a: usize, b: usize) -> usize {
    a.min(b) + 8 * (a ^ b).trailing_zeros() as usize
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use glam::{DVec3, Vec3};

    use super::*;
    use crate::{DepthField, distance_map, envelope, phantom};

    fn corners(solid: &Solid, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle
            .map(|vertex| Vec3::from_array(solid.positions_in_patient[vertex as usize]).as_dvec3())
    }

    fn volume_mm3(solid: &Solid) -> f64 {
        let of = |&triangle: &[u32; 3]| {
            let [a, b, c] = corners(solid, triangle);
            a.dot(b.cross(c)) / 6.0
        };
        solid.triangles.iter().map(of).sum()
    }

    /// Vertices − edges + triangles; 2 for a ball, 0 for a torus.
    fn euler_number(solid: &Solid) -> i64 {
        let (vertices, triangles) = (solid.positions_in_patient.len(), solid.triangles.len());
        vertices as i64 - 3 * triangles as i64 / 2 + triangles as i64
    }

    /// Fails unless each edge belongs to two triangles in opposite directions, and each triangle has an area.
    fn assert_closed(solid: &Solid) {
        let mut edges: HashMap<[u32; 2], u32> = HashMap::new();
        for &[a, b, c] in &solid.triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for ([a, b], &count) in &edges {
            assert_eq!((count, edges.get(&[*b, *a])), (1, Some(&1)), "{a} to {b}");
        }
        for &triangle in &solid.triangles {
            let [a, b, c] = corners(solid, triangle);
            assert!((b - a).cross(c - a).length() > 0.0, "{a} {b} {c}");
        }
    }

    fn at_depth(brain: &crate::BrainMask, depth_mm: f32) -> Solid {
        let field = DepthField::new(&distance_map(&envelope(brain, 0.0).unwrap()));
        let depth = depth_mm / field.spacing_mm() * DepthField::STEPS_PER_VOXEL;
        solid(field.grid(), |voxel| {
            f32::from(field.values()[voxel]) - depth
        })
    }

    #[test]
    fn whatever_the_values_are_the_mesh_is_closed() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        let grid = Grid::aligned([14, 13, 12], [0.7; 3], DVec3::new(-90.0, 80.0, 100.0)).unwrap();
        // Few values, of which many are 0, and many; more and less of them inside.
        for (levels, above) in [
            (3, 1),
            (5, 1),
            (5, 3),
            (1 << 20, 1 << 19),
            (1 << 20, 1 << 18),
        ] {
            for _ in 0..20 {
                let values: Vec<f32> = (0..grid.voxel_count())
                    .map(|voxel| {
                        let is_on_face = (grid.voxel(voxel).iter().zip(grid.size()))
                            .any(|(&place, side)| place == 0 || place == side - 1);
                        let value = (random() % levels) as f32 - above as f32;
                        if is_on_face { -1.0 } else { value }
                    })
                    .collect();
                let solid = solid(&grid, |voxel| values[voxel]);
                assert!(solid.triangles.len() > 1000);
                assert_closed(&solid);
                assert!(volume_mm3(&solid) > 0.0);
            }
        }
    }

    #[test]
    fn a_cell_has_its_inside_where_its_corners_are_inside() {
        let grid = Grid::aligned([4; 3], [1.0; 3], DVec3::ZERO).unwrap();
        for case in 1..256u32 {
            for saddle in [0.25, 1.0, 4.0] {
                let value = |voxel: usize| {
                    let place = grid.voxel(voxel);
                    let is_in_cell = place.iter().all(|along| (1..=2).contains(along));
                    let corner = (0..3)
                        .map(|axis| (place[axis].wrapping_sub(1) & 1) << axis)
                        .sum::<usize>();
                    if is_in_cell && case >> corner & 1 == 1 {
                        saddle
                    } else {
                        -1.0
                    }
                };
                let solid = solid(&grid, value);
                assert_closed(&solid);
                // A ray along x to a voxel crosses the mesh an odd number of times if it is inside.
                for voxel in 0..grid.voxel_count() {
                    // Beside the diagonals of triangles.
                    let voxel_place = grid.voxel(voxel).map(|place| place as f64);
                    let at = DVec3::from_array(voxel_place) + DVec3::new(0.0, 1.3e-4, 0.7e-4);
                    let crossed = solid.triangles.iter().filter(|&&triangle| {
                        let [a, b, c] = corners(&solid, triangle).map(|corner| corner - at);
                        let side = |p: DVec3, q: DVec3| p.y * q.z - p.z * q.y;
                        let sides = [side(a, b), side(b, c), side(c, a)];
                        let is_met = sides.iter().all(|&side| side > 0.0)
                            || sides.iter().all(|&side| side < 0.0);
                        let normal = (b - a).cross(c - a);
                        is_met && a.dot(normal) / normal.x > 0.0
                    });
                    assert_eq!(
                        crossed.count() % 2 == 1,
                        value(voxel) >= 0.0,
                        "{case} {voxel}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_ball_is_smaller_by_the_depth_and_a_lobe_parts_from_the_other() {
        // Depth counts from the centres of border voxels, which lie up to a voxel inside the ball.
        let ball_of = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let mut before = f64::INFINITY;
        for depth_mm in [0.0, 0.5, 4.0, 7.3, 12.0] {
            let ball = at_depth(&phantom::ball(20.0), depth_mm);
            assert_closed(&ball);
            assert_eq!(euler_number(&ball), 2);
            let volume = volume_mm3(&ball);
            let [least, most] = [1.1, 0.0].map(|less| ball_of(20.0 - less - f64::from(depth_mm)));
            assert!((least..most).contains(&volume), "{volume} at {depth_mm}");
            assert!(volume < before);
            before = volume;
        }
        // The bar is 8 wide.
        let lobes = phantom::two_lobes([18.0, 15.0], 50.0, 8.0);
        for (depth_mm, bodies) in [(4.0, 1), (10.0, 2)] {
            let solid = at_depth(&lobes, depth_mm);
            assert_closed(&solid);
            assert_eq!(euler_number(&solid), 2 * bodies);
        }
        let spacing = 0.8;
        let ellipsoid = at_depth(&phantom::ellipsoid([34.0, 22.0, 18.0], spacing), 3.0);
        assert_closed(&ellipsoid);
        let widest = ellipsoid.positions_in_patient.iter().map(|place| place[0]);
        let widest = widest.fold(0.0, f32::max);
        assert!((widest - (34.0 * 0.8 - 3.0)).abs() < 0.9, "{widest}");
    }

    #[test]
    fn nothing_inside_is_an_empty_mesh() {
        assert_eq!(at_depth(&phantom::ball(8.0), 30.0), Solid::default());
    }
}
