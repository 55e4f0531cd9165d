//! The part of each row of a block that is looked at, so that little is computed around the brain.

use std::ops::Range;

/// A range of voxels for each row of a block; it may be empty.
#[derive(Debug, Clone)]
pub(crate) struct Spans {
    pub(crate) size: [usize; 3],
    /// The first voxel of each row; the length of the row if its range is empty.
    starts: Vec<u32>,
    /// The end of each range; 0 if it is empty.
    ends: Vec<u32>,
}

impl Spans {
    pub(crate) fn whole(size: [usize; 3]) -> Self {
        let [nx, ny, nz] = size;
        Self {
            size,
            starts: vec![0; ny * nz],
            ends: vec![nx as u32; ny * nz],
        }
    }

    /// From the first to the last voxel of each row that is looked at.
    pub(crate) fn around<T>(
        size: [usize; 3],
        voxels: &[T],
        is_looked_at: impl Fn(&T) -> bool,
    ) -> Self {
        let rows = voxels.chunks_exact(size[0]);
        let (starts, ends) = rows
            .map(|row| {
                let start = row.iter().position(&is_looked_at).unwrap_or(row.len());
                let last = row[start..].iter().rposition(&is_looked_at);
                (start as u32, last.map_or(0, |last| start + last + 1) as u32)
            })
            .unzip();
        Self { size, starts, ends }
    }

    /// The range of a row.
    pub(crate) fn row(&self, y: usize, z: usize) -> Range<usize> {
        let row = y + self.size[1] * z;
        let (start, end) = (self.starts[row] as usize, self.ends[row] as usize);
        if start < end { start..end } else { 0..0 }
    }

    /// For each row, the smallest range that contains those of the rows up to `reach` before and after it along y.
    pub(crate) fn widened_along_y(&self, reach: usize) -> Self {
        self.widened(self.size[1], 1, reach)
    }

    /// The same along z.
    pub(crate) fn widened_along_z(&self, reach: usize) -> Self {
        self.widened(self.starts.len(), self.size[1], reach)
    }

    /// Joins the rows of each group up to `reach` strides apart.
    fn widened(&self, group: usize, stride: usize, reach: usize) -> Self {
        let shifts = (1..=reach).map(|step| step * stride);
        let shifts: Vec<usize> = shifts.take_while(|&shift| shift < group).collect();
        Self {
            size: self.size,
            starts: joined(&self.starts, group, &shifts, u32::min),
            ends: joined(&self.ends, group, &shifts, u32::max),
        }
    }
}

/// Joins each number with those of its group that are `shifts` before and after it.
fn joined(
    numbers: &[u32],
    group: usize,
    shifts: &[usize],
    join: impl Fn(u32, u32) -> u32,
) -> Vec<u32> {
    let mut joined = numbers.to_vec();
    for (joined, numbers) in joined.chunks_mut(group).zip(numbers.chunks(group)) {
        for &shift in shifts {
            for (joined, after) in joined.iter_mut().zip(&numbers[shift..]) {
                *joined = join(*joined, *after);
            }
            for (joined, before) in joined[shift..].iter_mut().zip(numbers) {
                *joined = join(*joined, *before);
            }
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_gets_what_its_neighbours_have() {
        let mut voxels = vec![false; 6 * 5 * 4];
        let index = |[x, y, z]: [usize; 3]| x + 6 * (y + 5 * z);
        for voxel in [[1, 2, 0], [3, 2, 0], [5, 4, 3]] {
            voxels[index(voxel)] = true;
        }
        let spans = Spans::around([6, 5, 4], &voxels, |is_set| *is_set);
        assert_eq!(
            [spans.row(2, 0), spans.row(4, 3), spans.row(0, 0)],
            [1..4, 5..6, 0..0]
        );
        let along_y = spans.widened_along_y(2);
        assert_eq!(
            [along_y.row(0, 0), along_y.row(4, 0), along_y.row(2, 3)],
            [1..4, 1..4, 5..6]
        );
        assert_eq!([along_y.row(1, 3), along_y.row(2, 1)], [0..0, 0..0]);
        let both = along_y.widened_along_z(3);
        assert_eq!(
            [both.row(2, 0), both.row(4, 1), both.row(1, 3)],
            [1..6, 1..6, 1..4]
        );
    }
}
