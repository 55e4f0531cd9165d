//! The files below a directory, and those in zip archives among them.
//!
//! File names are never used: not for output, and not in messages. Links are not followed.

use std::fs::File;
use std::io::{BufReader, Read, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use imaging::dicom::{DicomError, Files};
use imaging::{Format, sniff};
use zip::ZipArchive;

/// The greatest number of files of an upload, including files in archives.
const MAX_FILES: usize = 20_000;

/// The greatest depth of nested directories.
const MAX_DEPTH: usize = 16;

/// The number of bytes that identify the kind of a file.
const HEAD_BYTES: u64 = 600;

/// One of the files.
#[derive(Debug, Clone, Copy)]
enum Found {
    /// By its number in `paths`.
    Path(usize),
    /// An entry of the archive of that number.
    Entry { archive: usize, entry: usize },
}

/// Where the files are.
pub(crate) enum Place {
    /// One file, which is open, with its bytes from an offset on.
    File(File, u64),
    /// The files below a directory.
    Directory(PathBuf),
}

/// All files, for reading one by one.
pub(crate) struct FilesBelow {
    /// The only file, with the offset of its bytes.
    single: Option<(File, u64)>,
    paths: Vec<PathBuf>,
    archives: Vec<ZipArchive<BufReader<File>>>,
    places: Vec<Found>,
    /// The limit for the unpacked bytes of all files.
    limit: u64,
    /// The bytes of the files that were read for the first time.
    counted: Vec<bool>,
    bytes: u64,
}

impl FilesBelow {
    pub(crate) fn open(place: Place, limit: u64) -> Result<Self, DicomError> {
        let mut files = Self {
            single: None,
            paths: Vec::new(),
            archives: Vec::new(),
            places: Vec::new(),
            limit,
            counted: Vec::new(),
            bytes: 0,
        };
        let mut paths = Vec::new();
        match place {
            Place::File(file, start) => {
                files.single = Some((file, start));
                paths.push(PathBuf::new());
            }
            Place::Directory(directory) => collect(&directory, 0, &mut paths)?,
        }
        paths.sort();
        for path in paths {
            files.add(path)?;
        }
        files.counted = vec![false; files.places.len()];
        Ok(files)
    }

    fn add(&mut self, path: PathBuf) -> Result<(), DicomError> {
        let mut head = Vec::new();
        let mut file = self.file(&path)?;
        file.by_ref()
            .take(HEAD_BYTES)
            .read_to_end(&mut head)
            .map_err(unreadable)?;
        if sniff(&head) == Format::Zip {
            return self.add_archive(file);
        }
        self.places.push(Found::Path(self.paths.len()));
        self.paths.push(path);
        self.check_count()
    }

    /// A file, at its first byte.
    fn file(&self, path: &Path) -> Result<File, DicomError> {
        let (mut file, start) = match &self.single {
            Some((file, start)) => (file.try_clone().map_err(unreadable)?, *start),
            None => (File::open(path).map_err(unreadable)?, 0),
        };
        file.seek(SeekFrom::Start(start)).map_err(unreadable)?;
        Ok(file)
    }

    fn add_archive(&mut self, file: File) -> Result<(), DicomError> {
        // Bytes before the first entry, such as the room of a spooled file, are skipped.
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(bad_zip)?;
        let number = self.archives.len();
        for entry in 0..archive.len() {
            let file = archive.by_index_raw(entry).map_err(bad_zip)?;
            if file.encrypted() {
                return Err(DicomError::Unreadable {
                    what: "the archive is encrypted".to_owned(),
                });
            }
            if file.is_file() {
                self.places.push(Found::Entry {
                    archive: number,
                    entry,
                });
                self.check_count()?;
            }
        }
        self.archives.push(archive);
        if self.archives.len() > MAX_ARCHIVES {
            return Err(DicomError::Unreadable {
                what: format!("the upload has more than {MAX_ARCHIVES} archives"),
            });
        }
        Ok(())
    }

    fn check_count(&self) -> Result<(), DicomError> {
        if self.places.len() > MAX_FILES {
            return Err(DicomError::TooManyFiles { limit: MAX_FILES });
        }
        Ok(())
    }
}

/// The greatest number of archives; each keeps a file open.
const MAX_ARCHIVES: usize = 8;

impl Files for FilesBelow {
    fn count(&self) -> usize {
        self.places.len()
    }

    fn read(&mut self, number: usize) -> Result<Vec<u8>, DicomError> {
        let spent = if self.counted[number] { 0 } else { self.bytes };
        let left = self.limit - spent;
        let bytes = match self.places[number] {
            Found::Path(path) => {
                let file = self.file(&self.paths[path])?;
                read_at_most(file, left)
            }
            Found::Entry { archive, entry } => {
                let file = self.archives[archive].by_index(entry).map_err(bad_zip)?;
                read_at_most(file, left)
            }
        }?;
        let bytes = bytes.ok_or(DicomError::TooManyBytes { limit: self.limit })?;
        if !self.counted[number] {
            self.counted[number] = true;
            self.bytes += bytes.len() as u64;
        }
        Ok(bytes)
    }
}

/// All bytes of a DICOM file, and the first ones of any other; `None` if there are more than `limit`. Lengths in headers are
/// not trusted.
fn read_at_most(mut source: impl Read, limit: u64) -> Result<Option<Vec<u8>>, DicomError> {
    let mut bytes = Vec::new();
    let head = source.by_ref().take(HEAD_BYTES.min(limit));
    let head = { head }.read_to_end(&mut bytes);
    if head.is_ok() && sniff(&bytes) != Format::Dicom {
        return Ok(Some(bytes));
    }
    let left = limit.saturating_add(1).saturating_sub(bytes.len() as u64);
    let read = source.take(left).read_to_end(&mut bytes);
    match head.and(read) {
        Ok(_) if bytes.len() as u64 > limit => Ok(None),
        Ok(_) => Ok(Some(bytes)),
        Err(error) => Err(unreadable(error)),
    }
}

fn collect(directory: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> Result<(), DicomError> {
    if depth > MAX_DEPTH {
        return Err(DicomError::Unreadable {
            what: "the directories are nested too deeply".to_owned(),
        });
    }
    for entry in std::fs::read_dir(directory).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let kind = entry.file_type().map_err(unreadable)?;
        if kind.is_dir() {
            collect(&entry.path(), depth + 1, paths)?;
        } else if kind.is_file() {
            paths.push(entry.path());
        }
        if paths.len() > MAX_FILES {
            return Err(DicomError::TooManyFiles { limit: MAX_FILES });
        }
    }
    Ok(())
}

/// The message of the system about a file, without its name.
fn unreadable(error: std::io::Error) -> DicomError {
    DicomError::Unreadable {
        what: match error.kind() {
            std::io::ErrorKind::InvalidData | std::io::ErrorKind::InvalidInput => {
                "an entry of the archive cannot be unpacked".to_owned()
            }
            kind => kind.to_string(),
        },
    }
}

fn bad_zip(error: zip::result::ZipError) -> DicomError {
    let what = match error {
        zip::result::ZipError::UnsupportedArchive(_) => {
            "the compression of the archive is not supported; use Deflate"
        }
        _ => "the zip archive is damaged",
    };
    DicomError::Unreadable {
        what: what.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::write::{SimpleFileOptions, ZipWriter};

    use super::*;

    const PLENTY: u64 = 1 << 30;

    fn zipped(entries: &[(&str, &[u8])]) -> Vec<u8> {
        let mut writer = ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, bytes) in entries {
            let options =
                SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
            writer.start_file(*name, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }

    fn file(path: &Path, start: u64) -> Place {
        Place::File(File::open(path).unwrap(), start)
    }

    fn all(files: &mut FilesBelow) -> Vec<Vec<u8>> {
        (0..files.count())
            .map(|number| files.read(number).unwrap())
            .collect()
    }

    #[test]
    fn files_are_found_in_directories_and_archives_and_links_are_not_followed() {
        let root = tempfile::tempdir().unwrap();
        let below = root.path().join("a/b");
        std::fs::create_dir_all(&below).unwrap();
        std::fs::write(below.join("one"), b"1").unwrap();
        std::fs::write(
            root.path().join("z.zip"),
            zipped(&[("d/two", b"22"), ("d/three", b"333")]),
        )
        .unwrap();
        std::os::unix::fs::symlink("/etc/passwd", root.path().join("link")).unwrap();
        std::os::unix::fs::symlink(root.path(), root.path().join("loop")).unwrap();
        let mut files = FilesBelow::open(Place::Directory(root.path().to_owned()), PLENTY).unwrap();
        assert_eq!(
            all(&mut files),
            [b"1".to_vec(), b"22".to_vec(), b"333".to_vec()]
        );
        // A second reading counts no second time.
        assert_eq!(all(&mut files).len(), 3);
    }

    #[test]
    fn a_spooled_file_has_room_before_its_bytes() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("upload");
        let archive = zipped(&[("one", b"1"), ("two", b"22")]);
        for (bytes, expected) in [
            (&b"DICM"[..], vec![b"DICM".to_vec()]),
            (&archive[..], vec![b"1".to_vec(), b"22".to_vec()]),
        ] {
            std::fs::write(&path, [&[0; 72], bytes].concat()).unwrap();
            let mut files = FilesBelow::open(file(&path, 72), PLENTY).unwrap();
            assert_eq!(all(&mut files), expected);
        }
    }

    #[test]
    fn names_that_lead_elsewhere_are_just_names() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("upload");
        std::fs::write(&path, zipped(&[("../../../escaped", b"x"), ("/abs", b"y")])).unwrap();
        let mut files = FilesBelow::open(file(&path, 0), PLENTY).unwrap();
        assert_eq!(all(&mut files), [b"x", b"y"]);
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_bomb_is_cut_off_at_the_limit() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("upload");
        let mut large = vec![0; 32 << 20];
        large[128..132].copy_from_slice(b"DICM");
        std::fs::write(&path, zipped(&[("zeros", &large)])).unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() < 100 << 10);
        let mut files = FilesBelow::open(file(&path, 0), 1 << 20).unwrap();
        assert_eq!(
            files.read(0),
            Err(DicomError::TooManyBytes { limit: 1 << 20 })
        );
    }

    #[test]
    fn what_is_not_dicom_is_not_unpacked() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("upload");
        let zeros = vec![0; 32 << 20];
        std::fs::write(&path, zipped(&[("zeros", &zeros), ("again", &zeros)])).unwrap();
        let mut files = FilesBelow::open(file(&path, 0), 1 << 20).unwrap();
        assert_eq!(all(&mut files), [[0; HEAD_BYTES as usize]; 2]);
    }

    #[test]
    fn a_damaged_archive_is_refused() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("upload");
        let whole = zipped(&[("a", &[7; 3000])]);
        for length in [4, 40, whole.len() - 10] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(FilesBelow::open(file(&path, 0), PLENTY).is_err());
        }
    }
}
