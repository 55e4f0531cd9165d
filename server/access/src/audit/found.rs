//! What a process finds in the folder when it begins its record. Its first line names the last line of each of the others, so that a record
//! that is missing later is noticed.

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::audit::line::{Named, read};

/// The longest line that is read here, in bytes.
const LONGEST_LINE: u64 = 4 << 20;

/// As many records are named in one line, those that began last.
const MOST_NAMED: usize = 1000;

/// The files of each process, by their numbers.
pub(crate) type Files = BTreeMap<String, BTreeMap<u32, PathBuf>>;

/// What the first line of a file has.
#[derive(Debug, Deserialize)]
pub(crate) struct FirstLine {
    pub(crate) time: String,
    #[serde(default)]
    pub(crate) others: Vec<Named>,
}

/// The files of a record, and the names of others in the folder.
///
/// # Errors
/// If the folder cannot be read.
pub(crate) fn files_in(folder: &Path) -> io::Result<(Files, Vec<String>)> {
    let (mut files, mut strange) = (Files::new(), Vec::new());
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match process_and_number(&name) {
            Some((process, number)) => {
                files.entry(process).or_default().insert(number, path);
            }
            None => strange.push(name.into_owned()),
        }
    }
    Ok((files, strange))
}

/// The process and the number of a file of the record.
fn process_and_number(name: &str) -> Option<(String, u32)> {
    let (process, number) = name.strip_suffix(".jsonl")?.rsplit_once('-')?;
    Some((process.to_owned(), number.parse().ok()?))
}

/// The last lines of the other processes in a folder, but for those that one of them has named already. What cannot be read is left to
/// [`verify`](crate::audit::verify).
pub(crate) fn others(folder: &Path, own: &str) -> Vec<Named> {
    let Ok((mut files, _)) = files_in(folder) else {
        return Vec::new();
    };
    files.remove(own);
    let first = files
        .values()
        .filter_map(|files| first_line(files.get(&1)?));
    let known: HashSet<_> = first.flat_map(|first| first.others).collect();
    let last = files.values().rev().filter_map(|files| {
        let mut paths = files.values().rev();
        last_line(paths.find(|path| !is_empty(path))?)
    });
    let new = last.filter(|last| !known.contains(last));
    new.take(MOST_NAMED).collect()
}

/// The first line of a file; `None` if it is none of a record.
pub(crate) fn first_line(path: &Path) -> Option<FirstLine> {
    let mut line = Vec::new();
    let file = BufReader::new(File::open(path).ok()?);
    file.take(LONGEST_LINE).read_until(b'\n', &mut line).ok()?;
    serde_json::from_slice(&line).ok()
}

/// Whether a file has no line: its process ended before the first one was on the disk.
fn is_empty(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|metadata| metadata.len() == 0)
}

/// The last whole line of a file; `None` if it is none of a record.
fn last_line(path: &Path) -> Option<Named> {
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let start = length.saturating_sub(LONGEST_LINE);
    file.seek(SeekFrom::Start(start)).ok()?;
    let mut end = Vec::new();
    file.take(LONGEST_LINE).read_to_end(&mut end).ok()?;
    let whole = end.iter().rposition(|&byte| byte == b'\n')?;
    let line = end[..whole].rsplit(|&byte| byte == b'\n').next()?;
    let last = read(line).filter(|line| line.is_sound)?;
    Some(Named {
        process: last.process,
        seq: last.seq,
        digest: last.digest,
    })
}
