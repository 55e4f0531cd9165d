//! A real Orthanc beside the server: it sends by STOW-RS and C-STORE, and series are fetched from it.
//!
//! It needs the Debian packages `orthanc`, `orthanc-dicomweb` and `dcmtk`, and `curl`.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use ::pacs::dimse::{self, DimseOptions, Peer};
use axum::body::Body;
use axum::http::Request;
use pacs::settings::Node;
use serde_json::{Value, json};
use tokio::net::TcpListener;

use crate::dicom::head_slices;
use crate::findings::mark;
use crate::pacs::{Neighbour, dcmtk};
use crate::results::{identified_case, result, until_sent};
use crate::series_builder::Syntax;
use crate::skipped;
use crate::storage_nodes::{every_kind, to_node};
use crate::until::until;

const PLUGIN: &str = "/usr/share/orthanc/plugins/libOrthancDicomWeb.so";
const PYTHON_PLUGIN: &str = "/usr/share/orthanc/plugins/libOrthancPython.so";
const BUTTON: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../docker/orthanc/isocortex.py"
);
const USER: &str = "alice:orthanctest";
const TOKEN: &str = "0123456789abcdef";

/// A port that is free now.
pub(crate) fn free_port() -> u16 {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

struct Orthanc {
    process: Child,
    http: u16,
    dicom: u16,
    folder: tempfile::TempDir,
}

impl Drop for Orthanc {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn program() -> Option<PathBuf> {
    let found = ["/usr/sbin/Orthanc", "/usr/bin/Orthanc"];
    let found = found.iter().map(PathBuf::from).find(|path| path.exists());
    if found.is_none() || !Path::new(PLUGIN).exists() {
        skipped("Orthanc or its DICOMweb plug-in is not installed");
        return None;
    }
    found
}

impl Orthanc {
    /// One that knows us, and runs the scripts; `None` if there is none here.
    async fn start(
        [http, dicom]: [u16; 2],
        ours: &str,
        our_dicom: u16,
        scripts: &[&str],
    ) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let configuration = json!({
            "Name": "test",
            "StorageDirectory": folder.path().join("storage"),
            "IndexDirectory": folder.path().join("index"),
            "Plugins": [PLUGIN],
            "HttpPort": http,
            "RemoteAccessAllowed": false,
            "AuthenticationEnabled": true,
            "RegisteredUsers": {"alice": "orthanctest"},
            "ExecuteLuaEnabled": false,
            "LuaScripts": scripts,
            "StableAge": 2,
            "DicomAet": "ORTHANCTEST",
            "DicomPort": dicom,
            "DicomAlwaysAllowStore": true,
            "DicomModalities": {"isocortex": {"AET": "ISOCORTEX", "Host": "127.0.0.1", "Port": our_dicom}},
            "DicomWeb": {"Enable": true, "Root": "/dicom-web/", "Servers": {"isocortex": {"Url": format!("{ours}/dicomweb/"), "HasDelete": "0", "Username": "orthanc", "Password": TOKEN}}}
        });
        let mut configuration = configuration;
        if Path::new(PYTHON_PLUGIN).exists() {
            configuration["Plugins"] = json!([PLUGIN, PYTHON_PLUGIN]);
            configuration["PythonScript"] = BUTTON.into();
        } else {
            skipped("the Python plug-in of Orthanc is not installed");
        }
        let [file, token] = ["orthanc.json", "token"].map(|name| folder.path().join(name));
        std::fs::write(&file, configuration.to_string()).unwrap();
        std::fs::write(&token, format!("{TOKEN}\n")).unwrap();
        let process = Command::new(program()?)
            .arg(&file)
            .env("ISOCORTEX_URL", ours)
            .env("ISOCORTEX_TOKEN_FILE", &token)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let orthanc = Self {
            process,
            http,
            dicom,
            folder,
        };
        until("Orthanc answers", async || {
            orthanc.ask("/system", None).await
        })
        .await;
        Some(orthanc)
    }

    /// The bytes of an answer of its DICOMweb plug-in; `None` if it refuses.
    async fn bytes(&self, path: &str, accept: &str) -> Option<Vec<u8>> {
        self.fetch(&format!("/dicom-web{path}"), accept).await
    }

    async fn fetch(&self, path: &str, accept: &str) -> Option<Vec<u8>> {
        let mut curl = Command::new("curl");
        curl.args(["--silent", "--fail", "--user", USER]);
        curl.args(["--header", &format!("Accept: {accept}")]);
        curl.arg(format!("http://127.0.0.1:{}{path}", self.http));
        let run = move || curl.output().expect("curl is installed");
        let output = tokio::task::spawn_blocking(run).await.unwrap();
        output.status.success().then_some(output.stdout)
    }

    /// A successful answer, to a GET or, with a body, to a POST.
    async fn ask(&self, path: &str, body: Option<Value>) -> Option<Value> {
        let mut curl = Command::new("curl");
        curl.args(["--silent", "--fail", "--user", USER]);
        if let Some(body) = body {
            curl.args(["--data", &body.to_string()]);
        }
        curl.arg(format!("http://127.0.0.1:{}{path}", self.http));
        let run = move || curl.output().expect("curl is installed");
        let output = tokio::task::spawn_blocking(run).await.unwrap();
        let is_json = output.status.success();
        is_json.then(|| serde_json::from_slice(&output.stdout).unwrap_or(Value::Null))
    }

    /// Stores the head; the name of its series here.
    async fn with_head(&self) -> Option<String> {
        let storescu = dcmtk("storescu")?;
        let files = self.folder.path().join("files");
        std::fs::create_dir(&files).unwrap();
        for (number, slice) in head_slices().iter().enumerate() {
            let file = files.join(format!("{number}.dcm"));
            std::fs::write(file, slice.file(Syntax::Explicit)).unwrap();
        }
        let mut command = Command::new(storescu);
        command.args(["-R", "+sd", "-aec", "ORTHANCTEST", "127.0.0.1"]);
        command.arg(self.dicom.to_string()).arg(files);
        let run = move || command.output().unwrap();
        let output = tokio::task::spawn_blocking(run).await.unwrap();
        assert!(output.status.success(), "{output:?}");
        let series = self.ask("/series", None).await.unwrap();
        Some(series[0].as_str().unwrap().to_owned())
    }
}

#[tokio::test]
async fn orthanc_sends_a_series_in_both_ways_and_it_is_fetched_from_there() {
    if program().is_none() {
        return;
    }
    let ports = [free_port(), free_port()];
    let secret = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(secret.path(), "orthanctest\n").unwrap();
    let node = |name: &str, password_file: &Path| Node {
        name: name.to_owned(),
        url: Some(format!("http://127.0.0.1:{}/dicom-web/", ports[0])),
        user: Some("alice".to_owned()),
        password_file: Some(password_file.to_owned()),
        ..Node::default()
    };
    let wrong = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(wrong.path(), "wrong").unwrap();
    let neighbour = Neighbour::start(|config| {
        config.pacs.nodes = vec![node("orthanc", secret.path()), node("wrong", wrong.path())];
    })
    .await;
    let server = &neighbour.server;
    let socket = server.on_a_socket().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let dicom = listener.local_addr().unwrap().port();
    let options = DimseOptions {
        peers: vec![Peer {
            aet: "ORTHANCTEST".to_owned(),
            address: [127, 0, 0, 1].into(),
            may_reject: false,
        }],
        ..DimseOptions::default()
    };
    let stop = std::future::pending();
    let grace = Duration::from_secs(1);
    tokio::spawn(dimse::serve(
        listener,
        server.pacs.arrivals().clone(),
        options,
        stop,
        grace,
    ));
    let ours = format!("http://{}", socket.address);
    let orthanc = Orthanc::start(ports, &ours, dicom, &[]).await.unwrap();
    if Path::new(PYTHON_PLUGIN).exists() {
        let scripts = orthanc.fetch("/plugins/explorer.js", "*/*").await.unwrap();
        assert!(String::from_utf8_lossy(&scripts).contains("Open in Isocortex"));
    }
    let Some(series) = orthanc.with_head().await else {
        return;
    };

    let delete = async |arrival: &Value| {
        let address = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
        server.method(axum::http::Method::DELETE, &address).await;
        let left = server.get("/v1/arrivals").await.json();
        assert_eq!(left["arrivals"], json!([]));
    };

    // STOW-RS by Orthanc's own job, which fails unless every image is in the answer.
    let order = json!({"Resources": [series], "Synchronous": true});
    let sent = orthanc.ask("/dicom-web/servers/isocortex/stow", Some(order));
    assert!(sent.await.is_some(), "the job of Orthanc succeeds");
    let by_stow = neighbour.settled().await;
    assert_eq!(by_stow["state"], "case", "{by_stow}");
    delete(&by_stow).await;

    // C-STORE by Orthanc.
    let order = json!({"Resources": [series], "Synchronous": true});
    let sent = orthanc
        .ask("/modalities/isocortex/store", Some(order))
        .await;
    assert!(sent.is_some(), "the job of Orthanc succeeds");
    let by_store = neighbour.settled().await;
    assert_eq!(by_store["source"], "c-store");
    assert_eq!(
        by_store["case"], by_stow["case"],
        "the same images are the same case"
    );
    delete(&by_store).await;

    // QIDO-RS and WADO-RS, as a notice of Orthanc requests it, twice.
    let _background = pacs::start_transfers(server.pacs.clone());
    let post = async |address: &str, body: Value| {
        let request = Request::post(address).body(Body::from(body.to_string()));
        server.send(request.unwrap()).await
    };
    let notice =
        json!({"node": "orthanc", "StudyInstanceUID": "1.2.3", "SeriesInstanceUID": "1.2.3.1"});
    post("/hooks/orthanc", notice.clone()).await;
    let accepted = post("/hooks/orthanc", notice).await;
    assert_eq!(accepted.status, 202);
    let until_ended = async |address: &str| {
        until("the retrieval ends", async || {
            let retrieval = server.get(address).await.json();
            let has_ended = retrieval["state"] == "done" || retrieval["state"] == "failed";
            has_ended.then_some(retrieval)
        })
        .await
    };
    let retrieval = until_ended(accepted.header("location")).await;
    assert_eq!(retrieval["state"], "done", "{retrieval}");
    assert_eq!(retrieval["received"], head_slices().len());
    assert_eq!(retrieval["expected"], head_slices().len());
    let fetched = neighbour.settled().await;
    assert_eq!(fetched["source"], "retrieval");
    assert_eq!(fetched["case"], by_stow["case"]);

    // What the node does not have, and what it does not give.
    for (node, series, reason) in [
        ("orthanc", "1.2.3.99", "node-has-no-such-series"),
        ("wrong", "1.2.3.1", "node-refused"),
    ] {
        let order = json!({"node": node, "study": "1.2.3", "series": series});
        let accepted = post("/v1/retrievals", order).await;
        let retrieval = until_ended(accepted.header("location")).await;
        assert_eq!(retrieval["reason"]["name"], reason, "{retrieval}");
    }
}

#[tokio::test]
async fn a_notice_of_orthanc_s_script_fetches_each_new_series() {
    if program().is_none() {
        return;
    }
    let ports = [free_port(), free_port()];
    let secret = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(secret.path(), "orthanctest").unwrap();
    let neighbour = Neighbour::start(|config| {
        config.http.token = Some(isocortex::config::Secret(TOKEN.to_owned()));
        config.pacs.nodes = vec![Node {
            name: "orthanc".to_owned(),
            url: Some(format!("http://127.0.0.1:{}/dicom-web", ports[0])),
            user: Some("alice".to_owned()),
            password_file: Some(secret.path().to_owned()),
            ..Node::default()
        }];
    })
    .await;
    let socket = neighbour.server.on_a_socket().await;
    let ours = format!("http://{}", socket.address);
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../docker/orthanc/isocortex.lua"
    );
    let orthanc = Orthanc::start(ports, &ours, free_port(), &[script])
        .await
        .unwrap();
    let _background = pacs::start_transfers(neighbour.server.pacs.clone());
    if orthanc.with_head().await.is_some() {
        let arrival = neighbour.settled().await;
        assert_eq!(arrival["state"], "case", "{arrival}");
        assert_eq!(arrival["source"], "retrieval");
    }
}

#[tokio::test]
async fn orthanc_stores_results_once_and_shows_them() {
    if program().is_none() {
        return;
    }
    let ports = [free_port(), free_port()];
    let secret = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(secret.path(), "orthanctest").unwrap();
    let neighbour = Neighbour::start(|config| {
        config.pacs.nodes = vec![Node {
            name: "orthanc".to_owned(),
            url: Some(format!("http://127.0.0.1:{}/dicom-web", ports[0])),
            user: Some("alice".to_owned()),
            password_file: Some(secret.path().to_owned()),
            ..Node::default()
        }];
    })
    .await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    // Results are annotated by default, pictures are not.
    let render = json!({"depth_mm": 5, "width": 200, "height": 160, "annotate": false});
    let bodies = [
        json!({"what": "view", "render": render, "node": "orthanc"}),
        json!({"what": "mask", "node": "orthanc"}),
    ];
    // Orthanc is not there yet: what is requested now is sent later.
    let _background = pacs::start_transfers(server.pacs.clone());
    let mut accepted = Vec::new();
    for body in bodies.iter().chain(&bodies) {
        accepted.push(result(server, &case, body).await);
    }
    let orthanc = Orthanc::start(ports, "http://127.0.0.1:1", free_port(), &[])
        .await
        .unwrap();
    let mut instances = Vec::new();
    for accepted in &accepted {
        let sent = until_sent(server, accepted).await;
        assert_eq!(sent["state"], "done", "{sent}");
        instances.push(sent["instance"].as_str().unwrap().to_owned());
    }
    assert_eq!(
        instances[..2],
        instances[2..],
        "equal requests are one object"
    );
    let stored = orthanc.ask("/instances", None).await.unwrap();
    assert_eq!(stored.as_array().unwrap().len(), 2);
    let picture = server
        .get(&format!("{case}/render?depth_mm=5&width=200&height=160"))
        .await;
    let picture = image::load_from_memory(&picture.body).unwrap().into_rgb8();
    let instance = &instances[0];
    let address = format!("/dicom-web/instances?SOPInstanceUID={instance}");
    let found = orthanc.ask(&address, None).await.unwrap();
    let series = &found[0]["0020000E"]["Value"][0].as_str().unwrap();
    assert_eq!(
        found[0]["0020000D"]["Value"][0], "1.2.3",
        "the study of the source"
    );
    let address = format!("/studies/1.2.3/series/{series}/instances/{instance}/rendered");
    let shown = orthanc.bytes(&address, "image/png").await;
    let shown = shown.expect("Orthanc renders it");
    let shown = image::load_from_memory(&shown).unwrap().into_rgb8();
    assert!(shown.iter().any(|&value| value > 20), "it is not black");
    assert!(shown == picture, "Orthanc shows what was drawn");
}

#[tokio::test]
async fn orthanc_has_each_kind_of_result_once_by_c_store() {
    if program().is_none() {
        return;
    }
    let ports = [free_port(), free_port()];
    let secret = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(secret.path(), "orthanctest").unwrap();
    // A node with both: series come from its DICOMweb, results go by C-STORE.
    let neighbour = Neighbour::start(|config| {
        config.pacs.nodes = vec![Node {
            name: "orthanc".to_owned(),
            url: Some("http://127.0.0.1:1/dicom-web".to_owned()),
            user: Some("alice".to_owned()),
            password_file: Some(secret.path().to_owned()),
            aet: Some("ORTHANCTEST".to_owned()),
            address: Some(format!("127.0.0.1:{}", ports[1])),
            ..Node::default()
        }];
    })
    .await;
    let case = identified_case(&neighbour).await;
    let server = &neighbour.server;
    mark(server, &case).await;
    let orthanc = Orthanc::start(ports, "http://127.0.0.1:1", free_port(), &[])
        .await
        .unwrap();
    let _background = pacs::start_transfers(server.pacs.clone());
    let kinds = every_kind();
    let mut instances = Vec::new();
    for (name, body) in kinds.iter().chain(&kinds) {
        let accepted = result(server, &case, &to_node(body, "orthanc")).await;
        let sent = until_sent(server, &accepted).await;
        assert_eq!(sent["state"], "done", "{name}: {sent}");
        instances.push(sent["instance"].as_str().unwrap().to_owned());
    }
    let stored = orthanc.ask("/instances", None).await.unwrap();
    assert_eq!(stored.as_array().unwrap().len(), kinds.len());
    for ((name, body), instance) in kinds.iter().zip(&instances) {
        let object = result(server, &case, body).await.body;
        let address = format!("/instances?SOPInstanceUID={instance}");
        let found = orthanc.ask(&format!("/dicom-web{address}"), None).await;
        let found = found.unwrap();
        assert_eq!(found[0]["0020000D"]["Value"][0], "1.2.3", "{name}");
        let series = found[0]["0020000E"]["Value"][0].as_str().unwrap();
        let address = format!("/studies/1.2.3/series/{series}/instances/{instance}");
        let accept = "multipart/related; type=\"application/dicom\"; transfer-syntax=*";
        let file = orthanc.bytes(&address, accept).await.unwrap();
        // Orthanc writes the lengths of sequences again. What is no sequence is the same: pixels, which end an object, or the document
        // of a report, after which comes the sequence of its sources.
        let same: &[u8] = match *name {
            "findings" => &[],
            "report" => document(&object),
            _ => &object[object.len() - 200..],
        };
        let is_whole = same.is_empty() || memchr::memmem::find(&file, same).is_some();
        assert!(
            is_whole,
            "{name}: Orthanc has other pixels or another document"
        );
    }
}

/// The PDF within an object.
fn document(object: &[u8]) -> &[u8] {
    let start = memchr::memmem::find(object, b"%PDF-").expect("a PDF begins");
    let end = memchr::memmem::rfind(object, b"%%EOF").expect("a PDF ends");
    &object[start..end]
}
