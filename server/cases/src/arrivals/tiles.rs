//! Whether a picture shows what another one shows in the same place.
//!
//! Each slice is compared with the former one on its own, tile by tile, without a shift. Noise, smoothing and other intensities leave
//! a tile with structure much as it was; if the slice was mirrored, turned or shifted, or is another slice, most tiles do not agree. What
//! is gone, such as a face or the skull, has not moved.

use geometry::Volume;

/// The least side of the pixels that are compared, if those of the volume are finer.
const PIXEL_MM: f64 = 1.0;

/// The most pixels along a row or a column.
const MOST: usize = 256;

/// The side of a tile.
const TILE_MM: f64 = 16.0;

/// The least correlation of a tile that shows the same.
const LEAST: f64 = 0.85;

/// The least standard deviation of a tile with structure, as a part of that of the whole picture.
const STRUCTURE: f64 = 0.15;

/// The least number of tiles by which a slice is judged.
const LEAST_TILES: usize = 8;

/// Some slices of a volume, with fewer pixels if they are fine.
#[derive(Debug)]
pub(super) struct Picture {
    /// Columns, rows and slices of the volume.
    full: [usize; 3],
    size: [usize; 3],
    /// Columns and rows of a tile.
    tile: [usize; 2],
    /// The means of blocks.
    pixels: Vec<u16>,
}

impl Picture {
    pub(super) fn new(volume: &Volume, slices: &[usize]) -> Self {
        let grid = volume.grid();
        let full = [grid.size()[0], grid.size()[1], slices.len()];
        let spacing_mm = grid.spacing_mm();
        let block = [0, 1].map(|axis| {
            let finest = (PIXEL_MM / spacing_mm[axis]).round() as usize;
            finest.max(full[axis].div_ceil(MOST)).max(1)
        });
        let [columns, rows] = [0, 1].map(|axis| full[axis] / block[axis]);
        let tile = [0, 1].map(|axis| {
            let pixels = (TILE_MM / (spacing_mm[axis] * block[axis] as f64)).round();
            (pixels as usize).max(4)
        });
        let mut pixels = Vec::with_capacity(columns * rows * slices.len());
        let mut sums = vec![0_u32; columns];
        let area = (block[0] * block[1]) as u32;
        for &slice in slices {
            for row in 0..rows {
                sums.fill(0);
                for row in row * block[1]..(row + 1) * block[1] {
                    let first = grid.index([0, row, slice]);
                    let voxels = volume.voxels()[first..].chunks_exact(block[0]);
                    for (sum, block) in sums.iter_mut().zip(voxels) {
                        *sum += block.iter().copied().map(u32::from).sum::<u32>();
                    }
                }
                pixels.extend(sums.iter().map(|sum| (sum / area) as u16));
            }
        }
        Self {
            full,
            size: [columns, rows, slices.len()],
            tile,
            pixels,
        }
    }

    /// Whether any slice shows something else than the one of another picture in the same place. If no slice shows enough, all are
    /// judged together, and count as moved if that is not enough either. So do pictures of different sizes.
    pub(super) fn is_moved_from(&self, other: &Self) -> bool {
        if self.full != other.full || self.tile != other.tile {
            return true;
        }
        let gone = lowest(&self.pixels);
        let least = STRUCTURE.powi(2) * variance(&other.pixels);
        let area = (self.size[0] * self.size[1]).max(1);
        let slices = self.pixels.chunks(area).zip(other.pixels.chunks(area));
        let tiles: Vec<Vec<bool>> = slices
            .map(|(here, before)| self.agreeing(here, before, gone, least))
            .collect();
        let mut judged = tiles.iter().filter_map(|tiles| is_apart(tiles)).peekable();
        match judged.peek() {
            Some(_) => judged.any(|is_apart| is_apart),
            None => is_apart(&tiles.concat()).unwrap_or(true),
        }
    }

    /// Whether the tiles of a slice that can tell show what they showed before.
    fn agreeing(&self, here: &[u16], before: &[u16], gone: u16, least: f64) -> Vec<bool> {
        let area = self.tile[0] * self.tile[1];
        let tiles = self.tiles(here, before, gone).into_iter();
        tiles.filter_map(|tile| tile.agrees(least, area)).collect()
    }

    /// The tiles of a slice, here and before. Pixels that are gone here do not count.
    fn tiles(&self, here: &[u16], before: &[u16], gone: u16) -> Vec<Sums> {
        let [columns, rows] = [0, 1].map(|axis| self.size[axis].div_ceil(self.tile[axis]));
        let mut tiles = vec![Sums::default(); columns * rows];
        let lines = here.chunks(self.size[0]).zip(before.chunks(self.size[0]));
        for (row, (here, before)) in lines.enumerate() {
            let first = row / self.tile[1] * columns;
            for (column, (&here, &before)) in here.iter().zip(before).enumerate() {
                if here > gone {
                    tiles[first + column / self.tile[0]].add(here, before);
                }
            }
        }
        tiles
    }
}

/// Whether most tiles do not agree; `None` if they are too few.
fn is_apart(tiles: &[bool]) -> Option<bool> {
    let apart = tiles.iter().filter(|agrees| !**agrees).count();
    (tiles.len() >= LEAST_TILES).then_some(2 * apart > tiles.len())
}

fn lowest(pixels: &[u16]) -> u16 {
    pixels.iter().copied().min().unwrap_or(0)
}

/// The variance of all pixels that show anything.
fn variance(pixels: &[u16]) -> f64 {
    let lowest = lowest(pixels);
    let values = || {
        pixels
            .iter()
            .filter(|pixel| **pixel > lowest)
            .copied()
            .map(f64::from)
    };
    let count = values().count().max(1) as f64;
    let mean = values().sum::<f64>() / count;
    values().map(|value| (value - mean).powi(2)).sum::<f64>() / count
}

/// Sums over the pixels of a tile, here and before.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: u64,
    sums: [u64; 2],
    squares: [u64; 2],
    products: u64,
}

impl Sums {
    fn add(&mut self, here: u16, before: u16) {
        let [here, before] = [here, before].map(u64::from);
        self.count += 1;
        self.sums[0] += here;
        self.sums[1] += before;
        self.squares[0] += here * here;
        self.squares[1] += before * before;
        self.products += here * before;
    }

    /// Here and before.
    fn variances(&self) -> [f64; 2] {
        [0, 1].map(|of| {
            let mean = self.mean(of);
            self.squares[of] as f64 / self.count as f64 - mean * mean
        })
    }

    fn mean(&self, of: usize) -> f64 {
        self.sums[of] as f64 / self.count as f64
    }

    /// Whether a tile shows the same as before; `None` if it had no structure, has none any more, or most of it is gone.
    fn agrees(&self, least: f64, area: usize) -> Option<bool> {
        if 2 * self.count < area as u64 {
            return None;
        }
        let [here, before] = self.variances();
        // Pixels are whole numbers: the least variance is that of one that differs by 1.
        if before <= least || here * (self.count as f64) < 0.5 {
            return None;
        }
        let covariance = self.products as f64 / self.count as f64 - self.mean(0) * self.mean(1);
        Some(covariance >= LEAST * (here * before).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use geometry::Grid;
    use geometry::phantom::head;

    use super::*;

    /// A head, of which each voxel comes from elsewhere in it and is scaled. Its sides differ, as those of a real one do.
    fn picture(
        from: impl Fn([usize; 3], [usize; 3]) -> [usize; 3],
        scaled: impl Fn(u16) -> u16,
    ) -> Picture {
        let head = head(3.0).volume;
        let grid: &Grid = head.grid();
        let size = grid.size();
        let voxels = (0..grid.voxel_count()).map(|index| {
            let [x, y, z] = from(grid.voxel(index), size);
            let wave = |at: usize, of_mm: f64| (at as f64 * 3.0 / of_mm).sin();
            let bend = 2.0 + wave(x, 23.0) + wave(y, 31.0) + wave(z, 29.0);
            let y = ((y as f64 + bend) as usize).min(size[1] - 1);
            scaled(head.voxels()[grid.index([x, y, z])])
        });
        let volume = Volume::new(grid.clone(), voxels.collect(), head.rescale()).unwrap();
        let slices: Vec<_> = (0..size[2]).collect();
        Picture::new(&volume, &slices)
    }

    #[test]
    fn what_is_mirrored_or_shifted_is_found_and_other_changes_are_not() {
        let plain = picture(|at, _| at, |value| value);
        assert!(!plain.is_moved_from(&plain));
        for scaled in [|value| value / 3 * 2 + 100, |value: u16| value.min(700)] {
            let changed = picture(|at, _| at, scaled);
            assert!(!changed.is_moved_from(&plain) && !plain.is_moved_from(&changed));
        }
        let inverted = picture(|at, _| at, |value| 1000 - value.min(1000));
        assert!(inverted.is_moved_from(&plain));
        for axis in 0..3 {
            let mirrored = move |mut at: [usize; 3], sides: [usize; 3]| {
                at[axis] = sides[axis] - 1 - at[axis];
                at
            };
            assert!(
                picture(mirrored, |value| value).is_moved_from(&plain),
                "{axis}"
            );
            let inverted = picture(mirrored, |value| 1000 - value.min(1000));
            assert!(inverted.is_moved_from(&plain), "{axis}");
            let shifted = move |mut at: [usize; 3], _: [usize; 3]| {
                at[axis] = at[axis].saturating_sub(2);
                at
            };
            assert!(
                picture(shifted, |value| value).is_moved_from(&plain),
                "{axis}"
            );
        }
    }

    #[test]
    fn one_slice_is_enough_and_what_is_gone_has_not_moved() {
        let plain = picture(|at, _| at, |value| value);
        let mirrored = |at: [usize; 3], sides: [usize; 3]| match at {
            [x, y, z] if z == sides[2] / 2 => [x, sides[1] - 1 - y, z],
            _ => at,
        };
        assert!(picture(mirrored, |value| value).is_moved_from(&plain));
        let exchanged = |at: [usize; 3], sides: [usize; 3]| match at {
            [x, y, z] if z == sides[2] / 2 => [x, y, z + 8],
            [x, y, z] if z == sides[2] / 2 + 8 => [x, y, z - 8],
            _ => at,
        };
        assert!(picture(exchanged, |value| value).is_moved_from(&plain));
        // The corner of the volume is empty.
        let cut = |at: [usize; 3], sides: [usize; 3]| match at {
            [x, y, _] if x < sides[0] / 2 || y < sides[1] / 3 => [0; 3],
            _ => at,
        };
        assert!(!picture(cut, |value| value).is_moved_from(&plain));
    }
}
