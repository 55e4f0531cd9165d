//! What an operator sees and does: logs, metrics, signals, checks of a configuration and of nodes, pages of other hosts.

use std::collections::BTreeSet;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, Request};
use serde_json::Value;

use crate::archive::Archive;
use crate::command_line::run;
use crate::results::python_with;
use crate::server::Server;
use crate::several_machines::program;
use crate::storage_nodes::Certificates;

/// A process whose log is JSON. Dropping it kills it.
pub(crate) struct Logged {
    process: Child,
    log: BufReader<ChildStderr>,
    /// Every line so far.
    lines: Vec<String>,
}

impl Drop for Logged {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.process.kill();
    }
}

impl Logged {
    /// A server of a store, at a free port of this machine.
    pub(crate) fn serve(data: &str, arguments: &[&str]) -> Self {
        let serve = ["serve", "--listen", "127.0.0.1:0", "--gpu", "off"];
        Self::start(&[&serve[..], &["--data", data], arguments].concat())
    }

    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut process = Command::new(program())
            .args(arguments)
            .args(["--log-format", "json", "--log", "debug"])
            .env_remove("ISOCORTEX_CONFIG")
            .env("ISOCORTEX_CREATE", "true")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = BufReader::new(process.stderr.take().unwrap());
        Self {
            process,
            log,
            lines: Vec::new(),
        }
    }

    /// Reads the log until a line has a message.
    pub(crate) fn until(&mut self, message: &str) -> Value {
        self.until_one(|said| said == message)
    }

    /// Reads the log until a message is such a one.
    fn until_one(&mut self, is_it: impl Fn(&str) -> bool) -> Value {
        loop {
            let mut line = String::new();
            assert!(
                self.log.read_line(&mut line).unwrap() > 0,
                "{:?}",
                self.lines
            );
            let parsed: Value = serde_json::from_str(&line).expect(&line);
            self.lines.push(line);
            if parsed["message"].as_str().is_some_and(&is_it) {
                return parsed;
            }
        }
    }

    fn signal(&self, name: &str) {
        let pid = self.process.id().to_string();
        let sent = Command::new("kill").args([name, &pid]).status();
        assert!(sent.unwrap().success());
    }

    /// How often the log has had a message so far.
    pub(crate) fn count(&self, message: &str) -> usize {
        let message = format!("\"message\":\"{message}\"");
        let lines = self.lines.iter();
        lines.filter(|line| line.contains(&message)).count()
    }

    /// Tells it to stop; it ends without an error.
    pub(crate) fn stop(mut self) {
        self.signal("-TERM");
        assert!(self.process.wait().unwrap().success());
    }

    /// Ends it in order; every line of its log is JSON, and nothing is on standard output.
    pub(crate) fn end(mut self) {
        self.signal("-TERM");
        self.until("stopped");
        let mut rest = String::new();
        self.log.read_to_string(&mut rest).unwrap();
        for line in self.lines.iter().map(String::as_str).chain(rest.lines()) {
            assert!(line.starts_with('{'), "{line}");
            // A statement that waits for a busy disk may be named.
            let is_statement =
                line.contains("\"target\":\"sqlx") && !line.contains("slow statement");
            assert!(!is_statement, "{line}");
        }
        let mut printed = String::new();
        let mut stdout = self.process.stdout.take().unwrap();
        stdout.read_to_string(&mut printed).unwrap();
        assert_eq!(printed, "");
        assert!(self.process.wait().unwrap().success());
    }
}

/// The status and the body of a GET.
pub(crate) fn get(address: &str, path: &str, token: &str) -> (u16, String) {
    let (status, body) = get_bytes(address, path, token);
    (status, String::from_utf8(body).unwrap())
}

/// The status and the body of a GET, which need not be text.
pub(crate) fn get_bytes(address: &str, path: &str, token: &str) -> (u16, Vec<u8>) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let request = format!(
        "GET {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\nConnection: close\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n");
    let body = answer.split_off(end.unwrap() + 4);
    let head = String::from_utf8(answer).unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    (status, body)
}

/// The status of a POST.
pub(crate) fn post(address: &str, path: &str, media_type: &str, body: &[u8]) -> u16 {
    let mut stream = TcpStream::connect(address).unwrap();
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {media_type}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes()).unwrap();
    // It may be answered before it is read.
    let _refused = stream.write_all(body);
    let mut answer = BufReader::new(stream);
    let mut line = String::new();
    answer.read_line(&mut line).unwrap();
    line.split(' ').nth(1).unwrap().parse().unwrap()
}

const OLD: &str = "0123456789abcdef";
const NEW: &str = "fedcba9876543210";

#[test]
fn a_worker_says_how_far_the_process_with_a_strangers_file_is_confined() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().to_str().unwrap();
    let mut worker = Logged::start(&["work", "--data", data]);
    worker.until_one(|said| said.starts_with("the process that prepares heads has "));
    worker.end();
}

#[test]
fn a_named_token_opens_once_it_is_in_the_file_and_no_longer_once_it_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let [data, tokens] = ["data", "tokens.toml"].map(|name| folder.path().join(name));
    let add = |name: &str| {
        let mut command = Command::new(program());
        command.args(["token", "new", name, "--role", "viewer", "--file"]);
        let made = command.arg(&tokens).output().unwrap();
        String::from_utf8(made.stdout).unwrap().trim().to_owned()
    };
    let first = add("first");
    let mut server = Logged::serve(
        data.to_str().unwrap(),
        &["--tokens-file", tokens.to_str().unwrap()],
    );
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap().to_owned();
    let status = |token: &str| get(&address, "/v1/cases", token).0;
    assert_eq!(status(&first), 200);
    let with_first = std::fs::read_to_string(&tokens).unwrap();

    let second = add("second");
    server.until("the tokens were read again");
    assert_eq!([status(&first), status(&second)], [200, 200]);

    // An editor may empty the file before it writes it.
    for wrong in ["nonsense", ""] {
        std::fs::write(&tokens, wrong).unwrap();
        server.until("the tokens stay as they were");
        assert_eq!([status(&first), status(&second)], [200, 200]);
    }

    std::fs::write(&tokens, with_first).unwrap();
    server.until("the tokens were read again");
    assert_eq!([status(&first), status(&second)], [200, 401]);
    server.end();
}

#[test]
fn a_withdrawn_token_opens_no_longer_although_a_certificate_cannot_be_read_again() {
    let Some(certificates) = Certificates::make() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let [data, tokens, file] =
        ["data", "tokens.toml", "isocortex.toml"].map(|name| folder.path().join(name));
    let add = |name: &str, until: &[&str]| {
        let arguments = ["token", "new", name, "--role", "viewer", "--file"];
        let mut command = Command::new(program());
        let command = command.args(arguments).arg(&tokens).args(until);
        let made = command.output().unwrap();
        String::from_utf8(made.stdout).unwrap().trim().to_owned()
    };
    let first = add("first", &[]);
    let with_first = std::fs::read_to_string(&tokens).unwrap();
    let second = add("second", &["--until", "2099-12-31"]);
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| certificates.text(name));
    let config = format!(
        "[http]\ntokens_file = {tokens:?}\n[pacs.dimse]\nlisten = \"127.0.0.1:0\"\ntls_certificate = {certificate:?}\ntls_key = {key:?}\n"
    );
    std::fs::write(&file, config).unwrap();
    let mut server = Logged::serve(
        data.to_str().unwrap(),
        &["--config", file.to_str().unwrap()],
    );
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap().to_owned();
    let status = |token: &str| get(&address, "/v1/cases", token).0;
    assert_eq!([status(&first), status(&second)], [200, 200]);
    let end = || {
        let metrics = get(&address, "/metrics", "").1;
        let mut lines = metrics.lines();
        let value = lines.find_map(|line| line.strip_prefix("isocortex_token_end_time_seconds "));
        value.map(|value| value.parse::<u64>().unwrap())
    };
    // The day after 2099-12-31 begins.
    assert_eq!(end(), Some(4_102_444_800));

    // A certificate that is none; then a key that is not there at all.
    let refused = "the certificates of C-STORE stay as they were";
    std::fs::write(&certificate, "nonsense").unwrap();
    server.until(refused);
    std::fs::write(&tokens, &with_first).unwrap();
    server.until(refused);
    assert_eq!([status(&first), status(&second)], [200, 401]);
    assert_eq!(end(), None);
    std::fs::remove_file(&key).unwrap();
    let gone = server.until(refused);
    let reason = gone["error"].as_str().unwrap();
    assert!(reason.contains("the file of the key for TLS"), "{reason}");
    let third = add("third", &[]);
    server.until(refused);
    assert_eq!([status(&first), status(&third)], [200, 200]);
    server.end();
}

#[test]
fn check_config_names_what_others_can_read_and_what_is_spelled_wrongly_and_changes_nothing() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let token = folder.path().join("token");
    std::fs::write(&token, OLD).unwrap();
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o644)).unwrap();
    let mut command = Command::new(program());
    let arguments = ["check-config", "--token-file", token.to_str().unwrap()];
    let checked = command
        .args(arguments)
        .env("ISOCORTEX_TOKENFILE", "token")
        .output();
    let checked = checked.unwrap();
    assert!(checked.status.success(), "{checked:?}");
    let said = String::from_utf8(checked.stdout).unwrap();
    for part in [
        "warning: others on this machine can read the file of the token, ",
        "its mode is 0644",
        "warning: the variable ISOCORTEX_TOKENFILE is not known",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let mode = token.metadata().unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o644);
}

#[test]
fn a_signal_reads_the_token_again_and_every_line_of_the_log_is_json() {
    let folder = tempfile::tempdir().unwrap();
    let [data, token] = ["data", "token"].map(|name| folder.path().join(name));
    std::fs::write(&token, OLD).unwrap();
    let mut server = Logged::serve(
        data.to_str().unwrap(),
        &["--token-file", token.to_str().unwrap()],
    );
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap().to_owned();
    let status = |token: &str| get(&address, "/v1/cases", token).0;
    assert_eq!(status(OLD), 200);

    std::fs::write(&token, NEW).unwrap();
    assert_eq!(status(OLD), 200, "nobody has said so");
    server.signal("-HUP");
    server.until("the tokens were read again");
    assert_eq!(status(NEW), 200);
    assert_eq!(status(OLD), 401);

    std::fs::write(&token, "short").unwrap();
    server.signal("-HUP");
    let refused = server.until("the tokens stay as they were");
    assert!(refused["error"].as_str().unwrap().contains("at least 16"));
    assert_eq!(status(NEW), 200);

    let (_, metrics) = get(&address, "/metrics", NEW);
    for name in [
        "isocortex_build_info{version=",
        "isocortex_database_up 1",
        "isocortex_free_bytes ",
        "isocortex_store_failures_total{part=\"database\"} ",
        "isocortex_preparations_total{result=\"ready\"} 0",
        "# TYPE isocortex_jobs gauge",
        "# TYPE isocortex_oldest_job_seconds gauge",
        "process_resident_memory_bytes ",
        "process_cpu_seconds_total ",
    ] {
        assert!(metrics.contains(name), "{name}: {metrics}");
    }
    assert!(metrics.trim_end().ends_with("# EOF"), "{metrics}");
    server.end();
}

#[test]
fn a_worker_answers_health_checks_and_metrics_and_outlives_a_hangup() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().display().to_string();
    let mut worker = Logged::start(&["work", "--data", &data, "--listen", "127.0.0.1:0"]);
    let line = worker.until("answering health checks");
    let address = line["address"].as_str().unwrap().to_owned();
    worker.signal("-HUP");
    for path in ["/healthz", "/readyz"] {
        assert_eq!(get(&address, path, "").0, 200, "{path}");
    }
    let (status, metrics) = get(&address, "/metrics", "");
    assert_eq!(status, 200);
    assert!(metrics.contains("isocortex_database_up 1"), "{metrics}");
    assert_eq!(get(&address, "/v1/cases", "").0, 404);
    worker.end();
}

/// A rule for a metric that does not exist never fires.
#[test]
fn every_metric_of_the_alerts_and_the_dashboard_is_in_the_metrics() {
    let folder = tempfile::tempdir().unwrap();
    let [data, file] = ["data", "isocortex.toml"].map(|name| folder.path().join(name));
    let listener = "[pacs.dimse]\nlisten = \"127.0.0.1:0\"\n";
    std::fs::write(&file, listener).unwrap();
    let mut server = Logged::serve(
        data.to_str().unwrap(),
        &["--config", file.to_str().unwrap()],
    );
    let line = server.until("listening");
    let address = line["address"].as_str().unwrap();
    // What counts requests begins with the first.
    get(address, "/healthz", "");
    let (_, metrics) = get(address, "/metrics", "");
    server.stop();
    let kinds = metrics
        .lines()
        .filter_map(|line| line.strip_prefix("# TYPE "));
    let stated: BTreeSet<String> = kinds
        .flat_map(|line| {
            let (name, kind) = line.split_once(' ').unwrap();
            let endings: &[&str] = match kind {
                "counter" => &["_total"],
                "histogram" => &["_bucket", "_count", "_sum"],
                _ => &[""],
            };
            endings.iter().map(move |ending| format!("{name}{ending}"))
        })
        .collect();
    let monitoring = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docker/monitoring");
    for (file, least) in [
        ("alerts.yaml", 12),
        ("alerts.test.yaml", 12),
        ("dashboard.json", 12),
    ] {
        let text = std::fs::read_to_string(monitoring.join(file)).unwrap();
        let words = text.split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_');
        let named = words.filter(|word| {
            let is_ours = word.starts_with("isocortex_") || word.starts_with("process_");
            is_ours && word.ends_with(|letter: char| letter.is_ascii_alphanumeric())
        });
        let named: BTreeSet<String> = named.map(str::to_owned).collect();
        let unknown: Vec<_> = named.difference(&stated).collect();
        assert!(
            unknown.is_empty(),
            "{file} names {unknown:?}; there are {stated:?}"
        );
        assert!(named.len() >= least, "{file} names {named:?}");
    }
}

/// The text of metrics is what a parser of the format accepts.
#[tokio::test]
async fn the_metrics_are_valid() {
    let Some(python) = python_with("prometheus_client") else {
        return;
    };
    let server = Server::start().await;
    let text = server.get("/metrics").await.body;
    let parse = "import sys\nfrom prometheus_client.openmetrics.parser import text_string_to_metric_families as parse\n\
                 assert list(parse(sys.stdin.read()))";
    let mut parser = Command::new(python)
        .args(["-c", parse])
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    parser.stdin.take().unwrap().write_all(&text).unwrap();
    assert!(parser.wait().unwrap().success());
}

fn written(folder: &Path, name: &str, text: &str) -> String {
    let file = folder.join(name);
    std::fs::write(&file, text).unwrap();
    file.display().to_string()
}

#[test]
fn a_configuration_is_checked_without_starting_anything() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data").display().to_string();
    let good = format!(
        "[storage]\ndata = \"{data}\"\n[pacs.dimse]\nlisten = \"127.0.0.1:11112\"\n\
         [[pacs.nodes]]\nname = \"archive\"\nurl = \"http://archive/dicom-web\"\n"
    );
    let config = written(folder.path(), "good.toml", &good);
    let (status, said) = run(&["check-config", "--config", &config]);
    assert_eq!(status, Some(0), "{said}");
    let not_there = format!("{data}, which does not exist yet");
    for words in [
        "is valid",
        "`archive`",
        "11112",
        "nobody may send",
        "its objects are in this folder",
        "missing  audit      set `audit.folder`",
        &not_there,
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert!(!Path::new(&data).exists());
    for (text, words) in [
        (
            "[[pacs.dimse.peers]]\naet = \"A\"\naddress = \"10.0.0.1\"",
            "warning: nobody can send images by C-STORE: `pacs.dimse.peers` has peers",
        ),
        (
            "[storage]\ndatabase = \"postgres://isocortex@127.0.0.1/isocortex\"",
            "name a bucket or a shared folder in `storage.objects`",
        ),
    ] {
        let config = written(folder.path(), "doubtful.toml", text);
        let (status, said) = run(&["check-config", "--config", &config]);
        assert_eq!(status, Some(0), "{text}: {said}");
        assert!(said.contains(words), "{text}: {said}");
    }
    for (text, words) in [
        (
            "[http]\nlisten = \"0.0.0.0:8640\"",
            "without a bearer token",
        ),
        ("[http]\ntoken_file = \"/nowhere\"", "/nowhere"),
        ("[http]\nallowed_origins = [\"*\"]", "is no origin"),
        (
            "[pacs.dimse]\nlisten = \"127.0.0.1:1\"\n[[pacs.dimse.peers]]\naet = \"A\"\naddress = \"10.0.0/8\"",
            "a network such as",
        ),
        ("[http]\nmax_uplods = 1", "max_uplods"),
        ("[render]\nthreads = 0", "render.threads"),
        ("[audit]\nfolder = \"/nowhere\"", "`audit.folder`"),
        ("[pacs]\ntime_zone = \"Mars/Phobos\"", "`pacs.time_zone`"),
        (
            "[pacs]\ntime_zone = \"+25:00\"",
            "from `-12:00` to `+14:00`",
        ),
        ("[storage]\ndata = \"/etc/passwd\"", "is no folder"),
        ("[storage]\ndata = \"/etc/passwd/store\"", "is no folder"),
        (
            "[http]\nlisten = \"127.0.0.1:8640\"\n[pacs.dimse]\nlisten = \"127.0.0.1:8640\"",
            "the same port 8640",
        ),
        (
            "[pacs.dimse]\ntls_certificate = \"/nowhere\"\ntls_key = \"/nowhere\"",
            "/nowhere",
        ),
    ] {
        let config = written(folder.path(), "bad.toml", text);
        let (status, said) = run(&["check-config", "--config", &config]);
        assert_eq!(status, Some(78), "{text}: {said}");
        assert!(said.contains(words), "{text}: {said}");
    }
    // Who reads the log as JSON reads this error, too.
    let config = written(folder.path(), "bad.toml", "[http");
    let (status, said) = run(&["serve", "--log-format", "json", "--config", &config]);
    assert_eq!(status, Some(78), "{said}");
    let line: serde_json::Value = serde_json::from_str(said.trim()).unwrap();
    assert_eq!(line["level"], "ERROR", "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_is_tested_by_command_and_by_request() {
    let node = Archive::start().await;
    let (root, address) = (node.root(), node.address);
    let nodes = format!(
        "[[pacs.nodes]]\nname = \"good\"\nurl = \"{root}\"\n\
         [[pacs.nodes]]\nname = \"rootless\"\nurl = \"http://{address}/\"\n\
         [[pacs.nodes]]\nname = \"gone\"\naet = \"GONE\"\naddress = \"127.0.0.1:1\"\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let config = written(folder.path(), "isocortex.toml", &nodes);
    let test = |name: &'static str| {
        let config = config.clone();
        tokio::task::spawn_blocking(move || run(&["test-node", "--config", &config, name]))
    };
    let expected = [
        ("good", 0, "dicomweb: it answers"),
        ("rootless", 69, "name the root"),
        ("gone", 69, "c-store: the node cannot be reached"),
        ("nobody", 2, "no node of the configuration"),
    ];
    for (name, status, words) in expected {
        let (found, said) = test(name).await.unwrap();
        assert_eq!(found, Some(status), "{name}: {said}");
        assert!(said.contains(words), "{name}: {said}");
    }

    let parsed: isocortex::config::Config = toml_of(folder.path(), &nodes);
    let server = Server::start_with(|config| config.pacs = parsed.pacs).await;
    for (name, is_reachable) in [("good", true), ("rootless", false), ("gone", false)] {
        let test = format!("/v1/pacs/nodes/{name}/test");
        let answer = server.method(Method::POST, &test).await.json();
        assert_eq!(answer["is_reachable"], is_reachable, "{answer}");
        assert_eq!(answer["services"].as_array().unwrap().len(), 1);
    }
    let reached = server.pacs.reached();
    let expected = [("gone", false), ("good", true), ("rootless", true)];
    assert_eq!(reached, expected.map(|(name, is)| (name.to_owned(), is)));
    let missing = server
        .method(Method::POST, "/v1/pacs/nodes/nobody/test")
        .await;
    assert_eq!(missing.status, 404);
}

fn toml_of(folder: &Path, text: &str) -> isocortex::config::Config {
    let file = written(folder, "again.toml", text);
    isocortex::config::Config::read(Path::new(&file)).unwrap()
}

#[tokio::test]
async fn pages_of_listed_origins_may_read_and_embed_and_no_others() {
    let server = Server::start_with(|config| {
        config.http.allowed_origins = vec!["https://viewer.example".to_owned()];
        config.http.frame_ancestors = vec!["https://pacs.example".to_owned()];
    })
    .await;
    let ask = async |method: Method, origin: &str, headers: &[(&str, &str)]| {
        let mut request = Request::builder()
            .method(&method)
            .uri(match method == Method::POST {
                true => "/dicomweb/studies",
                false => "/v1/cases",
            })
            .header("host", "localhost")
            .header("origin", origin);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        server.send(request.body(Body::empty()).unwrap()).await
    };
    // As a viewer asks: a question, because of the header with the token, and the list itself.
    let question = [
        ("access-control-request-method", "GET"),
        ("access-control-request-headers", "authorization"),
    ];
    let listed = "https://viewer.example";
    let answer = ask(Method::OPTIONS, listed, &question).await;
    assert_eq!(answer.status, 204);
    assert_eq!(answer.header("access-control-allow-origin"), listed);
    assert!(
        answer
            .header("access-control-allow-headers")
            .contains("authorization")
    );
    let list = ask(Method::GET, listed, &[]).await;
    assert_eq!(list.status, 200);
    assert_eq!(list.header("access-control-allow-origin"), listed);
    assert!(
        list.header("access-control-expose-headers")
            .contains("retry-after")
    );
    let cross = [("sec-fetch-site", "cross-site")];
    let stored = ask(Method::POST, listed, &cross).await;
    assert_eq!(stored.status, 415, "it is not refused for its origin");

    for other in ["https://evil.example", "http://viewer.example", "null"] {
        let answer = ask(Method::OPTIONS, other, &question).await;
        assert_eq!(answer.status, 405, "{other}");
        let read = ask(Method::GET, other, &[]).await;
        assert!(read.headers.get("access-control-allow-origin").is_none());
        assert_eq!(read.header("vary"), "origin");
        assert_eq!(
            ask(Method::POST, other, &cross).await.status,
            403,
            "{other}"
        );
    }
    let page = server.get("/").await;
    let policy = page.header("content-security-policy");
    assert!(
        policy.ends_with("frame-ancestors 'self' https://pacs.example"),
        "{policy}"
    );

    let usual = Server::start().await;
    let read = usual.get_with("/v1/cases", &[("origin", listed)]).await;
    assert!(read.headers.get("access-control-allow-origin").is_none());
    let policy = usual.get("/").await;
    let policy = policy.header("content-security-policy");
    assert!(policy.ends_with("frame-ancestors 'self'"), "{policy}");
}
