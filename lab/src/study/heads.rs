//! The heads of the study: from files to trials. Each trial is stored as it finishes, so that an interrupted run
//! continues.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use analysis::midsagittal_plane;
use geometry::{BrainMask, DepthField, Volume, distance_map, envelope};
use imaging::nifti;

use super::stored::{MadeWith, Stored, Unfinished};
use super::{Ground, HeadResult, StudyParameters, Trial, run_head, seed_of};
use crate::BenchError;
pub use crate::brain::MaskFrom;
use crate::files::{read, write};

/// Radius of the ball that closes the brain mask, in mm.
const CLOSING_MM: f64 = 10.0;

/// A head of the study, as files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StudyHead {
    /// Its name in the tables.
    pub name: String,
    /// A NIfTI file, or a folder with one DICOM series, and its mask; `None` for the synthetic head.
    pub files: Option<(PathBuf, MaskFrom)>,
}

/// The output directories.
#[derive(Debug, Clone)]
pub struct StudyFolders {
    /// The directory of `NAME.json` for each head, which is reused if it was made with the same parameters. Until a head
    /// is finished, its trials are in `NAME.unfinished`.
    pub results: PathBuf,
    /// The directory for each head with each of its lesions, as NIfTI.
    pub lesions: Option<PathBuf>,
}

/// A finished trial of a head.
#[derive(Debug, Clone, Copy)]
pub struct Finished<'a> {
    /// The name of the head.
    pub head: &'a str,
    /// The trial.
    pub trial: &'a Trial,
    /// Number of finished trials of this head.
    pub done: usize,
    /// Number of all trials of this head.
    pub count: usize,
}

impl StudyHead {
    /// The trials of this head: from the directory of results, or new ones.
    ///
    /// # Errors
    /// If a file cannot be read or written, a result was made with other parameters, no usable mask can be made, or the
    /// head has no maps.
    pub fn trials(
        &self,
        parameters: &StudyParameters,
        folders: &StudyFolders,
        progress: &mut dyn FnMut(Finished<'_>),
    ) -> Result<HeadResult, BenchError> {
        let path = folders.results.join(format!("{}.json", self.name));
        let made_with = MadeWith::these(parameters);
        if let Some(result) = Stored::read(&path, &made_with)? {
            return Ok(result);
        }
        let path_until_then = folders.results.join(format!("{}.unfinished", self.name));
        let (mut unfinished, finished) = Unfinished::open(path_until_then, &made_with)?;
        let (volume, brain) = self.read()?;
        let envelope = envelope(&brain, CLOSING_MM)?;
        let head = analysis::Head {
            volume: &volume,
            depth: &DepthField::new(&distance_map(&envelope)),
            plane: &midsagittal_plane(&envelope, &volume),
        };
        let mut done = finished.len();
        let mut stored = Ok(());
        let study = (parameters, seed_of(&self.name));
        let trials = run_head(head, study, finished, |trial| {
            done += 1;
            progress(Finished {
                head: &self.name,
                trial,
                done,
                count: parameters.trials(),
            });
            stored = unfinished.add(trial);
            match stored {
                Ok(()) => ControlFlow::Continue(()),
                Err(_) => ControlFlow::Break(()),
            }
        })?;
        stored?;
        if let Some(folder) = &folders.lesions {
            let ground = Ground::new(head)?;
            for (number, trial) in trials.iter().enumerate() {
                let bytes =
                    nifti::write_volume(&ground.simulated(&trial.lesion(), parameters.simulator))?;
                write(
                    &folder.join(format!("{}-{number}.nii.gz", self.name)),
                    &bytes,
                )?;
            }
        }
        let result = HeadResult {
            name: self.name.clone(),
            trials,
        };
        let stored = Stored { made_with, result };
        stored.write(&path)?;
        unfinished.remove()?;
        Ok(stored.result)
    }

    fn read(&self) -> Result<(Volume, BrainMask), BenchError> {
        let Some((volume, mask)) = &self.files else {
            let head = geometry::phantom::head(1.0);
            let brain = BrainMask::from_mask(&head.brain, head.volume.grid())?;
            return Ok((head.volume, brain));
        };
        let bytes = if volume.is_dir() {
            from_dicom(volume)?
        } else {
            read(volume)?
        };
        let volume = nifti::read_volume(&bytes, &imaging::Limits::default())?;
        let brain = mask.brain(&self.name, &volume)?;
        Ok((volume, brain))
    }
}

/// The one series of a folder, as NIfTI.
fn from_dicom(folder: &Path) -> Result<Vec<u8>, BenchError> {
    let unreadable = |reason| BenchError::Unreadable {
        path: folder.to_owned(),
        reason,
    };
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let paths: Result<Vec<PathBuf>, _> = entries.map(|entry| Ok(entry?.path())).collect();
    let files = paths.map_err(unreadable)?;
    let mut files = files
        .iter()
        .map(|path| read(path))
        .collect::<Result<Vec<_>, _>>()?;
    let options = imaging::dicom::Options::default();
    let converted = imaging::dicom::convert(&mut files, &options, &imaging::Limits::default());
    let refused = |error| {
        BenchError::Usage(format!(
            "{} is not a usable DICOM series: {error}",
            folder.display()
        ))
    };
    Ok(converted.map_err(refused)?.nifti)
}
