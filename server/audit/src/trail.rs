//! Reading a record on while it is written, from a place that is kept: what is sent elsewhere.
//!
//! The files of all processes in the folder are read, those of processes that have ended too. Lines of one process come in their order.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::found::{Files, files_in};
use crate::line::read;
use crate::writer::{private, sync_folder};

/// What the files of a trail begin with, which are no files of the record.
const OWN: &str = "forwarded.";

/// The file with the places.
const KEPT: &str = "forwarded.json";

/// The same, before it is whole.
const NEW: &str = "forwarded.new";

/// The file that is locked by the process that reads.
const LOCK: &str = "forwarded.lock";

/// A line to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrailLine {
    /// The process that has written it.
    pub process: String,
    /// Its number in the chain of the process.
    pub seq: u64,
    /// When it was written, by RFC 3339.
    pub time: String,
    /// The DICOM name of its kind.
    pub name: String,
    /// How it ended.
    pub outcome: String,
    /// The whole line, without its end.
    pub json: String,
}

/// How far the files of one process were read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Place {
    /// The number of the file.
    file: u32,
    /// The bytes of it that were read.
    offset: u64,
    /// The number of the last line.
    seq: u64,
    /// Whether that was the last one of a process that stopped in order.
    is_stopped: bool,
}

/// How far the files of each process were read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Places(BTreeMap<String, Place>);

/// What a trail has read.
#[derive(Debug, Default)]
pub struct Passage {
    pub lines: Vec<TrailLine>,
    /// Lines that are not in the record any more, or never were whole.
    pub missing: u64,
}

/// Reads a record on. One process does at a time.
#[derive(Debug)]
pub struct Trail {
    folder: PathBuf,
    places: Places,
    /// Held as long as this exists.
    _lock: File,
}

impl Trail {
    /// Begins at the kept place; `None` if another process reads this record.
    ///
    /// # Errors
    /// If the folder cannot be read, or its kept place cannot be used.
    pub fn take(folder: &Path) -> io::Result<Option<Self>> {
        let lock = private()
            .create(true)
            .append(true)
            .open(folder.join(LOCK))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => return Err(error),
        }
        let places = match std::fs::read(folder.join(KEPT)) {
            Ok(text) => serde_json::from_slice(&text).map_err(|error| {
                let why = format!("{KEPT} cannot be understood ({error}); remove it to send the whole record again");
                io::Error::new(io::ErrorKind::InvalidData, why)
            })?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Places::default(),
            Err(error) => return Err(error),
        };
        Ok(Some(Self {
            folder: folder.to_owned(),
            places,
            _lock: lock,
        }))
    }

    /// How far it has read.
    pub fn places(&self) -> Places {
        self.places.clone()
    }

    /// Reads on from another place.
    pub fn go_to(&mut self, places: Places) {
        self.places = places;
    }

    /// Makes a place durable, from which the next process reads on.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&self, places: &Places) -> io::Result<()> {
        let new = self.folder.join(NEW);
        let mut file = private()
            .create(true)
            .write(true)
            .truncate(true)
            .open(&new)?;
        file.write_all(&serde_json::to_vec(places)?)?;
        file.sync_data()?;
        std::fs::rename(new, self.folder.join(KEPT))?;
        sync_folder(&self.folder)
    }

    /// The bytes that it has not read.
    ///
    /// # Errors
    /// If the folder or a file cannot be read.
    pub fn waiting_bytes(&self) -> io::Result<u64> {
        let mut waiting = 0;
        for (process, files) in files_in(&self.folder)?.0 {
            let place = self.places.0.get(&process).cloned().unwrap_or_default();
            for (_, path) in files.range(place.file..) {
                waiting += std::fs::metadata(path)?.len();
            }
            if files.contains_key(&place.file) {
                waiting = waiting.saturating_sub(place.offset);
            }
        }
        Ok(waiting)
    }

    /// Reads whole lines on, about so many bytes of one file at the most. Nothing is read if nothing was written since.
    ///
    /// # Errors
    /// If the folder or a file cannot be read.
    pub fn read_on(&mut self, bytes: u64) -> io::Result<Passage> {
        let mut passage = Passage::default();
        let (files, _) = files_in(&self.folder)?;
        self.forget_processes_without(&files);
        for (process, files) in &files {
            let place = self.places.0.entry(process.clone()).or_default();
            place.read_on(process, files, bytes, &mut passage)?;
            if !passage.lines.is_empty() {
                break;
            }
        }
        Ok(passage)
    }

    /// What was removed needs no place any more.
    fn forget_processes_without(&mut self, files: &Files) {
        self.places.0.retain(|process, place| {
            let is_there = files.contains_key(process);
            if !is_there && !place.is_stopped {
                tracing::warn!(
                    process,
                    seq = place.seq,
                    "the files of the audit record of a process were removed; lines after this one, if there were any, were not sent to the collector"
                );
            }
            is_there
        });
    }
}

impl Place {
    fn read_on(
        &mut self,
        process: &str,
        files: &BTreeMap<u32, PathBuf>,
        bytes: u64,
        passage: &mut Passage,
    ) -> io::Result<()> {
        // A folder may have the files of many processes that have ended.
        if self.is_stopped && files.range(self.file + 1..).next().is_none() {
            return Ok(());
        }
        loop {
            let Some(path) = files.get(&self.file) else {
                // What was missed between two files is known by the number of the next line.
                let Some((&next, _)) = files.range(self.file..).next() else {
                    return Ok(());
                };
                (self.file, self.offset) = (next, 0);
                continue;
            };
            let text = self.text(path, bytes)?;
            let whole = text.iter().rposition(|&byte| byte == b'\n');
            if let Some(end) = whole {
                self.offset += end as u64 + 1;
                for line in text[..end].split(|&byte| byte == b'\n') {
                    self.take(process, line, passage);
                }
                return Ok(());
            }
            // A later file is begun only when this one is written no more, though a last line may have come since this one was read.
            let has_later = files.range(self.file + 1..).next().is_some();
            if !has_later || !self.is_read(path, text.len())? {
                return Ok(());
            }
            self.file += 1;
            self.offset = 0;
        }
    }

    /// Whether a file has no more than these bytes beyond what was read.
    fn is_read(&self, path: &Path, further: usize) -> io::Result<bool> {
        Ok(std::fs::metadata(path)?.len() <= self.offset + further as u64)
    }

    /// What follows in a file, at least a whole line if there is one.
    fn text(&mut self, path: &Path, bytes: u64) -> io::Result<Vec<u8>> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        if length < self.offset {
            // Lines that could not be made durable were taken back, and some of them may have been sent.
            tracing::warn!("a file of the audit record is shorter than it was; it is sent again");
            self.offset = 0;
        }
        if length == self.offset {
            return Ok(Vec::new());
        }
        (&file).seek(SeekFrom::Start(self.offset))?;
        let mut text = Vec::new();
        loop {
            let read = (&file).take(bytes).read_to_end(&mut text)?;
            if read == 0 || text.contains(&b'\n') {
                return Ok(text);
            }
        }
    }

    fn take(&mut self, process: &str, line: &[u8], passage: &mut Passage) {
        let read = read(line).filter(|read| read.process == process);
        let (Some(read), Ok(json)) = (read, str::from_utf8(line)) else {
            tracing::error!(
                process,
                after = self.seq,
                "a line of the audit record is not as it was written; it is not sent to the collector"
            );
            passage.missing += 1;
            return;
        };
        if read.seq > self.seq + 1 {
            let missing = read.seq - self.seq - 1;
            tracing::error!(
                process,
                after = self.seq,
                missing,
                "lines of the audit record were removed before they were sent to the collector"
            );
            passage.missing += missing;
        }
        self.seq = read.seq;
        self.is_stopped = read.is_stop;
        passage.lines.push(TrailLine {
            process: read.process,
            seq: read.seq,
            time: read.time,
            name: read.name,
            outcome: read.outcome,
            json: json.to_owned(),
        });
    }
}

/// Whether this is the name of a file of a trail.
pub(crate) fn is_of_trail(name: &str) -> bool {
    name.starts_with(OWN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Action, Event, EventKind};
    use crate::verify::verify;
    use crate::writer::{Audit, Options};

    fn audit(folder: &Path, max_file_bytes: u64) -> Audit {
        Audit::start(Options {
            folder: folder.to_owned(),
            max_file_bytes,
            window: std::time::Duration::from_secs(300),
        })
        .unwrap()
    }

    /// A record of a process that has ended, with so many exports between its start and its stop.
    fn record(folder: &Path, exports: usize, max_file_bytes: u64) {
        let audit = audit(folder, max_file_bytes);
        for _ in 0..exports {
            let event = Event::new(EventKind::Export, Action::Read, "export", "ana");
            wait(audit.record_durable(event));
        }
        audit.shut_down();
    }

    fn trail(folder: &Path) -> Trail {
        Trail::take(folder).unwrap().unwrap()
    }

    /// All that there is to read, and the count of what is missing.
    fn rest(trail: &mut Trail) -> (Vec<u64>, u64) {
        let (mut seqs, mut missing) = (Vec::new(), 0);
        loop {
            let passage = trail.read_on(700).unwrap();
            missing += passage.missing;
            if passage.lines.is_empty() {
                return (seqs, missing);
            }
            seqs.extend(passage.lines.iter().map(|line| line.seq));
        }
    }

    fn first_to(last: u64) -> Vec<u64> {
        (1..=last).collect()
    }

    #[test]
    fn all_lines_come_once_in_their_order_through_all_files() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1000);
        let mut trail = trail(folder.path());
        assert_eq!(rest(&mut trail), (vec![1], 0));
        for _ in 0..20 {
            let event = Event::new(EventKind::Export, Action::Read, "export", "ana");
            wait(audit.record_durable(event));
        }
        assert!(trail.waiting_bytes().unwrap() > 5000);
        let (seqs, missing) = rest(&mut trail);
        assert_eq!((&seqs[..], missing), (&first_to(21)[1..], 0));
        assert_eq!(trail.waiting_bytes().unwrap(), 0);
        audit.shut_down();
        assert_eq!(rest(&mut trail), (vec![22], 0));
        let verified = verify(folder.path()).unwrap();
        assert!(
            verified.breaks.is_empty() && verified.notes.is_empty(),
            "{verified:?}"
        );
    }

    fn wait(recording: impl Future<Output = Result<(), crate::CannotRecord>>) {
        use std::pin::pin;
        use std::task::{Context, Poll, Waker};
        let mut recording = pin!(recording);
        loop {
            match recording
                .as_mut()
                .poll(&mut Context::from_waker(Waker::noop()))
            {
                Poll::Ready(done) => return done.unwrap(),
                Poll::Pending => std::thread::yield_now(),
            }
        }
    }

    #[test]
    fn the_next_one_reads_on_where_the_last_one_has_kept_its_place() {
        let folder = tempfile::tempdir().unwrap();
        record(folder.path(), 8, 1000);
        let mut first = trail(folder.path());
        assert!(
            Trail::take(folder.path()).unwrap().is_none(),
            "one at a time"
        );
        let two: Vec<_> = [700, 700]
            .map(|bytes| first.read_on(bytes).unwrap().lines)
            .concat();
        first.keep(&first.places()).unwrap();
        first.read_on(700).unwrap();
        drop(first);
        let mut second = trail(folder.path());
        let (seqs, missing) = rest(&mut second);
        assert_eq!((&seqs[..], missing), (&first_to(10)[two.len()..], 0));
        // Another process begins a chain of its own.
        record(folder.path(), 1, 1000);
        assert_eq!(rest(&mut second), (first_to(3), 0));
        drop(second);
        std::fs::write(folder.path().join(KEPT), "{").unwrap();
        let error = Trail::take(folder.path()).unwrap_err().to_string();
        assert!(error.contains("remove it"), "{error}");
        assert!(verify(folder.path()).unwrap().notes.is_empty());
    }

    #[test]
    fn what_is_removed_before_it_was_read_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        record(folder.path(), 8, 1000);
        let mut trail = trail(folder.path());
        let read = trail.read_on(700).unwrap().lines.len() as u64;
        let files: Vec<_> = files_in(folder.path()).unwrap().0.into_values().collect();
        let paths: Vec<_> = files[0].values().collect();
        assert!(paths.len() > 2);
        std::fs::remove_file(paths[0]).unwrap();
        std::fs::remove_file(paths[1]).unwrap();
        let (seqs, missing) = rest(&mut trail);
        assert_eq!(read + missing + seqs.len() as u64, 10);
        assert!(missing > 0 && seqs.last() == Some(&10));
        // What was read may go.
        paths[2..]
            .iter()
            .for_each(|path| std::fs::remove_file(path).unwrap());
        assert_eq!(rest(&mut trail), (vec![], 0));
        assert_eq!(trail.places(), Places::default());
    }

    #[test]
    fn what_was_never_a_line_is_counted_and_half_a_line_waits() {
        let folder = tempfile::tempdir().unwrap();
        record(folder.path(), 2, 1 << 20);
        let path = files_in(folder.path())
            .unwrap()
            .0
            .into_values()
            .next()
            .unwrap()[&1]
            .clone();
        let text = std::fs::read_to_string(&path).unwrap();
        let (start, others) = text.split_at(text.find('\n').unwrap() + 1);
        std::fs::write(
            &path,
            format!("{start}CANARY\n{}", &others[..others.len() - 1]),
        )
        .unwrap();
        let mut trail = trail(folder.path());
        assert_eq!(rest(&mut trail), (vec![1, 2, 3], 1));
        std::fs::write(&path, format!("{start}CANARY\n{others}")).unwrap();
        assert_eq!(rest(&mut trail), (vec![4], 0));
    }

    #[test]
    fn a_file_that_was_cut_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1 << 20);
        let event = Event::new(EventKind::Export, Action::Read, "export", "ana");
        wait(audit.record_durable(event));
        let path = files_in(folder.path())
            .unwrap()
            .0
            .into_values()
            .next()
            .unwrap()[&1]
            .clone();
        let mut trail = trail(folder.path());
        assert_eq!(rest(&mut trail), (first_to(2), 0));
        audit.shut_down();
        let text = std::fs::read_to_string(&path).unwrap();
        let cut = text.trim_end().rfind('\n').unwrap() + 1;
        let cut = text[..cut - 1].rfind('\n').unwrap() + 1;
        std::fs::write(&path, &text[..cut]).unwrap();
        assert_eq!(rest(&mut trail), (vec![1], 0));
    }
}
