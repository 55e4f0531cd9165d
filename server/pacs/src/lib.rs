//! The neighbour of a PACS: images come by DICOMweb (STOW-RS) or DIMSE (C-STORE), or are fetched from configured nodes
//! (QIDO-RS, WADO-RS), viewers of the PACS open cases by the UIDs of their studies, and results are sent back as DICOM
//! objects.
//!
//! Only the framing of messages is read in this process, by bounded parsers. Data sets are read by the limited child of
//! `cases`.

mod address;
mod arrivals;
mod background;
mod described;
pub mod dimse;
mod error;
mod fetch;
mod held;
mod hooks;
mod launch;
pub mod multipart;
pub mod node;
mod node_tests;
mod page;
mod parts;
mod query;
mod rendered;
mod results;
mod retrievals;
mod retrieve;
mod send;
mod state;
mod stow;
mod transfers;

use axum::Router;
use axum::http::Method;
use axum::routing::get;
use http_support::scopes::{Row, Scope};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub use self::background::Background;
pub use self::node_tests::test_in_words;
pub use self::state::{Options, Pacs};

/// What a token must permit, for each route that is more than looking.
pub const SCOPES: &[Row] = &[
    (Method::POST, "/dicomweb/studies", Scope::DicomStore),
    (Method::POST, "/dicomweb/studies/{study}", Scope::DicomStore),
    (Method::POST, "/hooks/orthanc", Scope::DicomStore),
    (Method::POST, "/v1/arrivals/{id}", Scope::Write),
    (Method::POST, "/v1/retrievals", Scope::Write),
    (Method::POST, "/v1/cases/{id}/dicom-results", Scope::Results),
    // The identifiers of a study are in its body, not in an address.
    (Method::POST, "/v1/launch", Scope::Read),
    (Method::POST, "/v1/pacs/nodes/{name}/test", Scope::Admin),
];

/// The routes that need a token, and their description.
pub fn guarded_routes(pacs: &Pacs) -> (Router, utoipa::openapi::OpenApi) {
    let (routes, description) = OpenApiRouter::new()
        .routes(routes!(stow::store_study))
        .routes(routes!(stow::store_in_study))
        .routes(routes!(query::studies))
        .routes(routes!(query::all_series))
        .routes(routes!(query::all_instances))
        .routes(routes!(query::series_of_study))
        .routes(routes!(query::instances_of_study))
        .routes(routes!(query::instances_of_series))
        .routes(routes!(retrieve::study))
        .routes(routes!(retrieve::series))
        .routes(routes!(retrieve::instance))
        .routes(routes!(retrieve::study_metadata))
        .routes(routes!(retrieve::series_metadata))
        .routes(routes!(retrieve::instance_metadata))
        .routes(routes!(retrieve::frames))
        .routes(routes!(arrivals::list_arrivals))
        .routes(routes!(arrivals::get_arrival, arrivals::take_arrival))
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
        .routes(routes!(rendered::picture_of_series))
        .routes(routes!(rendered::thumbnail_of_series))
        .routes(routes!(rendered::picture_of_instance))
        .routes(routes!(rendered::thumbnail_of_instance))
        .routes(routes!(rendered::picture_of_frame))
        .routes(routes!(launch::find_launched))
        .routes(routes!(page::get_pacs))
        .routes(routes!(node_tests::test_node))
        .split_for_parts();
    // The standard spells the word in two ways.
    let routes = routes
        .route(
            "/dicomweb/studies/{study}/rendered3d",
            get(rendered::of_study),
        )
        .route(
            "/dicomweb/studies/{study}/series/{series}/rendered3d",
            get(rendered::of_series),
        );
    (routes.with_state(pacs.clone()), description)
}
