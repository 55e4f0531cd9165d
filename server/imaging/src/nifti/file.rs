//! A file with a checked header, and the bytes of its voxels in chunks.

use geometry::Grid;

use crate::sniff::recognised;
use crate::{ImagingError, Limits};

use super::affine::Form;
use super::header::Header;
use super::mgh;
use super::source::{Source, check_promise};
use super::start::{LONGEST_HEADER, MGH_HEADER, header_length};

/// Bytes of a chunk: a whole number of voxels of any type, small enough for the cache.
const CHUNK_BYTES: usize = 256 << 10;

/// More than the footer of an MGH file has: parameters of the sequence, names of labels, and the commands that made the file.
const MOST_OF_A_FOOTER: u64 = 16 << 20;

/// An opened file: its checked header, and its source of bytes.
pub(crate) struct NiftiFile<'a> {
    pub(crate) header: Header,
    /// The bytes of the header, or of one of NIfTI that says the same.
    pub(crate) header_bytes: Vec<u8>,
    pub(crate) grid: Grid,
    /// Whether the header does not state the axes, and FreeSurfer's default is used.
    pub(crate) are_axes_assumed: bool,
    source: Source<'a>,
    /// Fewer bytes may follow the voxels.
    most_following: u64,
    /// Bytes read from the source.
    taken: u64,
}

impl<'a> NiftiFile<'a> {
    /// Reads and checks the header, and checks that the bytes can contain what it describes. Allocates nothing that
    /// depends on it.
    pub(crate) fn open(bytes: &'a [u8], limits: &Limits) -> Result<Self, ImagingError> {
        let file = Self::open_header(bytes, limits)?;
        check_promise(bytes, file.header.file_bytes())?;
        Ok(file)
    }

    /// As [`NiftiFile::open`], with one of the two forms of the header alone.
    pub(crate) fn open_keeping(
        bytes: &'a [u8],
        form: Form,
        limits: &Limits,
    ) -> Result<Self, ImagingError> {
        let file = Self::open_header_with(bytes, Some(form), limits)?;
        check_promise(bytes, file.header.file_bytes())?;
        Ok(file)
    }

    /// Reads and checks the header; `bytes` may end anywhere after it.
    pub(crate) fn open_header(bytes: &'a [u8], limits: &Limits) -> Result<Self, ImagingError> {
        Self::open_header_with(bytes, None, limits)
    }

    fn open_header_with(
        bytes: &'a [u8],
        form: Option<Form>,
        limits: &Limits,
    ) -> Result<Self, ImagingError> {
        let mut source = Source::new(bytes);
        let mut buffer = [0; LONGEST_HEADER];
        let (start, rest) = buffer.split_at_mut(4);
        let started = source.fill(start)?;
        let length = header_length(&start[..started]).ok_or_else(|| ImagingError::NotNifti {
            found: recognised(bytes),
        })?;
        let followed = source.fill(&mut rest[..length - 4])?;
        if followed < length - 4 {
            return Err(ImagingError::NiftiTruncated {
                expected: length as u64,
                found: (4 + followed) as u64,
            });
        }
        let mut header_bytes = buffer[..length].to_vec();
        let is_mgh = length == MGH_HEADER;
        let are_axes_assumed = is_mgh && mgh::assumes_axes(&header_bytes);
        if is_mgh {
            header_bytes = mgh::as_nifti(&header_bytes)?;
        }
        let mut header = Header::parse(&header_bytes)?;
        if is_mgh {
            header.vox_offset = MGH_HEADER as u64;
        }
        if let Some(form) = form {
            if are_axes_assumed {
                return Err(ImagingError::NiftiFormMissing { form: form.name() });
            }
            header.placement = header.placement.keeping(form)?;
        }
        check_limits(&header, limits)?;
        let grid = Grid::new(header.size, header.placement.patient_from_voxel()?)?;
        Ok(Self {
            most_following: match is_mgh {
                true => MOST_OF_A_FOOTER,
                false => header.voxel_bytes() / header.size[2] as u64,
            },
            header,
            header_bytes,
            grid,
            are_axes_assumed,
            source,
            taken: length as u64,
        })
    }

    /// Passes the bytes of all voxels to `take`, a whole number of voxels at a time, and checks that less than a slice,
    /// or the footer of an MGH file, follows them.
    ///
    /// # Errors
    /// If the file is too short or too long, or its checksum is wrong; and the errors of `take`.
    pub(crate) fn for_each_chunk(
        &mut self,
        mut take: impl FnMut(&[u8]) -> Result<(), ImagingError>,
    ) -> Result<(), ImagingError> {
        let mut buffer = vec![0; CHUNK_BYTES];
        while self.taken < self.header.vox_offset {
            let gap = self.header.vox_offset - self.taken;
            self.fill(&mut buffer, gap)?;
        }
        let end = self.header.file_bytes();
        while self.taken < end {
            let chunk = self.fill(&mut buffer, end - self.taken)?;
            take(chunk)?;
        }
        self.expect_end()
    }

    /// The next `wanted` bytes, or as many as the buffer holds.
    fn fill<'b>(&mut self, buffer: &'b mut [u8], wanted: u64) -> Result<&'b [u8], ImagingError> {
        let length = usize::try_from(wanted)
            .unwrap_or(usize::MAX)
            .min(buffer.len());
        let chunk = &mut buffer[..length];
        let filled = self.source.fill(chunk)?;
        self.taken += filled as u64;
        if filled < length {
            return Err(ImagingError::NiftiTruncated {
                expected: self.header.file_bytes(),
                found: self.taken,
            });
        }
        Ok(chunk)
    }

    /// Some writers fill the last block of a file; what is as long as a slice may be voxels, and the header wrong. MGH has a footer.
    ///
    /// Reading past the end is what makes the decoder verify the last checksum.
    fn expect_end(&mut self) -> Result<(), ImagingError> {
        let mut buffer = [0; 4096];
        let mut following = 0;
        while following < self.most_following {
            match self.source.fill(&mut buffer)? {
                0 => return Ok(()),
                more => following += more as u64,
            }
        }
        Err(ImagingError::NiftiTrailingData {
            expected: self.header.file_bytes(),
        })
    }

    /// Memory for one value per voxel.
    pub(crate) fn room(&self) -> Room {
        Room {
            voxels: self.grid.voxel_count(),
        }
    }
}

/// Grows a list of one value per voxel as the values arrive, and never beyond the last voxel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    voxels: usize,
}

impl Room {
    /// Reserves memory for `incoming` more values, at least doubling the capacity.
    pub(crate) fn reserve<T>(
        self,
        values: &mut Vec<T>,
        incoming: usize,
    ) -> Result<(), ImagingError> {
        if values.capacity() - values.len() >= incoming {
            return Ok(());
        }
        let missing = self.voxels - values.len();
        reserve_exact(values, missing.min(incoming.max(values.len())))
    }
}

/// Reserves memory for `additional` values, or returns an error.
pub(crate) fn reserve_exact<T>(values: &mut Vec<T>, additional: usize) -> Result<(), ImagingError> {
    let bytes = (additional as u64).saturating_mul(size_of::<T>() as u64);
    values
        .try_reserve_exact(additional)
        .map_err(|_| ImagingError::OutOfMemory { bytes })
}

fn check_limits(header: &Header, limits: &Limits) -> Result<(), ImagingError> {
    let voxels = header.voxel_count();
    let limit = limits.max_voxels.min(geometry::MAX_VOXELS) as u64;
    if voxels > limit {
        return Err(ImagingError::TooManyVoxels { voxels, limit });
    }
    let bytes = header.voxel_bytes();
    if bytes > limits.max_bytes {
        return Err(ImagingError::TooManyBytes {
            bytes,
            limit: limits.max_bytes,
        });
    }
    Ok(())
}
