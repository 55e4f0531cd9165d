//! The whole way beside archives that speak DIMSE alone, DCMTK's `dcmqrscp` and pynetdicom's `qrscp`: they send a study when they are
//! asked to, store the results, send them back with the images, and send the images of a corrected patient.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use pacs::dimse::{DimseOptions, Peer};
use serde_json::{Value, json};

use crate::corrections::corrected_head;
use crate::findings::mark;
use crate::orthanc::free_port;
use crate::pacs::{NO_DELAY, Neighbour, dcmtk, dimse, run};
use crate::results::{identified_head, python_with, result, until_sent};
use crate::storage_nodes::{add_storage_node, every_kind, to_node};
use crate::until::until;

/// An archive on this machine. Dropping it ends it.
struct Archive {
    process: Child,
    port: u16,
    folder: tempfile::TempDir,
}

impl Drop for Archive {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// How to start an archive in a folder on a port; `us` is where it sends to.
type Start = fn(&Path, u16, SocketAddr) -> Option<Command>;

/// DCMTK's archive.
fn dcmqrscp(folder: &Path, port: u16, us: SocketAddr) -> Option<Command> {
    let program = dcmtk("dcmqrscp")?;
    let images = folder.join("images");
    std::fs::create_dir(&images).unwrap();
    let settings = format!(
        "NetworkTCPPort = {port}\nMaxPDUSize = 16384\nMaxAssociations = 16\n\
         HostTable BEGIN\nus = (ISOCORTEX, 127.0.0.1, {})\nHostTable END\n\
         VendorTable BEGIN\nVendorTable END\n\
         AETable BEGIN\nARCHIVE {} RW (9, 1024mb) ANY\nAETable END\n",
        us.port(),
        images.display(),
    );
    let file = folder.join("dcmqrscp.cfg");
    std::fs::write(&file, settings).unwrap();
    let mut command = Command::new(program);
    command.env(NO_DELAY.0, NO_DELAY.1).arg("-c").arg(file);
    Some(command)
}

/// The archive of pynetdicom.
fn qrscp(folder: &Path, port: u16, us: SocketAddr) -> Option<Command> {
    let python = python_with("sqlalchemy, pynetdicom")?;
    let settings = format!(
        "[DEFAULT]\nae_title: ARCHIVE\nport: {port}\nmax_pdu: 16382\nacse_timeout: 30\ndimse_timeout: 30\n\
         network_timeout: 30\nbind_address: 127.0.0.1\ninstance_location: {}\ndatabase_location: {}\n\n\
         [ISOCORTEX]\naddress: 127.0.0.1\nport: {}\n",
        folder.join("images").display(),
        folder.join("images.sqlite").display(),
        us.port(),
    );
    let file = folder.join("qrscp.ini");
    std::fs::write(&file, settings).unwrap();
    let mut command = Command::new(python);
    command.args(["-m", "pynetdicom", "qrscp", "-c"]).arg(file);
    Some(command)
}

impl Archive {
    async fn start(port: u16, us: SocketAddr, start: Start) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = start(folder.path(), port, us)?;
        let process = command.stdout(Stdio::null()).stderr(Stdio::null());
        let archive = Self {
            process: process.spawn().unwrap(),
            port,
            folder,
        };
        until("the archive listens", async || {
            let connected = tokio::net::TcpStream::connect(("127.0.0.1", port)).await;
            connected.ok()
        })
        .await;
        Some(archive)
    }

    /// Stores files in it, as a scanner does.
    async fn store(&self, files: &[Vec<u8>]) {
        let folder = tempfile::tempdir().unwrap();
        let mut paths: Vec<PathBuf> = Vec::new();
        for (number, file) in files.iter().enumerate() {
            paths.push(folder.path().join(format!("{number}.dcm")));
            std::fs::write(paths.last().unwrap(), file).unwrap();
        }
        let port = self.port.to_string();
        let mut arguments = vec!["-aet", "SCANNER", "-aec", "ARCHIVE", "127.0.0.1", &port];
        arguments.extend(paths.iter().map(|path| path.to_str().unwrap()));
        let stored = run(&dcmtk("storescu").unwrap(), &arguments).await;
        assert!(stored.status.success(), "{stored:?}");
    }

    /// Lets it send the study to us, by C-MOVE; returns whether it was warned.
    async fn send(&self) -> bool {
        let port = self.port.to_string();
        let level = ["-k", "QueryRetrieveLevel=STUDY"];
        let study = ["-k", "StudyInstanceUID=1.2.3", "127.0.0.1", &port];
        let titles = ["-S", "-aet", "SCANNER", "-aec", "ARCHIVE"];
        let to = ["-aem", "ISOCORTEX"];
        let arguments = [&titles[..], &to, &level, &study].concat();
        let moved = run(&dcmtk("movescu").unwrap(), &arguments).await;
        let is_warned = String::from_utf8_lossy(&moved.stderr).contains("Warning: SubOperations");
        assert!(moved.status.success() || is_warned, "{moved:?}");
        is_warned
    }

    /// The files that it has.
    fn files(&self) -> Vec<Vec<u8>> {
        let files = storage::testing::files_below(&self.folder.path().join("images"));
        files
            .iter()
            .map(|file| std::fs::read(file).unwrap())
            .collect()
    }
}

/// The arrival of the images, all of which came, once it is a case other than one.
async fn case_other_than(neighbour: &Neighbour, before: &Value) -> Value {
    neighbour.all_has_come();
    until("another case comes", async || {
        let list = neighbour.server.get("/v1/arrivals?state=case").await;
        match &list.json()["arrivals"].as_array().unwrap()[..] {
            [arrival] if arrival["case"] != *before => Some(arrival["case"].clone()),
            _ => None,
        }
    })
    .await
}

async fn goes_the_whole_way(start: Start) {
    if dcmtk("storescu").is_none() || dcmtk("movescu").is_none() {
        return;
    }
    let port = free_port();
    let neighbour = Neighbour::start(|config| {
        add_storage_node(config, "archive", "ARCHIVE", port);
    })
    .await;
    let peer = Peer {
        aet: "ARCHIVE".to_owned(),
        address: [127, 0, 0, 1].into(),
        // It sends back our own notes, too.
        may_reject: true,
    };
    let options = DimseOptions {
        peers: vec![peer],
        max_associations: 16,
        ..DimseOptions::default()
    };
    let us = dimse(&neighbour, options).await;
    let Some(archive) = Archive::start(port, us, start).await else {
        return;
    };
    let server = &neighbour.server;

    // The images come, and become a case.
    archive.store(&identified_head()).await;
    assert!(!archive.send().await);
    let old = case_other_than(&neighbour, &Value::Null).await;
    let address = format!("/v1/cases/{}", old.as_str().unwrap());
    server.until_ready(&address).await;

    // Results go out and are there.
    mark(server, &address).await;
    let _background = pacs::start_transfers(server.pacs.clone());
    for (name, body) in every_kind() {
        let accepted = result(server, &address, &to_node(&body, "archive")).await;
        let sent = until_sent(server, &accepted).await;
        assert_eq!(sent["state"], "done", "{name}: {sent}");
        let instance = sent["instance"].as_str().unwrap().as_bytes();
        let has = |file: &Vec<u8>| memchr::memmem::find(file, instance).is_some();
        assert!(archive.files().iter().any(has), "{name} is not there");
    }

    // The study comes back with them, and nothing changes.
    assert!(!archive.send().await);
    assert_eq!(case_other_than(&neighbour, &Value::Null).await, old);

    // A corrected patient makes another case, and nothing more is sent of the old one.
    archive.store(&corrected_head()).await;
    assert!(archive.send().await, "each image is answered B000");
    let new = case_other_than(&neighbour, &old).await;
    let view = json!({"what": "view", "node": "archive"});
    assert_eq!(result(server, &address, &view).await.problem(), "closed");
    let new = format!("/v1/cases/{}", new.as_str().unwrap());
    server.until_ready(&new).await;
    let attributes = server.get(&format!("{new}/dicom")).await.json();
    assert_eq!(attributes["attributes"]["PatientID"], "PAT-RIGHT");
}

#[tokio::test]
async fn dcmqrscp_sends_a_study_stores_its_results_and_corrects_its_patient() {
    goes_the_whole_way(dcmqrscp).await;
}

#[tokio::test]
async fn qrscp_sends_a_study_stores_its_results_and_corrects_its_patient() {
    goes_the_whole_way(qrscp).await;
}
