//! The data types of voxels.

use crate::ImagingError;

/// A supported data type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DataType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl DataType {
    /// The type for a `datatype` code; its size must match `bitpix`.
    pub(crate) fn from_header(code: i16, bitpix: i16) -> Result<Self, ImagingError> {
        let data_type = Self::from_code(code)?;
        let expected = 8 * data_type.bytes() as i16;
        if bitpix != expected {
            return Err(ImagingError::NiftiBitpix {
                bitpix,
                name: data_type.name(),
                expected,
            });
        }
        Ok(data_type)
    }

    fn from_code(code: i16) -> Result<Self, ImagingError> {
        Ok(match code {
            2 => Self::U8,
            4 => Self::I16,
            8 => Self::I32,
            16 => Self::F32,
            64 => Self::F64,
            256 => Self::I8,
            512 => Self::U16,
            768 => Self::U32,
            1024 => Self::I64,
            1280 => Self::U64,
            _ => {
                let name = unreadable_name(code);
                return Err(ImagingError::NiftiDataType { code, name });
            }
        })
    }

    /// Bytes of a voxel.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// The name of an unsupported data type in the standard.
fn unreadable_name(code: i16) -> &'static str {
    match code {
        1 => "binary, 1 bit",
        32 => "complex64",
        128 => "RGB24",
        1536 => "float128",
        1792 => "complex128",
        2048 => "complex256",
        2304 => "RGBA32",
        _ => "unknown",
    }
}
