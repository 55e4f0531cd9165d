//! An association of a peer with us, from its request to its release, as states: each PDU leads from one to the next.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;
use std::time::Duration;

use access::audit::{Action, Audit, Event, EventKind, Outcome, digest_of_uid};
use case::series::{SeriesUids, Uid};
use cases::Error;
use cases::dicom::MAX_FILE_BYTES;
use dicom_ul::pdu::{
    AbortRQServiceProviderReason, AbortRQSource, AssociationRQ, PDataValue, PDataValueType, Pdu,
};
use imaging::dicom::IMAGE_CLASSES;
use storage::{Spool, Spooled};
use tokio::io::{AsyncRead, AsyncWrite};

use crate::dimse::command::{self, Request};
use crate::dimse::counts::{AssociationCounts, Rejection};
use crate::dimse::head::file_head;
use crate::dimse::negotiate::{Accepted, Context, negotiate, rejection};
use crate::dimse::options::{DimseOptions, is_aet};
use crate::dimse::peers::Peer;
use crate::dimse::wire::{Wire, WireError, fragments, peer_max_length};
use crate::identity::{InstanceIdentity, series_of};
use crate::refusal::{Refusal, Refusals, Status};
use crate::series::Arrivals;
use crate::store::REJECTION_NOTE;
use crate::values::{ArrivalSource, Reception};

/// What the name of a peer begins with in the audit record, so that none is the name of a token, or of somebody who has signed in.
const TITLE_PREFIX: &str = "aet:";

/// The most classes that the line about refused presentation contexts names.
const MOST_CLASSES: usize = 10;

/// How long an image waits for the disk of the audit record. A disk that takes longer counts as full.
const LONGEST_RECORDING: Duration = Duration::from_secs(10);

/// Why an association ends early. It contains nothing that a peer has sent.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Abort {
    #[error(transparent)]
    Wire(#[from] WireError),
    #[error("unexpected PDU")]
    Unexpected,
    #[error("a PDU for data contains none")]
    Empty,
    #[error("a command cannot be read")]
    BadCommand,
    #[error("an image is larger than the limit of {MAX_FILE_BYTES} bytes")]
    TooLarge,
    #[error("the peer aborted it")]
    ByPeer,
    #[error("the association was rejected")]
    Rejected,
}

impl Abort {
    /// What to tell the peer, if it can still hear it.
    fn reason(&self) -> Option<AbortRQServiceProviderReason> {
        match self {
            Self::Wire(WireError::Lost(_)) | Self::ByPeer | Self::Rejected => None,
            Self::Wire(WireError::Silent) | Self::TooLarge => {
                Some(AbortRQServiceProviderReason::ReasonNotSpecified)
            }
            Self::Unexpected => Some(AbortRQServiceProviderReason::UnexpectedPdu),
            Self::Wire(WireError::TooLong(_) | WireError::BadPdu)
            | Self::Empty
            | Self::BadCommand => Some(AbortRQServiceProviderReason::InvalidPduParameter),
        }
    }
}

/// Who has connected.
#[derive(Debug, Clone)]
pub(crate) struct Caller {
    pub(crate) address: IpAddr,
    /// The peers that are listed with the address.
    pub(crate) peers: Vec<Peer>,
    /// Whether there are as many associations as there may be, of all or of the address.
    pub(crate) is_beyond_limit: bool,
    /// The time for the request of an association.
    pub(crate) patience: Duration,
}

/// A title that a peer has sent, for the log: it may be anything.
fn shown(title: &str) -> &str {
    let title = title.trim();
    match is_aet(title) {
        true => title,
        false => "(no title)",
    }
}

/// Serves an association; returns the number of images that were stored.
pub(crate) async fn associate<S: AsyncRead + AsyncWrite + Unpin>(
    stream: S,
    caller: &Caller,
    arrivals: &Arrivals,
    options: &DimseOptions,
) -> Result<usize, Abort> {
    let mut wire = Wire::new(stream, options.idle);
    let served = serve(&mut wire, caller, arrivals, options).await;
    if let Err(abort) = &served
        && let Some(reason) = abort.reason()
    {
        let source = AbortRQSource::ServiceProvider(reason);
        // The peer may be gone.
        let _ = wire.send(&Pdu::AbortRQ { source }).await;
    }
    served
}

async fn serve<S: AsyncRead + AsyncWrite + Unpin>(
    wire: &mut Wire<S>,
    caller: &Caller,
    arrivals: &Arrivals,
    options: &DimseOptions,
) -> Result<usize, Abort> {
    let asked = wire.receive_within(caller.patience).await?;
    let Pdu::AssociationRQ(request) = asked else {
        return Err(Abort::Unexpected);
    };
    tracing::Span::current().record("calling", shown(&request.calling_ae_title));
    let negotiated = negotiate(&request, &caller.peers, options);
    let Accepted { answer, contexts } = match negotiated {
        Ok(accepted) => accepted,
        Err(why) => {
            if let Some(count) = options.counts.reject(why) {
                tracing::warn!(
                    called = shown(&request.called_ae_title),
                    reason = why.name(),
                    count,
                    "associations were rejected"
                );
            }
            wire.send(&Pdu::AssociationRJ(rejection(why))).await?;
            return Err(Abort::Rejected);
        }
    };
    if caller.is_beyond_limit {
        let why = Rejection::Limit;
        if let Some(count) = options.counts.reject(why) {
            tracing::warn!(reason = why.name(), count, "associations were rejected");
        }
        wire.send(&Pdu::AssociationRJ(rejection(why))).await?;
        return Err(Abort::Rejected);
    }
    log_refused(&request, &contexts, &options.counts);
    let _running = options.counts.begin();
    wire.send(&Pdu::AssociationAC(answer)).await?;
    let mut messages = Messages {
        arrivals,
        audit: &options.audit,
        counts: &options.counts,
        contexts: &contexts,
        state: State::Command(Vec::new()),
        studies: BTreeMap::new(),
        may_reject: (caller.peers.iter())
            .any(|peer| peer.may_reject && peer.aet == request.calling_ae_title),
        peer: &request.calling_ae_title,
        event: event_of(caller, &request.calling_ae_title),
        is_announced: false,
        refusals: Refusals::of(ArrivalSource::CStore),
    };
    let peer_max_length = peer_max_length(&request.user_variables);
    let ended = exchange(wire, &mut messages, peer_max_length, options).await;
    messages.record_end(ended.is_ok()).await;
    ended
}

/// The name of a peer in the audit record.
fn name_of(title: &str) -> String {
    format!("{TITLE_PREFIX}{}", shown(title))
}

/// Images from a peer, for the audit record.
fn event_of(caller: &Caller, title: &str) -> Event {
    Event {
        from: Some(caller.address),
        ..Event::new(
            EventKind::InstancesTransferred,
            Action::Create,
            "image",
            &name_of(title),
        )
    }
}

/// Answers messages until the peer releases the association.
async fn exchange<S: AsyncRead + AsyncWrite + Unpin>(
    wire: &mut Wire<S>,
    messages: &mut Messages<'_>,
    peer_max_length: usize,
    options: &DimseOptions,
) -> Result<usize, Abort> {
    loop {
        let pdu = wire.receive_within(options.idle).await?;
        match pdu {
            // Otherwise a peer could keep its association for ever without sending anything.
            Pdu::PData { data }
                if data
                    .iter()
                    .all(|value| value.data.is_empty() && !value.is_last) =>
            {
                return Err(Abort::Empty);
            }
            Pdu::PData { data } => {
                for value in data {
                    let Some((context, response)) = messages.take(value).await? else {
                        continue;
                    };
                    let command = PDataValueType::Command;
                    for part in fragments(&response, command, context, peer_max_length) {
                        wire.send(&Pdu::PData { data: vec![part] }).await?;
                    }
                }
            }
            Pdu::ReleaseRQ => {
                wire.send(&Pdu::ReleaseRP).await?;
                return Ok(messages.stored());
            }
            Pdu::AbortRQ { .. } => return Err(Abort::ByPeer),
            _ => return Err(Abort::Unexpected),
        }
    }
}

/// Messages, put together of fragments.
struct Messages<'a> {
    arrivals: &'a Arrivals,
    audit: &'a Audit,
    counts: &'a AssociationCounts,
    contexts: &'a [Context],
    state: State,
    /// How many images of each study were stored, by the digest of its UID.
    studies: BTreeMap<String, usize>,
    /// Whether the rejection notes of the peer count.
    may_reject: bool,
    /// The title of the peer, one of those that are listed.
    peer: &'a str,
    event: Event,
    /// Whether it is on record that images come.
    is_announced: bool,
    refusals: Refusals,
}

/// What a request is answered.
type Answer = Result<Status, Refusal>;

enum State {
    /// The rest of a command.
    Command(Vec<u8>),
    /// The rest of the data set of an image.
    Image {
        request: Request,
        context: u8,
        file: Box<Spool>,
    },
    /// The rest of a data set that is of no use.
    Ignored {
        request: Request,
        context: u8,
        answer: Answer,
    },
}

impl Messages<'_> {
    /// Takes a fragment; after the last one of a message its context and its response.
    async fn take(&mut self, value: PDataValue) -> Result<Option<(u8, Vec<u8>)>, Abort> {
        let id = value.presentation_context_id;
        let is_command = value.value_type == PDataValueType::Command;
        let state = std::mem::replace(&mut self.state, State::Command(Vec::new()));
        match state {
            State::Command(mut bytes) if is_command => {
                if bytes.len() + value.data.len() > command::MAX_LENGTH {
                    return Err(Abort::BadCommand);
                }
                bytes.extend(value.data);
                if !value.is_last {
                    self.state = State::Command(bytes);
                    return Ok(None);
                }
                let request = Request::parse(&bytes).ok_or(Abort::BadCommand)?;
                self.begin(request, id).await
            }
            State::Image {
                request,
                context,
                mut file,
            } if !is_command && id == context => {
                if file.len() + value.data.len() as u64 > MAX_FILE_BYTES {
                    if is_ignored(&request) {
                        let answer = Ok(Status::Success);
                        return Ok(self.ignore(request, context, answer, value.is_last));
                    }
                    return Err(Abort::TooLarge);
                }
                if let Err(error) = file.write(value.data.into()).await {
                    let answer = Err(Error::from(error).into());
                    return Ok(self.ignore(request, context, answer, value.is_last));
                }
                if !value.is_last {
                    self.state = State::Image {
                        request,
                        context,
                        file,
                    };
                    return Ok(None);
                }
                let answer = match file.finish().await {
                    Ok(file) => self.store(&request, file).await,
                    Err(error) => Err(Error::from(error).into()),
                };
                self.count(&answer);
                Ok(Some((context, request.response(&answer))))
            }
            State::Ignored {
                request,
                context,
                answer,
            } if !is_command && id == context => {
                Ok(self.ignore(request, context, answer, value.is_last))
            }
            _ => Err(Abort::Unexpected),
        }
    }

    /// Goes on without the data set of a message.
    fn ignore(
        &mut self,
        request: Request,
        context: u8,
        answer: Answer,
        is_last: bool,
    ) -> Option<(u8, Vec<u8>)> {
        if is_last {
            if matches!(request, Request::Store { .. }) {
                self.count(&answer);
            }
            return Some((context, request.response(&answer)));
        }
        self.state = State::Ignored {
            request,
            context,
            answer,
        };
        None
    }

    /// Counts the answer to an image.
    fn count(&mut self, answer: &Answer) {
        if let Err(refusal) = answer
            && refusal.is_of_object()
        {
            self.arrivals.refused(ArrivalSource::CStore);
            self.refusals.add(refusal);
        }
        self.counts.answered(answer.is_ok(), self.peer);
    }

    /// Answers a request, or waits for its data set.
    async fn begin(&mut self, request: Request, id: u8) -> Result<Option<(u8, Vec<u8>)>, Abort> {
        let context = self.contexts.iter().find(|context| context.id == id);
        let context = context.ok_or(Abort::Unexpected)?;
        let unrecognised =
            Refusal::new(Status::UnrecognisedOperation, "it is not C-ECHO or C-STORE");
        let refusal = match &request {
            Request::Echo { .. } => {
                return Ok(Some((id, request.response(&Ok(Status::Success)))));
            }
            Request::Other {
                has_data_set: false,
                ..
            } => return Ok(Some((id, request.response(&Err(unrecognised))))),
            Request::Other { .. } => unrecognised,
            Request::Store { object, .. } if object.sop_class_uid != context.abstract_syntax => {
                let why = "its class is not that of its presentation context";
                Refusal::new(Status::ClassNotSupported, why)
            }
            Request::Store { .. } if !self.announce().await => {
                let why = "the audit record of the server cannot be written";
                Refusal::new(Status::OutOfResources, why)
            }
            Request::Store { .. } => match self.open(&request, context).await {
                Ok(file) => {
                    self.state = State::Image {
                        context: id,
                        file: Box::new(file),
                        request,
                    };
                    return Ok(None);
                }
                Err(error) => error.into(),
            },
        };
        Ok(self.ignore(request, id, Err(refusal), false))
    }

    /// How many images were stored.
    fn stored(&self) -> usize {
        self.studies.values().sum()
    }

    /// Records that images come, before the first one; whether that is on record.
    async fn announce(&mut self) -> bool {
        if !self.is_announced {
            let allowed = Event {
                outcome: Outcome::Allowed,
                ..self.event.clone()
            };
            self.is_announced = self.record(allowed).await;
        }
        self.is_announced
    }

    /// Records how many images of each study have come.
    async fn record_end(&self, is_complete: bool) {
        if !self.is_announced {
            return;
        }
        let ended = Event {
            outcome: match is_complete {
                true => Outcome::Success,
                false => Outcome::SeriousFailure,
            },
            ..self.event.clone()
        };
        let of_study = |(study, &count): (&String, &usize)| Event {
            study: Some(study.as_str().into()),
            count: Some(count as u64),
            ..ended.clone()
        };
        let mut events: Vec<_> = self.studies.iter().map(of_study).collect();
        if events.is_empty() {
            events.push(ended);
        }
        for event in events {
            if !self.record(event).await {
                tracing::error!("the end of an association is not in the audit record");
                return;
            }
        }
    }

    async fn record(&self, event: Event) -> bool {
        let recorded = self.audit.record(event);
        let recorded = tokio::time::timeout(LONGEST_RECORDING, recorded).await;
        matches!(recorded, Ok(Ok(())))
    }

    /// A file with the head of Part 10, which a data set lacks on the way.
    async fn open(&self, request: &Request, context: &Context) -> Result<Spool, Error> {
        let mut file = self.arrivals.cases.store().spools().begin().await?;
        if let Request::Store { object, .. } = request {
            let head = file_head(object, &context.transfer_syntax);
            file.write(head.into()).await?;
        }
        Ok(file)
    }

    /// Makes an image durable.
    async fn store(&mut self, request: &Request, file: Spooled) -> Answer {
        let Request::Store { object, .. } = request else {
            return Err(Error::Internal.into());
        };
        let identity = match InstanceIdentity::read(&self.arrivals.cases, &file).await {
            // Nothing of it is kept, so nothing of it need be understood, unless it may be a rejection note.
            Err(Error::Failure(_)) if is_ignored(request) && !is_list(request) => {
                return Ok(Status::Success);
            }
            Err(Error::Failure(why)) => {
                let uids = series_of(&self.arrivals.cases, &file, &why).await;
                return Err(self.refuse(uids, Error::Failure(why).into()).await);
            }
            read => read?,
        };
        let is_same = identity.sop_class_uid.as_str() == object.sop_class_uid
            && identity.sop_instance_uid.as_str() == object.sop_instance_uid;
        if !is_same {
            let why = "its class or instance UID is not that of the command";
            let refusal = Refusal::new(Status::DataSetDoesNotMatch, why);
            return Err(self.refuse(Some(identity.uids), refusal).await);
        }
        let source = ArrivalSource::CStore;
        if !identity.is_image {
            let by = &self.event.who;
            let noted = self.arrivals.note(identity, (source, by), self.may_reject);
            return noted.await?;
        }
        let study = digest_of_uid(identity.uids.study.as_str());
        let images = vec![(identity, file)];
        let received = self.arrivals.receive(images, source).await?;
        let received = received.first().copied().unwrap_or(Reception::Known);
        let answer = received.status();
        if answer.is_ok() {
            *self.studies.entry(study).or_default() += 1;
        }
        answer
    }

    /// Counts a refusal in the arrival of its series, if that is known, and returns it.
    async fn refuse(&self, uids: Option<SeriesUids>, refusal: Refusal) -> Refusal {
        if let Some(uids) = uids {
            let refused = vec![(uids, refusal.clone())];
            self.arrivals.refuse(refused, ArrivalSource::CStore).await;
        }
        refusal
    }
}

/// Whether an object is of a class of which nothing is kept.
fn is_ignored(request: &Request) -> bool {
    matches!(request, Request::Store { object, .. } if !IMAGE_CLASSES.contains(&object.sop_class_uid.as_str()))
}

/// Logs for which classes an association may send nothing.
fn log_refused(request: &AssociationRQ, contexts: &[Context], counts: &AssociationCounts) {
    let proposed = request.presentation_contexts.iter();
    let is_refused = |class: &&str| {
        contexts
            .iter()
            .all(|context| context.abstract_syntax != *class)
    };
    let refused: BTreeSet<&str> = proposed
        .map(|proposed| proposed.abstract_syntax.as_str())
        .filter(is_refused)
        .collect();
    if refused.is_empty() {
        return;
    }
    let classes = refused
        .into_iter()
        .filter_map(Uid::parse)
        .take(MOST_CLASSES);
    let classes: Vec<String> = classes.map(|class| class.as_str().to_owned()).collect();
    let classes = classes.join(" ");
    let Some(count) = counts.refuse_contexts(&classes) else {
        return;
    };
    let why = "for another service, or in a transfer syntax that is not known";
    match contexts.is_empty() {
        true => tracing::info!(
            classes,
            count,
            why,
            "all presentation contexts were refused"
        ),
        false => tracing::info!(classes, count, why, "presentation contexts were refused"),
    }
}

/// Whether an object is a list, such as a rejection note.
fn is_list(request: &Request) -> bool {
    matches!(request, Request::Store { object, .. } if object.sop_class_uid == REJECTION_NOTE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_title_is_the_name_of_anybody_else_in_the_audit_record() {
        for title in ["proxy:ana", "isocortex", "anybody", "token", "dr.silva"] {
            assert_eq!(*name_of(title), format!("{TITLE_PREFIX}{title}"));
        }
        assert_eq!(name_of("two\nlines"), "aet:(no title)");
    }
}
