//! Connected components of a mask, found on runs of voxels along x.

use memchr::memchr;

/// The voxels that count as neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Connectivity {
    /// Voxels that share a face.
    Faces,
    /// Voxels that share a face, an edge or a corner.
    Corners,
}

/// Consecutive voxels along x: `start..end` in the x-fastest order.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
}

/// The runs of one value in a mask, joined to components.
struct Components {
    runs: Vec<Run>,
    /// Union-find over the runs; a root is its own parent.
    parents: Vec<u32>,
}

impl Components {
    fn find(size: [usize; 3], mask: &[bool], value: bool, connectivity: Connectivity) -> Self {
        let [nx, ny, nz] = size;
        let (runs, row_starts) = runs_by_row(nx, mask, value);
        let parents = (0..runs.len() as u32).collect();
        let mut components = Self { runs, parents };
        let neighbour_rows: &[(isize, isize)] = match connectivity {
            Connectivity::Faces => &[(-1, 0), (0, -1)],
            Connectivity::Corners => &[(-1, 0), (-1, -1), (0, -1), (1, -1)],
        };
        let slack = u32::from(connectivity == Connectivity::Corners);
        for row in 0..ny * nz {
            for &(dy, dz) in neighbour_rows {
                let (y, z) = (row % ny, row / ny);
                let (Some(y), Some(z)) = (y.checked_add_signed(dy), z.checked_add_signed(dz))
                else {
                    continue;
                };
                if y < ny {
                    let other = y + ny * z;
                    components.join_rows(&row_starts, row, other, nx, slack);
                }
            }
        }
        components
    }

    /// Joins the touching runs of two rows; both are sorted, so one pass is enough.
    fn join_rows(&mut self, row_starts: &[u32], row: usize, other: usize, nx: usize, slack: u32) {
        let (mut a, mut b) = (row_starts[row], row_starts[other]);
        let shift = ((row - other) * nx) as u32;
        while a < row_starts[row + 1] && b < row_starts[other + 1] {
            let (here, there) = (self.runs[a as usize], self.runs[b as usize]);
            if here.start < there.end + shift + slack && there.start + shift < here.end + slack {
                self.union(a, b);
            }
            if here.end < there.end + shift {
                a += 1;
            } else {
                b += 1;
            }
        }
    }

    fn root(&mut self, mut run: u32) -> u32 {
        while self.parents[run as usize] != run {
            let grandparent = self.parents[self.parents[run as usize] as usize];
            self.parents[run as usize] = grandparent;
            run = grandparent;
        }
        run
    }

    /// The smaller number becomes the root, so that the result does not depend on the order.
    fn union(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// The number of voxels in the component of each root run; 0 for the other runs.
    fn voxels(&mut self) -> Vec<u64> {
        let mut voxels = vec![0; self.runs.len()];
        for run in 0..self.runs.len() {
            let root = self.root(run as u32);
            voxels[root as usize] += u64::from(self.runs[run].end - self.runs[run].start);
        }
        voxels
    }

    fn fill(&self, run: usize, mask: &mut [bool], value: bool) {
        let Run { start, end } = self.runs[run];
        mask[start as usize..end as usize].fill(value);
    }

    /// Clears all components but one.
    fn keep(&mut self, kept: Option<usize>, mask: &mut [bool]) {
        for run in 0..self.runs.len() {
            if Some(self.root(run as u32) as usize) != kept {
                self.fill(run, mask, false);
            }
        }
    }
}

/// The runs of `value`, and the number of the first run of each row (plus a final entry).
fn runs_by_row(nx: usize, mask: &[bool], value: bool) -> (Vec<Run>, Vec<u32>) {
    let mut runs = Vec::new();
    let mut row_starts = Vec::with_capacity(mask.len() / nx + 1);
    let bytes: &[u8] = bytemuck::cast_slice(mask);
    for (row, voxels) in bytes.chunks_exact(nx).enumerate() {
        row_starts.push(runs.len() as u32);
        let offset = row * nx;
        let mut x = 0;
        let find = |value: bool, from: usize| memchr(value.into(), &voxels[from..]);
        while let Some(gap) = find(value, x) {
            let start = x + gap;
            x = find(!value, start).map_or(nx, |length| start + length);
            runs.push(Run {
                start: (offset + start) as u32,
                end: (offset + x) as u32,
            });
        }
    }
    row_starts.push(runs.len() as u32);
    (runs, row_starts)
}

/// Keeps the largest component and clears the others; among equals, the first.
pub(crate) fn keep_largest_component(
    size: [usize; 3],
    mask: &mut [bool],
    connectivity: Connectivity,
) {
    let mut components = Components::find(size, mask, true, connectivity);
    let voxels = components.voxels();
    let largest = (0..voxels.len()).rev().max_by_key(|&run| voxels[run]);
    components.keep(largest, mask);
}

/// Keeps the component with the most voxels of another mask and clears the others; among equals, the first. If none
/// contains any, nothing is left.
pub(crate) fn keep_component_with_most_of(
    size: [usize; 3],
    mask: &mut [bool],
    counted: &[bool],
    connectivity: Connectivity,
) {
    let mut components = Components::find(size, mask, true, connectivity);
    let mut held = vec![0usize; components.runs.len()];
    for run in 0..components.runs.len() {
        let Run { start, end } = components.runs[run];
        let root = components.root(run as u32);
        let voxels = &counted[start as usize..end as usize];
        held[root as usize] += voxels.iter().filter(|&&voxel| voxel).count();
    }
    let most = (0..held.len()).rev().max_by_key(|&run| held[run]);
    components.keep(most.filter(|&run| held[run] > 0), mask);
}

/// The fraction of a mask in its largest component; 1 if the mask is empty.
pub(crate) fn largest_component_share(
    size: [usize; 3],
    mask: &[bool],
    connectivity: Connectivity,
) -> f64 {
    let voxels = Components::find(size, mask, true, connectivity).voxels();
    match voxels.iter().max() {
        Some(&largest) => largest as f64 / voxels.iter().sum::<u64>() as f64,
        None => 1.0,
    }
}

/// Fills the background that cannot be reached from the faces of the grid through voxel faces.
pub(crate) fn fill_holes(size: [usize; 3], mask: &mut [bool]) {
    let [nx, ny, nz] = size;
    let mut components = Components::find(size, mask, false, Connectivity::Faces);
    let mut is_open = vec![false; components.runs.len()];
    for run in 0..components.runs.len() {
        let Run { start, end } = components.runs[run];
        let (start, end) = (start as usize, end as usize);
        let (y, z) = (start / nx % ny, start / (nx * ny));
        let on_face =
            start % nx == 0 || end % nx == 0 || y == 0 || y == ny - 1 || z == 0 || z == nz - 1;
        if on_face {
            is_open[components.root(run as u32) as usize] = true;
        }
    }
    for run in 0..components.runs.len() {
        if !is_open[components.root(run as u32) as usize] {
            components.fill(run, mask, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 3] = [6, 5, 4];

    fn mask_of(voxels: &[[usize; 3]]) -> Vec<bool> {
        let mut mask = vec![false; SIZE.iter().product()];
        for [x, y, z] in voxels {
            mask[x + SIZE[0] * (y + SIZE[1] * z)] = true;
        }
        mask
    }

    #[test]
    fn the_larger_of_two_components_is_kept() {
        let large = [[1, 1, 1], [2, 1, 1], [2, 2, 1]];
        let mut mask = mask_of(&[&large[..], &[[5, 4, 3], [5, 3, 3]]].concat());
        keep_largest_component(SIZE, &mut mask, Connectivity::Corners);
        assert_eq!(mask, mask_of(&large));
    }

    #[test]
    fn the_component_that_holds_most_of_another_mask_is_kept() {
        let (large, small) = ([[1, 1, 1], [2, 1, 1], [2, 2, 1]], [[5, 4, 3], [5, 3, 3]]);
        let both = mask_of(&[&large[..], &small].concat());
        for (counted, kept) in [
            (vec![[2, 1, 1], [5, 4, 3], [5, 3, 3]], mask_of(&small)),
            (vec![[2, 1, 1], [5, 4, 3], [4, 4, 3]], mask_of(&large)),
            (vec![[4, 4, 3]], mask_of(&[])),
        ] {
            let mut mask = both.clone();
            keep_component_with_most_of(SIZE, &mut mask, &mask_of(&counted), Connectivity::Faces);
            assert_eq!(mask, kept, "{counted:?}");
        }
    }

    #[test]
    fn a_corner_joins_only_where_corners_count() {
        for step in [[1, 1, 1], [1, 0, 1], [0, 1, 1], [1, 1, 0]] {
            let voxels = [[2, 2, 1], [2 + step[0], 2 + step[1], 1 + step[2]]];
            let mut mask = mask_of(&voxels);
            keep_largest_component(SIZE, &mut mask, Connectivity::Corners);
            assert_eq!(mask, mask_of(&voxels), "{step:?}");
            keep_largest_component(SIZE, &mut mask, Connectivity::Faces);
            assert_eq!(mask, mask_of(&voxels[..1]), "{step:?}");
        }
        // Towards lower x and y as well.
        let voxels = [[3, 3, 1], [2, 2, 2]];
        let mut mask = mask_of(&voxels);
        keep_largest_component(SIZE, &mut mask, Connectivity::Corners);
        assert_eq!(mask, mask_of(&voxels));
    }

    #[test]
    fn rows_do_not_join_across_the_edge_of_the_grid() {
        let mut mask = mask_of(&[[5, 1, 1], [4, 1, 1], [0, 2, 1]]);
        keep_largest_component(SIZE, &mut mask, Connectivity::Corners);
        assert_eq!(mask, mask_of(&[[5, 1, 1], [4, 1, 1]]));
    }

    #[test]
    fn a_hole_is_filled_and_a_bay_is_not() {
        let block = |hole: [usize; 3]| -> Vec<_> {
            (0..27)
                .map(|i| [1 + i % 3, 1 + i / 3 % 3, i / 9])
                .filter(|&voxel| voxel != hole)
                .collect::<Vec<_>>()
        };
        let mut with_hole = mask_of(&block([2, 2, 1]));
        fill_holes(SIZE, &mut with_hole);
        assert!(with_hole[2 + 6 * (2 + 5)]);
        let mut with_bay = mask_of(&block([2, 2, 0]));
        let before = with_bay.clone();
        fill_holes(SIZE, &mut with_bay);
        assert_eq!(with_bay, before);
    }

    #[test]
    fn an_empty_mask_stays_empty() {
        let mut mask = mask_of(&[]);
        keep_largest_component(SIZE, &mut mask, Connectivity::Faces);
        fill_holes(SIZE, &mut mask);
        assert_eq!(mask, mask_of(&[]));
    }
}
