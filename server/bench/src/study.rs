//! The heads of the study: from files to trials, with one JSON file per head, so that an interrupted run continues.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use analysis::midsagittal_plane;
use analysis::study::{Ground, HeadResult, StudyParameters, Trial, run_head};
use geometry::{BrainMask, DepthField, Mask, Volume, distance_map, envelope};
use imaging::nifti;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::BenchError;

/// Radius of the ball that closes the brain mask, in mm.
const CLOSING_MM: f64 = 10.0;

/// The version of the files of results. It increases if lesions, places or observers change.
const FORMAT: u32 = 3;

/// The parameters of a stored result, in the words of the command line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct MadeWith {
    format: u32,
    map_format: u32,
    lesions: usize,
    shams: usize,
    patches: usize,
    normals: usize,
    seed: u64,
    radius_mm: Option<f64>,
    blur_mm: Option<f64>,
}

impl MadeWith {
    fn these(parameters: &StudyParameters) -> Self {
        Self {
            format: FORMAT,
            map_format: analysis::MAP_FORMAT,
            lesions: parameters.lesions,
            shams: parameters.shams,
            patches: parameters.patches,
            normals: parameters.normals,
            seed: parameters.seed,
            radius_mm: parameters.lesion.map(|(_, radius_mm, _)| radius_mm),
            blur_mm: parameters.lesion.map(|(_, _, effect)| effect.blur_mm),
        }
    }
}

/// The file of results of one head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Stored {
    made_with: MadeWith,
    #[serde(flatten)]
    result: HeadResult,
}

impl Stored {
    /// The result in a file, if it was made with these parameters.
    fn read(path: &Path, bytes: &[u8], made_with: &MadeWith) -> Result<HeadResult, BenchError> {
        let refused = |reason: &str| {
            let path = path.display();
            let advice = "remove it, or name another directory with --results";
            Err(BenchError::Usage(format!("{path} {reason}; {advice}")))
        };
        let json: Value = match serde_json::from_slice(bytes) {
            Ok(json) => json,
            Err(error) => return refused(&format!("is not a result of a study: {error}")),
        };
        let wanted = serde_json::to_value(made_with).expect("numbers");
        let stored = &json["made_with"];
        let others = wanted.as_object().into_iter().flatten();
        let others: Vec<String> = others
            .filter(|(name, now)| stored.get(name.as_str()) != Some(now))
            .map(|(name, now)| match stored.get(name.as_str()) {
                Some(then) => format!("{name} {then}, not {now}"),
                None => format!("no {name}"),
            })
            .collect();
        if !others.is_empty() {
            return refused(&format!(
                "was made with other parameters ({})",
                others.join("; ")
            ));
        }
        match serde_json::from_value::<Self>(json) {
            Ok(stored) => Ok(stored.result),
            Err(error) => refused(&format!("is not a result of a study: {error}")),
        }
    }
}

/// A head of the study, as files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StudyHead {
    /// Its name in the tables.
    pub name: String,
    /// A NIfTI file, or a folder with one DICOM series; `None` for the synthetic head.
    pub files: Option<[PathBuf; 2]>,
    /// Whether parameters were tuned on it.
    pub is_tuned: bool,
}

/// The output directories.
#[derive(Debug, Clone)]
pub struct StudyFolders {
    /// The directory of `NAME.json` for each head, which is reused if it was made with the same parameters.
    pub results: PathBuf,
    /// The directory for each head with each of its lesions, as NIfTI.
    pub lesions: Option<PathBuf>,
}

impl StudyHead {
    /// The trials of this head: from the directory of results, or new ones.
    ///
    /// # Errors
    /// If a file cannot be read or written, a result was made with other parameters, or the head has no maps.
    pub fn trials(
        &self,
        parameters: &StudyParameters,
        folders: &StudyFolders,
        progress: &dyn Fn(&str),
    ) -> Result<HeadResult, BenchError> {
        let path = folders.results.join(format!("{}.json", self.name));
        let made_with = MadeWith::these(parameters);
        if let Ok(bytes) = std::fs::read(&path) {
            let mut result = Stored::read(&path, &bytes, &made_with)?;
            result.is_tuned = self.is_tuned;
            return Ok(result);
        }
        let (volume, mask) = self.read()?;
        let brain = BrainMask::from_mask(&mask, volume.grid())?;
        let envelope = envelope(&brain, CLOSING_MM)?;
        let head = analysis::Head {
            volume: &volume,
            depth: &DepthField::new(&distance_map(&envelope)),
            plane: &midsagittal_plane(&envelope, &volume),
        };
        let mut done = 0;
        let trials = run_head(head, &parameters.for_head(&self.name), |trial, count| {
            done += 1;
            progress(&described(&self.name, trial, [done, count]));
            ControlFlow::Continue(())
        })?;
        if let Some(folder) = &folders.lesions {
            let ground = Ground::new(head)?;
            let searched = trials.iter().filter(|trial| trial.is_searched);
            for (number, trial) in searched.enumerate() {
                let bytes = nifti::write_volume(&ground.with_lesion(&trial.lesion()))?;
                write(
                    &folder.join(format!("{}-{number}.nii.gz", self.name)),
                    &bytes,
                )?;
            }
        }
        let result = HeadResult {
            name: self.name.clone(),
            is_tuned: self.is_tuned,
            trials,
        };
        let stored = Stored { made_with, result };
        let bytes = serde_json::to_vec_pretty(&stored).expect("numbers and names");
        write(&path, &bytes)?;
        Ok(stored.result)
    }

    fn read(&self) -> Result<(Volume, Mask), BenchError> {
        let Some([volume, mask]) = &self.files else {
            let head = geometry::phantom::head(1.0);
            return Ok((head.volume, head.brain));
        };
        let limits = imaging::Limits::default();
        let bytes = if volume.is_dir() {
            from_dicom(volume)?
        } else {
            read(volume)?
        };
        Ok((
            nifti::read_volume(&bytes, &limits)?,
            nifti::read_mask(&read(mask)?, &limits)?,
        ))
    }
}

fn described(name: &str, trial: &Trial, [done, count]: [usize; 2]) -> String {
    let (sign, radius_mm) = (trial.sign.name(), trial.radius_mm);
    format!("{name}: {done} of {count} ({sign}, radius {radius_mm} mm)")
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

fn read(path: &Path) -> Result<Vec<u8>, BenchError> {
    std::fs::read(path).map_err(|reason| BenchError::Unreadable {
        path: path.to_owned(),
        reason,
    })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    std::fs::write(path, bytes).map_err(|error| BenchError::Unwritable {
        path: path.to_owned(),
        reason: error.to_string(),
    })
}
