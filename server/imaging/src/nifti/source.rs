//! The bytes of a file, unpacked on demand.

use std::io::{self, Read};

use flate2::bufread::GzDecoder;

use crate::ImagingError;

/// The magic bytes of a gzip member (RFC 1952 §2.3.1).
pub(crate) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// The most bytes that one byte of deflate can unpack to: a match of 258 bytes takes two bits (RFC 1951 §3.2.5).
const MAX_EXPANSION: u64 = 1032;

/// The bytes of a file, plain or in any number of gzip members.
///
/// Bytes after a member that begin no further one are passed over, as gzip itself does: the checksum of the member
/// was verified, and what is missing then is missed by whoever reads.
pub(crate) enum Source<'a> {
    Plain(&'a [u8]),
    Gzip(Box<GzDecoder<&'a [u8]>>),
}

impl<'a> Source<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        if bytes.starts_with(&GZIP_MAGIC) {
            Self::Gzip(Box::new(GzDecoder::new(bytes)))
        } else {
            Self::Plain(bytes)
        }
    }

    /// Fills the buffer as far as there are bytes, and returns how many there were.
    pub(crate) fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, ImagingError> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.read(&mut buffer[filled..])? {
                0 => break,
                read => filled += read,
            }
        }
        Ok(filled)
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ImagingError> {
        let read = match self {
            Self::Plain(bytes) => bytes.read(buffer),
            Self::Gzip(stream) => loop {
                match stream.read(buffer) {
                    Ok(0) if stream.get_ref().starts_with(&GZIP_MAGIC) => {
                        **stream = GzDecoder::new(*stream.get_ref());
                    }
                    read => break read,
                }
            },
        };
        read.map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => ImagingError::GzipTruncated,
            _ => ImagingError::GzipCorrupt,
        })
    }
}

/// Rejects a header that describes more bytes than the file can contain.
pub(crate) fn check_promise(file: &[u8], promised: u64) -> Result<(), ImagingError> {
    let at_hand = file.len() as u64;
    if !file.starts_with(&GZIP_MAGIC) {
        return match promised > at_hand {
            false => Ok(()),
            true => Err(ImagingError::NiftiTruncated {
                expected: promised,
                found: at_hand,
            }),
        };
    }
    if promised > at_hand.saturating_mul(MAX_EXPANSION) {
        return Err(ImagingError::NiftiPromise {
            promised,
            packed: at_hand,
        });
    }
    Ok(())
}
