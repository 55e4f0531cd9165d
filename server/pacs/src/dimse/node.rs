//! C-STORE to a node (PS3.4 B, PS3.7 §9.1.1): one association for each object.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use dicom_ul::pdu::{
    AbortRQSource, AssociationAC, PDataValueType, Pdu, PresentationContextResultReason,
};
use imaging::dicom::write::{file_head, implicit_file};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::pki_types::ServerName;

use crate::dimse::command::{
    self, ObjectName, VERIFICATION, echo_request, status_of_response, store_request,
};
use crate::dimse::negotiate::{EXPLICIT, IMPLICIT, request_to_store};
use crate::dimse::options::is_aet;
use crate::dimse::outcome::{is_stored, rejected};
use crate::dimse::wire::{Wire, WireError, fragments, peer_max_length};
use crate::node::error::{BadNode, NodeError};
use http::tls::ConnectingTls;

/// How long to wait for a connection.
const CONNECT: Duration = Duration::from_secs(10);

/// How long a PDU may take.
const IDLE: Duration = Duration::from_secs(30);

/// How long a node may take to store an object that it has received.
const ANSWER: Duration = Duration::from_secs(300);

/// How long an object may take in all.
const WHOLE: Duration = Duration::from_secs(600);

/// How long an echo may take in all.
const ECHO: Duration = Duration::from_secs(20);

/// How long to wait until a node agrees that all is done.
const RELEASE: Duration = Duration::from_secs(5);

/// The only presentation context.
const CONTEXT: u8 = 1;

/// A node that objects are sent to. Cheap to clone.
#[derive(Debug, Clone)]
pub struct StorageNode {
    address: String,
    /// TLS, and the name in the certificate of the node.
    tls: Option<(ConnectingTls, ServerName<'static>)>,
    /// Its application entity title.
    aet: String,
    our_aet: String,
}

impl StorageNode {
    /// A node at a host and a port, by its application entity title and ours.
    ///
    /// # Errors
    /// [`BadNode`].
    pub fn new(address: &str, aet: &str, our_aet: &str) -> Result<Self, BadNode> {
        if !is_aet(aet) || !is_aet(our_aet) {
            return Err(BadNode::Aet);
        }
        let (host, port) = address.rsplit_once(':').ok_or(BadNode::StorageAddress)?;
        let is_host = !host.is_empty() && !host.contains(['/', '@', ' ']);
        let port: u16 = port.parse().map_err(|_| BadNode::StorageAddress)?;
        if !is_host || port == 0 {
            return Err(BadNode::StorageAddress);
        }
        Ok(Self {
            address: address.to_owned(),
            tls: None,
            aet: aet.to_owned(),
            our_aet: our_aet.to_owned(),
        })
    }

    /// The same node by TLS.
    ///
    /// # Errors
    /// [`BadNode::StorageAddress`] if its host cannot be in a certificate.
    pub fn with_tls(self, tls: ConnectingTls) -> Result<Self, BadNode> {
        let host = self.address.rsplit_once(':').map_or("", |(host, _)| host);
        let host = host
            .trim_start_matches('[')
            .trim_end_matches(']')
            .to_owned();
        let name = ServerName::try_from(host).map_err(|_| BadNode::StorageAddress)?;
        Ok(Self {
            tls: Some((tls, name)),
            ..self
        })
    }

    /// Stores an object, which is in a file that we have written. Afterwards the node has it.
    ///
    /// # Errors
    /// [`NodeError`]. The node may have it nevertheless, if its answer was lost.
    pub async fn store(&self, file: &Bytes) -> Result<(), NodeError> {
        let object = Object::read(file.clone()).ok_or(NodeError::Object)?;
        let operation = Operation::Store(Box::new(object));
        let stored = tokio::time::timeout(WHOLE, self.connect_and_do(operation)).await;
        stored.map_err(|_elapsed| NodeError::Silent)?
    }

    /// Asks the node whether it is there and knows us (C-ECHO).
    ///
    /// # Errors
    /// [`NodeError`], in the words of storing, since that is what would fail.
    pub async fn echo(&self) -> Result<(), NodeError> {
        let answered = tokio::time::timeout(ECHO, self.connect_and_do(Operation::Echo)).await;
        answered.map_err(|_elapsed| NodeError::Silent)?
    }

    async fn connect_and_do(&self, operation: Operation) -> Result<(), NodeError> {
        let stream = tokio::time::timeout(CONNECT, TcpStream::connect(&self.address)).await;
        let stream = stream.map_err(|_elapsed| NodeError::Unreachable)?;
        let stream = stream.map_err(|_| NodeError::Unreachable)?;
        if let Err(error) = stream.set_nodelay(true) {
            tracing::debug!(%error, "TCP_NODELAY refused");
        }
        let Some((tls, name)) = &self.tls else {
            return self.do_over(stream, operation).await;
        };
        let connecting = TlsConnector::from(Arc::clone(tls)).connect(name.clone(), stream);
        let stream = tokio::time::timeout(CONNECT, connecting).await;
        let stream = stream.map_err(|_elapsed| NodeError::Silent)?;
        let stream = stream.map_err(WireError::Lost)?;
        self.do_over(stream, operation).await
    }

    async fn do_over<S: AsyncRead + AsyncWrite + Unpin>(
        &self,
        stream: S,
        operation: Operation,
    ) -> Result<(), NodeError> {
        let mut wire = Wire::new(stream, IDLE);
        let done = self.associate_and_do(&mut wire, operation).await;
        // The node may be gone, and what it has stored stays stored.
        let _ = match done {
            Ok(()) | Err(NodeError::Failed(_) | NodeError::Class) => release(&mut wire).await,
            Err(NodeError::Unreadable | NodeError::Silent | NodeError::Object) => {
                let source = AbortRQSource::ServiceUser;
                wire.send(&Pdu::AbortRQ { source }).await
            }
            Err(_) => Ok(()),
        };
        done
    }

    async fn associate_and_do<S: AsyncRead + AsyncWrite + Unpin>(
        &self,
        wire: &mut Wire<S>,
        operation: Operation,
    ) -> Result<(), NodeError> {
        let class = match &operation {
            Operation::Echo => VERIFICATION,
            Operation::Store(object) => object.name.sop_class_uid.as_str(),
        };
        let request = request_to_store(CONTEXT, class, &self.our_aet, &self.aet);
        wire.send(&Pdu::AssociationRQ(request)).await?;
        let answer = match wire.receive().await? {
            Pdu::AssociationAC(answer) => answer,
            Pdu::AssociationRJ(rejection) => return Err(rejected(&rejection)),
            Pdu::AbortRQ { .. } => return Err(NodeError::Aborted),
            _ => return Err(NodeError::Unreadable),
        };
        let syntax = accepted_syntax(&answer)?;
        let max_length = peer_max_length(&answer.user_variables);
        let object = match operation {
            Operation::Echo => {
                let command = echo_request();
                for part in fragments(&command, PDataValueType::Command, CONTEXT, max_length) {
                    wire.send(&Pdu::PData { data: vec![part] }).await?;
                }
                return is_stored(status(wire).await?);
            }
            Operation::Store(object) => object.in_syntax(syntax).await?,
        };
        let command = store_request(&object.name);
        let command = fragments(&command, PDataValueType::Command, CONTEXT, max_length);
        let data = fragments(&object.data_set, PDataValueType::Data, CONTEXT, max_length);
        for part in command.chain(data) {
            wire.send(&Pdu::PData { data: vec![part] }).await?;
        }
        is_stored(status(wire).await?)
    }
}

/// What an association is for.
enum Operation {
    Echo,
    Store(Box<Object>),
}

/// An object in a file.
struct Object {
    name: ObjectName,
    transfer_syntax: String,
    data_set: Bytes,
    file: Bytes,
}

impl Object {
    fn read(file: Bytes) -> Option<Self> {
        let head = file_head(&file).ok()?;
        Some(Self {
            name: ObjectName {
                sop_class_uid: head.sop_class_uid,
                sop_instance_uid: head.sop_instance_uid,
            },
            transfer_syntax: head.transfer_syntax,
            data_set: file.slice(head.length..),
            file,
        })
    }

    async fn in_syntax(self, syntax: &str) -> Result<Self, NodeError> {
        if self.transfer_syntax == syntax {
            return Ok(self);
        }
        if syntax != IMPLICIT {
            return Err(NodeError::Unreadable);
        }
        let write = move || implicit_file(&self.file);
        let file = tokio::task::spawn_blocking(write).await;
        let file = file.map_err(|_| NodeError::Object)?;
        let file = file.map_err(|_| NodeError::Object)?;
        Self::read(file.into()).ok_or(NodeError::Object)
    }
}

/// The transfer syntax that a node has chosen of those that were proposed.
fn accepted_syntax(answer: &AssociationAC) -> Result<&'static str, NodeError> {
    let mut results = answer.presentation_contexts.iter();
    let result = results.find(|result| result.id == CONTEXT);
    let accepted =
        result.filter(|result| result.reason == PresentationContextResultReason::Acceptance);
    let chosen = accepted.ok_or(NodeError::Class)?;
    let chosen = chosen.transfer_syntax.trim_end_matches(['\0', ' ']);
    let mut proposed = [EXPLICIT, IMPLICIT].into_iter();
    proposed
        .find(|&syntax| syntax == chosen)
        .ok_or(NodeError::Unreadable)
}

/// The status of the response.
async fn status<S: AsyncRead + AsyncWrite + Unpin>(wire: &mut Wire<S>) -> Result<u16, NodeError> {
    let mut bytes = Vec::new();
    loop {
        let values = match wire.receive_within(ANSWER).await? {
            Pdu::PData { data } => data,
            Pdu::AbortRQ { .. } => return Err(NodeError::Aborted),
            _ => return Err(NodeError::Unreadable),
        };
        for value in values {
            let is_command = value.value_type == PDataValueType::Command;
            if !is_command || bytes.len() + value.data.len() > command::MAX_LENGTH {
                return Err(NodeError::Unreadable);
            }
            bytes.extend(value.data);
            if value.is_last {
                return status_of_response(&bytes).ok_or(NodeError::Unreadable);
            }
        }
    }
}

async fn release<S: AsyncRead + AsyncWrite + Unpin>(wire: &mut Wire<S>) -> Result<(), WireError> {
    wire.send(&Pdu::ReleaseRQ).await?;
    wire.receive_within(RELEASE).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use super::*;
    use crate::dimse::command::Request;
    use crate::refusal::Status;
    use dicom_ul::pdu::{
        AssociationRJ, AssociationRJResult, AssociationRJServiceProviderPresentationReason,
        AssociationRJServiceUserReason, AssociationRJSource, AssociationRQ,
        PresentationContextResult, UserVariableItem,
    };
    use imaging::dicom::Attributes;
    use imaging::dicom::write::{Head, Laterality, Picture, picture};
    use tokio::io::DuplexStream;

    const MAX_LENGTH: u32 = 256;

    fn ours() -> StorageNode {
        StorageNode::new("127.0.0.1:104", "ARCHIVE", "ISOCORTEX").unwrap()
    }

    fn file() -> Bytes {
        let attributes = [
            ("StudyInstanceUID", "1.2.3"),
            ("PatientName", "Müller^Änne"),
        ];
        let source = Attributes {
            attributes: attributes
                .map(|(name, value)| (name.to_owned(), value.to_owned()))
                .into(),
            ..Attributes::default()
        };
        let head = Head {
            source: &source,
            series_uid: "2.25.1",
            instance_uid: "2.25.2",
            series_number: 9001,
            series_description: "a picture",
            derivation: "",
            comment: "",
            version: "1",
            date: "20261122",
            time: "153000",
            offset: None,
            is_annotated: false,
            is_recognizable: None,
        };
        let pixels = Picture {
            width: 20,
            height: 10,
            rgb: (0..600_u32).map(|value| value as u8).collect(),
            orientation: None,
            laterality: Laterality::Both,
        };
        picture(&head, pixels).unwrap().into()
    }

    /// What a node of the test does.
    enum Node {
        /// It stores the object in this syntax, and answers with this status.
        Stores(&'static str, Status),
        /// It answers to the request for an association.
        Answers(Pdu),
        /// It sends something else.
        Sends(&'static [u8]),
        /// It ends the association after the first PDU of data.
        Leaves,
    }

    fn accepted(request: &AssociationRQ, syntax: &str) -> AssociationAC {
        let [proposed] = &request.presentation_contexts[..] else {
            panic!("{request:?}");
        };
        assert_eq!(proposed.abstract_syntax, "1.2.840.10008.5.1.4.1.1.7");
        assert_eq!(proposed.transfer_syntaxes, [EXPLICIT, IMPLICIT]);
        AssociationAC {
            protocol_version: 1,
            calling_ae_title: request.calling_ae_title.clone(),
            called_ae_title: request.called_ae_title.clone(),
            application_context_name: request.application_context_name.clone(),
            presentation_contexts: vec![PresentationContextResult {
                id: proposed.id,
                reason: match syntax {
                    "" => PresentationContextResultReason::AbstractSyntaxNotSupported,
                    _ => PresentationContextResultReason::Acceptance,
                },
                transfer_syntax: syntax.to_owned(),
            }],
            user_variables: vec![UserVariableItem::MaxLength(MAX_LENGTH)],
        }
    }

    /// Plays the node; returns the data set that came.
    async fn play(stream: DuplexStream, node: Node) -> Vec<u8> {
        let mut wire = Wire::new(stream, Duration::from_secs(10));
        let Ok(Pdu::AssociationRQ(request)) = wire.receive().await else {
            panic!("it begins otherwise");
        };
        assert_eq!(request.calling_ae_title, "ISOCORTEX");
        assert_eq!(request.called_ae_title, "ARCHIVE");
        let (syntax, answer) = match node {
            Node::Stores(syntax, status) => (syntax, Some(status)),
            Node::Leaves => (EXPLICIT, None),
            Node::Answers(pdu) => {
                wire.send(&pdu).await.unwrap();
                return Vec::new();
            }
            Node::Sends(bytes) => {
                use tokio::io::AsyncWriteExt as _;
                wire.stream.write_all(bytes).await.unwrap();
                return Vec::new();
            }
        };
        let answered = Pdu::AssociationAC(accepted(&request, syntax));
        wire.send(&answered).await.unwrap();
        let (mut command, mut data_set) = (Vec::new(), Vec::new());
        loop {
            let values = match wire.receive().await.unwrap() {
                Pdu::PData { data } => data,
                Pdu::ReleaseRQ => {
                    wire.send(&Pdu::ReleaseRP).await.unwrap();
                    return data_set;
                }
                Pdu::AbortRQ { .. } => return data_set,
                other => panic!("{other:?}"),
            };
            for value in values {
                assert!(value.data.len() + 6 <= MAX_LENGTH as usize);
                let is_data = value.value_type == PDataValueType::Data;
                match is_data {
                    true => data_set.extend(value.data),
                    false => command.extend(value.data),
                }
                let Some(status) = answer else {
                    return data_set;
                };
                if is_data && value.is_last {
                    let response = Request::parse(&command).unwrap().response(&Ok(status));
                    let parts = fragments(&response, PDataValueType::Command, CONTEXT, 64);
                    for part in parts {
                        wire.send(&Pdu::PData { data: vec![part] }).await.unwrap();
                    }
                }
            }
        }
    }

    async fn sent_to(node: Node) -> (Result<(), NodeError>, Vec<u8>) {
        let (here, there) = tokio::io::duplex(1000);
        let playing = tokio::spawn(play(there, node));
        let object = Object::read(file()).unwrap();
        let sent = ours()
            .do_over(here, Operation::Store(Box::new(object)))
            .await;
        (sent, playing.await.unwrap())
    }

    #[tokio::test]
    async fn an_object_arrives_as_it_is_in_both_syntaxes() {
        const PIXEL_DATA: dicom_object::Tag = dicom_object::Tag(0x7FE0, 0x0010);
        let file = file();
        let object = Object::read(file.clone()).unwrap();
        for cut in [0, 100, 200, file.len() - object.data_set.len() - 1] {
            assert!(Object::read(file.slice(..cut)).is_none(), "{cut}");
        }
        let (sent, received) = sent_to(Node::Stores(EXPLICIT, Status::Success)).await;
        assert_eq!(sent, Ok(()));
        assert!(received == object.data_set);
        let (sent, received) = sent_to(Node::Stores(IMPLICIT, Status::Success)).await;
        assert_eq!(sent, Ok(()));
        assert!(received != object.data_set);
        let head = crate::dimse::head::file_head(&object.name, IMPLICIT);
        let again = [&head[..], &received].concat();
        let values = |file: &[u8]| {
            let object = dicom_object::from_reader(file).unwrap();
            let values = object.iter().map(|element| (element.header().tag, element));
            let values = values.filter(|(tag, _)| *tag != PIXEL_DATA);
            let values =
                values.map(|(tag, element)| (tag, element.to_str().ok().map(Cow::into_owned)));
            values.collect::<Vec<_>>()
        };
        assert_eq!(values(&again), values(&file));
        // The pixels stand last, in words where the representation is implicit.
        assert_eq!(received[received.len() - 100..], file[file.len() - 100..]);
    }

    #[tokio::test]
    async fn a_refusal_is_told_with_its_reason() {
        for (status, expected) in [
            (Status::OutOfResources, 0xA700),
            (Status::ClassNotSupported, 0x0122),
            (Status::CannotUnderstand, 0xC000),
        ] {
            let (sent, _) = sent_to(Node::Stores(EXPLICIT, status)).await;
            assert_eq!(sent, Err(NodeError::Failed(expected)));
        }
        let (sent, _) = sent_to(Node::Stores("", Status::Success)).await;
        assert_eq!(sent, Err(NodeError::Class));
        let (sent, _) = sent_to(Node::Stores("1.2.840.10008.1.2.2", Status::Success)).await;
        assert_eq!(sent, Err(NodeError::Unreadable));
        let user = AssociationRJSource::ServiceUser;
        let congestion = AssociationRJServiceProviderPresentationReason::TemporaryCongestion;
        let congestion = AssociationRJSource::ServiceProviderPresentation(congestion);
        for (result, source, expected) in [
            (AssociationRJResult::Transient, congestion, NodeError::Busy),
            (
                AssociationRJResult::Permanent,
                user(AssociationRJServiceUserReason::CallingAETitleNotRecognized),
                NodeError::OurTitle,
            ),
            (
                AssociationRJResult::Permanent,
                user(AssociationRJServiceUserReason::CalledAETitleNotRecognized),
                NodeError::ItsTitle,
            ),
            (
                AssociationRJResult::Permanent,
                user(AssociationRJServiceUserReason::NoReasonGiven),
                NodeError::Rejected,
            ),
        ] {
            let rejection = Pdu::AssociationRJ(AssociationRJ { result, source });
            let (sent, _) = sent_to(Node::Answers(rejection)).await;
            assert_eq!(sent, Err(expected));
        }
    }

    #[tokio::test]
    async fn a_node_that_leaves_or_lies_has_stored_nothing() {
        let (sent, _) = sent_to(Node::Leaves).await;
        assert_eq!(sent, Err(NodeError::Lost));
        let source = AbortRQSource::ServiceUser;
        let (sent, _) = sent_to(Node::Answers(Pdu::AbortRQ { source })).await;
        assert_eq!(sent, Err(NodeError::Aborted));
        let (sent, _) = sent_to(Node::Answers(Pdu::ReleaseRP)).await;
        assert_eq!(sent, Err(NodeError::Unreadable));
        for lie in [
            &b"HTTP/1.1 400 Bad Request\r\n\r\n"[..],
            &[2, 0, 0xFF, 0xFF, 0xFF, 0xFF],
            &[2, 0, 0, 0, 0, 2, 0, 1],
        ] {
            let (sent, _) = sent_to(Node::Sends(lie)).await;
            assert_eq!(sent, Err(NodeError::Unreadable), "{lie:?}");
        }
        let (sent, _) = sent_to(Node::Sends(&[2, 0, 0])).await;
        assert_eq!(sent, Err(NodeError::Lost));
    }

    #[test]
    fn a_node_has_a_title_a_host_and_a_port() {
        for address in ["pacs.example:104", "192.0.2.7:11112", "[::1]:104"] {
            assert!(StorageNode::new(address, "A", "B").is_ok(), "{address}");
        }
        for address in [
            "",
            "pacs",
            ":104",
            "pacs:0",
            "pacs:x",
            "http://pacs:104",
            "a b:1",
        ] {
            let refused = StorageNode::new(address, "A", "B").err();
            assert_eq!(refused, Some(BadNode::StorageAddress), "{address}");
        }
        assert!(StorageNode::new("pacs:104", "CT 1", "B").is_ok());
        for (aet, our_aet) in [("", "B"), ("A", "B "), ("A", "SEVENTEEN-LETTERS")] {
            let refused = StorageNode::new("pacs:104", aet, our_aet).err();
            assert_eq!(refused, Some(BadNode::Aet));
        }
    }
}
