//! Single values far beyond all others, which would take the levels of 16 bits away from the rest.

/// Enough values to find the quantiles of a volume.
pub const SAMPLE: usize = 1 << 20;

/// The fewest values of which quantiles say something.
const FEWEST: usize = 1000;

/// The widest range, as a multiple of the distance between the 1st and the 99th percentile. Within a head the median is about half
/// of that distance above the background, so that one of 65,534 steps of this range is 0.5 % of it.
const WIDEST: f64 = 164.0;

/// The range that 16 bits divide: all of it, unless a step would exceed 0.5 % of the median within a head; then it ends at half the
/// widest range beyond the 1st and the 99th percentile.
///
/// The quantiles are those of the sample, without zeros, because many maps are zero almost everywhere, and without values that are
/// not finite.
pub fn kept_range(mut sample: Vec<f64>, [least, greatest]: [f64; 2]) -> [f64; 2] {
    sample.retain(|&value| value != 0.0 && value.is_finite());
    if sample.len() < FEWEST {
        return [least, greatest];
    }
    let mut quantile = |share: f64| {
        let place = (share * (sample.len() - 1) as f64).round() as usize;
        *sample.select_nth_unstable_by(place, f64::total_cmp).1
    };
    let [low, high] = [0.01, 0.99].map(&mut quantile);
    let spread = high - low;
    if spread <= 0.0 || greatest - least <= WIDEST * spread {
        return [least, greatest];
    }
    let beyond = (WIDEST - 1.0) / 2.0 * spread;
    [least.max(low - beyond), greatest.min(high + beyond)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head() -> Vec<f64> {
        (0..5000)
            .map(|number| f64::from(number % 101) / 50.0)
            .collect()
    }

    #[test]
    fn a_range_that_16_bits_divide_finely_is_kept() {
        for most in [2.0, 100.0, 300.0] {
            assert_eq!(kept_range(head(), [0.0, most]), [0.0, most]);
        }
    }

    #[test]
    fn one_odd_value_does_not_take_the_levels_of_the_others() {
        for [least, greatest] in [[0.0, 5e4], [0.0, 1e12], [-1e6, 2.0], [-1e6, 1e6]] {
            let [low, high] = kept_range(head(), [least, greatest]);
            assert!((high - low) / 65_534.0 < 0.006, "{low} {high}");
            assert!(low <= 0.0 && high >= 2.0);
        }
    }

    #[test]
    fn a_map_that_is_zero_almost_everywhere_is_judged_by_the_rest() {
        let mut map = vec![0.0; 100_000];
        map.extend((0..2000).map(|number| 2.0 + f64::from(number) / 400.0));
        assert_eq!(kept_range(map, [0.0, 7.0]), [0.0, 7.0]);
        let few = [vec![0.0; 100_000], vec![3.0, 90_000.0]].concat();
        assert_eq!(kept_range(few, [0.0, 90_000.0]), [0.0, 90_000.0]);
    }
}
