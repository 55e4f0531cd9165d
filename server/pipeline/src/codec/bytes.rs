//! Little-endian numbers and grids in and out of bytes.

use geometry::Grid;
use glam::{DAffine3, DMat3, DVec3};

/// Reads numbers from the front of a slice; `None` if it ends early.
#[derive(Debug)]
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl<'a> Reader<'a> {
    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (front, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(front)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn f32(&mut self) -> Option<f32> {
        self.array().map(f32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.array().map(f64::from_le_bytes)
    }

    /// A number of up to 32 bits, 7 in a byte.
    pub(super) fn leb128(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..32).step_by(7) {
            let [byte] = self.array()?;
            value |= u32::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    pub(super) fn grid(&mut self) -> Option<Grid> {
        let mut size = [0; 3];
        for side in &mut size {
            *side = usize::try_from(self.u32()?).ok()?;
        }
        let mut columns = [DVec3::ZERO; 4];
        for column in &mut columns {
            *column = DVec3::new(self.f64()?, self.f64()?, self.f64()?);
        }
        let affine = DAffine3 {
            matrix3: DMat3::from_cols(columns[0], columns[1], columns[2]),
            translation: columns[3],
        };
        Grid::new(size, affine).ok()
    }
}

pub(super) fn put_leb128(bytes: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

pub(super) fn put_grid(bytes: &mut Vec<u8>, grid: &Grid) {
    for side in grid.size() {
        // A grid has at most 2³⁰ voxels.
        bytes.extend((side as u32).to_le_bytes());
    }
    for number in grid.patient_from_voxel().to_cols_array() {
        bytes.extend(number.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        for value in [0, 1, 127, 128, 300, u32::MAX] {
            let mut bytes = Vec::new();
            put_leb128(&mut bytes, value);
            assert_eq!(Reader(&bytes).leb128(), Some(value));
            assert_eq!(Reader(&bytes[..bytes.len() - 1]).leb128(), None);
        }
    }

    #[test]
    fn a_grid_comes_back_exactly() {
        let affine = DAffine3::from_cols_array(&[
            0.1, 0.2, -1.0, 1.0, 0.1, 0.0, 0.0, 1.3, 0.1, 7.0, -8.0, 0.3,
        ]);
        let grid = Grid::new([3, 4, 5], affine).unwrap();
        let mut bytes = Vec::new();
        put_grid(&mut bytes, &grid);
        assert_eq!(Reader(&bytes).grid(), Some(grid));
        assert_eq!(Reader(&bytes[1..]).grid(), None);
    }
}
