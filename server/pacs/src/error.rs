//! Errors of a request. The binary passes in how they are written, so that they look as all others.

use axum::http::StatusCode;
use axum::response::Response;
use case::Failure;
use storage::StoreError;

use crate::multipart::MultipartError;

/// How errors become answers.
#[derive(Debug, Clone, Copy)]
pub struct Problems {
    /// An error of the application.
    pub of_cases: fn(cases::Error) -> Response,
    /// Another one: its status, the last part of its type, and a sentence.
    pub other: fn(StatusCode, &'static str, String) -> Response,
}

/// An error of a request.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PacsError {
    #[error(transparent)]
    Cases(#[from] cases::Error),
    #[error("{detail}")]
    Request {
        status: StatusCode,
        kind: &'static str,
        detail: String,
    },
}

impl PacsError {
    pub(crate) fn new(status: StatusCode, kind: &'static str, detail: impl Into<String>) -> Self {
        Self::Request {
            status,
            kind,
            detail: detail.into(),
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
            Self::Request {
                status,
                kind,
                detail,
            } => (problems.other)(status, kind, detail),
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

impl From<Failure> for ReasonView {
    fn from(failure: Failure) -> Self {
        Self {
            name: failure.name,
            detail: failure.detail,
        }
    }
}
