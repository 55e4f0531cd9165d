//! The exact Euclidean distance transform, separable, many voxels at a time.
//!
//! Distances are linear along y, found by two sweeps, and squared after that; along z and x each value
//! becomes the least of its neighbours' at distance k plus k², for k growing until k² alone is too much:
//! the lower envelope of parabolas (Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled
//! Functions", 2012) by brute force. The cost grows with the greatest distance, but 32 voxels go at once
//! in 16 bits, which beats the linear-time algorithm on every grid that is accepted here.

use multiversion::multiversion;
use rayon::prelude::*;

/// Voxels that are worked on at once.
const LANES: usize = 32;

/// One lane of squares for each voxel.
type Lanes = [u16; LANES];

/// The largest distance that is represented, in voxels: 255² is the last square below 2¹⁶.
pub(crate) const MAX_DISTANCE: u8 = 255;

/// Squared distance of each voxel to the nearest seed, but at most the square of its bound.
///
/// `bounds` holds for each voxel an upper bound of its distance in voxels; a seed's is 0. A bound below the
/// true distance must not be passed on to a voxel with a larger one: either all bounds are the same, or a
/// seed lies on every straight way between the two. The result is x-fastest, as `bounds` is.
///
/// # Panics
/// When the number of bounds is not that of the voxels.
pub(crate) fn squared_distances(size: [usize; 3], bounds: &[u8]) -> Vec<u16> {
    let mut memory = Memory::default();
    memory.squared_distances(size, bounds);
    memory.planes
}

/// What a transform writes to, to be used again: fresh memory costs as much as a pass.
#[derive(Default)]
pub(crate) struct Memory {
    planes: Vec<u16>,
    slabs: Vec<u16>,
}

impl Memory {
    /// As [`squared_distances`], in memory that may have been used before.
    pub(crate) fn squared_distances(&mut self, size: [usize; 3], bounds: &[u8]) -> &[u16] {
        let [nx, ny, nz] = size;
        assert_eq!(bounds.len(), nx * ny * nz, "one bound for each voxel");
        let Self { planes, slabs } = self;
        planes.resize(bounds.len(), 0);
        slabs.resize(bounds.len(), 0);
        planes
            .par_chunks_mut(nx * ny)
            .zip(bounds.par_chunks(nx * ny))
            .for_each(|(plane, bounds)| sweep_along_y(bounds, plane, nx));
        // Slabs of one y, so that each is one piece of memory that a thread can own.
        slabs
            .par_chunks_mut(nx * nz)
            .enumerate()
            .for_each_init(Vec::new, |block, (y, slab)| {
                minimise_along_z(&planes[y * nx..], block, slab, size);
            });
        planes
            .par_chunks_mut(nx * ny)
            .enumerate()
            .for_each(|(z, plane)| minimise_along_x(&slabs[z * nx..], plane, [nx, ny, nz]));
        planes
    }
}

/// Squares of the distances along y, in one plane of constant z.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn sweep_along_y(bounds: &[u8], plane: &mut [u16], nx: usize) {
    let mut distance = bounds.to_vec();
    let relax = |row: &mut [u8], neighbour: &[u8]| {
        for (here, &there) in row.iter_mut().zip(neighbour) {
            *here = (*here).min(there.saturating_add(1));
        }
    };
    let ny = distance.len() / nx;
    for y in 1..ny {
        let (above, below) = distance.split_at_mut(y * nx);
        relax(&mut below[..nx], &above[(y - 1) * nx..]);
    }
    for y in (1..ny).rev() {
        let (above, below) = distance.split_at_mut(y * nx);
        relax(&mut above[(y - 1) * nx..], &below[..nx]);
    }
    for (square, &distance) in plane.iter_mut().zip(&distance) {
        *square = u16::from(distance) * u16::from(distance);
    }
}

/// The minimum over z, for one y: from rows `size[0] * size[1]` apart to rows that follow each other.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn minimise_along_z(rows: &[u16], block: &mut Vec<u16>, slab: &mut [u16], size: [usize; 3]) {
    let [nx, ny, nz] = size;
    // Whole rows at a time into memory that stays in the cache, rather than columns from memory that does not.
    let width = nx.max(LANES);
    block.resize(width * nz, 0);
    for (z, row) in block.chunks_exact_mut(width).enumerate() {
        row[..nx].copy_from_slice(&rows[z * nx * ny..z * nx * ny + nx]);
    }
    let mut to_varied = vec![0u32; nz];
    for first in (0..nx).step_by(LANES) {
        // The last lanes may be done twice, rather than lanes beyond the row.
        let first = first.min(nx.saturating_sub(LANES));
        let column = Column {
            block,
            width,
            first,
            height: nz,
        };
        let ceiling = column.greatest();
        column.measure_varied(ceiling, &mut to_varied);
        for (z, &to_varied) in to_varied.iter().enumerate() {
            let is_out_of_reach = to_varied * to_varied >= u32::from(ceiling);
            let least = if is_out_of_reach {
                *column.at(z)
            } else {
                column.least(z)
            };
            let lanes = LANES.min(nx);
            slab[z * nx + first..z * nx + first + lanes].copy_from_slice(&least[..lanes]);
        }
    }
}

/// Lanes that stand above each other in rows of `width`.
struct Column<'a> {
    block: &'a [u16],
    width: usize,
    first: usize,
    height: usize,
}

impl Column<'_> {
    #[inline(always)]
    fn at(&self, z: usize) -> &Lanes {
        lanes(self.block, z * self.width + self.first)
    }

    #[inline(always)]
    fn greatest(&self) -> u16 {
        let mut greatest = [0; LANES];
        for z in 0..self.height {
            for (greatest, &value) in greatest.iter_mut().zip(self.at(z)) {
                *greatest = value.max(*greatest);
            }
        }
        greatest.into_iter().fold(0, u16::max)
    }

    /// Distance from each place to the nearest with a lane below `ceiling`, the column's greatest value.
    ///
    /// Where that is far, the value stays the ceiling: so are most places when distances are followed only so far.
    #[inline(always)]
    fn measure_varied(&self, ceiling: u16, to_varied: &mut [u32]) {
        let mut distance = 1 << 9;
        for (z, to_varied) in to_varied.iter_mut().enumerate() {
            distance = if is_all(self.at(z), ceiling) {
                distance + 1
            } else {
                0
            };
            *to_varied = distance;
        }
        for z in (1..to_varied.len()).rev() {
            to_varied[z - 1] = to_varied[z - 1].min(to_varied[z] + 1);
        }
    }

    /// The least of the column's values, each raised by the square of its distance from `z`.
    #[inline(always)]
    fn least(&self, z: usize) -> Lanes {
        let mut least = *self.at(z);
        let reach = z.max(self.height - 1 - z);
        for k in 1..=reach.min(usize::from(MAX_DISTANCE)) {
            let square = (k * k) as u16;
            if !any_above(&least, square) {
                break;
            }
            if k <= z {
                lower(&mut least, self.at(z - k), square);
            }
            if z + k < self.height {
                lower(&mut least, self.at(z + k), square);
            }
        }
        least
    }
}

#[inline(always)]
fn is_all(lanes: &[u16], value: u16) -> bool {
    lanes.iter().fold(0, |any, &lane| any | (lane ^ value)) == 0
}

/// The minimum over x, for one z: from rows `size[0] * size[2]` apart to rows that follow each other.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn minimise_along_x(rows: &[u16], plane: &mut [u16], size: [usize; 3]) {
    let [nx, _, nz] = size;
    let margin = usize::from(MAX_DISTANCE);
    // Beyond the ends of a row there is no seed, however far one looks.
    let mut row = vec![u16::MAX; margin + nx.max(LANES) + margin];
    for (y, out) in plane.chunks_exact_mut(nx).enumerate() {
        row[margin..margin + nx].copy_from_slice(&rows[y * nx * nz..y * nx * nz + nx]);
        let ceiling = row[margin..margin + nx]
            .iter()
            .fold(0, |greatest, &value| greatest.max(value));
        for first in (0..nx).step_by(LANES) {
            // The last lanes may be done twice, rather than lanes beyond the row.
            let first = first.min(nx.saturating_sub(LANES));
            let width = LANES.min(nx);
            let place = margin + first;
            let is_out_of_reach = u32::from(ceiling) <= (LANES * LANES) as u32
                && is_all(
                    &row[place.max(margin + LANES) - LANES..(place + 2 * LANES).min(margin + nx)],
                    ceiling,
                );
            let least = if is_out_of_reach {
                *lanes(&row, place)
            } else {
                least_of_row(&row, place, margin.min(nx - 1))
            };
            out[first..first + width].copy_from_slice(&least[..width]);
        }
    }
}

/// The least of a row's values at a place and up to `reach` voxels away, each raised by the square of its distance.
#[inline(always)]
fn least_of_row(row: &[u16], place: usize, reach: usize) -> Lanes {
    let mut least = *lanes(row, place);
    for k in 1..=reach {
        let square = (k * k) as u16;
        if !any_above(&least, square) {
            break;
        }
        lower(&mut least, lanes(row, place - k), square);
        lower(&mut least, lanes(row, place + k), square);
    }
    least
}

/// The lanes of a row that start at `first`.
#[inline(always)]
fn lanes(row: &[u16], first: usize) -> &Lanes {
    row[first..]
        .first_chunk()
        .expect("a row has a margin on both sides")
}

/// Whether a neighbour whose distance has this square could still lower a lane.
///
/// As a disjunction of differences, because that is one instruction for each register and a test.
#[inline(always)]
fn any_above(lanes: &Lanes, square: u16) -> bool {
    lanes
        .iter()
        .fold(0, |any, &value| any | value.saturating_sub(square))
        != 0
}

#[inline(always)]
fn lower(least: &mut Lanes, values: &Lanes, square: u16) {
    for (least, &value) in least.iter_mut().zip(values) {
        *least = (*least).min(value.saturating_add(square));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, voxel by voxel.
    fn brute_force(size: [usize; 3], bounds: &[u8]) -> Vec<u16> {
        let [nx, ny, _] = size;
        let voxel = |index: usize| [index % nx, index / nx % ny, index / (nx * ny)];
        let seeds: Vec<_> = (0..bounds.len())
            .filter(|&i| bounds[i] == 0)
            .map(voxel)
            .collect();
        let squared = |a: [usize; 3], b: [usize; 3]| -> usize {
            (0..3).map(|axis| a[axis].abs_diff(b[axis]).pow(2)).sum()
        };
        let distance = |index: usize| {
            let nearest = seeds.iter().map(|&seed| squared(voxel(index), seed)).min();
            let bound = usize::from(bounds[index]).pow(2);
            nearest.unwrap_or(bound).min(bound) as u16
        };
        (0..bounds.len()).map(distance).collect()
    }

    /// A few pseudo-random seeds; the same ones at each run.
    fn scattered_seeds(size: [usize; 3], bound: u8, one_in: u32) -> Vec<u8> {
        let mut state = 12345u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        (0..size.iter().product())
            .map(|_| if next() % one_in == 0 { 0 } else { bound })
            .collect()
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        for size in [[1, 1, 1], [7, 5, 3], [33, 4, 9], [32, 32, 32], [70, 3, 31]] {
            for one_in in [3, 50, 900] {
                let bounds = scattered_seeds(size, MAX_DISTANCE, one_in);
                assert_eq!(
                    squared_distances(size, &bounds),
                    brute_force(size, &bounds),
                    "{size:?}"
                );
            }
        }
    }

    #[test]
    fn distances_stop_at_a_common_bound() {
        let size = [40, 21, 17];
        let bounds = scattered_seeds(size, 5, 2000);
        assert_eq!(squared_distances(size, &bounds), brute_force(size, &bounds));
    }

    #[test]
    fn the_longest_distance_is_exact() {
        let size = [256, 2, 2];
        let mut bounds = vec![MAX_DISTANCE; 1024];
        bounds[0] = 0;
        let squared = squared_distances(size, &bounds);
        assert_eq!(squared[255], 255 * 255);
        assert_eq!(squared[254 + 3 * 256], 254 * 254 + 2);
    }

    #[test]
    fn without_a_seed_every_distance_is_its_bound() {
        assert_eq!(squared_distances([3, 2, 2], &[9; 12]), [81; 12]);
    }
}
