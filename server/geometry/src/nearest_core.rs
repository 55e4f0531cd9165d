//! The nearest core voxel of every voxel.

use rayon::prelude::*;

use crate::Core;
use crate::grid::voxel_at;

/// The exact nearest core voxel of each voxel; among equals, the first one with the lowest x.
pub(crate) struct NearestCore {
    size: [usize; 3],
    /// Coordinates of the core voxels, by x.
    voxels: Vec<[i32; 3]>,
    /// The number of the nearest core voxel of each voxel.
    nearest: Vec<u32>,
}

impl NearestCore {
    /// Finds them row by row: along x, the squared distances to the core voxels are parabolas of the same shape, and
    /// their lower envelope gives the nearest ones. Rows without a voxel inside are skipped.
    pub(crate) fn new(size: [usize; 3], core: &Core, inside: &[bool]) -> Self {
        let [nx, ny, _] = size;
        let voxel = |index: u32| voxel_at(index as usize, size).map(|place| place as i32);
        let mut voxels: Vec<_> = core.voxels().iter().map(|&index| voxel(index)).collect();
        voxels.sort_unstable();
        let mut nearest = vec![0; inside.len()];
        let rows = nearest
            .par_chunks_mut(nx)
            .zip(inside.par_chunks(nx))
            .enumerate();
        rows.for_each_init(Vec::new, |envelope, (row, (nearest, inside))| {
            if inside.contains(&true) {
                let place = [(row % ny) as i32, (row / ny) as i32];
                lower_envelope(&voxels, place, envelope);
                fill_row(envelope, nearest);
            }
        });
        Self {
            size,
            voxels,
            nearest,
        }
    }

    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    /// The number of the core voxel nearest to a voxel in a row with a voxel inside.
    #[inline]
    pub(crate) fn core_of(&self, index: usize) -> u32 {
        self.nearest[index]
    }

    /// The offset from a voxel to a core voxel.
    #[inline]
    pub(crate) fn way(&self, voxel: [usize; 3], core: u32) -> [i32; 3] {
        let root = self.voxels[core as usize];
        [0, 1, 2].map(|axis| root[axis] - voxel[axis] as i32)
    }

    /// Coordinates of a voxel.
    pub(crate) fn voxel(&self, index: usize) -> [usize; 3] {
        voxel_at(index, self.size)
    }
}

/// The parabola of a core voxel on a row, and the first x at which it is the lowest.
struct Parabola {
    core: u32,
    vertex: i32,
    height: i32,
    from: i32,
}

/// The parabolas that are lowest somewhere on the row at `[y, z]`, by x.
///
/// Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", 2012, in integers.
fn lower_envelope(voxels: &[[i32; 3]], [y, z]: [i32; 2], envelope: &mut Vec<Parabola>) {
    envelope.clear();
    for (core, &[vertex, core_y, core_z]) in voxels.iter().enumerate() {
        let height = (core_y - y).pow(2) + (core_z - z).pow(2);
        let mut from = i32::MIN;
        let mut is_needed = true;
        while let Some(last) = envelope.last() {
            if last.vertex == vertex {
                is_needed = height < last.height;
                if !is_needed {
                    break;
                }
            } else {
                // The first x at which the new parabola is strictly lower.
                let difference = height + vertex * vertex - last.height - last.vertex * last.vertex;
                from = difference.div_euclid(2 * (vertex - last.vertex)) + 1;
                if from > last.from {
                    break;
                }
            }
            envelope.pop();
            from = i32::MIN;
        }
        if is_needed {
            envelope.push(Parabola {
                core: core as u32,
                vertex,
                height,
                from,
            });
        }
    }
}

fn fill_row(envelope: &[Parabola], nearest: &mut [u32]) {
    for (i, parabola) in envelope.iter().enumerate() {
        let start = parabola.from.clamp(0, nearest.len() as i32) as usize;
        let end = envelope
            .get(i + 1)
            .map_or(nearest.len() as i32, |next| next.from);
        let end = end.clamp(0, nearest.len() as i32) as usize;
        if start < end {
            nearest[start..end].fill(parabola.core);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_that_of_brute_force() {
        let size = [23, 9, 7];
        let mut state = 7u32;
        let mut next = |below: usize| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as usize % below
        };
        for count in [1, 2, 5, 40] {
            let count_of_voxels = size.iter().product();
            let mut indices: Vec<u32> = (0..count).map(|_| next(count_of_voxels) as u32).collect();
            indices.sort_unstable();
            indices.dedup();
            let core = Core::from_voxels(indices);
            let nearest = NearestCore::new(size, &core, &vec![true; count_of_voxels]);
            for index in 0..count_of_voxels {
                let voxel = nearest.voxel(index);
                let squared = |core| {
                    nearest
                        .way(voxel, core)
                        .map(|along| along * along)
                        .iter()
                        .sum::<i32>()
                };
                let least = (0..core.voxels().len() as u32).map(squared).min();
                assert_eq!(Some(squared(nearest.core_of(index))), least, "{voxel:?}");
            }
        }
    }
}
