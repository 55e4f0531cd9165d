//! Limits on the dimensions of a head.

use geometry::Grid;

use super::Limits;
use super::failure::from_imaging;
use case::{Failure, FailureKind};

/// Limits on the dimensions of a volume. Anything else is rejected before it is queued, because a few kilobytes of an
/// impossible volume can cost gigabytes and minutes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadLimits {
    /// The shortest and the longest edge of a voxel, in mm.
    pub voxel_mm: [f64; 2],
    /// The shortest and the longest side of the volume, in mm.
    pub field_mm: [f64; 2],
    /// The greatest ratio of two edges of a voxel.
    pub max_ratio: f64,
}

impl Default for HeadLimits {
    fn default() -> Self {
        Self {
            voxel_mm: [0.1, 10.0],
            field_mm: [50.0, 500.0],
            max_ratio: 20.0,
        }
    }
}

impl HeadLimits {
    /// The usual limits, but for the shortest side of the volume, in mm.
    pub fn with_sides_from(shortest_mm: f64) -> Self {
        let usual = Self::default();
        Self {
            field_mm: [shortest_mm, usual.field_mm[1]],
            ..usual
        }
    }

    /// Checks the header of an upload and returns its number of voxels; `start` is the first 64 kB of the volume.
    ///
    /// # Errors
    /// A [`Failure`] that names the exceeded limit, with both numbers.
    pub fn check(&self, start: &[u8], limits: &Limits) -> Result<usize, Failure> {
        let grid = imaging::nifti::read_grid(start, limits).map_err(from_imaging)?;
        self.check_grid(&grid)?;
        Ok(grid.voxel_count())
    }

    fn check_grid(&self, grid: &Grid) -> Result<(), Failure> {
        let edges = grid.spacing_mm();
        let size = grid.size();
        let sides = [0, 1, 2].map(|axis| edges[axis] * size[axis] as f64);
        let within = |values: [f64; 3], [least, most]: [f64; 2]| {
            // 10 mm may be stored as 10.000001 mm in single precision.
            let slack = 1e-4;
            let range = least * (1.0 - slack)..=most * (1.0 + slack);
            values.iter().all(|value| range.contains(value))
        };
        if !within(edges, self.voxel_mm) {
            let [least, most] = self.voxel_mm;
            return Err(refusal(
                "voxel-size-implausible",
                format!(
                    "a voxel measures {} mm; each edge must be {least} to {most} mm",
                    product(edges)
                ),
            ));
        }
        if !within(sides, self.field_mm) {
            let [least, most] = self.field_mm;
            return Err(refusal(
                "field-implausible",
                format!(
                    "the volume measures {} mm; each side must be {least} to {most} mm",
                    product(sides)
                ),
            ));
        }
        let longest = edges.iter().copied().fold(0.0, f64::max);
        let shortest = edges.iter().copied().fold(f64::INFINITY, f64::min);
        if longest > self.max_ratio * shortest {
            let most = self.max_ratio;
            return Err(refusal(
                "voxel-ratio-implausible",
                format!(
                    "a voxel measures {} mm; no edge may be more than {most} times as long as another",
                    product(edges)
                ),
            ));
        }
        Ok(())
    }
}

fn product([x, y, z]: [f64; 3]) -> String {
    let digits = |value: f64| (value * 1000.0).round() / 1000.0;
    format!("{} × {} × {}", digits(x), digits(y), digits(z))
}

fn refusal(name: &'static str, what: String) -> Failure {
    let detail = format!(
        "{what}. If the volume is a head, correct its header; the limits of the server are configurable"
    );
    Failure::new(FailureKind::Unusable, name, detail)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn checked(size: [usize; 3], spacing_mm: [f64; 3]) -> Result<(), String> {
        let grid = Grid::aligned(size, spacing_mm, DVec3::ZERO).unwrap();
        let checked = HeadLimits::default().check_grid(&grid);
        checked.map_err(|failure| failure.name.clone())
    }

    #[test]
    fn what_no_head_has_is_refused_by_name() {
        assert_eq!(checked([256; 3], [1.0; 3]), Ok(()));
        assert_eq!(checked([512, 512, 24], [0.45, 0.45, 6.5]), Ok(()));
        assert_eq!(checked([20; 3], [10.000_001; 3]), Ok(()));
        for (size, spacing, name) in [
            ([64; 3], [100.0, 100.0, 0.01], "voxel-size-implausible"),
            ([64; 3], [1.0, 1.0, 10.5], "voxel-size-implausible"),
            ([40, 200, 200], [1.0; 3], "field-implausible"),
            ([256; 3], [2.0, 2.0, 1.0], "field-implausible"),
            ([20, 20, 500], [10.0, 10.0, 0.2], "voxel-ratio-implausible"),
        ] {
            assert_eq!(checked(size, spacing), Err(name.to_owned()));
        }
    }
}
