//! The range of numbers that come in chunks.

use crate::ImagingError;

use super::element::{Element, for_each};
use super::header::ByteOrder;

/// The range of the numbers so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range<T> {
    /// Least and greatest.
    ends: Option<[T; 2]>,
    /// Whether all are integers.
    pub(crate) whole: bool,
    /// Count of NaN and infinite values.
    non_finite: u64,
}

impl<T: Element> Range<T> {
    pub(crate) fn new() -> Self {
        Self {
            ends: None,
            whole: true,
            non_finite: 0,
        }
    }

    /// Adds the numbers of a chunk.
    pub(crate) fn extend(&mut self, bytes: &[u8], order: ByteOrder) {
        let Self {
            ends,
            mut whole,
            mut non_finite,
        } = *self;
        let Some([mut least, mut greatest]) = ends.or_else(|| first_twice(bytes, order)) else {
            return;
        };
        for_each(bytes, order, |value: T| {
            non_finite += u64::from(!value.to_f64().is_finite());
            least = if value < least { value } else { least };
            greatest = if value > greatest { value } else { greatest };
            whole = whole && value.is_whole();
        });
        *self = Self {
            ends: Some([least, greatest]),
            whole,
            non_finite,
        };
    }

    /// Least and greatest number.
    ///
    /// # Errors
    /// If some are not finite; `voxels` is the count of all numbers.
    pub(crate) fn ends(&self, voxels: u64) -> Result<[T; 2], ImagingError> {
        match (self.non_finite, self.ends) {
            (0, Some(ends)) => Ok(ends),
            (count, _) => Err(ImagingError::NiftiNonFinite { count, voxels }),
        }
    }
}

fn first_twice<T: Element>(bytes: &[u8], order: ByteOrder) -> Option<[T; 2]> {
    let mut first = None;
    for_each(bytes.get(..T::BYTES)?, order, |value: T| {
        first = Some(value);
    });
    first.map(|value| [value, value])
}
