//! Whether a picture shows what another one shows in the same place, or mirrored, turned over or shifted.

use geometry::{AXIS_ORDERS, Volume};

/// The most blocks of voxels along an axis.
const MOST: usize = 64;

/// How much better the pictures must correlate when one is moved: a head that is its own mirror image is none.
const MARGIN: f64 = 1e-3;

/// A volume with few voxels, each the mean of a block.
#[derive(Debug)]
pub(super) struct Reduced {
    /// Those of the volume.
    full: [usize; 3],
    size: [usize; 3],
    /// With mean 0 and norm 1.
    voxels: Vec<f64>,
}

/// The axes of a picture in another order, and those reversed that have a bit.
type Turn = ([usize; 3], u8);

const AS_IT_IS: Turn = (AXIS_ORDERS[0], 0);

impl Reduced {
    /// Some slices of a volume.
    pub(super) fn new(volume: &Volume, slices: &[usize]) -> Self {
        let grid = volume.grid();
        let full = [grid.size()[0], grid.size()[1], slices.len()];
        let blocks = full.map(Blocks::new);
        let size = [0, 1, 2].map(|axis| blocks[axis].count);
        let mut sums = vec![0.0; size.iter().product()];
        let columns: Vec<_> = (0..full[0]).map(|column| blocks[0].of(column)).collect();
        for (layer, &slice) in slices.iter().enumerate() {
            for row in 0..full[1] {
                let first = grid.index([0, row, slice]);
                let to = size[0] * (blocks[1].of(row) + size[1] * blocks[2].of(layer));
                let voxels = &volume.voxels()[first..first + full[0]];
                for (column, voxel) in columns.iter().zip(voxels) {
                    sums[to + column] += f64::from(*voxel);
                }
            }
        }
        for (index, sum) in sums.iter_mut().enumerate() {
            let block = [
                index % size[0],
                index / size[0] % size[1],
                index / size[0] / size[1],
            ];
            let voxels = (0..3).map(|axis| blocks[axis].length(block[axis], full[axis]));
            *sum /= voxels.product::<usize>() as f64;
        }
        normalise(&mut sums);
        Self {
            full,
            size,
            voxels: sums,
        }
    }

    /// Whether this picture is more like another one that is mirrored, turned by right angles, shifted by more than half a block, or
    /// all of that, than like the other one as it is. It is if their sizes differ.
    pub(super) fn is_moved_from(&self, other: &Self) -> bool {
        if self.full != other.full {
            return true;
        }
        let as_it_is = self.correlation(other, AS_IT_IS, [0; 3]);
        let orders = AXIS_ORDERS
            .into_iter()
            .filter(|order| order.map(|axis| self.full[axis]) == self.full);
        let mut turns = orders.flat_map(|order| (0..8).map(move |reversed| (order, reversed)));
        turns.any(|turn| self.best_correlation(other, turn) > as_it_is + MARGIN)
    }

    /// The best correlation with another picture that is turned and then shifted: a way from no shift, along which it grows.
    fn best_correlation(&self, other: &Self, turn: Turn) -> f64 {
        let mut shift = [0_isize; 3];
        let mut best = self.correlation(other, turn, shift);
        loop {
            let before = best;
            for (axis, step) in [0, 1, 2]
                .into_iter()
                .flat_map(|axis| [(axis, 1), (axis, -1)])
            {
                let half = (self.size[axis] / 2) as isize;
                loop {
                    let mut further = shift;
                    further[axis] += step;
                    if further[axis].abs() > half {
                        break;
                    }
                    let found = self.correlation(other, turn, further);
                    if found <= best {
                        break;
                    }
                    (best, shift) = (found, further);
                }
            }
            if best <= before {
                return best;
            }
        }
    }

    /// The correlation with another picture that is turned and then shifted by so many blocks.
    fn correlation(&self, other: &Self, (order, reversed): Turn, shift: [isize; 3]) -> f64 {
        let [columns, rows, _] = self.size;
        let steps = [1, columns, columns * rows];
        // Where this picture and the other one have the voxels along an axis that both have.
        let along = |axis: usize| {
            let count = self.size[axis];
            let at = move |own: usize| {
                let there = own
                    .checked_add_signed(-shift[axis])
                    .filter(|at| *at < count)?;
                let there = match reversed >> axis & 1 {
                    0 => there,
                    _ => count - 1 - there,
                };
                Some((own * steps[axis], there * steps[order[axis]]))
            };
            (0..count).filter_map(at).collect::<Vec<_>>()
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let mut sum = 0.0;
        for (own_layer, layer) in &z {
            for (own_row, row) in &y {
                let (own, there) = (own_row + own_layer, row + layer);
                let products = x.iter().map(|(own_column, column)| {
                    self.voxels[own_column + own] * other.voxels[column + there]
                });
                sum += products.sum::<f64>();
            }
        }
        sum
    }
}

/// Blocks along an axis that are as long as each other, but for the first and the last one. They stay the same blocks, to half a
/// voxel, when the axis is reversed.
#[derive(Debug, Clone, Copy)]
struct Blocks {
    count: usize,
    length: usize,
    /// How much the first one lacks.
    before: usize,
}

impl Blocks {
    fn new(voxels: usize) -> Self {
        let length = voxels.div_ceil(MOST).max(1);
        let count = voxels.div_ceil(length);
        Self {
            count,
            length,
            before: (count * length - voxels) / 2,
        }
    }

    fn of(self, voxel: usize) -> usize {
        (voxel + self.before) / self.length
    }

    /// The voxels of a block, of so many along the axis.
    fn length(self, block: usize, voxels: usize) -> usize {
        let end = ((block + 1) * self.length - self.before).min(voxels);
        end - (block * self.length).saturating_sub(self.before)
    }
}

fn normalise(voxels: &mut [f64]) {
    let mean = voxels.iter().sum::<f64>() / voxels.len().max(1) as f64;
    voxels.iter_mut().for_each(|voxel| *voxel -= mean);
    let norm = voxels.iter().map(|voxel| voxel * voxel).sum::<f64>().sqrt();
    if norm > 0.0 {
        voxels.iter_mut().for_each(|voxel| *voxel /= norm);
    }
}

#[cfg(test)]
mod tests {
    use geometry::Grid;
    use geometry::phantom::head;
    use glam::DAffine3;

    use super::*;

    /// A head with a bright place on one side, of which the voxels come from elsewhere in it.
    fn picture(
        from: impl Fn([usize; 3], [usize; 3]) -> [usize; 3],
        scaled: impl Fn(u16) -> u16,
    ) -> Reduced {
        let head = head(4.0).volume;
        let sides = head.grid().size();
        // A cube, so that axes can be exchanged.
        let side = *sides.iter().min().unwrap();
        let grid = Grid::new([side; 3], DAffine3::IDENTITY).unwrap();
        let voxels = (0..grid.voxel_count()).map(|index| {
            let at = from(grid.voxel(index), [side; 3]);
            let is_marked = [(0, 3, 5), (1, 3, 7), (2, 4, 7)];
            let is_marked = is_marked
                .iter()
                .all(|&(axis, low, high)| (side * low / 10..side * high / 10).contains(&at[axis]));
            scaled(head.voxels()[head.grid().index(at)] / 2 + 3000 * u16::from(is_marked))
        });
        let voxels = voxels.collect();
        let volume = Volume::new(grid, voxels, head.rescale()).unwrap();
        let slices: Vec<_> = (0..side).collect();
        Reduced::new(&volume, &slices)
    }

    #[test]
    fn what_is_mirrored_turned_or_shifted_is_found_and_other_changes_are_not() {
        let plain = picture(|at, _| at, |value| value);
        assert!(!plain.is_moved_from(&plain));
        for scaled in [|value| value / 3 * 2 + 100, |value: u16| value.min(2500)] {
            let changed = picture(|at, _| at, scaled);
            assert!(!changed.is_moved_from(&plain) && !plain.is_moved_from(&changed));
        }
        let reversed = |axis: usize| {
            move |mut at: [usize; 3], sides: [usize; 3]| {
                at[axis] = sides[axis] - 1 - at[axis];
                at
            }
        };
        let shifted = |axis: usize, by: usize| {
            move |mut at: [usize; 3], _: [usize; 3]| {
                at[axis] = at[axis].saturating_sub(by);
                at
            }
        };
        for axis in 0..3 {
            for by in [0, 1, 2, 5] {
                // What is shifted as it is would be found without the mirror image.
                for other in 0..3 {
                    let moved = |at, sides| reversed(axis)(shifted(other, by)(at, sides), sides);
                    let moved = picture(moved, |value| value / 2);
                    assert!(moved.is_moved_from(&plain), "{axis} {other} {by}");
                }
            }
            let moved = picture(shifted(axis, 2), |value| value);
            assert!(moved.is_moved_from(&plain), "{axis}");
        }
        let exchanged = picture(|[x, y, z], _| [y, x, z], |value| value);
        assert!(exchanged.is_moved_from(&plain));
    }

    #[test]
    fn blocks_have_each_voxel_once_and_lie_alike_on_both_sides() {
        for voxels in [1, 2, 7, 64, 65, 181, 217, 256, 301] {
            let blocks = Blocks::new(voxels);
            assert!(blocks.count <= MOST, "{voxels}");
            let mut found = vec![0; blocks.count];
            (0..voxels).for_each(|voxel| found[blocks.of(voxel)] += 1);
            let lengths: Vec<_> = (0..blocks.count)
                .map(|block| blocks.length(block, voxels))
                .collect();
            assert_eq!(found, lengths, "{voxels}");
            assert!(found[0].abs_diff(found[blocks.count - 1]) <= 1, "{voxels}");
        }
    }
}
