//! The audit record by syslog over TLS: what a collector gets, and what happens while it is away.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::audit::{Action, Audit, Event, EventKind, Options, WINDOW, verify};
use http_support::tls::{TlsAuthority, TlsIdentity, listening_tls};
use isocortex::collector::{Collector, Progress, Sender};
use isocortex::config::Syslog;
use serde_json::Value;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio_rustls::TlsAcceptor;

use crate::command_line::run;
use crate::operation::{Logged, get};
use crate::storage_nodes::Certificates;
use crate::until::until;

/// A message that a collector has received.
#[derive(Debug)]
struct Message {
    /// Everything before the line of the record.
    header: String,
    line: Value,
}

impl Message {
    fn seq(&self) -> u64 {
        self.line["seq"].as_u64().unwrap()
    }
}

/// A collector on a port of this machine, until it is dropped.
struct Collecting {
    port: u16,
    messages: UnboundedReceiver<Message>,
    task: tokio::task::JoinHandle<()>,
}

impl Drop for Collecting {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Collecting {
    /// With an authority, whoever sends needs a certificate of it.
    async fn start(port: u16, ours: &Certificates, authority: Option<&Certificates>) -> Self {
        let identity = TlsIdentity::read(&ours.read("cert.pem"), &ours.read("key.pem")).unwrap();
        let authority = authority.map(|it| TlsAuthority::read(&it.read("ca.pem")).unwrap());
        let tls = listening_tls(&identity, authority.as_ref()).unwrap();
        let listener = TcpListener::bind(("127.0.0.1", port)).await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (sender, messages) = unbounded_channel();
        let task = tokio::spawn(collect(listener, TlsAcceptor::from(tls), sender));
        Self {
            port,
            messages,
            task,
        }
    }

    async fn next(&mut self) -> Message {
        self.messages.recv().await.unwrap()
    }

    /// The numbers of the lines up to one.
    async fn until(&mut self, last: u64) -> Vec<u64> {
        let mut seqs = Vec::new();
        while seqs.last() != Some(&last) {
            seqs.push(self.next().await.seq());
        }
        seqs
    }

    /// Ends without a word, as if the machine were gone.
    async fn end(mut self) {
        self.task.abort();
        let _ = (&mut self.task).await;
    }
}

/// Reads the messages of one connection after the other.
async fn collect(listener: TcpListener, tls: TlsAcceptor, sender: UnboundedSender<Message>) {
    loop {
        let (stream, _) = listener.accept().await.unwrap();
        let Ok(mut stream) = tls.accept(stream).await else {
            continue;
        };
        while let Some(message) = frame(&mut stream).await {
            let text = String::from_utf8(message).unwrap();
            let (header, json) = text.split_at(text.find('{').unwrap());
            let message = Message {
                header: header.to_owned(),
                line: serde_json::from_str(json).unwrap(),
            };
            sender.send(message).unwrap();
        }
        let _ = stream.shutdown().await;
    }
}

/// What has as many octets as the number before it states.
async fn frame(stream: &mut (impl AsyncRead + Unpin)) -> Option<Vec<u8>> {
    let mut octets = 0;
    loop {
        match stream.read_u8().await.ok()? {
            b' ' => break,
            digit @ b'0'..=b'9' => octets = octets * 10 + usize::from(digit - b'0'),
            other => panic!("{other} in the number of octets"),
        }
    }
    let mut message = vec![0; octets];
    stream.read_exact(&mut message).await.ok()?;
    Some(message)
}

/// A record in files of some lines each, and what sends it.
struct Sent {
    audit: Audit,
    sender: Sender,
}

fn syslog(address: String, authority: PathBuf) -> Syslog {
    Syslog {
        address,
        tls_authority: authority,
        tls_certificate: None,
        tls_key: None,
    }
}

fn collector_at(port: u16, authority: &Certificates) -> Collector {
    let address = format!("127.0.0.1:{port}");
    Collector::new(&syslog(address, authority.path("ca.pem"))).unwrap()
}

impl Sent {
    fn start(folder: &Path, collector: Collector) -> Self {
        let audit = Audit::start(Options {
            folder: folder.to_owned(),
            max_file_bytes: 3000,
            window: WINDOW,
        });
        Self {
            audit: audit.unwrap(),
            sender: Sender::start(folder, collector).unwrap(),
        }
    }

    async fn record(&self, count: usize) {
        for _ in 0..count {
            let event = Event::new(EventKind::Export, Action::Read, "export", "ana");
            self.audit.record_durable(event).await.unwrap();
        }
    }

    async fn fails(&self, reason: &str) {
        let progress = self.sender.progress();
        let failed = || progress.failures().contains(&(leaked(reason), 0));
        until(reason, async || (!failed()).then_some(())).await;
    }

    fn progress(&self) -> Arc<Progress> {
        self.sender.progress()
    }

    async fn end(self) {
        let Self { audit, sender } = self;
        let end = move || {
            audit.shut_down();
            sender.shut_down();
        };
        tokio::task::spawn_blocking(end).await.unwrap();
    }
}

/// One of the reasons.
fn leaked(reason: &str) -> &'static str {
    let known = ["unreachable", "tls", "refused", "lost"];
    known.into_iter().find(|it| *it == reason).unwrap()
}

fn first_to(last: u64) -> Vec<u64> {
    (1..=last).collect()
}

#[tokio::test]
async fn each_line_comes_once_in_its_order_and_the_next_process_goes_on() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let mut collecting = Collecting::start(0, &ours, None).await;
    let collector = collector_at(collecting.port, &ours);
    let sent = Sent::start(folder.path(), collector.clone());
    sent.record(20).await;
    let first = collecting.next().await;
    assert_eq!(first.line["object"], "start");
    let mut second = collecting.next().await;
    let process = second.line["process"].as_str().unwrap().to_owned();
    assert!(second.header.starts_with("<85>1 2"), "{second:?}");
    let middle = format!(" isocortex {process} Export [meta sequenceId=\"2\"][origin software=");
    assert!(second.header.contains(&middle), "{second:?}");
    assert_eq!(collecting.until(21).await, &first_to(21)[2..]);
    sent.end().await;
    second = collecting.next().await;
    assert_eq!((second.seq(), &second.line["object"]), (22, &"stop".into()));
    // What has arrived is not sent again.
    let sent = Sent::start(folder.path(), collector);
    sent.record(1).await;
    let next = collecting.next().await;
    assert_eq!(next.seq(), 1);
    assert_ne!(next.line["process"], *process);
    assert_eq!(collecting.next().await.seq(), 2);
    sent.end().await;
    let verified = verify(folder.path()).unwrap();
    assert!(
        verified.breaks.is_empty() && verified.notes.is_empty(),
        "{verified:?}"
    );
}

#[tokio::test]
async fn a_collector_that_is_away_delays_nothing_and_misses_nothing() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let before = Collecting::start(0, &ours, None).await;
    let port = before.port;
    before.end().await;
    let sent = Sent::start(folder.path(), collector_at(port, &ours));
    // It is on the disk although nobody is there.
    sent.record(20).await;
    sent.fails("unreachable").await;
    let progress = sent.progress();
    until("lines wait", async || {
        (progress.waiting_bytes() > 5000).then_some(())
    })
    .await;
    assert!(progress.sent() == 0 && !progress.is_connected());
    let mut collecting = Collecting::start(port, &ours, None).await;
    assert_eq!(collecting.until(21).await, first_to(21));
    // What it got a moment before it went may not have arrived, and comes again.
    collecting.end().await;
    sent.record(5).await;
    sent.fails("lost").await;
    let mut collecting = Collecting::start(port, &ours, None).await;
    assert_eq!(collecting.until(26).await, first_to(26));
    until("nothing waits", async || {
        (progress.waiting_bytes() == 0 && progress.is_connected()).then_some(())
    })
    .await;
    assert_eq!(progress.missing(), 0);
    sent.end().await;
}

#[tokio::test]
async fn a_collector_of_another_authority_or_another_name_gets_nothing() {
    let (Some(ours), Some(other)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let mut collecting = Collecting::start(0, &ours, None).await;
    let port = collecting.port;
    let elsewhere = syslog(format!("localhost:{port}"), ours.path("ca.pem"));
    for collector in [
        collector_at(port, &other),
        Collector::new(&elsewhere).unwrap(),
    ] {
        assert!(collector.test().await.is_err());
        let folder = tempfile::tempdir().unwrap();
        let sent = Sent::start(folder.path(), collector);
        sent.record(1).await;
        sent.fails("tls").await;
        assert_eq!(sent.progress().sent(), 0);
        sent.end().await;
    }
    assert!(collecting.messages.try_recv().is_err());
    collector_at(port, &ours).test().await.unwrap();
}

#[tokio::test]
async fn a_collector_may_require_a_certificate() {
    let (Some(ours), Some(other)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let mut collecting = Collecting::start(0, &ours, Some(&ours)).await;
    let plain = collector_at(collecting.port, &ours);
    assert!(plain.test().await.is_err());
    let of = |certificates: &Certificates| {
        let address = format!("127.0.0.1:{}", collecting.port);
        Collector::new(&Syslog {
            tls_certificate: Some(certificates.path("cert.pem")),
            tls_key: Some(certificates.path("key.pem")),
            ..syslog(address, ours.path("ca.pem"))
        })
        .unwrap()
    };
    assert!(of(&other).test().await.is_err());
    let folder = tempfile::tempdir().unwrap();
    let sent = Sent::start(folder.path(), plain);
    sent.record(3).await;
    // By TLS 1.3 this is known only after the first lines were sent.
    sent.fails("lost").await;
    sent.end().await;
    assert!(collecting.messages.try_recv().is_err());
    let right = of(&ours);
    right.test().await.unwrap();
    // The lines of the process before are sent too. Of two that started within a second, either may come first.
    let sent = Sent::start(folder.path(), right);
    let mut exports = 0;
    while exports < 3 {
        let line = collecting.next().await.line;
        exports += usize::from(line["object"] == "export");
    }
    sent.end().await;
}

/// rsyslog with GnuTLS does so, if it does not want our certificate.
#[tokio::test]
async fn a_collector_that_leaves_after_the_handshake_without_a_word_is_none() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let identity = TlsIdentity::read(&ours.read("cert.pem"), &ours.read("key.pem")).unwrap();
    let acceptor = TlsAcceptor::from(listening_tls(&identity, None).unwrap());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let leaving = tokio::spawn(async move {
        let (stream, _) = listener.accept().await.unwrap();
        drop(acceptor.accept(stream).await.unwrap());
    });
    let refused = collector_at(port, &ours).test().await;
    assert!(refused.is_err());
    leaving.await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_sends_its_record_and_its_metrics_tell() {
    let Some(ours) = Certificates::make() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    std::fs::create_dir(path("audit")).unwrap();
    let mut collecting = Collecting::start(0, &ours, None).await;
    let configured = |address: &str, rest: &str| {
        let (audit, authority) = (path("audit"), ours.text("ca.pem"));
        let text = format!(
            "[storage]\ndata = \"{}\"\n[audit]\nfolder = \"{audit}\"\n[audit.syslog]\naddress = \"{address}\"\ntls_authority = \"{authority}\"\n{rest}",
            path("data")
        );
        std::fs::write(path("isocortex.toml"), text).unwrap();
        path("isocortex.toml")
    };
    let address = format!("127.0.0.1:{}", collecting.port);
    let config = configured(&address, "");
    let (status, said) = run(&["check-config", "--config", &config]);
    assert_eq!(status, Some(0), "{said}");
    let words = format!("sends this record by syslog over TLS to {address}");
    assert!(said.contains(&words), "{said}");
    let test = ["audit", "test", "--config", &config];
    let tested = tokio::task::block_in_place(|| run(&test));
    assert_eq!(tested.0, Some(0), "{tested:?}");

    let serve = [
        "serve",
        "--listen",
        "127.0.0.1:0",
        "--gpu",
        "off",
        "--config",
        &config,
    ];
    let mut server = tokio::task::block_in_place(|| Logged::start(&serve));
    let line = tokio::task::block_in_place(|| server.until("listening"));
    let at = line["address"].as_str().unwrap();
    assert_eq!(collecting.next().await.line["object"], "start");
    let (status, _) = tokio::task::block_in_place(|| get(at, "/v1/cases", "none"));
    assert_eq!(status, 200);
    let list = async { while collecting.next().await.line["object"] != "list" {} };
    list.await;
    let (_, metrics) = tokio::task::block_in_place(|| get(at, "/metrics", "none"));
    for line in [
        "isocortex_audit_collector_connected 1",
        "isocortex_audit_missing_total 0",
        "isocortex_audit_collector_failures_total{reason=\"tls\"} 0",
    ] {
        assert!(metrics.contains(line), "{line}: {metrics}");
    }
    tokio::task::block_in_place(|| server.end());
    let stop = async { while collecting.next().await.line["object"] != "stop" {} };
    stop.await;

    for (address, rest, words) in [
        ("", "", "`audit.syslog`: `address` must be a host"),
        ("collector:99999", "", "must be a host"),
        ("collector", "tls_key = \"/nowhere\"", "or neither"),
        ("collector", "port = 5", "port"),
    ] {
        let config = configured(address, rest);
        let (status, said) = run(&["check-config", "--config", &config]);
        assert_eq!(status, Some(78), "{said}");
        assert!(said.contains(words), "{said}");
    }
    let config = configured(&address, "");
    collecting.end().await;
    let (status, said) = run(&["audit", "test", "--config", &config]);
    assert_eq!(status, Some(69), "{said}");
}
