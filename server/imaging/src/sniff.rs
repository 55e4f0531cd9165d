//! Recognises the kind of a file by its content.

use std::io::Read;

use flate2::bufread::GzDecoder;

use crate::nifti;

/// A kind of file, recognised by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A NIfTI header of a single file or a pair, an Analyze header, or an MGH header.
    Nifti,
    /// A gzip stream that contains such a header, or that is too damaged to tell.
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
    // A preamble may contain anything (DICOM PS3.10 §7.1), even the first bytes of another format.
    if dicom_start(bytes) > Some(0) {
        Format::Dicom
    } else if bytes.starts_with(&nifti::GZIP_MAGIC) {
        sniff_gzip(bytes)
    } else if nifti::looks_like_header(bytes) {
        Format::Nifti
    } else if is_zip(bytes) {
        Format::Zip
    } else if dicom_start(bytes).is_some() {
        Format::Dicom
    } else {
        Format::Unknown
    }
}

/// Formats that nothing here reads, by their first bytes.
const OTHERS: [(&[u8], &str); 16] = [
    (b"\xfd7zXZ\0", "an xz archive"),
    (b"BZh", "a bzip2 archive"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!", "a RAR archive"),
    (b"NRRD", "an NRRD image"),
    (b"CDF\x01", "a MINC 1 image"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 or MINC 2 file"),
    (b"ObjectType", "a MetaImage header"),
    (
        b"version https://git-lfs",
        "a Git LFS pointer, not the file itself",
    ),
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"%PDF", "a PDF document"),
    (b"{", "a JSON text"),
    (b"<", "an HTML or XML text"),
    (b"II*\0", "a TIFF picture"),
];

/// What a file is that is not the expected one, as far as its first bytes tell.
pub(crate) fn recognised(bytes: &[u8]) -> &'static str {
    if bytes.is_empty() {
        return "an empty file";
    }
    if bytes.starts_with(&nifti::GZIP_MAGIC) {
        let (inner, _) = unpacked_start(bytes);
        return match sniff(&inner) {
            Format::Nifti => "a gzipped NIfTI or MGH file",
            Format::Dicom => "gzipped DICOM, which must be unpacked",
            Format::Zip => "a gzipped zip archive, which must be unpacked",
            Format::NiftiGz | Format::Unknown if inner.starts_with(&nifti::GZIP_MAGIC) => {
                "a file that is gzipped twice"
            }
            _ if inner.get(257..262) == Some(b"ustar") => "a gzipped tar archive",
            _ => "a gzip file of something else",
        };
    }
    match sniff(bytes) {
        Format::Nifti => "a NIfTI or MGH file",
        Format::Zip => "a zip archive",
        Format::Dicom => "a DICOM file",
        _ if bytes.get(257..262) == Some(b"ustar") => "a tar archive",
        _ => {
            let known = OTHERS.iter().find(|(magic, _)| bytes.starts_with(magic));
            known.map_or("a file of an unknown kind", |&(_, name)| name)
        }
    }
}

/// A gzip stream of anything but NIfTI or MGH is unknown. If it cannot be unpacked, it counts as NIfTI, so that the reader
/// reports why.
fn sniff_gzip(bytes: &[u8]) -> Format {
    let (start, is_sound) = unpacked_start(bytes);
    if !is_sound || nifti::looks_like_header(&start) {
        Format::NiftiGz
    } else {
        Format::Unknown
    }
}

/// As many bytes of a gzip stream as identify its content, and whether they could be unpacked.
fn unpacked_start(bytes: &[u8]) -> (Vec<u8>, bool) {
    let mut start = Vec::new();
    let stream = GzDecoder::new(bytes).take(nifti::LONGEST_HEADER as u64);
    let is_sound = { stream }.read_to_end(&mut start).is_ok();
    (start, is_sound)
}

/// A local file header, an empty archive, or the first part of a split one.
fn is_zip(bytes: &[u8]) -> bool {
    [b"PK\x03\x04", b"PK\x05\x06", b"PK\x07\x08"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// Where the elements of a DICOM file begin; `None` if it is none.
///
/// That is after the preamble and the magic word (PS3.10 §7.1); some writers omit the preamble, the magic word or both. A data set
/// that happens to have the magic word at its place begins at 0.
pub(crate) fn dicom_start(bytes: &[u8]) -> Option<usize> {
    let is_element = |at: usize| bytes.get(at..).is_some_and(is_first_element);
    if bytes.get(128..132) == Some(b"DICM") {
        let is_bare = !is_element(132) && is_element(0);
        return Some(if is_bare { 0 } else { 132 });
    }
    if bytes.starts_with(b"DICM") && is_element(4) {
        return Some(4);
    }
    let is_preamble = |bytes: &[u8]| bytes.iter().all(|&byte| byte == 0);
    if bytes.get(..128).is_some_and(is_preamble) && is_element(128) {
        return Some(128);
    }
    is_element(0).then_some(0)
}

/// A little-endian element (0002,00xx) or (0008,00xx), followed by a value representation or a small length.
fn is_first_element(bytes: &[u8]) -> bool {
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
    fn what_is_not_read_is_named() {
        let mut tar = vec![0; 600];
        tar[257..262].copy_from_slice(b"ustar");
        let packed = |bytes: &[u8]| {
            use std::io::Write as _;
            let fast = flate2::Compression::fast();
            let mut packed = flate2::write::GzEncoder::new(Vec::new(), fast);
            packed.write_all(bytes).unwrap();
            packed.finish().unwrap()
        };
        let dicom = [&[0; 128][..], b"DICM\x02\0\x10\0UI\0\0"].concat();
        for (bytes, name) in [
            (vec![], "an empty file"),
            (b"NRRD0004\n".to_vec(), "an NRRD image"),
            (b"\xfd7zXZ\0".to_vec(), "an xz archive"),
            (b"BZh9".to_vec(), "a bzip2 archive"),
            (b"\x28\xb5\x2f\xfd".to_vec(), "a Zstandard archive"),
            (
                b"version https://git-lfs.github.com".to_vec(),
                "a Git LFS pointer, not the file itself",
            ),
            (b"{\"a\": 1}".to_vec(), "a JSON text"),
            (b"CDF\x01".to_vec(), "a MINC 1 image"),
            (b"PK\x03\x04".to_vec(), "a zip archive"),
            (tar.clone(), "a tar archive"),
            (packed(&tar), "a gzipped tar archive"),
            (packed(&dicom), "gzipped DICOM, which must be unpacked"),
            (packed(&packed(b"anything")), "a file that is gzipped twice"),
            (b"anything".to_vec(), "a file of an unknown kind"),
        ] {
            assert_eq!(recognised(&bytes), name);
        }
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
