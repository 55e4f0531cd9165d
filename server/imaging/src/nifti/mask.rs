use geometry::Mask;

use crate::{ImagingError, Limits};

use super::datatype::DataType;
use super::element::{Element, extend_with};
use super::file::NiftiFile;
use super::header::Scaling;

/// The greatest value of a probability map; overshoot from interpolation stays below it.
const MAX_PROBABILITY: f64 = 1.25;

/// In a probability map, a voxel belongs to the mask if its value is above this.
const LIKELY: f64 = 0.5;

/// Reads a mask from a NIfTI file, plain or gzipped.
///
/// A voxel belongs to the mask if its scaled value is above 0: so 0 and 1, 0 and 255, labels, and a skull-stripped head
/// all work. A file with values between 0 and 1 and none above 1.25 (interpolation overshoots) is a probability map:
/// there a voxel belongs to the mask if its value is above ½. A voxel that is NaN or infinite does not belong to it.
///
/// # Errors
/// If the file is not a single volume, is damaged, or exceeds a limit.
pub fn read_mask(bytes: &[u8], limits: &Limits) -> Result<Mask, ImagingError> {
    let mut file = NiftiFile::open(bytes, limits)?;
    let classes = match file.header.data_type {
        DataType::U8 => read_classes::<u8>(&mut file),
        DataType::I8 => read_classes::<i8>(&mut file),
        DataType::U16 => read_classes::<u16>(&mut file),
        DataType::I16 => read_classes::<i16>(&mut file),
        DataType::U32 => read_classes::<u32>(&mut file),
        DataType::I32 => read_classes::<i32>(&mut file),
        DataType::U64 => read_classes::<u64>(&mut file),
        DataType::I64 => read_classes::<i64>(&mut file),
        DataType::F32 => read_classes::<f32>(&mut file),
        DataType::F64 => read_classes::<f64>(&mut file),
    }?;
    Ok(Mask::new(file.grid, classes.belonging())?)
}

/// Facts about a value, as bits.
mod fact {
    /// Above 0; the only fact that matters for an unscaled integer.
    pub(super) const POSITIVE: u8 = 1;
    /// Above ½.
    pub(super) const LIKELY: u8 = 2;
    /// Between 0 and 1.
    pub(super) const FRACTION: u8 = 4;
    /// Above any probability.
    pub(super) const LARGE: u8 = 8;
}

/// Facts about the values, collected until all are known.
struct Classes {
    /// Facts about each voxel.
    facts: Vec<u8>,
    /// Facts that hold for at least one voxel.
    any: u8,
}

fn read_classes<T: Element>(file: &mut NiftiFile) -> Result<Classes, ImagingError> {
    let order = file.header.order;
    let scaling = file.header.scaling;
    let room = file.room();
    let mut facts = Vec::new();
    file.for_each_chunk(|chunk| {
        room.reserve(&mut facts, chunk.len() / T::BYTES)?;
        if T::WHOLE && scaling.is_identity() {
            extend_with(&mut facts, chunk, order, |value: T| {
                u8::from(value > T::ZERO)
            });
        } else {
            extend_with(&mut facts, chunk, order, |value: T| {
                facts_of(value, scaling)
            });
        }
        Ok(())
    })?;
    let any = facts.iter().fold(0, |any, facts| any | facts);
    Ok(Classes { facts, any })
}

fn facts_of<T: Element>(value: T, scaling: Scaling) -> u8 {
    let intensity = scaling.intensity(value.to_f64());
    if !intensity.is_finite() {
        return 0;
    }
    let flag = |holds: bool, fact: u8| if holds { fact } else { 0 };
    flag(intensity > 0.0, fact::POSITIVE)
        | flag(intensity > LIKELY, fact::LIKELY)
        | flag(intensity > MAX_PROBABILITY, fact::LARGE)
        | flag(intensity > 0.0 && intensity < 1.0, fact::FRACTION)
}

impl Classes {
    fn belonging(self) -> Vec<bool> {
        let Self { facts, any } = self;
        let probabilities = any & fact::FRACTION != 0 && any & fact::LARGE == 0;
        let belongs = if probabilities {
            fact::LIKELY
        } else {
            fact::POSITIVE
        };
        facts
            .into_iter()
            .map(|facts| facts & belongs != 0)
            .collect()
    }
}
