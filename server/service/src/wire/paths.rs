//! The table of all depths.

use bytes::Bytes;
use geometry::{PathTable, Piece};

use cases::models::PathKind;

const MAGIC: &[u8; 4] = b"ISOP";
const VERSION: u16 = 2;
const HEADER_LENGTH: usize = 56;
const PIECE_LENGTH: usize = 24;

/// The vertices of a table that are not at the depth of their mesh.
#[derive(Debug, Default)]
pub struct Astray {
    /// How many start on a cut.
    pub unknown: usize,
    /// For each row, how many are shallower, because their paths end before.
    pub shallow: Vec<usize>,
}

/// A table of paths in the layout of the README: header, finer pieces, three planes of differences, and counts.
pub fn paths(table: &PathTable, kind: PathKind, astray: &Astray) -> Bytes {
    let pieces = 4 * table.first_piece.len() + PIECE_LENGTH * table.pieces.len();
    let mut file = Vec::with_capacity(
        HEADER_LENGTH + pieces + 6 * table.rows.len() + 4 * astray.shallow.len(),
    );
    write_header(&mut file, table, kind, astray.unknown);
    let first_piece = table.first_piece.iter();
    file.extend(first_piece.flat_map(|number| number.to_le_bytes()));
    for piece in &table.pieces {
        write_piece(&mut file, piece);
    }
    for axis in 0..3 {
        write_plane(&mut file, &table.rows, table.size.vertex_count(), axis);
    }
    let shallow = astray.shallow.iter();
    file.extend(shallow.flat_map(|&count| (count as u32).to_le_bytes()));
    file.into()
}

fn write_header(file: &mut Vec<u8>, table: &PathTable, kind: PathKind, unknown_vertices: usize) {
    let kind: u16 = match kind {
        PathKind::Forest => 0,
        PathKind::Flow => 1,
    };
    let counts = [
        table.size.contour_count(),
        table.size.points_per_contour(),
        table.size.vertex_count(),
        table.row_count(),
        table.pieces.len(),
    ];
    let [x, y, z] = table.origin_in_patient;
    let numbers = [x, y, z, table.step_mm, table.row_mm, table.max_depth_mm];
    file.extend_from_slice(MAGIC);
    file.extend_from_slice(&VERSION.to_le_bytes());
    file.extend_from_slice(&kind.to_le_bytes());
    file.extend(
        counts
            .iter()
            .flat_map(|&count| (count as u32).to_le_bytes()),
    );
    file.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    file.extend_from_slice(&(unknown_vertices as u32).to_le_bytes());
}

fn write_piece(file: &mut Vec<u8>, piece: &Piece) {
    file.extend_from_slice(&piece.vertex.to_le_bytes());
    file.extend(piece.depths_mm.iter().flat_map(|mm| mm.to_le_bytes()));
    let ends = piece.ends.iter().flatten();
    file.extend(ends.flat_map(|coordinate| coordinate.to_le_bytes()));
}

/// One coordinate of every row, as the difference from the row before.
fn write_plane(file: &mut Vec<u8>, rows: &[[u16; 3]], vertices: usize, axis: usize) {
    let first = rows[..vertices].iter().map(|position| position[axis]);
    let later = rows.iter().zip(&rows[vertices..]);
    let differences = later.map(|(before, position)| position[axis].wrapping_sub(before[axis]));
    file.extend(first.chain(differences).flat_map(u16::to_le_bytes));
}

#[cfg(test)]
mod tests {
    use geometry::MeshSize;

    use super::super::fixture::{f32_at, u32_at};
    use super::*;

    fn table() -> PathTable {
        let size = MeshSize::new(3, 4).unwrap();
        let vertices = size.vertex_count() as u16;
        let position =
            |row: u16, vertex: u16| [row * 7 + vertex, 60_000 - row * 9, (vertex * 3) ^ row];
        PathTable {
            size,
            origin_in_patient: [-1.0, 2.0, -3.0],
            step_mm: 0.01,
            row_mm: 0.5,
            max_depth_mm: 1.75,
            rows: (0..5)
                .flat_map(|row| (0..vertices).map(move |vertex| position(row, vertex)))
                .collect(),
            pieces: vec![Piece {
                vertex: 6,
                depths_mm: [0.625, 0.75],
                ends: [[1, 2, 3], [4, 5, 6]],
            }],
            first_piece: vec![0, 0, 1, 1, 1, 1],
        }
    }

    /// Reads the planes as the README tells a client to.
    fn positions_of(file: &[u8]) -> Vec<[u16; 3]> {
        let [vertices, rows, pieces] = [16, 20, 24].map(|offset| u32_at(file, offset) as usize);
        let start = HEADER_LENGTH + 4 * (rows + 1) + PIECE_LENGTH * pieces;
        assert_eq!(file.len(), start + (6 * vertices + 4) * rows);
        let mut positions = vec![[0u16; 3]; rows * vertices];
        let count = positions.len();
        for (axis, index) in (0..3).flat_map(|axis| (0..count).map(move |index| (axis, index))) {
            let offset = start + 2 * (axis * count + index);
            let stored = u16::from_le_bytes([file[offset], file[offset + 1]]);
            let before = index.checked_sub(vertices);
            let before = before.map_or(0, |before| positions[before][axis]);
            positions[index][axis] = stored.wrapping_add(before);
        }
        positions
    }

    #[test]
    fn a_client_that_follows_the_readme_gets_the_table_back() {
        let table = table();
        let astray = Astray {
            unknown: 7,
            shallow: vec![0, 0, 2, 5, 13],
        };
        let file = paths(&table, PathKind::Flow, &astray);
        assert_eq!(&file[..4], MAGIC);
        assert_eq!(file[6], 1);
        assert_eq!(
            [8, 12, 16, 20, 24].map(|offset| u32_at(&file, offset)),
            [3, 4, 14, 5, 1]
        );
        assert_eq!(
            [28, 32, 36].map(|offset| f32_at(&file, offset)),
            table.origin_in_patient
        );
        assert_eq!(
            [40, 44, 48].map(|offset| f32_at(&file, offset)),
            [0.01, 0.5, 1.75]
        );
        let pieces = HEADER_LENGTH + 4 * 6;
        assert_eq!(u32_at(&file, HEADER_LENGTH + 8), 1);
        assert_eq!(u32_at(&file, pieces), 6);
        assert_eq!(f32_at(&file, pieces + 8), 0.75);
        assert_eq!(file[pieces + 12..pieces + 14], [1, 0]);
        assert_eq!(u32_at(&file, 52), 7);
        assert_eq!(positions_of(&file), table.rows);
        let counts = [5, 4, 3, 2, 1].map(|back| u32_at(&file, file.len() - 4 * back));
        assert_eq!(counts, [0, 0, 2, 5, 13]);
    }
}
