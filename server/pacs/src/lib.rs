//! The PACS interface: images come by DICOMweb (STOW-RS) or DIMSE (C-STORE), or are fetched from configured nodes
//! (QIDO-RS, WADO-RS), viewers of the PACS open cases by the UIDs of their studies, and results are sent back as DICOM
//! objects. It is no archive: what came is not found or retrieved here.
//!
//! Only the framing of messages is read in this process, by bounded parsers. Data sets are read by the limited child of
//! `cases`.

mod address;
mod arrivals;
mod background;
pub mod dimse;
mod error;
mod fetch;
mod hooks;
mod launch;
pub mod multipart;
pub mod node;
mod node_tests;
mod page;
mod parts;
mod rejections;
mod rendered;
mod results;
mod retrievals;
mod send;
mod state;
mod stow;
mod transfers;

use access::audited::Audited;
use access::routes::Row;
use access::scopes::Scope;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::Method;
use axum::routing::get;
use http::sent::MAX_BODY_BYTES;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use self::background::start_transfers;
pub use self::node_tests::test_in_words;
pub use self::state::{Options, Pacs};

const fn read(path: &'static str, audited: Audited) -> Row {
    (Method::GET, path, Scope::Read, audited)
}

const fn post(path: &'static str, scope: Scope, audited: Audited) -> Row {
    (Method::POST, path, scope, audited)
}

/// What a token must permit, and what is recorded, for each route.
pub const SCOPES: &[Row] = &[
    post("/dicomweb/studies", Scope::DicomStore, Audited::Store),
    post(
        "/dicomweb/studies/{study}",
        Scope::DicomStore,
        Audited::Store,
    ),
    read("/dicomweb/studies/{study}/rendered3D", Audited::View),
    read("/dicomweb/studies/{study}/rendered3d", Audited::View),
    read(
        "/dicomweb/studies/{study}/series/{series}/rendered3D",
        Audited::View,
    ),
    read(
        "/dicomweb/studies/{study}/series/{series}/rendered3d",
        Audited::View,
    ),
    // A notice of a PACS, which fetches a series.
    post("/hooks/orthanc", Scope::DicomStore, Audited::Fetch),
    read("/v1/arrivals", Audited::Query),
    read("/v1/arrivals/{id}", Audited::Query),
    post("/v1/arrivals/{id}", Scope::Write, Audited::Upload),
    read("/v1/rejections", Audited::Query),
    (
        Method::DELETE,
        "/v1/rejections/{id}",
        Scope::Admin,
        Audited::Operation,
    ),
    read("/v1/retrievals", Audited::Query),
    post("/v1/retrievals", Scope::Write, Audited::Fetch),
    read("/v1/retrievals/{id}", Audited::Query),
    post(
        "/v1/cases/{id}/dicom-results",
        Scope::Results,
        Audited::Result,
    ),
    read("/v1/dicom-results", Audited::Query),
    read("/v1/dicom-results/{id}", Audited::Query),
    // The identifiers of a study are in its body, not in an address.
    post("/v1/launch", Scope::Read, Audited::Identity),
    read("/v1/pacs", Audited::No),
    post(
        "/v1/pacs/nodes/{name}/test",
        Scope::Admin,
        Audited::Operation,
    ),
];

/// The routes that need a token.
pub struct Guarded {
    /// Those that take images, which have the time of an upload.
    pub uploads: Router,
    /// The others, which have the time of an answer.
    pub answers: Router,
    pub description: utoipa::openapi::OpenApi,
}

/// The routes that need a token, and their description.
pub fn guarded_routes(pacs: &Pacs) -> Guarded {
    let (uploads, description) = OpenApiRouter::new()
        .routes(routes!(stow::store_study))
        .routes(routes!(stow::store_in_study))
        .split_for_parts();
    let (answers, others) = OpenApiRouter::new()
        .routes(routes!(arrivals::list_arrivals))
        .routes(routes!(arrivals::get_arrival, arrivals::take_arrival))
        .routes(routes!(rejections::list_rejections))
        .routes(routes!(rejections::lift_rejection))
        .routes(routes!(
            retrievals::create_retrieval,
            transfers::list_retrievals
        ))
        .routes(routes!(retrievals::get_retrieval))
        .routes(routes!(results::create_result))
        .routes(routes!(transfers::list_results))
        .routes(routes!(results::get_result))
        .routes(routes!(hooks::stable_series))
        .routes(routes!(rendered::of_study))
        .routes(routes!(rendered::of_series))
        .routes(routes!(launch::find_launched))
        .routes(routes!(page::get_pacs))
        .routes(routes!(node_tests::test_node))
        .split_for_parts();
    // The standard spells the word in two ways.
    let answers = answers
        .route(
            "/dicomweb/studies/{study}/rendered3d",
            get(rendered::of_study),
        )
        .route(
            "/dicomweb/studies/{study}/series/{series}/rendered3d",
            get(rendered::of_series),
        );
    let [uploads, answers] = [uploads, answers].map(|routes| {
        let routes = routes.layer(DefaultBodyLimit::max(MAX_BODY_BYTES));
        routes.with_state(pacs.clone())
    });
    Guarded {
        uploads,
        answers,
        description: description.merge_from(others),
    }
}
