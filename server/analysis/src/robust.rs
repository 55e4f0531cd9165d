//! Robust statistics, which a few lesions do not affect.

/// Robust location and spread: the median, and 1.4826 times the median absolute deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Robust {
    median: f32,
    spread: f32,
}

impl Robust {
    /// Computes them from the values that are not NaN. The spread is at least `least_spread`, because a perfectly
    /// symmetric head differs only by rounding.
    pub(crate) fn of(values: impl Iterator<Item = f32>, least_spread: f32) -> Self {
        let mut values: Vec<f32> = values.filter(|value| !value.is_nan()).collect();
        let median = median(&mut values);
        for value in &mut values {
            *value = (*value - median).abs();
        }
        let spread = 1.4826 * self::median(&mut values);
        Self {
            median,
            spread: spread.max(least_spread),
        }
    }

    /// The distance of a value above the median, in spreads.
    pub(crate) fn z(self, value: f32) -> f32 {
        (value - self.median) / self.spread
    }
}

/// 0 if there are no values.
fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
