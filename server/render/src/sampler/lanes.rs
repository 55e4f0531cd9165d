//! Samples many positions together, step by step, so that the compiler makes vectors and no load waits for another.

use super::{EDGE, Sampler, between};

/// Positions sampled together.
pub(crate) const LANES: usize = 64;

/// A number for each position of a group.
pub(crate) type Lanes = [f32; LANES];

impl Sampler<'_, i16> {
    /// The values at `count` positions in voxel coordinates, given by axis; those of [`Sampler::at`].
    ///
    /// Step by step for all of them, so that the compiler makes vectors, and no load waits for another.
    #[inline(always)]
    pub(crate) fn at_each(&self, positions: &[Lanes; 3], count: usize, values: &mut Lanes) {
        let mut cells = [0; LANES];
        let mut places = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let position = [positions[0][lane], positions[1][lane], positions[2][lane]];
            let (cell, place) = self.cell(position);
            cells[lane] = cell;
            [places[0][lane], places[1][lane], places[2][lane]] = place;
        }
        let [_, dy, dz] = self.strides;
        let mut pairs = [[0; LANES]; 4];
        for lane in 0..count {
            let first = cells[lane] as usize;
            pairs[0][lane] = self.pair(first);
            pairs[1][lane] = self.pair(first + dy);
            pairs[2][lane] = self.pair(first + dz);
            pairs[3][lane] = self.pair(first + dz + dy);
        }
        for lane in 0..LANES {
            let [x, y, z] = [places[0][lane], places[1][lane], places[2][lane]];
            let [v00, v10, v01, v11] = [
                between_both(pairs[0][lane], x),
                between_both(pairs[1][lane], x),
                between_both(pairs[2][lane], x),
                between_both(pairs[3][lane], x),
            ];
            values[lane] = between(between(v00, v10, y), between(v01, v11, y), z);
        }
    }

    /// The gradients at `count` positions in voxel coordinates, given by axis; those of [`Sampler::gradient`], and 0
    /// where there is none.
    #[inline(always)]
    pub(crate) fn gradient_at_each(
        &self,
        positions: &[Lanes; 3],
        count: usize,
        gradients: &mut [Lanes; 3],
    ) {
        if self.last.iter().any(|&last| last < 3.0) {
            gradients.iter_mut().for_each(|axis| axis.fill(0.0));
            return;
        }
        let mut cells = [0; LANES];
        let mut places = [[0.0; LANES]; 3];
        // Where there is no gradient, 0; elsewhere the half of central differences.
        let mut factors = [0.0; LANES];
        for lane in 0..LANES {
            let position = [positions[0][lane], positions[1][lane], positions[2][lane]];
            let inside = |axis: usize| {
                (position[axis] >= 1.0 + EDGE) & (position[axis] < self.last[axis] - 1.0)
            };
            let is_inside = inside(0) & inside(1) & inside(2);
            let (cell, place) = self.cell(position);
            let [_, dy, dz] = self.strides;
            cells[lane] = if is_inside {
                cell
            } else {
                (1 + dy + dz) as u32
            };
            [places[0][lane], places[1][lane], places[2][lane]] = place;
            factors[lane] = if is_inside { 0.5 } else { 0.0 };
        }
        let mut taps = [[0; LANES]; 16];
        for lane in 0..count {
            let around = self.around(cells[lane] as usize);
            for (tap, pair) in taps.iter_mut().zip(around) {
                tap[lane] = pair;
            }
        }
        for lane in 0..LANES {
            let around = std::array::from_fn(|tap| taps[tap][lane]);
            let place = [places[0][lane], places[1][lane], places[2][lane]];
            let gradient = gradient_between(around, place);
            for (axis, component) in gradients.iter_mut().zip(gradient) {
                axis[lane] = factors[lane] * component;
            }
        }
    }

    /// A voxel's value and that of the next along x, in the lower and the upper half; twice the same along an axis of
    /// one voxel.
    #[inline(always)]
    fn pair(&self, index: usize) -> u32 {
        match self.values[index..].first_chunk() {
            Some(&[low, high]) if self.strides[0] == 1 => packed(low, high),
            _ => packed(self.values[index], self.values[index]),
        }
    }

    /// The 32 values that the gradient in a cell stands on, in pairs along x: four for each of the cell's edges along
    /// x, then two before and two behind the cell at either y and either z.
    #[inline(always)]
    fn around(&self, cell: usize) -> [u32; 16] {
        let [_, dy, dz] = self.strides;
        let values = &self.values[cell - dz..];
        let cell = dz;
        let pair = |start: usize| match values[start..].first_chunk() {
            Some(&[low, high]) => packed(low, high),
            None => 0,
        };
        [
            pair(cell - 1),
            pair(cell + 1),
            pair(cell + dy - 1),
            pair(cell + dy + 1),
            pair(cell + dz - 1),
            pair(cell + dz + 1),
            pair(cell + dz + dy - 1),
            pair(cell + dz + dy + 1),
            pair(cell - dy),
            pair(cell + 2 * dy),
            pair(cell + dz - dy),
            pair(cell + dz + 2 * dy),
            pair(cell - dz),
            pair(cell + 2 * dz),
            pair(cell + dy - dz),
            pair(cell + dy + 2 * dz),
        ]
    }
}

/// Twice the gradient from [`Sampler::around`] at a place in the cell.
#[inline(always)]
fn gradient_between(around: [u32; 16], [x, y, z]: [f32; 3]) -> [f32; 3] {
    // The difference along x, and the value, on one of the cell's edges along x.
    let four = |first: u32, second: u32| {
        let [[a, b], [c, d]] = [unpacked(first), unpacked(second)];
        [between(c - a, d - b, x), between(b, c, x)]
    };
    let [x00, v00] = four(around[0], around[1]);
    let [x10, v10] = four(around[2], around[3]);
    let [x01, v01] = four(around[4], around[5]);
    let [x11, v11] = four(around[6], around[7]);
    let pair = |tap: usize| between_both(around[tap], x);
    let near_y = between(v10 - pair(8), pair(9) - v00, y);
    let far_y = between(v11 - pair(10), pair(11) - v01, y);
    let left_z = between(v01 - pair(12), pair(13) - v00, z);
    let right_z = between(v11 - pair(14), pair(15) - v10, z);
    [
        between(between(x00, x10, y), between(x01, x11, y), z),
        between(near_y, far_y, z),
        between(left_z, right_z, y),
    ]
}

#[inline(always)]
fn packed(low: i16, high: i16) -> u32 {
    u32::from(low as u16) | u32::from(high as u16) << 16
}

#[inline(always)]
fn unpacked(pair: u32) -> [f32; 2] {
    [
        ((pair << 16) as i32 >> 16) as f32,
        (pair as i32 >> 16) as f32,
    ]
}

#[inline(always)]
fn between_both(pair: u32, fraction: f32) -> f32 {
    let [low, high] = unpacked(pair);
    between(low, high, fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places within a grid of 9 × 8 × 7 voxels, on its faces and beyond them, and none at all.
    fn positions() -> [Lanes; 3] {
        let coordinate = |lane: usize, axis: usize| match lane {
            0 => f32::NAN,
            1 => f32::NEG_INFINITY,
            2 => axis as f32,
            3 => 1.0 + EDGE,
            _ => ((lane * (17 + 5 * axis)) % 97) as f32 / 8.0 - 1.5,
        };
        std::array::from_fn(|axis| std::array::from_fn(|lane| coordinate(lane, axis)))
    }

    #[test]
    fn positions_looked_at_together_give_what_each_gives_alone() {
        let values: Vec<i16> = (0..504)
            .map(|index| (index * 7919 % 4001 - 2000) as i16)
            .collect();
        let positions = positions();
        for size in [[9, 8, 7], [1, 8, 63], [63, 8, 1], [2, 126, 2]] {
            let sampler = Sampler::new(&values, size);
            let mut found = [0.0; LANES];
            sampler.at_each(&positions, LANES, &mut found);
            let mut gradients = [[0.0; LANES]; 3];
            sampler.gradient_at_each(&positions, LANES, &mut gradients);
            for lane in 0..LANES {
                let position = positions.map(|axis| axis[lane]);
                assert_eq!(found[lane], sampler.at(position), "{size:?} {position:?}");
                assert_eq!(
                    gradients.map(|axis| axis[lane]),
                    sampler.gradient(position).unwrap_or_default(),
                    "{size:?} {position:?}"
                );
            }
        }
    }
}
