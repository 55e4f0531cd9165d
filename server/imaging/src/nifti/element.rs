//! Converts the bytes of a file to numbers.

#![expect(
    clippy::cast_lossless,
    reason = "one macro serves the types for which `From` exists and those for which it does not"
)]

use super::start::ByteOrder;

/// A number in a file.
pub(crate) trait Element: Copy + PartialOrd {
    /// Bytes of one number.
    const BYTES: usize;
    /// Whether the type is an integer type.
    const WHOLE: bool;
    const ZERO: Self;
    /// From [`Self::BYTES`] bytes, the least significant first.
    fn from_little_endian(bytes: &[u8]) -> Self;
    /// From [`Self::BYTES`] bytes, the most significant first.
    fn from_big_endian(bytes: &[u8]) -> Self;
    /// The nearest double.
    fn to_f64(self) -> f64;
    /// Whether it is an integer.
    fn is_whole(self) -> bool;
    /// Whether `self - least`, which is not negative, is at most `u16::MAX`.
    fn is_within_16_bits_of(self, least: Self) -> bool;
    /// `self - least`, which must be an integer of 16 bits.
    fn steps_above(self, least: Self) -> u16;
}

/// The methods that are the same for every element type.
macro_rules! from_bytes {
    ($number:ty) => {
        const BYTES: usize = size_of::<$number>();
        const ZERO: Self = 0 as Self;
        fn from_little_endian(bytes: &[u8]) -> Self {
            <$number>::from_le_bytes(bytes.try_into().expect("a chunk of one element"))
        }
        fn from_big_endian(bytes: &[u8]) -> Self {
            <$number>::from_be_bytes(bytes.try_into().expect("a chunk of one element"))
        }
        fn to_f64(self) -> f64 {
            self as f64
        }
    };
}

macro_rules! integer {
    ($($number:ty)*) => {$(
        impl Element for $number {
            const WHOLE: bool = true;
            from_bytes!($number);
            fn is_whole(self) -> bool {
                true
            }
            fn is_within_16_bits_of(self, least: Self) -> bool {
                self.abs_diff(least) as u64 <= u64::from(u16::MAX)
            }
            fn steps_above(self, least: Self) -> u16 {
                self.wrapping_sub(least) as u16
            }
        }
    )*};
}

macro_rules! real {
    ($($number:ty)*) => {$(
        impl Element for $number {
            const WHOLE: bool = false;
            from_bytes!($number);
            fn is_whole(self) -> bool {
                self == self.trunc()
            }
            fn is_within_16_bits_of(self, least: Self) -> bool {
                self - least <= Self::from(u16::MAX)
            }
            fn steps_above(self, least: Self) -> u16 {
                (self - least) as u16
            }
        }
    )*};
}

integer!(u8 i8 u16 i16 u32 i32 u64 i64);
real!(f32 f64);

/// Appends the result of `convert` for each element of `bytes`.
pub(crate) fn extend_with<T: Element, U>(
    converted: &mut Vec<U>,
    bytes: &[u8],
    order: ByteOrder,
    convert: impl Fn(T) -> U,
) {
    let elements = bytes.chunks_exact(T::BYTES);
    match order {
        ByteOrder::Little => {
            converted.extend(elements.map(|bytes| convert(T::from_little_endian(bytes))));
        }
        ByteOrder::Big => {
            converted.extend(elements.map(|bytes| convert(T::from_big_endian(bytes))));
        }
    }
}

/// Passes each element of `bytes` to `visit`.
pub(crate) fn for_each<T: Element>(bytes: &[u8], order: ByteOrder, visit: impl FnMut(T)) {
    let elements = bytes.chunks_exact(T::BYTES);
    match order {
        ByteOrder::Little => elements.map(T::from_little_endian).for_each(visit),
        ByteOrder::Big => elements.map(T::from_big_endian).for_each(visit),
    }
}
