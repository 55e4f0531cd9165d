//! Recognises the kind of a file by its content.

use std::io::Read;

use flate2::bufread::GzDecoder;

use crate::nifti;

/// A kind of file, recognised by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A NIfTI header of a single file or a pair, or an Analyze header.
    Nifti,
    /// A gzip stream that contains a NIfTI header, or that is too damaged to tell.
    NiftiGz,
    /// A zip archive.
    Zip,
    /// DICOM, with or without the preamble of Part 10.
    Dicom,
    /// Something else.
    Unknown,
}

impl Format {
    /// Whether the file may contain DICOM: a DICOM file or a zip archive.
    pub fn may_be_dicom(self) -> bool {
        matches!(self, Self::Zip | Self::Dicom)
    }
}

/// The number of bytes at the start of a file that identify its kind and contain the size of its volume, gzipped or
/// not.
pub const START_BYTES: u64 = 64 << 10;

/// The kind of a file that starts with `bytes`: its first [`START_BYTES`], or fewer. The reader checks the rest.
pub fn sniff(bytes: &[u8]) -> Format {
    if bytes.starts_with(&nifti::GZIP_MAGIC) {
        sniff_gzip(bytes)
    } else if nifti::looks_like_header(bytes) {
        Format::Nifti
    } else if is_zip(bytes) {
        Format::Zip
    } else if is_dicom(bytes) {
        Format::Dicom
    } else {
        Format::Unknown
    }
}

/// A gzip stream of anything but NIfTI is unknown. If it cannot be unpacked, it counts as NIfTI, so that the reader
/// reports why.
fn sniff_gzip(bytes: &[u8]) -> Format {
    let mut header = [0; nifti::LONGEST_HEADER];
    let mut filled = 0;
    let mut stream = GzDecoder::new(bytes);
    while filled < header.len() {
        match stream.read(&mut header[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(_) => return Format::NiftiGz,
        }
    }
    if nifti::looks_like_header(&header[..filled]) {
        Format::NiftiGz
    } else {
        Format::Unknown
    }
}

/// A local file header, an empty archive, or the first part of a split one.
fn is_zip(bytes: &[u8]) -> bool {
    [b"PK\x03\x04", b"PK\x05\x06", b"PK\x07\x08"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// The magic word after the preamble (DICOM PS3.10 §7.1), or a first element of group 2 or 8.
fn is_dicom(bytes: &[u8]) -> bool {
    let magic = bytes.get(128..132) == Some(b"DICM");
    magic || is_dicom_without_preamble(bytes)
}

/// A little-endian element (0002,00xx) or (0008,00xx), followed by a value representation or a small length.
fn is_dicom_without_preamble(bytes: &[u8]) -> bool {
    let &[group, 0, _, 0, first, second, third, fourth, ..] = bytes else {
        return false;
    };
    let explicit = first.is_ascii_uppercase() && second.is_ascii_uppercase();
    let implicit = first > 0 && first.is_multiple_of(2) && [second, third, fourth] == [0; 3];
    matches!(group, 2 | 8) && (explicit || implicit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archives_and_dicom_are_told_by_their_magic_words() {
        assert_eq!(sniff(b"PK\x03\x04rest"), Format::Zip);
        assert_eq!(sniff(b"PK\x05\x06"), Format::Zip);
        let mut dicom = vec![0; 128];
        dicom.extend_from_slice(b"DICM");
        assert_eq!(sniff(&dicom), Format::Dicom);
    }

    #[test]
    fn dicom_without_a_preamble_is_told_by_its_first_element() {
        assert_eq!(
            sniff(b"\x08\x00\x05\x00CS\x0a\x00ISO_IR 100"),
            Format::Dicom
        );
        assert_eq!(
            sniff(b"\x08\x00\x05\x00\x0a\x00\x00\x00ISO_IR 100"),
            Format::Dicom
        );
        assert_eq!(sniff(b"\x08\x00\x05\x00\x00\x00\x00\x00"), Format::Unknown);
    }

    #[test]
    fn anything_else_is_unknown() {
        for bytes in [
            &b""[..],
            b"\x1f",
            b"<html>",
            b"\x89PNG\r\n\x1a\n",
            &[0; 600],
        ] {
            assert_eq!(sniff(bytes), Format::Unknown, "{bytes:?}");
        }
    }
}
