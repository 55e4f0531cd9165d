//! Deviations that a few lesions do not stretch.

/// The middle and the spread of a set of values: its median and 1.4826 times its median absolute deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Robust {
    median: f32,
    spread: f32,
}

impl Robust {
    /// Of the values that are numbers. A spread below `least_spread` counts as that: a head that is its own mirror image differs by
    /// rounding alone, which is no finding.
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

    /// How many spreads a value lies above the median.
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
