//! A second scan of a head, made from the first: other voxels and other noise, the same head.

use analysis::TissueScale;
use geometry::{Grid, Volume};
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::lesion::Sampler;
use crate::random::Random;

/// The same head on voxels that lie half a voxel further along each axis. Interpolation removes noise; white Gaussian noise with the
/// missing variance is added. Voxels without intensity around them stay so.
pub(crate) fn half_a_voxel_further(volume: &Volume, tissue: &TissueScale, seed: u64) -> Volume {
    let grid = volume.grid();
    let half = DVec3::splat(0.5);
    let patient_from_voxel = grid.patient_from_voxel() * DAffine3::from_translation(half);
    let shifted = Grid::new(grid.size(), patient_from_voxel).expect("a grid of the same voxels");
    let noise = f64::from(tissue.noise * (tissue.white - tissue.grey));
    let [nx, ny, nz] = grid.size();
    let rescale = volume.rescale();
    let sampler = Sampler { volume };
    let slice = |z: usize| {
        let mut random = Random::new(seed ^ (z as u64 + 1));
        let mut values = Vec::with_capacity(nx * ny);
        for y in 0..ny {
            for x in 0..nx {
                // A number is drawn for each voxel, so that none depends on the others.
                let drawn = random.normal();
                let ahead = [x + 1, y + 1, z + 1];
                let far = [0, 1, 2].map(|axis| ahead[axis].min(grid.size()[axis] - 1));
                let is_empty = [grid.index([x, y, z]), grid.index(far)]
                    .iter()
                    .all(|&index| volume.voxels()[index] == 0);
                if is_empty {
                    values.push(0);
                    continue;
                }
                let place = DVec3::new(x as f64, y as f64, z as f64) + half;
                let (intensity, kept) = sampler.at(place);
                let missing = (1.0 - kept).max(0.0).sqrt();
                let stored = (intensity + noise * missing * drawn - f64::from(rescale.intercept))
                    / f64::from(rescale.slope);
                values.push(stored.round().clamp(0.0, 65535.0) as u16);
            }
        }
        values
    };
    let voxels = (0..nz).into_par_iter().flat_map_iter(slice).collect();
    Volume::new(shifted, voxels, rescale).expect("as many voxels as before")
}
