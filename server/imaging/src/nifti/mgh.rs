//! MGH files, plain or gzipped (`.mgz`): their header as the header of NIfTI-2 that says the same. Their voxels follow it as those of NIfTI
//! do, the most significant byte first.
//!
//! A header without a valid orientation (`goodRASflag` 0) is read as FreeSurfer reads it: the axes point left, down and forwards, the voxels
//! have 1 mm, and the middle of the volume is the origin. Other programs assume something else (nibabel lets y point up), so that whoever reads
//! such a file must tell that its axes are assumed.
//!
//! Source: <https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat>.

use glam::{DMat3, DVec3};

use crate::ImagingError;

use super::start::LONGEST_HEADER;

/// Whether a header does not state the axes of its volume.
pub(super) fn assumes_axes(bytes: &[u8]) -> bool {
    i16::from_be_bytes([bytes[28], bytes[29]]) <= 0
}

/// The header of NIfTI-2 that says what the `MGH_HEADER` bytes say, but for the place of the voxels.
pub(super) fn as_nifti(bytes: &[u8]) -> Result<Vec<u8>, ImagingError> {
    let four = |at: usize| bytes[at..at + 4].try_into().expect("four bytes");
    let whole = |at: usize| i32::from_be_bytes(four(at));
    let vector = |at: usize| {
        DVec3::from_array([0, 4, 8].map(|next| f32::from_be_bytes(four(at + next)).into()))
    };
    let (code, bits) = match whole(20) {
        0 => (2, 8),
        1 => (8, 32),
        3 => (16, 32),
        4 => (4, 16),
        10 => (512, 16),
        code => return Err(ImagingError::MghDataType { code }),
    };
    let sides = [4, 8, 12, 16].map(|at| i64::from(whole(at)));
    let is_assumed = assumes_axes(bytes);
    let (edges, directions, centre) = match is_assumed {
        true => (
            DVec3::ONE,
            DMat3::from_cols(-DVec3::X, -DVec3::Z, DVec3::Y),
            DVec3::ZERO,
        ),
        false => (
            vector(30),
            DMat3::from_cols(vector(42), vector(54), vector(66)),
            vector(78),
        ),
    };
    let axes = directions * DMat3::from_diagonal(edges);
    let middle = DVec3::new(sides[0] as f64, sides[1] as f64, sides[2] as f64) / 2.0;
    let offset = centre - axes * middle;

    let mut header = vec![0; LONGEST_HEADER];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &(LONGEST_HEADER as u32).to_be_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &i16::to_be_bytes(code));
    put(14, &i16::to_be_bytes(bits));
    put(16, &4i64.to_be_bytes());
    for (axis, side) in sides.iter().enumerate() {
        put(24 + 8 * axis, &side.to_be_bytes());
    }
    // The space of the scanner, or none that is known.
    put(348, &(if is_assumed { 2i32 } else { 1 }).to_be_bytes());
    put(500, &2i32.to_be_bytes());
    for axis in 0..3 {
        put(112 + 8 * axis, &edges[axis].to_be_bytes());
        let row = [
            axes.x_axis[axis],
            axes.y_axis[axis],
            axes.z_axis[axis],
            offset[axis],
        ];
        for (column, number) in row.into_iter().enumerate() {
            put(400 + 32 * axis + 8 * column, &number.to_be_bytes());
        }
    }
    Ok(header)
}
