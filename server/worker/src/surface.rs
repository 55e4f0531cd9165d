//! Surfaces with values: read in a process of their own, drawn into the voxels of a case there.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use case::{Failure, FailureKind};
use imaging::Limits;
use imaging::surface::{Drawing, Drawn, SurfaceError, SurfaceFiles};
use storage::Spooled;
use tempfile::TempDir;

use crate::confine::{Needs, confine};
use crate::error::Error;
use crate::headers::MAX_FILE_BYTES;
use crate::memory::series_bytes;
use crate::message::{Order, Stated, SurfaceOrder, VOLUME};
use crate::outcome::OUTCOME;
use crate::program::cannot_run;
use crate::reader::{SeriesReader, check_file, outcome};

/// The largest outcome: the names of labels.
const MAX_OUTCOME_BYTES: u64 = 4 << 20;

/// Surfaces to draw into the voxels of a case.
#[derive(Debug)]
pub struct Surfaces<'a> {
    /// Each with its values, unless they are in the same file.
    pub files: &'a [(Spooled, Option<Spooled>)],
    /// The volume that `tkregister` coordinates belong to.
    pub t1: Option<&'a Spooled>,
    /// How they are drawn.
    pub drawing: Drawing,
}

/// Surfaces as a volume.
#[derive(Debug)]
pub struct SurfaceReading {
    output: TempDir,
    /// What was drawn.
    pub drawn: Drawn,
}

impl SurfaceReading {
    /// The file of the volume, gzipped NIfTI-1, after [`Spooled::START`] bytes of room as in a spooled file.
    pub fn file(&self) -> PathBuf {
        self.output.path().join(VOLUME)
    }
}

impl SeriesReader {
    /// Reads surfaces and draws them. `scratch` is a directory where temporary files may be.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with the files; [`Error::NotRun`], logged, if the process cannot be started.
    pub async fn read_surfaces(
        &self,
        surfaces: Surfaces<'_>,
        scratch: &Path,
    ) -> Result<SurfaceReading, Error> {
        let output = tempfile::Builder::new()
            .prefix("surface-")
            .tempdir_in(scratch)
            .map_err(cannot_run)?;
        let limits = self.limits();
        let memory_bytes = series_bytes(&limits);
        let _memory = self.memory.take(memory_bytes).await;
        let path = |file: &Spooled| std::path::absolute(file.path()).map_err(cannot_run);
        let files = surfaces.files.iter().map(|(surface, values)| {
            let values = values.as_ref().map(path).transpose()?;
            Ok::<_, Error>((path(surface)?, values))
        });
        let order = SurfaceOrder {
            files: files.collect::<Result<_, _>>()?,
            t1: surfaces.t1.map(path).transpose()?,
            start: Spooled::START,
            output: std::path::absolute(output.path()).map_err(cannot_run)?,
            drawing: surfaces.drawing,
            max_voxels: limits.max_voxels,
            memory_bytes,
            seconds: self.longest.as_secs().max(1),
        };
        let status = match self.run(&Order::Surfaces(order)).await {
            Err(Error::Failure(_)) => return Err(beyond_limits().into()),
            ended => ended?,
        };
        let reading = tokio::task::spawn_blocking(move || take(status, output, &limits));
        Ok(reading.await.map_err(|_| Error::NotRun)??)
    }
}

/// The files of a child.
fn take(status: ExitStatus, output: TempDir, limits: &Limits) -> Result<SurfaceReading, Failure> {
    let read = outcome(status, &output, ("surfaces", MAX_OUTCOME_BYTES));
    let drawn: Drawn = read.map_err(|failure| match &*failure.name {
        crate::READER_DIED => beyond_limits(),
        _ => failure,
    })?;
    let largest = Spooled::START + 8 * limits.max_voxels as u64 + (1 << 20);
    match check_file(&output.path().join(VOLUME), largest) {
        Ok(()) => Ok(SurfaceReading { output, drawn }),
        Err(_) => Err(beyond_limits()),
    }
}

fn beyond_limits() -> Failure {
    Failure::unusable(
        "surface-unreadable",
        "the surface could not be read: the process that reads it ended, because a file is damaged, or needs more time or memory than allowed",
    )
}

/// In the process, which has its limits: reads the files of an order and writes the volume.
///
/// # Errors
/// If the files cannot be opened or written.
pub(crate) fn draw(order: &SurfaceOrder) -> io::Result<()> {
    let mut outcome_file = File::create_new(order.output.join(OUTCOME))?;
    let mut volume_file = File::create_new(order.output.join(VOLUME))?;
    let open = |path: &PathBuf| {
        let mut file = File::open(path)?;
        file.seek(io::SeekFrom::Start(order.start))?;
        Ok::<_, io::Error>(file)
    };
    let mut files = Vec::new();
    for (surface, values) in &order.files {
        files.push((open(surface)?, values.as_ref().map(open).transpose()?));
    }
    let t1 = order.t1.as_ref().map(open).transpose()?;
    confine(&Needs::default());
    let files: Vec<_> = (files.into_iter())
        .map(|(surface, values)| Ok((all(surface)?, values.map(all).transpose()?)))
        .collect::<io::Result<_>>()?;
    let files: Vec<_> = (files.iter())
        .map(|(surface, values)| SurfaceFiles {
            surface,
            values: values.as_deref(),
        })
        .collect();
    let t1 = t1.map(all).transpose()?;
    let limits = Limits {
        max_voxels: order.max_voxels,
        ..Limits::default()
    };
    let outcome = match imaging::surface::draw(&files, t1.as_deref(), &order.drawing, &limits) {
        Ok((nifti, drawn)) => {
            io::copy(&mut io::repeat(0).take(order.start), &mut volume_file)?;
            volume_file.write_all(&nifti)?;
            Stated::Read(drawn)
        }
        Err(error) => Stated::Refused(refusal(&error)),
    };
    outcome_file.write_all(&serde_json::to_vec(&outcome)?)
}

fn all(file: File) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn refusal(error: &SurfaceError) -> Failure {
    let kind = match error {
        SurfaceError::NotRecognised { .. } => FailureKind::NotRecognised,
        error if error.is_too_large() => FailureKind::TooLarge,
        _ => FailureKind::Unusable,
    };
    Failure::new(kind, error.kind(), error.to_string())
}
