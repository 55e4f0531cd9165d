//! The bytes of a map: eight bits per voxel, with one code for undefined.
//!
//! All numbers are little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `ISOMAP`, then the format as two digits |
//! | 4 | kind: see [`MapKind`] |
//! | 3 × 4 | voxels along x, y and z |
//! | 12 × 8 | `patient_from_voxel`, LPS mm: the columns of the axes, then the position of the first voxel |
//! | 2 × 4 | the value of code 1, and the difference between one code and the next |
//! | 1 per voxel | codes, x-fastest; 0 is undefined |

use geometry::Grid;
use glam::DAffine3;
use strum::{IntoStaticStr, VariantArray};

/// The version of the computation and storage of maps. Maps of another version are computed again.
pub const MAP_FORMAT: u32 = 9;

/// The code of an undefined voxel.
pub const UNDEFINED: u8 = 0;

const MAGIC: &[u8; 8] = b"ISOMAP03";
const HEADER_BYTES: usize = 8 + 4 + 3 * 4 + 12 * 8 + 2 * 4;

/// The kind of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
#[repr(u32)]
pub enum MapKind {
    /// Sharpness of the junction, per mm.
    Sharpness = 0,
    /// Density of voxels between grey and white matter, 0 to 1.
    Junction = 1,
    /// Sharpness compared with the mirrored side, in robust deviations: negative where this side is less sharp.
    Asymmetry = 2,
    /// Intensities smoothed by 4 mm, compared with the mirrored side, in robust deviations.
    IntensityAsymmetry = 3,
    /// How much less sharp the junction is than its surroundings and the other side, in robust deviations.
    Blur = 4,
    /// How much thicker the cortex is than on the other side, in robust deviations.
    Thickness = 5,
    /// How much brighter a FLAIR is than around and than on the other side, in robust deviations. It belongs to a layer.
    Flair = 6,
}

impl MapKind {
    /// All kinds, in the order of their numbers.
    pub const ALL: &'static [Self] = Self::VARIANTS;

    /// Those that are computed from a head alone, in the order of their numbers.
    pub const OF_HEAD: [Self; 6] = [
        Self::Sharpness,
        Self::Junction,
        Self::Asymmetry,
        Self::IntensityAsymmetry,
        Self::Blur,
        Self::Thickness,
    ];

    /// Its name in the interfaces.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The unit of its values, for legends.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Sharpness => "1/mm",
            Self::Junction => "",
            Self::Asymmetry
            | Self::IntensityAsymmetry
            | Self::Blur
            | Self::Thickness
            | Self::Flair => "z",
        }
    }

    /// The values of the codes.
    fn scale(self) -> Scale {
        let (least, step) = match self {
            Self::Sharpness => (0.0, 0.005),
            Self::Junction => (0.0, 1.0 / 254.0),
            Self::Asymmetry
            | Self::IntensityAsymmetry
            | Self::Blur
            | Self::Thickness
            | Self::Flair => (-12.7, 0.1),
        };
        Scale { least, step }
    }
}

/// The mapping from codes to values: `least + (code − 1) · step`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The value of code 1.
    pub least: f32,
    /// The difference between one code and the next.
    pub step: f32,
}

impl Scale {
    /// The nearest code; values beyond the ends are clamped, NaN is undefined.
    pub fn code(self, value: f32) -> u8 {
        // NaN stays NaN, and becomes 0: UNDEFINED.
        ((value - self.least) / self.step + 1.5).clamp(1.0, 255.0) as u8
    }

    /// The value of a code; NaN if it is undefined.
    pub fn value(self, code: u8) -> f32 {
        if code == UNDEFINED {
            return f32::NAN;
        }
        self.least + f32::from(code - 1) * self.step
    }
}

/// A map of a head, on a block of the native grid.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredMap {
    kind: MapKind,
    grid: Grid,
    scale: Scale,
    codes: Vec<u8>,
}

/// Why bytes cannot be decoded as a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StoredMapError {
    /// The bytes are not a map, or a map of another format.
    #[error("the bytes are not a map of format {MAP_FORMAT}; compute the maps again")]
    OtherFormat,
    /// The header has an impossible value.
    #[error("the header of the map is damaged: {what}; compute the maps again")]
    Damaged { what: &'static str },
}

impl StoredMap {
    /// A map from the values at some voxels of a grid, NaN where undefined; it is undefined everywhere else.
    pub(crate) fn new(
        kind: MapKind,
        grid: &Grid,
        voxels: &[u32],
        values: impl IntoIterator<Item = f32>,
    ) -> Self {
        let scale = kind.scale();
        let mut codes = vec![UNDEFINED; grid.voxel_count()];
        for (&voxel, value) in voxels.iter().zip(values) {
            codes[voxel as usize] = scale.code(value);
        }
        Self {
            kind,
            grid: grid.clone(),
            scale,
            codes,
        }
    }

    pub fn kind(&self) -> MapKind {
        self.kind
    }

    /// Its grid: a block of the grid of the volume.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The mapping from codes to values.
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// Codes, x-fastest.
    pub fn codes(&self) -> &[u8] {
        &self.codes
    }

    /// The codes, taken out.
    pub fn into_codes(self) -> Vec<u8> {
        self.codes
    }

    /// The value of a voxel; NaN where it is undefined.
    pub fn value(&self, index: usize) -> f32 {
        self.scale.value(self.codes[index])
    }

    /// Encodes it as described in the documentation of the module.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER_BYTES + self.codes.len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&(self.kind as u32).to_le_bytes());
        for side in self.grid.size() {
            bytes.extend_from_slice(&(side as u32).to_le_bytes());
        }
        for entry in self.grid.patient_from_voxel().to_cols_array() {
            bytes.extend_from_slice(&entry.to_le_bytes());
        }
        for number in [self.scale.least, self.scale.step] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&self.codes);
        bytes
    }

    /// Decodes the bytes from [`StoredMap::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are not a map of this format, or the header has an impossible value.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, StoredMapError> {
        let damaged = |what| StoredMapError::Damaged { what };
        let rest = bytes
            .strip_prefix(MAGIC)
            .ok_or(StoredMapError::OtherFormat)?;
        let (header, codes) = rest
            .split_at_checked(HEADER_BYTES - MAGIC.len())
            .ok_or(damaged("it is truncated"))?;
        let whole = |place: usize| {
            let bytes = header[4 * place..]
                .first_chunk()
                .expect("within the header");
            u32::from_le_bytes(*bytes)
        };
        let entry = |place: usize| {
            let bytes = header[16 + 8 * place..].first_chunk();
            f64::from_le_bytes(*bytes.expect("within the header"))
        };
        let number = |place: usize| {
            let bytes = header[16 + 96 + 4 * place..].first_chunk();
            f32::from_le_bytes(*bytes.expect("within the header"))
        };
        let kind = MapKind::ALL
            .iter()
            .copied()
            .find(|kind| *kind as u32 == whole(0))
            .ok_or(damaged("its kind is unknown"))?;
        let affine = DAffine3::from_cols_array(&std::array::from_fn(entry));
        let size = [1, 2, 3].map(|place| whole(place) as usize);
        let grid = Grid::new(size, affine).map_err(|_| damaged("its grid is invalid"))?;
        if codes.len() != grid.voxel_count() {
            return Err(damaged("it does not have one code for each voxel"));
        }
        let scale = Scale {
            least: number(0),
            step: number(1),
        };
        if !scale.least.is_finite() || !scale.step.is_finite() || scale.step <= 0.0 {
            return Err(damaged("its scale is invalid"));
        }
        Ok(Self {
            kind,
            grid,
            scale,
            codes: codes.to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    fn map() -> StoredMap {
        let affine = DAffine3 {
            matrix3: DMat3::from_rotation_z(0.3) * DMat3::from_diagonal(DVec3::new(1.0, 0.9, 1.2)),
            translation: DVec3::new(-80.0, 12.5, 7.0),
        };
        let grid = Grid::new([3, 4, 5], affine).unwrap();
        let values = (0..60).map(|index| match index {
            7 => f32::NAN,
            _ => index as f32 * 0.4 - 11.0,
        });
        let voxels: Vec<u32> = (0..60).collect();
        StoredMap::new(MapKind::Blur, &grid, &voxels, values)
    }

    #[test]
    fn a_map_comes_back_from_its_bytes() {
        let map = map();
        assert_eq!(StoredMap::from_bytes(&map.to_bytes()).unwrap(), map);
        assert!(map.value(7).is_nan());
        for index in (0..60).filter(|&index| index != 7) {
            let value = index as f32 * 0.4 - 11.0;
            assert!(
                (map.value(index) - value.min(12.7)).abs() < 0.051,
                "{index}"
            );
        }
    }

    #[test]
    fn every_map_that_is_cut_short_or_changed_in_its_header_is_refused_or_sound() {
        let bytes = map().to_bytes();
        for length in 0..bytes.len() {
            assert!(StoredMap::from_bytes(&bytes[..length]).is_err(), "{length}");
        }
        for place in 0..24 {
            let mut changed = bytes.clone();
            changed[place] ^= 0x55;
            assert!(StoredMap::from_bytes(&changed).is_err(), "{place}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert!(StoredMap::from_bytes(&longer).is_err());
    }

    #[test]
    fn codes_keep_to_their_ends_and_to_undefined() {
        for &kind in MapKind::ALL {
            let scale = kind.scale();
            assert_eq!(scale.code(f32::NAN), UNDEFINED);
            assert_eq!(scale.code(f32::NEG_INFINITY), 1);
            assert_eq!(scale.code(1e9), 255);
            for code in 1..=255 {
                assert_eq!(scale.code(scale.value(code)), code);
            }
        }
    }
}
