//! Three-dimensional textures, without a copy of the voxels.

use std::sync::Arc;

use bytes::Bytes;
use geometry::{DepthField, Grid};

use crate::models::Model;

/// A block of 16-bit voxels and how to read them.
#[derive(Debug)]
pub struct Texture {
    /// Voxels, x-fastest, little-endian.
    pub voxels: Bytes,
    /// `u16` or `i16`.
    pub format: &'static str,
    /// Value of a stored unit.
    pub scale: f32,
    /// Value of the stored 0.
    pub offset: f32,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Rows of the affine from voxel centres to LPS mm, without the last.
    pub patient_from_voxel: [f64; 12],
}

/// The intensities of a case, as acquired, cropped to the envelope.
pub fn volume_texture(model: &Arc<Model>) -> Texture {
    let rescale = model.volume.rescale();
    Texture {
        voxels: shared_voxels(model, |model| model.volume.voxels()),
        format: "u16",
        scale: rescale.slope,
        offset: rescale.intercept,
        size: model.volume.grid().size(),
        patient_from_voxel: rows_of_affine(model.volume.grid()),
    }
}

/// The signed depth of a case on the working grid, in mm.
pub fn depth_texture(model: &Arc<Model>) -> Texture {
    let grid = model.field.grid();
    Texture {
        voxels: shared_voxels(model, |model| model.field.values()),
        format: "i16",
        scale: grid.spacing_mm()[0] as f32 / DepthField::STEPS_PER_VOXEL,
        offset: 0.0,
        size: grid.size(),
        patient_from_voxel: rows_of_affine(grid),
    }
}

/// Voxels of a model as bytes that keep the model alive, not copied where memory is little-endian already.
fn shared_voxels<T: bytemuck::Pod>(model: &Arc<Model>, voxels: fn(&Model) -> &[T]) -> Bytes {
    struct Shared<T: 'static>(Arc<Model>, fn(&Model) -> &[T]);
    impl<T: bytemuck::Pod> AsRef<[u8]> for Shared<T> {
        fn as_ref(&self) -> &[u8] {
            bytemuck::cast_slice(self.1(&self.0))
        }
    }
    let shared = Shared(Arc::clone(model), voxels);
    if cfg!(target_endian = "little") {
        Bytes::from_owner(shared)
    } else {
        let swapped = |pair: &[u8]| [pair[1], pair[0]];
        shared.as_ref().chunks_exact(2).flat_map(swapped).collect()
    }
}

fn rows_of_affine(grid: &Grid) -> [f64; 12] {
    let affine = grid.patient_from_voxel();
    let columns = affine.matrix3.to_cols_array_2d();
    let translation = affine.translation.to_array();
    std::array::from_fn(|position| {
        let (row, column) = (position / 4, position % 4);
        columns
            .get(column)
            .map_or(translation[row], |axis| axis[row])
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_affine_is_written_row_by_row() {
        let grid = Grid::aligned([2, 2, 2], [1.0, 2.0, 3.0], DVec3::new(-7.0, 8.0, 9.0)).unwrap();
        let expected = [1.0, 0.0, 0.0, -7.0, 0.0, 2.0, 0.0, 8.0, 0.0, 0.0, 3.0, 9.0];
        assert_eq!(rows_of_affine(&grid), expected);
    }
}
