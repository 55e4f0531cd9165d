//! The child process, which reads the files.

use std::io::{self, Read, Write as _};
use std::process::ExitCode;

use imaging::Limits;
use imaging::dicom::{DicomError, Options, SeriesName, convert};
use rustix::process::{Resource, Rlimit, Signal, setrlimit};

use super::files::FilesBelow;
use super::message::{OUTCOME, Order, Outcome, Summary, VOLUME};
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
    let mut order = Vec::new();
    io::stdin().take(MAX_ORDER_BYTES).read_to_end(&mut order)?;
    let order: Order = serde_json::from_slice(&order)?;
    limit_this_process(&order)?;
    let outcome = match read(&order) {
        Ok((volume, summary)) => {
            write_volume(&order, &volume)?;
            Outcome::Read(summary)
        }
        Err(error) => Outcome::Refused(refusal(&error)),
    };
    std::fs::write(order.output.join(OUTCOME), serde_json::to_vec(&outcome)?)
}

fn write_volume(order: &Order, volume: &[u8]) -> io::Result<()> {
    let mut file = std::fs::File::create_new(order.output.join(VOLUME))?;
    io::copy(&mut io::repeat(0).take(order.room), &mut file)?;
    file.write_all(volume)
}

/// From here on, the kernel ends this process if it exceeds its limits or if its parent ends.
fn limit_this_process(order: &Order) -> io::Result<()> {
    let voxels = order.max_voxels as u64;
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
    at_most(Resource::Cpu, order.seconds)?;
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

fn read(order: &Order) -> Result<(Vec<u8>, Summary), DicomError> {
    let mut files = FilesBelow::open(&order.input, order.input_start, order.max_input_bytes)?;
    let options = Options {
        series: order.series.as_deref().and_then(SeriesName::parse),
        allow_gaps: order.allow_gaps,
    };
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    let converted = convert(&mut files, &options, &limits)?;
    let summary = Summary {
        attributes: converted.attributes,
        series: converted.series,
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
        let order = Order {
            input: "/".into(),
            input_start: 0,
            output: "/".into(),
            room: 0,
            series: None,
            allow_gaps: false,
            max_voxels: 1000,
            max_input_bytes: 1000,
            seconds: 60,
        };
        limit_this_process(&order).unwrap();
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
