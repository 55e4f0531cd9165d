//! Intensities as bytes.

use geometry::{Grid, Rescale, Volume};

use super::bytes::{Reader, put_grid};
use super::residuals::{put_residuals, read_residuals};

/// The predicted value of a voxel: the mean of its previous neighbours along x and y, or the only one.
///
/// The mean of two neighbours has less MR noise than a single one.
fn predict(before: &[u16], x: usize, row_length: usize, has_row_above: bool) -> u16 {
    let at = before.len();
    match (x > 0, has_row_above) {
        (true, true) => u16::midpoint(before[at - 1], before[at - row_length]),
        (true, false) => before[at - 1],
        (false, true) => before[at - row_length],
        (false, false) => 0,
    }
}

/// The payload of a volume.
pub fn encode_volume(volume: &Volume) -> Vec<u8> {
    let voxels = volume.voxels();
    let [nx, ny, _] = volume.grid().size();
    let mut bytes = Vec::with_capacity(2 * voxels.len() + 256);
    put_grid(&mut bytes, volume.grid());
    bytes.extend(volume.rescale().slope.to_le_bytes());
    bytes.extend(volume.rescale().intercept.to_le_bytes());
    let residuals = voxels.iter().enumerate().map(|(index, &voxel)| {
        let (x, y) = (index % nx, index / nx % ny);
        voxel.wrapping_sub(predict(&voxels[..index], x, nx, y > 0))
    });
    put_residuals(&mut bytes, residuals);
    bytes
}

/// The volume of a payload; `None` if it is not one.
pub fn decode_volume(bytes: &[u8]) -> Option<Volume> {
    let mut reader = Reader(bytes);
    let grid = reader.grid()?;
    let rescale = Rescale {
        slope: reader.f32()?,
        intercept: reader.f32()?,
    };
    let residuals = read_residuals(&mut reader, grid.voxel_count())?;
    let voxels = undo_prediction(&grid, residuals);
    Volume::new(grid, voxels, rescale).ok()
}

fn undo_prediction(grid: &Grid, mut residuals: impl ExactSizeIterator<Item = u16>) -> Vec<u16> {
    let [nx, ny, nz] = grid.size();
    let mut voxels = Vec::with_capacity(residuals.len());
    for row in 0..ny * nz {
        for (x, residual) in residuals.by_ref().take(nx).enumerate() {
            voxels.push(residual.wrapping_add(predict(&voxels, x, nx, row % ny > 0)));
        }
    }
    voxels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_volume_comes_back_exactly() {
        let grid = Grid::aligned([7, 5, 3], [1.0, 2.0, 0.5], glam::DVec3::NEG_ONE).unwrap();
        let voxels = (0..105u32)
            .map(|index| ((index * 40_503) >> 3) as u16)
            .collect();
        let rescale = Rescale {
            slope: 0.5,
            intercept: -3.0,
        };
        let volume = Volume::new(grid, voxels, rescale).unwrap();
        let bytes = encode_volume(&volume);
        assert_eq!(decode_volume(&bytes), Some(volume));
        assert_eq!(decode_volume(&bytes[..bytes.len() - 1]), None);
    }
}
