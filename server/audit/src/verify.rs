//! Whether a record is as it was written.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::line::{NO_DIGEST, Read, read};
use crate::trail::{is_of_trail, process_and_number};

/// What was found in a folder.
#[derive(Debug, Default)]
pub struct Verified {
    /// Files that were read.
    pub files: usize,
    /// Whole lines in them.
    pub lines: usize,
    /// Where the record is not as it was written.
    pub breaks: Vec<Break>,
    /// What may be so, and may not be.
    pub notes: Vec<String>,
    /// The last line of each process.
    pub heads: Vec<Head>,
}

/// The last line of a process. Compare it with one that was kept elsewhere: lines that are missing at the end leave no other trace.
#[derive(Debug)]
pub struct Head {
    /// The process.
    pub process: String,
    /// The number of its last line.
    pub seq: u64,
    /// The digest of that.
    pub digest: String,
}

/// A place at which the record is not as it was written.
#[derive(Debug, PartialEq, Eq)]
pub struct Break {
    /// The name of the file.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub kind: BreakKind,
}

/// What is wrong.
#[derive(Debug, PartialEq, Eq)]
pub enum BreakKind {
    /// It is no line of a record.
    NotALine,
    /// Its end is missing.
    Truncated,
    /// It does not have the digest that it states.
    Changed,
    /// So many lines before it are missing.
    Removed(u64),
    /// It was inserted or repeated.
    Inserted,
    /// The line before it is not the one that was written.
    Replaced,
    /// It is of another process than its file.
    Strange,
    /// The file with this number is missing before it.
    FileMissing(u32),
    /// The file does not begin with its first line.
    Beheaded,
    /// The file has another number than when it was begun.
    Renumbered(u32),
}

impl fmt::Display for Break {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}: ", self.file, self.line)?;
        match self.kind {
            BreakKind::NotALine => write!(formatter, "not a line of an audit record"),
            BreakKind::Truncated => write!(formatter, "the end of the line is missing"),
            BreakKind::Changed => write!(formatter, "the line was changed"),
            BreakKind::Removed(1) => write!(formatter, "a line before this one was removed"),
            BreakKind::Removed(count) => {
                write!(formatter, "{count} lines before this one were removed")
            }
            BreakKind::Inserted => write!(formatter, "the line was inserted or repeated"),
            BreakKind::Replaced => write!(formatter, "the line before this one was replaced"),
            BreakKind::Strange => write!(formatter, "the line is of another process"),
            BreakKind::FileMissing(number) => {
                write!(formatter, "the file {number:06} before this one is missing")
            }
            BreakKind::Beheaded => write!(formatter, "the beginning of the file is missing"),
            BreakKind::Renumbered(number) => {
                write!(formatter, "the file was begun as number {number:06}")
            }
        }
    }
}

/// Reads all files of a folder, and finds what was changed, removed or inserted.
///
/// # Errors
/// If the folder or a file cannot be read.
pub fn verify(folder: &Path) -> io::Result<Verified> {
    let mut processes: BTreeMap<String, BTreeMap<u32, PathBuf>> = BTreeMap::new();
    let mut verified = Verified::default();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match process_and_number(&name) {
            Some((process, number)) => {
                processes.entry(process).or_default().insert(number, path);
            }
            None if is_of_trail(&name) => {}
            None => verified
                .notes
                .push(format!("{name} is no file of an audit record")),
        }
    }
    for (process, files) in processes {
        verify_process(&process, &files, &mut verified)?;
    }
    Ok(verified)
}

/// What the next line must follow.
struct Chain {
    /// `None` before the first line that is there.
    last: Option<(u64, String)>,
    is_stopped: bool,
}

fn verify_process(
    process: &str,
    files: &BTreeMap<u32, PathBuf>,
    verified: &mut Verified,
) -> io::Result<()> {
    let mut chain = Chain {
        last: None,
        is_stopped: false,
    };
    let mut expected = 1;
    for (&number, path) in files {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let mut report = |line, kind| {
            verified.breaks.push(Break {
                file: file.clone().into_owned(),
                line,
                kind,
            });
        };
        if number > expected && expected > 1 {
            report(1, BreakKind::FileMissing(expected));
            // What is missing is said.
            chain.last = None;
        }
        if number > 1 && expected == 1 {
            let note = format!("the files of {process} before {number:06} are not here");
            verified.notes.push(note);
        }
        let begins_here = number == 1;
        expected = number + 1;
        verified.files += 1;
        let text = std::fs::read(path)?;
        // A file begins with a line.
        if text.is_empty() {
            report(1, BreakKind::Truncated);
        }
        for (at, line) in text.split_inclusive(|&byte| byte == b'\n').enumerate() {
            let Some(line) = line.strip_suffix(b"\n") else {
                report(at + 1, BreakKind::Truncated);
                continue;
            };
            verified.lines += 1;
            let Some(line) = read(line) else {
                report(at + 1, BreakKind::NotALine);
                continue;
            };
            if line.process != process {
                report(at + 1, BreakKind::Strange);
                continue;
            }
            match (at, line.file) {
                // The first file begins with the first line of the process.
                (0, None) if number > 1 => report(1, BreakKind::Beheaded),
                (_, Some(begun)) if begun != number => {
                    report(at + 1, BreakKind::Renumbered(begun));
                }
                _ => {}
            }
            if let Some(kind) = chain.follow(&line, begins_here) {
                report(at + 1, kind);
            }
        }
    }
    if !chain.is_stopped {
        let note = format!(
            "{process} has not stopped in order: it runs, or was killed, or its last lines are missing"
        );
        verified.notes.push(note);
    }
    verified.heads.extend(chain.last.map(|(seq, digest)| Head {
        process: process.to_owned(),
        seq,
        digest,
    }));
    Ok(())
}

impl Chain {
    /// Goes on with a line; what is wrong with it.
    fn follow(&mut self, line: &Read, begins_here: bool) -> Option<BreakKind> {
        let before = match &self.last {
            Some((seq, digest)) => Some((*seq, digest.clone())),
            None => begins_here.then(|| (0, NO_DIGEST.to_hex().to_string())),
        };
        if let Some((seq, _)) = before
            && line.seq <= seq
        {
            return Some(BreakKind::Inserted);
        }
        self.last = Some((line.seq, line.digest.clone()));
        self.is_stopped = line.is_stop;
        if !line.is_sound {
            return Some(BreakKind::Changed);
        }
        let (seq, digest) = before?;
        if line.seq > seq + 1 {
            Some(BreakKind::Removed(line.seq - seq - 1))
        } else {
            (line.previous != digest).then_some(BreakKind::Replaced)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Action, Event, EventKind};
    use crate::line::{Position, STOP, write};

    const PROCESS: &str = "20260101T000000Z-00000001";

    /// Six lines in one file: a start, four events and a stop.
    fn lines() -> Vec<String> {
        lines_in(&[1, 0, 0, 0, 0, 0])
    }

    /// The same, of which those with a number begin the file with it.
    fn lines_in(files: &[u32; 6]) -> Vec<String> {
        let mut at = Position::first();
        let mut files = files.iter();
        let objects = ["start", "a", "b", "c", "d", STOP];
        let lines = objects.map(|object| {
            let begins = files.next().copied().filter(|&file| file > 0);
            let kind = match object {
                STOP => EventKind::ApplicationActivity,
                _ => EventKind::Export,
            };
            let event = Event::new(kind, Action::Read, object, "somebody");
            let (line, next) = write(&event, None, PROCESS, &at, begins);
            at = next;
            String::from_utf8(line).unwrap()
        });
        lines.into()
    }

    fn found(files: &[(u32, String)]) -> (Vec<(usize, BreakKind)>, Verified) {
        let folder = tempfile::tempdir().unwrap();
        for (number, text) in files {
            let name = format!("{PROCESS}-{number:06}.jsonl");
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let mut verified = verify(folder.path()).unwrap();
        let breaks = std::mem::take(&mut verified.breaks).into_iter();
        (breaks.map(|one| (one.line, one.kind)).collect(), verified)
    }

    fn broken(lines: &[String]) -> Vec<(usize, BreakKind)> {
        found(&[(1, lines.concat())]).0
    }

    #[test]
    fn a_record_as_it_was_written_has_no_break_and_tells_its_last_line() {
        let all = lines_in(&[1, 0, 0, 2, 0, 0]);
        let (breaks, verified) = found(&[(1, all[..3].concat()), (2, all[3..].concat())]);
        assert_eq!(breaks, []);
        assert_eq!((verified.files, verified.lines), (2, 6));
        assert!(verified.notes.is_empty(), "{:?}", verified.notes);
        assert_eq!(verified.heads[0].seq, 6);
        assert!(all[5].contains(&verified.heads[0].digest));
    }

    #[test]
    fn a_changed_line_is_found() {
        let mut all = lines();
        all[2] = all[2].replace("somebody", "nobody");
        assert_eq!(broken(&all), [(3, BreakKind::Changed)]);
        // With a digest that fits again, the next line tells.
        let mut all = lines();
        let other = write(
            &Event::new(EventKind::Export, Action::Read, "b", "nobody"),
            None,
            PROCESS,
            &Position {
                seq: 3,
                previous: blake3::Hash::from_hex(digest_of(&all[1])).unwrap(),
            },
            None,
        );
        all[2] = String::from_utf8(other.0).unwrap();
        assert_eq!(broken(&all), [(4, BreakKind::Replaced)]);
    }

    fn digest_of(line: &str) -> String {
        read(line.trim_end().as_bytes()).unwrap().digest
    }

    #[test]
    fn a_removed_line_is_found() {
        let mut all = lines();
        all.remove(2);
        assert_eq!(broken(&all), [(3, BreakKind::Removed(1))]);
        all.remove(0);
        let at_the_start = [(1, BreakKind::Removed(1)), (2, BreakKind::Removed(1))];
        assert_eq!(broken(&all), at_the_start);
    }

    #[test]
    fn an_inserted_line_is_found() {
        let mut all = lines();
        all.insert(3, all[1].clone());
        assert_eq!(broken(&all), [(4, BreakKind::Inserted)]);
        let mut all = lines();
        all.insert(3, "{\"who\": \"me\"}\n".to_owned());
        assert_eq!(broken(&all), [(4, BreakKind::NotALine)]);
        let mut all = lines();
        all.swap(2, 3);
        assert_eq!(
            broken(&all),
            [(3, BreakKind::Removed(1)), (4, BreakKind::Inserted)]
        );
    }

    #[test]
    fn a_missing_end_is_found_as_far_as_it_can_be() {
        let all = lines();
        let half = &all[4][..all[4].len() / 2];
        let (breaks, verified) = found(&[(1, all[..4].concat() + half)]);
        assert_eq!(breaks, [(5, BreakKind::Truncated)]);
        assert_eq!(verified.notes.len(), 1);
        let (breaks, _) = found(&[(1, String::new())]);
        assert_eq!(breaks, [(1, BreakKind::Truncated)]);
        // Whole lines that are missing at the end leave the note alone, and a last line that is not the one that was kept.
        let (breaks, verified) = found(&[(1, all[..4].concat())]);
        assert_eq!(breaks, []);
        assert!(verified.notes[0].contains("has not stopped in order"));
        assert_eq!(verified.heads[0].seq, 4);
    }

    #[test]
    fn a_missing_file_is_found_unless_it_is_the_first() {
        let all = lines_in(&[1, 0, 2, 0, 3, 0]);
        let [one, two, three] = [0..2, 2..4, 4..6].map(|range| all[range].concat());
        let (breaks, _) = found(&[(1, one), (3, three.clone())]);
        assert_eq!(breaks, [(1, BreakKind::FileMissing(2))]);
        let (breaks, verified) = found(&[(2, two), (3, three)]);
        assert_eq!(breaks, []);
        assert!(verified.notes[0].contains("before 000002 are not here"));
    }

    #[test]
    fn a_cut_head_is_found_although_the_files_before_are_gone() {
        let all = lines_in(&[1, 0, 2, 0, 0, 0]);
        assert_eq!(found(&[(2, all[2..].concat())]).0, []);
        let (breaks, _) = found(&[(2, all[3..].concat())]);
        assert_eq!(breaks, [(1, BreakKind::Beheaded)]);
        let (breaks, _) = found(&[(7, all[2..].concat())]);
        assert_eq!(breaks, [(1, BreakKind::Renumbered(2))]);
    }
}
