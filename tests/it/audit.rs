//! The record of who does what: what is in it, what is not, and what happens if it cannot be written.

use std::path::Path;
use std::process::Command;

use access::audit::{digest_of_uid, verify};
use axum::body::Body;
use axum::http::{Method, Request};
use cases::remove_expired;
use isocortex::config::Config;
use serde_json::Value;
use storage::upkeep::Removal;

use crate::dicom::head_slices;
use crate::head::plain_head;
use crate::pacs::Neighbour;
use crate::scopes::TokensFile;
use crate::series_builder::{Syntax, files};
use crate::server::{Answer, Server, form, form_type};
use crate::several_machines::program;
use crate::until::until;

/// What must be in no line.
const CANARY: &str = "CANARY";

/// A server that records what its holders of tokens do.
struct Recorded {
    server: Server,
    tokens: TokensFile,
    folder: tempfile::TempDir,
}

impl Recorded {
    async fn start() -> Self {
        Self::start_with(|_| {}).await
    }

    async fn start_with(change: impl FnOnce(&mut Config)) -> Self {
        let mut tokens = TokensFile::new();
        tokens.add("dr.silva", &["--role", "editor"]);
        let folder = tempfile::tempdir().unwrap();
        let configure = |config: &mut Config| {
            config.http.tokens_file = Some(tokens.path());
            config.audit.folder = Some(folder.path().join("audit"));
            change(config);
        };
        std::fs::create_dir(folder.path().join("audit")).unwrap();
        Self {
            server: Server::start_with(configure).await,
            tokens,
            folder,
        }
    }

    fn audit(&self) -> std::path::PathBuf {
        self.folder.path().join("audit")
    }

    async fn ask(&self, method: Method, address: &str, who: &str) -> Answer {
        self.send(method, address, who, Body::empty()).await
    }

    async fn get(&self, address: &str) -> Answer {
        self.ask(Method::GET, address, "dr.silva").await
    }

    async fn send(&self, method: Method, address: &str, who: &str, body: Body) -> Answer {
        let request = Request::builder().method(method).uri(address);
        let request = request
            .header("authorization", self.tokens.bearer(who))
            .header("content-type", form_type());
        self.server.send(request.body(body).unwrap()).await
    }

    /// Uploads a head with a label; the address of the case, ready.
    async fn uploaded(&self) -> String {
        let parameters = format!("{{\"name\": \"{CANARY}\"}}");
        let volume = plain_head().bytes();
        let parts = [
            ("volume", &volume[..]),
            ("parameters", parameters.as_bytes()),
        ];
        let answer = self
            .send(
                Method::POST,
                "/v1/cases",
                "dr.silva",
                Body::from(form(&parts)),
            )
            .await;
        assert_eq!(answer.status, 202, "{answer:?}");
        let address = answer.header("location").to_owned();
        let events = self.get(&format!("{address}/events")).await;
        assert!(String::from_utf8_lossy(&events.body).contains("\"ready\""));
        address
    }

    /// The lines that are on the disk now.
    fn lines(&self) -> Vec<Value> {
        lines_of(&self.audit())
    }

    /// The lines of an object, once the server has ended its record.
    fn all_of(&self, object: &str) -> Vec<Value> {
        self.server.state.audit().shut_down();
        let mut lines = self.lines();
        lines.retain(|line| line["object"] == object);
        lines
    }
}

fn lines_of(folder: &Path) -> Vec<Value> {
    let files = std::fs::read_dir(folder).unwrap();
    let text = files.map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap());
    let text: String = text.collect();
    let lines = text.lines().map(serde_json::from_str);
    lines.map(Result::unwrap).collect()
}

fn outcomes(lines: &[Value]) -> Vec<&str> {
    let outcomes = lines.iter().map(|line| line["outcome"].as_str());
    outcomes.map(Option::unwrap).collect()
}

#[tokio::test]
async fn who_did_what_with_which_case_is_on_record_and_nothing_of_a_patient() {
    let recorded = Recorded::start().await;
    let address = recorded.uploaded().await;
    let case = address.rsplit('/').next().unwrap();
    for depth in [8, 9, 10] {
        let picture = format!("{address}/render?width=64&height=64&depth_mm={depth}");
        assert_eq!(recorded.get(&picture).await.status, 200);
    }
    for query in [CANARY, "other"] {
        recorded.get(&format!("/v1/cases?text={query}")).await;
    }
    for _ in 0..2 {
        assert_eq!(recorded.get("/v1/cases").await.status, 200);
    }
    let other = recorded.ask(Method::GET, &address, "read").await;
    assert_eq!(other.status, 200);
    let export = recorded.get(&format!("{address}/mask")).await;
    assert_eq!(export.status, 200, "{export:?}");
    // It is durable before the answer.
    let is_of_export = |line: &Value| line["request"] == export.header("x-request-id");
    let lines = recorded.lines();
    let line = lines.iter().find(|line| is_of_export(line)).unwrap();
    assert_eq!(
        (&line["name"], &line["who"]),
        (&"Export".into(), &"dr.silva".into())
    );
    assert_eq!(line["route"], "GET /v1/cases/{id}/mask");
    assert_eq!(
        (&line["case"], &line["outcome"]),
        (&case.into(), &"success".into())
    );
    let refused = recorded.ask(Method::DELETE, &address, "read").await;
    assert_eq!(refused.status, 403);
    let wrong = Body::from("{\"unknown\": 1}");
    let wrong = recorded.send(Method::PATCH, &address, "dr.silva", wrong);
    assert!(wrong.await.status.is_client_error());
    let deleted = recorded.ask(Method::DELETE, &address, "dr.silva").await;
    assert_eq!(deleted.status, 204);
    // What shows nothing leaves no line.
    assert_eq!(recorded.server.get("/v1/cases").await.status, 401);
    let gone = recorded.get(&format!("{address}/mask")).await;
    assert_eq!(gone.status, 404);
    assert_eq!(recorded.get(&address).await.status, 404);

    // Once a day for each person, if only once in a process.
    let viewed = recorded.all_of("case");
    let who = viewed.iter().map(|line| line["who"].as_str().unwrap());
    let who: std::collections::BTreeSet<_> = who.collect();
    assert_eq!(who, ["dr.silva", "read"].into());
    assert_eq!(viewed.len(), 2, "{viewed:?}");
    assert!(viewed.iter().all(|line| line["case"] == case));
    assert_eq!(viewed[0]["name"], "DICOM Instances Accessed");
    assert_eq!(outcomes(&recorded.all_of("list")), ["success"]);
    assert_eq!(outcomes(&recorded.all_of("export")), ["success"]);
    assert_eq!(outcomes(&recorded.all_of("upload")), ["allowed"]);
    let made = recorded.all_of("new case");
    assert_eq!((made.len(), &made[0]["case"]), (1, &case.into()));
    assert_eq!(made[0]["request"], recorded.all_of("upload")[0]["request"]);
    let changes = recorded.all_of("change");
    assert_eq!(outcomes(&changes), ["allowed", "minor-failure"]);
    assert_eq!(changes[0]["request"], changes[1]["request"]);
    let deletions = recorded.all_of("deletion");
    assert_eq!(outcomes(&deletions), ["minor-failure", "allowed"]);
    assert_eq!(deletions[0]["who"], "read");
    assert!(deletions.iter().all(|line| line["case"] == case));

    let verified = verify(&recorded.audit()).unwrap();
    assert!(
        verified.breaks.is_empty() && verified.notes.is_empty(),
        "{verified:?}"
    );
    let text = format!("{:?}", recorded.lines());
    assert!(!text.contains(CANARY) && !text.contains("text="), "{text}");
}

#[tokio::test]
async fn a_signature_is_recorded_with_whoever_gave_it() {
    let recorded = Recorded::start().await;
    let address = recorded.uploaded().await;
    let mine = format!("{address}/readings/mine");
    let send = async |method: Method, address: &str, tag: &str, body: String| {
        let request = Request::builder().method(method).uri(address);
        let request = request.header("authorization", recorded.tokens.bearer("dr.silva"));
        let request = request.header("if-match", tag).body(Body::from(body));
        recorded.server.send(request.unwrap()).await
    };
    let tag = recorded.get(&mine).await.header("etag").to_owned();
    let reading = serde_json::json!({ "conclusion": CANARY, "findings": [] });
    let kept = send(Method::PUT, &mine, &tag, reading.to_string()).await;
    assert_eq!(kept.status, 200, "{kept:?}");
    let signature = format!("{mine}/signature");
    let signed = send(Method::POST, &signature, kept.header("etag"), String::new()).await;
    assert_eq!(signed.status, 200, "{signed:?}");
    // Nothing is signed twice, which the record says.
    let again = send(
        Method::POST,
        &signature,
        signed.header("etag"),
        String::new(),
    )
    .await;
    assert_eq!(again.status, 409, "{again:?}");
    let lines = recorded.all_of("signature");
    assert_eq!(outcomes(&lines), ["allowed", "allowed", "minor-failure"]);
    let line = &lines[0];
    assert_eq!(line["who"], "dr.silva");
    assert_eq!(line["action"], "C");
    assert_eq!(line["request"], signed.header("x-request-id"));
    assert!(address.ends_with(line["case"].as_str().unwrap()));
    assert!(!format!("{:?}", recorded.lines()).contains(CANARY));
}

/// A report and a case to hand on leave as files, and show the identity of a patient if that was asked for.
#[tokio::test]
async fn a_file_that_names_the_patient_is_recorded_as_an_identity_too() {
    let recorded = Recorded::start().await;
    let address = recorded.uploaded().await;
    let mut expected = Vec::new();
    let mut named = Vec::new();
    for (file, query) in [
        ("report", ""),
        ("report", "?patient=true"),
        ("share", ""),
        ("share", "?patient=true"),
    ] {
        let file = format!("{address}/{file}{query}");
        // Its maps may not be ready yet.
        let answer = until("the file", async || {
            let answer = recorded.get(&file).await;
            (answer.status == 200).then_some(answer)
        });
        let request = answer.await.header("x-request-id").to_owned();
        if !query.is_empty() {
            named.push(request.clone());
        }
        expected.push(request);
    }
    let of = |object: &str| {
        let mut lines = recorded.all_of(object);
        lines.retain(|line| line["outcome"] == "success");
        let requests = lines.iter().map(|line| line["request"].as_str().unwrap());
        requests.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(of("export"), expected);
    assert_eq!(of("identity"), named);
}

#[tokio::test]
async fn what_cannot_be_recorded_is_not_done() {
    let recorded = Recorded::start().await;
    let address = recorded.uploaded().await;
    assert_eq!(recorded.server.get("/readyz").await.status, 200);
    std::fs::remove_dir_all(recorded.audit()).unwrap();
    let full = async |method: Method, address: &str| {
        let answer = recorded.ask(method, address, "dr.silva").await;
        assert_eq!(answer.status, 507, "{answer:?}");
        assert_eq!(answer.problem(), "audit-full");
    };
    // Before anything is done.
    full(Method::DELETE, &address).await;
    full(Method::GET, &format!("{address}/mask")).await;
    full(Method::GET, &address).await;
    full(Method::GET, "/v1/cases").await;
    full(Method::POST, "/v1/cases").await;
    // What is refused is refused all the same, and health checks tell.
    assert_eq!(recorded.server.get(&address).await.status, 401);
    assert_eq!(recorded.server.get("/healthz").await.status, 200);
    assert_eq!(recorded.server.get("/readyz").await.problem(), "audit-full");
    std::fs::create_dir(recorded.audit()).unwrap();
    let audit = recorded.server.state.audit();
    let again = async {
        while audit.is_full() {
            tokio::task::yield_now().await;
        }
    };
    let again = tokio::time::timeout(std::time::Duration::from_secs(60), again);
    again.await.expect("it is tried again");
    assert_eq!(
        recorded.get(&address).await.status,
        200,
        "nothing was deleted"
    );
    assert_eq!(recorded.server.get("/readyz").await.status, 200);
    assert_eq!(recorded.all_of("recorded again").len(), 1);
    assert!(verify(&recorded.audit()).unwrap().breaks.is_empty());
}

#[tokio::test]
async fn a_case_that_is_removed_because_of_its_age_is_on_record_or_stays() {
    let recorded = Recorded::start_with(|config| config.storage.keep_days = Some(1)).await;
    let address = recorded.uploaded().await;
    let store = recorded.server.state.cases.store();
    store.pass_time(std::time::Duration::from_secs(2 * 86_400));
    let audit = recorded.server.state.audit();
    let elsewhere = recorded.folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    let config = Config {
        audit: access::audit::Options {
            folder: Some(elsewhere.clone()),
        },
        ..Config::default()
    };
    let lost = config.audit().unwrap();
    std::fs::remove_dir_all(&elsewhere).unwrap();
    let removal = Removal::Automatic;
    let removed = async |audit| {
        remove_expired(store, &isocortex::start::recorded(audit), removal)
            .await
            .unwrap()
            .removed
    };
    assert_eq!(removed(&lost).await, 0);
    assert_eq!(recorded.get(&address).await.status, 200);
    assert_eq!(removed(audit).await, 1);
    assert_eq!(recorded.get(&address).await.status, 404);
    let removed = recorded.all_of("expired case");
    assert_eq!(outcomes(&removed), ["allowed"]);
    assert_eq!(removed[0]["case"], address.rsplit('/').next().unwrap());
    assert_eq!(removed[0]["who"], "isocortex");
}

#[tokio::test]
async fn images_from_a_pacs_have_a_line_for_each_request_and_study() {
    let folder = tempfile::tempdir().unwrap();
    let neighbour = Neighbour::start(|config| {
        config.audit.folder = Some(folder.path().to_owned());
    })
    .await;
    let slices = files(&head_slices(), Syntax::Explicit);
    for slice in &slices[..3] {
        let stored = neighbour.store(std::slice::from_ref(slice)).await;
        assert_eq!(stored.status, 200, "{stored:?}");
    }
    neighbour.server.state.audit().shut_down();
    let mut lines = lines_of(folder.path());
    lines.retain(|line| line["object"] == "image");
    assert_eq!(outcomes(&lines), ["allowed", "success"].repeat(3));
    assert_eq!(lines[0]["name"], "DICOM Instances Transferred");
    assert_eq!(lines[0]["who"], "anybody");
    for line in lines.iter().filter(|line| line["outcome"] == "success") {
        assert_eq!(line["study"], *digest_of_uid("1.2.3"));
        assert_eq!(line["count"], 1);
    }
}

#[tokio::test]
async fn the_command_finds_what_was_changed() {
    let recorded = Recorded::start().await;
    recorded.get("/v1/cases").await;
    recorded.server.state.audit().shut_down();
    let verify = || {
        let mut command = Command::new(program());
        let done = command.args(["audit", "verify"]).arg(recorded.audit());
        let done = done.output().unwrap();
        let text = String::from_utf8(done.stdout).unwrap();
        (done.status.code(), text)
    };
    let (status, text) = verify();
    assert_eq!(status, Some(0), "{text}");
    assert!(
        text.contains("as they were written") && text.contains("last line of "),
        "{text}"
    );
    let file = std::fs::read_dir(recorded.audit()).unwrap().next().unwrap();
    let file = file.unwrap().path();
    let lines = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, lines.replace("\"dr.silva\"", "\"dr.souza\"")).unwrap();
    let (status, text) = verify();
    assert_eq!(status, Some(74));
    assert!(text.contains(".jsonl:2: the line was changed"), "{text}");
}
