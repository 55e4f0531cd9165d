//! The inner loop of every convolution: one row of its output.

use multiversion::multiversion;

use super::normalisation::Sums;

/// What one row of the output of a convolution is made of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    /// Values of the input.
    pub(crate) input: &'a [f32],
    /// Where in them the first output begins to see each row of its neighbourhood.
    pub(crate) starts: &'a [usize],
    /// Values from what one output sees to what the next one sees.
    pub(crate) step: usize,
    /// Values that an output sees of each row.
    pub(crate) seen: usize,
    /// For each block of channels, each row and each value seen: a weight for each of the block's channels.
    pub(crate) weights: &'a [f32],
    /// Channels in a block: 8 or 16.
    pub(crate) lanes: usize,
    /// What is added to each channel; empty for nothing.
    pub(crate) bias: &'a [f32],
    /// Channels of the output.
    pub(crate) outputs: usize,
    /// The first voxel that is written.
    pub(crate) first: usize,
    /// Voxels from one that is written to the next.
    pub(crate) stride: usize,
}

/// Fills the voxels of an output row and adds them to the sums of their channels.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn convolve_row(row: &Row<'_>, output: &mut [f32], sums: &mut [Sums]) {
    // Eight registers of eight sums each: what sixteen registers have room for, and two units can fill.
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

/// The outputs at some voxels that follow each other.
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
