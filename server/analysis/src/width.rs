//! From the sharpness of a junction to its width.

use std::f64::consts::PI;

use crate::gradient::weight;

/// The least measurable width, in mm.
const LEAST_MM: f64 = 1.0;
/// The greatest width of the table, in mm, and the step between its rows.
const MOST_MM: f64 = 6.0;
const STEP_MM: f64 = 0.125;
/// Step and half-width of the integral, in mm.
const INTEGRAL_STEP_MM: f64 = 0.05;
const INTEGRAL_MM: f64 = 12.0;

/// The width of a junction: the standard deviation of the best-matching error function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JunctionWidth {
    /// Less than the least measurable width.
    UnderOneMm,
    /// The width, in mm.
    Mm(f32),
    /// More than the end of the table.
    OverSixMm,
}

/// The sharpness of a straight junction of each width.
#[derive(Debug, Clone, PartialEq)]
pub struct WidthTable {
    /// The sharpness for widths from 1 mm on, descending.
    sharpness: Vec<f32>,
}

/// The filters for an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgeFilters {
    /// The Gaussian of the gradient, in mm.
    pub(crate) gradient_mm: f64,
    /// The half-width of the weight, in tissue scale.
    pub(crate) half_width: f32,
    /// The Gaussian of the window, in mm.
    pub(crate) window_mm: f64,
}

impl WidthTable {
    pub(crate) fn new(filters: EdgeFilters) -> Self {
        let rows = ((MOST_MM - LEAST_MM) / STEP_MM).round() as usize;
        let width = |row: usize| LEAST_MM + STEP_MM * row as f64;
        let sharpness = (0..=rows).map(|row| filters.sharpness_of(width(row)) as f32);
        Self {
            sharpness: sharpness.collect(),
        }
    }

    /// The width of a junction of this sharpness (per mm); `None` if the sharpness is undefined.
    pub fn width(&self, sharpness: f32) -> Option<JunctionWidth> {
        if sharpness.is_nan() {
            return None;
        }
        let after = self.sharpness.iter().position(|&row| row <= sharpness);
        Some(match after {
            Some(0) => JunctionWidth::UnderOneMm,
            None => JunctionWidth::OverSixMm,
            Some(after) => {
                let [high, low] = [self.sharpness[after - 1], self.sharpness[after]];
                let part = (high - sharpness) / (high - low);
                let rows = (after - 1) as f32 + part;
                JunctionWidth::Mm(LEAST_MM as f32 + STEP_MM as f32 * rows)
            }
        })
    }
}

impl EdgeFilters {
    /// The sharpness at the middle of a straight edge that rises from 0 to 1 as an error function with this deviation.
    ///
    /// Nothing changes along the edge, so the three-dimensional filters become integrals across it.
    fn sharpness_of(&self, sigma_mm: f64) -> f64 {
        let sigma = sigma_mm.hypot(self.gradient_mm);
        let steps = (INTEGRAL_MM / INTEGRAL_STEP_MM) as i64;
        // From the middle outwards: the two sides are alike.
        let (mut rise, mut sum, mut total) = (0.5, 0.0, 0.0);
        for step in 0..=steps {
            let place = step as f64 * INTEGRAL_STEP_MM;
            let slope = normal(place / sigma) / sigma;
            let weight = f64::from(weight(rise as f32, 1.0 / self.half_width))
                * (-0.5 * (place / self.window_mm).powi(2)).exp()
                * if step == 0 { 0.5 } else { 1.0 };
            sum += slope * weight;
            total += weight;
            let ahead = normal((place + INTEGRAL_STEP_MM / 2.0) / sigma) / sigma;
            rise += ahead * INTEGRAL_STEP_MM;
        }
        sum / total
    }
}

fn normal(place: f64) -> f64 {
    (-0.5 * place * place).exp() / (2.0 * PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_width_is_found_again_and_a_sharp_edge_is_only_said_to_be_sharp() {
        let filters = EdgeFilters {
            gradient_mm: 0.65,
            half_width: 0.5,
            window_mm: 2.5,
        };
        let table = WidthTable::new(filters);
        for width in [1.01, 1.4, 2.3, 5.9] {
            let found = table.width(filters.sharpness_of(width) as f32);
            let Some(JunctionWidth::Mm(found)) = found else {
                panic!("{width}: {found:?}");
            };
            assert!((f64::from(found) - width).abs() < 0.01, "{width}: {found}");
        }
        let at = |width: f64| table.width(filters.sharpness_of(width) as f32);
        assert_eq!(at(0.9), Some(JunctionWidth::UnderOneMm));
        assert_eq!(at(7.0), Some(JunctionWidth::OverSixMm));
        assert_eq!(table.width(f32::NAN), None);
    }
}
