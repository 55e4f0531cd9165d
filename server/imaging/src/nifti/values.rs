//! Reads any volume as numbers: intensities, maps with negative values, labels.

use geometry::Grid;

use crate::{ImagingError, Limits};

use super::datatype::DataType;
use super::element::{Element, extend_with};
use super::file::NiftiFile;

/// The numbers of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    /// The grid of the voxels.
    pub grid: Grid,
    /// A number for each voxel, x-fastest; NaN if it is undefined.
    pub numbers: Vec<f32>,
    /// Whether the header states that positions are those of the scanner (code 1).
    pub is_in_scanner_space: bool,
}

/// Reads the numbers of a NIfTI file, plain or gzipped, with slope and intercept applied, in single precision. NaN and
/// infinite numbers are undefined.
///
/// # Errors
/// If the file is not a single volume, is damaged, or exceeds a limit.
pub fn read_values(bytes: &[u8], limits: &Limits) -> Result<Values, ImagingError> {
    let mut file = NiftiFile::open(bytes, limits)?;
    let numbers = match file.header.data_type {
        DataType::U8 => read::<u8>(&mut file),
        DataType::I8 => read::<i8>(&mut file),
        DataType::U16 => read::<u16>(&mut file),
        DataType::I16 => read::<i16>(&mut file),
        DataType::U32 => read::<u32>(&mut file),
        DataType::I32 => read::<i32>(&mut file),
        DataType::U64 => read::<u64>(&mut file),
        DataType::I64 => read::<i64>(&mut file),
        DataType::F32 => read::<f32>(&mut file),
        DataType::F64 => read::<f64>(&mut file),
    }?;
    Ok(Values {
        is_in_scanner_space: file.header.placement.is_in_scanner_space(),
        grid: file.grid,
        numbers,
    })
}

/// Whether a NIfTI file states that positions are those of the scanner (code 1). The first 64 kB of the file are
/// enough.
///
/// # Errors
/// If the header does not describe a volume, or exceeds a limit.
pub fn is_in_scanner_space(start: &[u8], limits: &Limits) -> Result<bool, ImagingError> {
    let file = NiftiFile::open_header(start, limits)?;
    Ok(file.header.placement.is_in_scanner_space())
}

/// Whether an MGH file does not state its axes (`goodRASflag` 0), so that FreeSurfer's default is used. The first 64 kB of the file are enough.
///
/// # Errors
/// If the header does not describe a volume, or exceeds a limit.
pub fn are_axes_assumed(start: &[u8], limits: &Limits) -> Result<bool, ImagingError> {
    Ok(NiftiFile::open_header(start, limits)?.are_axes_assumed)
}

fn read<T: Element>(file: &mut NiftiFile) -> Result<Vec<f32>, ImagingError> {
    let order = file.header.order;
    let scaling = file.header.scaling;
    let room = file.room();
    let mut numbers = Vec::new();
    file.for_each_chunk(|chunk| {
        room.reserve(&mut numbers, chunk.len() / T::BYTES)?;
        extend_with(&mut numbers, chunk, order, |value: T| {
            let number = scaling.intensity(value.to_f64()) as f32;
            if number.is_finite() { number } else { f32::NAN }
        });
        Ok(())
    })?;
    Ok(numbers)
}
