//! The child process, which reads the files.

use std::io::{self, BufRead as _, Read, Seek as _, Write as _};
use std::path::Path;
use std::process::ExitCode;

use imaging::Limits;
use imaging::dicom::{self, DicomError, Identity, Options, Purpose, SeriesName, convert, identify};
use rustix::process::{Resource, Rlimit, Signal, setrlimit};

use super::files::FilesBelow;
use super::message::{
    FileOrder, HeadersOrder, OUTCOME, Order, Outcome, SeriesOrder, Stated, StoredOrder,
    StoredOutcome, StoredTask, Summary, VOLUME,
};
use case::{Failure, FailureKind};

/// The limit for the size of a request.
const MAX_ORDER_BYTES: u64 = 64 << 10;

/// Memory for the program itself, one file and one picture.
const BASE_BYTES: u64 = 1 << 30;

/// Memory for each voxel: its sample in single precision while slices are collected, and its result.
const BYTES_PER_VOXEL: u64 = 8;

/// Files open at a time: the three standard ones, one that is read, one that is written, and some that libraries want.
const OPEN_FILES: u64 = 32;

/// Handles the request on standard input. Errors in the files are written as an outcome.
pub fn run() -> ExitCode {
    match carry_out() {
        Ok(()) => ExitCode::SUCCESS,
        // Nobody reads the output of this process; its parent sees that it failed.
        Err(_) => ExitCode::FAILURE,
    }
}

fn carry_out() -> io::Result<()> {
    let mut orders = io::BufReader::new(io::stdin());
    match read_order(&mut orders)? {
        Some(Order::Series(order)) => read_series(&order),
        Some(Order::Headers(order)) => read_headers(&order, &mut orders),
        Some(Order::Stored(order)) => read_stored(&order),
        None => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

/// The next order; `None` at the end of the input.
fn read_order<T: serde::de::DeserializeOwned>(
    orders: &mut impl io::BufRead,
) -> io::Result<Option<T>> {
    let mut line = Vec::new();
    let read = orders.take(MAX_ORDER_BYTES).read_until(b'\n', &mut line)?;
    Ok((read > 0)
        .then(|| serde_json::from_slice(&line))
        .transpose()?)
}

fn read_series(order: &SeriesOrder) -> io::Result<()> {
    limit_this_process(order.max_voxels as u64, order.seconds)?;
    let outcome = match read(order) {
        Ok((volume, summary)) => {
            write_volume(order, &volume)?;
            Outcome::Read(summary)
        }
        Err(error) => Outcome::Refused(refusal(&error)),
    };
    std::fs::write(order.output.join(OUTCOME), serde_json::to_vec(&outcome)?)
}

/// Answers until the parent closes the input.
fn read_headers(order: &HeadersOrder, orders: &mut impl io::BufRead) -> io::Result<()> {
    limit_this_process(0, order.seconds)?;
    while let Some(file) = read_order::<FileOrder>(orders)? {
        let stated = match read_header(&file, order.max_file_bytes) {
            Ok(identity) => Stated::Read(identity),
            Err(error) => Stated::Refused(refusal(&error)),
        };
        let mut answer = vec![b'\n'];
        serde_json::to_writer(&mut answer, &stated)?;
        answer.push(b'\n');
        let mut output = io::stdout().lock();
        output.write_all(&answer)?;
        output.flush()?;
    }
    Ok(())
}

fn read_header(order: &FileOrder, most: u64) -> Result<Identity, DicomError> {
    let file = read_file(&order.file, order.start, most)?;
    let identity = identify(&file)?;
    if let Some(output) = &order.output {
        let room = usize::try_from(order.start).unwrap_or(0);
        let without = dicom::deidentified_file(&file)?;
        let written = [vec![0; room], without].concat();
        std::fs::write(output, written).map_err(unreadable)?;
    }
    Ok(identity)
}

fn unreadable(error: io::Error) -> DicomError {
    DicomError::Unreadable {
        what: error.kind().to_string(),
    }
}

fn read_file(path: &Path, start: u64, most: u64) -> Result<Vec<u8>, DicomError> {
    let mut file = std::fs::File::open(path).map_err(unreadable)?;
    file.seek(io::SeekFrom::Start(start)).map_err(unreadable)?;
    let mut bytes = Vec::new();
    let read = file.take(most + 1).read_to_end(&mut bytes);
    if read.map_err(unreadable)? as u64 > most {
        return Err(DicomError::TooManyBytes { limit: most });
    }
    Ok(bytes)
}

fn read_stored(order: &StoredOrder) -> io::Result<()> {
    limit_this_process(0, order.seconds)?;
    let outcome = match stored(order) {
        Ok(outcome) => outcome,
        Err(error) => StoredOutcome::Refused(refusal(&error)),
    };
    std::fs::write(order.output.join(OUTCOME), serde_json::to_vec(&outcome)?)
}

fn stored(order: &StoredOrder) -> Result<StoredOutcome, DicomError> {
    let read = |number: usize| {
        let path = order.input.join(number.to_string());
        read_file(&path, 0, order.max_file_bytes)
    };
    let write = |number: usize, bytes: &[u8]| {
        std::fs::write(order.output.join(number.to_string()), bytes).map_err(unreadable)
    };
    match &order.task {
        StoredTask::Metadata => {
            let each = (0..order.count).map(|number| dicom::metadata(&read(number)?));
            Ok(StoredOutcome::Metadata(each.collect::<Result<_, _>>()?))
        }
        StoredTask::Files(accepted) => {
            let each = (0..order.count).map(|number| {
                let file = read(number)?;
                let is_accepted = |syntax: &String| {
                    let mut accepted = accepted.iter();
                    accepted.any(|accepted| accepted == "*" || accepted == syntax)
                };
                let syntax = dicom::stored_syntax(&file)?.filter(is_accepted);
                if syntax.is_none() {
                    write(number, &dicom::explicit_file(&file)?)?;
                }
                Ok(syntax)
            });
            Ok(StoredOutcome::Files(
                each.collect::<Result<_, DicomError>>()?,
            ))
        }
        StoredTask::Compare => {
            let difference = dicom::difference(&read(0)?, &read(1)?)?;
            Ok(StoredOutcome::Compared(difference))
        }
        StoredTask::Frames(numbers) => {
            let frames = dicom::frames(&read(0)?, numbers)?;
            for (number, frame) in frames.iter().enumerate() {
                if let Some(frame) = frame {
                    write(number, frame)?;
                }
            }
            let exist = frames.iter().map(Option::is_some);
            Ok(StoredOutcome::Frames(exist.collect()))
        }
    }
}

fn write_volume(order: &SeriesOrder, volume: &[u8]) -> io::Result<()> {
    let mut file = std::fs::File::create_new(order.output.join(VOLUME))?;
    io::copy(&mut io::repeat(0).take(order.room), &mut file)?;
    file.write_all(volume)
}

/// From here on, the kernel ends this process if it exceeds its limits or if its parent ends.
fn limit_this_process(voxels: u64, seconds: u64) -> io::Result<()> {
    let at_most = |resource, most: u64| {
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        setrlimit(resource, limit).map_err(io::Error::from)
    };
    at_most(
        Resource::As,
        BASE_BYTES.saturating_add(BYTES_PER_VOXEL.saturating_mul(voxels)),
    )?;
    at_most(Resource::Cpu, seconds)?;
    at_most(Resource::Nofile, OPEN_FILES)?;
    at_most(
        Resource::Fsize,
        BASE_BYTES.saturating_add(4u64.saturating_mul(voxels)),
    )?;
    // A core file would contain images of a patient.
    at_most(Resource::Core, 0)?;
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    Ok(())
}

fn read(order: &SeriesOrder) -> Result<(Vec<u8>, Summary), DicomError> {
    let mut files = FilesBelow::open(&order.input, order.input_start, order.max_input_bytes)?;
    let options = Options {
        series: order.series.as_deref().and_then(SeriesName::parse),
        allow_gaps: order.allow_gaps,
        purpose: match order.is_layer {
            true => Purpose::Layer,
            false => Purpose::Case,
        },
    };
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    let converted = convert(&mut files, &options, &limits)?;
    let summary = Summary {
        attributes: converted.attributes,
        series: converted.series,
        is_t1: converted.is_t1,
        others: converted.others,
        ignored_files: converted.ignored_files,
    };
    Ok((converted.nifti, summary))
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
        limit_this_process(1000, 60).unwrap();
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
            .args(["--exact", "dicom::child::tests::limited", "--ignored"])
            .stdout(std::process::Stdio::null())
            .status();
        assert!(status.unwrap().success());
    }
}
