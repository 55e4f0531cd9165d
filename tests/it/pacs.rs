//! A PACS beside the server: images come by STOW-RS and C-STORE and become cases.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

use ::pacs::dimse::{self, DimseOptions, Peer, StorageNode};
use ::pacs::node::NodeError;
use ::pacs::{ArrivalOptions, ImageStatus, start_series_reader};
use axum::body::Body;
use axum::http::Request;
use case::series::{SeriesUids, Uid};
use cases::runner::Runner;
use imaging::dicom::write::KeyObjectTitle;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpSocket, TcpStream};

use crate::corrections::note_of;
use crate::dicom::{head_slices, reader};
use crate::scopes::TokensFile;
use crate::series_builder::{DataSet, Slice, Syntax, files};
use crate::server::{Answer, Server};
use crate::skipped;
use crate::until::until;

pub(crate) const BOUNDARY: &str =
    "a-boundary-of-more-than-seventy-characters-as-a-well-known-server-makes-it";

/// A body of files, without lengths.
pub(crate) fn related(files: &[Vec<u8>]) -> Vec<u8> {
    let mut body = Vec::new();
    for file in files {
        body.extend(format!("--{BOUNDARY}\r\nContent-Type: application/dicom\r\n\r\n").bytes());
        body.extend(file);
        body.extend(b"\r\n");
    }
    body.extend(format!("--{BOUNDARY}--\r\n").bytes());
    body
}

pub(crate) fn stow(address: &str, body: Vec<u8>) -> Request<Body> {
    let kind = format!("multipart/related; type=\"application/dicom\"; boundary={BOUNDARY}");
    Request::post(address)
        .header("content-type", kind)
        .header("accept", "application/dicom+json")
        .body(Body::from(body))
        .unwrap()
}

/// How long nothing may have come for a series.
const STABLE: Duration = Duration::from_millis(1500);

/// A server that reads series soon.
pub(crate) struct Neighbour {
    pub(crate) server: Server,
    reader: Runner,
}

impl Neighbour {
    pub(crate) async fn start(configure: impl FnOnce(&mut isocortex::config::Config)) -> Self {
        let server = Server::start_with(|config| {
            config.dicom_program = reader();
            configure(config);
        })
        .await;
        let options = ArrivalOptions {
            stable: STABLE,
            ..ArrivalOptions::default()
        };
        Self {
            reader: start_series_reader(server.pacs.arrivals().clone(), options),
            server,
        }
    }

    /// The server after a restart; nothing reads series any more.
    pub(crate) async fn restarted(self) -> Server {
        let Self { server, reader } = self;
        reader.shut_down(Duration::from_secs(10)).await;
        server.restart().await
    }

    pub(crate) async fn store(&self, files: &[Vec<u8>]) -> Answer {
        let request = stow("/dicomweb/studies", related(files));
        self.server.send(request).await
    }

    /// Nothing more comes of what was sent here: the time for further images passes.
    pub(crate) fn all_has_come(&self) {
        self.server.state.cases.store().pass_time(STABLE);
    }

    /// The one series that came, once it is settled. If it was sent here, all of it has come.
    pub(crate) async fn settled(&self) -> Value {
        let mut is_over = false;
        until("the series is settled", async || {
            let authorization = ("authorization", "Bearer 0123456789abcdef");
            let list = self.server.get_with("/v1/arrivals", &[authorization]).await;
            match &list.json()["arrivals"].as_array().unwrap()[..] {
                [arrival] if arrival["state"] != "receiving" => return Some(arrival.clone()),
                [arrival] if !is_over && arrival["source"] != "retrieval" => {
                    is_over = true;
                    self.all_has_come();
                }
                _ => {}
            }
            None
        })
        .await
    }
}

pub(crate) fn items<'a>(answer: &'a Value, tag: &str) -> &'a [Value] {
    answer[tag]["Value"].as_array().map_or(&[], Vec::as_slice)
}

pub(crate) fn reasons(answer: &Value, tag: &str) -> Vec<u64> {
    let reason = |item: &Value| item["00081197"]["Value"][0].as_u64().unwrap();
    items(answer, tag).iter().map(reason).collect()
}

/// The sentences of the items, as far as they are stated.
fn comments(answer: &Value, tag: &str) -> Vec<String> {
    let comment = |item: &Value| item["00000902"]["Value"][0].as_str().unwrap().to_owned();
    items(answer, tag).iter().map(comment).collect()
}

#[tokio::test]
async fn a_series_that_is_stored_becomes_a_case_and_late_images_make_a_version_of_it() {
    let neighbour = Neighbour::start(|_| {}).await;
    let slices = head_slices();
    let (late, early) = slices.split_last().unwrap();
    let early = files(early, Syntax::Explicit);
    let answer = neighbour.store(&early).await;
    assert_eq!(answer.status, 200, "{answer:?}");
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    let stored = answer.json();
    assert_eq!(items(&stored, "00081199").len(), early.len());
    assert!(stored["00081198"].is_null());
    // The same images again are no error, and no images.
    assert_eq!(neighbour.store(&early).await.status, 200);
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    assert_eq!(arrival["instances"], early.len());
    assert_eq!(arrival["source"], "stow");
    let first = arrival["case"].as_str().unwrap().to_owned();
    neighbour
        .server
        .until_ready(&format!("/v1/cases/{first}"))
        .await;

    let answer = neighbour.store(&[late.file(Syntax::Implicit)]).await;
    assert_eq!(answer.status, 200);
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["instances"], slices.len());
    let second = arrival["case"].as_str().unwrap().to_owned();
    assert_ne!(first, second);
    let case = neighbour.server.get(&format!("/v1/cases/{second}")).await;
    assert_eq!(case.json()["previous"], first);

    // A viewer finds it, and nothing tells whose head it is.
    let launched = json!({"query": "?StudyInstanceUIDs=1.2.3"}).to_string();
    let launched = Request::post("/v1/launch").body(Body::from(launched));
    let launched = neighbour.server.send(launched.unwrap()).await;
    let found = launched.json()["case"].as_str().unwrap().to_owned();
    assert!(found == first || found == second);
    for address in ["/v1/arrivals", "/v1/cases", "/metrics"] {
        let answer = neighbour.server.get(address).await;
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        for canary in ["Somebody", "Secret", "P-77"] {
            assert!(!text.contains(canary), "{address}: {text}");
        }
    }
    // What was deleted does not come back, and leaves nothing.
    let address = format!("/v1/cases/{second}");
    neighbour.server.until_ready(&address).await;
    for case in [&second, &first] {
        let address = format!("/v1/cases/{case}");
        let deleted = neighbour
            .server
            .method(axum::http::Method::DELETE, &address)
            .await;
        assert_eq!(deleted.status, 204);
    }
    neighbour.server.is_empty_and_well().await;
    let list = neighbour.server.get("/v1/arrivals").await.json();
    assert_eq!(list["arrivals"], json!([]));
}

#[tokio::test]
async fn every_image_that_is_not_stored_is_listed_with_its_reason() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|_| {}).await;
    let sound = Slice::number(0).file(Syntax::Explicit);
    let mut without_study = Slice::number(2).file(Syntax::Explicit);
    let study = memchr::memmem::find(&without_study, b"\x0D\0UI\x06\x001.2.3\0").unwrap();
    without_study[study + 6..][..5].copy_from_slice(b"study");
    let mut cut = Slice::number(3).file(Syntax::Explicit);
    cut.truncate(cut.len() - 20);
    let parts = [
        sound.clone(),
        b"not DICOM at all".to_vec(),
        without_study.clone(),
        without_study.clone(),
        cut,
    ];
    let answer = neighbour.store(&parts).await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let stored = answer.json();
    assert_eq!(items(&stored, "00081199").len(), 1);
    assert_eq!(reasons(&stored, "0008119A"), [0xC000; 4]);
    let of_study = "its Study Instance UID is no UID (up to 64 digits and points); e";
    let of_length = "a DICOM file is damaged: its pixel data is truncated";
    assert_eq!(comments(&stored, "0008119A")[1..3], [of_study; 2]);
    assert!(comments(&stored, "0008119A")[3].contains(of_length));
    // Each reason is one line of the log, with its number.
    let logged = lines.text();
    for (reason, objects) in [(of_study, 2), (of_length, 1)] {
        let lines: Vec<_> = logged.lines().filter(|it| it.contains(reason)).collect();
        assert_eq!(lines.len(), 1, "{logged}");
        assert!(
            lines[0].contains(&format!("objects={objects}")),
            "{lines:?}"
        );
    }
    assert_eq!(neighbour.store(&parts[1..3]).await.status, 409);
    let to_other_study = |parts: &[Vec<u8>]| {
        let request = stow("/dicomweb/studies/1.2.99", related(parts));
        neighbour.server.send(request)
    };
    let of_address = "it belongs to another study than the one in the address";
    let answer = to_other_study(&parts[..1]).await;
    assert_eq!(answer.status, 409);
    let answer = answer.json();
    assert_eq!(reasons(&answer, "00081198"), [0xA900]);
    assert_eq!(comments(&answer, "00081198"), [of_address]);
    let instance = &items(&answer, "00081198")[0]["00081155"]["Value"][0];
    assert_eq!(instance, "1.2.3.4.1");
    let same_study = stow("/dicomweb/studies/1.2.3", related(&parts[..1]));
    assert_eq!(neighbour.server.send(same_study).await.status, 200);
    let counted = neighbour.server.pacs.store().images();
    assert!(
        counted.contains(&("stow", ImageStatus::Refused, 7)),
        "{counted:?}"
    );
    // One slice is no volume.
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "nothing");
    assert_eq!(arrival["reason"]["name"], "dicom-too-few-slices");
    // What was cut, and the image at the address of another study. The image was stored nevertheless.
    assert_eq!(arrival["refused_objects"], 2, "{arrival}");
    assert_eq!(arrival["last_refusal"], of_address);
    assert_eq!(arrival["instances"], 1);

    // By DIMSE it is the same.
    let address = dimse(&neighbour, dimse_options()).await;
    let node = StorageNode::new(&address.to_string(), "ISOCORTEX", "SENDER").unwrap();
    let refused = node.store(&with_head(&parts[4], "1.2.3.4.4").into()).await;
    assert_eq!(refused, Err(NodeError::Failed(0xC000)));
    let arrivals = neighbour.server.get("/v1/arrivals").await.json();
    let arrival = &arrivals["arrivals"][0];
    assert_eq!(arrival["refused_objects"], 3, "{arrival}");
    let why = arrival["last_refusal"].as_str().unwrap();
    assert!(why.contains(of_length), "{why}");

    // No sender makes rows without end, and none takes the place of what was stored.
    let mut strayed = Slice::number(1);
    let strayed = (0..101).map(|number| {
        strayed.series_uid = format!("1.2.3.10.{number}");
        strayed.file(Syntax::Explicit)
    });
    let strayed: Vec<_> = strayed.collect();
    assert_eq!(to_other_study(&strayed).await.status, 409);
    let list = neighbour.server.get("/v1/arrivals?limit=200").await.json();
    let list = list["arrivals"].as_array().unwrap();
    assert_eq!(list.len(), 101);
    assert_eq!(list[0]["series"], "1.2.3.10.100");
    assert_eq!(list[0]["reason"]["name"], "all-refused");
    assert_eq!(list[0]["last_refusal"], of_address);
    assert_eq!(list[99]["series"], "1.2.3.10.1");
    assert_eq!(list[100]["id"], arrival["id"]);

    // A link to such a series still says that it is not there, so that it can be fetched.
    let query = json!({"query": "study=1.2.3&series=1.2.3.10.1"}).to_string();
    let request = Request::post("/v1/launch").body(query.into()).unwrap();
    let launched = neighbour.server.send(request).await.json();
    assert_eq!(
        (&launched["state"], &launched["series"]),
        (&json!("absent"), &json!("1.2.3.10.1"))
    );
}

#[tokio::test]
async fn what_is_no_request_of_this_kind_is_refused_and_leaves_nothing() {
    let neighbour = Neighbour::start(|config| config.limits.max_upload_bytes = 1 << 20).await;
    let server = &neighbour.server;
    let sound = related(&[Slice::number(0).file(Syntax::Explicit)]);
    let cut = sound[..sound.len() - 40].to_vec();
    let large = related(&[vec![7; 5 << 20]]);
    for (body, status, kind) in [
        (cut, 400, "body-unreadable"),
        (related(&[]), 400, "no-images"),
        (b"no boundary".to_vec(), 400, "body-unreadable"),
        (large, 413, "body-too-large"),
    ] {
        let answer = server.send(stow("/dicomweb/studies", body)).await;
        assert_eq!(
            (answer.status.as_u16(), answer.problem().as_str()),
            (status, kind)
        );
    }
    let mut request = stow("/dicomweb/studies", sound.clone());
    let form = "multipart/form-data; boundary=x".parse().unwrap();
    request.headers_mut().insert("content-type", form);
    assert_eq!(server.send(request).await.status, 415);
    let mut request = stow("/dicomweb/studies", sound.clone());
    let xml = "application/dicom+xml".parse().unwrap();
    request.headers_mut().insert("accept", xml);
    assert_eq!(server.send(request).await.status, 406);
    let answer = server.send(stow("/dicomweb/studies/Smith", sound)).await;
    assert_eq!(answer.problem(), "not-a-uid");
    for (address, kind) in [
        ("/v1/arrivals?limit=0", "query-value-out-of-range"),
        ("/v1/arrivals?after=x", "query-value-out-of-range"),
        ("/v1/arrivals?x=y", "query-unknown-key"),
        ("/v1/arrivals?state=lost", "query-value-out-of-range"),
        ("/v1/arrivals?case=x", "query-value-out-of-range"),
        ("/v1/arrivals?text=", "query-value-out-of-range"),
        ("/v1/arrivals?since=2026", "query-value-out-of-range"),
        ("/v1/arrivals/x", "no-such-arrival"),
        (
            "/v1/retrievals/00000000000000000000000000000000",
            "no-such-retrieval",
        ),
    ] {
        assert_eq!(server.get(address).await.problem(), kind, "{address}");
    }
    let unknown = json!({"node": "x", "study": "1.2", "series": "1.3"}).to_string();
    let unknown = Request::post("/v1/retrievals").body(Body::from(unknown));
    let answer = server.send(unknown.unwrap()).await;
    assert_eq!(answer.problem(), "no-such-node");
    server.is_empty_and_well().await;
}

#[tokio::test]
async fn the_token_opens_these_routes_too_and_may_be_the_password_of_basic() {
    let neighbour = Neighbour::start(|config| {
        config.http.token = Some(isocortex::config::Secret("0123456789abcdef".to_owned()));
    })
    .await;
    let server = &neighbour.server;
    for address in ["/v1/arrivals", "/v1/retrievals/x"] {
        assert_eq!(server.get(address).await.status, 401);
    }
    let none = server.send(stow("/dicomweb/studies", related(&[]))).await;
    assert_eq!(none.status, 401);
    // "orthanc:0123456789abcdef"
    let basic = "Basic b3J0aGFuYzowMTIzNDU2Nzg5YWJjZGVm";
    let headers = [("authorization", basic)];
    let answer = server.get_with("/v1/arrivals", &headers).await;
    assert_eq!(answer.status, 200);
    // The page of a launch holds no data.
    let page = server.get("/launch?StudyInstanceUIDs=1.2.3").await;
    assert_eq!(page.status, 200);
    assert!(!String::from_utf8_lossy(&page.body).contains("1.2.3"));
}

#[tokio::test]
async fn a_rejection_note_needs_a_right_by_http_and_by_dimse_and_is_refused_alone_without_it() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let mut tokens = TokensFile::new();
    tokens.add("orthanc", &["--role", "pacs"]);
    tokens.add("archive", &["--scope", "dicom-store,dicom-reject"]);
    let neighbour = Neighbour::start(|config| config.http.tokens_file = Some(tokens.path())).await;
    let send = async |files: &[Vec<u8>], name: &str| {
        let mut request = stow("/dicomweb/studies", related(files));
        let bearer = tokens.bearer(name).parse().unwrap();
        request.headers_mut().insert("authorization", bearer);
        neighbour.server.send(request).await
    };
    let launched = async || {
        let body = json!({"query": "study=1.2.3"}).to_string();
        let request = Request::post("/v1/launch").header("authorization", tokens.bearer("read"));
        let request = request.body(Body::from(body)).unwrap();
        neighbour.server.send(request).await.json()["case"].clone()
    };
    let is_case = || {
        neighbour.all_has_come();
        until("it is a case", async || {
            launched().await.as_str().map(str::to_owned)
        })
    };
    let uids: Vec<_> = (head_slices().into_iter())
        .map(|slice| slice.sop_uid)
        .collect();
    let [quality, retention] = [
        KeyObjectTitle::RejectedForQuality,
        KeyObjectTitle::RetentionExpired,
    ]
    .map(|title| note_of(title, &uids));

    // By HTTP, the images of the same request are stored.
    let images = files(&head_slices(), Syntax::Explicit);
    let (last, others) = images.split_last().unwrap();
    let mixed = [others, &[quality.clone(), last.clone()]].concat();
    let answer = send(&mixed, "orthanc").await;
    assert_eq!(answer.status, 202, "{answer:?}");
    let stored = answer.json();
    assert_eq!(items(&stored, "00081199").len(), images.len());
    assert_eq!(reasons(&stored, "00081198"), [0x0124]);
    let why = "its sender may not reject images (`dicom-reject`, `may_reject`)";
    assert_eq!(comments(&stored, "00081198"), [why]);
    let case = is_case().await;
    let alone = send(std::slice::from_ref(&quality), "orthanc").await;
    assert_eq!(alone.status, 409, "{alone:?}");
    let authorization = ("authorization", &*tokens.bearer("read"));
    let list = (neighbour.server)
        .get_with("/v1/arrivals", &[authorization])
        .await;
    let list = list.json();
    let mut list = list["arrivals"].as_array().unwrap().iter();
    let row = list.find(|each| each["series"] == "1.2.3.99").unwrap();
    assert_eq!(
        (&row["state"], &row["reason"]["name"], &row["ignored"]),
        (
            &json!("nothing"),
            &json!("rejection-not-permitted"),
            &json!(2)
        )
    );

    // By DIMSE, the peer of the same title at another address may.
    let mut options = dimse_options();
    options.peers[1].may_reject = true;
    let refusing = dimse(&neighbour, options.clone()).await;
    options.peers[0].may_reject = true;
    let permitting = dimse(&neighbour, options).await;
    let store = async |address: std::net::SocketAddr, note: &[u8]| {
        let node = StorageNode::new(&address.to_string(), "ISOCORTEX", "SENDER").unwrap();
        node.store(&note.to_vec().into()).await
    };
    let refused = store(refusing, &retention).await;
    assert_eq!(refused, Err(NodeError::Failed(0x0124)));
    assert_eq!(launched().await, case);
    let counted = neighbour.server.pacs.store().images();
    for (source, count) in [("stow", 2), ("c-store", 1)] {
        let refused = (source, ImageStatus::Refused, count);
        assert!(counted.contains(&refused), "{counted:?}");
    }
    for by in ["orthanc", "aet:SENDER"] {
        let is_refusal = |line: &str| line.contains("rejection note was refused");
        let logged = lines.text();
        let mut refusals = logged.lines().filter(|line| is_refusal(line));
        assert!(refusals.any(|line| line.contains(by)), "{by}");
    }

    // With the right, either is heeded.
    assert_eq!(store(permitting, &retention).await, Ok(()));
    assert_eq!(launched().await, Value::Null);
    assert_eq!(send(&images, "orthanc").await.status, 200);
    is_case().await;
    let heeded = send(&[quality], "archive").await;
    assert_eq!(heeded.status, 200, "{heeded:?}");
    let noted = "the images that it names are rejected; it is not kept itself";
    assert_eq!(comments(&heeded.json(), "00081199"), [noted]);
    assert_eq!(launched().await, Value::Null);
}

/// The file of a slice with the head that a sender by C-STORE needs.
fn with_head(file: &[u8], instance: &str) -> Vec<u8> {
    let (syntax, data_set) = file[132..].split_at(8 + usize::from(file[138]));
    let mut meta = DataSet::new(Syntax::Explicit);
    meta.text([2, 2], "UI", "1.2.840.10008.5.1.4.1.1.4");
    meta.text([2, 3], "UI", instance);
    meta.bytes.extend(syntax);
    let mut head = DataSet::new(Syntax::Explicit);
    let length = meta.bytes.len() as u32;
    head.bytes([2, 0], "UL", &length.to_le_bytes());
    [&file[..132], &head.bytes, &meta.bytes, data_set].concat()
}

/// The file of a slice with more texts, or other ones.
pub(crate) fn with_texts(slice: &Slice, texts: &[([u16; 2], &str, &str)]) -> Vec<u8> {
    let mut set = slice.data_set(Syntax::Explicit);
    let mut elements = BTreeMap::new();
    let mut rest = std::mem::take(&mut set.bytes);
    while !rest.is_empty() {
        let number = |at: usize| u16::from_le_bytes([rest[at], rest[at + 1]]);
        let end = 8 + usize::from(number(6));
        let (tag, after) = ([number(0), number(2)], rest.split_off(end));
        elements.insert(tag, std::mem::replace(&mut rest, after));
    }
    for &(tag, vr, text) in texts {
        let mut element = DataSet::new(Syntax::Explicit);
        element.text(tag, vr, text);
        elements.insert(tag, element.bytes);
    }
    set.bytes = elements.into_values().flatten().collect();
    let samples: Vec<u8> = slice
        .samples
        .iter()
        .flat_map(|sample| sample.to_le_bytes())
        .collect();
    set.bytes([0x7FE0, 0x10], "OW", &samples);
    set.file()
}

/// A slice with a canary in every attribute that may name somebody.
fn with_canaries(slice: &Slice) -> Vec<u8> {
    with_texts(
        slice,
        &[
            ([0x08, 0x0050], "SH", "CANARY-1"),
            ([0x08, 0x0080], "LO", "CANARY-2"),
            ([0x08, 0x0081], "ST", "CANARY-3"),
            ([0x08, 0x0090], "PN", "CANARY^4"),
            ([0x08, 0x1010], "SH", "CANARY-5"),
            ([0x08, 0x1030], "LO", "CANARY-6"),
            ([0x08, 0x103E], "LO", "t1 CANARY-7"),
            ([0x08, 0x1048], "PN", "CANARY^8"),
            ([0x10, 0x0010], "PN", "CANARY^9"),
            ([0x10, 0x0020], "LO", "CANARY-10"),
            ([0x10, 0x0030], "DA", "19670312"),
            ([0x10, 0x1000], "LO", "CANARY-11"),
            ([0x10, 0x1001], "PN", "CANARY^17"),
            ([0x10, 0x1005], "PN", "CANARY^18"),
            ([0x10, 0x1040], "LO", "CANARY-12"),
            ([0x10, 0x4000], "LT", "CANARY-13"),
            ([0x18, 0x1030], "LO", "CANARY-14"),
            ([0x20, 0x0010], "SH", "CANARY-15"),
            ([0x20, 0x4000], "LT", "CANARY-16"),
        ],
    )
}

/// Log lines of this thread.
#[derive(Clone, Default)]
pub(crate) struct Lines(Arc<Mutex<Vec<u8>>>);

impl Lines {
    /// Collects what is logged as long as the guard lives.
    pub(crate) fn collect(&self) -> tracing::subscriber::DefaultGuard {
        let written = self.clone();
        let subscriber = tracing_subscriber::fmt()
            .with_max_level(tracing_subscriber::filter::LevelFilter::TRACE)
            .with_ansi(false)
            .with_writer(move || written.clone())
            .finish();
        tracing::subscriber::set_default(subscriber)
    }

    /// What was logged.
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.0.lock().unwrap()).into_owned()
    }
}

impl std::io::Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[tokio::test]
async fn another_volume_of_the_study_becomes_a_layer_although_it_came_first() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let flair: Vec<_> = head_slices()
        .into_iter()
        .map(|slice| Slice {
            description: "flair",
            sop_uid: format!("1.2.3.77.{}", slice.instance),
            series_uid: "1.2.3.77".to_owned(),
            series_number: 7,
            ..slice
        })
        .collect();
    assert_eq!(
        neighbour
            .store(&files(&flair, Syntax::Explicit))
            .await
            .status,
        200
    );
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["reason"]["name"], "series-not-t1", "{arrival}");
    let t1 = files(&head_slices(), Syntax::Explicit);
    assert_eq!(neighbour.store(&t1).await.status, 200);
    let (case, layer) = until("a layer comes of it", async || {
        let list = server.get("/v1/arrivals").await.json();
        let arrivals = list["arrivals"].as_array().unwrap();
        let of = |state: &str| arrivals.iter().find(|each| each["state"] == state).cloned();
        of("case").zip(of("layer"))
    })
    .await;
    assert_eq!(layer["case"], case["case"]);
    assert_eq!(layer["reason"]["name"], "series-is-layer");
    let address = format!("/v1/cases/{}", case["case"].as_str().unwrap());
    server.until_ready(&address).await;
    let layers = server.get(&format!("{address}/layers")).await.json();
    let text = layers.to_string();
    assert!(text.contains("FLAIR"), "{text}");
}

#[tokio::test]
async fn a_series_that_was_refused_is_taken_as_a_case_and_a_layer_as_one_too() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let flair: Vec<_> = head_slices()
        .into_iter()
        .map(|slice| Slice {
            description: "FLAIR 3D",
            ..slice
        })
        .collect();
    let stored = neighbour.store(&files(&flair, Syntax::Explicit)).await;
    assert_eq!(stored.status, 200);
    let refused = neighbour.settled().await;
    assert_eq!(refused["reason"]["name"], "series-not-t1", "{refused}");
    assert_eq!(refused["label"], "FLAIR 3D");
    let address = format!("/v1/arrivals/{}", refused["id"].as_str().unwrap());
    let take = async |body: &str| {
        let request = Request::post(&address).body(Body::from(body.to_owned()));
        server.send(request.unwrap()).await
    };
    for (body, status, kind) in [
        (r#"{"as": "nothing"}"#, 400, "body-unreadable"),
        (r#"{"as": "case", "gaps": true}"#, 400, "body-unreadable"),
        (r#"{"as": "layer"}"#, 409, "no-case-of-study"),
    ] {
        let answer = take(body).await;
        let found = (answer.status.as_u16(), answer.problem());
        assert_eq!(found, (status, kind.to_owned()), "{body}");
    }
    let taken = take(r#"{"as": "case"}"#).await;
    assert_eq!(taken.status, 202, "{taken:?}");
    let taken = taken.json();
    assert_eq!(
        (&taken["state"], &taken["refused"]["name"]),
        (&json!("receiving"), &json!("series-not-t1"))
    );
    let settled = neighbour.settled().await;
    assert_eq!(settled["state"], "case", "{settled}");
    assert_eq!(settled["refused"]["name"], "series-not-t1");
    assert_eq!(settled["taken"], json!({"as": "case", "allow_gaps": false}));
    let case = settled["case"].as_str().unwrap();
    let label = server.get(&format!("/v1/cases/{case}")).await.json();
    assert_eq!(label["name"], "FLAIR 3D");
    assert_eq!(
        take(r#"{"as": "layer"}"#).await.problem(),
        "arrival-not-refused"
    );
    // It is found by what became of it and by its label, and not by those of others.
    for (query, count) in [
        (format!("state=case&case={case}&text=flair"), 1),
        ("state=layer".to_owned(), 0),
        ("text=T1".to_owned(), 0),
        ("until=2026-01-01T00:00:00Z".to_owned(), 0),
    ] {
        let list = server.get(&format!("/v1/arrivals?{query}")).await.json();
        assert_eq!(list["arrivals"].as_array().unwrap().len(), count, "{query}");
    }
}

#[tokio::test]
async fn a_layer_is_taken_as_a_case_of_its_own() {
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    assert_eq!(
        neighbour
            .store(&files(&head_slices(), Syntax::Explicit))
            .await
            .status,
        200
    );
    let first = neighbour.settled().await;
    let other: Vec<_> = head_slices()
        .into_iter()
        .map(|slice| Slice {
            description: "FLAIR",
            sop_uid: format!("1.2.3.77.{}", slice.instance),
            series_uid: "1.2.3.77".to_owned(),
            series_number: 7,
            ..slice
        })
        .collect();
    assert_eq!(
        neighbour
            .store(&files(&other, Syntax::Explicit))
            .await
            .status,
        200
    );
    let in_state = async |state: &str| {
        let address = format!("/v1/arrivals?text=FLAIR&state={state}");
        until(&format!("the state is {state}"), async || {
            let list = server.get(&address).await.json();
            match &list["arrivals"].as_array().unwrap()[..] {
                [arrival] => Some(arrival.clone()),
                _ => None,
            }
        })
        .await
    };
    let layer = in_state("layer").await;
    assert_eq!(layer["case"], first["case"]);
    let address = format!("/v1/arrivals/{}", layer["id"].as_str().unwrap());
    let request = Request::post(&address).body(Body::from(r#"{"as": "case"}"#));
    assert_eq!(server.send(request.unwrap()).await.status, 202);
    let taken = in_state("case").await;
    assert_ne!(taken["case"], first["case"]);
    assert!(taken["refused"].is_null(), "it was not refused: {taken}");
    let case = format!("/v1/cases/{}", taken["case"].as_str().unwrap());
    let case = server.get(&case).await.json();
    assert!(
        case["previous"].is_null(),
        "it is of another series: {case}"
    );
}

/// What would tell whose head it is.
const IDENTITY: [&str; 5] = ["CANARY", "19670312", "P-77", "Secret", "1.2.3.4."];

fn tells_nothing(texts: &[Vec<u8>]) {
    for text in texts {
        for canary in IDENTITY {
            let found = memchr::memmem::find(text, canary.as_bytes());
            assert_eq!(found, None, "{canary} in {} bytes", text.len());
        }
    }
}

/// An image of a series, as it is kept.
pub(crate) async fn an_image(server: &Server, study: &str, series: &str) -> Vec<u8> {
    let uid = |text| Uid::parse(text).unwrap();
    let uids = SeriesUids {
        study: uid(study),
        series: uid(series),
    };
    let store = server.pacs.store();
    let (_, object) = store.images_of(&uids).await.unwrap().remove(0);
    store.store().object(&object).await.unwrap().to_vec()
}

#[tokio::test]
async fn with_deidentify_nothing_is_kept_that_tells_whose_head_it_is() {
    let neighbour = Neighbour::start(|config| {
        config.pacs.deidentify = true;
        crate::results::add_node(config, "away", "http://127.0.0.1:1/rs".to_owned());
    })
    .await;
    let server = &neighbour.server;
    let slices = head_slices();
    let images: Vec<_> = slices.iter().map(with_canaries).collect();
    let stored = neighbour.store(&images).await;
    assert_eq!(stored.status, 200, "{stored:?}");
    // The sender knows its images by their own names.
    let answered = stored.json();
    let listed = &items(&answered, "00081199")[0]["00081155"]["Value"][0];
    assert!(listed.as_str().unwrap().starts_with("1.2.3.4."));
    tells_nothing(&server.everything());
    // The same images again are still the same.
    assert_eq!(neighbour.store(&images[..3]).await.status, 200);
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    assert_eq!(arrival["instances"], slices.len());
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&case).await;
    let [study, series] = ["study", "series"].map(|name| arrival[name].as_str().unwrap());
    assert!(study.starts_with("2.25.") && series.starts_with("2.25."));
    let mut texts = server.everything();
    for address in [
        "/v1/arrivals".to_owned(),
        case.clone(),
        format!("{case}/dicom"),
    ] {
        let answer = server.get(&address).await;
        assert_eq!(answer.status, 200, "{address}: {answer:?}");
        texts.push(answer.body.to_vec());
    }
    tells_nothing(&texts);
    // What remains is the volume.
    let kept = imaging::dicom::attributes(&an_image(server, study, series).await).unwrap();
    assert_eq!(kept.value("PatientIdentityRemoved"), Some("YES"));
    assert_eq!(kept.value("SeriesDescription"), Some("t1"));
    for body in [
        json!({"what": "view"}),
        json!({"what": "view", "node": "away"}),
    ] {
        let refused = crate::results::result(server, &case, &body).await;
        assert_eq!(refused.problem(), "deidentified");
    }
    let asked = json!({"node": "away", "study": "1.2", "series": "1.3"}).to_string();
    let asked = Request::post("/v1/retrievals").body(Body::from(asked));
    let refused = server.send(asked.unwrap()).await;
    assert_eq!(
        (refused.status.as_u16(), refused.problem().as_str()),
        (422, "deidentified")
    );
}

#[tokio::test]
async fn no_attribute_of_an_image_shows_anywhere_else() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|_| {}).await;
    let server = &neighbour.server;
    let images: Vec<_> = head_slices().iter().map(with_canaries).collect();
    let stored = neighbour.store(&images).await;
    assert_eq!(stored.status, 200);
    let mut cut = images[0].clone();
    cut.truncate(600);
    let refused = neighbour.store(&[cut]).await;
    assert_eq!(refused.status, 409);
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    let case = format!("/v1/cases/{}", arrival["case"].as_str().unwrap());
    server.until_ready(&case).await;
    let launched = json!({"query": "accessionNumber=CANARY-1"}).to_string();
    let launched = Request::post("/v1/launch").body(Body::from(launched));
    let launched = server.send(launched.unwrap()).await;
    assert_eq!(launched.json()["state"], "ready");
    let mut texts = vec![stored.body, refused.body, launched.body];
    for address in [
        "/v1/arrivals".to_owned(),
        "/v1/cases".to_owned(),
        "/metrics".to_owned(),
        case.clone(),
        format!("{case}/quality"),
        format!("{case}/layers"),
        format!("{case}/render?depth_mm=5&width=160&height=160&annotate=true"),
    ] {
        texts.push(server.get(&address).await.body);
    }
    for (body, status) in [
        (
            json!({"what": "sheet", "render": {"width": 128, "height": 128}, "node": "CANARY"}),
            404,
        ),
        (json!({"what": "view", "CANARY": 1}), 400),
        (
            json!({"what": "view", "study": {"StudyInstanceUID": "1.2", "PatientID": "CANARY"}}),
            400,
        ),
        (json!({"what": "mask", "render": {}}), 400),
    ] {
        let refused = crate::results::result(server, &case, &body).await;
        assert_eq!(refused.status, status, "{body}");
        texts.push(refused.body);
    }
    let sent = json!({"what": "view", "render": {"width": 128, "height": 128}});
    assert_eq!(
        crate::results::result(server, &case, &sent).await.status,
        200
    );
    let mut texts: Vec<Vec<u8>> = texts.into_iter().map(Into::into).collect();
    for file in server.stored_files() {
        texts.push(file.to_string_lossy().into_owned().into_bytes());
    }
    let logged = lines.0.lock().unwrap().clone();
    assert!(memchr::memmem::find(&logged, b"a series became a case").is_some());
    // A case can be followed through the log by the first digits of its id.
    let short = &arrival["case"].as_str().unwrap()[..8];
    let logged_text = String::from_utf8_lossy(&logged).into_owned();
    for line in ["beginning a job", "a case is ready"] {
        let has_both = |text: &str| text.contains(line) && text.contains(short);
        assert!(logged_text.lines().any(has_both), "{line}: {logged_text}");
    }
    let by_stow = |text: &&str| text.contains("stored by STOW-RS");
    assert_eq!(logged_text.lines().filter(by_stow).count(), 2);
    texts.push(logged);
    for text in texts {
        for canary in ["CANARY", "19670312"] {
            let found = memchr::memmem::find(&text, canary.as_bytes());
            assert_eq!(found, None, "{}", String::from_utf8_lossy(&text));
        }
    }
    // Whoever asks for the attributes of the case gets them.
    let attributes = server.get(&format!("{case}/dicom")).await;
    assert_eq!(attributes.json()["attributes"]["PatientName"], "CANARY^9");
}

/// A listener for C-STORE on a free port.
pub(crate) async fn dimse(neighbour: &Neighbour, options: DimseOptions) -> std::net::SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let arrivals = neighbour.server.pacs.arrivals().clone();
    let options = DimseOptions {
        audit: neighbour.server.state.audit().clone(),
        ..options
    };
    let grace = Duration::from_secs(1);
    tokio::spawn(dimse::serve(
        listener,
        arrivals,
        options,
        std::future::pending(),
        grace,
    ));
    address
}

pub(crate) fn dimse_options() -> DimseOptions {
    DimseOptions {
        peers: [[127, 0, 0, 1], [127, 0, 0, 2]]
            .map(|address| Peer {
                aet: "SENDER".to_owned(),
                address: address.into(),
                may_reject: false,
            })
            .to_vec(),
        idle: Duration::from_millis(1500),
        max_associations: 16,
        ..DimseOptions::default()
    }
}

/// A program of DCMTK, if it is installed.
pub(crate) fn dcmtk(name: &str) -> Option<std::path::PathBuf> {
    // A Python package has programs of the same names.
    let path = std::path::Path::new("/usr/bin").join(name);
    let is_there = path.exists();
    if !is_there {
        skipped(&format!("{name} of DCMTK is not installed"));
    }
    is_there.then_some(path)
}

/// For DCMTK: without it, each image waits 100 ms for the acknowledgement of half a message.
pub(crate) const NO_DELAY: (&str, &str) = ("TCP_NODELAY", "1");

pub(crate) async fn run(program: &std::path::Path, arguments: &[&str]) -> std::process::Output {
    let program = program.to_owned();
    let arguments: Vec<String> = arguments.iter().map(|&text| text.to_owned()).collect();
    let run = move || {
        let mut command = std::process::Command::new(program);
        command.env(NO_DELAY.0, NO_DELAY.1).args(arguments).output()
    };
    tokio::task::spawn_blocking(run).await.unwrap().unwrap()
}

#[tokio::test]
async fn storescu_stores_a_series_in_every_syntax_and_echoscu_is_answered() {
    let (Some(echoscu), Some(storescu)) = (dcmtk("echoscu"), dcmtk("storescu")) else {
        return;
    };
    let neighbour = Neighbour::start(|_| {}).await;
    let options = dimse_options();
    let counts = Arc::clone(&options.counts);
    let address = dimse(&neighbour, options).await;
    let port = address.port().to_string();
    let to_us = ["-aet", "SENDER", "-aec", "ISOCORTEX", "127.0.0.1", &port];
    let began = SystemTime::now();
    let echo = run(&echoscu, &to_us).await;
    assert!(echo.status.success(), "{echo:?}");
    assert!(counts.last_images().is_empty(), "an echo is no image");
    let folder = tempfile::tempdir().unwrap();
    let slices = head_slices();
    let third = slices.len() / 3;
    for (number, slice) in slices.iter().enumerate() {
        let syntax = match number / third {
            0 => Syntax::Explicit,
            1 => Syntax::Implicit,
            _ => Syntax::BigEndian,
        };
        let path = folder.path().join(format!("{number}.dcm"));
        std::fs::write(path, slice.file(syntax)).unwrap();
    }
    let mut arguments = vec!["-R", "+sd"];
    arguments.extend(to_us);
    let path = folder.path().to_str().unwrap();
    arguments.push(path);
    let stored = run(&storescu, &arguments).await;
    assert!(stored.status.success(), "{stored:?}");
    let last: Vec<_> = counts.last_images().into_iter().collect();
    assert!(
        matches!(&last[..], [(peer, time)] if peer == "SENDER" && *time > began),
        "{last:?}"
    );
    let arrival = neighbour.settled().await;
    assert_eq!(arrival["state"], "case", "{arrival}");
    assert_eq!(arrival["source"], "c-store");
    assert_eq!(arrival["instances"], slices.len());
    // Strangers are rejected.
    for strangers in [
        ["-aet", "OTHER", "-aec", "ISOCORTEX"],
        ["-aet", "SENDER", "-aec", "OTHER"],
    ] {
        let mut arguments = strangers.to_vec();
        arguments.extend(["127.0.0.1", &port]);
        assert!(!run(&echoscu, &arguments).await.status.success());
    }
    let echo = run(&echoscu, &to_us).await;
    assert!(echo.status.success());
}

/// What comes back until the connection is closed.
async fn answered(stream: &mut TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    let read = tokio::time::timeout(Duration::from_secs(20), stream.read_to_end(&mut bytes));
    // A reset is an end, too.
    let _ = read.await.expect("the connection is closed in time");
    bytes
}

/// A request for an association that would be accepted.
fn association_request() -> Vec<u8> {
    association_of("SENDER")
}

/// A request for an association by somebody with a title, to send MR images.
fn association_of(title: &str) -> Vec<u8> {
    association_for(title, "1.2.840.10008.5.1.4.1.1.4")
}

fn association_for(title: &str, service: &str) -> Vec<u8> {
    let item = |kind: u8, value: &[u8]| {
        let mut item = vec![kind, 0];
        item.extend((value.len() as u16).to_be_bytes());
        item.extend(value);
        item
    };
    let mut context = vec![1, 0, 0, 0];
    context.extend(item(0x30, service.as_bytes()));
    context.extend(item(0x40, b"1.2.840.10008.1.2"));
    let mut body = vec![0, 1, 0, 0];
    body.extend(format!("ISOCORTEX       {title:16}").as_bytes());
    body.extend([0; 32]);
    body.extend(item(0x10, b"1.2.840.10008.3.1.1.1"));
    body.extend(item(0x20, &context));
    body.extend(item(0x50, &item(0x51, &16384_u32.to_be_bytes())));
    let mut pdu = vec![1, 0];
    pdu.extend((body.len() as u32).to_be_bytes());
    pdu.extend(body);
    pdu
}

#[tokio::test]
async fn an_association_needs_a_listed_title_at_its_own_address() {
    let neighbour = Neighbour::start(|_| {}).await;
    let mut options = dimse_options();
    options.peers[1].aet = "OTHER".to_owned();
    let address = dimse(&neighbour, options).await;
    let answer = async |from: &str, title: &str, called: &str| {
        let socket = TcpSocket::new_v4().unwrap();
        socket.bind(format!("{from}:0").parse().unwrap()).unwrap();
        let mut stream = socket.connect(address).await.unwrap();
        let mut request = association_of(title);
        request[10..26].copy_from_slice(format!("{called:16}").as_bytes());
        // The connection of a stranger may be closed already.
        let _ = stream.write_all(&request).await;
        let mut head = [0; 1];
        match stream.read_exact(&mut head).await {
            Ok(_) => Some(head[0]),
            Err(_) => None,
        }
    };
    let (accepted, rejected) = (Some(2), Some(3));
    for (from, title, called, expected) in [
        ("127.0.0.1", "SENDER", "ISOCORTEX", accepted),
        ("127.0.0.2", "OTHER", "ISOCORTEX", accepted),
        ("127.0.0.1", "OTHER", "ISOCORTEX", rejected),
        ("127.0.0.2", "SENDER", "ISOCORTEX", rejected),
        ("127.0.0.1", "sender", "ISOCORTEX", rejected),
        ("127.0.0.1", "STRANGER", "ISOCORTEX", rejected),
        ("127.0.0.1", "SENDER", "ELSEWHERE", rejected),
        ("127.0.0.3", "SENDER", "ISOCORTEX", None),
    ] {
        let answered = answer(from, title, called).await;
        assert_eq!(answered, expected, "{title} at {from} to {called}");
    }
}

#[tokio::test]
async fn a_peer_that_asks_for_another_service_alone_has_a_line_in_the_log() {
    let lines = Lines::default();
    let _logging = lines.collect();
    let neighbour = Neighbour::start(|_| {}).await;
    let address = dimse(&neighbour, dimse_options()).await;
    let is_line = |line: &&str| line.contains("INFO") && line.contains("contexts were refused");
    // Images, then a search, once more, and a storage commitment.
    for (service, count) in [
        ("1.2.840.10008.5.1.4.1.1.4", 0),
        ("1.2.840.10008.5.1.4.1.2.2.1", 1),
        ("1.2.840.10008.5.1.4.1.2.2.1", 1),
        ("1.2.840.10008.1.20.1", 2),
    ] {
        let mut stream = TcpStream::connect(address).await.unwrap();
        let request = association_for("SENDER", service);
        stream.write_all(&request).await.unwrap();
        // The association is accepted, without a context.
        assert_eq!(stream.read_u8().await.unwrap(), 2, "{service}");
        let logged = lines.text();
        let refused: Vec<_> = logged.lines().filter(is_line).collect();
        assert_eq!(refused.len(), count, "{service}: {refused:?}");
        let are_named = refused.iter().all(|line| line.contains("SENDER"));
        assert!(are_named, "{refused:?}");
        assert!(
            count == 0 || refused[count - 1].contains(service),
            "{refused:?}"
        );
    }
}

#[tokio::test]
async fn peers_that_stall_lie_or_come_in_crowds_harm_nothing() {
    let neighbour = Neighbour::start(|_| {}).await;
    let address = dimse(&neighbour, dimse_options()).await;
    let connect = async || TcpStream::connect(address).await.unwrap();
    let request = association_request();
    let four_gigabytes = [4, 0, 0xFF, 0xFF, 0xFF, 0xFF];
    let lying_fragment = [4, 0, 0, 0, 0, 6, 0xFF, 0xFF, 0xFF, 0xFF, 1, 3];
    let lying_command = [
        4, 0, 0, 0, 0, 14, 0, 0, 0, 10, 1, 3, 0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF,
    ];
    let no_data = [4, 0, 0, 0, 0, 6, 0, 0, 0, 2, 1, 1];
    let data_first = [4, 0, 0, 0, 0, 8, 0, 0, 0, 4, 1, 2, 0, 0];
    for attack in [
        &b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"[..],
        &four_gigabytes,
        &[5, 0, 0, 0, 0, 4, 0, 0, 0, 0],
        &request[..40],
        &[&request[..], &four_gigabytes].concat(),
        &[&request[..], &lying_fragment].concat(),
        &[&request[..], &lying_command].concat(),
        &[&request[..], &data_first].concat(),
        &[&request[..], &no_data].concat(),
        &[&request[..], &[4, 0, 0, 0, 0, 0]].concat(),
        &[&request[..], &request].concat(),
        &request,
    ] {
        let mut stream = connect().await;
        stream.write_all(attack).await.unwrap();
        let answer = answered(&mut stream).await;
        // An abort is the last that is heard, if anything is.
        let last = answer.len().saturating_sub(10);
        assert!(answer.is_empty() || answer[last] == 7, "{answer:?}");
    }
    // One address has no more than a quarter, which is four; the fifth is rejected for now. A place is free a moment after its connection is closed.
    tokio::time::sleep(Duration::from_millis(300)).await;
    let mut crowd = Vec::new();
    for _ in 0..4 {
        let mut stream = connect().await;
        stream.write_all(&request).await.unwrap();
        let mut head = [0; 6];
        stream.read_exact(&mut head).await.unwrap();
        assert_eq!(head[0], 2, "it is accepted");
        crowd.push(stream);
    }
    let mut fifth = connect().await;
    fifth.write_all(&request).await.unwrap();
    // A-ASSOCIATE-RJ: transient, by the provider (presentation), local limit exceeded.
    assert_eq!(answered(&mut fifth).await, [3, 0, 0, 0, 0, 4, 0, 2, 3, 2]);
    let other = TcpSocket::new_v4().unwrap();
    other.bind("127.0.0.2:0".parse().unwrap()).unwrap();
    let mut other = other.connect(address).await.unwrap();
    other.write_all(&request).await.unwrap();
    let mut head = [0; 6];
    other.read_exact(&mut head).await.unwrap();
    assert_eq!(head[0], 2, "another address is accepted meanwhile");
    drop(crowd);
    neighbour.server.is_empty_and_well().await;
}
