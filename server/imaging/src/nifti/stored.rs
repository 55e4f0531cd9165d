//! Converts voxels of any type to 16 bits.

use geometry::{Grid, Mask, Rescale, Volume};

use crate::{ImagingError, Limits};

use super::datatype::DataType;
use super::element::{Element, extend_with, for_each};
use super::file::{NiftiFile, reserve_exact};
use super::header::Scaling;
use super::outliers::{SAMPLE, kept_range};
use super::range::Range;
use super::start::ByteOrder;

/// The greatest stored value.
const STORED_MAX: f64 = u16::MAX as f64;

/// Reads the volume of a NIfTI file, plain or gzipped.
///
/// Voxels are stored in 16 bits with a positive slope. Integers of 8 and 16 bits stay exact; so do wider integers and
/// integral floating-point numbers with a range that fits in 16 bits. Any other range from `min` to `max` is divided
/// into 65,534 equal steps, with an error of at most half a step, (max − min)/131,068; zero stays exactly zero (the
/// background of a skull-stripped head does not change). Intensities are in single precision, which rounds to 6·10⁻⁸ of
/// the largest one.
///
/// Values that are not finite become 0, and values that lie so far beyond all others that the steps would be too coarse become
/// the end of the range.
///
/// # Errors
/// If the file is not such a volume, is damaged, or exceeds a limit.
pub fn read_volume(bytes: &[u8], limits: &Limits) -> Result<Volume, ImagingError> {
    read_counted(bytes, limits).map(|(volume, _)| volume)
}

/// The voxels of a file whose values were replaced.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Replaced {
    /// Those that are NaN or infinite, and became 0.
    pub not_finite: u64,
    /// Those among them that are not connected with a face of the volume by others of their kind; `None` if none became 0.
    pub enclosed: Option<Mask>,
    /// Those that lie far beyond all others, and became the end of the range.
    pub clipped: u64,
}

/// As [`read_volume`], with the number of voxels that were replaced.
///
/// # Errors
/// As [`read_volume`].
pub fn read_counted(bytes: &[u8], limits: &Limits) -> Result<(Volume, Replaced), ImagingError> {
    let mut file = NiftiFile::open(bytes, limits)?;
    let stored = match file.header.data_type {
        DataType::U8 => read_narrow(&mut file, 0.0, |value: u8| value.into()),
        DataType::I8 => read_narrow(&mut file, -128.0, |value: i8| {
            (i16::from(value) + 128) as u16
        }),
        DataType::U16 => read_narrow(&mut file, 0.0, |value: u16| value),
        DataType::I16 => read_narrow(&mut file, -32768.0, |value: i16| value as u16 ^ 0x8000),
        DataType::U32 => read_wide::<u32>(&mut file),
        DataType::I32 => read_wide::<i32>(&mut file),
        DataType::U64 => read_wide::<u64>(&mut file),
        DataType::I64 => read_wide::<i64>(&mut file),
        DataType::F32 => read_wide::<f32>(&mut file),
        DataType::F64 => read_wide::<f64>(&mut file),
    }?;
    let Stored {
        mut voxels,
        steps,
        replaced,
    } = stored;
    let intensities = steps.scaled(file.header.scaling);
    if intensities.slope < 0.0 {
        voxels.iter_mut().for_each(|stored| *stored = !*stored);
    }
    let volume = Volume::new(file.grid, voxels, intensities.rising().rescale()?)?;
    Ok((volume, replaced))
}

/// The grid of a NIfTI file. The first 64 kB of the file are enough for every header, plain or gzipped.
///
/// # Errors
/// If the header does not describe a volume, or exceeds a limit.
pub fn read_grid(start: &[u8], limits: &Limits) -> Result<Grid, ImagingError> {
    Ok(NiftiFile::open_header(start, limits)?.grid)
}

/// Values in 16 bits, and the mapping to the numbers in the file.
struct Stored {
    voxels: Vec<u16>,
    steps: Steps,
    replaced: Replaced,
}

/// Number = slope · stored + intercept, in double precision.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Steps {
    slope: f64,
    intercept: f64,
}

impl Steps {
    fn unit_from(intercept: f64) -> Self {
        Self {
            slope: 1.0,
            intercept,
        }
    }

    /// Applies the scaling of the file, so that the mapping gives intensities.
    fn scaled(self, scaling: Scaling) -> Self {
        Self {
            slope: scaling.slope * self.slope,
            intercept: scaling.intensity(self.intercept),
        }
    }

    /// Inverts the stored values if the slope is negative, so that it becomes positive.
    fn rising(self) -> Self {
        if self.slope > 0.0 {
            return self;
        }
        Self {
            slope: -self.slope,
            intercept: self.intercept + self.slope * STORED_MAX,
        }
    }

    /// Converts to the single precision of a volume, if the values fit; zero stays zero.
    fn rescale(self) -> Result<Rescale, ImagingError> {
        let max = self.slope * STORED_MAX + self.intercept;
        let slope = self.slope as f32;
        let intercept = match self.stored_zero() {
            Some(zero) => -(slope * f32::from(zero)),
            None => self.intercept as f32,
        };
        let fits = slope.is_normal() && intercept.is_finite();
        if fits && (max as f32).is_finite() {
            Ok(Rescale { slope, intercept })
        } else {
            Err(ImagingError::NiftiIntensityRange {
                min: self.intercept,
                max,
            })
        }
    }

    /// The stored value that represents zero, if there is one.
    fn stored_zero(self) -> Option<u16> {
        let position = -self.intercept / self.slope;
        let nearest = position.round();
        let is_zero = (position - nearest).abs() < 1e-6 && (0.0..=STORED_MAX).contains(&nearest);
        is_zero.then_some(nearest as u16)
    }
}

/// Integers of at most 16 bits, converted as they arrive; the stored value 0 represents `least`.
fn read_narrow<T: Element>(
    file: &mut NiftiFile,
    least: f64,
    convert: impl Fn(T) -> u16 + Copy,
) -> Result<Stored, ImagingError> {
    let order = file.header.order;
    let room = file.room();
    let mut voxels = Vec::new();
    file.for_each_chunk(|chunk| {
        room.reserve(&mut voxels, chunk.len() / T::BYTES)?;
        extend_with(&mut voxels, chunk, order, convert);
        Ok(())
    })?;
    Ok(Stored {
        voxels,
        steps: Steps::unit_from(least),
        replaced: Replaced::default(),
    })
}

/// Wider numbers, kept unchanged until their range is known.
fn read_wide<T: Element>(file: &mut NiftiFile) -> Result<Stored, ImagingError> {
    let order = file.header.order;
    let mut range = Range::<T>::new();
    let mut chunks = Vec::new();
    file.for_each_chunk(|chunk| {
        range.extend(chunk, order);
        chunks.push(copy(chunk)?);
        Ok(())
    })?;
    let mut replaced = Replaced {
        not_finite: range.non_finite,
        ..Replaced::default()
    };
    if range.non_finite > 0 {
        replaced.enclosed = Some(enclosed::<T>(&chunks, order, &file.grid)?);
    }
    let ends = range.ends();
    let (voxels, steps) = if range.whole && ends[1].is_within_16_bits_of(ends[0]) {
        keep_whole(chunks, order, ends)?
    } else {
        let ends = ends.map(T::to_f64);
        let kept = kept_range(sample::<T>(&chunks, order), ends);
        if kept != ends {
            let is_beyond = |value: f64| value < kept[0] || value > kept[1];
            for chunk in &chunks {
                for_each(chunk, order, |value: T| {
                    let value = value.to_f64();
                    replaced.clipped += u64::from(value.is_finite() && is_beyond(value));
                });
            }
        }
        quantise::<T>(chunks, order, kept)?
    };
    Ok(Stored {
        voxels,
        steps,
        replaced,
    })
}

/// Evenly chosen values that are neither zero nor undefined.
fn sample<T: Element>(chunks: &[Vec<u8>], order: ByteOrder) -> Vec<f64> {
    let count: usize = chunks.iter().map(|chunk| chunk.len() / T::BYTES).sum();
    let every = (count / SAMPLE).max(1);
    let (mut sample, mut number) = (Vec::new(), 0);
    for chunk in chunks {
        for_each(chunk, order, |value: T| {
            if number % every == 0 {
                sample.push(value.to_f64());
            }
            number += 1;
        });
    }
    sample
}

/// Those of the values that are not finite that are not connected with a face of the volume by others.
fn enclosed<T: Element>(
    chunks: &[Vec<u8>],
    order: ByteOrder,
    grid: &Grid,
) -> Result<Mask, ImagingError> {
    let size = grid.size();
    let mut is_left = Vec::new();
    for chunk in chunks {
        for_each(chunk, order, |value: T| {
            is_left.push(!value.to_f64().is_finite());
        });
    }
    let strides = [1, size[0], size[0] * size[1]];
    let place = |index: usize, axis: usize| index / strides[axis] % size[axis];
    let is_on_face =
        |index: usize| (0..3).any(|axis| [0, size[axis] - 1].contains(&place(index, axis)));
    let mut reached: Vec<usize> = (0..is_left.len())
        .filter(|&index| is_left[index] && is_on_face(index))
        .collect();
    reached.iter().for_each(|&index| is_left[index] = false);
    while let Some(index) = reached.pop() {
        for axis in 0..3 {
            let at = place(index, axis);
            let before = (at > 0).then(|| index - strides[axis]);
            let after = (at + 1 < size[axis]).then(|| index + strides[axis]);
            for next in [before, after].into_iter().flatten() {
                if is_left[next] {
                    is_left[next] = false;
                    reached.push(next);
                }
            }
        }
    }
    Ok(Mask::new(grid.clone(), is_left)?)
}

/// The value, or zero in place of one that is not finite.
fn finite<T: Element>(value: T) -> T {
    match value.to_f64().is_finite() {
        true => value,
        false => T::ZERO,
    }
}

fn copy(chunk: &[u8]) -> Result<Vec<u8>, ImagingError> {
    let mut bytes = Vec::new();
    reserve_exact(&mut bytes, chunk.len())?;
    bytes.extend_from_slice(chunk);
    Ok(bytes)
}

/// Integers with a range of at most 16 bits: unchanged, or relative to the least.
fn keep_whole<T: Element>(
    chunks: Vec<Vec<u8>>,
    order: ByteOrder,
    [least, greatest]: [T; 2],
) -> Result<(Vec<u16>, Steps), ImagingError> {
    let fit_as_they_are = least.to_f64() >= 0.0 && greatest.to_f64() <= STORED_MAX;
    let first = if fit_as_they_are { T::ZERO } else { least };
    let voxels = convert_chunks(chunks, order, |value: T| finite(value).steps_above(first))?;
    Ok((voxels, Steps::unit_from(first.to_f64())))
}

/// Numbers rounded to the nearest of 65,536 equidistant levels; those beyond the ends, to the last one. If the range includes
/// zero, zero is one of the levels.
fn quantise<T: Element>(
    chunks: Vec<Vec<u8>>,
    order: ByteOrder,
    ends: [f64; 2],
) -> Result<(Vec<u16>, Steps), ImagingError> {
    let steps = Steps::across(ends);
    let per_step = 1.0 / steps.slope;
    let voxels = convert_chunks(chunks, order, |value: T| {
        ((finite(value).to_f64() - steps.intercept) * per_step + 0.5) as u16
    })?;
    Ok((voxels, steps))
}

impl Steps {
    /// 65,534 steps that cover a range, and a spare one so that zero can be a level.
    fn across([min, max]: [f64; 2]) -> Self {
        let slope = (max - min) / (STORED_MAX - 1.0);
        if slope == 0.0 {
            return Self::unit_from(min);
        }
        let surrounds_zero = min < 0.0 && max >= 0.0;
        let intercept = if surrounds_zero {
            (min / slope).floor() * slope
        } else {
            min
        };
        Self { slope, intercept }
    }
}

/// Converts chunk by chunk and frees the memory of each.
fn convert_chunks<T: Element>(
    chunks: Vec<Vec<u8>>,
    order: ByteOrder,
    convert: impl Fn(T) -> u16 + Copy,
) -> Result<Vec<u16>, ImagingError> {
    let values = chunks.iter().map(|chunk| chunk.len() / T::BYTES).sum();
    let mut voxels = Vec::new();
    reserve_exact(&mut voxels, values)?;
    for chunk in chunks {
        extend_with(&mut voxels, &chunk, order, convert);
    }
    Ok(voxels)
}
