//! Why somebody has no access.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use http::problem::AppError;

use crate::scopes::Scope;
use crate::tokens::Holder;

/// Why a request is refused before it reaches its route.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// The bearer token is missing or wrong.
    #[error("authentication required: send `Authorization: Bearer …`")]
    Unauthorized,
    /// The token was right and has ended.
    #[error("your token has ended; ask the administrator of this server for a new one")]
    TokenEnded,
    /// The headers of a proxy that signs people in are not accepted.
    #[error("the proxy in front of this server {why}; tell the administrator of this server")]
    ProxyRefused { why: &'static str },
    /// The token does not permit this.
    #[error("the token `{}` may not do this: it lacks the scope `{scope}`", .holder.name)]
    MissingScope {
        holder: Holder,
        /// What the route needs.
        scope: Scope,
    },
    /// The audit record cannot be written.
    #[error(
        "the audit record of this server cannot be written, so it answers nothing that the record must name; tell its administrator"
    )]
    AuditFull,
    /// A page of another site requests a change.
    #[error("requests from pages of other sites are rejected")]
    CrossSite,
    /// The Host header names another machine.
    #[error("this server accepts only localhost, 127.0.0.1 and [::1] as its host name")]
    WrongHost,
}

impl AccessError {
    /// The status and the last part of the problem's type.
    fn status_and_kind(&self) -> (StatusCode, &'static str) {
        match self {
            Self::Unauthorized => (StatusCode::UNAUTHORIZED, "unauthorized"),
            Self::ProxyRefused { .. } => (StatusCode::UNAUTHORIZED, "proxy-refused"),
            Self::TokenEnded => (StatusCode::UNAUTHORIZED, "token-ended"),
            Self::MissingScope { .. } => (StatusCode::FORBIDDEN, "missing-scope"),
            Self::AuditFull => (StatusCode::INSUFFICIENT_STORAGE, "audit-full"),
            Self::CrossSite => (StatusCode::FORBIDDEN, "cross-site"),
            Self::WrongHost => (StatusCode::MISDIRECTED_REQUEST, "wrong-host"),
        }
    }

    /// What the client should send, for `WWW-Authenticate`.
    fn challenge(&self) -> Option<HeaderValue> {
        match self {
            Self::Unauthorized | Self::ProxyRefused { .. } => {
                Some(HeaderValue::from_static("Bearer realm=\"isocortex\""))
            }
            Self::TokenEnded => Some(HeaderValue::from_static(
                "Bearer realm=\"isocortex\", error=\"invalid_token\", error_description=\"the token has ended\"",
            )),
            Self::MissingScope { scope, .. } => {
                let challenge = format!(
                    "Bearer realm=\"isocortex\", error=\"insufficient_scope\", scope=\"{scope}\""
                );
                HeaderValue::from_str(&challenge).ok()
            }
            Self::AuditFull | Self::CrossSite | Self::WrongHost => None,
        }
    }
}

impl From<AccessError> for AppError {
    fn from(error: AccessError) -> Self {
        let (status, kind) = error.status_and_kind();
        let problem = Self::new(status, kind, error.to_string());
        match error.challenge() {
            Some(challenge) => problem.with_header(header::WWW_AUTHENTICATE, challenge),
            None => problem,
        }
    }
}

impl IntoResponse for AccessError {
    fn into_response(self) -> Response {
        AppError::from(self).into_response()
    }
}
