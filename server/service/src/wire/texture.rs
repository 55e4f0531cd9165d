//! Three-dimensional textures, without a copy of the voxels.

use std::fmt;
use std::sync::Arc;

use bytes::Bytes;
use case::CaseFacts;
use geometry::{DepthField, Grid, Volume};
use glam::{DAffine3, DVec3};

use case::LayerKind;
use cases::library::LayerVoxels;
use cases::models::WarmModel;
use render::{Layer, LayerValues};

/// A block of voxels and their encoding.
#[derive(Debug)]
pub struct Texture {
    /// Voxels, x-fastest, little-endian.
    pub voxels: Voxels,
    /// `u8`, `u16` or `i16`.
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

/// Where the bytes of a texture come from.
pub enum Voxels {
    /// The bytes of the model.
    Shared(Bytes),
    /// Computed on demand.
    Made(Box<dyn FnOnce() -> Bytes + Send>),
}

impl Voxels {
    pub fn bytes(self) -> Bytes {
        match self {
            Self::Shared(bytes) => bytes,
            Self::Made(make) => make(),
        }
    }
}

impl fmt::Debug for Voxels {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Shared(_) => "Shared",
            Self::Made(_) => "Made",
        })
    }
}

/// A volume in memory whose voxels can be sent without a copy.
pub trait Owner: Clone + Send + Sync + 'static {
    fn volume(&self) -> &Volume;
}

impl Owner for Arc<Volume> {
    fn volume(&self) -> &Volume {
        self
    }
}

impl Owner for WarmModel {
    fn volume(&self) -> &Volume {
        self.model().volume()
    }
}

/// Intensities as acquired, or in eight bits over a range from [`quick_range`].
///
/// The least of 16 bits is sent as 0: devices that filter these in half precision are exact for small numbers, but
/// round those of a NIfTI file with signed voxels, which are stored from 32,768 on, to multiples of 32.
pub fn volume_texture(owner: impl Owner, range: Option<[f32; 2]>) -> Texture {
    let volume = owner.volume();
    let rescale = volume.rescale();
    let whole = Texture {
        voxels: Voxels::Shared(shared_voxels(&owner, |owner| owner.volume().voxels())),
        format: "u16",
        scale: rescale.slope,
        offset: rescale.intercept,
        size: volume.grid().size(),
        patient_from_voxel: rows_of(volume.grid().patient_from_voxel()),
    };
    let Some([low, high]) = range else {
        return from_the_least(whole, owner);
    };
    let step = ((high - low) / 255.0).max(f32::MIN_POSITIVE);
    let make = move || {
        let volume = owner.volume();
        // A float below 0 or above 255 becomes the nearer end.
        let quick = |stored| ((volume.intensity(f32::from(stored)) - low) / step).round() as u8;
        let table: Vec<u8> = (0..=u16::MAX).map(quick).collect();
        let voxels = volume.voxels().iter();
        voxels.map(|&stored| table[usize::from(stored)]).collect()
    };
    Texture {
        voxels: Voxels::Made(Box::new(make)),
        format: "u8",
        scale: step,
        offset: low,
        ..whole
    }
}

/// A texture of all 16 bits with the least stored value of a volume as 0.
fn from_the_least(whole: Texture, owner: impl Owner) -> Texture {
    let least = owner.volume().voxels().iter().copied().min();
    let Some(least) = least.filter(|&least| least > 0) else {
        return whole;
    };
    let make = move || {
        let voxels = owner.volume().voxels().iter();
        voxels
            .flat_map(|stored| (stored - least).to_le_bytes())
            .collect()
    };
    Texture {
        voxels: Voxels::Made(Box::new(make)),
        offset: whole.offset + whole.scale * f32::from(least),
        ..whole
    }
}

/// Numbers of 16 bits as their differences from the number before, which a general compression makes smaller than the numbers.
///
/// A difference `d`, modulo 2¹⁶, is written as `2 d` if it is not negative, else as `-2 d - 1`: first the lower bytes of all, then the upper ones.
pub fn differences(numbers: &[u8]) -> Vec<u8> {
    let count = numbers.len() / 2;
    let mut planes = vec![0; 2 * count];
    let (lower, upper) = planes.split_at_mut(count);
    let mut before = 0_i16;
    for (index, pair) in numbers.chunks_exact(2).enumerate() {
        let number = i16::from_le_bytes([pair[0], pair[1]]);
        let difference = number.wrapping_sub(before);
        [lower[index], upper[index]] = ((difference << 1) ^ (difference >> 15)).to_le_bytes();
        before = number;
    }
    planes
}

/// The range of intensities of eight bits, for a first picture: the default window and half its width to either side, as
/// far as the intensities around the brain reach.
pub fn quick_range(facts: &CaseFacts) -> [f32; 2] {
    let low = (facts.window.center - facts.window.width).max(facts.intensity_min);
    let high = (facts.window.center + facts.window.width).min(facts.intensity_max);
    [low, high.max(low)]
}

/// A layer of eight bits on its grid.
///
/// # Panics
/// If the layer does not have codes, as maps have.
pub fn layer_texture(grid: &Grid, layer: &Arc<Layer>) -> Texture {
    struct Codes(Arc<Layer>);
    impl AsRef<[u8]> for Codes {
        fn as_ref(&self) -> &[u8] {
            match self.0.values() {
                LayerValues::Codes { codes, .. } => codes,
                LayerValues::Numbers(_) | LayerValues::Labels { .. } => &[],
            }
        }
    }
    let LayerValues::Codes { least, step, .. } = *layer.values() else {
        panic!("a map is stored in codes");
    };
    Texture {
        voxels: Voxels::Shared(Bytes::from_owner(Codes(Arc::clone(layer)))),
        format: "u8",
        scale: step,
        offset: least - step,
        size: layer.size(),
        patient_from_voxel: rows_of(grid.patient_from_voxel()),
    }
}

/// An added layer around the envelope, on its own grid in the patient space of the case: its stored values, or for a
/// label map the numbers of the colours.
///
/// # Errors
/// If its placement is beyond all bounds.
pub fn added_layer_texture(voxels: LayerVoxels) -> Result<Texture, cases::Error> {
    let grid = voxels.grid_in_case()?;
    let rescale = voxels.volume.rescale();
    let format = match voxels.kind {
        LayerKind::Labels => "u8",
        _ => "u16",
    };
    let make = move || match voxels.kind {
        LayerKind::Labels => voxels.label_colors().into(),
        _ => {
            let codes = voxels.volume.voxels().iter();
            codes.flat_map(|code| code.to_le_bytes()).collect()
        }
    };
    Ok(Texture {
        voxels: Voxels::Made(Box::new(make)),
        format,
        scale: rescale.slope,
        offset: rescale.intercept,
        size: grid.size(),
        patient_from_voxel: rows_of(grid.patient_from_voxel()),
    })
}

/// The signed depth below a surface on its working grid, in mm; of a part, with the fence in the lowest bit.
pub fn depth_texture(model: &WarmModel) -> Texture {
    let grid = model.model().field().grid();
    Texture {
        voxels: if model.surface().is_whole() {
            Voxels::Shared(shared_voxels(model, |model| model.model().field().values()))
        } else {
            let shared = model.clone();
            let bytes = |value: i16| value.to_le_bytes();
            let make = move || {
                fenced_depths(shared.model().field())
                    .flat_map(bytes)
                    .collect()
            };
            Voxels::Made(Box::new(make))
        },
        format: "i16",
        scale: grid.spacing_mm()[0] as f32 / DepthField::STEPS_PER_VOXEL,
        offset: 0.0,
        size: grid.size(),
        patient_from_voxel: rows_of(grid.patient_from_voxel()),
    }
}

/// Every `step`th depth along each axis, from the first on: enough for the shading of a first picture.
pub fn coarse_depth_texture(model: &WarmModel, step: usize) -> Texture {
    let whole = depth_texture(model);
    let affine = model.model().field().grid().patient_from_voxel();
    let shared = model.clone();
    let make = move || {
        let field = shared.model().field();
        let values = if shared.surface().is_whole() {
            every(step, field.grid(), field.values())
        } else {
            every(
                step,
                field.grid(),
                &fenced_depths(field).collect::<Vec<_>>(),
            )
        };
        values.into_iter().flat_map(i16::to_le_bytes).collect()
    };
    Texture {
        voxels: Voxels::Made(Box::new(make)),
        size: whole.size.map(|side| side.div_ceil(step)),
        patient_from_voxel: rows_of(affine * DAffine3::from_scale(DVec3::splat(step as f64))),
        ..whole
    }
}

/// The depths of a field, whose lowest bits are 1 where a fence makes the depth unknown.
fn fenced_depths(field: &DepthField) -> impl Iterator<Item = i16> + '_ {
    let fenced = field.fenced();
    field
        .values()
        .iter()
        .enumerate()
        .map(move |(index, value)| {
            let voxel = field.grid().voxel(index).map(|along| along as i64);
            value & !1 | i16::from(fenced.is_some_and(|fenced| fenced.contains(voxel)))
        })
}

/// Every `step`th value along each axis, from the first on.
fn every(step: usize, grid: &Grid, values: &[i16]) -> Vec<i16> {
    let [nx, ny, nz] = grid.size();
    let mut kept = Vec::new();
    for z in (0..nz).step_by(step) {
        for y in (0..ny).step_by(step) {
            let row = &values[nx * (y + ny * z)..][..nx];
            kept.extend(row.iter().step_by(step));
        }
    }
    kept
}

/// Voxels as bytes that keep their owner alive, not copied where memory is little-endian already.
fn shared_voxels<O: Clone + Send + Sync + 'static, T: bytemuck::Pod>(
    owner: &O,
    voxels: fn(&O) -> &[T],
) -> Bytes {
    struct Shared<O, T: 'static>(O, fn(&O) -> &[T]);
    impl<O, T: bytemuck::Pod> AsRef<[u8]> for Shared<O, T> {
        fn as_ref(&self) -> &[u8] {
            bytemuck::cast_slice(self.1(&self.0))
        }
    }
    let shared = Shared(owner.clone(), voxels);
    if cfg!(target_endian = "little") {
        Bytes::from_owner(shared)
    } else {
        let swapped = |pair: &[u8]| [pair[1], pair[0]];
        shared.as_ref().chunks_exact(2).flat_map(swapped).collect()
    }
}

fn rows_of(affine: DAffine3) -> [f64; 12] {
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
    use geometry::Rescale;
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_coarse_block_keeps_the_first_of_each_step() {
        let grid = Grid::aligned([5, 2, 3], [1.0; 3], DVec3::ZERO).unwrap();
        let values: Vec<i16> = (0..30).collect();
        assert_eq!(every(1, &grid, &values), values);
        assert_eq!(every(2, &grid, &values), [0, 2, 4, 20, 22, 24]);
        assert_eq!(every(9, &grid, &values), [0]);
    }

    #[test]
    fn intensities_are_sent_from_the_least_on() {
        let grid = Grid::aligned([3, 1, 1], [1.0; 3], DVec3::ZERO).unwrap();
        let sent = |stored: [u16; 3]| {
            let rescale = Rescale {
                slope: 0.5,
                intercept: -16384.0,
            };
            let volume = Volume::new(grid.clone(), stored.to_vec(), rescale).unwrap();
            let texture = volume_texture(Arc::new(volume), None);
            let offset = texture.offset;
            let bytes = texture.voxels.bytes();
            let codes = bytes.chunks_exact(2);
            let codes = codes.map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
            (codes.collect::<Vec<_>>(), offset)
        };
        assert_eq!(sent([32768, 33068, 33768]), (vec![0, 300, 1000], 0.0));
        assert_eq!(sent([0, 33068, 65535]), (vec![0, 33068, 65535], -16384.0));
    }

    #[test]
    fn differences_are_small_and_wrap_around() {
        let numbers = [5_u16, 7, 6, 65535, 0].map(u16::to_le_bytes).concat();
        // 5, +2, -1, -7 and +1, modulo 2¹⁶.
        assert_eq!(differences(&numbers), [10, 4, 1, 13, 2, 0, 0, 0, 0, 0]);
        let far = [0_u16, 40000].map(u16::to_le_bytes).concat();
        let code = (2 * (65536 - 40000) - 1_u32) as u16;
        let [lower, upper] = code.to_le_bytes();
        assert_eq!(differences(&far), [0, lower, 0, upper]);
    }

    #[test]
    fn the_affine_is_written_row_by_row() {
        let grid = Grid::aligned([2, 2, 2], [1.0, 2.0, 3.0], DVec3::new(-7.0, 8.0, 9.0)).unwrap();
        let expected = [1.0, 0.0, 0.0, -7.0, 0.0, 2.0, 0.0, 8.0, 0.0, 0.0, 3.0, 9.0];
        assert_eq!(rows_of(grid.patient_from_voxel()), expected);
    }
}
