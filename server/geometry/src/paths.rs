//! The table of the positions of all vertices at all depths.

use glam::Vec3;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::segment::{Corner, Segment};
use crate::walk::Walker;
use crate::{DepthField, DistanceMap, EnvelopeMesh, MeshSize, Paths};

/// The depth between two rows of a table, in voxels.
const ROW_VOXELS: f32 = 0.5;

/// The greatest depth error of a position between two rows, in mm; beyond it the table stores finer pieces.
const ROW_TOLERANCE_MM: f32 = 0.025;

/// Depths closer than this count as equal, in mm.
const FINEST_STEP_MM: f32 = 0.01;

/// The positions of the vertices of a mesh at every depth: depth-major, 16 bits per coordinate.
///
/// Positions at a depth between two rows are interpolated. If the path of a vertex bends or jumps so much between two
/// rows that the depth would be off by more than 0.025 mm, finer pieces of the path are stored beside the rows.
#[derive(Debug, Clone, PartialEq)]
pub struct PathTable {
    /// The size of the mesh.
    pub size: MeshSize,
    /// The position of the stored coordinates `[0, 0, 0]`, LPS mm.
    pub origin_in_patient: [f32; 3],
    /// The length of a step of a stored coordinate, in mm.
    pub step_mm: f32,
    /// The depth between two rows, in mm. Row 0 is depth 0.
    pub row_mm: f32,
    /// The depth of the deepest voxel, in mm; the last row is the first one at least as deep.
    pub max_depth_mm: f32,
    /// Rows of `size.vertex_count()` stored positions.
    pub rows: Vec<[u16; 3]>,
    /// Finer pieces of some paths, sorted by the row before them.
    pub pieces: Vec<Piece>,
    /// The index of the first piece after each row, and finally the number of pieces.
    pub first_piece: Vec<u32>,
}

/// A straight piece of the path of a vertex between two rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// The vertex.
    pub vertex: u32,
    /// The depths at its ends, in mm; it applies to depths above the first, up to and including the second.
    pub depths_mm: [f32; 2],
    /// The stored positions of its ends.
    pub ends: [[u16; 3]; 2],
}

/// A mesh at a depth.
#[derive(Debug, Clone, PartialEq)]
pub struct ShrunkMesh {
    /// Its depth: the requested depth, clamped to 0 and the greatest depth.
    pub depth_mm: f32,
    /// The vertices in LPS mm, in the order of [`MeshSize::vertex_count`].
    pub positions_in_patient: Vec<[f32; 3]>,
}

impl PathTable {
    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.rows.len() / self.size.vertex_count()
    }

    /// Its memory in bytes.
    pub fn bytes(&self) -> usize {
        6 * self.rows.len() + size_of_val(&self.pieces[..]) + 4 * self.first_piece.len()
    }

    /// The mesh of the isosurface `depth_mm` below the envelope, clamped to 0 and the greatest depth.
    ///
    /// Each vertex is at the first point of its path that is deep enough; if there is none, at the end of the path.
    /// This reads two rows of the table and the few finer pieces.
    ///
    /// Source: the paper, section 3.2.
    pub fn shrink(&self, depth_mm: f32) -> ShrunkMesh {
        let depth_mm = depth_mm.max(0.0).min(self.max_depth_mm);
        let row = ((depth_mm / self.row_mm) as usize).min(self.row_count() - 2);
        let vertices = self.size.vertex_count();
        let [near, far] = [row, row + 1].map(|row| &self.rows[row * vertices..][..vertices]);
        let fraction = (depth_mm - row as f32 * self.row_mm) / self.row_mm;
        let mut positions = vec![[0.0; 3]; vertices];
        let scale = Scale {
            origin: self.origin_in_patient,
            step: self.step_mm,
            fraction,
        };
        interpolate(
            near.as_flattened(),
            far.as_flattened(),
            &scale,
            positions.as_flattened_mut(),
        );
        let pieces = self.first_piece[row] as usize..self.first_piece[row + 1] as usize;
        for piece in &self.pieces[pieces] {
            let [start, end] = piece.depths_mm;
            if depth_mm > start && depth_mm <= end {
                let fraction = (depth_mm - start) / (end - start);
                let scale = Scale { fraction, ..scale };
                let position = &mut positions[piece.vertex as usize];
                interpolate(&piece.ends[0], &piece.ends[1], &scale, position);
            }
        }
        ShrunkMesh {
            depth_mm,
            positions_in_patient: positions,
        }
    }
}

impl PathTable {
    /// For each row, how many vertices of the mesh at its depth are shallower than that: [`ShrunkMesh::shallow_count`].
    pub fn shallow_counts(&self, field: &DepthField) -> Vec<usize> {
        let of_row = |row| self.shrink(row as f32 * self.row_mm).shallow_count(field);
        (0..self.row_count()).into_par_iter().map(of_row).collect()
    }
}

/// How much shallower than its mesh a vertex may be, in mm: more than the error of a path.
const SHALLOWER_MM: f32 = 0.1;

impl ShrunkMesh {
    /// The vertices whose depth is unknown, because what cuts the brain is nearer than any dura; `field` is the depth that the mesh was
    /// made with.
    pub fn unknown_vertices(&self, field: &DepthField) -> Vec<usize> {
        let is_unknown = |position: &[f32; 3]| {
            let position = Vec3::from_array(*position).as_dvec3();
            !field.is_known(position, self.depth_mm)
        };
        let vertices = self.positions_in_patient.iter().enumerate();
        vertices
            .filter(|(_, position)| is_unknown(position))
            .map(|(vertex, _)| vertex)
            .collect()
    }

    /// How many vertices are shallower than the mesh, because their paths end before its depth.
    pub fn shallow_count(&self, field: &DepthField) -> usize {
        self.shallow_vertices(field).count()
    }

    /// The vertices that are shallower than the mesh.
    pub fn shallow_vertices(&self, field: &DepthField) -> impl Iterator<Item = usize> {
        let voxel_from_patient = field.grid().voxel_from_patient();
        let is_shallow = move |position: &[f32; 3]| {
            let position = Vec3::from_array(*position).as_dvec3();
            let voxel = voxel_from_patient.transform_point3(position).as_vec3();
            field.depth_mm(voxel) < self.depth_mm - SHALLOWER_MM
        };
        let vertices = self.positions_in_patient.iter().enumerate();
        let shallow = vertices.filter(move |(_, position)| is_shallow(position));
        shallow.map(|(vertex, _)| vertex)
    }
}

/// The mapping from two rows of stored positions to positions in LPS mm.
#[derive(Clone, Copy)]
struct Scale {
    origin: [f32; 3],
    step: f32,
    fraction: f32,
}

/// Interpolates between the positions of two rows; all as x, y, z, x, y, z and so on.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn interpolate(near: &[u16], far: &[u16], scale: &Scale, out: &mut [f32]) {
    // Eight vertices at a time, so that the pattern of axes fits the registers.
    const LANES: usize = 24;
    let origin: [f32; LANES] = std::array::from_fn(|lane| scale.origin[lane % 3]);
    let chunks = near
        .chunks(LANES)
        .zip(far.chunks(LANES))
        .zip(out.chunks_mut(LANES));
    for ((near, far), out) in chunks {
        for (((out, &near), &far), origin) in out.iter_mut().zip(near).zip(far).zip(origin) {
            let (near, far) = (f32::from(near), f32::from(far));
            *out = origin + scale.step * (near + (far - near) * scale.fraction);
        }
    }
}

/// Follows the path of every vertex and tabulates its position at every depth.
pub fn path_table(
    mesh: &EnvelopeMesh,
    distance: &DistanceMap,
    field: &DepthField,
    paths: Paths<'_>,
) -> PathTable {
    let walker = Walker::new(distance, field, paths);
    let frame = Frame::new(distance);
    let ways = mesh.positions_in_voxel.par_iter().enumerate();
    let columns: Vec<Column> = ways
        .map(|(vertex, &start)| frame.tabulate(&walker, vertex as u32, start))
        .collect();
    let mut rows = Vec::with_capacity(frame.row_count * columns.len());
    for row in 0..frame.row_count {
        rows.extend(columns.iter().map(|column| column.positions[row]));
    }
    let mut pieces: Vec<_> = columns
        .into_iter()
        .flat_map(|column| column.pieces)
        .collect();
    pieces.sort_by_key(|&(row, piece)| (row, piece.vertex));
    let first_piece = (0..=frame.row_count)
        .map(|row| {
            pieces.partition_point(|&(row_of_piece, _)| (row_of_piece as usize) < row) as u32
        })
        .collect();
    PathTable {
        size: mesh.size,
        origin_in_patient: frame.origin_in_patient,
        step_mm: frame.step_mm,
        row_mm: frame.row_mm,
        max_depth_mm: frame.max_depth_mm,
        rows,
        pieces: pieces.into_iter().map(|(_, piece)| piece).collect(),
        first_piece,
    }
}

/// The mesh at one depth, without a table, for meshes with too large a table.
pub fn shrink_once(
    mesh: &EnvelopeMesh,
    distance: &DistanceMap,
    field: &DepthField,
    paths: Paths<'_>,
    depth_mm: f32,
) -> ShrunkMesh {
    let walker = Walker::new(distance, field, paths);
    let depth_mm = depth_mm.max(0.0).min(distance.max_depth_mm());
    let patient_from_voxel = distance.grid().patient_from_voxel();
    let shrink = |&start: &Vec3| {
        let position = first_deep_enough(&walker, start, depth_mm);
        patient_from_voxel
            .transform_point3(position.as_dvec3())
            .as_vec3()
            .to_array()
    };
    let positions_in_patient = mesh.positions_in_voxel.par_iter().map(shrink).collect();
    ShrunkMesh {
        depth_mm,
        positions_in_patient,
    }
}

/// The first point of the path of a vertex that is at least `depth_mm` deep, or the end of the path.
fn first_deep_enough(walker: &Walker, start: Vec3, depth_mm: f32) -> Vec3 {
    if depth_mm == 0.0 {
        return start;
    }
    let mut previous = None;
    for corner in walker.way(start) {
        if corner.depth_mm >= depth_mm {
            let from = previous.unwrap_or(corner);
            let mut segment = Segment::new(from, corner);
            let place = segment.reaching(walker.field(), depth_mm);
            return segment.at(place);
        }
        previous = Some(corner);
    }
    previous.map_or(start, |end| end.position)
}

/// The encoding of positions and depths.
struct Frame {
    /// Stored steps per voxel.
    steps_per_voxel: f32,
    origin_in_patient: [f32; 3],
    step_mm: f32,
    row_mm: f32,
    row_count: usize,
    max_depth_mm: f32,
}

/// One vertex at every depth.
struct Column {
    positions: Vec<[u16; 3]>,
    pieces: Vec<(u32, Piece)>,
}

impl Frame {
    fn new(distance: &DistanceMap) -> Self {
        let grid = distance.grid();
        let longest = grid.size().into_iter().max().unwrap_or(1) as f32;
        let steps_per_voxel = f32::from(u16::MAX) / longest;
        let spacing_mm = grid.spacing_mm()[0] as f32;
        let row_mm = ROW_VOXELS * spacing_mm;
        let max_depth_mm = distance.max_depth_mm();
        Self {
            steps_per_voxel,
            origin_in_patient: grid.patient_from_voxel().translation.as_vec3().to_array(),
            step_mm: spacing_mm / steps_per_voxel,
            row_mm,
            row_count: (max_depth_mm / row_mm).ceil().max(1.0) as usize + 1,
            max_depth_mm,
        }
    }

    fn stored(&self, position: Vec3) -> [u16; 3] {
        (position * self.steps_per_voxel + 0.5)
            .to_array()
            .map(|coordinate| coordinate as u16)
    }

    /// Follows the path of one vertex and notes where it first reaches the depth of each row.
    fn tabulate(&self, walker: &Walker, vertex: u32, start: Vec3) -> Column {
        let mut way = walker.way(start);
        let first = way.next().unwrap_or(Corner {
            position: start,
            depth_mm: 0.0,
        });
        let mut column = Tabulation {
            frame: self,
            field: walker.field(),
            vertex,
            trail: vec![first],
            column: Column {
                positions: vec![self.stored(start)],
                pieces: Vec::new(),
            },
        };
        for corner in way {
            if column.row() + 1 == self.row_count {
                break;
            }
            column.walk_to(corner);
        }
        column.rest()
    }
}

/// The column of a vertex under construction.
struct Tabulation<'a> {
    frame: &'a Frame,
    field: &'a DepthField,
    vertex: u32,
    /// The path since the last row was reached.
    trail: Vec<Corner>,
    column: Column,
}

impl Tabulation<'_> {
    /// The last row reached.
    fn row(&self) -> usize {
        self.column.positions.len() - 1
    }

    fn depth_of_row(&self, row: usize) -> f32 {
        row as f32 * self.frame.row_mm
    }

    fn walk_to(&mut self, corner: Corner) {
        let mut segment = Segment::new(self.trail[self.trail.len() - 1], corner);
        self.trail.push(corner);
        let mut is_within_segment = false;
        while self.row() + 1 < self.frame.row_count {
            let [near, far] = [self.row(), self.row() + 1].map(|row| self.depth_of_row(row));
            if corner.depth_mm < far {
                break;
            }
            let place = segment.reaching(self.field, far);
            let reached = segment.at(place);
            // Between two rows on one segment the depth is a known cubic; across a bend it must be sampled.
            if !(is_within_segment && segment.is_straight(place, [near, far], ROW_TOLERANCE_MM)) {
                self.refine([near, far], [self.trail[0].position, reached], true);
            }
            segment.start_at(place, far);
            self.column.positions.push(self.frame.stored(reached));
            self.trail.clear();
            self.trail.extend([
                Corner {
                    position: reached,
                    depth_mm: far,
                },
                corner,
            ]);
            is_within_segment = true;
        }
    }

    /// Places the vertex at the end of the path for every row that it did not reach.
    fn rest(mut self) -> Column {
        if self.row() + 1 < self.frame.row_count {
            let [near, far] = [self.row(), self.row() + 1].map(|row| self.depth_of_row(row));
            let end = self.trail[self.trail.len() - 1].position;
            let deepest = self
                .trail
                .iter()
                .map(|corner| corner.depth_mm)
                .fold(near, f32::max);
            if deepest - near > FINEST_STEP_MM {
                let reached = self.first_reaching(deepest);
                self.refine([near, deepest], [self.trail[0].position, reached], false);
            }
            self.keep([deepest, far], [end, end]);
            self.column
                .positions
                .resize(self.frame.row_count, self.frame.stored(end));
        }
        self.column
    }

    /// The first point of the trail that is at least `depth_mm` deep.
    fn first_reaching(&self, depth_mm: f32) -> Vec3 {
        let later = &self.trail[1..];
        let corner = later.iter().position(|corner| corner.depth_mm >= depth_mm);
        let corner = corner.unwrap_or(later.len() - 1);
        let mut segment = Segment::new(self.trail[corner], later[corner]);
        let place = segment.reaching(self.field, depth_mm);
        segment.at(place)
    }

    /// Splits the path between two depths until straight pieces match its depth; a single piece for a whole row is not
    /// stored.
    fn refine(&mut self, depths_mm: [f32; 2], ends: [Vec3; 2], is_whole_row: bool) {
        let [near, far] = depths_mm;
        if self.is_straight(depths_mm, ends) {
            if !is_whole_row {
                self.keep(depths_mm, ends);
            }
        } else if far - near <= FINEST_STEP_MM {
            // The path jumps: it gets shallower, and continues where it reaches this depth again.
            self.keep(depths_mm, [ends[1]; 2]);
        } else {
            let middle = (near + far) / 2.0;
            let reached = self.first_reaching(middle);
            self.refine([near, middle], [ends[0], reached], false);
            self.refine([middle, far], [reached, ends[1]], false);
        }
    }

    /// Whether the depth along the straight line between two points is linear to within the tolerance.
    ///
    /// The longer the line relative to its depth range, the more samples are compared.
    fn is_straight(&self, [near, far]: [f32; 2], [start, end]: [Vec3; 2]) -> bool {
        let detour = start.distance(end) * self.field.spacing_mm() / (far - near);
        let samples = if detour < 4.0 { 3 } else { 15 };
        (1..=samples).all(|sample| {
            let fraction = sample as f32 / (samples + 1) as f32;
            let depth = self.field.depth_mm(start.lerp(end, fraction));
            (depth - near - (far - near) * fraction).abs() <= ROW_TOLERANCE_MM
        })
    }

    fn keep(&mut self, depths_mm: [f32; 2], ends: [Vec3; 2]) {
        let ends = ends.map(|end| self.frame.stored(end));
        let piece = Piece {
            vertex: self.vertex,
            depths_mm,
            ends,
        };
        self.column.pieces.push((self.row() as u32, piece));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Core, Forest, core, distance_map, envelope, envelope_mesh, forest, phantom};

    struct Case {
        distance: DistanceMap,
        field: DepthField,
        core: Core,
        forest: Forest,
    }

    fn case(brain: &crate::BrainMask) -> Case {
        let distance = distance_map(&envelope(brain, 4.0).unwrap());
        let field = DepthField::new(&distance);
        let core = core(&distance);
        let forest = forest(&distance, &core);
        Case {
            distance,
            field,
            core,
            forest,
        }
    }

    fn cases() -> [Case; 3] {
        [
            case(&phantom::ball(22.0)),
            case(&phantom::ellipsoid([34.0, 22.0, 18.0], 0.8)),
            case(&phantom::two_lobes([18.0, 15.0], 30.0, 8.0)),
        ]
    }

    fn in_voxel(case: &Case, positions: &[[f32; 3]]) -> Vec<Vec3> {
        let voxel_from_patient = case.distance.grid().voxel_from_patient();
        let convert = |&position: &[f32; 3]| {
            voxel_from_patient
                .transform_point3(Vec3::from_array(position).as_dvec3())
                .as_vec3()
        };
        positions.iter().map(convert).collect()
    }

    #[test]
    fn a_vertex_is_at_the_depth_asked_for_wherever_its_path_reaches_it() {
        for case in cases() {
            let mesh = envelope_mesh(&case.field, MeshSize::new(20, 24).unwrap()).unwrap();
            for paths in [Paths::Forest(&case.forest), Paths::Flow] {
                let table = path_table(&mesh, &case.distance, &case.field, paths);
                let walker = Walker::new(&case.distance, &case.field, paths);
                let reaches = |start: &Vec3| {
                    walker
                        .way(*start)
                        .map(|corner| corner.depth_mm)
                        .fold(0.0, f32::max)
                };
                let reach: Vec<f32> = mesh.positions_in_voxel.iter().map(reaches).collect();
                for step in 0..400 {
                    let depth = step as f32 * 0.0517;
                    let shrunk = table.shrink(depth);
                    for (vertex, &position) in in_voxel(&case, &shrunk.positions_in_patient)
                        .iter()
                        .enumerate()
                    {
                        let there = case.field.depth_mm(position);
                        if depth <= reach[vertex] {
                            assert!((there - depth).abs() <= 0.05, "{there} for {depth}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_table_agrees_with_a_walk_for_one_depth() {
        for case in cases() {
            let mesh = envelope_mesh(&case.field, MeshSize::new(9, 12).unwrap()).unwrap();
            for paths in [Paths::Forest(&case.forest), Paths::Flow] {
                let table = path_table(&mesh, &case.distance, &case.field, paths);
                for depth in [0.0, 2.7, 6.0, 9.9, 14.2, 400.0] {
                    let (tabulated, walked) = (
                        table.shrink(depth),
                        shrink_once(&mesh, &case.distance, &case.field, paths, depth),
                    );
                    assert_eq!(tabulated.depth_mm, walked.depth_mm);
                    let pairs = tabulated
                        .positions_in_patient
                        .iter()
                        .zip(&walked.positions_in_patient);
                    let apart: Vec<f32> = pairs
                        .map(|(a, b)| Vec3::from_array(*a).distance(Vec3::from_array(*b)))
                        .collect();
                    // Along a ridge or the surface, 0.01 mm of depth is a long distance.
                    let close = apart.iter().filter(|&&apart| apart < 0.1).count();
                    assert!(
                        close * 100 >= apart.len() * 85,
                        "{depth}: {close} of {}",
                        apart.len()
                    );
                }
            }
        }
    }

    #[test]
    fn depth_zero_is_the_envelope_mesh() {
        let case = &cases()[1];
        let mesh = envelope_mesh(&case.field, MeshSize::STANDARD).unwrap();
        let table = path_table(
            &mesh,
            &case.distance,
            &case.field,
            Paths::Forest(&case.forest),
        );
        for depth in [0.0, -3.0, f32::NAN] {
            let shrunk = table.shrink(depth);
            assert_eq!(shrunk.depth_mm, 0.0);
            let positions = in_voxel(case, &shrunk.positions_in_patient);
            for (position, expected) in positions.iter().zip(&mesh.positions_in_voxel) {
                assert!(position.distance(*expected) < 0.01);
            }
        }
    }

    #[test]
    fn beyond_its_roots_depth_a_vertex_rests_at_the_root() {
        for case in cases() {
            let mesh = envelope_mesh(&case.field, MeshSize::new(12, 16).unwrap()).unwrap();
            let table = path_table(
                &mesh,
                &case.distance,
                &case.field,
                Paths::Forest(&case.forest),
            );
            let shrunk = table.shrink(f32::INFINITY);
            assert_eq!(shrunk.depth_mm, case.distance.max_depth_mm());
            for position in in_voxel(&case, &shrunk.positions_in_patient) {
                let nearest = position.round().to_array().map(|place| place as usize);
                let index = case.distance.grid().index(nearest) as u32;
                assert!(case.core.voxels().contains(&index), "{position}");
            }
        }
    }

    #[test]
    fn vertices_that_are_not_at_the_depth_of_their_mesh_are_counted() {
        for case in cases() {
            let mesh = envelope_mesh(&case.field, MeshSize::new(12, 16).unwrap()).unwrap();
            let paths = Paths::Forest(&case.forest);
            let table = path_table(&mesh, &case.distance, &case.field, paths);
            assert_eq!(table.shrink(4.0).shallow_count(&case.field), 0);
            // At the greatest depth only the roots there are deep enough.
            let deepest = table.shrink(f32::INFINITY);
            let expected = in_voxel(&case, &deepest.positions_in_patient)
                .into_iter()
                .filter(|&place| case.field.depth_mm(place) < deepest.depth_mm - 0.1)
                .count();
            assert_eq!(deepest.shallow_count(&case.field), expected);
            assert_eq!(deepest.unknown_vertices(&case.field), []);
            let counts = table.shallow_counts(&case.field);
            assert_eq!((counts.len(), counts[0]), (table.row_count(), 0));
            assert_eq!(counts[table.row_count() - 1], expected);
        }
        // An ellipsoid of which a face of the volume takes the lower half.
        let whole = phantom::ellipsoid([34.0, 22.0, 18.0], 1.0);
        let grid = whole.mask().grid();
        let [nx, ny, nz] = grid.size();
        let seen = grid
            .block([0, 0, nz as i64 / 2], [nx, ny, nz - nz / 2])
            .unwrap();
        let inside = whole.mask().voxels().iter().enumerate();
        let inside = inside.map(|(index, &is)| is && grid.voxel(index)[2] >= nz / 2);
        let half = crate::Mask::new(grid.clone(), inside.collect()).unwrap();
        let brain = crate::BrainMask::from_mask(&half, &seen).unwrap();
        let cuts = brain.cuts(&seen);
        let distance = distance_map(&crate::cut_envelope(&brain, 4.0, &cuts).unwrap());
        let field = DepthField::new(&distance);
        let mesh = envelope_mesh(&field, MeshSize::new(20, 24).unwrap()).unwrap();
        let shrunk = path_table(&mesh, &distance, &field, Paths::Flow).shrink(5.0);
        let unknown = shrunk.unknown_vertices(&field);
        let expected: Vec<usize> = (0..shrunk.positions_in_patient.len())
            .filter(|&vertex| {
                let height_mm =
                    f64::from(shrunk.positions_in_patient[vertex][2]) - cuts[0].offset_mm;
                height_mm < 5.0 + 1.5
            })
            .collect();
        assert_eq!(unknown, expected);
        assert!(unknown.len() > 50, "{}", unknown.len());
    }

    #[test]
    fn flow_keeps_nearer_to_the_envelope_than_the_forest() {
        let case = &cases()[1];
        let mesh = envelope_mesh(&case.field, MeshSize::STANDARD).unwrap();
        let start = path_table(&mesh, &case.distance, &case.field, Paths::Flow).shrink(0.0);
        let way_to = |paths, depth: f32| -> f32 {
            let shrunk = path_table(&mesh, &case.distance, &case.field, paths).shrink(depth);
            let ends = shrunk
                .positions_in_patient
                .iter()
                .zip(&start.positions_in_patient);
            let apart = ends.map(|(a, b)| Vec3::from_array(*a).distance(Vec3::from_array(*b)));
            apart.sum::<f32>() / mesh.size.vertex_count() as f32
        };
        let (flow, forest) = (
            way_to(Paths::Flow, 6.0),
            way_to(Paths::Forest(&case.forest), 6.0),
        );
        // A vertex moves at least as far as its depth grows.
        assert!(
            (5.99..6.8).contains(&flow) && flow < forest,
            "{flow} {forest}"
        );
    }

    #[test]
    fn the_exact_search_finds_the_nearest_voxel_that_is_deep_enough() {
        let case = &cases()[2];
        let pyramid = crate::deepest_first::DepthPyramid::new(&case.distance);
        let grid = case.distance.grid();
        let centres = |least: f32| {
            (0..grid.voxel_count())
                .filter(move |&index| {
                    case.distance
                        .depth_mm(index)
                        .is_some_and(|depth| depth >= least)
                })
                .map(|index| Vec3::from_array(grid.voxel(index).map(|place| place as f32)))
        };
        for (start, least) in [
            ([10.2, 14.0, 9.7], 6.0),
            ([40.0, 11.3, 20.1], 12.0),
            ([5.0, 5.0, 5.0], 1.0),
        ] {
            let start = Vec3::from_array(start);
            let found = pyramid.nearest_deeper(start, least).unwrap();
            let nearest = centres(least)
                .map(|centre| centre.distance(start))
                .fold(f32::INFINITY, f32::min);
            assert!((found.distance(start) - nearest).abs() < 0.01);
        }
        assert_eq!(pyramid.nearest_deeper(Vec3::ZERO, 1000.0), None);
    }
}
