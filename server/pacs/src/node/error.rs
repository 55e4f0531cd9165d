//! What may be wrong with a node.

/// Out of resources (PS3.4 table B.2-1): `A7xx`.
const OUT_OF_RESOURCES: u16 = 0xA700;

const PROCESSING_FAILURE: u16 = 0x0110;

/// Why a node of the configuration cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadNode {
    #[error("the name of a node must be 1 to 32 letters, digits, hyphens or underscores")]
    Name,
    #[error(
        "`url` must be http:// or https://, a host and a path, without a name, a password or a query"
    )]
    Address,
    #[error("the credentials of a node have characters that no header can have")]
    Credentials,
    /// The roots of TLS.
    #[error("the system has no trusted roots for TLS")]
    Roots,
    /// It can be used for nothing.
    #[error("a node needs `url` (DICOMweb), or `aet` and `address` (C-STORE), or all three")]
    NoService,
    /// Its title for C-STORE, or ours.
    #[error(
        "an application entity title must be 1 to 16 printable characters without backslashes, and without spaces at its ends"
    )]
    Aet,
    /// Its address for C-STORE.
    #[error("`address` must be a host and a port, such as `pacs.example:104`")]
    StorageAddress,
}

/// Why a request to a node failed. It contains nothing that the node has sent but its status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NodeError {
    #[error("the node cannot be reached")]
    Unreachable,
    #[error("the node did not answer in time")]
    Silent,
    #[error("the node refused our credentials")]
    Refused,
    #[error(
        "the node does not have this series, or its `url` is not the root of a DICOMweb server"
    )]
    NotFound,
    #[error(
        "the node has no DICOMweb at its `url`; name the root, which ends with /dicom-web for Orthanc"
    )]
    NoDicomWeb,
    #[error(
        "the node has no STOW-RS at its `url`; name the root of a DICOMweb server, which ends with /dicom-web for Orthanc"
    )]
    NoStow,
    #[error("the node answered with status {0}")]
    Status(u16),
    #[error("the answer of the node cannot be read")]
    Unreadable,
    #[error("the node did not store the object (failure reason {0:04X})")]
    NotStored(u16),
    #[error("the node did not store the object")]
    NotStoredAtAll,
    /// There is no TLS between us.
    #[error(
        "no connection by TLS: the node speaks another protocol, or its certificate or ours is not accepted"
    )]
    Tls,
    /// The connection ended too early.
    #[error("the connection to the node was lost")]
    Lost,
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
    /// It answered C-STORE with a failure.
    #[error("the node did not store the object (status {0:04X})")]
    Failed(u16),
    /// The file is damaged.
    #[error("the object cannot be read")]
    Object,
}

impl NodeError {
    /// Whether the same request may succeed later.
    pub(crate) fn may_pass(self) -> bool {
        match self {
            Self::Unreachable | Self::Silent | Self::Lost | Self::Busy | Self::Aborted => true,
            Self::Status(status) => status >= 500 || status == 429,
            // The reasons of STOW-RS are the statuses of C-STORE (PS3.18 table I.2-2).
            Self::NotStored(status) | Self::Failed(status) => {
                status & 0xFF00 == OUT_OF_RESOURCES || status == PROCESSING_FAILURE
            }
            _ => false,
        }
    }

    /// Whether the node answered, though not as it must.
    pub(crate) fn is_answer(self) -> bool {
        self.kind() != "node-unreachable"
    }

    pub(crate) fn kind(self) -> &'static str {
        match self {
            Self::Unreachable | Self::Silent | Self::Lost => "node-unreachable",
            Self::Refused | Self::Tls | Self::OurTitle | Self::ItsTitle | Self::Rejected => {
                "node-refused"
            }
            Self::NotFound => "node-has-no-such-series",
            Self::NoDicomWeb => "node-has-no-dicomweb",
            Self::NoStow => "node-has-no-stow",
            Self::Status(_) | Self::Unreadable | Self::Busy | Self::Aborted => "node-failed",
            Self::NotStored(_) | Self::NotStoredAtAll | Self::Class | Self::Failed(_) => {
                "node-did-not-store"
            }
            Self::Object => "result-lost",
        }
    }
}
