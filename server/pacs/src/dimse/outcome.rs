//! What becomes of an object that is sent to a node.

use std::io;

use dicom_ul::pdu::{
    AssociationRJ, AssociationRJResult, AssociationRJServiceUserReason, AssociationRJSource,
};

use crate::dimse::wire::WireError;
use crate::node::error::NodeError;

const SUCCESS: u16 = 0x0000;

const DUPLICATE_INSTANCE: u16 = 0x0111;

impl From<WireError> for NodeError {
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
pub(crate) fn rejected(rejection: &AssociationRJ) -> NodeError {
    if rejection.result == AssociationRJResult::Transient {
        return NodeError::Busy;
    }
    match &rejection.source {
        AssociationRJSource::ServiceUser(
            AssociationRJServiceUserReason::CallingAETitleNotRecognized,
        ) => NodeError::OurTitle,
        AssociationRJSource::ServiceUser(
            AssociationRJServiceUserReason::CalledAETitleNotRecognized,
        ) => NodeError::ItsTitle,
        _ => NodeError::Rejected,
    }
}

/// Whether a status (PS3.4 table B.2-1, PS3.7 C) means that the node has the object.
pub(crate) fn is_stored(status: u16) -> Result<(), NodeError> {
    match status {
        // The instance is named after its contents, so one of this name is the same.
        SUCCESS | DUPLICATE_INSTANCE => Ok(()),
        0xB000..=0xBFFF => {
            let status = format!("{status:04X}");
            tracing::info!(status, "a node has stored a result with a warning");
            Ok(())
        }
        status => Err(NodeError::Failed(status)),
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
            assert_eq!(answer, Err(NodeError::Failed(status)));
            assert_eq!(
                answer.map_err(NodeError::may_pass),
                Err(may_pass),
                "{status:04X}"
            );
        }
    }
}
