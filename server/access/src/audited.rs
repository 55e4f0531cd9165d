//! What is recorded of a request.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use crate::audit::{Action, Audit, CannotRecord, Event, EventKind, Outcome, digest_of_uid};
use axum::extract::{FromRequestParts as _, MatchedPath, RawPathParams, Request};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use case::CaseId;
use tower_http::request_id::RequestId;

use crate::error::AccessError;
use http::listen::Peer;

/// How long a request waits for the disk of the audit record. A disk that takes longer counts as full.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

const CASES: &str = "/v1/cases/";

/// What is recorded of the requests of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Audited {
    /// Nothing: it shows nothing of a patient.
    No,
    /// A case was looked at.
    View,
    /// Cases were listed or searched, without the identity of a patient.
    Query,
    /// The identity of a patient was shown.
    Identity,
    /// Files of a case left.
    Export,
    /// A result was made, or sent to a node.
    Result,
    /// Images came from a PACS.
    Store,
    /// A volume was uploaded.
    Upload,
    /// Images were fetched from a node.
    Fetch,
    /// A case or a layer was changed.
    Change,
    /// A reader has signed a reading.
    Signature,
    /// A case or a layer was deleted.
    Delete,
    /// The server itself was used.
    Operation,
}

/// When an event is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum When {
    Never,
    /// Before the answer, once a day for each person and case.
    Daily,
    /// Before the answer, if that shows what was asked for.
    BeforeAnswer,
    /// Before anything is done, and again if it then fails.
    BeforeDone,
}

impl Audited {
    fn event(self) -> (EventKind, Action, &'static str) {
        match self {
            Self::No => (EventKind::ApplicationActivity, Action::Read, "nothing"),
            Self::View => (EventKind::InstancesAccessed, Action::Read, "case"),
            Self::Query => (EventKind::Query, Action::Execute, "list"),
            Self::Identity => (EventKind::PatientRecord, Action::Read, "identity"),
            Self::Export => (EventKind::Export, Action::Read, "export"),
            Self::Result => (EventKind::Export, Action::Create, "result"),
            Self::Store => (EventKind::InstancesTransferred, Action::Create, "image"),
            Self::Upload => (EventKind::Import, Action::Create, "upload"),
            Self::Fetch => (EventKind::Import, Action::Execute, "retrieval"),
            Self::Change => (EventKind::ProcedureRecord, Action::Update, "change"),
            Self::Signature => (EventKind::ProcedureRecord, Action::Create, "signature"),
            Self::Delete => (EventKind::StudyDeleted, Action::Delete, "deletion"),
            Self::Operation => (EventKind::ApplicationActivity, Action::Execute, "operation"),
        }
    }

    fn when(self) -> When {
        match self {
            Self::No => When::Never,
            Self::View | Self::Query => When::Daily,
            Self::Identity | Self::Export => When::BeforeAnswer,
            Self::Result
            | Self::Store
            | Self::Upload
            | Self::Fetch
            | Self::Change
            | Self::Signature
            | Self::Delete
            | Self::Operation => When::BeforeDone,
        }
    }
}

/// The studies of the images that a request has stored, and how many: an extension of its answer.
#[derive(Debug, Clone, Default)]
pub struct StoredImages(pub BTreeMap<String, u64>);

/// An answer that shows the identity of a patient, although that of its route need not: an extension of the answer. This is recorded, too.
#[derive(Debug, Clone, Copy)]
pub struct NamesPatient;

/// Who asks for what, and the record of it.
pub(crate) struct Recorder {
    audit: Audit,
    who: Arc<str>,
    from: Option<IpAddr>,
    route: Arc<str>,
    request: Option<Arc<str>>,
    audited: Audited,
}

impl Recorder {
    /// What there is to record of a request by somebody.
    pub(crate) fn new(audit: &Audit, who: &str, audited: Audited, request: &Request) -> Self {
        let extensions = request.extensions();
        let path = extensions.get::<MatchedPath>();
        let path = path.map_or("", MatchedPath::as_str);
        let id = extensions.get::<RequestId>();
        let id = id.and_then(|id| id.header_value().to_str().ok());
        Self {
            audit: audit.clone(),
            who: who.into(),
            from: extensions.get::<Peer>().map(|peer| peer.0),
            route: format!("{} {path}", request.method()).into(),
            request: id.map(Into::into),
            audited,
        }
    }

    fn event(&self, (kind, action, object): (EventKind, Action, &'static str)) -> Event {
        Event {
            from: self.from,
            route: Some(self.route.clone()),
            request: self.request.clone(),
            ..Event::new(kind, action, object, &self.who)
        }
    }

    /// Records that somebody may not change what they wanted to. Who may not look is in the log of the proxy.
    pub(crate) async fn refuses(&self, request: Request) {
        if self.audited.when() == When::BeforeDone {
            let mut event = self.event(self.audited.event());
            name_case(&mut event, request).await;
            event.outcome = Outcome::MinorFailure;
            // It is refused anyway.
            let _ = self.record(event).await;
        }
    }

    /// Answers a request, and records it.
    pub(crate) async fn answer(self, request: Request, next: Next) -> Response {
        let when = self.audited.when();
        if when == When::Never {
            return next.run(request).await;
        }
        // Nothing is done that could not be recorded.
        if self.audit.is_full() {
            return AccessError::AuditFull.into_response();
        }
        let mut event = self.event(self.audited.event());
        let request = name_case(&mut event, request).await;
        if when == When::BeforeDone {
            event.outcome = Outcome::Allowed;
            if let Err(full) = self.record(event.clone()).await {
                return full.into_response();
            }
        }
        let mut response = next.run(request).await;
        event.outcome = outcome_of(response.status());
        match self.record_answer(event, &mut response).await {
            Ok(()) => response,
            Err(full) => full.into_response(),
        }
    }

    /// Records how a request ended, as far as that is recorded.
    async fn record_answer(
        &self,
        event: Event,
        response: &mut Response,
    ) -> Result<(), AccessError> {
        let is_success = event.outcome == Outcome::Success;
        let extensions = response.extensions_mut();
        if let Some(StoredImages(studies)) = extensions.remove() {
            self.record_images(&event, studies).await?;
        }
        if extensions.remove::<NamesPatient>().is_some() && is_success {
            let (kind, action, object) = Audited::Identity.event();
            let identity = Event {
                kind,
                action,
                object,
                ..event.clone()
            };
            self.record(identity).await?;
        }
        match self.audited.when() {
            When::Daily if is_success => in_time(self.audit.record_daily(event)).await,
            When::BeforeAnswer if is_success => self.record(event).await,
            When::BeforeDone if is_success => match new_case(&event, response) {
                Some(made) => self.record(made).await,
                None => Ok(()),
            },
            When::BeforeDone => {
                // It was not done, so the answer may go.
                if self.record(event).await.is_err() {
                    tracing::error!("the failure of what was allowed is not in the audit record");
                }
                Ok(())
            }
            When::Never | When::Daily | When::BeforeAnswer => Ok(()),
        }
    }

    /// Records the images of each study that a request has stored.
    async fn record_images(
        &self,
        event: &Event,
        studies: BTreeMap<String, u64>,
    ) -> Result<(), AccessError> {
        for (study, count) in studies {
            let of_study = Event {
                outcome: Outcome::Success,
                study: Some(digest_of_uid(&study).into()),
                count: Some(count),
                ..event.clone()
            };
            self.record(of_study).await?;
        }
        Ok(())
    }

    async fn record(&self, event: Event) -> Result<(), AccessError> {
        in_time(self.audit.record(event)).await
    }
}

async fn in_time(
    recording: impl Future<Output = Result<(), CannotRecord>>,
) -> Result<(), AccessError> {
    let recorded = tokio::time::timeout(LONGEST_WAIT, recording).await;
    recorded
        .unwrap_or(Err(CannotRecord))
        .map_err(|_| AccessError::AuditFull)
}

fn outcome_of(status: StatusCode) -> Outcome {
    match status.as_u16() {
        0..400 => Outcome::Success,
        400..500 => Outcome::MinorFailure,
        _ => Outcome::SeriousFailure,
    }
}

/// Adds the case or the study that a request names.
async fn name_case(event: &mut Event, request: Request) -> Request {
    let (mut parts, body) = request.into_parts();
    // What is not UTF-8 names nothing.
    if let Ok(names) = RawPathParams::from_request_parts(&mut parts, &()).await {
        let value = |name: &str| {
            let found = names.iter().find(|(key, _)| *key == name);
            found.map(|(_, value)| value)
        };
        let is_of_case = parts.uri.path().starts_with(CASES);
        let case = value("id").filter(|_| is_of_case).and_then(CaseId::parse);
        event.case = case.map(|id| id.to_string().into());
        event.study = value("study").map(|uid| digest_of_uid(uid).into());
    }
    Request::from_parts(parts, body)
}

/// The event of the case that an upload has made, if it names none.
fn new_case(upload: &Event, response: &Response) -> Option<Event> {
    let made = response.headers().get(header::LOCATION)?;
    let made = made.to_str().ok()?.strip_prefix(CASES)?;
    let id = CaseId::parse(made.split('/').next()?)?;
    upload.case.is_none().then(|| Event {
        kind: EventKind::ProcedureRecord,
        object: "new case",
        case: Some(id.to_string().into()),
        ..upload.clone()
    })
}
