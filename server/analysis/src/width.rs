//! From the sharpness of a junction to its width.

use std::f64::consts::PI;

use crate::gradient::{HALF_WIDTH, sigma_for, weight};
use crate::sharpness::WINDOW_MM;

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

/// From sharpness to the width of a junction, for voxels of these edges.
pub fn width_table(spacing_mm: [f64; 3]) -> WidthTable {
    let gradient_mm = sigma_for(spacing_mm);
    let rows = ((MOST_MM - LEAST_MM) / STEP_MM).round() as usize;
    let width = |row: usize| LEAST_MM + STEP_MM * row as f64;
    let sharpness = (0..=rows).map(|row| sharpness_of(gradient_mm, width(row)) as f32);
    WidthTable {
        sharpness: sharpness.collect(),
    }
}

impl WidthTable {
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

/// The sharpness at the middle of a straight edge that rises from 0 to 1 as an error function with this deviation.
///
/// Nothing changes along the edge, so the three-dimensional filters become integrals across it.
fn sharpness_of(gradient_mm: f64, sigma_mm: f64) -> f64 {
    let sigma = sigma_mm.hypot(gradient_mm);
    let steps = (INTEGRAL_MM / INTEGRAL_STEP_MM) as i64;
    // From the middle outwards: the two sides are alike.
    let (mut rise, mut sum, mut total) = (0.5, 0.0, 0.0);
    for step in 0..=steps {
        let place = step as f64 * INTEGRAL_STEP_MM;
        let slope = normal(place / sigma) / sigma;
        let weight = f64::from(weight(rise as f32, 1.0 / HALF_WIDTH))
            * (-0.5 * (place / WINDOW_MM).powi(2)).exp()
            * if step == 0 { 0.5 } else { 1.0 };
        sum += slope * weight;
        total += weight;
        let ahead = normal((place + INTEGRAL_STEP_MM / 2.0) / sigma) / sigma;
        rise += ahead * INTEGRAL_STEP_MM;
    }
    sum / total
}

fn normal(place: f64) -> f64 {
    (-0.5 * place * place).exp() / (2.0 * PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_width_is_found_again_and_a_sharp_edge_is_only_said_to_be_sharp() {
        let sharpness_of = |width| sharpness_of(sigma_for([1.0; 3]), width) as f32;
        let table = width_table([1.0; 3]);
        for width in [1.01, 1.4, 2.3, 5.9] {
            let found = table.width(sharpness_of(width));
            let Some(JunctionWidth::Mm(found)) = found else {
                panic!("{width}: {found:?}");
            };
            assert!((f64::from(found) - width).abs() < 0.01, "{width}: {found}");
        }
        let at = |width: f64| table.width(sharpness_of(width));
        assert_eq!(at(0.9), Some(JunctionWidth::UnderOneMm));
        assert_eq!(at(7.0), Some(JunctionWidth::OverSixMm));
        assert_eq!(table.width(f32::NAN), None);
    }
}
