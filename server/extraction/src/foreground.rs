//! Whether a volume can be that of a head: an estimate in milliseconds, before an extraction that takes seconds.

use geometry::Volume;

use crate::ExtractionError;
use crate::pruning::Classes;

/// More than any head with its neck and shoulders, in ml.
const MOST_ML: f64 = 20_000.0;

/// The least share of the foreground that foreground surrounds. In the noise of a scanner or of a generator that is half
/// bright, it is one in 64; in tissue, most of it is.
const LEAST_INSIDE: f64 = 0.05;

/// About so many voxels are looked at.
const LOOKED_AT: usize = 1 << 18;

/// Checks that the brighter part of a volume is not larger than a head, and that it is no noise.
///
/// # Errors
/// [`ExtractionError::NoBrain`] otherwise. A volume with a single intensity passes; the extraction says what is wrong with it.
pub fn check_foreground(volume: &Volume) -> Result<(), ExtractionError> {
    let [nx, ny, nz] = volume.grid().size();
    let voxels = volume.voxels();
    let intensity = |index: usize| volume.intensity(f32::from(voxels[index]));
    let every = (voxels.len() / LOOKED_AT).max(1);
    let looked_at: Vec<f32> = (0..voxels.len()).step_by(every).map(intensity).collect();
    let Some(threshold) = Classes::of(&looked_at).map(|classes| classes.threshold) else {
        return Ok(());
    };
    let is_bright = |index: usize| intensity(index) > threshold;
    let (mut bright, mut inner, mut inside) = (0usize, 0usize, 0usize);
    for index in (0..voxels.len()).step_by(every) {
        if !is_bright(index) {
            continue;
        }
        bright += 1;
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)];
        let sides = [(x, nx, 1), (y, ny, nx), (z, nz, nx * ny)];
        if sides.iter().any(|&(at, side, _)| at == 0 || at + 1 == side) {
            continue;
        }
        inner += 1;
        let is_inside = sides
            .iter()
            .all(|&(_, _, step)| is_bright(index - step) && is_bright(index + step));
        inside += usize::from(is_inside);
    }
    let spacing = volume.grid().spacing_mm();
    let bright_ml = (bright * every) as f64 * spacing.iter().product::<f64>() / 1000.0;
    if bright_ml > MOST_ML {
        return Err(ExtractionError::NoBrain {
            what: "what is brighter than its surroundings is larger than a head, so its spacing may not be in mm",
        });
    }
    if inner > 0 && (inside as f64) < LEAST_INSIDE * inner as f64 {
        return Err(ExtractionError::NoBrain {
            what: "it is noise",
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use geometry::phantom::head;
    use geometry::{Grid, Rescale};
    use glam::{DAffine3, DVec3};

    use super::*;

    /// A cube of so many voxels along each side.
    fn cube(side: usize, spacing_mm: f64, value: impl Fn([usize; 3]) -> u16) -> Volume {
        let affine = DAffine3::from_scale(DVec3::splat(spacing_mm));
        let grid = Grid::new([side; 3], affine).unwrap();
        let at = |index: usize| [index % side, index / side % side, index / (side * side)];
        let voxels = (0..side.pow(3)).map(|index| value(at(index))).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        Volume::new(grid, voxels, rescale).unwrap()
    }

    fn reason(volume: &Volume) -> Option<&'static str> {
        match check_foreground(volume) {
            Ok(()) => None,
            Err(ExtractionError::NoBrain { what }) => Some(what),
            Err(other) => panic!("{other}"),
        }
    }

    /// A generator of noise: the upper bits of a linear congruence.
    fn noise() -> impl Fn([usize; 3]) -> u16 {
        let state = std::cell::Cell::new(1u64);
        move |_| {
            let next = state.get().wrapping_mul(6_364_136_223_846_793_005);
            state.set(next.wrapping_add(1_442_695_040_888_963_407));
            (state.get() >> 54) as u16
        }
    }

    #[test]
    fn heads_pass_at_any_spacing() {
        for spacing_mm in [2.0, 4.0] {
            assert_eq!(reason(&head(spacing_mm).volume), None, "{spacing_mm} mm");
        }
        assert_eq!(reason(&cube(20, 8.0, |_| 7)), None, "a single intensity");
    }

    #[test]
    fn a_block_of_the_size_of_a_barrel_is_no_head() {
        let block = cube(50, 10.0, |at| {
            100 * u16::from(at.iter().all(|side| (10..40).contains(side)))
        });
        assert!(reason(&block).unwrap().contains("larger than a head"));
        let small = cube(50, 5.0, |at| {
            100 * u16::from(at.iter().all(|side| (10..40).contains(side)))
        });
        assert_eq!(reason(&small), None, "3.4 l");
    }

    #[test]
    fn noise_is_no_head() {
        for (side, spacing_mm) in [(50, 10.0), (50, 4.0), (120, 2.0)] {
            assert!(reason(&cube(side, spacing_mm, noise())).is_some());
        }
        assert_eq!(reason(&cube(50, 4.0, noise())), Some("it is noise"));
    }
}
