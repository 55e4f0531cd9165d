//! Writes gzipped NIfTI-1 files for other programs.
//!
//! Every file is little-endian, in millimetres, and placed by the sform (code 1) and, if the axes are orthogonal, also
//! by the qform. The affine is rounded to single precision. The same values give the same bytes.

use std::io::{Read as _, Write};

use flate2::read::GzDecoder;
use flate2::{Compression, GzBuilder, write::GzEncoder};
use geometry::{Grid, Mask, Rescale, Volume};

use crate::{ImagingError, Limits};

use super::affine::{Form, Placement};
use super::file::NiftiFile;

/// The offset of the voxels: after the header and four bytes that announce no extension.
const VOX_OFFSET: usize = 352;

/// Voxels converted at a time.
const CHUNK_VOXELS: usize = 32 << 10;

/// Codes of the written data types, and their bytes per voxel.
const UINT8: (i16, i16) = (2, 1);
const FLOAT32: (i16, i16) = (16, 4);
const INT16: (i16, i16) = (4, 2);
const UINT16: (i16, i16) = (512, 2);

/// The code of an extension that is text.
const COMMENT: i32 = 6;

/// The longest comment that is read.
const MAX_COMMENT_BYTES: usize = 1 << 20;

const UNSCALED: Rescale = Rescale {
    slope: 1.0,
    intercept: 0.0,
};

/// A mask as `.nii.gz` in 8 bits: 1 in the mask, 0 elsewhere.
///
/// # Errors
/// If a side has more than 32,767 voxels, the limit of NIfTI-1.
pub fn write_mask(mask: &Mask) -> Result<Vec<u8>, ImagingError> {
    let header = header(mask.grid(), UINT8, UNSCALED)?;
    pack(&header, mask.voxels(), |belongs, bytes| {
        bytes.push(u8::from(belongs));
    })
}

/// A volume as `.nii.gz`: its stored 16-bit values, with slope and intercept.
///
/// # Errors
/// If a side has more than 32,767 voxels, if the slope is zero, or if slope or intercept is not finite.
pub fn write_volume(volume: &Volume) -> Result<Vec<u8>, ImagingError> {
    let rescale = volume.rescale();
    let Rescale { slope, intercept } = rescale;
    if slope == 0.0 || !slope.is_finite() || !intercept.is_finite() {
        return Err(ImagingError::Unwritable { slope, intercept });
    }
    let header = header(volume.grid(), UINT16, rescale)?;
    pack(&header, volume.voxels(), |stored, bytes| {
        bytes.extend_from_slice(&stored.to_le_bytes());
    })
}

/// Numbers as `.nii.gz`, in single precision; NaN if a voxel has none.
///
/// # Errors
/// If a side has more than 32,767 voxels.
///
/// # Panics
/// If there is not one number for each voxel of the grid.
pub fn write_numbers(grid: &Grid, numbers: &[f32]) -> Result<Vec<u8>, ImagingError> {
    assert_eq!(
        numbers.len(),
        grid.voxel_count(),
        "one number for each voxel"
    );
    write_commented(grid, numbers, "")
}

/// The same with a comment, an extension with code 6.
pub(crate) fn write_commented(
    grid: &Grid,
    numbers: &[f32],
    comment: &str,
) -> Result<Vec<u8>, ImagingError> {
    let start = commented(header(grid, FLOAT32, UNSCALED)?, comment);
    pack(&start, numbers, |number, bytes| {
        bytes.extend_from_slice(&number.to_le_bytes());
    })
}

/// Samples as `.nii.gz`, with slope and intercept: in 16 bits if all are integers that fit, otherwise in single
/// precision.
///
/// # Errors
/// If a side has more than 32,767 voxels.
pub(crate) fn write_samples(
    grid: &Grid,
    samples: &[f32],
    rescale: Rescale,
) -> Result<Vec<u8>, ImagingError> {
    let all = |[least, greatest]: [f32; 2]| {
        let fits = |&sample: &f32| (least..=greatest).contains(&sample) && sample.fract() == 0.0;
        samples.iter().all(fits)
    };
    if all([0.0, 65535.0]) {
        let header = header(grid, UINT16, rescale)?;
        pack(&header, samples, |sample, bytes| {
            bytes.extend_from_slice(&(sample as u16).to_le_bytes());
        })
    } else if all([-32768.0, 32767.0]) {
        let header = header(grid, INT16, rescale)?;
        pack(&header, samples, |sample, bytes| {
            bytes.extend_from_slice(&(sample as i16).to_le_bytes());
        })
    } else {
        let header = header(grid, FLOAT32, rescale)?;
        pack(&header, samples, |sample, bytes| {
            bytes.extend_from_slice(&sample.to_le_bytes());
        })
    }
}

/// Labels as `.nii.gz` in 16 bits, 0 where there is none, with their names in a comment (an extension with code 6): a number, a
/// space and a name on each line. A line feed in a name is written as a space.
///
/// # Errors
/// If a side has more than 32,767 voxels.
///
/// # Panics
/// If there is not one label for each voxel of the grid.
pub fn write_labels(
    grid: &Grid,
    labels: &[u16],
    names: &[(u16, &str)],
) -> Result<Vec<u8>, ImagingError> {
    assert_eq!(labels.len(), grid.voxel_count(), "one label for each voxel");
    let names = names
        .iter()
        .map(|(number, name)| format!("{number} {}\n", name.replace('\n', " ")));
    let comment = names.collect::<String>();
    let start = commented(header(grid, UINT16, UNSCALED)?, &comment);
    pack(&start, labels, |label, bytes| {
        bytes.extend_from_slice(&label.to_le_bytes());
    })
}

/// A header with a comment, unless that is empty.
fn commented(header: [u8; VOX_OFFSET], comment: &str) -> Vec<u8> {
    let mut start = header.to_vec();
    if !comment.is_empty() {
        // Size and code, then the comment, which zeros fill up to a multiple of 16 bytes.
        let size = (8 + comment.len()).next_multiple_of(16);
        let offset = (VOX_OFFSET + size) as f32;
        start[108..112].copy_from_slice(&offset.to_le_bytes());
        start[348] = 1;
        start.extend((size as i32).to_le_bytes());
        start.extend(COMMENT.to_le_bytes());
        start.extend(comment.bytes());
        start.resize(VOX_OFFSET + size, 0);
    }
    start
}

/// The comment of a file that [`write_commented`] wrote; `None` if it has none.
pub(crate) fn comment_of(bytes: &[u8]) -> Option<String> {
    let mut unpacked = GzDecoder::new(bytes);
    let mut start = [0; VOX_OFFSET + 8];
    unpacked.read_exact(&mut start).ok()?;
    let number = |at: usize| i32::from_le_bytes(start[at..at + 4].try_into().expect("four bytes"));
    let length = usize::try_from(number(VOX_OFFSET)).ok()?.checked_sub(8)?;
    if start[348] != 1 || number(VOX_OFFSET + 4) != COMMENT || length > MAX_COMMENT_BYTES {
        return None;
    }
    let mut comment = vec![0; length];
    unpacked.read_exact(&mut comment).ok()?;
    let comment = String::from_utf8(comment).ok()?;
    Some(comment.trim_end_matches('\0').to_owned())
}

/// A NIfTI file, plain or gzipped, with one of the two forms of its header alone, without extensions, as `.nii.gz`. The same file
/// gives the same bytes.
///
/// # Errors
/// If the header does not have that form, or the file is not a single volume, is damaged, or exceeds a limit.
pub fn keeping_form(bytes: &[u8], form: Form, limits: &Limits) -> Result<Vec<u8>, ImagingError> {
    let mut file = NiftiFile::open_keeping(bytes, form, limits)?;
    let mut encoder = GzBuilder::new().write(Vec::new(), Compression::fast());
    write_all(&mut encoder, &file.header.written_over(&file.header_bytes));
    // No extension follows.
    write_all(&mut encoder, &[0; 4]);
    file.for_each_chunk(|chunk| {
        write_all(&mut encoder, chunk);
        Ok(())
    })?;
    Ok(encoder.finish().expect("memory does not fail"))
}

/// Header and encoded values in one gzip member without a name or time.
fn pack<T: Copy>(
    header: &[u8],
    values: &[T],
    encode: impl Fn(T, &mut Vec<u8>),
) -> Result<Vec<u8>, ImagingError> {
    let mut encoder = GzBuilder::new().write(Vec::new(), Compression::fast());
    let mut bytes = Vec::new();
    write_all(&mut encoder, header);
    for chunk in values.chunks(CHUNK_VOXELS) {
        bytes.clear();
        chunk.iter().for_each(|&value| encode(value, &mut bytes));
        write_all(&mut encoder, &bytes);
    }
    Ok(encoder.finish().expect("a vector takes all bytes"))
}

fn write_all(encoder: &mut GzEncoder<Vec<u8>>, bytes: &[u8]) {
    encoder.write_all(bytes).expect("a vector takes all bytes");
}

/// A NIfTI-1 header and the four bytes after it.
fn header(
    grid: &Grid,
    (code, bytes): (i16, i16),
    rescale: Rescale,
) -> Result<[u8; VOX_OFFSET], ImagingError> {
    let placement = Placement::from_patient(grid.patient_from_voxel());
    let mut header = HeaderBytes([0; VOX_OFFSET]);
    header.put(0, 348i32.to_le_bytes());
    header.put(40, 3i16.to_le_bytes());
    for (axis, &side) in grid.size().iter().enumerate() {
        let side = i16::try_from(side).map_err(|_| ImagingError::SideTooLong { side })?;
        header.put(42 + 2 * axis, side.to_le_bytes());
    }
    for unused in 3..7 {
        header.put(42 + 2 * unused, 1i16.to_le_bytes());
    }
    header.put(70, code.to_le_bytes());
    header.put(72, (8 * bytes).to_le_bytes());
    header.put(108, (VOX_OFFSET as f32).to_le_bytes());
    header.put(112, rescale.slope.to_le_bytes());
    header.put(116, rescale.intercept.to_le_bytes());
    header.put_placement(&placement);
    header.put(344, *b"n+1\0");
    Ok(header.0)
}

struct HeaderBytes([u8; VOX_OFFSET]);

impl HeaderBytes {
    fn put<const N: usize>(&mut self, at: usize, bytes: [u8; N]) {
        self.0[at..at + N].copy_from_slice(&bytes);
    }

    fn put_singles(&mut self, at: usize, numbers: &[f64]) {
        for (i, &number) in numbers.iter().enumerate() {
            self.put(at + 4 * i, (number as f32).to_le_bytes());
        }
    }

    fn put_placement(&mut self, placement: &Placement) {
        self.put_singles(76, &placement.pixdim);
        self.put(123, [placement.units]);
        self.put(252, (placement.qform_code as i16).to_le_bytes());
        self.put(254, (placement.sform_code as i16).to_le_bytes());
        self.put_singles(256, &placement.quaternion);
        self.put_singles(268, &placement.qoffset);
        self.put_singles(280, placement.srow.as_flattened());
    }
}
