//! Whether a record is as it was written.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::audit::line::{NO_DIGEST, Read, read};

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
    pub what: Cow<'static, str>,
}

impl fmt::Display for Break {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}: {}", self.file, self.line, self.what)
    }
}

/// Reads all files of a folder, and finds what was changed, removed or inserted.
///
/// # Errors
/// If the folder or a file cannot be read.
pub fn verify(folder: &Path) -> io::Result<Verified> {
    let mut verified = Verified::default();
    // The files of each process, by their numbers.
    let mut processes = BTreeMap::<_, BTreeMap<_, _>>::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match process_and_number(&name) {
            Some((process, number)) => {
                processes.entry(process).or_default().insert(number, path);
            }
            None => {
                let note = format!("{name} is no file of an audit record");
                verified.notes.push(note);
            }
        }
    }
    for (process, files) in &processes {
        verify_process(process, files, &mut verified)?;
    }
    Ok(verified)
}

/// The process and the number of a file of the record.
fn process_and_number(name: &str) -> Option<(String, u32)> {
    let (process, number) = name.strip_suffix(".jsonl")?.rsplit_once('-')?;
    Some((process.to_owned(), number.parse().ok()?))
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
    let last = files.keys().next_back();
    for (&number, path) in files {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let mut report = |line, what| {
            verified.breaks.push(Break {
                file: file.clone().into_owned(),
                line,
                what,
            });
        };
        let truncated = Cow::Borrowed("the end of the line is missing");
        if number > expected && expected > 1 {
            report(
                1,
                format!("the file {expected:06} before this one is missing").into(),
            );
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
        // A process that ended while it began a file has left the last one empty.
        if text.is_empty() && Some(&number) != last {
            report(1, truncated.clone());
        }
        for (at, line) in text.split_inclusive(|&byte| byte == b'\n').enumerate() {
            let Some(line) = line.strip_suffix(b"\n") else {
                report(at + 1, truncated.clone());
                continue;
            };
            verified.lines += 1;
            let Some(line) = read(line) else {
                report(at + 1, "not a line of an audit record".into());
                continue;
            };
            if line.process != process {
                report(at + 1, "the line is of another process".into());
                continue;
            }
            match (at, line.file) {
                // The first file begins with the first line of the process.
                (0, None) if number > 1 => {
                    report(1, "the beginning of the file is missing".into());
                }
                (_, Some(begun)) if begun != number => {
                    report(
                        at + 1,
                        format!("the file was begun as number {begun:06}").into(),
                    );
                }
                _ => {}
            }
            if let Some(what) = chain.follow(&line, begins_here) {
                report(at + 1, what);
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
    fn follow(&mut self, line: &Read, begins_here: bool) -> Option<Cow<'static, str>> {
        let before = match &self.last {
            Some((seq, digest)) => Some((*seq, digest.clone())),
            None => begins_here.then(|| (0, NO_DIGEST.to_hex().to_string())),
        };
        if let Some((seq, _)) = before
            && line.seq <= seq
        {
            return Some("the line was inserted or repeated".into());
        }
        self.last = Some((line.seq, line.digest.clone()));
        self.is_stopped = line.is_stop;
        if !line.is_sound {
            return Some("the line was changed".into());
        }
        let (seq, digest) = before?;
        match line.seq - seq - 1 {
            0 if line.previous == digest => None,
            0 => Some("the line before this one was replaced".into()),
            1 => Some("a line before this one was removed".into()),
            count => Some(format!("{count} lines before this one were removed").into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::event::{Action, Event, EventKind};
    use crate::audit::line::{Position, STOP, write};

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
            let (line, next) = write(&event, PROCESS, &at, begins);
            at = next;
            String::from_utf8(line).unwrap()
        });
        lines.into()
    }

    fn found(files: &[(u32, String)]) -> (Vec<String>, Verified) {
        let folder = tempfile::tempdir().unwrap();
        for (number, text) in files {
            let name = format!("{PROCESS}-{number:06}.jsonl");
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let mut verified = verify(folder.path()).unwrap();
        let breaks = std::mem::take(&mut verified.breaks).into_iter();
        let breaks = breaks.map(|one| format!("{}: {}", one.line, one.what));
        (breaks.collect(), verified)
    }

    fn broken(lines: &[String]) -> Vec<String> {
        found(&[(1, lines.concat())]).0
    }

    #[test]
    fn a_record_as_it_was_written_has_no_break_and_tells_its_last_line() {
        let all = lines_in(&[1, 0, 0, 2, 0, 0]);
        let (breaks, verified) = found(&[(1, all[..3].concat()), (2, all[3..].concat())]);
        assert_eq!(breaks, [""; 0]);
        assert_eq!((verified.files, verified.lines), (2, 6));
        assert!(verified.notes.is_empty(), "{:?}", verified.notes);
        assert_eq!(verified.heads[0].seq, 6);
        assert!(all[5].contains(&verified.heads[0].digest));
    }

    #[test]
    fn a_changed_line_is_found() {
        let mut all = lines();
        all[2] = all[2].replace("somebody", "nobody");
        assert_eq!(broken(&all), ["3: the line was changed"]);
        // With a digest that fits again, the next line tells.
        let mut all = lines();
        let other = write(
            &Event::new(EventKind::Export, Action::Read, "b", "nobody"),
            PROCESS,
            &Position {
                seq: 3,
                previous: blake3::Hash::from_hex(digest_of(&all[1])).unwrap(),
            },
            None,
        );
        all[2] = String::from_utf8(other.0).unwrap();
        assert_eq!(broken(&all), ["4: the line before this one was replaced"]);
    }

    fn digest_of(line: &str) -> String {
        read(line.trim_end().as_bytes()).unwrap().digest
    }

    #[test]
    fn a_removed_line_is_found() {
        let mut all = lines();
        all.remove(2);
        assert_eq!(broken(&all), ["3: a line before this one was removed"]);
        all.remove(0);
        let at_the_start = [
            "1: a line before this one was removed",
            "2: a line before this one was removed",
        ];
        assert_eq!(broken(&all), at_the_start);
    }

    #[test]
    fn an_inserted_line_is_found() {
        let mut all = lines();
        all.insert(3, all[1].clone());
        assert_eq!(broken(&all), ["4: the line was inserted or repeated"]);
        let mut all = lines();
        all.insert(3, "{\"who\": \"me\"}\n".to_owned());
        assert_eq!(broken(&all), ["4: not a line of an audit record"]);
        let mut all = lines();
        all.swap(2, 3);
        assert_eq!(
            broken(&all),
            [
                "3: a line before this one was removed",
                "4: the line was inserted or repeated"
            ]
        );
    }

    #[test]
    fn a_missing_end_is_found_as_far_as_it_can_be() {
        let all = lines();
        let half = &all[4][..all[4].len() / 2];
        let (breaks, verified) = found(&[(1, all[..4].concat() + half)]);
        assert_eq!(breaks, ["5: the end of the line is missing"]);
        assert_eq!(verified.notes.len(), 1);
        // Whole lines that are missing at the end leave the note alone, and a last line that is not the one that was kept.
        let (breaks, verified) = found(&[(1, all[..4].concat())]);
        assert_eq!(breaks, [""; 0]);
        assert!(verified.notes[0].contains("has not stopped in order"));
        assert_eq!(verified.heads[0].seq, 4);
    }

    #[test]
    fn an_empty_file_is_the_last_one_of_a_process_that_was_killed_or_a_break() {
        let all = lines_in(&[1, 0, 2, 0, 0, 0]);
        let [one, two] = [all[..2].concat(), all[2..].concat()];
        let (breaks, verified) = found(&[(1, one), (2, String::new())]);
        assert_eq!(breaks, [""; 0]);
        assert!(verified.notes[0].contains("has not stopped in order"));
        assert_eq!(found(&[(1, String::new())]).0, [""; 0]);
        let (breaks, _) = found(&[(1, String::new()), (2, two)]);
        assert_eq!(breaks, ["1: the end of the line is missing"]);
    }

    #[test]
    fn a_missing_file_is_found_unless_it_is_the_first() {
        let all = lines_in(&[1, 0, 2, 0, 3, 0]);
        let [one, two, three] = [0..2, 2..4, 4..6].map(|range| all[range].concat());
        let (breaks, _) = found(&[(1, one), (3, three.clone())]);
        assert_eq!(breaks, ["1: the file 000002 before this one is missing"]);
        let (breaks, verified) = found(&[(2, two), (3, three)]);
        assert_eq!(breaks, [""; 0]);
        assert!(verified.notes[0].contains("before 000002 are not here"));
    }

    #[test]
    fn a_file_of_something_else_is_a_note() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("old.txt"), "").unwrap();
        let verified = verify(folder.path()).unwrap();
        assert_eq!((verified.files, verified.breaks.len()), (0, 0));
        assert_eq!(verified.notes, ["old.txt is no file of an audit record"]);
    }

    #[test]
    fn a_cut_head_is_found_although_the_files_before_are_gone() {
        let all = lines_in(&[1, 0, 2, 0, 0, 0]);
        assert_eq!(found(&[(2, all[2..].concat())]).0, [""; 0]);
        let (breaks, _) = found(&[(2, all[3..].concat())]);
        assert_eq!(breaks, ["1: the beginning of the file is missing"]);
        let (breaks, _) = found(&[(7, all[2..].concat())]);
        assert_eq!(breaks, ["1: the file was begun as number 000002"]);
    }
}
