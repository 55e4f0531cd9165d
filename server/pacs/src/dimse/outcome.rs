//! What becomes of an object that is sent to a node.

use std::io;

use dicom_ul::pdu::{
    AssociationRJ, AssociationRJResult, AssociationRJServiceUserReason, AssociationRJSource,
};

use crate::dimse::wire::WireError;

const SUCCESS: u16 = 0x0000;

/// Out of resources (PS3.4 table B.2-1): `A7xx`.
const OUT_OF_RESOURCES: u16 = 0xA700;

const PROCESSING_FAILURE: u16 = 0x0110;

const DUPLICATE_INSTANCE: u16 = 0x0111;

/// Why a node has not stored an object. It contains nothing that the node has sent but its status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotStored {
    /// There is no connection.
    #[error("the node cannot be reached")]
    Unreachable,
    /// There is no TLS between us.
    #[error(
        "no connection by TLS: the node speaks another protocol, or its certificate or ours is not accepted"
    )]
    Tls,
    /// The connection ended too early.
    #[error("the connection to the node was lost")]
    Lost,
    /// It stalled.
    #[error("the node did not answer in time")]
    Silent,
    /// It may accept an association later.
    #[error("the node is busy")]
    Busy,
    /// It does not know us.
    #[error(
        "the node does not accept our application entity title; register the `aet` of `[pacs.dimse]` there"
    )]
    OurTitle,
    /// It has another title.
    #[error("the node has another application entity title; correct the `aet` of the node")]
    ItsTitle,
    /// It accepts no association of ours.
    #[error("the node rejected the association")]
    Rejected,
    /// It accepts no such object.
    #[error("the node does not accept objects of this class")]
    Class,
    /// It aborted the association.
    #[error("the node aborted the association")]
    Aborted,
    /// It does not follow the protocol.
    #[error("the answer of the node cannot be read")]
    Unreadable,
    /// It answered with a failure.
    #[error("the node did not store the object (status {0:04X})")]
    Status(u16),
    /// The file is damaged.
    #[error("the object cannot be read")]
    Object,
}

impl NotStored {
    /// Whether the node may store the same object later.
    pub fn may_pass(self) -> bool {
        match self {
            Self::Unreachable | Self::Lost | Self::Silent | Self::Busy | Self::Aborted => true,
            Self::Status(status) => {
                status & 0xFF00 == OUT_OF_RESOURCES || status == PROCESSING_FAILURE
            }
            Self::Tls
            | Self::OurTitle
            | Self::ItsTitle
            | Self::Rejected
            | Self::Class
            | Self::Unreadable
            | Self::Object => false,
        }
    }
}

impl From<WireError> for NotStored {
    fn from(error: WireError) -> Self {
        match error {
            // An alert of TLS may also come after the handshake, when the node has seen our certificate.
            WireError::Lost(error) if error.kind() == io::ErrorKind::InvalidData => Self::Tls,
            WireError::Lost(_) => Self::Lost,
            WireError::Silent => Self::Silent,
            WireError::TooLong(_) | WireError::BadPdu => Self::Unreadable,
        }
    }
}

/// Why a node has rejected an association (PS3.8 §9.3.4).
pub(crate) fn rejected(rejection: &AssociationRJ) -> NotStored {
    if rejection.result == AssociationRJResult::Transient {
        return NotStored::Busy;
    }
    match &rejection.source {
        AssociationRJSource::ServiceUser(
            AssociationRJServiceUserReason::CallingAETitleNotRecognized,
        ) => NotStored::OurTitle,
        AssociationRJSource::ServiceUser(
            AssociationRJServiceUserReason::CalledAETitleNotRecognized,
        ) => NotStored::ItsTitle,
        _ => NotStored::Rejected,
    }
}

/// Whether a status (PS3.4 table B.2-1, PS3.7 C) means that the node has the object.
pub(crate) fn is_stored(status: u16) -> Result<(), NotStored> {
    match status {
        // The instance is named after its contents, so one of this name is the same.
        SUCCESS | DUPLICATE_INSTANCE => Ok(()),
        0xB000..=0xBFFF => {
            let status = format!("{status:04X}");
            tracing::info!(status, "a node has stored a result with a warning");
            Ok(())
        }
        status => Err(NotStored::Status(status)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_means_stored_later_or_never() {
        for stored in [0x0000, 0xB000, 0xB006, 0xB007, 0x0111] {
            assert_eq!(is_stored(stored), Ok(()), "{stored:04X}");
        }
        for (status, may_pass) in [
            (0xA700, true),
            (0xA7FF, true),
            (0x0110, true),
            (0xA900, false),
            (0xC000, false),
            (0x0122, false),
            (0x0124, false),
            (0x0001, false),
        ] {
            let answer = is_stored(status);
            assert_eq!(answer, Err(NotStored::Status(status)));
            assert_eq!(
                answer.map_err(NotStored::may_pass),
                Err(may_pass),
                "{status:04X}"
            );
        }
    }
}
