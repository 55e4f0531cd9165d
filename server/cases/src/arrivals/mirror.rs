//! Whether a picture is the mirror image of another one, or another one turned over.

use geometry::{AXIS_ORDERS, Volume};

/// The most voxels along an axis that are compared.
const MOST: usize = 64;

/// How much better the pictures must correlate when one is turned over: a head that is its own mirror image is none.
const MARGIN: f64 = 1e-3;

/// Few voxels of a volume, on both sides of its middle alike, so that they stay the same voxels when it is turned over.
#[derive(Debug)]
pub(super) struct Reduced {
    /// Those of the volume.
    full: [usize; 3],
    size: [usize; 3],
    /// With mean 0 and norm 1.
    voxels: Vec<f64>,
}

impl Reduced {
    /// Voxels of some slices of a volume.
    pub(super) fn new(volume: &Volume, slices: &[usize]) -> Self {
        let grid = volume.grid();
        let full = [grid.size()[0], grid.size()[1], slices.len()];
        let [columns, rows, layers] = full.map(places);
        let mut voxels = Vec::with_capacity(columns.len() * rows.len() * layers.len());
        for &layer in &layers {
            for &row in &rows {
                let voxel = |&column: &usize| grid.index([column, row, slices[layer]]);
                let of_row = columns.iter().map(voxel);
                voxels.extend(of_row.map(|index| f64::from(volume.voxels()[index])));
            }
        }
        normalise(&mut voxels);
        Self {
            full,
            size: [columns.len(), rows.len(), layers.len()],
            voxels,
        }
    }

    /// Whether this picture is more like another one that is mirrored, turned by right angles, or both, than like the other one as
    /// it is. It is if their sizes differ.
    pub(super) fn is_mirror_image_of(&self, other: &Self) -> bool {
        if self.full != other.full {
            return true;
        }
        let plain = self.correlation(other, AXIS_ORDERS[0], 0);
        let orders = AXIS_ORDERS
            .into_iter()
            .filter(|order| order.map(|axis| self.full[axis]) == self.full);
        let mut turned = orders.flat_map(|order| (0..8).map(move |reversed| (order, reversed)));
        turned.any(|(order, reversed)| self.correlation(other, order, reversed) > plain + MARGIN)
    }

    /// The correlation with another picture of which the axes are exchanged, and those reversed that have a bit.
    fn correlation(&self, other: &Self, order: [usize; 3], reversed: u8) -> f64 {
        let [columns, rows, _] = self.size;
        let steps = [1, columns, columns * rows];
        // Where the other picture has the voxels along an axis of this one.
        let along = |axis: usize| {
            let (count, step) = (self.size[axis], steps[order[axis]]);
            let at = move |index: usize| match reversed >> axis & 1 {
                0 => index * step,
                _ => (count - 1 - index) * step,
            };
            (0..count).map(at).collect::<Vec<_>>()
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let mut own = self.voxels.iter();
        let mut sum = 0.0;
        for layer in &z {
            for row in &y {
                let pairs = x.iter().zip(&mut own);
                let products = pairs.map(|(column, own)| own * other.voxels[column + row + layer]);
                sum += products.sum::<f64>();
            }
        }
        sum
    }
}

/// At most [`MOST`] of so many voxels along an axis.
fn places(count: usize) -> Vec<usize> {
    let step = count.div_ceil(MOST).max(1);
    let lower: Vec<_> = (0..count / 2).step_by(step).collect();
    let middle = (count % 2 == 1).then_some(count / 2);
    let upper = lower.iter().rev().map(|index| count - 1 - index);
    lower.iter().copied().chain(middle).chain(upper).collect()
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
    fn what_is_mirrored_or_turned_is_found_and_other_changes_are_not() {
        let plain = picture(|at, _| at, |value| value);
        assert!(!plain.is_mirror_image_of(&plain));
        for scaled in [|value| value / 3 * 2 + 100, |value: u16| value.min(2500)] {
            let changed = picture(|at, _| at, scaled);
            assert!(!changed.is_mirror_image_of(&plain) && !plain.is_mirror_image_of(&changed));
        }
        for axis in 0..3 {
            let reversed = |mut at: [usize; 3], sides: [usize; 3]| {
                at[axis] = sides[axis] - 1 - at[axis];
                at
            };
            assert!(
                picture(reversed, |value| value / 2).is_mirror_image_of(&plain),
                "{axis}"
            );
        }
        let exchanged = picture(|[x, y, z], _| [y, x, z], |value| value);
        assert!(exchanged.is_mirror_image_of(&plain));
        // Few voxels, the same ones from both ends.
        for count in [1, 2, 7, 64, 65, 256, 301] {
            let few = places(count);
            assert!(few.len() <= MOST + 1, "{count}");
            let reversed: Vec<_> = few.iter().rev().map(|index| count - 1 - index).collect();
            assert_eq!(few, reversed);
        }
    }
}
