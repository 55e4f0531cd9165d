//! PDUs over a connection (PS3.8 §9.3).

use std::io;
use std::time::Duration;

use bytes::Bytes;
use dicom_ul::pdu::{
    PDU_HEADER_SIZE, PDataValue, PDataValueType, Pdu, UserVariableItem, read_pdu, write_pdu,
};
use futures_util::FutureExt as _;
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};

/// The largest PDU that we accept, without its head.
pub(crate) const MAX_PDU_LENGTH: u32 = 128 << 10;

/// The bytes of a fragment before its data.
const FRAGMENT_HEAD: usize = 6;

/// Why a PDU was not received or sent. It contains nothing that a peer has sent.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WireError {
    #[error("the connection was lost")]
    Lost(#[from] io::Error),
    #[error("the peer was silent for too long")]
    Silent,
    #[error("a PDU of {0} bytes is longer than the limit of {MAX_PDU_LENGTH}")]
    TooLong(u32),
    #[error("a PDU cannot be read")]
    BadPdu,
}

/// A connection, encrypted or not.
pub(crate) trait Connection: AsyncRead + AsyncWrite + Unpin + Send {}

impl<S: AsyncRead + AsyncWrite + Unpin + Send> Connection for S {}

/// The largest PDU that the peer accepts; without a statement, or with 0, any.
pub(crate) fn peer_max_length(variables: &[UserVariableItem]) -> usize {
    let stated = variables.iter().find_map(|item| match item {
        UserVariableItem::MaxLength(length) => Some(*length as usize),
        _ => None,
    });
    match stated {
        None | Some(0) => MAX_PDU_LENGTH as usize,
        Some(length) => length.clamp(64, MAX_PDU_LENGTH as usize),
    }
}

/// A command or a data set as fragments.
pub(crate) fn fragments(
    message: &[u8],
    value_type: PDataValueType,
    context: u8,
    max_length: usize,
) -> impl Iterator<Item = PDataValue> {
    // The head of a fragment counts, and its length is even.
    let pieces = message.chunks((max_length - FRAGMENT_HEAD) & !1);
    let last = pieces.len().saturating_sub(1);
    pieces.enumerate().map(move |(number, piece)| PDataValue {
        presentation_context_id: context,
        value_type: value_type.clone(),
        is_last: number == last,
        data: piece.to_vec(),
    })
}

/// PDUs over a connection.
pub(crate) struct Wire<S> {
    pub(crate) stream: S,
    /// How long a PDU may take.
    idle: Duration,
}

impl<S: AsyncRead + AsyncWrite + Unpin> Wire<S> {
    pub(crate) fn new(stream: S, idle: Duration) -> Self {
        Self { stream, idle }
    }

    /// The next PDU, whole. Its length is checked before it is read.
    pub(crate) async fn receive(&mut self) -> Result<Pdu, WireError> {
        self.receive_within(self.idle).await
    }

    /// As [`Wire::receive`], with another limit of time.
    pub(crate) async fn receive_within(&mut self, patience: Duration) -> Result<Pdu, WireError> {
        let received = tokio::time::timeout(patience, self.receive_now()).await;
        received.map_err(|_elapsed| WireError::Silent)?
    }

    async fn receive_now(&mut self) -> Result<Pdu, WireError> {
        let mut bytes = vec![0; PDU_HEADER_SIZE as usize];
        self.stream.read_exact(&mut bytes).await?;
        let length = u32::from_be_bytes([bytes[2], bytes[3], bytes[4], bytes[5]]);
        if length > MAX_PDU_LENGTH {
            return Err(WireError::TooLong(length));
        }
        bytes.resize(bytes.len() + length as usize, 0);
        self.stream
            .read_exact(&mut bytes[PDU_HEADER_SIZE as usize..])
            .await?;
        parse(bytes)
    }

    pub(crate) async fn send(&mut self, pdu: &Pdu) -> Result<(), WireError> {
        let mut bytes = Vec::new();
        write_pdu(&mut bytes, pdu).map_err(|_| WireError::BadPdu)?;
        let sent = tokio::time::timeout(self.idle, async {
            self.stream.write_all(&bytes).await?;
            self.stream.flush().await
        });
        Ok(sent.await.map_err(|_elapsed| WireError::Silent)??)
    }
}

/// Whether bytes begin with a PDU that is accepted. They come from memory, so nothing is awaited.
pub(super) fn parse_whole(bytes: Vec<u8>) -> bool {
    let mut wire = Wire::new(io::Cursor::new(bytes), Duration::MAX);
    matches!(wire.receive_now().now_or_never(), Some(Ok(_)))
}

/// A whole PDU. The reader of `dicom-ul` takes some lengths inside of a PDU on trust and panics if they lie.
fn parse(bytes: Vec<u8>) -> Result<Pdu, WireError> {
    let read = std::panic::catch_unwind(move || read_pdu(Bytes::from(bytes), MAX_PDU_LENGTH, true));
    match read {
        Ok(Ok(Some(pdu))) => Ok(pdu),
        _ => Err(WireError::BadPdu),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use dicom_ul::pdu::{AbortRQSource, AssociationRQ, PresentationContextProposed};

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
