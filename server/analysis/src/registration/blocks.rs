//! How well the parts of the head fit if each may shift by itself, which distinguishes the same head at the correct
//! placement.

use glam::Vec3;

use super::metric::{BlockFit, Blocks, Comparison, PLACES_PASSED};
use super::pose::Pose;

/// Edge of a block, in mm.
const BLOCK_MM: f32 = 36.0;
/// The least fraction of the points of a whole block that a block must have, covered by the layer.
const LEAST_FILLED: f64 = 0.35;
/// The trial shifts of each block to either side, in mm, one round after the other.
const REACHES_MM: [f32; 3] = [4.0, 2.5, 1.5];
/// The greatest shift of a block along an axis, in mm.
const FARTHEST_MM: f32 = 8.0;

/// The shift of each part of the head that the layer covers, in mm.
///
/// Each part is shifted by itself to where its intensities fit the joint histogram of the whole best.
pub(super) fn shifts_of_parts_mm(comparison: &Comparison, pose: Pose, step_mm: f64) -> Vec<f32> {
    let fit = comparison.joint(pose).fit();
    let mut blocks = divided(comparison.places());
    let fits = |blocks: &Blocks| comparison.fit_of_blocks(&fit, pose, blocks);
    let begun = fits(&blocks);
    for reach in REACHES_MM {
        for axis in 0..3 {
            let here = fits(&blocks);
            let lower = fits(&blocks.moved(axis, -reach));
            let upper = fits(&blocks.moved(axis, reach));
            for (block, shift) in blocks.shifts.iter_mut().enumerate() {
                let told = [lower[block], here[block], upper[block]].map(BlockFit::mean);
                let next = shift[axis] + reach * summit(told);
                shift[axis] = next.clamp(-FARTHEST_MM, FARTHEST_MM);
            }
        }
    }
    let whole = f64::from(BLOCK_MM).powi(3) / step_mm.powi(3) / PLACES_PASSED as f64;
    let kept = blocks.shifts.iter().zip(&begun);
    kept.filter(|(_, begun)| begun.count >= LEAST_FILLED * whole)
        .map(|(shift, _)| shift.length())
        .collect()
}

impl Blocks {
    fn moved(&self, axis: usize, by_mm: f32) -> Self {
        let mut shifts = self.shifts.clone();
        for shift in &mut shifts {
            shift[axis] += by_mm;
        }
        Self {
            of_place: self.of_place.clone(),
            shifts,
        }
    }
}

/// The maximum in −1 to 1 of a parabola through values at −1, 0 and 1.
fn summit([lower, here, upper]: [f64; 3]) -> f32 {
    let bend = lower - 2.0 * here + upper;
    let place = if bend < 0.0 {
        (lower - upper) / (2.0 * bend)
    } else if upper > lower {
        1.0
    } else {
        -1.0
    };
    place.clamp(-1.0, 1.0) as f32
}

/// Cubes around the centre.
fn divided(places: &[Vec3]) -> Blocks {
    const SIDE: u16 = 16;
    let number = |place: &Vec3| {
        let cube = (*place / BLOCK_MM + Vec3::splat(f32::from(SIDE) / 2.0) + 0.5)
            .clamp(Vec3::ZERO, Vec3::splat(f32::from(SIDE - 1)));
        let [x, y, z] = cube.to_array().map(|cell| cell as u16);
        x + SIDE * (y + SIDE * z)
    };
    let numbers: Vec<u16> = places.iter().map(number).collect();
    let mut used: Vec<u16> = numbers.clone();
    used.sort_unstable();
    used.dedup();
    let renumbered = |number: &u16| used.binary_search(number).expect("it is used") as u16;
    Blocks {
        of_place: numbers.iter().map(renumbered).collect(),
        shifts: vec![Vec3::ZERO; used.len()],
    }
}
