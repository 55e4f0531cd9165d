//! Results that are sent by C-STORE: to storescp of DCMTK, and to another Isocortex, which keeps MR and CT images only; and
//! TLS in both directions.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use ::pacs::dimse::{self, ReloadedTls, TlsAuthority, TlsIdentity, listening_tls};
use axum::body::Body;
use axum::http::Request;
use isocortex::config::Config;
use pacs::settings::Node;
use serde_json::{Value, json};

use crate::findings::mark;
use crate::orthanc::free_port;
use crate::pacs::{Neighbour, dcmtk, dimse, dimse_options};
use crate::results::{RETRY_AFTER, identified_case, result, small, until_sent, until_tried};
use crate::skipped;
use crate::until::until;

/// The data set of a file, without its head.
fn data_set(file: &[u8]) -> &[u8] {
    let length = u32::from_le_bytes(file[140..144].try_into().unwrap());
    &file[144 + length as usize..]
}

/// A result of each kind, with its name.
pub(crate) fn every_kind() -> [(&'static str, Value); 7] {
    let size = json!({"width": 128, "height": 128});
    [
        ("view", json!({"what": "view", "render": small()})),
        ("sheet", json!({"what": "sheet", "render": size})),
        ("envelope", json!({"what": "envelope"})),
        ("mask", json!({"what": "mask"})),
        ("findings", json!({"what": "findings"})),
        ("finding-segments", json!({"what": "finding-segments"})),
        ("report", json!({"what": "report"})),
    ]
}

/// A request, to be sent to a node.
pub(crate) fn to_node(body: &Value, node: &str) -> Value {
    let mut body = body.clone();
    body["node"] = node.into();
    body
}

/// Adds a node for C-STORE.
pub(crate) fn add_storage_node(config: &mut Config, name: &str, aet: &str, port: u16) {
    config.pacs.nodes.push(Node {
        name: name.to_owned(),
        aet: Some(aet.to_owned()),
        address: Some(format!("127.0.0.1:{port}")),
        ..Node::default()
    });
}

/// A storage program of DCMTK.
struct Storescp {
    process: Child,
    folder: tempfile::TempDir,
}

impl Drop for Storescp {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Storescp {
    async fn start(port: u16, options: &[&str]) -> Option<Self> {
        let program = dcmtk("storescp")?;
        let folder = tempfile::tempdir().unwrap();
        let images = folder.path().join("images");
        std::fs::create_dir(&images).unwrap();
        let process = Command::new(program)
            .args(["-aet", "ARCHIVE", "-od"])
            .arg(images)
            .args(options)
            .arg(port.to_string())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let storescp = Self { process, folder };
        until("storescp listens", async || {
            let connected = tokio::net::TcpStream::connect(("127.0.0.1", port)).await;
            connected.ok()
        })
        .await;
        Some(storescp)
    }

    fn images(&self) -> PathBuf {
        self.folder.path().join("images")
    }

    /// What it has stored.
    fn files(&self) -> Vec<Vec<u8>> {
        let entries = std::fs::read_dir(self.images()).unwrap();
        entries
            .map(|entry| std::fs::read(entry.unwrap().path()).unwrap())
            .collect()
    }
}

#[tokio::test]
async fn storescp_has_each_kind_of_result_once_and_as_it_is() {
    let port = free_port();
    let Some(storescp) = Storescp::start(port, &["+B"]).await else {
        return;
    };
    let neighbour = Neighbour::start(|config| {
        add_storage_node(config, "archive", "ARCHIVE", port);
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    mark(server, &case).await;
    let _background = pacs::start_transfers(server.pacs.clone());
    let (mut expected, mut withdrawn) = (Vec::new(), Vec::new());
    for (name, body) in every_kind() {
        let body_to_node = to_node(&body, "archive");
        let first = result(server, &case, &body_to_node).await;
        let first = until_sent(server, &first).await;
        assert_eq!(first["state"], "done", "{name}: {first}");
        let second = result(server, &case, &body_to_node).await;
        let second = until_sent(server, &second).await;
        assert_eq!(second["state"], "done", "{name}: {second}");
        assert_eq!(first["instance"], second["instance"]);
        expected.push((name, result(server, &case, &body).await.body));
        withdrawn.push(first["instance"].clone());
    }
    // What was sent is withdrawn by a note, which is a result, too.
    let note = json!({"what": "key-object",
        "key_object": {"instances": withdrawn, "title": "rejected-for-quality"}});
    let sent = result(server, &case, &to_node(&note, "archive")).await;
    assert_eq!(until_sent(server, &sent).await["state"], "done");
    expected.push(("note", result(server, &case, &note).await.body));
    let files = storescp.files();
    assert_eq!(files.len(), expected.len(), "each is stored once");
    for (name, object) in expected {
        let is_this = |file: &Vec<u8>| data_set(file) == data_set(&object);
        assert!(files.iter().any(is_this), "{name} is not as it was made");
    }
    // Nothing is fetched from a node without DICOMweb.
    let order = json!({"node": "archive", "study": "1.2.3", "series": "1.2.3.1"}).to_string();
    let order = Request::post("/v1/retrievals").body(Body::from(order));
    let refused = server.send(order.unwrap()).await;
    assert_eq!(refused.status, 422);
    assert_eq!(refused.problem(), "node-without-dicomweb");
}

#[tokio::test]
async fn a_node_that_accepts_only_implicit_syntax_has_the_same_attributes_and_pixels() {
    let port = free_port();
    let (Some(storescp), Some(dcmdump)) = (
        Storescp::start(port, &["+xi", "+B"]).await,
        dcmtk("dcmdump"),
    ) else {
        return;
    };
    let neighbour = Neighbour::start(|config| {
        add_storage_node(config, "archive", "ARCHIVE", port);
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let _background = pacs::start_transfers(server.pacs.clone());
    let attributes = |file: &[u8]| {
        let path = storescp.folder.path().join("dumped.dcm");
        std::fs::write(&path, file).unwrap();
        let output = Command::new(&dcmdump).arg("+L").arg(path).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        // The head and the pixels differ in their form.
        let lines = text.lines().map(str::trim_start).filter(|line| {
            line.starts_with('(') && !line.starts_with("(0002") && !line.starts_with("(7fe0")
        });
        let values = lines.filter_map(|line| line.split('#').next());
        values.map(str::to_owned).collect::<Vec<_>>()
    };
    for (name, body) in [every_kind()[0].clone(), every_kind()[3].clone()] {
        let sent = result(server, &case, &to_node(&body, "archive")).await;
        let sent = until_sent(server, &sent).await;
        assert_eq!(sent["state"], "done", "{name}: {sent}");
        let object = result(server, &case, &body).await.body;
        let files = storescp.files();
        let [file] = &files[..] else {
            panic!("{} files", files.len());
        };
        std::fs::remove_dir_all(storescp.images()).unwrap();
        std::fs::create_dir(storescp.images()).unwrap();
        let implicit = b"1.2.840.10008.1.2\0";
        assert!(memchr::memmem::find(&file[..400], implicit).is_some());
        assert_ne!(data_set(file), data_set(&object));
        let [arrived, made] = [attributes(file), attributes(&object)];
        assert!(made.len() > 40, "{name}");
        assert_eq!(arrived, made, "{name}");
        assert!(file.ends_with(&object[object.len() - 2000..]), "{name}");
    }
}

#[tokio::test]
async fn a_node_without_resources_is_sent_the_result_again() {
    let port = free_port();
    let Some(storescp) = Storescp::start(port, &[]).await else {
        return;
    };
    let neighbour = Neighbour::start(|config| {
        add_storage_node(config, "full", "ARCHIVE", port);
        add_storage_node(config, "away", "ARCHIVE", 1);
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    // Without its folder, storescp answers with A700.
    std::fs::remove_dir(storescp.images()).unwrap();
    let _background = pacs::start_transfers(server.pacs.clone());
    let body = every_kind()[0].1.clone();
    let accepted = result(server, &case, &to_node(&body, "full")).await;
    let state = until_tried(server, &accepted).await;
    assert_eq!(state["state"], "queued", "{state}");
    std::fs::create_dir(storescp.images()).unwrap();
    server.state.cases.store().pass_time(RETRY_AFTER);
    let sent = until_sent(server, &accepted).await;
    assert_eq!(sent["state"], "done", "{sent}");
    assert!(sent["attempts"].as_u64() >= Some(2), "{sent}");
    assert_eq!(storescp.files().len(), 1);
    // Nobody listens there.
    let accepted = result(server, &case, &to_node(&body, "away")).await;
    let state = until_tried(server, &accepted).await;
    assert_eq!(state["state"], "queued", "{state}");
}

#[tokio::test]
async fn a_node_that_refuses_is_believed_and_one_that_aborts_is_asked_again() {
    let [refusing, aborting] = [free_port(), free_port()];
    let (Some(_refusing), Some(_aborting)) = (
        Storescp::start(refusing, &["--refuse"]).await,
        Storescp::start(aborting, &["--abort-after"]).await,
    ) else {
        return;
    };
    // Another Isocortex, which knows one of our two titles.
    let other = Neighbour::start(|_| {}).await;
    let port = dimse(&other, dimse_options()).await.port();
    let neighbour = Neighbour::start(|config| {
        config.pacs.dimse.aet = "SENDER".to_owned();
        add_storage_node(config, "refusing", "ARCHIVE", refusing);
        add_storage_node(config, "aborting", "ARCHIVE", aborting);
        add_storage_node(config, "mistaken", "ARCHIVE", port);
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let _background = pacs::start_transfers(server.pacs.clone());
    let body = every_kind()[0].1.clone();
    for (node, reason, detail) in [
        ("refusing", "node-refused", "rejected the association"),
        ("mistaken", "node-refused", "correct the `aet` of the node"),
    ] {
        let accepted = result(server, &case, &to_node(&body, node)).await;
        let sent = until_sent(server, &accepted).await;
        assert_eq!(sent["state"], "failed", "{sent}");
        assert_eq!(sent["reason"]["name"], reason, "{sent}");
        let told = sent["reason"]["detail"].as_str().unwrap();
        assert!(told.contains(detail), "{told}");
    }
    let accepted = result(server, &case, &to_node(&body, "aborting")).await;
    let state = until_tried(server, &accepted).await;
    assert_eq!(state["state"], "queued", "{state}");

    let stranger = Neighbour::start(|config| {
        add_storage_node(config, "other", "ISOCORTEX", port);
    })
    .await;
    let case = identified_case(&stranger).await;
    let _background = pacs::start_transfers(stranger.server.pacs.clone());
    let accepted = result(&stranger.server, &case, &to_node(&body, "other")).await;
    let sent = until_sent(&stranger.server, &accepted).await;
    assert_eq!(sent["reason"]["name"], "node-refused", "{sent}");
    let told = sent["reason"]["detail"].as_str().unwrap();
    assert!(told.contains("our application entity title"), "{told}");
    let arrivals = other.server.get("/v1/arrivals").await.json();
    assert_eq!(arrivals["arrivals"], json!([]));
}

/// An authority, and a certificate of this machine that it has issued.
pub(crate) struct Certificates(tempfile::TempDir);

impl Certificates {
    /// `None`, loudly, if openssl is not installed.
    pub(crate) fn make() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let openssl = |arguments: &str| {
            let output = Command::new("openssl")
                .args(arguments.split(' '))
                .current_dir(folder.path())
                .output();
            output.map(|output| assert!(output.status.success(), "{output:?}"))
        };
        let authority = "req -x509 -newkey rsa:2048 -nodes -keyout ca.key -out ca.pem -days 30 -subj /CN=authority";
        if openssl(authority).is_err() {
            skipped("openssl is not installed");
            return None;
        }
        for step in [
            "req -newkey rsa:2048 -nodes -keyout key.pem -out request.pem -subj /CN=machine -addext subjectAltName=IP:127.0.0.1",
            "x509 -req -in request.pem -CA ca.pem -CAkey ca.key -CAcreateserial -copy_extensions copy -days 30 -out cert.pem",
        ] {
            openssl(step).unwrap();
        }
        Some(Self(folder))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    /// Shows its certificate, and accepts those of its authority.
    fn of_dcmtk(&self) -> [String; 5] {
        let [key, certificate, authority] =
            ["key.pem", "cert.pem", "ca.pem"].map(|name| self.text(name));
        [
            "+tls".to_owned(),
            key,
            certificate,
            "+cf".to_owned(),
            authority,
        ]
    }
}

#[tokio::test]
async fn results_go_by_tls_to_a_node_whose_authority_is_known() {
    let (Some(ours), Some(other)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let port = free_port();
    let options = ours.of_dcmtk();
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    let Some(storescp) = Storescp::start(port, &options).await else {
        return;
    };
    let add = |config: &mut Config, name: &str, authority: &Path| {
        add_storage_node(config, name, "ARCHIVE", port);
        let node = config.pacs.nodes.last_mut().unwrap();
        node.tls_authority = Some(authority.to_owned());
    };
    let neighbour = Neighbour::start(|config| {
        config.pacs.dimse.tls_certificate = Some(ours.path("cert.pem"));
        config.pacs.dimse.tls_key = Some(ours.path("key.pem"));
        add(config, "archive", &ours.path("ca.pem"));
        add(config, "stranger", &other.path("ca.pem"));
    })
    .await;
    let server = &neighbour.server;
    let case = identified_case(&neighbour).await;
    let _background = pacs::start_transfers(server.pacs.clone());
    let body = every_kind()[0].1.clone();
    let accepted = result(server, &case, &to_node(&body, "archive")).await;
    let sent = until_sent(server, &accepted).await;
    assert_eq!(sent["state"], "done", "{sent}");
    assert_eq!(storescp.files().len(), 1);
    let accepted = result(server, &case, &to_node(&body, "stranger")).await;
    let sent = until_sent(server, &accepted).await;
    assert_eq!(sent["reason"]["name"], "node-refused", "{sent}");
    let told = sent["reason"]["detail"].as_str().unwrap();
    assert!(told.contains("TLS"), "{told}");
    assert_eq!(storescp.files().len(), 1);
}

#[tokio::test]
async fn peers_are_served_by_tls_alone_if_it_is_configured() {
    let (Some(ours), Some(other)) = (Certificates::make(), Certificates::make()) else {
        return;
    };
    let Some(echoscu) = dcmtk("echoscu") else {
        return;
    };
    let identity = TlsIdentity::read(&ours.read("cert.pem"), &ours.read("key.pem")).unwrap();
    let authority = TlsAuthority::read(&ours.read("ca.pem")).unwrap();
    let neighbour = Neighbour::start(|_| {}).await;
    let with_tls = |authority: Option<&TlsAuthority>| dimse::DimseOptions {
        tls: Some(ReloadedTls::new(
            listening_tls(&identity, authority).unwrap(),
        )),
        ..dimse_options()
    };
    let open = dimse(&neighbour, with_tls(None)).await.port();
    let closed = dimse(&neighbour, with_tls(Some(&authority))).await.port();
    let nothing: [String; 0] = [];
    let anonymous = ["+tla", "+cf", &ours.text("ca.pem")].map(str::to_owned);
    let mut mistaken = other.of_dcmtk();
    mistaken[4] = ours.text("ca.pem");
    for (port, security, is_served) in [
        (open, &anonymous[..], true),
        (open, &ours.of_dcmtk(), true),
        (open, &other.of_dcmtk(), false),
        (open, &nothing, false),
        (closed, &ours.of_dcmtk(), true),
        (closed, &mistaken, false),
        (closed, &anonymous, false),
        (closed, &nothing, false),
    ] {
        let mut command = Command::new(&echoscu);
        command.args(["-to", "30", "-ta", "30", "-td", "30", "-aet", "SENDER"]);
        command.args(["-aec", "ISOCORTEX"]).args(security);
        command.args(["127.0.0.1", &port.to_string()]);
        let output = tokio::task::spawn_blocking(move || command.output());
        let output = output.await.unwrap().unwrap();
        assert_eq!(
            output.status.success(),
            is_served,
            "{security:?}: {output:?}"
        );
    }
}
