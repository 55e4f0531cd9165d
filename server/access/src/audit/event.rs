use std::net::IpAddr;
use std::sync::Arc;

use serde::Serialize;

/// The kinds of events, as far as they fit those of DICOM audit messages (PS3.15 §A.5.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EventKind {
    /// A process has started or stopped, or could not record events for a while.
    ApplicationActivity,
    /// A case was looked at.
    InstancesAccessed,
    /// Images came from a PACS, or results went to one.
    InstancesTransferred,
    /// A case or a layer was deleted.
    StudyDeleted,
    /// Data left as files.
    Export,
    /// Data came as files.
    Import,
    /// The identity of a patient was shown.
    PatientRecord,
    /// A case, its findings or its layers were changed, or a reading was signed.
    ProcedureRecord,
    /// Cases were listed or searched.
    Query,
}

impl EventKind {
    /// The code of the event in the terminology of DICOM (PS3.16, CID 400), and its meaning.
    pub fn code(self) -> (&'static str, &'static str) {
        match self {
            Self::ApplicationActivity => ("110100", "Application Activity"),
            Self::InstancesAccessed => ("110103", "DICOM Instances Accessed"),
            Self::InstancesTransferred => ("110104", "DICOM Instances Transferred"),
            Self::StudyDeleted => ("110105", "DICOM Study Deleted"),
            Self::Export => ("110106", "Export"),
            Self::Import => ("110107", "Import"),
            Self::PatientRecord => ("110110", "Patient Record"),
            Self::ProcedureRecord => ("110111", "Procedure Record"),
            Self::Query => ("110112", "Query"),
        }
    }
}

/// What was done: the letters of DICOM audit messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
pub enum Action {
    #[serde(rename = "C")]
    Create,
    #[serde(rename = "R")]
    Read,
    #[serde(rename = "U")]
    Update,
    #[serde(rename = "D")]
    Delete,
    #[serde(rename = "E")]
    Execute,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It was allowed, and then done: if it was not, a line with the same request states the failure.
    Allowed,
    Success,
    /// Refused, or impossible.
    MinorFailure,
    /// The server, a node or the store failed.
    SeriousFailure,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    pub kind: EventKind,
    pub action: Action,
    pub outcome: Outcome,
    /// What it was done with, in one word, such as `picture`.
    pub object: &'static str,
    /// Who did it: the name of a token, or the title of a peer.
    pub who: Arc<str>,
    /// The address that it came from.
    pub from: Option<IpAddr>,
    /// The node that it went to.
    pub to: Option<Arc<str>>,
    /// The id of the case.
    pub case: Option<Arc<str>>,
    /// The digest of the UID of the study ([`digest_of_uid`]), if it is about one.
    pub study: Option<Arc<str>>,
    /// Method and template of the address, if it was a request.
    pub route: Option<Arc<str>>,
    /// The id of the request.
    pub request: Option<Arc<str>>,
    /// How many images it is about, if it is about images.
    pub count: Option<u64>,
}

impl Event {
    /// An event with nothing but these.
    pub fn new(kind: EventKind, action: Action, object: &'static str, who: &str) -> Self {
        Self {
            kind,
            action,
            outcome: Outcome::Success,
            object,
            who: who.into(),
            from: None,
            to: None,
            case: None,
            study: None,
            route: None,
            request: None,
            count: None,
        }
    }
}

/// What stands for a UID: the first 32 hexadecimal digits of its BLAKE3 digest. Whoever knows the UID finds its events.
pub fn digest_of_uid(uid: &str) -> String {
    let digest = blake3::hash(uid.trim().as_bytes());
    digest.to_hex()[..32].to_owned()
}
