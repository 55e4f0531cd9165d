//! A surface as a thin sheet of voxels.

use geometry::Grid;
use glam::DVec3;

use super::{SurfaceError, ValuedSurface};

/// How far from the surface the centre of a voxel of the sheet may be, in mm. With large voxels it is half of their diagonal, so that the
/// sheet has no holes.
pub const HALF_THICKNESS_MM: f64 = 1.0;

/// The distance between the samples of a triangle, in mm.
const STEP_MM: f64 = 0.5;

/// The most samples of all triangles: 2,000 cm² have 2 million.
const MAX_SAMPLES: u64 = 20_000_000;

/// The voxels around surfaces.
#[derive(Debug)]
pub struct Sheet {
    /// The value of each voxel of the grid; NaN away from the surfaces.
    pub numbers: Vec<f32>,
    /// How thick it is, in mm.
    pub thickness_mm: f64,
}

/// Draws surfaces into the voxels of a grid. A voxel has the value of the nearest sample of a triangle: between the vertices linear, or of
/// labels that of the nearest vertex.
///
/// # Errors
/// If the triangles are too large, or nothing lies in the grid.
pub fn sheet(
    surfaces: &[ValuedSurface],
    grid: &Grid,
    are_labels: bool,
) -> Result<Sheet, SurfaceError> {
    let spacing = DVec3::from_array(grid.spacing_mm());
    let radius_mm = HALF_THICKNESS_MM.max(spacing.length() / 2.0);
    let mut numbers = vec![f32::NAN; grid.voxel_count()];
    let mut nearest_mm = vec![f32::INFINITY; grid.voxel_count()];
    let mut is_empty = true;
    let mut samples = 0;
    for surface in surfaces {
        for triangle in &surface.triangles {
            let [a, b, c] = triangle.map(|vertex| surface.positions_in_patient[vertex as usize]);
            let values = triangle.map(|vertex| surface.values[vertex as usize]);
            let longest = (a - b).length().max((b - c).length()).max((c - a).length());
            let steps = (longest / STEP_MM).ceil().max(1.0) as u64;
            samples += steps.saturating_mul(steps) / 2 + 1;
            if samples > MAX_SAMPLES {
                return Err(SurfaceError::TooLarge);
            }
            for second in 0..=steps {
                for third in 0..=steps - second {
                    let [v, w] = [second, third].map(|part| part as f64 / steps as f64);
                    let weights = [1.0 - v - w, v, w];
                    let value = value_at(values, weights, are_labels);
                    let at = a * weights[0] + b * v + c * w;
                    if !value.is_nan() {
                        dab(grid, at, radius_mm, |voxel, apart_mm| {
                            if (apart_mm as f32) < nearest_mm[voxel] {
                                nearest_mm[voxel] = apart_mm as f32;
                                numbers[voxel] = value;
                                is_empty = false;
                            }
                        });
                    }
                }
            }
        }
    }
    if is_empty {
        return Err(SurfaceError::Outside);
    }
    Ok(Sheet {
        numbers,
        thickness_mm: 2.0 * radius_mm,
    })
}

/// The value at a place of a triangle; NaN if a vertex that counts there has none.
fn value_at(values: [f32; 3], weights: [f64; 3], is_label: bool) -> f32 {
    if is_label {
        let most = (0..3).max_by(|&one, &other| weights[one].total_cmp(&weights[other]));
        return values[most.unwrap_or_default()];
    }
    let parts = values
        .iter()
        .zip(weights)
        .filter(|(_, weight)| *weight > 0.0);
    let sum: f64 = parts
        .map(|(&value, weight)| f64::from(value) * weight)
        .sum();
    sum as f32
}

/// Calls `each` for every voxel whose centre lies within a radius of a place, with the distance in mm.
fn dab(grid: &Grid, at: DVec3, radius_mm: f64, mut each: impl FnMut(usize, f64)) {
    let reach = DVec3::splat(radius_mm) / DVec3::from_array(grid.spacing_mm());
    let middle = grid.voxel_from_patient().transform_point3(at);
    let last = DVec3::from_array(grid.size().map(|size| size as f64 - 1.0));
    let from = (middle - reach).ceil().max(DVec3::ZERO).to_array();
    let to = (middle + reach).floor().min(last).to_array();
    let range = |axis: usize| from[axis] as i64..=to[axis] as i64;
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let voxel = [x, y, z].map(|index| index as usize);
                let centre = DVec3::from_array(voxel.map(|index| index as f64));
                let centre = grid.patient_from_voxel().transform_point3(centre);
                let apart_mm = centre.distance(at);
                if apart_mm <= radius_mm {
                    each(grid.index(voxel), apart_mm);
                }
            }
        }
    }
}
