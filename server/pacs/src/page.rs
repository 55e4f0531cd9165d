//! What the page adds to a case from DICOM: the patient, and a dialog that sends results to a node.

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use crate::state::Pacs;
use http::fresh::fresh_json;

/// What this server has of a PACS.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = PacsView)]
pub(crate) struct PacsView {
    /// The names of the nodes to which results can be sent.
    nodes: Vec<String>,
    /// Whether the page shows the patient, the study and the series.
    patient_banner: bool,
}

/// The nodes of the PACS
#[utoipa::path(
    get, path = "/v1/pacs", tag = "pacs",
    responses((status = 200, description = "The nodes, and what the page shows", body = PacsView)),
)]
pub(crate) async fn get_pacs(State(pacs): State<Pacs>) -> Response {
    // Without an identity, neither results nor a banner can be made.
    let has_identity = pacs.needs_identity().is_ok();
    let nodes = pacs.options().nodes.iter().filter(|_| has_identity);
    let view = PacsView {
        nodes: nodes.map(|node| node.name().into()).collect(),
        patient_banner: has_identity && pacs.options().shows_patient,
    };
    fresh_json(StatusCode::OK, &view)
}
