//! The collector to which the audit record is sent: syslog (RFC 5424) over TLS (RFC 5425).
//!
//! The files of the record stay the truth. A thread reads them on, from a place that is kept beside them, and sends each line as one message, so
//! that a collector that is away delays nothing and misses nothing. Syslog has no receipts: what was sent in the last half minute before a
//! connection is lost is sent again by the next one, so the collector may get a line twice.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use audit::{Places, Trail, TrailLine};
use http_support::tls::{BadTls, ConnectingTls, TlsAuthority, TlsIdentity, connecting_tls};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, ReadHalf, WriteHalf};
use tokio::net::TcpStream;
use tokio::sync::oneshot::{self, error::TryRecvError};
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::pki_types::ServerName;

use crate::config::Syslog;

/// The port of syslog over TLS.
const PORT: u16 = 6514;

/// How long to wait for a connection, and how long for a handshake.
const CONNECT: Duration = Duration::from_secs(10);

/// How long the collector may take nothing.
const STALLED: Duration = Duration::from_secs(60);

/// How long the system of the collector may leave bytes unacknowledged. Then the connection is lost.
const UNACKNOWLEDGED: Duration = Duration::from_secs(20);

/// How long the place of a line is not kept after it was sent: longer than a connection outlives a line that has not arrived.
const HELD: Duration = Duration::from_secs(30);

/// How often a place is kept.
const KEPT_EVERY: Duration = Duration::from_secs(5);

/// How often the record is looked at.
const TICK: Duration = Duration::from_millis(500);

/// How long a connection lasts that is not refused.
const SETTLED: Duration = Duration::from_secs(1);

/// How often a process that may not send tries again.
const OTHER_SENDS: Duration = Duration::from_secs(5);

/// The times between two attempts to connect.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// How long the end of the process waits for the collector.
const LAST: Duration = Duration::from_secs(5);

/// The bytes of lines that are read at a time.
const BATCH: u64 = 256 << 10;

/// Of syslog: security and authorization.
const FACILITY: u8 = 10;

/// Why there is no collector.
#[derive(Debug, thiserror::Error)]
pub enum BadCollector {
    /// Its address.
    #[error(
        "`address` must be a host, with a port unless it is 6514, such as `syslog.example:6514`"
    )]
    Address,
    /// A file cannot be read.
    #[error("{} cannot be read: {source}", .path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    /// A certificate without a key, or a key without a certificate.
    #[error("set both `tls_certificate` and `tls_key`, or neither")]
    HalfIdentity,
    /// A file is invalid.
    #[error(transparent)]
    Tls(#[from] BadTls),
}

/// A collector. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Collector {
    /// Host and port.
    address: String,
    /// What its certificate must name.
    name: ServerName<'static>,
    files: Syslog,
}

impl Collector {
    /// The collector of a configuration, of which nothing is asked yet.
    ///
    /// # Errors
    /// [`BadCollector`].
    pub fn new(syslog: &Syslog) -> Result<Self, BadCollector> {
        let text = syslog.address.trim();
        // An IPv6 address without brackets has no port.
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) if !host.contains(':') || host.ends_with(']') => {
                let port = port.parse().ok().filter(|&port: &u16| port > 0);
                (host, port.ok_or(BadCollector::Address)?)
            }
            _ => (text, PORT),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let name = ServerName::try_from(host.to_owned()).map_err(|_| BadCollector::Address)?;
        let address = match host.contains(':') {
            true => format!("[{host}]:{port}"),
            false => format!("{host}:{port}"),
        };
        let collector = Self {
            address,
            name,
            files: syslog.clone(),
        };
        collector.tls()?;
        Ok(collector)
    }

    /// Its host and port.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// TLS towards it, as its files are now.
    fn tls(&self) -> Result<ConnectingTls, BadCollector> {
        let files = &self.files;
        let identity = match (&files.tls_certificate, &files.tls_key) {
            (None, None) => None,
            (Some(certificate), Some(key)) => {
                let certificate = read(certificate)?;
                Some(TlsIdentity::read(&certificate, &read(key)?)?)
            }
            _ => return Err(BadCollector::HalfIdentity),
        };
        let authority = TlsAuthority::read(&read(&files.tls_authority)?)?;
        Ok(connecting_tls(&authority, identity.as_ref())?)
    }

    /// A connection to it, if its certificate is right.
    async fn connect(&self) -> Result<TlsStream<TcpStream>, Unsent> {
        let tls = self.tls().map_err(|error| Unsent::new("files", error))?;
        let stream = tokio::time::timeout(CONNECT, TcpStream::connect(&self.address)).await;
        let stream = stream.unwrap_or_else(|_elapsed| Err(io::ErrorKind::TimedOut.into()));
        let stream = stream.map_err(|error| Unsent::new("unreachable", error))?;
        notice_loss(&stream);
        let handshake = TlsConnector::from(tls).connect(self.name.clone(), stream);
        let stream = tokio::time::timeout(CONNECT, handshake).await;
        let stream = stream.unwrap_or_else(|_elapsed| Err(io::ErrorKind::TimedOut.into()));
        stream.map_err(|error| Unsent::new("tls", error))
    }

    /// Connects, sends nothing, and closes the connection.
    ///
    /// # Errors
    /// If the collector is away, has another certificate, or refuses ours.
    pub async fn test(&self) -> Result<(), Unsent> {
        let (mut reading, writing) = tokio::io::split(self.connect().await?);
        let refused = |error: io::Error| Unsent::new("refused", error);
        // A certificate of ours that it does not want is refused after the handshake, by some without a word.
        if let Ok(read) = tokio::time::timeout(SETTLED, reading.read(&mut [0; 64])).await
            && read.map_err(refused)? == 0
        {
            return Err(refused(io::ErrorKind::ConnectionAborted.into()));
        }
        let closed = tokio::time::timeout(LAST, close(reading, writing)).await;
        match closed {
            // Some close only when they have something to do. With a certificate that it does not want it would have said so.
            Err(_elapsed) => Ok(()),
            Ok(closed) => closed.map_err(refused),
        }
    }
}

fn read(path: &Path) -> Result<Vec<u8>, BadCollector> {
    std::fs::read(path).map_err(|source| BadCollector::Unreadable {
        path: path.to_owned(),
        source,
    })
}

/// Makes the system give up a connection whose other side acknowledges nothing.
fn notice_loss(stream: &TcpStream) {
    #[cfg(target_os = "linux")]
    {
        let millis = u32::try_from(UNACKNOWLEDGED.as_millis()).unwrap_or(u32::MAX);
        if let Err(error) = rustix::net::sockopt::set_tcp_user_timeout(stream, millis) {
            tracing::debug!(%error, "TCP_USER_TIMEOUT refused");
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (stream, UNACKNOWLEDGED);
}

/// Ends a connection. It is well if the other side ends it too: then it has read everything.
async fn close(
    mut reading: ReadHalf<TlsStream<TcpStream>>,
    mut writing: WriteHalf<TlsStream<TcpStream>>,
) -> io::Result<()> {
    writing.shutdown().await?;
    let mut ignored = [0; 64];
    loop {
        match reading.read(&mut ignored).await {
            Ok(0) => return Ok(()),
            Ok(_) => {}
            // It has ended the connection below, but not TLS.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

/// Why nothing is sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct Unsent {
    /// In one word, for the metrics.
    reason: &'static str,
    why: String,
}

impl Unsent {
    fn new(reason: &'static str, why: impl ToString) -> Self {
        Self {
            reason,
            why: why.to_string(),
        }
    }
}

/// What the metrics tell of sending.
#[derive(Debug, Default)]
pub struct Progress {
    sent: AtomicU64,
    missing: AtomicU64,
    waiting_bytes: AtomicU64,
    is_connected: AtomicBool,
    /// Since when something waits.
    waiting: Mutex<Option<Instant>>,
    failures: Mutex<Vec<(&'static str, u64)>>,
}

impl Progress {
    /// Why nothing was sent, in one word each.
    const REASONS: [&'static str; 6] = ["files", "unreachable", "tls", "refused", "lost", "record"];

    /// Lines that were sent, those that are sent again included.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    /// Lines that were not in the record any more when it was their turn.
    pub fn missing(&self) -> u64 {
        self.missing.load(Ordering::Relaxed)
    }

    /// Bytes of the record that have not been sent.
    pub fn waiting_bytes(&self) -> u64 {
        self.waiting_bytes.load(Ordering::Relaxed)
    }

    /// For how long something has waited.
    pub fn lag(&self) -> Duration {
        let waiting = *guard(&self.waiting);
        waiting.map_or(Duration::ZERO, |since| since.elapsed())
    }

    /// Whether there is a connection.
    pub fn is_connected(&self) -> bool {
        self.is_connected.load(Ordering::Relaxed)
    }

    /// How often nothing could be sent, by the reason.
    pub fn failures(&self) -> Vec<(&'static str, u64)> {
        let failures = guard(&self.failures);
        let of = |reason| {
            let found = failures.iter().find(|(known, _)| *known == reason);
            (reason, found.map_or(0, |(_, count)| *count))
        };
        Self::REASONS.map(of).into()
    }

    fn fails(&self, reason: &'static str) {
        self.is_connected.store(false, Ordering::Relaxed);
        let mut failures = guard(&self.failures);
        match failures.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, count)) => *count += 1,
            None => failures.push((reason, 1)),
        }
    }

    fn waits(&self, bytes: u64) {
        self.waiting_bytes.store(bytes, Ordering::Relaxed);
        let mut waiting = guard(&self.waiting);
        *waiting = match bytes {
            0 => None,
            _ => waiting.or_else(|| Some(Instant::now())),
        };
    }
}

/// What is held for moments.
fn guard<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A thread that sends a record to a collector.
#[derive(Debug)]
pub struct Sender {
    progress: Arc<Progress>,
    stop: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl Sender {
    /// Begins to send the record in a folder.
    ///
    /// # Errors
    /// If there can be no thread.
    pub fn start(folder: &Path, collector: Collector) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread();
        let runtime = { runtime }.enable_io().enable_time().build()?;
        let progress = Arc::new(Progress::default());
        let (stop, stopped) = oneshot::channel();
        let sending = Sending {
            folder: folder.to_owned(),
            collector,
            progress: Arc::clone(&progress),
            stop: stopped,
            is_stopping: false,
            is_settled: false,
            last_failure: None,
        };
        let thread = std::thread::Builder::new().name("audit-sender".to_owned());
        let thread = thread.spawn(move || runtime.block_on(sending.run()))?;
        Ok(Self {
            progress,
            stop,
            thread,
        })
    }

    /// How far it is.
    pub fn progress(&self) -> Arc<Progress> {
        Arc::clone(&self.progress)
    }

    /// Sends what is left if the collector is there, for 5 s at most. What it does not send then is sent by the next process.
    pub fn shut_down(self) {
        // An error of either means that the thread has ended.
        let _ = self.stop.send(());
        let _ = self.thread.join();
    }
}

/// Why sending has paused.
enum Paused {
    /// The process ends.
    Stopped,
    Failed(Unsent),
}

struct Sending {
    folder: PathBuf,
    collector: Collector,
    progress: Arc<Progress>,
    stop: oneshot::Receiver<()>,
    is_stopping: bool,
    /// Whether the connection has lasted for a moment.
    is_settled: bool,
    /// Each is said once.
    last_failure: Option<Unsent>,
}

impl Sending {
    async fn run(mut self) {
        let Some(mut trail) = self.take_trail().await else {
            return;
        };
        let mut pause = FIRST_PAUSE;
        loop {
            let kept = trail.places();
            let mut recent = Recent::new(kept);
            let connected = tokio::select! {
                connected = self.collector.connect() => connected,
                _ = &mut self.stop => return,
            };
            let failure = match connected {
                Err(failure) => failure,
                Ok(stream) => match self.send(&mut trail, &mut recent, stream).await {
                    Paused::Stopped => return,
                    Paused::Failed(failure) => failure,
                },
            };
            if std::mem::take(&mut self.is_settled) {
                pause = FIRST_PAUSE;
            }
            // What may not have arrived is sent again.
            trail.go_to(recent.kept);
            self.failed(failure);
            if let Ok(bytes) = trail.waiting_bytes() {
                self.progress.waits(bytes);
            }
            if self.stops_within(pause).await {
                return;
            }
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
    }

    /// The record, once no other process sends it.
    async fn take_trail(&mut self) -> Option<Trail> {
        loop {
            match Trail::take(&self.folder) {
                Ok(Some(trail)) => return Some(trail),
                Ok(None) => tracing::debug!("another process sends this audit record"),
                Err(error) => self.failed(Unsent::new("record", error)),
            }
            if self.stops_within(OTHER_SENDS).await {
                return None;
            }
        }
    }

    /// Waits; `true` as soon as the process ends.
    async fn stops_within(&mut self, time: Duration) -> bool {
        if !self.is_stopping {
            self.is_stopping = tokio::time::timeout(time, &mut self.stop).await.is_ok();
        }
        self.is_stopping
    }

    fn is_stopping(&mut self) -> bool {
        if !self.is_stopping {
            self.is_stopping = self.stop.try_recv() != Err(TryRecvError::Empty);
        }
        self.is_stopping
    }

    /// Makes a place durable. Without it, what was sent since the last one is sent again by the next process.
    fn keep(&self, trail: &Trail, places: &Places) {
        if let Err(error) = trail.keep(places) {
            tracing::warn!(%error, "how far the audit record was sent to the collector cannot be kept");
        }
    }

    /// A connection has lasted for a moment. One that is refused because of our certificate is refused only after the handshake.
    fn settled(&mut self) {
        if !self.is_settled {
            self.is_settled = true;
            self.last_failure = None;
            tracing::info!(
                collector = self.collector.address,
                "sending the audit record"
            );
        }
    }

    fn failed(&mut self, failure: Unsent) {
        self.progress.fails(failure.reason);
        if self.last_failure.as_ref() != Some(&failure) {
            tracing::error!(
                collector = self.collector.address,
                error = %failure,
                "the audit record is not sent to the collector; it is kept, and sent once that is possible"
            );
            self.last_failure = Some(failure);
        }
    }

    /// Sends whatever there is, until the connection is lost or the process ends.
    async fn send(
        &mut self,
        trail: &mut Trail,
        recent: &mut Recent,
        stream: TlsStream<TcpStream>,
    ) -> Paused {
        let (mut reading, mut writing) = tokio::io::split(stream);
        let lost = |error: io::Error| {
            // Whether it ends TLS too does not matter here.
            let error = match error.kind() {
                io::ErrorKind::UnexpectedEof => io::ErrorKind::ConnectionAborted.into(),
                _ => error,
            };
            Paused::Failed(Unsent::new("lost", error))
        };
        let mut deadline = None;
        self.progress.is_connected.store(true, Ordering::Relaxed);
        loop {
            if self.is_stopping() {
                deadline = deadline.or_else(|| Some(Instant::now() + LAST));
            }
            let passage = match trail.read_on(BATCH) {
                Ok(passage) => passage,
                Err(error) => return Paused::Failed(Unsent::new("record", error)),
            };
            let missing = &self.progress.missing;
            missing.fetch_add(passage.missing, Ordering::Relaxed);
            if !passage.lines.is_empty() {
                if let Ok(bytes) = trail.waiting_bytes() {
                    self.progress.waits(bytes.max(1));
                }
                let frames: Vec<u8> = passage.lines.iter().flat_map(frame).collect();
                let writes = async {
                    writing.write_all(&frames).await?;
                    writing.flush().await
                };
                match tokio::time::timeout(STALLED, writes).await {
                    Err(_elapsed) => return lost(io::ErrorKind::TimedOut.into()),
                    Ok(Err(error)) => return lost(error),
                    Ok(Ok(())) => {}
                }
                let count = passage.lines.len() as u64;
                self.progress.sent.fetch_add(count, Ordering::Relaxed);
            }
            recent.sent(trail.places(), Instant::now());
            if recent.keeps_later(Instant::now()) {
                self.keep(trail, &recent.kept);
            }
            let is_over = deadline.is_some_and(|deadline| Instant::now() >= deadline);
            if passage.lines.is_empty() {
                self.progress.waits(0);
            } else if !is_over {
                continue;
            }
            if deadline.is_some() {
                // What was sent has arrived if the collector, which has accepted the connection, closes it in order.
                let closed = tokio::time::timeout(LAST, close(reading, writing)).await;
                if self.is_settled && matches!(closed, Ok(Ok(()))) {
                    self.keep(trail, &recent.last);
                }
                return Paused::Stopped;
            }
            let mut ignored = [0; 64];
            tokio::select! {
                // It has nothing to say, so this is the end.
                read = reading.read(&mut ignored) => match read {
                    Ok(0) => return lost(io::ErrorKind::ConnectionAborted.into()),
                    Ok(_) => {}
                    Err(error) => return lost(error),
                },
                _ = self.stops_within(TICK) => self.settled(),
            }
        }
    }
}

/// The places of what was sent a moment ago.
struct Recent {
    /// What was sent before this has arrived.
    kept: Places,
    /// From when to when, and what was sent until then.
    places: VecDeque<(Instant, Instant, Places)>,
    last: Places,
}

impl Recent {
    fn new(kept: Places) -> Self {
        Self {
            last: kept.clone(),
            kept,
            places: VecDeque::new(),
        }
    }

    /// Everything before a place was sent.
    fn sent(&mut self, places: Places, now: Instant) {
        if self.last == places {
            return;
        }
        self.last = places.clone();
        match self.places.back_mut() {
            Some((from, until, last)) if now.duration_since(*from) < KEPT_EVERY => {
                (*until, *last) = (now, places);
            }
            _ => self.places.push_back((now, now, places)),
        }
    }

    /// Whether a later place is to be kept now.
    fn keeps_later(&mut self, now: Instant) -> bool {
        let mut is_later = false;
        while let Some((_, until, _)) = self.places.front()
            && now.duration_since(*until) >= HELD
            && let Some((_, _, places)) = self.places.pop_front()
        {
            self.kept = places;
            is_later = true;
        }
        is_later
    }
}

/// A message of syslog (RFC 5424) with the number of its octets before it (RFC 5425). Its text is the line of the record.
fn frame(line: &TrailLine) -> Vec<u8> {
    let severity = match line.outcome.as_str() {
        "serious-failure" => 3,
        "minor-failure" => 4,
        _ => 5,
    };
    let priority = FACILITY * 8 + severity;
    // The number of a message goes up to 2,147,483,647 (§7.3.1).
    let sequence = (line.seq - 1) % 0x7fff_ffff + 1;
    let message = format!(
        "<{priority}>1 {time} {host} isocortex {process} {kind} [meta sequenceId=\"{sequence}\"][origin software=\"isocortex\" swVersion=\"{version}\"] {json}",
        time = line.time,
        host = word(&host_name(), 255),
        process = word(&line.process, 128),
        kind = word(&line.name, 32),
        version = env!("CARGO_PKG_VERSION"),
        json = line.json,
    );
    [format!("{} ", message.len()).as_bytes(), message.as_bytes()].concat()
}

/// What may be a field of a header: printable ASCII without spaces.
fn word(text: &str, longest: usize) -> String {
    let word: String = text
        .chars()
        .filter(char::is_ascii_graphic)
        .take(longest)
        .collect();
    match word.is_empty() {
        true => "-".to_owned(),
        false => word,
    }
}

/// The name of this machine.
fn host_name() -> String {
    #[cfg(unix)]
    return rustix::system::uname()
        .nodename()
        .to_string_lossy()
        .into_owned();
    #[cfg(not(unix))]
    String::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(name: &str, outcome: &str) -> TrailLine {
        TrailLine {
            process: "20260101T000000Z-00000001".to_owned(),
            seq: 7,
            time: "2026-01-01T00:00:00.123Z".to_owned(),
            name: name.to_owned(),
            outcome: outcome.to_owned(),
            json: "{\"seq\":7,\"who\":\"josé\"}".to_owned(),
        }
    }

    #[test]
    fn a_line_is_a_message_of_its_octets() {
        let frame = frame(&line("DICOM Instances Accessed", "success"));
        let text = String::from_utf8(frame).unwrap();
        let (octets, message) = text.split_once(' ').unwrap();
        assert_eq!(octets, message.len().to_string());
        let parts: Vec<_> = message.splitn(7, ' ').collect();
        let host = word(&host_name(), 255);
        let process = "20260101T000000Z-00000001";
        let expected = [
            "<85>1",
            "2026-01-01T00:00:00.123Z",
            &host,
            "isocortex",
            process,
        ];
        assert_eq!(parts[..5], expected);
        assert_eq!(parts[5], "DICOMInstancesAccessed");
        let data = format!(
            "[meta sequenceId=\"7\"][origin software=\"isocortex\" swVersion=\"{}\"] {{\"seq\":7,\"who\":\"josé\"}}",
            env!("CARGO_PKG_VERSION")
        );
        assert_eq!(parts[6], data);
    }

    #[test]
    fn a_failure_has_a_severity_of_its_own() {
        for (outcome, priority) in [
            ("intended", "<85>"),
            ("minor-failure", "<84>"),
            ("serious-failure", "<83>"),
        ] {
            let frame = frame(&line("Export", outcome));
            assert!(String::from_utf8(frame).unwrap().contains(priority));
        }
    }

    #[test]
    fn what_was_sent_is_kept_once_it_must_have_arrived() {
        let place = |offset: u64| -> Places {
            let text = format!(
                "{{\"p\": {{\"file\": 1, \"offset\": {offset}, \"seq\": 1, \"is_stopped\": false}}}}"
            );
            serde_json::from_str(&text).unwrap()
        };
        let start = Instant::now();
        let mut recent = Recent::new(place(0));
        recent.sent(place(1), start);
        recent.sent(place(2), start + Duration::from_millis(900));
        recent.sent(place(3), start + Duration::from_secs(5));
        assert!(!recent.keeps_later(start + HELD));
        assert!(recent.keeps_later(start + HELD + Duration::from_secs(1)));
        assert_eq!(recent.kept, place(2), "two of a moment are one");
        // Nothing new was sent.
        recent.sent(place(3), start + Duration::from_secs(20));
        assert!(recent.keeps_later(start + HELD + Duration::from_secs(5)));
        assert_eq!(recent.kept, place(3));
        assert!(!recent.keeps_later(start + HELD * 9));
    }

    #[test]
    fn an_address_has_a_port_or_the_usual_one() {
        let folder = tempfile::tempdir().unwrap();
        let files = |address: &str| Syslog {
            address: address.to_owned(),
            tls_authority: folder.path().join("nowhere"),
            tls_certificate: None,
            tls_key: None,
        };
        for bad in [
            "",
            ":6514",
            "host:0",
            "host:x",
            "a b",
            "user@host:1",
            "host:70000",
        ] {
            let error = Collector::new(&files(bad)).unwrap_err();
            assert!(matches!(error, BadCollector::Address), "{bad}: {error}");
        }
        let error = Collector::new(&files("syslog.example")).unwrap_err();
        assert!(matches!(error, BadCollector::Unreadable { .. }), "{error}");
    }
}
