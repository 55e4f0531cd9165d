//! The inner loop of every convolution: one row of its output.

use multiversion::multiversion;

use super::normalisation::Sums;

/// The inputs of one output row of a convolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    /// The values of the input.
    pub(crate) input: &'a [f32],
    /// The offset in them of each row that the first output reads.
    pub(crate) starts: &'a [usize],
    /// The offset from the values of one output to those of the next.
    pub(crate) step: usize,
    /// The number of values that an output reads in each row.
    pub(crate) seen: usize,
    /// For each block of channels, row and input value: a weight for each channel of the block.
    pub(crate) weights: &'a [f32],
    /// Channels in a block: 8 or 16.
    pub(crate) lanes: usize,
    /// The bias of each channel; empty for none.
    pub(crate) bias: &'a [f32],
    /// The number of output channels.
    pub(crate) outputs: usize,
    /// The first voxel to write.
    pub(crate) first: usize,
    /// The distance from one written voxel to the next.
    pub(crate) stride: usize,
}

/// Fills the voxels of an output row and adds them to the sums of their channels.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn convolve_row(row: &Row<'_>, output: &mut [f32], sums: &mut [Sums]) {
    // Eight registers of eight sums each fit in sixteen registers and keep two units busy.
    if row.lanes == 16 {
        fill::<4, 16>(row, output, sums);
    } else {
        fill::<8, 8>(row, output, sums);
    }
}

#[inline(always)]
fn fill<const VOXELS: usize, const LANES: usize>(
    row: &Row<'_>,
    output: &mut [f32],
    sums: &mut [Sums],
) {
    let block_length = row.starts.len() * row.seen * LANES;
    let voxels = output.len() / row.outputs / row.stride;
    for (block, weights) in row.weights.chunks_exact(block_length).enumerate() {
        let channel = block * LANES;
        let channels = LANES.min(row.outputs - channel);
        let mut start = [0.0; LANES];
        if let Some(bias) = row.bias.get(channel..channel + channels) {
            start[..channels].copy_from_slice(bias);
        }
        let mut total = [[0.0; LANES]; 2];
        let mut store = |voxel: usize, values: &[f32; LANES]| {
            let place = (row.first + voxel * row.stride) * row.outputs + channel;
            output[place..place + channels].copy_from_slice(&values[..channels]);
            for lane in 0..LANES {
                let value = f64::from(values[lane]);
                total[0][lane] += value;
                total[1][lane] += value * value;
            }
        };
        let mut voxel = 0;
        while voxel + VOXELS <= voxels {
            let values = products::<VOXELS, LANES>(row, weights, voxel, start);
            for (offset, values) in values.iter().enumerate() {
                store(voxel + offset, values);
            }
            voxel += VOXELS;
        }
        while voxel < voxels {
            store(voxel, &products::<1, LANES>(row, weights, voxel, start)[0]);
            voxel += 1;
        }
        for (lane, sums) in sums[channel..channel + channels].iter_mut().enumerate() {
            sums.values += total[0][lane];
            sums.squares += total[1][lane];
        }
    }
}

/// The outputs at some consecutive voxels.
#[inline(always)]
fn products<const VOXELS: usize, const LANES: usize>(
    row: &Row<'_>,
    weights: &[f32],
    voxel: usize,
    start: [f32; LANES],
) -> [[f32; LANES]; VOXELS] {
    let mut sums = [start; VOXELS];
    let seen = row.seen;
    for (&place, weights) in row.starts.iter().zip(weights.chunks_exact(seen * LANES)) {
        let place = place + voxel * row.step;
        let inputs: [&[f32]; VOXELS] =
            std::array::from_fn(|voxel| &row.input[place + voxel * row.step..][..seen]);
        for (at, weights) in weights.as_chunks::<LANES>().0.iter().enumerate().take(seen) {
            for voxel in 0..VOXELS {
                let value = inputs[voxel][at];
                for lane in 0..LANES {
                    sums[voxel][lane] = value.mul_add(weights[lane], sums[voxel][lane]);
                }
            }
        }
    }
    sums
}
