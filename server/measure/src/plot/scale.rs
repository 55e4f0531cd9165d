//! From numbers to places along an axis.

/// One axis of a plot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    /// Whether equal ways are equal ratios.
    pub is_log: bool,
}

impl Axis {
    /// An axis on which equal ways are equal differences; it begins at 0.
    pub fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            is_log: false,
        }
    }

    /// An axis on which equal ways are equal ratios.
    pub fn log(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            is_log: true,
        }
    }
}

/// How the numbers of an axis lie from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    is_log: bool,
}

impl Scale {
    /// Around some numbers, of which a logarithmic axis takes the positive ones.
    pub(super) fn around(axis: &Axis, numbers: impl Iterator<Item = f64>) -> Self {
        let is_log = axis.is_log;
        let shown = numbers.filter(|number| number.is_finite() && (!is_log || *number > 0.0));
        let [low, high] = shown.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], number| {
            [low.min(number), high.max(number)]
        });
        if low > high {
            return Self {
                low: if is_log { 1.0 } else { 0.0 },
                high: if is_log { 10.0 } else { 1.0 },
                is_log,
            };
        }
        if is_log {
            Self {
                low: low / 1.25,
                high: high * 1.25,
                is_log,
            }
        } else {
            let high = if high > 0.0 { high * 1.05 } else { 1.0 };
            Self {
                low: low.min(0.0),
                high,
                is_log,
            }
        }
    }

    /// Where a number lies: 0 at the low end, 1 at the high one. `None` where a logarithm has no place for it.
    pub(super) fn place(&self, number: f64) -> Option<f64> {
        if !number.is_finite() || (self.is_log && number <= 0.0) {
            return None;
        }
        Some(if self.is_log {
            (number / self.low).ln() / (self.high / self.low).ln()
        } else {
            (number - self.low) / (self.high - self.low)
        })
    }

    /// The numbers that are written along the axis.
    pub(super) fn ticks(&self) -> Vec<f64> {
        if self.is_log {
            self.log_ticks()
        } else {
            self.linear_ticks()
        }
    }

    fn linear_ticks(&self) -> Vec<f64> {
        let rough = (self.high - self.low) / 6.0;
        let unit = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|factor| factor * unit)
            .find(|step| *step >= rough)
            .unwrap_or(10.0 * unit);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|tick| tick as f64 * step).collect()
    }

    fn log_ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let factors: &[f64] = if decades < 3.0 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        (first..=last)
            .flat_map(|exponent| {
                factors
                    .iter()
                    .map(move |factor| factor * 10_f64.powi(exponent))
            })
            .filter(|tick| (self.low..=self.high).contains(tick))
            .collect()
    }
}

/// A tick's number, short.
pub(super) fn tick_text(number: f64) -> String {
    let magnitude = number.abs();
    if magnitude != 0.0 && !(1e-4..1e7).contains(&magnitude) {
        return format!("{number:.0e}");
    }
    if magnitude >= 1e6 {
        return format!("{} M", trimmed(number / 1e6));
    }
    if magnitude >= 1e4 {
        return format!("{} k", trimmed(number / 1e3));
    }
    trimmed(number)
}

fn trimmed(number: f64) -> String {
    let text = format!("{number:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_axis_begins_at_0_and_has_round_ticks() {
        let scale = Scale::around(&Axis::linear("s"), [3.0, 8.0].into_iter());
        assert_eq!(scale.ticks(), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(scale.place(0.0), Some(0.0));
        assert!((scale.place(8.4).unwrap() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_log_axis_has_its_middle_at_the_geometric_mean() {
        let scale = Scale::around(&Axis::log("s"), [10.0, 1000.0, -1.0, f64::NAN].into_iter());
        assert!((scale.place(100.0).unwrap() - 0.5).abs() < 1e-9);
        assert_eq!(scale.place(0.0), None);
        let few = [10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
        assert_eq!(scale.ticks(), few);
    }

    #[test]
    fn an_axis_of_nothing_is_still_an_axis() {
        for axis in [Axis::linear("s"), Axis::log("s")] {
            let scale = Scale::around(&axis, std::iter::empty());
            assert!(!scale.ticks().is_empty());
        }
    }

    #[test]
    fn ticks_are_short() {
        let texts = [
            (0.0, "0"),
            (0.002, "0.002"),
            (1500.0, "1500"),
            (20_000.0, "20 k"),
            (5e6, "5 M"),
            (1e-7, "1e-7"),
        ];
        for (number, text) in texts {
            assert_eq!(tick_text(number), text);
        }
    }
}
