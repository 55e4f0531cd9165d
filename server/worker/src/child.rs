//! The child process, which reads the files.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, Read, Seek as _, Write as _};
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use imaging::Limits;
use imaging::dicom::{
    self, Attributes, Converted, DicomError, Identity, convert, fingerprint, identify,
};
use rustix::process::Resource;

use crate::confine::{Directory, Instead, Needs, confine, said, set_limits};
use crate::files::{FilesBelow, Place};
use crate::headers::MAX_FILE_BYTES;
use crate::message::{HeaderOrder, Order, SeriesOrder, Stated, StoredOrder, VOLUME};
use crate::outcome::OUTCOME;
use case::{Failure, FailureKind};

/// The limit for the size of a request.
const MAX_ORDER_BYTES: u64 = 64 << 10;

/// The largest file that is written, beside the samples of the voxels.
const BASE_FILE_BYTES: u64 = 1 << 30;

/// Files open at a time: the three standard ones, those that are read and written, and some that libraries want.
const OPEN_FILES: u64 = 32;

/// Handles the request on standard input. Errors in the files are written as an outcome.
pub fn run() -> ExitCode {
    exit_code(carry_out(None))
}

/// As [`run`], with other code that runs in place of reading a series or preparing a case. The outcome is a failure with its words.
#[cfg(any(test, feature = "testing"))]
pub fn run_instead(mut code: impl FnMut(&crate::Confinement) -> String) -> ExitCode {
    exit_code(carry_out(Some(&mut code)))
}

fn exit_code(ended: io::Result<()>) -> ExitCode {
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        // Nobody reads the output of this process; its parent sees that it failed.
        Err(_) => ExitCode::FAILURE,
    }
}

fn carry_out(instead: Option<Instead<'_>>) -> io::Result<()> {
    close_inherited();
    match read_order()? {
        Order::Series(order) => read_series(&order, instead),
        Order::Header(order) => answer(&read_header(&order, header)?),
        Order::SeriesOf(order) => {
            answer(&read_header(&order, |file, _, _| dicom::series_of(file))?)
        }
        Order::Marks(order) => answer(&read_header(&order, |file, _, _| dicom::marks(file))?),
        Order::Stored(order) => read_stored(&order),
        Order::Prepare(order) => crate::prepare::prepare(&order, instead),
        Order::Surfaces(order) => {
            limit_this_process(order.memory_bytes, order.max_voxels as u64, order.seconds)?;
            crate::surface::draw(&order)
        }
        Order::Subject(order) => {
            limit_this_process(order.memory_bytes, order.max_voxels as u64, order.seconds)?;
            crate::subject::read(&order)
        }
        Order::Confine => {
            limit_this_process(1 << 30, 0, 1)?;
            answer(&confine(&Needs::default()))
        }
    }
}

/// Closes what the server has inherited from who started it, and passes on with every process. Nothing else is open yet but the
/// three standard files.
fn close_inherited() {
    let open = match cfg!(target_os = "linux") {
        true => "/proc/self/fd",
        false => "/dev/fd",
    };
    let open = std::fs::read_dir(open).into_iter().flatten();
    let numbers = open.filter_map(|file| file.ok()?.file_name().to_str()?.parse::<i32>().ok());
    // All are read first: one of them is the directory, which is closed by then.
    for number in numbers.filter(|&number| number > 2).collect::<Vec<_>>() {
        let _closed = nix::unistd::close(number);
    }
}

fn read_order() -> io::Result<Order> {
    let mut line = Vec::new();
    let orders = io::BufReader::new(io::stdin());
    orders.take(MAX_ORDER_BYTES).read_until(b'\n', &mut line)?;
    Ok(serde_json::from_slice(&line)?)
}

/// Answers on the standard output, on a line of its own.
fn answer(answer: &impl serde::Serialize) -> io::Result<()> {
    let mut line = vec![b'\n'];
    serde_json::to_writer(&mut line, answer)?;
    line.push(b'\n');
    let mut output = io::stdout().lock();
    output.write_all(&line)?;
    output.flush()
}

/// Everything is opened before this process is confined. A file needs no path any more; a directory becomes the current one,
/// because its path leads through directories that are closed by then.
fn read_series(order: &SeriesOrder, instead: Option<Instead<'_>>) -> io::Result<()> {
    limit_this_process(order.memory_bytes, order.max_voxels as u64, order.seconds)?;
    let mut outcome_file = File::create_new(order.output.join(OUTCOME))?;
    let mut volume_file = File::create_new(order.output.join(VOLUME))?;
    let input = File::open(&order.input)?;
    let (place, confinement) = match input.metadata()?.is_dir() {
        true => {
            rustix::process::fchdir(&input)?;
            let reads = Directory {
                directory: input.as_fd(),
                is_own: order.is_own_input,
            };
            let needs = Needs {
                reads: Some(reads),
                ..Needs::default()
            };
            (Place::Directory(PathBuf::from(".")), confine(&needs))
        }
        false => {
            let place = Place::File(input, order.input_start);
            (place, confine(&Needs::default()))
        }
    };
    let outcome = match instead {
        Some(code) => Stated::Refused(said(code(&confinement))),
        None => match read(order, place) {
            Ok(converted) => {
                io::copy(&mut io::repeat(0).take(order.room), &mut volume_file)?;
                volume_file.write_all(&converted.nifti)?;
                Stated::Read(converted)
            }
            Err(error) => Stated::Refused(refusal(&error)),
        },
    };
    outcome_file.write_all(&serde_json::to_vec(&outcome)?)
}

/// What `read` finds in a file, given its bytes, the room before an output, and that output.
fn read_header<T>(
    order: &HeaderOrder,
    read: impl Fn(&[u8], u64, Option<&mut File>) -> Result<T, DicomError>,
) -> io::Result<Stated<T>> {
    limit_this_process(order.memory_bytes, 0, order.seconds)?;
    let mut file = File::open(&order.file)?;
    file.seek(io::SeekFrom::Start(order.start))?;
    let mut output = match &order.output {
        Some(path) => Some(
            OpenOptions::new()
                .write(true)
                .create(true)
                .truncate(true)
                .open(path)?,
        ),
        None => None,
    };
    confine(&Needs::default());
    let found =
        read_file(file, MAX_FILE_BYTES).and_then(|file| read(&file, order.start, output.as_mut()));
    Ok(stated(found))
}

fn header(file: &[u8], room: u64, output: Option<&mut File>) -> Result<Identity, DicomError> {
    let mut identity = identify(file)?;
    let print = |file: &[u8]| match identity.is_image {
        true => fingerprint(file).ok(),
        false => None,
    };
    let Some(output) = output else {
        identity.fingerprint = print(file);
        return Ok(identity);
    };
    let without = dicom::deidentified_file(file)?;
    identity.fingerprint = print(&without);
    let written = io::copy(&mut io::repeat(0).take(room), output);
    written.map_err(unreadable)?;
    output.write_all(&without).map_err(unreadable)?;
    Ok(identity)
}

fn unreadable(error: io::Error) -> DicomError {
    DicomError::Unreadable {
        what: error.kind().to_string(),
    }
}

/// The rest of a file.
fn read_file(file: File, most: u64) -> Result<Vec<u8>, DicomError> {
    let mut bytes = Vec::new();
    let read = file.take(most + 1).read_to_end(&mut bytes);
    if read.map_err(unreadable)? as u64 > most {
        return Err(DicomError::TooManyBytes { limit: most });
    }
    Ok(bytes)
}

fn read_stored(order: &StoredOrder) -> io::Result<()> {
    limit_this_process(order.memory_bytes, 0, order.seconds)?;
    let mut outcome_file = File::create_new(order.output.join(OUTCOME))?;
    let input = File::open(&order.input)?;
    rustix::process::fchdir(&input)?;
    let reads = Directory {
        directory: input.as_fd(),
        is_own: true,
    };
    confine(&Needs {
        reads: Some(reads),
        ..Needs::default()
    });
    outcome_file.write_all(&serde_json::to_vec(&stated(attributes(order)))?)
}

/// Reads the files of the current directory.
fn attributes(order: &StoredOrder) -> Result<Vec<Attributes>, DicomError> {
    let read = |number: usize| {
        let file = File::open(Path::new(".").join(number.to_string())).map_err(unreadable)?;
        read_file(file, order.max_file_bytes)
    };
    (0..order.count)
        .map(|number| dicom::attributes(&read(number)?))
        .collect()
}

/// From here on, the kernel ends this process if it exceeds its limits.
fn limit_this_process(memory: u64, voxels: u64, seconds: u64) -> io::Result<()> {
    let file_bytes = BASE_FILE_BYTES.saturating_add(4u64.saturating_mul(voxels));
    let limits = [
        (Resource::As, memory),
        (Resource::Cpu, seconds),
        (Resource::Nofile, OPEN_FILES),
        (Resource::Fsize, file_bytes),
        // A core file would contain images of a patient.
        (Resource::Core, 0),
        (Resource::Nproc, 0),
    ];
    set_limits(&limits.map(|(resource, most)| (resource, most, most)))
}

fn read(order: &SeriesOrder, place: Place) -> Result<Converted, DicomError> {
    let mut files = FilesBelow::open(place, order.max_input_bytes)?;
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    convert(&mut files, &order.options, &limits)
}

fn stated<T>(found: Result<T, DicomError>) -> Stated<T> {
    found.map_or_else(|error| Stated::Refused(refusal(&error)), Stated::Read)
}

fn refusal(error: &DicomError) -> Failure {
    let kind = match error {
        DicomError::NoDicom { .. } => FailureKind::NotRecognised,
        DicomError::OutOfMemory { .. } => FailureKind::OutOfMemory,
        error if error.is_too_large() => FailureKind::TooLarge,
        _ => FailureKind::Unusable,
    };
    Failure::new(kind, error.kind(), error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[ignore = "it is started by the test below, for its limits last as long as its process"]
    fn limited() {
        limit_this_process(1 << 30, 1000, 60).unwrap();
        let mut hog: Vec<u8> = Vec::new();
        assert!(hog.try_reserve_exact(2 << 30).is_err());
        let open: Vec<_> = (0..OPEN_FILES)
            .map(|_| std::fs::File::open("/dev/null"))
            .collect();
        assert!(open.iter().any(Result::is_err));
    }

    #[test]
    fn the_kernel_limits_memory_and_files() {
        let status = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child::tests::limited", "--ignored"])
            .stdout(std::process::Stdio::null())
            .status();
        assert!(status.unwrap().success());
    }
}
