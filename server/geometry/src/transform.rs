//! The exact Euclidean distance transform, separable, many voxels at a time.
//!
//! Two sweeps along y find linear distances, which are then squared. Along z and x, each value becomes the minimum over
//! k of the neighbours at distance k plus k², for growing k until k² alone exceeds it: the lower envelope of parabolas
//! (Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", 2012) by brute force. The cost grows
//! with the greatest distance, but many voxels are processed at once in few bits, which is faster than the linear-time
//! algorithm on every accepted grid.
//!
//! The sweeps work in place, plane by plane; z and x together, in a slab of constant y that stays in the cache. The
//! slabs are consecutive in the result, so its axes are x, z, y; after a second transform they are x, y, z again.

use std::ops::{BitOr, Range};

use multiversion::multiversion;
use rayon::prelude::*;

/// The number of voxels processed at once.
const LANES: usize = 64;

/// Squared distances, one lane per voxel.
type Lanes<Square> = [Square; LANES];

/// The largest distance that is represented, in voxels: 255² is the last square below 2¹⁶.
pub(crate) const MAX_DISTANCE: u8 = 255;

/// The largest distance with a square that fits in eight bits.
const MAX_SMALL_DISTANCE: u8 = 15;

/// The converted values of a grid with the axes x, y, z, in the order x, z, y, which [`transformed`] reverses.
pub(crate) fn exchanged<T: Copy + Sync, U: Copy + Default + Send>(
    [nx, ny, nz]: [usize; 3],
    values: &[T],
    convert: impl Fn(T) -> U + Sync,
) -> Vec<U> {
    let mut exchanged = vec![U::default(); values.len()];
    exchanged
        .par_chunks_mut(nx * nz)
        .enumerate()
        .for_each(|(y, slab)| {
            for (z, row) in slab.chunks_exact_mut(nx).enumerate() {
                let values = &values[nx * (y + ny * z)..][..nx];
                for (out, &value) in row.iter_mut().zip(values) {
                    *out = convert(value);
                }
            }
        });
    exchanged
}

/// `convert` of the squared distance from each voxel to the nearest seed, which is at most the square of its bound.
///
/// `bounds` contains an upper bound of the distance of each voxel, x-fastest, in voxels; it is 0 for a seed. It is
/// overwritten. A bound below the true distance must not propagate to a voxel with a larger bound: either all bounds
/// are equal, or a seed lies on every straight line between the two.
///
/// The axes of the result are x, z, y. Voxels nearer than `margin` to a face of the grid are omitted.
///
/// # Panics
/// If the number of bounds differs from the number of voxels, or the margin leaves none.
pub(crate) fn transformed<T: Copy + Default + Send>(
    size: [usize; 3],
    bounds: &mut [u8],
    margin: usize,
    convert: impl Fn(u16) -> T + Sync,
) -> Vec<T> {
    let [nx, ny, nz] = size;
    assert_eq!(bounds.len(), nx * ny * nz, "one bound for each voxel");
    let greatest = bounds
        .par_chunks_mut(nx * ny)
        .map(|plane| {
            sweep_along_y(plane, nx);
            plane.iter().copied().fold(0, u8::max)
        })
        .reduce(|| 0, u8::max);
    let kept = size.map(|side| margin..side - margin);
    let slabs = Slabs {
        size,
        kept,
        distances: bounds,
    };
    if greatest <= MAX_SMALL_DISTANCE {
        slabs.minimised(minimise_small, |square: u8| convert(u16::from(square)))
    } else {
        slabs.minimised(minimise_large, convert)
    }
}

/// Distances along y, in one plane of constant z.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "x86_64+sse4.1"))]
fn sweep_along_y(distance: &mut [u8], nx: usize) {
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
}

/// The distances along y, from which slabs of constant y are taken.
struct Slabs<'a> {
    size: [usize; 3],
    /// The wanted range along each axis.
    kept: [Range<usize>; 3],
    distances: &'a [u8],
}

impl Slabs<'_> {
    /// The wanted slabs, each minimised along z and x by `minimise`.
    fn minimised<S: Square, T: Copy + Default + Send>(
        &self,
        minimise: impl Fn(&mut Slab<S>, &[u8], usize) + Sync,
        convert: impl Fn(S) -> T + Sync,
    ) -> Vec<T> {
        let [nx, ny, nz] = self.size;
        let [kept_x, kept_y, kept_z] = &self.kept;
        let kept_slab = kept_x.len() * kept_z.len();
        let mut values = vec![T::default(); kept_slab * kept_y.len()];
        values
            .par_chunks_mut(kept_slab)
            .zip(kept_y.clone())
            .for_each_init(
                || Slab::new(nx, nz, &self.kept),
                |slab, (values, y)| {
                    minimise(slab, &self.distances[nx * y..], nx * ny);
                    for (value, &square) in values.iter_mut().zip(&slab.least) {
                        *value = convert(square);
                    }
                },
            );
        values
    }
}

/// The squares of one y, with scratch memory.
struct Slab<S> {
    /// The number of voxels in a row, and the distance from one row to the next in squares.
    nx: usize,
    width: usize,
    kept_x: Range<usize>,
    kept_z: Range<usize>,
    /// The squares of the distances along y, a row for each z.
    squares: Vec<S>,
    /// The distance from each z to the nearest z with a different lane.
    to_varied: Vec<u32>,
    /// The wanted rows, minimised along z.
    rows: Vec<S>,
    /// One of these rows with a margin on both sides.
    row: Vec<S>,
    /// The wanted values, minimised along z and x.
    least: Vec<S>,
}

impl<S: Square> Slab<S> {
    fn new(nx: usize, nz: usize, [kept_x, _, kept_z]: &[Range<usize>; 3]) -> Self {
        let width = nx.max(LANES);
        let margin = usize::from(S::REACH);
        Self {
            nx,
            width,
            kept_x: kept_x.clone(),
            kept_z: kept_z.clone(),
            squares: vec![S::default(); width * nz],
            to_varied: vec![0; nz],
            rows: vec![S::default(); width * kept_z.len()],
            // There is no seed beyond the ends of a row.
            row: vec![S::MAX; margin + nx + LANES + margin],
            least: vec![S::default(); kept_x.len() * kept_z.len()],
        }
    }

    /// The least squares from the distances along y, with a row every `stride` values.
    #[inline(always)]
    fn minimise(&mut self, distances: &[u8], stride: usize) {
        let rows = self.squares.chunks_exact_mut(self.width);
        for (row, distances) in rows.zip(distances.chunks(stride)) {
            for (square, &distance) in row[..self.nx].iter_mut().zip(distances) {
                *square = S::of(distance);
            }
        }
        for first in starts(&(0..self.nx)) {
            self.minimise_along_z(first);
        }
        for number in 0..self.kept_z.len() {
            self.minimise_along_x(number);
        }
    }

    #[inline(always)]
    fn minimise_along_z(&mut self, first: usize) {
        let column = Column {
            squares: &self.squares,
            width: self.width,
            first,
        };
        let ceiling = column.greatest();
        column.measure_varied(ceiling, &mut self.to_varied);
        let rows = self.rows.chunks_exact_mut(self.width);
        for (row, z) in rows.zip(self.kept_z.clone()) {
            let to_varied = self.to_varied[z];
            let is_out_of_reach = to_varied * to_varied >= ceiling.into();
            row[first..first + LANES].copy_from_slice(&if is_out_of_reach {
                *column.at(z)
            } else {
                column.least(z)
            });
        }
    }

    #[inline(always)]
    fn minimise_along_x(&mut self, number: usize) {
        let margin = usize::from(S::REACH);
        let row = &mut self.row[..];
        row[margin..margin + self.nx].copy_from_slice(&self.rows[number * self.width..][..self.nx]);
        let within = margin..margin + self.nx;
        let ceiling = row[within.clone()]
            .iter()
            .copied()
            .fold(S::default(), S::max);
        let out = &mut self.least[number * self.kept_x.len()..][..self.kept_x.len()];
        for first in starts(&self.kept_x) {
            let place = margin + first;
            let around = place.max(margin + LANES) - LANES..(place + 2 * LANES).min(within.end);
            let is_out_of_reach =
                ceiling.into() <= (LANES * LANES) as u32 && is_all(&row[around], ceiling);
            let least = if is_out_of_reach {
                *lanes(row, place)
            } else {
                least_of_row(row, place, margin.min(self.nx - 1))
            };
            let out = &mut out[first - self.kept_x.start..];
            let count = out.len().min(LANES);
            out[..count].copy_from_slice(&least[..count]);
        }
    }
}

/// The starts of lanes that cover a range; the last one may overlap the one before, but not leave the range.
#[inline(always)]
fn starts(range: &Range<usize>) -> impl Iterator<Item = usize> + use<> {
    let last = range.end.saturating_sub(LANES).max(range.start);
    range
        .clone()
        .step_by(LANES)
        .map(move |first| first.min(last))
}

/// Minimises a slab with squares that fit in eight bits.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "x86_64+sse4.1"))]
fn minimise_small(slab: &mut Slab<u8>, distances: &[u8], stride: usize) {
    slab.minimise(distances, stride);
}

/// Minimises a slab of any squares.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl", "x86_64+avx2", "x86_64+sse4.1"))]
fn minimise_large(slab: &mut Slab<u16>, distances: &[u8], stride: usize) {
    slab.minimise(distances, stride);
}

/// A squared distance in as few bits as possible; sums saturate.
trait Square: Copy + Default + Ord + Into<u32> + BitOr<Output = Self> + Send {
    const MAX: Self;
    /// The largest distance with a square.
    const REACH: u8;

    fn of(distance: u8) -> Self;
    fn plus(self, other: Self) -> Self;
    /// The saturating difference.
    fn minus(self, other: Self) -> Self;
}

impl Square for u8 {
    const MAX: Self = Self::MAX;
    const REACH: u8 = MAX_SMALL_DISTANCE;

    #[inline(always)]
    fn of(distance: u8) -> Self {
        distance.wrapping_mul(distance)
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.saturating_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.saturating_sub(other)
    }
}

impl Square for u16 {
    const MAX: Self = Self::MAX;
    const REACH: u8 = MAX_DISTANCE;

    #[inline(always)]
    fn of(distance: u8) -> Self {
        Self::from(distance) * Self::from(distance)
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.saturating_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.saturating_sub(other)
    }
}

/// Lanes above each other in rows of `width`.
struct Column<'a, S> {
    squares: &'a [S],
    width: usize,
    first: usize,
}

impl<S: Square> Column<'_, S> {
    #[inline(always)]
    fn height(&self) -> usize {
        self.squares.len() / self.width
    }

    #[inline(always)]
    fn at(&self, z: usize) -> &Lanes<S> {
        lanes(self.squares, z * self.width + self.first)
    }

    #[inline(always)]
    fn greatest(&self) -> S {
        let mut greatest = [S::default(); LANES];
        for z in 0..self.height() {
            for (greatest, &value) in greatest.iter_mut().zip(self.at(z)) {
                *greatest = value.max(*greatest);
            }
        }
        greatest.into_iter().fold(S::default(), S::max)
    }

    /// The distance from each place to the nearest one with a lane below `ceiling`, the greatest value of the column.
    ///
    /// Far from it the value stays the ceiling. If distances are followed only a short way, most places are like that.
    #[inline(always)]
    fn measure_varied(&self, ceiling: S, to_varied: &mut [u32]) {
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

    /// The least value of the column, each raised by its squared distance from `z`.
    #[inline(always)]
    fn least(&self, z: usize) -> Lanes<S> {
        let mut least = *self.at(z);
        let reach = z.max(self.height() - 1 - z);
        for k in 1..=reach.min(usize::from(S::REACH)) {
            let square = S::of(k as u8);
            if !any_above(&least, square) {
                break;
            }
            if k <= z {
                lower(&mut least, self.at(z - k), square);
            }
            if z + k < self.height() {
                lower(&mut least, self.at(z + k), square);
            }
        }
        least
    }
}

/// The least value of a row up to `reach` voxels from a place, each raised by its squared distance.
#[inline(always)]
fn least_of_row<S: Square>(row: &[S], place: usize, reach: usize) -> Lanes<S> {
    let mut least = *lanes(row, place);
    for k in 1..=reach {
        let square = S::of(k as u8);
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
fn lanes<S>(row: &[S], first: usize) -> &Lanes<S> {
    row[first..]
        .first_chunk()
        .expect("a row has a margin on both sides")
}

#[inline(always)]
fn is_all<S: Square>(lanes: &[S], value: S) -> bool {
    !lanes
        .iter()
        .fold(false, |differs, &lane| differs | (lane != value))
}

/// Whether a neighbour at this squared distance could still lower a lane.
///
/// A disjunction of differences, because it takes one instruction per register and a test.
#[inline(always)]
fn any_above<S: Square>(lanes: &Lanes<S>, square: S) -> bool {
    lanes
        .iter()
        .fold(S::default(), |any, &value| any | value.minus(square))
        != S::default()
}

#[inline(always)]
fn lower<S: Square>(least: &mut Lanes<S>, values: &Lanes<S>, square: S) {
    for (least, &value) in least.iter_mut().zip(values) {
        *least = (*least).min(value.plus(square));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squared_distances(size @ [nx, ny, nz]: [usize; 3], bounds: &[u8]) -> Vec<u16> {
        let mut bounds = exchanged(size, bounds, |bound| bound);
        transformed([nx, nz, ny], &mut bounds, 0, |squared| squared)
    }

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
    fn a_margin_is_left_out_and_axes_are_exchanged() {
        for (size, margin) in [([70, 21, 17], 4), ([11, 12, 13], 5), ([130, 9, 3], 1)] {
            for bound in [7, 40] {
                let mut bounds = scattered_seeds(size, bound, 300);
                let whole = brute_force(size, &bounds);
                let [nx, ny, nz] = size;
                let kept = |side: usize| margin..side - margin;
                let mut expected = Vec::new();
                for (y, z) in kept(ny).flat_map(|y| kept(nz).map(move |z| (y, z))) {
                    expected.extend(kept(nx).map(|x| whole[x + nx * (y + ny * z)]));
                }
                let found = transformed(size, &mut bounds, margin, |squared| squared);
                assert_eq!(found, expected, "{size:?}, bound {bound}");
            }
        }
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
