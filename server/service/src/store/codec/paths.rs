//! A table of paths as the steps from each depth to the next.

use geometry::{MeshSize, PathTable};

use super::bytes::Reader;
use super::residuals::{put_residuals, read_residuals};

pub(crate) fn encode_paths(table: &PathTable) -> Vec<u8> {
    let vertices = table.size.vertex_count();
    let mut bytes = Vec::with_capacity(6 * table.rows.len() + 4 * vertices + 64);
    bytes.extend((table.size.contour_count() as u16).to_le_bytes());
    bytes.extend((table.size.points_per_contour() as u16).to_le_bytes());
    for number in table.origin_in_patient {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(table.step_mm.to_le_bytes());
    bytes.extend(table.row_mm.to_le_bytes());
    bytes.extend(((table.rows.len() / vertices) as u32).to_le_bytes());
    for depth in &table.rest_depth_mm {
        bytes.extend(depth.to_le_bytes());
    }
    let rows = &table.rows;
    for axis in 0..3 {
        let steps = (0..rows.len()).map(|at| {
            let before = if at < vertices {
                0
            } else {
                rows[at - vertices][axis]
            };
            rows[at][axis].wrapping_sub(before)
        });
        put_residuals(&mut bytes, steps);
    }
    bytes
}

pub(crate) fn decode_paths(bytes: &[u8]) -> Option<PathTable> {
    let mut reader = Reader(bytes);
    let size = MeshSize::new(usize::from(reader.u16()?), usize::from(reader.u16()?)).ok()?;
    let origin_in_patient = [reader.f32()?, reader.f32()?, reader.f32()?];
    let [step_mm, row_mm] = [reader.f32()?, reader.f32()?];
    let row_count = usize::try_from(reader.u32()?).ok()?;
    let vertices = size.vertex_count();
    let positions = vertices.checked_mul(row_count).filter(|_| row_count > 0)?;
    let resting = reader.take(4 * vertices)?;
    if Some(reader.0.len()) != positions.checked_mul(6) {
        return None;
    }
    let mut rows = vec![[0; 3]; positions];
    for axis in 0..3 {
        for (at, step) in read_residuals(&mut reader, positions)?.enumerate() {
            let before = if at < vertices {
                0
            } else {
                rows[at - vertices][axis]
            };
            rows[at][axis] = step.wrapping_add(before);
        }
    }
    Some(PathTable {
        size,
        origin_in_patient,
        step_mm,
        row_mm,
        rows,
        rest_depth_mm: read_depths(resting),
    })
}

fn read_depths(bytes: &[u8]) -> Vec<f32> {
    let depths = bytes.chunks_exact(4);
    depths
        .filter_map(|depth| depth.try_into().ok())
        .map(f32::from_le_bytes)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_comes_back_exactly() {
        let size = MeshSize::new(3, 4).unwrap();
        let vertices = size.vertex_count();
        let table = PathTable {
            size,
            origin_in_patient: [-1.0, 2.0, 0.25],
            step_mm: 0.01,
            row_mm: 0.5,
            rows: (0..5 * vertices as u16)
                .map(|at| [at.wrapping_mul(40_503), at, u16::MAX - at])
                .collect(),
            rest_depth_mm: (0..vertices).map(|vertex| vertex as f32 / 3.0).collect(),
        };
        let bytes = encode_paths(&table);
        assert_eq!(decode_paths(&bytes), Some(table));
        for length in 0..bytes.len() {
            assert_eq!(decode_paths(&bytes[..length]), None, "{length}");
        }
    }
}
