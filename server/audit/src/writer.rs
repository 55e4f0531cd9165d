//! The thread that writes events, and the handle for those who record them.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::hash::{BuildHasher as _, RandomState};
use std::io::{self, Write as _};
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use futures_channel::oneshot;
use jiff::Timestamp;

use crate::bounded::{Bounded, Key};
use crate::event::{Action, Event, EventKind, Outcome};
use crate::found::others;
use crate::line::{Begins, Position, STOP, write};

/// Events of one kind by one person about one case within this time are one event with a count.
pub const WINDOW: Duration = Duration::from_secs(300);

/// Events that may wait for the disk. Beyond this it counts as full.
const WAITING: usize = 4096;

/// Events that are counted at a time; beyond this, each has a line of its own.
const COUNTED: usize = 4096;

/// How often a disk that is full is tried again, and windows are looked at.
const TICK: Duration = Duration::from_secs(1);

/// Where and how events are recorded.
#[derive(Debug, Clone)]
pub struct Options {
    /// The folder of the files. It must exist.
    pub folder: PathBuf,
    /// The size beyond which another file is begun, in bytes.
    pub max_file_bytes: u64,
    /// How long events of one kind are one event with a count; usually [`WINDOW`].
    pub window: Duration,
}

/// An event cannot be recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the audit record cannot be written")]
pub struct CannotRecord;

/// Records events; without options it records nothing. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Audit(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    sender: SyncSender<Message>,
    /// The last attempt to write has failed.
    is_full: Arc<AtomicBool>,
    /// Held for moments.
    bounded: Mutex<Bounded>,
    counted: Arc<AllCounted>,
    thread: Mutex<Option<JoinHandle<()>>>,
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
    /// Whether it is counted together with those like it.
    is_counted: bool,
    /// The line of its start, if this is its count.
    first: Option<u64>,
    done: Option<oneshot::Sender<()>>,
}

impl Waiting {
    fn of(event: Event) -> Self {
        Self {
            event,
            is_counted: false,
            first: None,
            done: None,
        }
    }
}

impl Audit {
    /// Begins a record in files of its own.
    ///
    /// # Errors
    /// If a file cannot be made in the folder.
    pub fn start(options: Options) -> io::Result<Self> {
        let is_full = Arc::new(AtomicBool::new(false));
        let counted = Arc::new(AllCounted::default());
        let writer = Writer::start(options, is_full.clone(), Arc::clone(&counted))?;
        let (sender, receiver) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name("audit".to_owned());
        let thread = thread.spawn(move || writer.run(&receiver))?;
        Ok(Self(Some(Arc::new(Inner {
            sender,
            is_full,
            bounded: Mutex::new(Bounded::new()),
            counted,
            thread: Mutex::new(Some(thread)),
        }))))
    }

    /// Whether the last event could not be written. What must be recorded must not be done then.
    pub fn is_full(&self) -> bool {
        let inner = self.0.as_ref();
        inner.is_some_and(|inner| inner.is_full.load(Ordering::Acquire))
    }

    /// Records an event within a second.
    ///
    /// # Errors
    /// If nothing can be recorded at the moment.
    pub fn record(&self, event: Event) -> Result<(), CannotRecord> {
        self.send(Waiting::of(event))
    }

    /// Records an event within a second, unless one like it was recorded in the last five minutes: then it is counted, and a second
    /// line with the count follows at their end.
    ///
    /// # Errors
    /// If nothing can be recorded at the moment.
    pub fn record_counted(&self, event: Event) -> Result<(), CannotRecord> {
        // Most are only counted, which the writer need not be woken for.
        if let Some(inner) = &self.0
            && !self.is_full()
            && inner.counted.add(&event)
        {
            return Ok(());
        }
        self.send(Waiting {
            is_counted: true,
            ..Waiting::of(event)
        })
    }

    /// Resolves once an event is on the disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub async fn record_durable(&self, event: Event) -> Result<(), CannotRecord> {
        if self.0.is_none() {
            return Ok(());
        }
        let (done, written) = oneshot::channel();
        self.send(Waiting {
            done: Some(done),
            ..Waiting::of(event)
        })?;
        written.await.map_err(|_dropped| CannotRecord)
    }

    /// Records a refusal durably, if it is to be recorded: of many that are alike, ever fewer are. Its count is that of those that are alike
    /// since one of them was last recorded; those that nobody has repeated for a while have a line together. A refusal stays one if it
    /// cannot be recorded.
    pub async fn record_refusal(&self, mut event: Event) {
        let Some(inner) = &self.0 else {
            return;
        };
        let due = inner.bounded().refusal(key_of(&event), Instant::now());
        if let Some(due) = due {
            if due.others > 0 {
                let _ = self.record(other_refusals(due.others));
            }
            event.count = due.own;
            let _ = self.record_durable(event).await;
        }
    }

    /// Whether events like this one have failed so often in a row that they are counted ([`Audit::record_counted`]) until one succeeds.
    pub fn is_failing(&self, event: &Event) -> bool {
        let inner = self.0.as_ref();
        inner.is_some_and(|inner| inner.bounded().fails(&key_of(event), Instant::now()))
    }

    /// Notes how an event ended, for [`Audit::is_failing`].
    pub fn note_end(&self, event: &Event) {
        if let Some(inner) = &self.0 {
            let is_success = event.outcome == Outcome::Success;
            let mut bounded = inner.bounded();
            bounded.ended(key_of(event), is_success, Instant::now());
        }
    }

    /// Records durably that somebody has signed in, if the last request with this name from this address was half a day ago.
    ///
    /// # Errors
    /// If it cannot be written.
    pub async fn record_sign_in(&self, event: Event) -> Result<(), CannotRecord> {
        let Some(inner) = &self.0 else {
            return Ok(());
        };
        let key = key_of(&event);
        if !inner.bounded().is_sign_in(key.clone(), Instant::now()) {
            return Ok(());
        }
        let recorded = self.record_durable(event).await;
        if recorded.is_err() {
            inner.bounded().sign_out(&key);
        }
        recorded
    }

    /// Writes what waits, and the last line. Later events cannot be recorded.
    pub fn shut_down(&self) {
        let Some(inner) = &self.0 else {
            return;
        };
        let rest = inner.bounded().rest();
        if rest > 0 {
            let _ = self.record(other_refusals(rest));
        }
        let mut thread = inner.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thread) = thread.take() {
            // An error of either means that the thread has ended.
            let _ = inner.sender.send(Message::Stop);
            let _ = thread.join();
        }
    }

    fn send(&self, waiting: Waiting) -> Result<(), CannotRecord> {
        let Some(inner) = &self.0 else {
            return Ok(());
        };
        if self.is_full() {
            return Err(CannotRecord);
        }
        let sent = inner.sender.try_send(Message::Record(Box::new(waiting)));
        sent.map_err(|_| CannotRecord)
    }
}

/// Refusals that are too few, or too many, for lines of their own.
fn other_refusals(count: u64) -> Event {
    let kind = EventKind::SecurityAlert;
    Event {
        outcome: Outcome::MinorFailure,
        count,
        ..Event::new(kind, Action::Execute, "other refusals", "isocortex")
    }
}

fn key_of(event: &Event) -> Key {
    (event.who.clone(), event.from, event.object)
}

impl Inner {
    fn bounded(&self) -> MutexGuard<'_, Bounded> {
        self.bounded.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What makes two events one.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Alike {
    kind: EventKind,
    action: Action,
    outcome: Outcome,
    object: &'static str,
    who: Arc<str>,
    from: Option<IpAddr>,
    case: Option<Arc<str>>,
    study: Option<Arc<str>>,
}

impl Alike {
    fn of(event: &Event) -> Self {
        Self {
            kind: event.kind,
            action: event.action,
            outcome: event.outcome,
            object: event.object,
            who: event.who.clone(),
            from: event.from,
            case: event.case.clone(),
            study: event.study.clone(),
        }
    }
}

/// Events that are counted.
#[derive(Debug)]
struct Counted {
    event: Event,
    /// The line of the first, once it is written.
    first: u64,
    since: Instant,
}

/// All events that are counted, since the first of each was given to the writer. Held for moments.
#[derive(Debug, Default)]
struct AllCounted(Mutex<HashMap<Alike, Counted>>);

impl AllCounted {
    fn lock(&self) -> MutexGuard<'_, HashMap<Alike, Counted>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts an event, unless it is the first of its kind.
    fn add(&self, event: &Event) -> bool {
        let mut counted = self.lock();
        let known = counted.get_mut(&Alike::of(event));
        if let Some(known) = known {
            known.event.count += event.count;
            return true;
        }
        false
    }

    /// Begins to count events like one, whose line is the first of them, unless there are too many.
    fn begin(&self, event: &Event, first: u64) {
        let mut counted = self.lock();
        if counted.len() < COUNTED {
            let begun = Counted {
                event: event.clone(),
                first,
                since: Instant::now(),
            };
            counted.insert(Alike::of(event), begun);
        }
    }
}

#[derive(Debug)]
struct Writer {
    options: Options,
    process: String,
    is_full: Arc<AtomicBool>,
    file: File,
    number: u32,
    /// The bytes of whole lines in the file.
    length: u64,
    at: Position,
    counted: Arc<AllCounted>,
    waiting: Vec<Waiting>,
    /// Events that could not be written.
    lost: u64,
}

impl Writer {
    fn start(
        options: Options,
        is_full: Arc<AtomicBool>,
        counted: Arc<AllCounted>,
    ) -> io::Result<Self> {
        let began = Timestamp::now().strftime("%Y%m%dT%H%M%SZ");
        let process = format!("{began}-{:08x}", RandomState::new().hash_one(0) as u32);
        let number = 1;
        let mut writer = Self {
            file: make_file(&options.folder, &process, number)?,
            options,
            process,
            is_full,
            number,
            length: 0,
            at: Position::first(),
            counted,
            waiting: Vec::new(),
            lost: 0,
        };
        writer.append(&[Waiting::of(writer.activity("start"))])?;
        Ok(writer)
    }

    /// An event of the record itself.
    fn activity(&self, object: &'static str) -> Event {
        Event::new(
            EventKind::ApplicationActivity,
            Action::Execute,
            object,
            "isocortex",
        )
    }

    fn run(mut self, receiver: &Receiver<Message>) {
        loop {
            let is_idle = self.counted.lock().is_empty() && !self.is_full.load(Ordering::Relaxed);
            let next = match is_idle {
                true => receiver.recv().map_err(|_| RecvTimeoutError::Disconnected),
                false => receiver.recv_timeout(TICK),
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
            self.close_windows(goes_on);
            if !goes_on {
                let stop = Waiting::of(self.activity(STOP));
                self.waiting.push(stop);
            }
            self.flush();
            if !goes_on {
                return;
            }
        }
    }

    /// Takes a message; `false` if it is the last one.
    fn take(&mut self, message: Message) -> bool {
        let Message::Record(waiting) = message else {
            return false;
        };
        if !waiting.is_counted {
            self.waiting.push(*waiting);
            return true;
        }
        // Others like it may have come first.
        if self.counted.add(&waiting.event) {
            return true;
        }
        let first = self.at.seq + self.waiting.len() as u64;
        self.counted.begin(&waiting.event, first);
        self.waiting.push(*waiting);
        true
    }

    /// Ends the counts whose time is over, or all.
    fn close_windows(&mut self, goes_on: bool) {
        let window = self.options.window;
        let is_over = |counted: &Counted| !goes_on || counted.since.elapsed() >= window;
        let over = |_: &Alike, counted: &mut Counted| is_over(counted);
        let over: Vec<_> = self.counted.lock().extract_if(over).collect();
        let counts = over.into_iter().map(|(_, counted)| counted);
        let mut counts: Vec<_> = counts.filter(|counted| counted.event.count > 1).collect();
        counts.sort_by_key(|counted| counted.first);
        self.waiting
            .extend(counts.into_iter().map(|counted| Waiting {
                first: Some(counted.first),
                ..Waiting::of(counted.event)
            }));
    }

    /// Writes what waits. If the disk is full, it is tried again with each call.
    fn flush(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        if self.is_full.load(Ordering::Relaxed) {
            self.lost += waiting.len() as u64;
            self.counted.lock().clear();
            let mut again = self.activity("recorded again");
            again.count = self.lost;
            if self.append(&[Waiting::of(again)]).is_ok() {
                tracing::info!(lost = self.lost, "the audit record is written again");
                self.lost = 0;
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
                self.is_full.store(true, Ordering::Release);
                // Those that wait hear it, because what they wait for is dropped. They do nothing, so nothing of them is lost.
                let lost = waiting.iter().filter(|waiting| waiting.done.is_none());
                self.lost = lost.count() as u64;
                self.counted.lock().clear();
            }
        }
    }

    /// Appends lines in one piece, and makes them durable. If that fails, the chain goes on as if they had never been.
    fn append(&mut self, waiting: &[Waiting]) -> io::Result<()> {
        if self.is_gone()? {
            self.begin_file()?;
        }
        let (mut lines, mut at) = (Vec::new(), self.at.clone());
        let others = match self.length {
            0 if self.number == 1 => others(&self.options.folder, &self.process),
            _ => Vec::new(),
        };
        for one in waiting {
            let begins = (self.length == 0 && lines.is_empty()).then_some(Begins {
                file: self.number,
                others: &others,
            });
            let (line, next) = write(&one.event, one.first, &self.process, &at, begins);
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
        if self.length >= self.options.max_file_bytes {
            // If there is no room for another file, this one grows.
            if let Err(error) = self.begin_file() {
                tracing::warn!(%error, "another file of the audit record cannot be begun");
            }
        }
        Ok(())
    }

    /// Goes on in another file.
    fn begin_file(&mut self) -> io::Result<()> {
        self.file = make_file(&self.options.folder, &self.process, self.number + 1)?;
        self.number += 1;
        self.length = 0;
        Ok(())
    }

    /// Whether the file was deleted, or moved with its folder, while it was open.
    #[cfg(unix)]
    fn is_gone(&self) -> io::Result<bool> {
        use std::os::unix::fs::MetadataExt as _;
        let ours = self.file.metadata()?;
        let path = path_of(&self.options.folder, &self.process, self.number);
        let there = std::fs::symlink_metadata(path);
        Ok(!there.is_ok_and(|there| (there.dev(), there.ino()) == (ours.dev(), ours.ino())))
    }

    #[cfg(not(unix))]
    fn is_gone(&self) -> io::Result<bool> {
        Ok(false)
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

pub(crate) fn private() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Makes the name of a new file durable.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()?;
    }
    Ok(())
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
    use crate::verify;

    fn audit(folder: &Path, max_file_bytes: u64) -> Audit {
        let options = Options {
            folder: folder.to_owned(),
            max_file_bytes,
            window: WINDOW,
        };
        Audit::start(options).unwrap()
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
        wait(audit.record_durable(event("export"))).unwrap();
        assert_eq!(lines(folder.path())[1]["object"], "export");
        audit.shut_down();
        assert!(audit.record(event("later")).is_err());
    }

    #[test]
    fn events_that_are_alike_are_one_with_a_count() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1 << 20);
        for _ in 0..3 {
            audit.record_counted(event("picture")).unwrap();
        }
        audit.record_counted(event("case")).unwrap();
        audit.shut_down();
        let lines = lines(folder.path());
        let seen: Vec<_> = (lines.iter())
            .map(|line| {
                (
                    line["object"].as_str().unwrap(),
                    &line["count"],
                    &line["first"],
                )
            })
            .map(|(object, count, first)| (object, count.as_u64().unwrap(), first.as_u64()))
            .collect();
        let expected = [
            ("start", 1, None),
            ("picture", 1, None),
            ("case", 1, None),
            ("picture", 3, Some(2)),
            ("stop", 1, None),
        ];
        assert_eq!(seen, expected);
    }

    #[test]
    fn a_file_that_is_large_is_followed_by_another_in_the_same_chain() {
        let folder = tempfile::tempdir().unwrap();
        let audit = audit(folder.path(), 1000);
        for _ in 0..20 {
            wait(audit.record_durable(event("export"))).unwrap();
        }
        audit.shut_down();
        let verified = verify(folder.path()).unwrap();
        assert!(
            verified.files > 5 && verified.breaks.is_empty(),
            "{verified:?}"
        );
        assert_eq!(verified.lines, 22);
    }

    #[cfg(unix)]
    #[test]
    fn files_are_for_their_owner_alone() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let _audit = audit(folder.path(), 1000);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap();
        let mode = file.unwrap().metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[cfg(unix)]
    #[test]
    fn where_nothing_can_be_written_it_says_so_until_something_can() {
        let outer = tempfile::tempdir().unwrap();
        let (folder, away) = (outer.path().join("audit"), outer.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        check_folder(&folder).unwrap();
        let audit = audit(&folder, 1 << 20);
        std::fs::rename(&folder, &away).unwrap();
        std::fs::remove_dir_all(&away).unwrap();
        assert_eq!(
            wait(audit.record_durable(event("export"))),
            Err(CannotRecord)
        );
        assert!(audit.is_full() && audit.record(event("export")).is_err());
        assert!(check_folder(&folder).is_err());
        std::fs::create_dir(&folder).unwrap();
        while audit.is_full() {
            std::thread::yield_now();
        }
        wait(audit.record_durable(event("export"))).unwrap();
        let lines = lines(&folder);
        assert_eq!(lines[0]["object"], "recorded again");
        assert_eq!(lines[1]["object"], "export");
        audit.shut_down();
        assert!(verify(&folder).unwrap().breaks.is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_was_renamed_gets_no_more_lines_and_the_one_in_its_place_does() {
        let outer = tempfile::tempdir().unwrap();
        let (folder, away) = (outer.path().join("audit"), outer.path().join("away"));
        std::fs::create_dir(&folder).unwrap();
        let audit = audit(&folder, 1 << 20);
        wait(audit.record_durable(event("export"))).unwrap();
        std::fs::rename(&folder, &away).unwrap();
        assert_eq!(
            wait(audit.record_durable(event("export"))),
            Err(CannotRecord)
        );
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
        audit.record(event("picture")).unwrap();
        wait(audit.record_durable(event("export"))).unwrap();
        wait(audit.record_sign_in(event("sign-in"))).unwrap();
        assert!(!audit.is_full());
        audit.shut_down();
    }
}
