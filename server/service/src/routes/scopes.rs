//! What a token must permit, for each route that is more than looking.

use axum::http::Method;
use http_support::scopes::{Row, Scope};

/// The routes of the service. Those that are only read are in no row, but for `POST`s that change nothing.
pub(crate) const SCOPES: &[Row] = &[
    (Method::POST, "/v1/cases", Scope::Write),
    (Method::PATCH, "/v1/cases/{id}", Scope::Write),
    (Method::DELETE, "/v1/cases/{id}", Scope::Write),
    (Method::POST, "/v1/cases/{id}/renders", Scope::Read),
    (Method::PUT, "/v1/cases/{id}/mask", Scope::Write),
    (Method::PUT, "/v1/cases/{id}/findings", Scope::Write),
    (Method::POST, "/v1/cases/{id}/layers", Scope::Write),
    (Method::PATCH, "/v1/cases/{id}/layers/{layer}", Scope::Write),
    (
        Method::DELETE,
        "/v1/cases/{id}/layers/{layer}",
        Scope::Write,
    ),
];
