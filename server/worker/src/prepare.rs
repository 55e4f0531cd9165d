//! Preparations in processes of their own.
//!
//! The kernel keeps its limits, its memory is free as soon as it ends, and a crash is the end of one case. It is confined (`confine/`)
//! before it reads the upload, and its results are checked like all that is read from the store.

use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, ExitStatus};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;
use case::{CaseFacts, Failure, FailureKind, ObjectKind, Parameters, Progress};
use imaging::Limits;
use pipeline::{Derived, Extractor, Pipeline, Source, StoredBrain};

use crate::confine::{Instead, Needs, confine, said};
use crate::message::{Order, PrepareOrder, Stated};
use crate::outcome::{OUTCOME, is_sound, read_bounded, read_outcome};
use crate::program::{Program, was_interrupted};

/// How often to look whether the process has ended, or shall end.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Memory for the program, the network and one picture of the size of its cube.
const BASE_BYTES: u64 = 1 << 30;

/// Memory for each voxel of the largest volume.
const BYTES_PER_VOXEL: u64 = 16;

/// The largest outcome and the largest object.
const MAX_OUTCOME_BYTES: u64 = 16 << 20;
const MAX_OBJECT_BYTES: u64 = 2 << 30;

/// How preparations run in processes of their own.
#[derive(Debug, Clone)]
pub struct PrepareProcess {
    /// The program of the process.
    pub program: Program,
    /// The file with the weights of the network, as it is configured.
    pub network: Option<PathBuf>,
    /// Where temporary files may be.
    pub scratch: PathBuf,
    pub threads: usize,
    /// The limit for CPU time, of all threads together.
    pub cpu_seconds: u64,
}

/// The files of an upload.
const SOURCE_FILES: [&str; 4] = ["volume", "mask", "dicom", "brain"];

/// The objects of a prepared case.
const OBJECTS: [ObjectKind; 6] = [
    ObjectKind::Mask,
    ObjectKind::Envelope,
    ObjectKind::Forest,
    ObjectKind::Paths,
    ObjectKind::Volume,
    ObjectKind::WholeVolume,
];

/// What the process may use, in bytes.
pub(crate) fn bytes(limits: &Limits) -> u64 {
    let voxels = limits.max_voxels as u64;
    BASE_BYTES.saturating_add(BYTES_PER_VOXEL.saturating_mul(voxels))
}

impl PrepareProcess {
    /// Prepares a case; `observe` is told each step as it begins. The process ends soon after `cancelled` is set.
    ///
    /// # Errors
    /// What the process says is wrong, or how it died.
    pub fn prepare(
        &self,
        source: &Source,
        parameters: &Parameters,
        limits: &Limits,
        (observe, cancelled): (&(dyn Fn(Progress) + Sync), &AtomicBool),
    ) -> Result<Derived, Failure> {
        let folder = tempfile::Builder::new()
            .prefix("prepare-")
            .tempdir_in(&self.scratch)
            .map_err(|error| cannot_run(&error))?;
        let order = PrepareOrder {
            brain: (source.brain.as_ref()).map(|brain| (brain.quality.clone(), brain.cuts.clone())),
            source: folder.path().join("source"),
            output: folder.path().join("output"),
            parameters: parameters.clone(),
            max_voxels: limits.max_voxels,
            network: self.network.clone(),
            threads: self.threads,
            cpu_seconds: self.cpu_seconds,
        };
        let ended = write_source(&order, source)
            .and_then(|()| self.run(&order, observe, cancelled))
            .map_err(|error| cannot_run(&error))?;
        if !ended.success() {
            return Err(self.why(ended, cancelled));
        }
        read_results(&order.output)
    }

    /// Runs the process until it ends; ends it, if `cancelled` is set.
    fn run(
        &self,
        order: &PrepareOrder,
        observe: &(dyn Fn(Progress) + Sync),
        cancelled: &AtomicBool,
    ) -> io::Result<ExitStatus> {
        let mut line = serde_json::to_vec(&Order::Prepare(Box::new(order.clone())))?;
        line.push(b'\n');
        let mut child = Ended(self.program.start_now()?);
        // If the process has already ended, its status tells why.
        let _ = child
            .0
            .stdin
            .take()
            .map(|mut orders| orders.write_all(&line));
        let progress = child.0.stdout.take();
        std::thread::scope(|scope| {
            scope.spawn(|| progress.map(|progress| tell(progress, observe)));
            loop {
                if let Some(status) = child.0.try_wait()? {
                    return Ok(status);
                }
                if cancelled.load(Ordering::Relaxed) {
                    child.0.kill()?;
                }
                std::thread::sleep(LOOK_EVERY);
            }
        })
    }

    /// Why a process did not end well.
    fn why(&self, status: ExitStatus, cancelled: &AtomicBool) -> Failure {
        if cancelled.load(Ordering::Relaxed) || was_interrupted(status) {
            return Failure::new(
                FailureKind::Cancelled,
                "cancelled",
                "the preparation was cancelled",
            );
        }
        tracing::warn!(%status, "the process that prepares a case died");
        let signal = status.signal().unwrap_or_default();
        if signal == libc::SIGXCPU {
            let detail = format!(
                "the preparation exceeded the limit of {} seconds of CPU time; upload a volume with fewer voxels",
                self.cpu_seconds
            );
            return Failure::unusable("preparation-too-slow", detail);
        }
        if [libc::SIGABRT, libc::SIGKILL].contains(&signal) {
            let detail =
                "the preparation needs more memory than allowed; upload a volume with fewer voxels";
            return Failure::unusable("preparation-too-large", detail);
        }
        crashed()
    }
}

/// A process that ends with its handle.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn tell(progress: ChildStdout, observe: &(dyn Fn(Progress) + Sync)) {
    for line in BufReader::new(progress.take(MAX_OUTCOME_BYTES)).lines() {
        let Ok(line) = line else { return };
        // A test program says other things, too.
        if let Ok(now) = serde_json::from_str(&line) {
            observe(now);
        }
    }
}

fn cannot_run(error: &io::Error) -> Failure {
    tracing::error!(kind = %error.kind(), "cannot start the process that prepares a case");
    crashed()
}

fn crashed() -> Failure {
    Failure::new(
        FailureKind::Internal,
        "preparation-crashed",
        "internal error during the preparation",
    )
}

fn write_source(order: &PrepareOrder, source: &Source) -> io::Result<()> {
    std::fs::create_dir(&order.source)?;
    std::fs::create_dir(&order.output)?;
    let brain = source.brain.as_ref().map(|brain| &brain.mask);
    let files = [
        Some(&source.volume),
        source.mask.as_ref(),
        source.dicom.as_ref(),
        brain,
    ];
    for (name, bytes) in SOURCE_FILES.iter().zip(files) {
        if let Some(bytes) = bytes {
            std::fs::write(order.source.join(name), bytes)?;
        }
    }
    Ok(())
}

fn read_results(output: &Path) -> Result<Derived, Failure> {
    let facts = match read_outcome(output, MAX_OUTCOME_BYTES).ok_or_else(crashed)? {
        Stated::Read(facts) => facts,
        Stated::Refused(failure) if is_sound(&failure) => return Err(failure),
        Stated::Refused(_) => return Err(crashed()),
    };
    let objects = OBJECTS.iter().map(|&kind| {
        let bytes = read_bounded(&output.join(kind.name()), MAX_OBJECT_BYTES);
        Ok((kind, bytes.ok_or_else(crashed)?.into()))
    });
    Ok(Derived {
        objects: objects.collect::<Result<_, Failure>>()?,
        facts,
    })
}

/// Prepares a volume in a process of this program, as a worker does. Tests have it.
///
/// # Errors
/// What the process says is wrong, or how it died.
#[cfg(any(test, feature = "testing"))]
pub fn prepare_by(program: Program, volume: Bytes, scratch: &Path) -> Result<Derived, Failure> {
    let process = PrepareProcess {
        program,
        network: None,
        scratch: scratch.to_owned(),
        threads: 1,
        cpu_seconds: 120,
    };
    let source = Source {
        volume,
        ..Source::default()
    };
    let (limits, never) = (Limits::default(), AtomicBool::new(false));
    process.prepare(&source, &Parameters::default(), &limits, (&|_| {}, &never))
}

/// In the process: prepares the case, or runs other code in place of this.
///
/// # Errors
/// If the files cannot be read or written.
pub(crate) fn prepare(order: &PrepareOrder, instead: Option<Instead<'_>>) -> io::Result<()> {
    let read = |name: &str| match std::fs::read(order.source.join(name)) {
        Ok(bytes) => Ok(Some(Bytes::from(bytes))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    };
    let [volume, mask, dicom, brain] = SOURCE_FILES.map(read);
    let brain = brain?.zip(order.brain.clone());
    let source = Source {
        volume: volume?.ok_or(io::ErrorKind::NotFound)?,
        mask: mask?,
        dicom: dicom?,
        brain: brain.map(|(mask, (quality, cuts))| StoredBrain {
            mask,
            quality,
            cuts,
        }),
    };
    crate::priority::yield_to_answers();
    let extractor = Extractor::open(order.network.as_deref()).map_err(io::Error::other)?;
    let output = File::open(&order.output)?;
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    crate::confine::limit_data(bytes(&limits), order.cpu_seconds)?;
    let confinement = confine(&Needs {
        writes: Some(output.as_fd()),
        threads: true,
        ..Needs::default()
    });
    if let Some(code) = instead {
        let outcome = Stated::Refused(said(code(&confinement)));
        return write_outcome(&output, &outcome);
    }
    let observe = |now: Progress| {
        if let Ok(mut line) = serde_json::to_vec(&now) {
            line.insert(0, b'\n');
            line.push(b'\n');
            // The parent may have gone.
            let mut told = io::stdout().lock();
            let _ = told.write_all(&line).and_then(|()| told.flush());
        }
    };
    let pipeline = Pipeline::new(extractor).with_threads(order.threads);
    let never = AtomicBool::new(false);
    let derived = pipeline.derive(&source, &order.parameters, &limits, &observe, &never);
    let outcome = match derived {
        Ok(derived) => {
            for (kind, bytes) in &derived.objects {
                crate::confine::create_in(&output, kind.name())?.write_all(bytes)?;
            }
            Stated::Read(derived.facts)
        }
        Err(failure) => Stated::Refused(failure),
    };
    write_outcome(&output, &outcome)
}

fn write_outcome(output: &File, outcome: &Stated<CaseFacts>) -> io::Result<()> {
    crate::confine::create_in(output, OUTCOME)?.write_all(&serde_json::to_vec(outcome)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_is_ended_with_the_server_has_not_crashed() {
        let scratch = tempfile::tempdir().unwrap();
        for (signal, name) in [
            ("TERM", "cancelled"),
            ("INT", "cancelled"),
            ("HUP", "cancelled"),
            ("SEGV", "preparation-crashed"),
            ("KILL", "preparation-too-large"),
        ] {
            let arguments = ["-c".to_owned(), format!("kill -{signal} $$")];
            let program = Program::other("/bin/sh".into(), arguments.map(Into::into).into());
            let failure = prepare_by(program, Bytes::new(), scratch.path());
            assert_eq!(
                failure.err().map(|failure| failure.name).as_deref(),
                Some(name)
            );
        }
    }
}
