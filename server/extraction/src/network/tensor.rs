//! Activations of a layer: channels last, with a border of zeros.

use std::ops::Range;

/// Values of `channels` channels at each voxel of a block, surrounded by `border` voxels of zeros.
///
/// Channel-fastest, then x, y and z. A convolution reads its padding from the border and needs no special cases.
#[derive(Debug, Clone)]
pub(crate) struct Tensor {
    size: [usize; 3],
    channels: usize,
    border: usize,
    values: Vec<f32>,
}

impl Tensor {
    pub(crate) fn zeros(size: [usize; 3], channels: usize, border: usize) -> Self {
        let voxels: usize = size.iter().map(|side| side + 2 * border).product();
        Self {
            size,
            channels,
            border,
            values: vec![0.0; voxels * channels],
        }
    }

    /// Voxels along x, y and z, without the border.
    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Values at a voxel.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// The offset of the values of a voxel; voxels of the border have negative coordinates or coordinates beyond the
    /// size.
    ///
    /// # Panics
    /// If the voxel is not in the block or its border.
    pub(crate) fn start_of(&self, voxel: [isize; 3]) -> usize {
        let within = |axis: usize| {
            let place = voxel[axis] + self.border as isize;
            let side = self.size[axis] + 2 * self.border;
            assert!((0..side as isize).contains(&place), "a border wide enough");
            place as usize
        };
        within(0) * self.channels + within(1) * self.row_length() + within(2) * self.plane_length()
    }

    /// All values, including the border.
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// Values in a row, including the border.
    pub(crate) fn row_length(&self) -> usize {
        (self.size[0] + 2 * self.border) * self.channels
    }

    /// Values in a plane, including the border.
    pub(crate) fn plane_length(&self) -> usize {
        (self.size[1] + 2 * self.border) * self.row_length()
    }

    /// The range of the voxels of row `y` in a plane, without the border.
    pub(crate) fn row_in_plane(&self, y: usize) -> Range<usize> {
        let start = (y + self.border) * self.row_length() + self.border * self.channels;
        start..start + self.size[0] * self.channels
    }

    /// The ranges of the voxels of all rows in a plane, without the border.
    pub(crate) fn rows_in_plane(&self) -> Vec<Range<usize>> {
        (0..self.size[1]).map(|y| self.row_in_plane(y)).collect()
    }

    /// The planes that are not border, for reading; each includes its border.
    pub(crate) fn planes(&self) -> &[f32] {
        let plane = self.plane_length();
        &self.values[self.border * plane..(self.border + self.size[2]) * plane]
    }

    /// The planes that are not border, for writing; each includes its border.
    pub(crate) fn planes_mut(&mut self) -> &mut [f32] {
        let plane = self.plane_length();
        &mut self.values[self.border * plane..(self.border + self.size[2]) * plane]
    }
}
