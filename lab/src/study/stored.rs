//! The results of one head on disk: a JSON file once it is finished, and until then one line for each finished trial.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{HeadResult, StudyParameters, Trial};
use crate::BenchError;
use crate::files::write;

/// The version of the files of results. It increases if lesions, places or observers change.
const FORMAT: u32 = 6;

/// The parameters of a stored result, in the words of the command line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct MadeWith {
    format: u32,
    map_format: u32,
    #[serde(flatten)]
    parameters: StudyParameters,
}

impl MadeWith {
    pub(super) fn these(parameters: &StudyParameters) -> Self {
        Self {
            format: FORMAT,
            map_format: analysis::MAP_FORMAT,
            parameters: *parameters,
        }
    }

    /// Refuses a file that was made with other parameters.
    fn check(&self, path: &Path, stored: &Value) -> Result<(), BenchError> {
        let wanted = serde_json::to_value(self).expect("numbers");
        let wanted = wanted.as_object().into_iter().flatten();
        let others: Vec<String> = wanted
            .filter(|(name, now)| stored.get(name.as_str()) != Some(now))
            .map(|(name, now)| match stored.get(name.as_str()) {
                Some(then) => format!("{name} {then}, not {now}"),
                None => format!("no {name}"),
            })
            .collect();
        if others.is_empty() {
            return Ok(());
        }
        let others = others.join("; ");
        refused(path, &format!("was made with other parameters ({others})"))
    }
}

fn refused<T>(path: &Path, reason: &str) -> Result<T, BenchError> {
    let path = path.display();
    let advice = "remove it, or name another directory with --results";
    Err(BenchError::Usage(format!("{path} {reason}; {advice}")))
}

/// The file of results of a finished head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Stored {
    pub(super) made_with: MadeWith,
    #[serde(flatten)]
    pub(super) result: HeadResult,
}

impl Stored {
    /// The result in a file; `None` if there is no such file.
    ///
    /// # Errors
    /// If the file is no result, or was made with other parameters.
    pub(super) fn read(
        path: &Path,
        made_with: &MadeWith,
    ) -> Result<Option<HeadResult>, BenchError> {
        let Ok(bytes) = std::fs::read(path) else {
            return Ok(None);
        };
        let no_result = |error| refused(path, &format!("is not a result of a study: {error}"));
        let json: Value = match serde_json::from_slice(&bytes) {
            Ok(json) => json,
            Err(error) => return no_result(error),
        };
        made_with.check(path, &json["made_with"])?;
        match serde_json::from_value::<Self>(json) {
            Ok(stored) => Ok(Some(stored.result)),
            Err(error) => no_result(error),
        }
    }

    /// Writes the file whole: a run that is interrupted leaves none.
    pub(super) fn write(&self, path: &Path) -> Result<(), BenchError> {
        let bytes = serde_json::to_vec_pretty(self).expect("numbers and names");
        let part = path.with_extension("json.part");
        write(&part, &bytes)?;
        std::fs::rename(&part, path).map_err(|error| BenchError::unwritable(path, &error))
    }
}

/// The file of a head that is not finished: a line with its parameters, and one for each finished trial.
pub(super) struct Unfinished {
    path: PathBuf,
    file: File,
}

impl Unfinished {
    /// Opens the file, or creates it, and returns the trials of an interrupted run. A line that was cut off is dropped.
    ///
    /// # Errors
    /// If the file cannot be read or written, or was made with other parameters.
    pub(super) fn open(
        path: PathBuf,
        made_with: &MadeWith,
    ) -> Result<(Self, Vec<Trial>), BenchError> {
        let bytes = std::fs::read(&path).unwrap_or_default();
        let mut trials = Vec::new();
        let mut kept = 0;
        for line in bytes.split_inclusive(|&byte| byte == b'\n') {
            if !line.ends_with(b"\n") {
                break;
            }
            if kept == 0 {
                let stored = serde_json::from_slice(line).unwrap_or(Value::Null);
                made_with.check(&path, &stored)?;
            } else {
                match serde_json::from_slice(line) {
                    Ok(trial) => trials.push(trial),
                    Err(_) => break,
                }
            }
            kept += line.len();
        }
        let file = OpenOptions::new()
            .append(true)
            .create(true)
            .open(&path)
            .and_then(|file| file.set_len(kept as u64).map(|()| file))
            .map_err(|error| BenchError::unwritable(&path, &error))?;
        let mut unfinished = Self { path, file };
        if kept == 0 {
            unfinished.line(made_with)?;
        }
        Ok((unfinished, trials))
    }

    /// Adds a finished trial.
    pub(super) fn add(&mut self, trial: &Trial) -> Result<(), BenchError> {
        self.line(trial)
    }

    fn line(&mut self, value: &impl Serialize) -> Result<(), BenchError> {
        let mut line = serde_json::to_vec(value).expect("numbers and names");
        line.push(b'\n');
        let written = self.file.write_all(&line);
        written.map_err(|error| BenchError::unwritable(&self.path, &error))
    }

    /// Removes the file of a head that is finished.
    pub(super) fn remove(self) -> Result<(), BenchError> {
        std::fs::remove_file(&self.path).map_err(|error| BenchError::unwritable(&self.path, &error))
    }
}
