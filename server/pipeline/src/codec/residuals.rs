//! 16-bit differences in two planes of bytes.

use super::bytes::Reader;

/// Folds a difference so that small ones of either sign are small numbers.
fn fold(difference: u16) -> u16 {
    difference << 1 ^ 0u16.wrapping_sub(difference >> 15)
}

fn unfold(folded: u16) -> u16 {
    folded >> 1 ^ 0u16.wrapping_sub(folded & 1)
}

/// Appends the low bytes of all folded differences, then the high ones.
pub(super) fn put_residuals(bytes: &mut Vec<u8>, differences: impl ExactSizeIterator<Item = u16>) {
    let count = differences.len();
    let start = bytes.len();
    bytes.resize(start + 2 * count, 0);
    let (low, high) = bytes[start..].split_at_mut(count);
    for ((low, high), difference) in low.iter_mut().zip(high).zip(differences) {
        [*low, *high] = fold(difference).to_le_bytes();
    }
}

/// Reads `count` differences; `None` if there are too few bytes.
pub(super) fn read_residuals<'a>(
    reader: &mut Reader<'a>,
    count: usize,
) -> Option<impl ExactSizeIterator<Item = u16> + use<'a>> {
    let low = reader.take(count)?;
    let high = reader.take(count)?;
    let folded = low.iter().zip(high);
    Some(folded.map(|(&low, &high)| unfold(u16::from_le_bytes([low, high]))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_difference_comes_back() {
        assert_eq!([0, u16::MAX, 1, u16::MAX - 1].map(fold), [0, 1, 2, 3]);
        let mut bytes = Vec::new();
        put_residuals(
            &mut bytes,
            (0..60_000u16)
                .chain(60_000..u16::MAX)
                .collect::<Vec<_>>()
                .into_iter(),
        );
        let mut reader = Reader(&bytes);
        assert!(
            read_residuals(&mut reader, usize::from(u16::MAX))
                .unwrap()
                .eq(0..u16::MAX)
        );
        assert!(read_residuals(&mut Reader(&bytes[1..]), usize::from(u16::MAX)).is_none());
    }
}
