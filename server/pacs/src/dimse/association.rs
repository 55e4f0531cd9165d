//! An association from its request to its release, as states: each PDU leads from one to the next.

use std::io;
use std::net::IpAddr;

use bytes::Bytes;
use cases::{Error, MAX_INSTANCE_BYTES};
use dicom_ul::pdu::{
    AbortRQServiceProviderReason, AbortRQSource, PDU_HEADER_SIZE, PDataValue, PDataValueType, Pdu,
    read_pdu, write_pdu,
};
use storage::arrivals::ArrivalSource;
use storage::{Spool, Spooled};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};

use super::command::{self, Request, Status};
use super::negotiate::{Accepted, Context, MAX_PDU_LENGTH, congestion, negotiate};
use super::options::DimseOptions;
use crate::state::Pacs;

/// Why an association ends early. It contains nothing that a peer has sent.
#[derive(Debug, thiserror::Error)]
pub(super) enum Abort {
    #[error("the connection was lost")]
    Lost(#[from] io::Error),
    #[error("the peer was silent for too long")]
    Silent,
    #[error("a PDU of {0} bytes is longer than the limit of {MAX_PDU_LENGTH}")]
    TooLong(u32),
    #[error("a PDU cannot be read")]
    BadPdu,
    #[error("a PDU came that does not fit the state of the association")]
    Unexpected,
    #[error("a PDU for data contains none")]
    Empty,
    #[error("a command cannot be read")]
    BadCommand,
    #[error("an image is larger than the limit of {MAX_INSTANCE_BYTES} bytes")]
    TooLarge,
    #[error("the peer aborted it")]
    ByPeer,
    #[error("the peer is not listed, or asked for another one than us")]
    Rejected,
}

impl Abort {
    /// What to tell the peer, if it can still hear it.
    fn reason(&self) -> Option<AbortRQServiceProviderReason> {
        match self {
            Self::Lost(_) | Self::ByPeer | Self::Rejected => None,
            Self::Silent | Self::TooLarge => Some(AbortRQServiceProviderReason::ReasonNotSpecified),
            Self::Unexpected => Some(AbortRQServiceProviderReason::UnexpectedPdu),
            Self::TooLong(_) | Self::BadPdu | Self::Empty | Self::BadCommand => {
                Some(AbortRQServiceProviderReason::InvalidPduParameter)
            }
        }
    }
}

/// Serves an association; returns the number of images that were stored.
pub(super) async fn associate<S: AsyncRead + AsyncWrite + Unpin>(
    stream: S,
    address: IpAddr,
    pacs: &Pacs,
    options: &DimseOptions,
) -> Result<usize, Abort> {
    let mut wire = Wire { stream, options };
    let served = serve(&mut wire, address, pacs).await;
    if let Err(abort) = &served
        && let Some(reason) = abort.reason()
    {
        let source = AbortRQSource::ServiceProvider(reason);
        // The peer may be gone.
        let _ = wire.send(&Pdu::AbortRQ { source }).await;
    }
    served
}

/// Rejects an association that would be one too many.
pub(super) async fn reject_for_now<S: AsyncRead + AsyncWrite + Unpin>(
    stream: S,
    options: &DimseOptions,
) -> Result<(), Abort> {
    let mut wire = Wire { stream, options };
    match wire.receive().await? {
        Pdu::AssociationRQ(_) => wire.send(&Pdu::AssociationRJ(congestion())).await,
        _ => Err(Abort::Unexpected),
    }
}

async fn serve<S: AsyncRead + AsyncWrite + Unpin>(
    wire: &mut Wire<'_, S>,
    address: IpAddr,
    pacs: &Pacs,
) -> Result<usize, Abort> {
    let Pdu::AssociationRQ(request) = wire.receive().await? else {
        return Err(Abort::Unexpected);
    };
    let Accepted { answer, contexts } = match negotiate(&request, address, wire.options) {
        Ok(accepted) => accepted,
        Err(rejection) => {
            wire.send(&Pdu::AssociationRJ(rejection)).await?;
            return Err(Abort::Rejected);
        }
    };
    wire.send(&Pdu::AssociationAC(answer)).await?;
    let peer_max_length = peer_max_length(&request.user_variables);
    let mut messages = Messages {
        pacs,
        contexts: &contexts,
        state: State::Command(Vec::new()),
        stored: 0,
    };
    loop {
        match wire.receive().await? {
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
                    for part in fragments(&response, context, peer_max_length) {
                        wire.send(&Pdu::PData { data: vec![part] }).await?;
                    }
                }
            }
            Pdu::ReleaseRQ => {
                wire.send(&Pdu::ReleaseRP).await?;
                return Ok(messages.stored);
            }
            Pdu::AbortRQ { .. } => return Err(Abort::ByPeer),
            _ => return Err(Abort::Unexpected),
        }
    }
}

/// The largest PDU that the peer accepts; without a statement, or with 0, any.
fn peer_max_length(variables: &[dicom_ul::pdu::UserVariableItem]) -> usize {
    let stated = variables.iter().find_map(|item| match item {
        dicom_ul::pdu::UserVariableItem::MaxLength(length) => Some(*length as usize),
        _ => None,
    });
    match stated {
        None | Some(0) => MAX_PDU_LENGTH as usize,
        // Each fragment has a head of six bytes.
        Some(length) => length.clamp(64, MAX_PDU_LENGTH as usize),
    }
}

/// A response as fragments of a command.
fn fragments(response: &[u8], context: u8, max_length: usize) -> Vec<PDataValue> {
    let pieces: Vec<&[u8]> = response.chunks(max_length - 6).collect();
    let count = pieces.len();
    let value = |(number, piece): (usize, &[u8])| PDataValue {
        presentation_context_id: context,
        value_type: PDataValueType::Command,
        is_last: number + 1 == count,
        data: piece.to_vec(),
    };
    pieces.into_iter().enumerate().map(value).collect()
}

/// PDUs over a connection.
struct Wire<'a, S> {
    stream: S,
    options: &'a DimseOptions,
}

impl<S: AsyncRead + AsyncWrite + Unpin> Wire<'_, S> {
    /// The next PDU, whole. Its length is checked before it is read.
    async fn receive(&mut self) -> Result<Pdu, Abort> {
        let idle = self.options.idle;
        let received = tokio::time::timeout(idle, self.receive_now()).await;
        received.map_err(|_elapsed| Abort::Silent)?
    }

    async fn receive_now(&mut self) -> Result<Pdu, Abort> {
        let mut bytes = vec![0; PDU_HEADER_SIZE as usize];
        self.stream.read_exact(&mut bytes).await?;
        let length = u32::from_be_bytes([bytes[2], bytes[3], bytes[4], bytes[5]]);
        if length > MAX_PDU_LENGTH {
            return Err(Abort::TooLong(length));
        }
        bytes.resize(bytes.len() + length as usize, 0);
        self.stream
            .read_exact(&mut bytes[PDU_HEADER_SIZE as usize..])
            .await?;
        parse(bytes)
    }

    async fn send(&mut self, pdu: &Pdu) -> Result<(), Abort> {
        let mut bytes = Vec::new();
        write_pdu(&mut bytes, pdu).map_err(|_| Abort::BadPdu)?;
        let sent = tokio::time::timeout(self.options.idle, async {
            self.stream.write_all(&bytes).await?;
            self.stream.flush().await
        });
        Ok(sent.await.map_err(|_elapsed| Abort::Silent)??)
    }
}

/// A whole PDU. The reader of `dicom-ul` takes some lengths inside of a PDU on trust and panics if they lie.
fn parse(bytes: Vec<u8>) -> Result<Pdu, Abort> {
    let read = std::panic::catch_unwind(move || read_pdu(Bytes::from(bytes), MAX_PDU_LENGTH, true));
    match read {
        Ok(Ok(Some(pdu))) => Ok(pdu),
        _ => Err(Abort::BadPdu),
    }
}

/// Messages, put together of fragments.
struct Messages<'a> {
    pacs: &'a Pacs,
    contexts: &'a [Context],
    state: State,
    stored: usize,
}

/// What comes next.
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
        status: Status,
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
                if file.len() + value.data.len() as u64 > MAX_INSTANCE_BYTES {
                    return Err(Abort::TooLarge);
                }
                if let Err(error) = file.write(value.data.into()).await {
                    let status = status_of(&error.into());
                    return Ok(self.ignore(request, context, status, value.is_last));
                }
                if !value.is_last {
                    self.state = State::Image {
                        request,
                        context,
                        file,
                    };
                    return Ok(None);
                }
                let status = match file.finish().await {
                    Ok(file) => self.store(&request, file).await,
                    Err(error) => status_of(&error.into()),
                };
                Ok(Some((context, request.response(status))))
            }
            State::Ignored {
                request,
                context,
                status,
            } if !is_command && id == context => {
                Ok(self.ignore(request, context, status, value.is_last))
            }
            _ => Err(Abort::Unexpected),
        }
    }

    /// Goes on without the data set of a message.
    fn ignore(
        &mut self,
        request: Request,
        context: u8,
        status: Status,
        is_last: bool,
    ) -> Option<(u8, Vec<u8>)> {
        if is_last {
            return Some((context, request.response(status)));
        }
        self.state = State::Ignored {
            request,
            context,
            status,
        };
        None
    }

    /// Answers a request, or waits for its data set.
    async fn begin(&mut self, request: Request, id: u8) -> Result<Option<(u8, Vec<u8>)>, Abort> {
        let context = self.contexts.iter().find(|context| context.id == id);
        let context = context.ok_or(Abort::Unexpected)?;
        let status = match &request {
            Request::Echo { .. } => return Ok(Some((id, request.response(Status::Success)))),
            Request::Other {
                has_data_set: false,
                ..
            } => {
                let response = request.response(Status::UnrecognisedOperation);
                return Ok(Some((id, response)));
            }
            Request::Other { .. } => Status::UnrecognisedOperation,
            Request::Store { sop_class_uid, .. } if *sop_class_uid != context.abstract_syntax => {
                Status::ClassNotSupported
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
                Err(error) => status_of(&error),
            },
        };
        Ok(self.ignore(request, id, status, false))
    }

    /// A file with the head of Part 10, which a data set lacks on the way.
    async fn open(&self, request: &Request, context: &Context) -> Result<Spool, Error> {
        let mut file = self.pacs.cases().store().spool().await?;
        let head = file_head(request, &context.transfer_syntax);
        file.write(head.into()).await?;
        Ok(file)
    }

    /// Makes an image durable.
    async fn store(&mut self, request: &Request, file: Spooled) -> Status {
        let Request::Store {
            sop_class_uid,
            sop_instance_uid,
            ..
        } = request
        else {
            return Status::ProcessingFailure;
        };
        let identity = match self.pacs.cases().headers.read(&file).await {
            Ok(identity) => identity,
            Err(error) => return status_of(&error),
        };
        let is_same = identity.sop_class_uid.as_str() == sop_class_uid
            && identity.sop_instance_uid.as_str() == sop_instance_uid;
        if !is_same {
            return Status::DataSetDoesNotMatch;
        }
        if !identity.is_image {
            return Status::ClassNotSupported;
        }
        let images = vec![(identity, file)];
        let received = self.pacs.cases().receive(images, ArrivalSource::CStore);
        match received.await {
            Ok(_) => {
                self.stored += 1;
                Status::Success
            }
            Err(error) => status_of(&error),
        }
    }
}

/// The status for an error of the application.
fn status_of(error: &Error) -> Status {
    match error {
        Error::StorageFull | Error::Busy | Error::Unavailable => Status::OutOfResources,
        Error::StorageFailed(cause) => {
            tracing::error!(
                error = cause as &dyn std::error::Error,
                "an image could not be stored"
            );
            Status::OutOfResources
        }
        Error::Failure(_) => Status::CannotUnderstand,
        error => {
            tracing::error!(%error, "an image could not be stored");
            Status::ProcessingFailure
        }
    }
}

/// The preamble and the file meta information (PS3.10 §7.1).
fn file_head(request: &Request, transfer_syntax: &str) -> Vec<u8> {
    let mut meta = Vec::new();
    let mut element = |number: u16, uid: &str| {
        let value = command::padded(uid);
        meta.extend([2, 0]);
        meta.extend(number.to_le_bytes());
        meta.extend(b"UI");
        meta.extend(u16::try_from(value.len()).unwrap_or(0).to_le_bytes());
        meta.extend(value);
    };
    if let Request::Store {
        sop_class_uid,
        sop_instance_uid,
        ..
    } = request
    {
        element(0x0002, sop_class_uid);
        element(0x0003, sop_instance_uid);
    }
    element(0x0010, transfer_syntax);
    let mut head = vec![0; 128];
    head.extend(b"DICM");
    head.extend([2, 0, 0, 0]);
    head.extend(b"UL");
    head.extend([4, 0]);
    head.extend(u32::try_from(meta.len()).unwrap_or(0).to_le_bytes());
    head.extend(meta);
    head
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use dicom_ul::pdu::{AssociationRQ, PresentationContextProposed, UserVariableItem};

    fn pdus() -> Vec<Vec<u8>> {
        let request = AssociationRQ {
            protocol_version: 1,
            calling_ae_title: "SENDER".to_owned(),
            called_ae_title: "ISOCORTEX".to_owned(),
            application_context_name: "1.2.840.10008.3.1.1.1".to_owned(),
            presentation_contexts: vec![PresentationContextProposed {
                id: 1,
                abstract_syntax: "1.2.840.10008.1.1".to_owned(),
                transfer_syntaxes: vec!["1.2.840.10008.1.2".to_owned()],
            }],
            user_variables: vec![
                UserVariableItem::MaxLength(16384),
                UserVariableItem::ImplementationClassUID("1.2.3".to_owned()),
            ],
        };
        let data = PDataValue {
            presentation_context_id: 1,
            value_type: PDataValueType::Command,
            is_last: true,
            data: vec![7; 60],
        };
        let source = AbortRQSource::ServiceUser;
        let pdus = [
            Pdu::AssociationRQ(request),
            Pdu::PData { data: vec![data] },
            Pdu::ReleaseRQ,
            Pdu::AbortRQ { source },
        ];
        let written = |pdu: &Pdu| {
            let mut bytes = Vec::new();
            write_pdu(&mut bytes, pdu).unwrap();
            bytes
        };
        pdus.iter().map(written).collect()
    }

    #[test]
    fn the_head_of_a_file_states_its_own_length() {
        let request = Request::Echo { message_id: 1 };
        let head = file_head(&request, "1.2.840.10008.1.2.1");
        let length = u32::from_le_bytes(head[140..144].try_into().unwrap());
        assert_eq!(length as usize, head.len() - 144);
    }

    proptest! {
        #[test]
        fn nothing_that_is_changed_on_the_way_is_a_panic(
            which in 0_usize..4,
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
            cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = pdus().swap_remove(which);
            for (at, byte) in changes {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            bytes.truncate(cut.index(bytes.len()) + 1);
            let _ = parse(bytes);
        }
    }
}
