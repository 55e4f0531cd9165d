//! Files built field by field, right or wrong.

use std::io::Read;

use flate2::Compression;
use flate2::bufread::GzEncoder;
use geometry::Volume;
use imaging::{ImagingError, Limits, nifti};

pub(crate) const U8: i16 = 2;
pub(crate) const I16: i16 = 4;
pub(crate) const I32: i16 = 8;
pub(crate) const F32: i16 = 16;
pub(crate) const F64: i16 = 64;
pub(crate) const I8: i16 = 256;
pub(crate) const U16: i16 = 512;
pub(crate) const U32: i16 = 768;
pub(crate) const I64: i16 = 1024;
pub(crate) const U64: i16 = 1280;

/// The data types that are read.
pub(crate) const DATA_TYPES: [i16; 10] = [U8, I16, I32, F32, F64, I8, U16, U32, I64, U64];

/// What a file says; the default is sound: 2×3×4 voxels of `uint8`, 0 to 23, in RAS.
#[derive(Debug, Clone)]
pub(crate) struct Nifti {
    pub(crate) version: u8,
    pub(crate) big_endian: bool,
    pub(crate) sizeof_hdr: Option<i32>,
    pub(crate) magic: Option<[u8; 4]>,
    pub(crate) dim: [i64; 8],
    pub(crate) datatype: i16,
    pub(crate) bitpix: Option<i16>,
    pub(crate) pixdim: [f64; 8],
    pub(crate) vox_offset: Option<f64>,
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
    pub(crate) units: u8,
    pub(crate) qform_code: i16,
    pub(crate) sform_code: i16,
    pub(crate) quaternion: [f64; 3],
    pub(crate) qoffset: [f64; 3],
    pub(crate) srow: [[f64; 4]; 3],
    pub(crate) data: Vec<u8>,
}

impl Default for Nifti {
    fn default() -> Self {
        Self {
            version: 1,
            big_endian: false,
            sizeof_hdr: None,
            magic: None,
            dim: [3, 2, 3, 4, 1, 1, 1, 1],
            datatype: U8,
            bitpix: None,
            pixdim: [1.0; 8],
            vox_offset: None,
            slope: 1.0,
            intercept: 0.0,
            units: 2,
            qform_code: 0,
            sform_code: 1,
            quaternion: [0.0; 3],
            qoffset: [0.0; 3],
            srow: [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
            ],
            data: (0..24).collect(),
        }
    }
}

impl Nifti {
    /// A sound file of 2×3×4 voxels of a type, in a version and byte order.
    pub(crate) fn of(datatype: i16, values: &[f64], version: u8, big_endian: bool) -> Self {
        let data = values
            .iter()
            .flat_map(|&value| encode(datatype, value, big_endian))
            .collect();
        Self {
            version,
            big_endian,
            datatype,
            data,
            ..Self::default()
        }
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let header = if self.version == 1 {
            self.nifti_1()
        } else {
            self.nifti_2()
        };
        [header, self.data.clone()].concat()
    }

    pub(crate) fn packed(&self) -> Vec<u8> {
        pack(&self.bytes())
    }

    pub(crate) fn read(&self) -> Result<Volume, ImagingError> {
        nifti::read_volume(&self.bytes(), &Limits::default())
    }

    fn nifti_1(&self) -> Vec<u8> {
        let mut header = Writer::new(352, self.big_endian);
        header.i32(0, self.sizeof_hdr.unwrap_or(348));
        (0..8).for_each(|i| header.i16(40 + 2 * i, self.dim[i] as i16));
        header.i16(70, self.datatype);
        header.i16(72, self.bitpix());
        (0..8).for_each(|i| header.f32(76 + 4 * i, self.pixdim[i]));
        header.f32(108, self.vox_offset.unwrap_or(352.0));
        header.f32(112, self.slope);
        header.f32(116, self.intercept);
        header.bytes[123] = self.units;
        header.i16(252, self.qform_code);
        header.i16(254, self.sform_code);
        (0..3).for_each(|i| header.f32(256 + 4 * i, self.quaternion[i]));
        (0..3).for_each(|i| header.f32(268 + 4 * i, self.qoffset[i]));
        (0..12).for_each(|i| header.f32(280 + 4 * i, self.srow[i / 4][i % 4]));
        header.put(344, &self.magic.unwrap_or(*b"n+1\0"));
        header.bytes
    }

    fn nifti_2(&self) -> Vec<u8> {
        let mut header = Writer::new(544, self.big_endian);
        header.i32(0, self.sizeof_hdr.unwrap_or(540));
        header.put(4, &self.magic.unwrap_or(*b"n+2\0"));
        header.put(8, b"\r\n\x1a\n");
        header.i16(12, self.datatype);
        header.i16(14, self.bitpix());
        (0..8).for_each(|i| header.i64(16 + 8 * i, self.dim[i]));
        (0..8).for_each(|i| header.f64(104 + 8 * i, self.pixdim[i]));
        header.i64(168, self.vox_offset.unwrap_or(544.0) as i64);
        header.f64(176, self.slope);
        header.f64(184, self.intercept);
        header.i32(344, self.qform_code.into());
        header.i32(348, self.sform_code.into());
        (0..3).for_each(|i| header.f64(352 + 8 * i, self.quaternion[i]));
        (0..3).for_each(|i| header.f64(376 + 8 * i, self.qoffset[i]));
        (0..12).for_each(|i| header.f64(400 + 8 * i, self.srow[i / 4][i % 4]));
        header.i32(500, self.units.into());
        header.bytes
    }

    fn bitpix(&self) -> i16 {
        let size = match self.datatype {
            U8 | I8 => 8,
            U16 | I16 => 16,
            U32 | I32 | F32 => 32,
            _ => 64,
        };
        self.bitpix.unwrap_or(size)
    }
}

/// A number in the bytes of a data type.
pub(crate) fn encode(datatype: i16, value: f64, big_endian: bool) -> Vec<u8> {
    let mut bytes = match datatype {
        U8 => (value as u8).to_le_bytes().to_vec(),
        I8 => (value as i8).to_le_bytes().to_vec(),
        U16 => (value as u16).to_le_bytes().to_vec(),
        I16 => (value as i16).to_le_bytes().to_vec(),
        U32 => (value as u32).to_le_bytes().to_vec(),
        I32 => (value as i32).to_le_bytes().to_vec(),
        U64 => (value as u64).to_le_bytes().to_vec(),
        I64 => (value as i64).to_le_bytes().to_vec(),
        F32 => (value as f32).to_le_bytes().to_vec(),
        F64 => value.to_le_bytes().to_vec(),
        _ => panic!("no such type: {datatype}"),
    };
    if big_endian {
        bytes.reverse();
    }
    bytes
}

pub(crate) fn pack(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    GzEncoder::new(bytes, Compression::default())
        .read_to_end(&mut packed)
        .expect("reading from memory");
    packed
}

/// All intensities of a volume.
pub(crate) fn intensities(volume: &Volume) -> Vec<f64> {
    let stored = volume.voxels().iter();
    stored
        .map(|&stored| volume.intensity(stored.into()).into())
        .collect()
}

struct Writer {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Writer {
    fn new(length: usize, big_endian: bool) -> Self {
        Self {
            bytes: vec![0; length],
            big_endian,
        }
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn put_number(&mut self, at: usize, mut little_endian: Vec<u8>) {
        if self.big_endian {
            little_endian.reverse();
        }
        self.put(at, &little_endian);
    }

    fn i16(&mut self, at: usize, value: i16) {
        self.put_number(at, value.to_le_bytes().to_vec());
    }

    fn i32(&mut self, at: usize, value: i32) {
        self.put_number(at, value.to_le_bytes().to_vec());
    }

    fn i64(&mut self, at: usize, value: i64) {
        self.put_number(at, value.to_le_bytes().to_vec());
    }

    fn f32(&mut self, at: usize, value: f64) {
        self.put_number(at, (value as f32).to_le_bytes().to_vec());
    }

    fn f64(&mut self, at: usize, value: f64) {
        self.put_number(at, value.to_le_bytes().to_vec());
    }
}
