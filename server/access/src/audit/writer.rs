//! The thread that writes events, and the handle for those who record them.

use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::hash::{BuildHasher as _, RandomState};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use futures_channel::oneshot;
use jiff::Timestamp;
use serde::Deserialize;

use crate::audit::event::{Action, Event, EventKind};
use crate::audit::line::{Position, STOP, write};

/// Events that may wait for the disk. Beyond this it counts as full.
const WAITING: usize = 4096;

/// The size beyond which another file is begun, in bytes.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// How often a disk that is full is tried again.
const TICK: Duration = Duration::from_secs(1);

/// What was looked at today is remembered up to this number; beyond it, lines of today are repeated.
const LOOKED_AT: usize = 1 << 16;

/// Seconds of a day.
const DAY: i64 = 86_400;

/// Where and how events are recorded; `[audit]` of the configuration.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// The folder of the files, which must exist. Without one, nothing is recorded.
    pub folder: Option<PathBuf>,
}

/// An event cannot be recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the audit record cannot be written")]
pub struct CannotRecord;

/// Records events; without a folder it records nothing. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Audit(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    sender: SyncSender<Message>,
    /// The last attempt to write has failed.
    is_full: Arc<AtomicBool>,
    /// Held for moments.
    looked_at: Mutex<LookedAt>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// Who has looked at what on a day: what events of this day say but for their times and addresses.
#[derive(Debug, Default)]
struct LookedAt {
    day: i64,
    events: HashSet<Daily>,
}

/// What makes two events of a day one.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Daily {
    object: &'static str,
    who: Arc<str>,
    case: Option<Arc<str>>,
    study: Option<Arc<str>>,
}

#[derive(Debug)]
enum Message {
    Record(Box<Waiting>),
    Stop,
}

/// An event that is not written yet.
#[derive(Debug)]
struct Waiting {
    event: Event,
    done: Option<oneshot::Sender<()>>,
}

impl Audit {
    /// Begins a record in files of its own, if there is a folder for it.
    ///
    /// # Errors
    /// If a file cannot be made in the folder.
    pub fn start(options: Options) -> io::Result<Self> {
        match options.folder {
            Some(folder) => Self::start_in(folder, MAX_FILE_BYTES),
            None => Ok(Self::default()),
        }
    }

    fn start_in(folder: PathBuf, max_file_bytes: u64) -> io::Result<Self> {
        let is_full = Arc::new(AtomicBool::new(false));
        let writer = Writer::start(folder, max_file_bytes, is_full.clone())?;
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name("audit".to_owned());
        let thread = thread.spawn(move || writer.run(&receiver))?;
        Ok(Self(Some(Arc::new(Inner {
            sender,
            is_full,
            looked_at: Mutex::default(),
            thread: Mutex::new(Some(thread)),
        }))))
    }

    /// Whether the last event could not be written. What must be recorded must not be done then.
    pub fn is_full(&self) -> bool {
        let inner = self.0.as_ref();
        inner.is_some_and(|inner| inner.is_full.load(Ordering::Acquire))
    }

    /// Resolves once an event is on the disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub async fn record(&self, event: Event) -> Result<(), CannotRecord> {
        let Some(inner) = &self.0 else {
            return Ok(());
        };
        if self.is_full() {
            return Err(CannotRecord);
        }
        let (done, written) = oneshot::channel();
        let waiting = Waiting {
            event,
            done: Some(done),
        };
        let sent = inner.sender.try_send(Message::Record(Box::new(waiting)));
        sent.map_err(|_| CannotRecord)?;
        written.await.map_err(|_dropped| CannotRecord)
    }

    /// Resolves once this event, or one of the same person about the same case, is on the disk with the date of today (UTC).
    ///
    /// # Errors
    /// If it cannot be written.
    pub async fn record_daily(&self, event: Event) -> Result<(), CannotRecord> {
        let Some(inner) = &self.0 else {
            return Ok(());
        };
        let daily = Daily {
            object: event.object,
            who: event.who.clone(),
            case: event.case.clone(),
            study: event.study.clone(),
        };
        if inner.looked_at_today().events.contains(&daily) {
            return Ok(());
        }
        self.record(event).await?;
        inner.looked_at_today().events.insert(daily);
        Ok(())
    }

    /// Writes what waits, and the last line. Later events cannot be recorded.
    pub fn shut_down(&self) {
        let Some(inner) = &self.0 else {
            return;
        };
        let mut thread = inner.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thread) = thread.take() {
            // An error of either means that the thread has ended.
            let _ = inner.sender.send(Message::Stop);
            let _ = thread.join();
        }
    }
}

impl Inner {
    fn looked_at_today(&self) -> MutexGuard<'_, LookedAt> {
        let today = Timestamp::now().as_second().div_euclid(DAY);
        let looked_at = self.looked_at.lock();
        let mut looked_at = looked_at.unwrap_or_else(PoisonError::into_inner);
        looked_at.of_day(today);
        looked_at
    }
}

impl LookedAt {
    /// Forgets what is of another day, and everything if there is too much.
    fn of_day(&mut self, day: i64) {
        if self.day != day || self.events.len() >= LOOKED_AT {
            self.day = day;
            self.events.clear();
        }
    }
}

#[derive(Debug)]
struct Writer {
    folder: PathBuf,
    max_file_bytes: u64,
    process: String,
    is_full: Arc<AtomicBool>,
    file: File,
    number: u32,
    /// The bytes of whole lines in the file.
    length: u64,
    at: Position,
    waiting: Vec<Waiting>,
}

impl Writer {
    fn start(folder: PathBuf, max_file_bytes: u64, is_full: Arc<AtomicBool>) -> io::Result<Self> {
        let began = Timestamp::now().strftime("%Y%m%dT%H%M%SZ");
        let process = format!("{began}-{:08x}", RandomState::new().hash_one(0) as u32);
        let number = 1;
        let mut writer = Self {
            file: make_file(&folder, &process, number)?,
            folder,
            max_file_bytes,
            process,
            is_full,
            number,
            length: 0,
            at: Position::first(),
            waiting: Vec::new(),
        };
        writer.append(&[activity("start")])?;
        Ok(writer)
    }

    fn run(mut self, receiver: &Receiver<Message>) {
        loop {
            let next = match self.is_full.load(Ordering::Relaxed) {
                false => receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
                true => receiver.recv_timeout(TICK),
            };
            let mut goes_on = match next {
                Ok(message) => self.take(message),
                Err(RecvTimeoutError::Timeout) => true,
                Err(RecvTimeoutError::Disconnected) => false,
            };
            // Whatever came while the disk was busy is written at once.
            while goes_on && let Ok(message) = receiver.try_recv() {
                goes_on = self.take(message);
            }
            if !goes_on {
                self.waiting.push(activity(STOP));
            }
            self.flush();
            if !goes_on {
                return;
            }
        }
    }

    /// Takes a message; `false` if it is the last one.
    fn take(&mut self, message: Message) -> bool {
        match message {
            Message::Record(waiting) => {
                self.waiting.push(*waiting);
                true
            }
            Message::Stop => false,
        }
    }

    /// Writes what waits. If the disk is full, each call tries again, and those who wait get an error.
    fn flush(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        if self.is_full.load(Ordering::Relaxed) {
            drop(waiting);
            if self.append(&[activity("recorded again")]).is_ok() {
                tracing::info!("the audit record is written again");
                self.is_full.store(false, Ordering::Release);
            }
            return;
        }
        if waiting.is_empty() {
            return;
        }
        match self.append(&waiting) {
            Ok(()) => {
                for done in waiting.into_iter().filter_map(|waiting| waiting.done) {
                    // Nobody may wait any more.
                    let _ = done.send(());
                }
            }
            Err(error) => {
                tracing::error!(
                    %error,
                    "the audit record cannot be written; what it must name is answered 507 until it can"
                );
                // Before those that wait hear it, because what they wait for is dropped.
                self.is_full.store(true, Ordering::Release);
            }
        }
    }

    /// Appends lines in one piece, and makes them durable. If that fails, the chain goes on as if they had never been.
    fn append(&mut self, waiting: &[Waiting]) -> io::Result<()> {
        if self.is_gone()? {
            self.begin_file()?;
        } else if self.length >= self.max_file_bytes
            && let Err(error) = self.begin_file()
        {
            // If there is no room for another file, this one grows.
            tracing::warn!(%error, "another file of the audit record cannot be begun");
        }
        let (mut lines, mut at) = (Vec::new(), self.at.clone());
        for one in waiting {
            let begins = (self.length == 0 && lines.is_empty()).then_some(self.number);
            let (line, next) = write(&one.event, &self.process, &at, begins);
            lines.extend(line);
            at = next;
        }
        let written = self.file.write_all(&lines);
        let written = written.and_then(|()| self.file.sync_data());
        if let Err(error) = written {
            // Half a line would look like damage. If this fails too, the line is written again behind it.
            let _ = self.file.set_len(self.length);
            return Err(error);
        }
        self.length += lines.len() as u64;
        self.at = at;
        Ok(())
    }

    /// Goes on in another file, which gets its first line at once.
    fn begin_file(&mut self) -> io::Result<()> {
        self.file = make_file(&self.folder, &self.process, self.number + 1)?;
        self.number += 1;
        self.length = 0;
        Ok(())
    }

    /// Whether the file was deleted, or moved with its folder, while it was open.
    fn is_gone(&self) -> io::Result<bool> {
        use std::os::unix::fs::MetadataExt as _;
        let ours = self.file.metadata()?;
        let path = path_of(&self.folder, &self.process, self.number);
        let there = std::fs::symlink_metadata(path);
        Ok(!there.is_ok_and(|there| (there.dev(), there.ino()) == (ours.dev(), ours.ino())))
    }
}

/// An event of the record itself.
fn activity(object: &'static str) -> Waiting {
    let kind = EventKind::ApplicationActivity;
    Waiting {
        event: Event::new(kind, Action::Execute, object, "isocortex"),
        done: None,
    }
}

fn path_of(folder: &Path, process: &str, number: u32) -> PathBuf {
    folder.join(format!("{process}-{number:06}.jsonl"))
}

/// Makes the file of a process with a number, for appending by its owner alone.
fn make_file(folder: &Path, process: &str, number: u32) -> io::Result<File> {
    let path = path_of(folder, process, number);
    let file = private().append(true).create_new(true).open(path)?;
    sync_folder(folder)?;
    Ok(file)
}

fn private() -> OpenOptions {
    let mut options = OpenOptions::new();
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Makes the name of a new file durable.
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Checks that a file can be made in a folder, and makes none that stays.
///
/// # Errors
/// If there is no such folder, or nothing can be written in it.
pub fn check_folder(folder: &Path) -> io::Result<()> {
    let trial = folder.join(format!(".trial-{}", std::process::id()));
    private().write(true).create_new(true).open(&trial)?;
    std::fs::remove_file(trial)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::verify;

    fn audit(folder: &Path, max_file_bytes: u64) -> Audit {
        Audit::start_in(folder.to_owned(), max_file_bytes).unwrap()
    }

    fn event(object: &'static str) -> Event {
        Event::new(
            EventKind::InstancesAccessed,
            Action::Read,
            object,
            "somebody",
        )
    }

    fn lines(folder: &Path) -> Vec<serde_json::Value> {
        let files = std::fs::read_dir(folder).unwrap();
        let mut files: Vec<_> = files.map(|file| file.unwrap().path()).collect();
        files.sort();
        let texts = files
            .iter()
            .map(|file| std::fs::read_to_string(file).unwrap());
        let all: String = texts.collect();
        let lines = all.lines().map(serde_json::from_str);
        lines.map(Result::unwrap).collect()
    }

    /// Waits without a runtime.
    fn wait<T>(future: impl Future<Output = T>) -> T {
        let mut future = std::pin::pin!(future);
        let mut context = std::task::Context::from_waker(std::task::Waker::noop());
        loop {
            if let std::task::Poll::Ready(value) = future.as_mut().poll(&mut context) {
                return value;
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn a_durable_event_is_in_the_file_once_it_is_awaited() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1 << 20);
        wait(audit.record(event("export"))).unwrap();
        assert_eq!(lines(folder.path())[1]["object"], "export");
        audit.shut_down();
        assert!(wait(audit.record(event("later"))).is_err());
    }

    #[test]
    fn who_looks_at_a_case_has_one_line_a_day() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1 << 20);
        let looks_at = |case: &str| Event {
            case: Some(case.into()),
            ..event("case")
        };
        for case in ["1", "1", "2", "1"] {
            wait(audit.record_daily(looks_at(case))).unwrap();
        }
        // Of yesterday.
        let inner = audit.0.as_ref().unwrap();
        inner.looked_at.lock().unwrap().day -= 1;
        wait(audit.record_daily(looks_at("1"))).unwrap();
        audit.shut_down();
        assert!(wait(audit.record_daily(looks_at("3"))).is_err());
        let lines = lines(folder.path());
        let cases: Vec<_> = lines
            .iter()
            .filter_map(|line| line["case"].as_str())
            .collect();
        assert_eq!(cases, ["1", "2", "1"]);
    }

    #[test]
    fn the_memory_of_a_day_is_bounded() {
        let mut looked_at = LookedAt::default();
        let daily = |number: usize| Daily {
            object: "case",
            who: "somebody".into(),
            case: Some(number.to_string().into()),
            study: None,
        };
        looked_at.events.extend((0..LOOKED_AT - 1).map(daily));
        looked_at.of_day(0);
        assert_eq!(looked_at.events.len(), LOOKED_AT - 1);
        looked_at.events.insert(daily(LOOKED_AT));
        looked_at.of_day(0);
        assert!(looked_at.events.is_empty());
    }

    #[test]
    fn a_record_is_whole_after_each_event_and_a_file_begins_with_its_first_line() {
        let folder = tempfile::tempdir().unwrap();
        let first = audit(folder.path(), 3000);
        for _ in 0..60 {
            wait(first.record(event("export"))).unwrap();
            let verified = verify(folder.path()).unwrap();
            assert_eq!(verified.breaks, []);
            for file in std::fs::read_dir(folder.path()).unwrap() {
                assert!(file.unwrap().metadata().unwrap().len() > 0);
            }
        }
        assert!(verify(folder.path()).unwrap().files > 5);
        // As if it were killed between the file and its first line.
        let all = verify(folder.path()).unwrap();
        let process = &all.heads[0].process;
        let next = path_of(folder.path(), process, all.files as u32 + 1);
        std::fs::write(next, "").unwrap();
        assert_eq!(verify(folder.path()).unwrap().breaks, []);
        let later = audit(folder.path(), 3000);
        later.shut_down();
        assert_eq!(verify(folder.path()).unwrap().breaks, []);
    }

    #[test]
    fn a_file_that_is_large_is_followed_by_another_in_the_same_chain() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1000);
        for _ in 0..20 {
            wait(audit.record(event("export"))).unwrap();
        }
        audit.shut_down();
        let verified = verify(folder.path()).unwrap();
        assert!(
            verified.files > 5 && verified.breaks.is_empty(),
            "{verified:?}"
        );
        assert_eq!(verified.lines, 22);
    }

    #[test]
    fn files_are_for_their_owner_alone() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let _audit = audit(folder.path(), 1000);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap();
        let mode = file.unwrap().metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn where_nothing_can_be_written_it_says_so_until_something_can() {
        let outer = tempfile::tempdir().unwrap();
        let (folder, away) = (outer.path().join("audit"), outer.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        check_folder(&folder).unwrap();
        let audit = audit(&folder, 1 << 20);
        std::fs::rename(&folder, &away).unwrap();
        std::fs::remove_dir_all(&away).unwrap();
        assert_eq!(wait(audit.record(event("export"))), Err(CannotRecord));
        assert!(audit.is_full() && wait(audit.record(event("export"))).is_err());
        assert!(check_folder(&folder).is_err());
        std::fs::create_dir(&folder).unwrap();
        while audit.is_full() {
            std::thread::yield_now();
        }
        wait(audit.record(event("export"))).unwrap();
        let lines = lines(&folder);
        assert_eq!(lines[0]["object"], "recorded again");
        assert_eq!(lines[1]["object"], "export");
        audit.shut_down();
        assert!(verify(&folder).unwrap().breaks.is_empty());
    }

    #[test]
    fn a_folder_that_was_renamed_gets_no_more_lines_and_the_one_in_its_place_does() {
        let outer = tempfile::tempdir().unwrap();
        let (folder, away) = (outer.path().join("audit"), outer.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        let audit = audit(&folder, 1 << 20);
        wait(audit.record(event("export"))).unwrap();
        std::fs::rename(&folder, &away).unwrap();
        assert_eq!(wait(audit.record(event("export"))), Err(CannotRecord));
        std::fs::create_dir(&folder).unwrap();
        while audit.is_full() {
            std::thread::yield_now();
        }
        audit.shut_down();
        assert_eq!(lines(&away).len(), 2);
        assert_eq!(lines(&folder)[0]["object"], "recorded again");
        // Together they are the whole record.
        for file in std::fs::read_dir(&away).unwrap() {
            let file = file.unwrap();
            std::fs::rename(file.path(), folder.join(file.file_name())).unwrap();
        }
        let verified = verify(&folder).unwrap();
        assert!(
            verified.breaks.is_empty() && verified.notes.is_empty(),
            "{verified:?}"
        );
        assert_eq!(verified.lines, 4);
    }

    #[test]
    fn without_a_folder_nothing_is_recorded_and_nothing_refused() {
        let audit = Audit::default();
        wait(audit.record_daily(event("case"))).unwrap();
        wait(audit.record(event("export"))).unwrap();
        assert!(!audit.is_full());
        audit.shut_down();
    }
}
