//! What is recorded of a request.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use audit::{Action, Audit, CannotRecord, Event, EventKind, Outcome, digest_of_uid};
use axum::extract::{FromRequestParts as _, MatchedPath, RawPathParams, Request};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use case::CaseId;
use tower_http::request_id::RequestId;

use crate::listen::Peer;
use crate::problem::AppError;

/// How long a request waits for the disk of the audit record. A disk that takes longer counts as full.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Where cases are.
const CASES: &str = "/v1/cases/";

/// What is recorded of the requests of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Audited {
    /// Nothing: it shows nothing of a patient.
    No,
    /// A case was looked at.
    View,
    /// Pictures of a case were drawn.
    Picture,
    /// Cases were listed or searched.
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
    /// A case or a layer was deleted.
    Delete,
    /// The server itself was used.
    Operation,
}

/// When an event is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum When {
    Never,
    /// Soon after, together with those like it.
    Counted,
    /// Durably before the answer.
    Before,
    /// Durably before anything is done, and durably again before the answer.
    Twice,
    // Of these two, what has failed eight times in a row is counted until it succeeds.
}

impl Audited {
    fn event(self) -> (EventKind, Action, &'static str) {
        match self {
            Self::No => (EventKind::ApplicationActivity, Action::Read, "nothing"),
            Self::View => (EventKind::InstancesAccessed, Action::Read, "case"),
            Self::Picture => (EventKind::InstancesAccessed, Action::Read, "picture"),
            Self::Query => (EventKind::Query, Action::Execute, "list"),
            Self::Identity => (EventKind::PatientRecord, Action::Read, "identity"),
            Self::Export => (EventKind::Export, Action::Read, "export"),
            Self::Result => (EventKind::Export, Action::Create, "result"),
            Self::Store => (EventKind::InstancesTransferred, Action::Create, "image"),
            Self::Upload => (EventKind::Import, Action::Create, "upload"),
            Self::Fetch => (EventKind::Import, Action::Execute, "retrieval"),
            Self::Change => (EventKind::ProcedureRecord, Action::Update, "change"),
            Self::Delete => (EventKind::StudyDeleted, Action::Delete, "deletion"),
            Self::Operation => (EventKind::ApplicationActivity, Action::Execute, "operation"),
        }
    }

    fn when(self) -> When {
        match self {
            Self::No => When::Never,
            Self::View | Self::Picture | Self::Query | Self::Store => When::Counted,
            Self::Identity | Self::Export => When::Before,
            Self::Result
            | Self::Upload
            | Self::Fetch
            | Self::Change
            | Self::Delete
            | Self::Operation => When::Twice,
        }
    }
}

/// The studies of the images that a request has stored, and how many: an extension of its answer.
#[derive(Debug, Clone, Default)]
pub struct StoredImages(pub BTreeMap<String, u64>);

/// An answer that shows the identity of a patient, although that of its route need not: an extension of the answer. This is recorded, too.
#[derive(Debug, Clone, Copy)]
pub struct NamesPatient;

/// Who asks for what, for the record.
pub(crate) struct Witness {
    audit: Audit,
    who: Arc<str>,
    from: Option<IpAddr>,
    route: Arc<str>,
    request: Option<Arc<str>>,
}

impl Witness {
    /// What there is to record of a request by somebody.
    pub(crate) fn new(audit: &Audit, who: &str, request: &Request) -> Self {
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
        }
    }

    fn event(&self, kind: EventKind, action: Action, object: &'static str) -> Event {
        Event {
            from: self.from,
            route: Some(self.route.clone()),
            request: self.request.clone(),
            ..Event::new(kind, action, object, &self.who)
        }
    }

    /// Records that somebody has shown a right token.
    pub(crate) async fn signs_in(&self) -> Result<(), AppError> {
        let event = self.event(EventKind::UserAuthentication, Action::Execute, "sign-in");
        in_time(self.audit.record_sign_in(event)).await
    }

    /// Records that somebody was refused.
    pub(crate) async fn is_refused(&self, why: &AppError, has_token: bool) {
        let (kind, object) = match why {
            AppError::MissingScope { .. } => (EventKind::SecurityAlert, "missing scope"),
            AppError::TokenEnded | AppError::SignInEnded => {
                (EventKind::UserAuthentication, "ended token")
            }
            AppError::IssuerAway => (EventKind::UserAuthentication, "unverified token"),
            AppError::ProxyRefused { .. } => (EventKind::UserAuthentication, "headers of a proxy"),
            _ if has_token => (EventKind::UserAuthentication, "wrong token"),
            _ => (EventKind::UserAuthentication, "no token"),
        };
        let event = Event {
            outcome: Outcome::MinorFailure,
            ..self.event(kind, Action::Execute, object)
        };
        // It is refused anyway.
        let _ = tokio::time::timeout(LONGEST_WAIT, self.audit.record_refusal(event)).await;
    }

    /// Answers a request, and records it.
    pub(crate) async fn watch(self, audited: Audited, request: Request, next: Next) -> Response {
        let when = audited.when();
        if when == When::Never {
            return next.run(request).await;
        }
        // Nothing is done that could not be recorded.
        if self.audit.is_full() {
            return AppError::AuditFull.into_response();
        }
        let (kind, action, object) = audited.event();
        let mut event = self.event(kind, action, object);
        let request = name_case(&mut event, request).await;
        // Whoever goes on with what fails does not fill the disk.
        let is_failing = self.audit.is_failing(&event);
        if when == When::Twice {
            let intended = Event {
                outcome: Outcome::Intended,
                ..event.clone()
            };
            let recorded = match is_failing {
                true => self.audit.record_counted(counted(intended)).map_err(full),
                false => in_time(self.audit.record_durable(intended)).await,
            };
            if let Err(full) = recorded {
                return full.into_response();
            }
        }
        let mut response = next.run(request).await;
        event.outcome = outcome_of(response.status());
        name_new_case(&mut event, &response);
        self.audit.note_end(&event);
        if let Some(StoredImages(studies)) = response.extensions_mut().remove() {
            return self.stored(event, studies, response);
        }
        if let Some(NamesPatient) = response.extensions_mut().remove() {
            let (kind, action, object) = Audited::Identity.event();
            let identity = Event {
                kind,
                action,
                object,
                ..event.clone()
            };
            if let Err(full) = in_time(self.audit.record_durable(identity)).await {
                return full.into_response();
            }
        }
        let is_counted = is_failing && event.outcome != Outcome::Success;
        let recorded = match when {
            When::Never => Ok(()),
            When::Before | When::Twice if is_counted => {
                self.audit.record_counted(counted(event)).map_err(full)
            }
            When::Counted => self.audit.record_counted(counted(event)).map_err(full),
            When::Before => in_time(self.audit.record_durable(event)).await,
            When::Twice => {
                // That it was intended is on record, and it is done.
                if in_time(self.audit.record_durable(event)).await.is_err() {
                    tracing::error!("the end of what was intended is not in the audit record");
                }
                Ok(())
            }
        };
        match recorded {
            Ok(()) => response,
            Err(full) => full.into_response(),
        }
    }
}

impl Witness {
    /// Records the images that a request has stored, for each study; and the request, if it failed or stored none.
    fn stored(self, event: Event, studies: BTreeMap<String, u64>, response: Response) -> Response {
        let of_study = |(study, &count): (&String, &u64)| Event {
            outcome: Outcome::Success,
            study: Some(digest_of_uid(study).into()),
            count,
            ..event.clone()
        };
        let mut events: Vec<_> = studies.iter().map(of_study).collect();
        if event.outcome != Outcome::Success || events.is_empty() {
            events.push(event);
        }
        let record = |event| self.audit.record_counted(counted(event));
        match events.into_iter().try_for_each(record) {
            Ok(()) => response,
            Err(why) => full(why).into_response(),
        }
    }
}

/// An event as it is counted together with others: it is no single request, and failures have no case, which may be none.
fn counted(event: Event) -> Event {
    let is_success = event.outcome == Outcome::Success;
    Event {
        route: None,
        request: None,
        case: event.case.filter(|_| is_success),
        study: event.study.filter(|_| is_success),
        ..event
    }
}

fn full(_: CannotRecord) -> AppError {
    AppError::AuditFull
}

async fn in_time(
    recording: impl Future<Output = Result<(), CannotRecord>>,
) -> Result<(), AppError> {
    let recorded = tokio::time::timeout(LONGEST_WAIT, recording).await;
    recorded.unwrap_or(Err(CannotRecord)).map_err(full)
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

/// Adds the case that an upload has made.
fn name_new_case(event: &mut Event, response: &Response) {
    let made = response.headers().get(header::LOCATION);
    let made = made.and_then(|made| made.to_str().ok()?.strip_prefix(CASES));
    let made = made.and_then(|made| CaseId::parse(made.split('/').next()?));
    if let (None, Some(id)) = (&event.case, made) {
        event.case = Some(id.to_string().into());
    }
}
