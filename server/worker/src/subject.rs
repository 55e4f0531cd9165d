//! The folder of a FreeSurfer subject, or a zip of it: read in a process of its own.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Write as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use bytes::Bytes;
use case::{Failure, FailureKind};
use imaging::Limits;
use imaging::surface::{
    MAX_SUBJECT_LAYERS, SubjectError, SubjectLayer, SurfaceError, subject, subject_files,
    subject_folder,
};
use serde::{Deserialize, Serialize};
use storage::Spooled;
use tempfile::TempDir;
use zip::ZipArchive;

use crate::confine::{Directory, Needs, confine};
use crate::error::Error;
use crate::headers::MAX_FILE_BYTES;
use crate::memory::series_bytes;
use crate::message::{Order, Stated, SubjectOrder, VOLUME};
use crate::outcome::OUTCOME;
use crate::program::cannot_run;
use crate::reader::{SeriesReader, check_file, outcome};
use crate::reading::Input;

/// The file of the brain, in the output directory.
const MASK: &str = "mask";

/// The largest outcome: the names of labels of all layers.
const MAX_OUTCOME_BYTES: u64 = 16 << 20;

/// The most files of an archive.
const MAX_ENTRIES: usize = 20_000;

/// The longest target of a link in an archive.
const MAX_LINK_BYTES: u64 = 255;

/// The name of a file of a subject in a folder without folders.
pub fn flat_name(name: &str) -> String {
    name.replace('/', "+")
}

/// What is stated of a subject.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Found {
    has_mask: bool,
    layers: Vec<SubjectLayer>,
}

/// The folder of a subject, read.
#[derive(Debug)]
pub struct SubjectReading {
    output: TempDir,
    has_mask: bool,
    /// Its layers, without their files.
    pub layers: Vec<SubjectLayer>,
}

impl SubjectReading {
    /// The file of the volume, after [`Spooled::START`] bytes of room as in a spooled file.
    pub fn volume(&self) -> PathBuf {
        self.output.path().join(VOLUME)
    }

    /// The file of the brain, likewise, if there is one.
    pub fn mask(&self) -> Option<PathBuf> {
        self.has_mask.then(|| self.output.path().join(MASK))
    }

    /// The file of a layer, by its number, likewise.
    pub fn layer(&self, number: usize) -> PathBuf {
        self.output.path().join(layer_name(number))
    }

    /// One of these files in memory.
    ///
    /// # Errors
    /// If it cannot be read.
    pub async fn bytes(file: PathBuf) -> io::Result<Bytes> {
        let file = Bytes::from(tokio::fs::read(file).await?);
        Ok(file.slice(file.len().min(Spooled::START as usize)..))
    }
}

fn layer_name(number: usize) -> String {
    format!("layer-{number}")
}

impl SeriesReader {
    /// Reads the folder of a FreeSurfer subject, or a zip of it; `None` if it is none. `scratch` is a directory where temporary files may be.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the files; [`Error::NotRun`], logged, if the process cannot be started.
    pub async fn read_subject(
        &self,
        input: Input<'_>,
        scratch: &Path,
    ) -> Result<Option<SubjectReading>, Error> {
        let (input, is_own_input) = match input {
            Input::Path(path) => (path, false),
            Input::Directory(directory) => (directory.path(), true),
            Input::Spooled(file) => (file.path(), false),
        };
        let output = tempfile::Builder::new()
            .prefix("subject-")
            .tempdir_in(scratch)
            .map_err(cannot_run)?;
        let limits = self.limits();
        let memory_bytes = series_bytes(&limits);
        let _memory = self.memory.take(memory_bytes).await;
        let order = SubjectOrder {
            input: std::path::absolute(input).map_err(cannot_run)?,
            is_own_input,
            output: std::path::absolute(output.path()).map_err(cannot_run)?,
            room: Spooled::START,
            max_voxels: limits.max_voxels,
            memory_bytes,
            max_input_bytes: self.max_input_bytes,
            seconds: self.longest.as_secs().max(1),
        };
        let status = match self.run(&Order::Subject(order)).await {
            Err(Error::Failure(_)) => return Err(beyond_limits().into()),
            ended => ended?,
        };
        let largest = self.max_input_bytes;
        let reading = tokio::task::spawn_blocking(move || take(status, output, &limits, largest));
        Ok(reading.await.map_err(|_| Error::NotRun)??)
    }
}

/// The files of a child; `None` if it found no subject.
fn take(
    status: ExitStatus,
    output: TempDir,
    limits: &Limits,
    max_input_bytes: u64,
) -> Result<Option<SubjectReading>, Failure> {
    let found = outcome::<Option<Found>>(status, &output, ("a subject", MAX_OUTCOME_BYTES));
    let found = found.map_err(|failure| match &*failure.name {
        crate::READER_DIED => beyond_limits(),
        _ => failure,
    })?;
    let Some(Found { has_mask, layers }) = found else {
        return Ok(None);
    };
    let drawn = 8 * limits.max_voxels as u64 + (1 << 20);
    let largest = Spooled::START + drawn.max(max_input_bytes);
    let reading = SubjectReading {
        output,
        has_mask,
        layers,
    };
    let files = (0..reading.layers.len()).map(|number| reading.layer(number));
    let mut files = files.chain([reading.volume()]).chain(reading.mask());
    let is_sound = reading.layers.len() <= MAX_SUBJECT_LAYERS
        && files.all(|file| check_file(&file, largest).is_ok());
    match is_sound {
        true => Ok(Some(reading)),
        false => Err(beyond_limits()),
    }
}

fn beyond_limits() -> Failure {
    Failure::unusable(
        "subject-unreadable",
        "the folder of the subject could not be read: the process that reads it ended, because a file is damaged, or needs more time or memory than allowed",
    )
}

/// Where the files of a subject are.
enum Place {
    /// Those that are in a folder, which is the current one: their paths without links.
    Folder(HashMap<String, PathBuf>),
    /// A zip, and the folder in it.
    Zip(Box<ZipArchive<BufReader<File>>>, String),
    Elsewhere,
}

/// In the process, which has its limits: reads the files of an order, and writes those of a case.
///
/// # Errors
/// If the files cannot be opened or written.
pub(crate) fn read(order: &SubjectOrder) -> io::Result<()> {
    let create = |name: &str| File::create_new(order.output.join(name));
    let mut outcome_file = create(OUTCOME)?;
    let (volume_file, mask_file) = (create(VOLUME)?, create(MASK)?);
    let layer_files = (0..MAX_SUBJECT_LAYERS).map(|number| create(&layer_name(number)));
    let layer_files = layer_files.collect::<io::Result<Vec<_>>>()?;
    let input = File::open(&order.input)?;
    let place = match input.metadata()?.is_dir() {
        true => {
            rustix::process::fchdir(&input)?;
            let place = Place::Folder(in_folder(Path::new("."), order.is_own_input)?);
            let reads = Directory {
                directory: input.as_fd(),
                is_own: order.is_own_input,
            };
            confine(&Needs {
                reads: Some(reads),
                ..Needs::default()
            });
            Ok(place)
        }
        false => {
            confine(&Needs::default());
            in_zip(input)
        }
    };
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    let mut left = order.max_input_bytes;
    let read = place.and_then(|mut place| {
        let mut file = |name: &str| {
            place.read(name, &mut left).map_err(|error| {
                let file = name.to_owned();
                SubjectError { file, error }
            })
        };
        subject(&mut file, &limits)
    });
    let outcome = match read {
        Ok(None) => Stated::Read(None),
        Ok(Some(subject)) => {
            let write = |mut file: &File, bytes: &[u8]| {
                io::copy(&mut io::repeat(0).take(order.room), &mut file)?;
                file.write_all(bytes)
            };
            write(&volume_file, &subject.volume)?;
            if let Some(mask) = &subject.mask {
                write(&mask_file, mask)?;
            }
            for (file, layer) in layer_files.iter().zip(&subject.layers) {
                write(file, &layer.file)?;
            }
            Stated::Read(Some(Found {
                has_mask: subject.mask.is_some(),
                layers: subject.layers,
            }))
        }
        Err(error) => Stated::Refused(refusal(&error)),
    };
    outcome_file.write_all(&serde_json::to_vec(&outcome)?)
}

/// The files of a subject below a folder. FreeSurfer links some of them to others: links within the folder are followed, and one that leads
/// outward, or anything but a file, is left out.
///
/// A folder that was made for this reading has no folders: there a file has its path as its name ([`flat_name`]).
fn in_folder(folder: &Path, is_flat: bool) -> io::Result<HashMap<String, PathBuf>> {
    let folder = folder.canonicalize()?;
    let found = subject_files().filter_map(|name| {
        let file = match is_flat {
            true => folder.join(flat_name(&name)),
            false => folder.join(&name),
        };
        let file = file.canonicalize().ok()?;
        let path = file.strip_prefix(&folder).ok()?;
        file.is_file().then(|| (name, Path::new(".").join(path)))
    });
    Ok(found.collect())
}

/// The folder of the only subject in a file, if that is a zip.
fn in_zip(file: File) -> Result<Place, SubjectError> {
    // Bytes before the first entry, such as the room of a spooled file, are skipped.
    let Ok(archive) = ZipArchive::new(BufReader::new(file)) else {
        return Ok(Place::Elsewhere);
    };
    if archive.len() > MAX_ENTRIES {
        return Ok(Place::Elsewhere);
    }
    let names = archive.file_names().filter_map(Result::ok);
    let folders = names.filter_map(|name| subject_folder(&name).map(str::to_owned));
    let mut folders: Vec<String> = folders.collect();
    folders.sort_unstable();
    folders.dedup();
    match &folders[..] {
        [] => Ok(Place::Elsewhere),
        [folder] => Ok(Place::Zip(Box::new(archive), folder.clone())),
        [..] => Err(SubjectError {
            file: "the archive".to_owned(),
            error: damaged(format!(
                "it has the folders of {} subjects; send one of them",
                folders.len()
            )),
        }),
    }
}

fn damaged(what: impl Into<String>) -> SurfaceError {
    let (part, what) = ("file", what.into());
    SurfaceError::Damaged { part, what }
}

impl Place {
    /// A file by its name, whose bytes are taken from those that are left.
    fn read(&mut self, name: &str, left: &mut u64) -> Result<Option<Vec<u8>>, SurfaceError> {
        match self {
            Self::Elsewhere => Ok(None),
            Self::Folder(paths) => match paths.get(name) {
                None => Ok(None),
                Some(path) => {
                    let file =
                        File::open(path).map_err(|error| damaged(error.kind().to_string()))?;
                    all(file, left).map(Some)
                }
            },
            Self::Zip(archive, folder) => {
                let path = format!("{folder}{name}");
                if archive.index_for_name(&path).is_none() {
                    return Ok(None);
                }
                let mut file = archive.by_name(&path).map_err(|error| in_archive(&error))?;
                if !file.is_symlink() {
                    return all(file, left).map(Some);
                }
                // FreeSurfer links some files to others beside them.
                let mut target = String::new();
                let target_read = file
                    .by_ref()
                    .take(MAX_LINK_BYTES)
                    .read_to_string(&mut target);
                drop(file);
                let beside = target_read.is_ok() && !target.contains(['/', '\\']);
                let (parent, _name) = path.rsplit_once('/').unwrap_or_default();
                let target = format!("{parent}/{target}");
                if !beside || archive.index_for_name(&target).is_none() {
                    return Ok(None);
                }
                let file = archive
                    .by_name(&target)
                    .map_err(|error| in_archive(&error))?;
                match file.is_file() {
                    true => all(file, left).map(Some),
                    false => Ok(None),
                }
            }
        }
    }
}

fn in_archive(error: &zip::result::ZipError) -> SurfaceError {
    damaged(match error {
        zip::result::ZipError::UnsupportedArchive(_) => {
            "it is encrypted, or packed in a way that is not supported; use Deflate"
        }
        _ => "the zip archive is damaged",
    })
}

/// All bytes of a file. Lengths in headers are not trusted.
fn all(file: impl Read, left: &mut u64) -> Result<Vec<u8>, SurfaceError> {
    let most = MAX_FILE_BYTES.min(*left);
    let mut bytes = Vec::new();
    let read = file.take(most + 1).read_to_end(&mut bytes);
    read.map_err(|_| damaged("it cannot be unpacked"))?;
    let count = bytes.len() as u64;
    if count > most {
        let what = "bytes with those before it";
        return Err(SurfaceError::TooMany { what, count, most });
    }
    *left -= count;
    Ok(bytes)
}

fn refusal(error: &SubjectError) -> Failure {
    let kind = match error.error.is_too_large() {
        true => FailureKind::TooLarge,
        false => FailureKind::Unusable,
    };
    Failure::new(kind, error.error.kind(), error.to_string())
}
