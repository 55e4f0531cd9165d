//! Fast interpolation between voxel centres.

mod lanes;

pub(crate) use lanes::{LANES, Lanes};

/// 1.5 · 2²³: a sum with it is rounded to a whole number, which then stands in its lowest bits.
const ROUNDER: f32 = 12_582_912.0;

/// How far from the last voxel centre a coordinate is kept, so that rounding never reaches past it.
const EDGE: f32 = 1.0 / 1024.0;

/// Trilinear interpolation of values on a grid, x-fastest; beyond the outermost voxel centres it is constant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sampler<'a, T> {
    values: &'a [T],
    /// From a voxel to its next along x, y, z; 0 along an axis of one voxel.
    strides: [usize; 3],
    /// Coordinates of the last voxel centre.
    last: [f32; 3],
    /// The greatest coordinates that are interpolated.
    limit: [f32; 3],
}

impl<'a, T: Copy + Into<f32>> Sampler<'a, T> {
    /// Interpolates `values` on a grid of `size` voxels.
    pub(crate) fn new(values: &'a [T], size: [usize; 3]) -> Self {
        assert_eq!(values.len(), size.iter().product::<usize>());
        let mut strides = [1, size[0], size[0] * size[1]];
        for (stride, side) in strides.iter_mut().zip(size) {
            if side == 1 {
                *stride = 0;
            }
        }
        let last = size.map(|side| (side - 1) as f32);
        Self {
            values,
            strides,
            last,
            limit: last.map(|last| (last - EDGE).max(0.0)),
        }
    }

    /// The value of the voxel with an index.
    pub(crate) fn of_voxel(&self, index: usize) -> f32 {
        self.values[index].into()
    }

    /// Whether a position in voxel coordinates lies in a voxel: within half a voxel of a centre.
    #[inline(always)]
    pub(crate) fn contains(&self, position: [f32; 3]) -> bool {
        let inside =
            |axis: usize| (position[axis] >= -0.5) & (position[axis] <= self.last[axis] + 0.5);
        inside(0) & inside(1) & inside(2)
    }

    /// The value at a position in voxel coordinates; `None` outside.
    #[inline(always)]
    pub(crate) fn value_at(&self, position: [f32; 3]) -> Option<f32> {
        self.contains(position).then(|| self.at(position))
    }

    /// The value at a position in voxel coordinates; outside, that of the nearest point.
    #[inline(always)]
    pub(crate) fn at(&self, position: [f32; 3]) -> f32 {
        let (corner, fractions) = self.cell(position);
        trilinear(self.corners(corner), fractions)
    }

    /// The value of the voxel nearest to a position in voxel coordinates.
    #[inline(always)]
    pub(crate) fn nearest(&self, position: [f32; 3]) -> f32 {
        let step = |axis: usize| {
            let place = position[axis].clamp(0.0, self.last[axis]);
            (place + 0.5) as usize * self.strides[axis]
        };
        self.values[step(0) + step(1) + step(2)].into()
    }

    /// The cell of eight voxels that a position in voxel coordinates lies in, as its first voxel, and where in it, 0 to
    /// 1.
    #[inline(always)]
    pub(crate) fn cell(&self, position: [f32; 3]) -> (u32, [f32; 3]) {
        let [(i, x), (j, y), (k, z)] = [
            whole_and_fraction(position[0], self.limit[0]),
            whole_and_fraction(position[1], self.limit[1]),
            whole_and_fraction(position[2], self.limit[2]),
        ];
        let [_, dy, dz] = self.strides;
        (i + j * dy as u32 + k * dz as u32, [x, y, z])
    }

    /// The values of a cell's eight voxels, x-fastest.
    #[inline(always)]
    pub(crate) fn corners(&self, corner: u32) -> [f32; 8] {
        let [dx, dy, dz] = self.strides;
        let value = |index: usize| -> f32 { self.values[index].into() };
        let first = corner as usize;
        let [second, third, fourth] = [first + dy, first + dz, first + dy + dz];
        [
            value(first),
            value(first + dx),
            value(second),
            value(second + dx),
            value(third),
            value(third + dx),
            value(fourth),
            value(fourth + dx),
        ]
    }

    /// The gradient at a position in voxel coordinates, per voxel: trilinear between central differences.
    ///
    /// `None` within a voxel of the grid's faces, where there is nothing to take a difference with.
    #[inline]
    pub(crate) fn gradient(&self, position: [f32; 3]) -> Option<[f32; 3]> {
        let inside =
            |axis: usize| position[axis] >= 1.0 + EDGE && position[axis] < self.last[axis] - 1.0;
        if !(0..3).all(inside) {
            return None;
        }
        let [(i, x), (j, y), (k, z)] = [
            whole_and_fraction(position[0], self.limit[0]),
            whole_and_fraction(position[1], self.limit[1]),
            whole_and_fraction(position[2], self.limit[2]),
        ];
        let [_, dy, dz] = self.strides;
        let corner = i as usize + j as usize * dy + k as usize * dz;
        // From the first value that is needed on; none is as far from it as three slices and a row.
        let values = &self.values[corner - dz..];
        let corner = dz;
        let pair = |start: usize| {
            let row: &[T; 2] = values[start..].first_chunk().expect("within the grid");
            between(row[0].into(), row[1].into(), x)
        };
        let four = |start: usize| {
            let row: &[T; 4] = values[start - 1..].first_chunk().expect("within the grid");
            let [a, b, c, d]: [f32; 4] =
                [row[0].into(), row[1].into(), row[2].into(), row[3].into()];
            [between(c - a, d - b, x), between(b, c, x)]
        };
        let [[x00, v00], [x10, v10]] = [four(corner), four(corner + dy)];
        let [[x01, v01], [x11, v11]] = [four(corner + dz), four(corner + dz + dy)];
        let [before_y, after_y] = [corner - dy, corner + 2 * dy];
        let [before_z, after_z] = [corner - dz, corner + 2 * dz];
        let along_x = between(between(x00, x10, y), between(x01, x11, y), z);
        let near_y = between(v10 - pair(before_y), pair(after_y) - v00, y);
        let far_y = between(v11 - pair(before_y + dz), pair(after_y + dz) - v01, y);
        let left_z = between(v01 - pair(before_z), pair(after_z) - v00, z);
        let right_z = between(v11 - pair(before_z + dy), pair(after_z + dy) - v10, z);
        let along_y = between(near_y, far_y, z);
        let along_z = between(left_z, right_z, y);
        Some([0.5 * along_x, 0.5 * along_y, 0.5 * along_z])
    }
}

/// Trilinear interpolation between the values of a cell's eight voxels.
#[inline(always)]
pub(crate) fn trilinear(corners: [f32; 8], [x, y, z]: [f32; 3]) -> f32 {
    let [a, b, c, d, e, f, g, h] = corners;
    let near = between(between(a, b, x), between(c, d, x), y);
    let far = between(between(e, f, x), between(g, h, x), y);
    between(near, far, z)
}

#[inline(always)]
fn between(low: f32, high: f32, fraction: f32) -> f32 {
    low + fraction * (high - low)
}

/// A coordinate brought to 0..=`limit`, as the voxel centre at or before it and the rest, 0 to 1.
#[inline(always)]
fn whole_and_fraction(coordinate: f32, limit: f32) -> (u32, f32) {
    // Not `clamp`: what is not a number becomes 0, and each line is one instruction.
    let coordinate = if coordinate > 0.0 { coordinate } else { 0.0 };
    let coordinate = if coordinate < limit {
        coordinate
    } else {
        limit
    };
    let rounded = rounded_down(coordinate);
    (whole_of(rounded), coordinate - (rounded - ROUNDER))
}

/// The whole number at or just before a coordinate of 0 to 2²²; anything for others.
#[inline(always)]
pub(crate) fn whole(coordinate: f32) -> u32 {
    whole_of(rounded_down(coordinate))
}

/// [`ROUNDER`] more than the whole number at or just before a coordinate.
#[inline(always)]
fn rounded_down(coordinate: f32) -> f32 {
    (coordinate - 0.5) + ROUNDER
}

#[inline(always)]
fn whole_of(rounded: f32) -> u32 {
    rounded.to_bits().wrapping_sub(ROUNDER.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f32, expected: f32) -> bool {
        (found - expected).abs() < 1e-4
    }

    #[test]
    fn a_trilinear_function_is_met_exactly() {
        let size = [5, 4, 3];
        let function = |[x, y, z]: [f32; 3]| 3.0 + 7.0 * x - 2.0 * y + 5.0 * z + 4.0 * x * y * z;
        let values: Vec<u16> = (0..60)
            .map(|index| function([index % 5, index / 5 % 4, index / 20].map(|c| c as f32)) as u16)
            .collect();
        let sampler = Sampler::new(&values, size);
        for position in [
            [0.0, 0.0, 0.0],
            [1.25, 0.5, 1.75],
            [3.0, 2.0, 1.0],
            [3.5, 0.1, 0.9],
        ] {
            assert!(
                close(sampler.at(position), function(position)),
                "{position:?}"
            );
        }
    }

    #[test]
    fn the_gradient_is_that_of_central_differences() {
        let size = [6, 5, 7];
        let values: Vec<i16> = (0..210).map(|index| (index * 7919 % 1009) as i16).collect();
        let sampler = Sampler::new(&values, size);
        for position in [
            [1.01, 1.01, 1.01],
            [2.25, 1.5, 3.75],
            [3.9, 2.9, 4.1],
            [1.5, 2.0, 2.5],
        ] {
            let found = sampler.gradient(position).unwrap();
            for axis in 0..3 {
                let shifted = |step: f32| {
                    let mut position = position;
                    position[axis] += step;
                    sampler.at(position)
                };
                let expected = 0.5 * (shifted(1.0) - shifted(-1.0));
                assert!(
                    (found[axis] - expected).abs() < 1e-2,
                    "{position:?} {found:?}"
                );
            }
        }
        assert_eq!(sampler.gradient([0.5, 2.0, 2.0]), None);
        assert_eq!(sampler.gradient([2.0, 3.5, 2.0]), None);
        assert_eq!(sampler.gradient([2.0, f32::NAN, 2.0]), None);
    }

    #[test]
    fn beyond_the_grid_the_nearest_face_is_met() {
        let sampler = Sampler::new(&[1_i16, 2, 3, 4], [2, 2, 1]);
        assert_eq!(sampler.at([-9.0, 0.0, 0.0]), 1.0);
        assert!((sampler.at([9.0, 9.0, 9.0]) - 4.0).abs() < 0.01);
        assert_eq!(sampler.at([0.5, 0.5, -0.3]), 2.5);
        assert!(sampler.contains([1.5, -0.5, 0.25]));
        assert!(!sampler.contains([1.6, 0.0, 0.0]));
        assert!(!sampler.contains([0.0, 0.0, f32::NAN]));
    }
}
