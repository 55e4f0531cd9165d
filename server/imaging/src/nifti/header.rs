//! The fixed-size header at the start of a file, in either version and byte order.

use crate::ImagingError;
use crate::sniff::recognised;

use super::affine::Placement;
use super::datatype::DataType;
use super::start::{ByteOrder, NIFTI_1_HEADER, Version, kind};

/// The greatest offset of the voxels from the start of the file: enough for large extensions.
const MAX_VOX_OFFSET: u64 = 64 << 20;

const NIFTI_2_MAGIC: &[u8] = b"n+2\0\r\n\x1a\n";
const NIFTI_2_PAIR_MAGIC: &[u8] = b"ni2\0\r\n\x1a\n";

/// The needed values of a header, checked as far as the header alone allows.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Header {
    pub(crate) order: ByteOrder,
    /// Voxels along x, y and z, each at least 2.
    pub(crate) size: [usize; 3],
    pub(crate) data_type: DataType,
    /// The offset of the voxels from the start of the file, in bytes.
    pub(crate) vox_offset: u64,
    pub(crate) scaling: Scaling,
    pub(crate) placement: Placement,
}

/// Intensity = slope · value + intercept; the slope is not zero, and both are finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

impl Header {
    /// Reads a header from its bytes; [`header_length`](super::start::header_length) states how many there must be.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, ImagingError> {
        let (version, order) = kind(bytes).ok_or_else(|| ImagingError::NotNifti {
            found: recognised(bytes),
        })?;
        check_magic(version, bytes)?;
        let fields = Fields { bytes, order };
        match version {
            Version::One => Self::parse_nifti_1(&fields),
            Version::Two => Self::parse_nifti_2(&fields),
        }
    }

    fn parse_nifti_1(fields: &Fields) -> Result<Self, ImagingError> {
        let single = |at| f64::from(fields.f32(at));
        Ok(Self {
            order: fields.order,
            size: volume_size(std::array::from_fn(|i| fields.i16(40 + 2 * i).into()))?,
            data_type: DataType::from_header(fields.i16(70), fields.i16(72))?,
            vox_offset: vox_offset(single(108), 352)?,
            scaling: Scaling::from_header(single(112), single(116))?,
            placement: Placement {
                units: fields.bytes[123],
                pixdim: std::array::from_fn(|i| single(76 + 4 * i)),
                qform_code: fields.i16(252).into(),
                sform_code: fields.i16(254).into(),
                quaternion: std::array::from_fn(|i| single(256 + 4 * i)),
                qoffset: std::array::from_fn(|i| single(268 + 4 * i)),
                srow: std::array::from_fn(|row| {
                    std::array::from_fn(|column| single(280 + 16 * row + 4 * column))
                }),
            },
        })
    }

    fn parse_nifti_2(fields: &Fields) -> Result<Self, ImagingError> {
        let double = |at| fields.f64(at);
        Ok(Self {
            order: fields.order,
            size: volume_size(std::array::from_fn(|i| fields.i64(16 + 8 * i)))?,
            data_type: DataType::from_header(fields.i16(12), fields.i16(14))?,
            vox_offset: vox_offset(fields.i64(168) as f64, 544)?,
            scaling: Scaling::from_header(double(176), double(184))?,
            placement: Placement {
                units: fields.i32(500) as u8,
                pixdim: std::array::from_fn(|i| double(104 + 8 * i)),
                qform_code: fields.i32(344),
                sform_code: fields.i32(348),
                quaternion: std::array::from_fn(|i| double(352 + 8 * i)),
                qoffset: std::array::from_fn(|i| double(376 + 8 * i)),
                srow: std::array::from_fn(|row| {
                    std::array::from_fn(|column| double(400 + 32 * row + 8 * column))
                }),
            },
        })
    }

    /// The bytes of a header with the forms and sizes of this one, and with voxels that follow four bytes after it.
    pub(crate) fn written_over(&self, bytes: &[u8]) -> Vec<u8> {
        let mut written = bytes.to_vec();
        let mut put = |at: usize, little_endian: &[u8]| {
            let place = &mut written[at..at + little_endian.len()];
            place.copy_from_slice(little_endian);
            if self.order == ByteOrder::Big {
                place.reverse();
            }
        };
        let Placement {
            qform_code,
            sform_code,
            pixdim,
            ..
        } = self.placement;
        if bytes.len() == NIFTI_1_HEADER {
            put(108, &352f32.to_le_bytes());
            put(252, &(qform_code as i16).to_le_bytes());
            put(254, &(sform_code as i16).to_le_bytes());
            for (axis, side) in pixdim.into_iter().enumerate().take(4).skip(1) {
                put(76 + 4 * axis, &(side as f32).to_le_bytes());
            }
        } else {
            put(168, &544i64.to_le_bytes());
            put(344, &qform_code.to_le_bytes());
            put(348, &sform_code.to_le_bytes());
            for (axis, side) in pixdim.into_iter().enumerate().take(4).skip(1) {
                put(104 + 8 * axis, &side.to_le_bytes());
            }
        }
        written
    }

    /// Number of voxels, saturating.
    pub(crate) fn voxel_count(&self) -> u64 {
        let side = |side: &usize| *side as u64;
        self.size.iter().map(side).fold(1, u64::saturating_mul)
    }

    /// Bytes of all voxels, saturating.
    pub(crate) fn voxel_bytes(&self) -> u64 {
        self.voxel_count()
            .saturating_mul(self.data_type.bytes() as u64)
    }

    /// Bytes of the whole file, unpacked, saturating.
    pub(crate) fn file_bytes(&self) -> u64 {
        self.vox_offset.saturating_add(self.voxel_bytes())
    }
}

/// The magic word distinguishes a single file from a pair, and NIfTI-1 from Analyze.
fn check_magic(version: Version, bytes: &[u8]) -> Result<(), ImagingError> {
    match version {
        Version::One => match &bytes[344..348] {
            b"n+1\0" => Ok(()),
            b"ni1\0" => Err(ImagingError::NiftiHeaderOnly),
            magic if magic[0] == b'n' => Err(BAD_MAGIC),
            _ => Err(ImagingError::Analyze),
        },
        Version::Two => match &bytes[4..12] {
            NIFTI_2_MAGIC => Ok(()),
            NIFTI_2_PAIR_MAGIC => Err(ImagingError::NiftiHeaderOnly),
            _ => Err(BAD_MAGIC),
        },
    }
}

const BAD_MAGIC: ImagingError = ImagingError::NiftiHeader {
    what: "its magic word is wrong",
};

/// Voxels along x, y and z, from `dim`: its length, then the sides; those beyond z must be 1.
fn volume_size(dim: [i64; 8]) -> Result<[usize; 3], ImagingError> {
    let dimensions = usize::try_from(dim[0])
        .ok()
        .filter(|count| (1..=7).contains(count))
        .ok_or(ImagingError::NiftiDimension {
            axis: 0,
            value: dim[0],
            range: "from 1 to 7",
        })?;
    let mut sides = [1u64; 7];
    for (axis, side) in sides.iter_mut().enumerate().take(dimensions) {
        // Some writers count axes that they do not fill.
        let value = match dim[axis + 1] {
            0 if axis >= 3 => 1,
            value => value,
        };
        *side = u64::try_from(value).ok().filter(|&side| side > 0).ok_or(
            ImagingError::NiftiDimension {
                axis: axis + 1,
                value,
                range: "at least 1",
            },
        )?;
    }
    let volumes = sides[3..].iter().copied().fold(1, u64::saturating_mul);
    if volumes > 1 {
        return Err(ImagingError::NiftiSeveralVolumes { count: volumes });
    }
    let size =
        [sides[0], sides[1], sides[2]].map(|side| usize::try_from(side).unwrap_or(usize::MAX));
    if size.contains(&1) {
        return Err(ImagingError::NiftiNotAVolume { size });
    }
    Ok(size)
}

/// The offset of the voxels: after the header and the four bytes that announce extensions. Zero is the least one.
fn vox_offset(value: f64, least: u64) -> Result<u64, ImagingError> {
    if value == 0.0 {
        return Ok(least);
    }
    let whole = value == value.trunc();
    if whole && (least as f64..=MAX_VOX_OFFSET as f64).contains(&value) {
        Ok(value as u64)
    } else {
        Err(ImagingError::NiftiVoxOffset {
            value,
            least,
            most: MAX_VOX_OFFSET,
        })
    }
}

impl Scaling {
    /// A slope of zero or NaN means that intensities are not scaled.
    fn from_header(slope: f64, intercept: f64) -> Result<Self, ImagingError> {
        if slope == 0.0 || slope.is_nan() {
            return Ok(Self {
                slope: 1.0,
                intercept: 0.0,
            });
        }
        if !slope.is_finite() || !intercept.is_finite() {
            return Err(ImagingError::NiftiScaling { slope, intercept });
        }
        Ok(Self { slope, intercept })
    }

    /// Whether the scaling changes nothing.
    pub(crate) fn is_identity(self) -> bool {
        self.slope == 1.0 && self.intercept == 0.0
    }

    /// The intensity for a value.
    pub(crate) fn intensity(self, value: f64) -> f64 {
        self.slope * value + self.intercept
    }
}

/// Numbers at fixed offsets of a header, which is long enough for all of them.
struct Fields<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

/// Reads a number at a byte offset.
macro_rules! field {
    ($($number:ident)*) => {$(
        fn $number(&self, at: usize) -> $number {
            let bytes = self.bytes[at..at + size_of::<$number>()].try_into();
            let bytes = bytes.expect("as many bytes as the number has");
            match self.order {
                ByteOrder::Little => $number::from_le_bytes(bytes),
                ByteOrder::Big => $number::from_be_bytes(bytes),
            }
        }
    )*};
}

impl Fields<'_> {
    field!(i16 i32 i64 f32 f64);
}
