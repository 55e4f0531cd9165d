//! Helpers for tests of the network.

use super::tensor::Tensor;

/// A pseudo-random number from -1 to 1, determined by the state.
pub(super) fn random(state: &mut u32) -> f32 {
    *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    (*state >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// A pseudo-random tensor with a border of zeros.
pub(super) fn random_tensor(
    size: [usize; 3],
    channels: usize,
    border: usize,
    state: &mut u32,
) -> Tensor {
    let mut tensor = Tensor::zeros(size, channels, border);
    let (rows, plane) = (tensor.rows_in_plane(), tensor.plane_length());
    for plane in tensor.planes_mut().chunks_exact_mut(plane) {
        for row in &rows {
            plane[row.clone()].fill_with(|| random(state));
        }
    }
    tensor
}

/// One value of a tensor or its border.
pub(super) fn value(tensor: &Tensor, voxel: [isize; 3], channel: usize) -> f32 {
    tensor.values()[tensor.start_of(voxel) + channel]
}
