//! Values between voxel centres, as fast as the pixels need them.

/// Trilinear interpolation of values on a grid, x-fastest; beyond the outermost voxel centres it is constant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sampler<'a, T> {
    values: &'a [T],
    /// From a voxel to its next along x, y, z; 0 along an axis of one voxel.
    strides: [usize; 3],
    /// The greatest coordinate.
    last: [f32; 3],
    /// The greatest lower corner of a cell of eight voxels.
    last_corner: [usize; 3],
}

/// A cell of eight voxels and a place in it.
struct Cell {
    corner: usize,
    fractions: [f32; 3],
}

impl<'a, T: Copy + Into<f32>> Sampler<'a, T> {
    /// Interpolates `values` on a grid of `size` voxels.
    pub(crate) fn new(values: &'a [T], size: [usize; 3]) -> Self {
        assert_eq!(values.len(), size.iter().product::<usize>());
        let [nx, ny, _] = size;
        let mut strides = [1, nx, nx * ny];
        for (stride, side) in strides.iter_mut().zip(size) {
            if side == 1 {
                *stride = 0;
            }
        }
        Self {
            values,
            strides,
            last: size.map(|side| (side - 1) as f32),
            last_corner: size.map(|side| side.saturating_sub(2)),
        }
    }

    /// Whether a position in voxel coordinates lies in a voxel: within half a voxel of a centre.
    #[inline]
    pub(crate) fn contains(&self, position: [f32; 3]) -> bool {
        (0..3).all(|axis| position[axis] >= -0.5 && position[axis] <= self.last[axis] + 0.5)
    }

    /// The value at a position in voxel coordinates.
    #[inline]
    pub(crate) fn at(&self, position: [f32; 3]) -> f32 {
        let cell = self.cell(position);
        self.in_cell(cell.corner, cell.fractions)
    }

    #[inline]
    fn cell(&self, position: [f32; 3]) -> Cell {
        let mut corner = 0;
        let mut fractions = [0.0; 3];
        let sides = [1, self.strides[1], self.strides[2]];
        for axis in 0..3 {
            let coordinate = position[axis].clamp(0.0, self.last[axis]);
            let below = (coordinate as i32 as usize).min(self.last_corner[axis]);
            fractions[axis] = coordinate - below as f32;
            corner += below * sides[axis];
        }
        Cell { corner, fractions }
    }

    #[inline]
    fn in_cell(&self, corner: usize, [x, y, z]: [f32; 3]) -> f32 {
        let [dx, dy, dz] = self.strides;
        let values = &self.values[corner..=corner + dx + dy + dz];
        let row = |start: usize| {
            let [low, high]: [f32; 2] = [values[start].into(), values[start + dx].into()];
            low + x * (high - low)
        };
        let near = row(0) + y * (row(dy) - row(0));
        let far = row(dz) + y * (row(dz + dy) - row(dz));
        near + z * (far - near)
    }

    /// The gradient at a position in voxel coordinates, per voxel: trilinear between central differences.
    #[inline]
    pub(crate) fn gradient(&self, position: [f32; 3]) -> [f32; 3] {
        // Central differences a whole voxel apart see the same fractions of their cells.
        std::array::from_fn(|axis| {
            let mut ahead = position;
            let mut behind = position;
            ahead[axis] += 1.0;
            behind[axis] -= 1.0;
            0.5 * (self.at(ahead) - self.at(behind))
        })
    }
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
            [4.0, 3.0, 2.0],
            [3.5, 0.1, 0.9],
        ] {
            assert!(
                close(sampler.at(position), function(position)),
                "{position:?}"
            );
        }
        let [x, y, z] = [2.0, 1.5, 1.0];
        let expected = [7.0 + 4.0 * y * z, -2.0 + 4.0 * x * z, 5.0 + 4.0 * x * y];
        let found = sampler.gradient([x, y, z]);
        assert!(
            (0..3).all(|axis| close(found[axis], expected[axis])),
            "{found:?}"
        );
    }

    #[test]
    fn beyond_the_grid_the_nearest_face_is_met() {
        let sampler = Sampler::new(&[1_i16, 2, 3, 4], [2, 2, 1]);
        assert_eq!(sampler.at([-9.0, 0.0, 0.0]), 1.0);
        assert_eq!(sampler.at([9.0, 9.0, 9.0]), 4.0);
        assert_eq!(sampler.at([0.5, 0.5, -0.3]), 2.5);
        assert!(sampler.contains([1.5, -0.5, 0.25]));
        assert!(!sampler.contains([1.6, 0.0, 0.0]));
        assert!(!sampler.contains([0.0, 0.0, f32::NAN]));
    }
}
