//! Errors of a PACS as clients see them.

use case::Failure;

use crate::node::NodeError;

/// A failure that is kept with an arrival or a retrieval, as clients see it.
#[derive(Debug, Clone, serde::Serialize, utoipa::ToSchema)]
#[schema(as = Reason)]
pub(crate) struct ReasonView {
    /// A stable name, such as `series-not-t1`.
    name: String,
    /// One plain sentence.
    detail: String,
}

impl From<NodeError> for ReasonView {
    fn from(error: NodeError) -> Self {
        Self {
            name: error.kind().to_owned(),
            detail: error.to_string(),
        }
    }
}

impl From<Failure> for ReasonView {
    fn from(failure: Failure) -> Self {
        Self {
            name: failure.name,
            detail: failure.detail,
        }
    }
}
