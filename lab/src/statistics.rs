//! Summary statistics.

use serde::Serialize;

/// Location and spread of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Sample size: at least one.
    pub count: usize,
    /// The mean.
    pub mean: f64,
    /// The least.
    pub least: f64,
    /// The 5th percentile.
    pub p5: f64,
    /// The median.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
    /// The 99th percentile.
    pub p99: f64,
    /// The greatest.
    pub greatest: f64,
}

impl Summary {
    /// The summary of some numbers; `None` if there are none, or one is NaN.
    pub fn of(numbers: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = numbers.into_iter().collect();
        if sorted.is_empty() || sorted.iter().any(|number| number.is_nan()) {
            return None;
        }
        sorted.sort_by(f64::total_cmp);
        Some(Self {
            count: sorted.len(),
            mean: sorted.iter().sum::<f64>() / sorted.len() as f64,
            least: sorted[0],
            p5: quantile(&sorted, 0.05),
            median: quantile(&sorted, 0.5),
            p95: quantile(&sorted, 0.95),
            p99: quantile(&sorted, 0.99),
            greatest: sorted[sorted.len() - 1],
        })
    }
}

/// The quantile `share` (0 to 1) of sorted numbers, with linear interpolation.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let below = place as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64)
}

/// A power law: y = factor · x^exponent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PowerLaw {
    /// 1 for proportional growth; 0 for none.
    pub exponent: f64,
    /// y at x = 1.
    pub factor: f64,
    /// The coefficient of determination of ln y, 0 to 1; 1 if there is no spread.
    pub explained: f64,
}

impl PowerLaw {
    /// The least-squares line through (ln x, ln y) of the positive pairs (x, y); `None` with fewer than two distinct x.
    pub fn fit(pairs: &[(f64, f64)]) -> Option<Self> {
        let logs: Vec<(f64, f64)> = pairs
            .iter()
            .filter(|(x, y)| *x > 0.0 && *y > 0.0 && x.is_finite() && y.is_finite())
            .map(|(x, y)| (x.ln(), y.ln()))
            .collect();
        let count = logs.len() as f64;
        let mean_x = logs.iter().map(|(x, _)| x).sum::<f64>() / count;
        let mean_y = logs.iter().map(|(_, y)| y).sum::<f64>() / count;
        let sum = |term: &dyn Fn(f64, f64) -> f64| -> f64 {
            logs.iter().map(|(x, y)| term(x - mean_x, y - mean_y)).sum()
        };
        let spread_x = sum(&|x, _| x * x);
        if logs.len() < 2 || spread_x <= f64::EPSILON {
            return None;
        }
        let exponent = sum(&|x, y| x * y) / spread_x;
        let spread_y = sum(&|_, y| y * y);
        let left_over = sum(&|x, y| (y - exponent * x).powi(2));
        Some(Self {
            exponent,
            factor: (mean_y - exponent * mean_x).exp(),
            explained: if spread_y <= f64::EPSILON {
                1.0
            } else {
                1.0 - left_over / spread_y
            },
        })
    }
}

/// A share or another statistic with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Interval {
    pub(crate) value: f64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Interval {
    /// A share of a count, with the interval of Wilson.
    ///
    /// Source: Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc. 22, 1927.
    pub(crate) fn of_count(found: usize, count: usize) -> Self {
        let count = count.max(1) as f64;
        let value = found as f64 / count;
        let z: f64 = 1.96;
        let shrunk = 1.0 + z * z / count;
        let middle = (value + z * z / (2.0 * count)) / shrunk;
        let half =
            z / shrunk * (value * (1.0 - value) / count + (z / (2.0 * count)).powi(2)).sqrt();
        Self {
            value,
            low: (middle - half).max(0.0),
            high: (middle + half).min(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn the_numbers_from_0_to_100_are_their_own_percentiles() {
        let summary = Summary::of((0..=100).rev().map(f64::from)).unwrap();
        let found = [
            summary.least,
            summary.p5,
            summary.median,
            summary.p95,
            summary.p99,
            summary.greatest,
        ];
        for (found, expected) in found.into_iter().zip([0.0, 5.0, 50.0, 95.0, 99.0, 100.0]) {
            assert!(close(found, expected), "{found} {expected}");
        }
        assert_eq!((summary.count, summary.mean), (101, 50.0));
    }

    #[test]
    fn the_median_of_two_lies_between_them_and_one_number_is_everything() {
        assert_eq!(Summary::of([1.0, 4.0]).unwrap().median, 2.5);
        let one = Summary::of([7.0]).unwrap();
        assert!([one.least, one.p5, one.median, one.p99, one.greatest] == [7.0; 5]);
    }

    #[test]
    fn nothing_and_what_is_no_number_have_no_summary() {
        assert_eq!(Summary::of([]), None);
        assert_eq!(Summary::of([1.0, f64::NAN]), None);
    }

    #[test]
    fn a_power_law_is_found_again() {
        let law = |x: f64| (x, 3.0 * x.powf(1.5));
        let fit = PowerLaw::fit(&[1.0, 2.0, 4.0, 16.0].map(law)).unwrap();
        assert!(close(fit.exponent, 1.5) && close(fit.factor, 3.0) && close(fit.explained, 1.0));
    }

    #[test]
    fn what_does_not_grow_has_the_exponent_0() {
        let fit = PowerLaw::fit(&[(1.0, 5.0), (10.0, 5.0), (100.0, 5.0)]).unwrap();
        assert!(close(fit.exponent, 0.0) && close(fit.factor, 5.0));
    }

    #[test]
    fn noise_is_left_over() {
        let fit = PowerLaw::fit(&[(1.0, 1.0), (2.0, 4.0), (4.0, 2.0), (8.0, 16.0)]).unwrap();
        assert!(fit.explained > 0.5 && fit.explained < 1.0, "{fit:?}");
    }

    #[test]
    fn one_point_or_one_place_has_no_law() {
        assert_eq!(PowerLaw::fit(&[(2.0, 3.0)]), None);
        assert_eq!(PowerLaw::fit(&[(2.0, 3.0), (2.0, 4.0)]), None);
        assert_eq!(PowerLaw::fit(&[(2.0, 3.0), (0.0, 4.0), (3.0, -1.0)]), None);
    }
}
