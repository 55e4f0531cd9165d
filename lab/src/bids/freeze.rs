//! Locks a trial: the hashes of the program and of its parameters, written before the first result.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::head::hash;
use crate::BenchError;
use crate::files::{read, write};

/// The name of the file with the hashes.
const FILE: &str = "frozen.json";

/// What was locked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Frozen {
    /// The BLAKE3 hash of the executable file.
    pub(super) program: String,
    pub(super) version: String,
    /// The BLAKE3 hash of the parameters below, as JSON without spaces.
    pub(super) parameters_hash: String,
    pub(super) parameters: Value,
}

impl Frozen {
    fn of(parameters: Value) -> Result<Self, BenchError> {
        let unreadable = |reason| BenchError::Unreadable {
            path: "the executable file".into(),
            reason,
        };
        let program = std::env::current_exe().map_err(unreadable)?;
        Ok(Self {
            program: hash(&read(&program)?),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            parameters_hash: hash(parameters.to_string().as_bytes()),
            parameters,
        })
    }

    /// Locks a directory of results on request. If it is locked already, checks that nothing has changed.
    ///
    /// # Errors
    /// If the directory has results but no lock, or is locked with another program or other parameters.
    pub(super) fn locked(
        results: &Path,
        parameters: Value,
        is_requested: bool,
    ) -> Result<Option<Self>, BenchError> {
        let path = results.join(FILE);
        let path_text = path.display();
        if !path.exists() {
            if !is_requested {
                return Ok(None);
            }
            if let Some(result) = first_result(results)? {
                return Err(BenchError::Usage(format!(
                    "--freeze comes too late: {} exists already; name an empty directory with --results",
                    result.display()
                )));
            }
            let frozen = Self::of(parameters)?;
            let bytes = serde_json::to_vec_pretty(&frozen).expect("names and numbers");
            write(&path, &bytes)?;
            return Ok(Some(frozen));
        }
        let stored: Self = serde_json::from_slice(&read(&path)?)
            .map_err(|error| BenchError::Usage(format!("{path_text} is damaged: {error}")))?;
        let now = Self::of(parameters)?;
        let changed = if stored.program != now.program {
            Some("another program".to_owned())
        } else {
            changed(&stored.parameters, &now.parameters)
        };
        match changed {
            Some(what) => Err(BenchError::Usage(format!(
                "the trial was locked with {what} ({path_text}); run it unchanged, or name another directory with --results"
            ))),
            None if stored == now => Ok(Some(stored)),
            None => Err(BenchError::Usage(format!(
                "{path_text} was changed by hand; name another directory with --results"
            ))),
        }
    }
}

/// The names of parameters that differ.
fn changed(stored: &Value, now: &Value) -> Option<String> {
    let names = now.as_object().into_iter().flatten();
    let others: Vec<&str> = names
        .filter(|(name, value)| stored.get(name.as_str()) != Some(value))
        .map(|(name, _)| name.as_str())
        .collect();
    (!others.is_empty()).then(|| format!("other parameters: {}", others.join(", ")))
}

/// A file of results in a directory.
fn first_result(results: &Path) -> Result<Option<PathBuf>, BenchError> {
    let unreadable = |reason| BenchError::Unreadable {
        path: results.to_owned(),
        reason,
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(results).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|ending| ending == "json") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found.into_iter().next())
}
