//! Reduced copies of volumes that are too large for a texture.

use rayon::prelude::*;

/// The number of voxels along x, y and z that become one, so that no side is longer than `max_side` and all voxels, of
/// two bytes, fit into `max_bytes`; `[1, 1, 1]` if the volume fits unchanged.
pub(super) fn reduction(size: [usize; 3], max_side: usize, max_bytes: u64) -> [usize; 3] {
    let mut factors = size.map(|side| side.div_ceil(max_side));
    loop {
        let reduced = reduced_size(size, factors);
        let bytes = reduced
            .iter()
            .fold(2, |bytes: u64, &side| bytes.saturating_mul(side as u64));
        let longest = (0..3).max_by_key(|&axis| reduced[axis]).unwrap_or(0);
        if bytes <= max_bytes || reduced[longest] == 1 {
            return factors;
        }
        factors[longest] += 1;
    }
}

/// Voxels of the copy along each axis.
pub(super) fn reduced_size(size: [usize; 3], factors: [usize; 3]) -> [usize; 3] {
    [0, 1, 2].map(|axis| size[axis].div_ceil(factors[axis]))
}

/// The means of blocks of voxels, x-fastest; blocks at the far faces may be incomplete.
pub(super) fn reduced(values: &[u16], size: [usize; 3], factors: [usize; 3]) -> Vec<u16> {
    let [width, height, depth] = reduced_size(size, factors);
    let mut means = vec![0; width * height * depth];
    let range = |axis: usize, place: usize| {
        let start = place * factors[axis];
        start..(start + factors[axis]).min(size[axis])
    };
    means
        .par_chunks_exact_mut(width)
        .enumerate()
        .for_each(|(row, means)| {
            let [ys, zs] = [range(1, row % height), range(2, row / height)];
            for (x, mean) in means.iter_mut().enumerate() {
                let xs = range(0, x);
                let mut sum = 0_u64;
                for z in zs.clone() {
                    for y in ys.clone() {
                        let start = size[0] * (y + size[1] * z);
                        let block = &values[start + xs.start..start + xs.end];
                        sum += block.iter().map(|&value| u64::from(value)).sum::<u64>();
                    }
                }
                let count = (xs.len() * ys.len() * zs.len()) as u64;
                *mean = ((sum + count / 2) / count) as u16;
            }
        });
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_is_left_alone() {
        assert_eq!(reduction([100, 200, 300], 300, 12_000_000), [1, 1, 1]);
    }

    #[test]
    fn long_sides_are_shortened_and_the_rest_until_it_fits() {
        assert_eq!(reduction([100, 2049, 300], 2048, u64::MAX), [1, 2, 1]);
        let factors = reduction([400, 400, 400], 2048, 20_000_000);
        let [x, y, z] = reduced_size([400; 3], factors);
        assert!(2 * x * y * z <= 20_000_000, "{factors:?}");
        assert_eq!(reduction([3, 3, 3], 2048, 0), [3, 3, 3]);
    }

    #[test]
    fn a_block_becomes_its_mean() {
        let values: Vec<u16> = (0..5 * 3 * 2).map(|index| index * 10).collect();
        let means = reduced(&values, [5, 3, 2], [2, 2, 2]);
        assert_eq!(reduced_size([5, 3, 2], [2, 2, 2]), [3, 2, 1]);
        // Voxels 0, 1, 5, 6, 15, 16, 20, 21; at the far corner 14 and 29.
        assert_eq!(means[0], 105);
        assert_eq!(means[5], 215);
    }
}
