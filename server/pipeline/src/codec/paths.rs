//! A table of paths, encoded as steps from each depth to the next, with its finer pieces.

use geometry::{MeshSize, PathTable, Piece};

use super::bytes::Reader;
use super::residuals::{put_residuals, read_residuals};

/// Bytes of a finer piece: a vertex, two depths and two positions.
const PIECE_LENGTH: usize = 24;

/// The payload of a table of paths.
pub fn encode_paths(table: &PathTable) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(6 * table.rows.len() + PIECE_LENGTH * table.pieces.len());
    bytes.extend((table.size.contour_count() as u16).to_le_bytes());
    bytes.extend((table.size.points_per_contour() as u16).to_le_bytes());
    let [x, y, z] = table.origin_in_patient;
    for number in [x, y, z, table.step_mm, table.row_mm, table.max_depth_mm] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend((table.row_count() as u32).to_le_bytes());
    for first in &table.first_piece {
        bytes.extend(first.to_le_bytes());
    }
    for piece in &table.pieces {
        put_piece(&mut bytes, piece);
    }
    let (rows, vertices) = (&table.rows, table.size.vertex_count());
    for axis in 0..3 {
        let steps = (0..rows.len()).map(|at| {
            let before = at
                .checked_sub(vertices)
                .map_or(0, |above| rows[above][axis]);
            rows[at][axis].wrapping_sub(before)
        });
        put_residuals(&mut bytes, steps);
    }
    bytes
}

/// The table of paths from a payload; `None` if it is damaged.
pub fn decode_paths(bytes: &[u8]) -> Option<PathTable> {
    let mut reader = Reader(bytes);
    let size = MeshSize::new(usize::from(reader.u16()?), usize::from(reader.u16()?)).ok()?;
    let origin_in_patient = [reader.f32()?, reader.f32()?, reader.f32()?];
    let [step_mm, row_mm, max_depth_mm] = [reader.f32()?, reader.f32()?, reader.f32()?];
    // A depth lies between two rows.
    let row_count = usize::try_from(reader.u32()?)
        .ok()
        .filter(|&rows| rows >= 2)?;
    let first_piece = read_first_pieces(&mut reader, row_count)?;
    let piece_count = usize::try_from(*first_piece.last()?).ok()?;
    let pieces = read_pieces(&mut reader, piece_count, size.vertex_count())?;
    let rows = read_rows(reader, row_count, size.vertex_count())?;
    Some(PathTable {
        size,
        origin_in_patient,
        step_mm,
        row_mm,
        max_depth_mm,
        rows,
        pieces,
        first_piece,
    })
}

fn put_piece(bytes: &mut Vec<u8>, piece: &Piece) {
    bytes.extend(piece.vertex.to_le_bytes());
    for depth in piece.depths_mm {
        bytes.extend(depth.to_le_bytes());
    }
    for coordinate in piece.ends.as_flattened() {
        bytes.extend(coordinate.to_le_bytes());
    }
}

fn read_first_pieces(reader: &mut Reader<'_>, row_count: usize) -> Option<Vec<u32>> {
    let bytes = reader.take(row_count.checked_add(1)?.checked_mul(4)?)?;
    let mut reader = Reader(bytes);
    let first_piece: Vec<u32> = (0..=row_count).map_while(|_| reader.u32()).collect();
    (first_piece.is_sorted() && first_piece[0] == 0).then_some(first_piece)
}

fn read_pieces(reader: &mut Reader<'_>, count: usize, vertices: usize) -> Option<Vec<Piece>> {
    let mut reader = Reader(reader.take(count.checked_mul(PIECE_LENGTH)?)?);
    (0..count)
        .map(|_| read_piece(&mut reader).filter(|piece| (piece.vertex as usize) < vertices))
        .collect()
}

fn read_piece(reader: &mut Reader<'_>) -> Option<Piece> {
    let vertex = reader.u32()?;
    let depths_mm = [reader.f32()?, reader.f32()?];
    let mut position = || Some([reader.u16()?, reader.u16()?, reader.u16()?]);
    Some(Piece {
        vertex,
        depths_mm,
        ends: [position()?, position()?],
    })
}

fn read_rows(mut reader: Reader<'_>, row_count: usize, vertices: usize) -> Option<Vec<[u16; 3]>> {
    let positions = row_count.checked_mul(vertices)?;
    if Some(reader.0.len()) != positions.checked_mul(6) {
        return None;
    }
    let mut rows = vec![[0; 3]; positions];
    #[expect(clippy::needless_range_loop, reason = "two rows are indexed by it")]
    for axis in 0..3 {
        for (at, step) in read_residuals(&mut reader, positions)?.enumerate() {
            let before = at
                .checked_sub(vertices)
                .map_or(0, |above| rows[above][axis]);
            rows[at][axis] = step.wrapping_add(before);
        }
    }
    Some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> PathTable {
        let size = MeshSize::new(3, 4).unwrap();
        let piece = |vertex| Piece {
            vertex,
            depths_mm: [0.25, 0.5],
            ends: [[1, 2, 3], [4, 5, u16::MAX]],
        };
        PathTable {
            size,
            origin_in_patient: [-1.0, 2.0, 0.25],
            step_mm: 0.01,
            row_mm: 0.5,
            max_depth_mm: 2.0,
            rows: (0..5 * size.vertex_count() as u16)
                .map(|at| [at.wrapping_mul(40_503), at, u16::MAX - at])
                .collect(),
            pieces: vec![piece(0), piece(13)],
            first_piece: vec![0, 0, 1, 1, 2, 2],
        }
    }

    #[test]
    fn a_table_comes_back_exactly() {
        let bytes = encode_paths(&table());
        assert_eq!(decode_paths(&bytes), Some(table()));
        for length in 0..bytes.len() {
            assert_eq!(decode_paths(&bytes[..length]), None, "{length}");
        }
    }

    #[test]
    fn a_table_that_would_be_read_beyond_its_ends_is_refused() {
        let mut beyond_vertices = table();
        beyond_vertices.pieces[1].vertex = 14;
        let mut beyond_pieces = table();
        beyond_pieces.first_piece[2] = 3;
        for bad in [beyond_vertices, beyond_pieces] {
            assert_eq!(decode_paths(&encode_paths(&bad)), None);
        }
    }
}
