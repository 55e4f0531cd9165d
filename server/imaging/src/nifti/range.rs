//! The range of numbers that come in chunks.

use super::element::{Element, for_each};
use super::start::ByteOrder;

/// The range of the finite numbers so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range<T> {
    /// Least and greatest.
    ends: Option<[T; 2]>,
    /// Whether all are integers.
    pub(crate) whole: bool,
    /// Count of NaN and infinite values.
    pub(crate) non_finite: u64,
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
            self.non_finite += (bytes.len() / T::BYTES) as u64;
            return;
        };
        for_each(bytes, order, |value: T| {
            if !value.to_f64().is_finite() {
                non_finite += 1;
                return;
            }
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

    /// Least and greatest number, with zero for those that are not finite.
    pub(crate) fn ends(&self) -> [T; 2] {
        let [mut least, mut greatest] = self.ends.unwrap_or([T::ZERO; 2]);
        if self.non_finite > 0 {
            least = if T::ZERO < least { T::ZERO } else { least };
            greatest = if T::ZERO > greatest {
                T::ZERO
            } else {
                greatest
            };
        }
        [least, greatest]
    }
}

fn first_twice<T: Element>(bytes: &[u8], order: ByteOrder) -> Option<[T; 2]> {
    let mut first = None;
    for_each(bytes, order, |value: T| {
        if first.is_none() && value.to_f64().is_finite() {
            first = Some(value);
        }
    });
    first.map(|value| [value, value])
}
