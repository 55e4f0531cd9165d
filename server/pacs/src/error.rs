//! Errors of a request. The binary passes in how they are written, so that they look as all others.

use axum::http::StatusCode;
use axum::response::Response;
use case::Failure;
use storage::StoreError;

use crate::multipart::MultipartError;
use crate::node::NodeError;

/// How errors become answers.
#[derive(Debug, Clone, Copy)]
pub struct Problems {
    /// An error of the application.
    pub of_cases: fn(cases::Error) -> Response,
    /// Another one.
    pub other: fn(Refusal) -> Response,
}

/// Why a request is refused.
#[derive(Debug, thiserror::Error)]
#[error("{detail}")]
pub struct Refusal {
    /// The status.
    pub status: StatusCode,
    /// The last part of its type.
    pub kind: &'static str,
    /// What is wrong, in one sentence.
    pub detail: String,
    /// The key of the query, or the place in the body, with the error.
    pub parameter: Option<String>,
}

/// An error of a request.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PacsError {
    #[error(transparent)]
    Cases(#[from] cases::Error),
    #[error(transparent)]
    Request(Refusal),
}

impl PacsError {
    pub(crate) fn new(status: StatusCode, kind: &'static str, detail: impl Into<String>) -> Self {
        Self::Request(Refusal {
            status,
            kind,
            detail: detail.into(),
            parameter: None,
        })
    }

    /// An invalid value of a key of the query; the rule says what it must be.
    pub(crate) fn wrong_value(key: &str, rule: &str) -> Self {
        Self::bad_request(
            "query-value-out-of-range",
            format!("`{key}` must be {rule}"),
        )
        .at(key)
    }

    /// An invalid value in the body, at a place such as `cine.frames`; the rule says what it must be.
    pub(crate) fn wrong_in_body(place: &str, rule: &str) -> Self {
        let detail = format!("`{place}` must be {rule}");
        Self::bad_request("body-value-out-of-range", detail).at(place)
    }

    /// The same with the key of the query, or the place in the body, with the error.
    pub(crate) fn at(self, place: &str) -> Self {
        match self {
            Self::Request(refusal) => Self::Request(Refusal {
                parameter: Some(place.to_owned()),
                ..refusal
            }),
            of_cases => of_cases,
        }
    }

    pub(crate) fn bad_request(kind: &'static str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, kind, detail)
    }

    pub(crate) fn not_found(kind: &'static str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, kind, detail)
    }

    pub(crate) fn answer(self, problems: Problems) -> Response {
        match self {
            Self::Cases(error) => (problems.of_cases)(error),
            Self::Request(refusal) => (problems.other)(refusal),
        }
    }
}

impl From<StoreError> for PacsError {
    fn from(error: StoreError) -> Self {
        cases::Error::from(error).into()
    }
}

impl From<MultipartError> for PacsError {
    fn from(error: MultipartError) -> Self {
        Self::bad_request("body-unreadable", error.to_string())
    }
}

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
