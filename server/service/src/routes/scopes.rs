//! What a token must permit, and what is recorded, for each route.

use access::audited::Audited;
use access::scopes::{Row, Scope};
use axum::http::Method;

const fn read(path: &'static str, audited: Audited) -> Row {
    (Method::GET, path, Scope::Read, audited)
}

const fn write(method: Method, path: &'static str, audited: Audited) -> Row {
    (method, path, Scope::Write, audited)
}

/// The routes of the service, but for the page, `/healthz`, `/readyz` and `/sign-in`, which need no token.
pub const SCOPES: &[Row] = &[
    read("/v1/session", Audited::No),
    read("/v1/cases", Audited::Query),
    write(Method::POST, "/v1/cases", Audited::Upload),
    // What identifies a patient is in its body, not in an address. It shows patients.
    (
        Method::POST,
        "/v1/cases/search",
        Scope::Read,
        Audited::Identity,
    ),
    read("/v1/cases/{id}", Audited::View),
    write(Method::PATCH, "/v1/cases/{id}", Audited::Change),
    write(Method::DELETE, "/v1/cases/{id}", Audited::Delete),
    read("/v1/cases/{id}/events", Audited::View),
    read("/v1/cases/{id}/dicom", Audited::Identity),
    read("/v1/cases/{id}/mesh", Audited::View),
    read("/v1/cases/{id}/mesh/triangles", Audited::View),
    read("/v1/cases/{id}/mesh/paths", Audited::View),
    read("/v1/cases/{id}/volume", Audited::View),
    read("/v1/cases/{id}/distance", Audited::View),
    read("/v1/cases/{id}/render", Audited::View),
    read("/v1/cases/{id}/slices/{plane}", Audited::View),
    read("/v1/cases/{id}/acquired/{plane}", Audited::View),
    // It draws what its body lists, and changes nothing.
    (
        Method::POST,
        "/v1/cases/{id}/renders",
        Scope::Read,
        Audited::Export,
    ),
    read("/v1/cases/{id}/mask", Audited::Export),
    write(Method::PUT, "/v1/cases/{id}/mask", Audited::Upload),
    read("/v1/cases/{id}/envelope", Audited::Export),
    read("/v1/cases/{id}/quality", Audited::View),
    read("/v1/cases/{id}/candidates", Audited::View),
    read("/v1/cases/{id}/profile", Audited::View),
    read("/v1/cases/{id}/registration", Audited::View),
    read("/v1/cases/{id}/report", Audited::Export),
    read("/v1/cases/{id}/findings", Audited::View),
    write(Method::PUT, "/v1/cases/{id}/findings", Audited::Change),
    read("/v1/cases/{id}/layers", Audited::View),
    write(Method::POST, "/v1/cases/{id}/layers", Audited::Upload),
    read("/v1/cases/{id}/layers/{layer}", Audited::View),
    write(
        Method::PATCH,
        "/v1/cases/{id}/layers/{layer}",
        Audited::Change,
    ),
    write(
        Method::DELETE,
        "/v1/cases/{id}/layers/{layer}",
        Audited::Delete,
    ),
    read("/v1/cases/{id}/layers/{layer}/events", Audited::View),
    read("/v1/cases/{id}/layers/{layer}/volume", Audited::View),
    read("/v1/cases/{id}/layers/{layer}/nifti", Audited::Export),
    // These need a token only if `http.guard_operation` is set.
    (Method::GET, "/metrics", Scope::Metrics, Audited::No),
    read("/version", Audited::No),
    read("/openapi.json", Audited::No),
    read("/docs", Audited::No),
    read("/docs.css", Audited::No),
];
