//! A NIfTI-1 writer of the tests' own, so that files can be made in any orientation, and wrong on purpose.

use std::io::Write as _;

/// What a file holds, field by field of NIfTI-1.
#[derive(Debug, Clone)]
pub(crate) struct Nifti {
    pub(crate) size: [i16; 3],
    /// Rows of the sform: voxel to RAS mm.
    pub(crate) ras_from_voxel: [[f32; 4]; 3],
    pub(crate) slope: f32,
    pub(crate) data: Data,
}

/// Voxels, x-fastest.
#[derive(Debug, Clone)]
pub(crate) enum Data {
    I16(Vec<i16>),
    U8(Vec<u8>),
}

impl Nifti {
    /// An uncompressed file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let (kind, bits, voxels): (i16, i16, Vec<u8>) = match &self.data {
            Data::U8(values) => (2, 8, values.clone()),
            Data::I16(values) => (4, 16, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        let mut file = vec![0u8; 352];
        let mut put = |offset: usize, bytes: &[u8]| {
            file[offset..offset + bytes.len()].copy_from_slice(bytes);
        };
        put(0, &348i32.to_le_bytes());
        put(40, &3i16.to_le_bytes());
        for axis in 0..3 {
            put(42 + 2 * axis, &self.size[axis].to_le_bytes());
            let column = [0, 1, 2].map(|row| self.ras_from_voxel[row][axis]);
            let edge = column.iter().map(|x| x * x).sum::<f32>().sqrt();
            put(80 + 4 * axis, &edge.to_le_bytes());
        }
        for axis in 3..7 {
            put(42 + 2 * axis, &1i16.to_le_bytes());
        }
        put(70, &kind.to_le_bytes());
        put(72, &bits.to_le_bytes());
        put(76, &1f32.to_le_bytes());
        put(108, &352f32.to_le_bytes());
        put(112, &self.slope.to_le_bytes());
        put(123, &[2]);
        put(254, &1i16.to_le_bytes());
        for (row, offset) in self.ras_from_voxel.iter().zip([280, 296, 312]) {
            for (column, value) in row.iter().enumerate() {
                put(offset + 4 * column, &value.to_le_bytes());
            }
        }
        put(344, b"n+1\0");
        file.extend(voxels);
        file
    }
}

/// gzip of a file.
pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}
