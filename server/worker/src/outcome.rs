//! What a process leaves in its output directory, which the parent does not trust.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use case::Failure;
use serde::de::DeserializeOwned;

use crate::message::Stated;

/// The file with what the process has [`Stated`].
pub(crate) const OUTCOME: &str = "outcome.json";

/// The longest name and detail of a failure, in bytes.
pub(crate) const MAX_TEXT: [usize; 2] = [64, 4096];

/// What a process has stated; `None` if that is no such file, or a larger one.
pub(crate) fn read_outcome<T: DeserializeOwned>(output: &Path, largest: u64) -> Option<Stated<T>> {
    let bytes = read_bounded(&output.join(OUTCOME), largest)?;
    serde_json::from_slice(&bytes).ok()
}

/// The bytes of a file that is no link and not too large.
pub(crate) fn read_bounded(path: &Path, largest: u64) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let is_file = std::fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file());
    let file = File::open(path).ok()?;
    let length = file.take(largest + 1).read_to_end(&mut bytes).ok()?;
    (is_file && length as u64 <= largest).then_some(bytes)
}

/// Whether a failure may be passed on: it is short, without control characters.
pub(crate) fn is_sound(failure: &Failure) -> bool {
    let [name, detail] = MAX_TEXT;
    let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    failure.name.len() <= name
        && failure.name.chars().all(is_name)
        && failure.detail.len() <= detail
        && !failure.detail.chars().any(char::is_control)
}
