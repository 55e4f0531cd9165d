//! Whether a node answers, for the first hour of every connection to a PACS.

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Serialize;
use utoipa::ToSchema;

use crate::error::ReasonView;
use crate::node::{Node, NodeError};
use crate::state::Pacs;
use http::fresh::fresh_json;
use http::problem::AppError;

/// What the services of a node answered.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct NodeTest {
    /// The name of the node.
    node: String,
    /// Whether all of them answered as they must.
    is_reachable: bool,
    /// Each service of the configuration.
    services: Vec<ServiceTest>,
}

/// What a service of a node answered.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct ServiceTest {
    /// `dicomweb` (a search for one study) or `c-store` (C-ECHO).
    service: &'static str,
    /// Whether it answered as it must.
    is_reachable: bool,
    /// The reason, if it did not.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
}

/// Test a node
///
/// Asks the DICOMweb server of a node for one study, and its storage SCP for an echo (C-ECHO). Nothing is stored.
#[utoipa::path(
    post, path = "/v1/pacs/nodes/{name}/test", tag = "pacs",
    params(("name" = String, Path, description = "The name of the node in the configuration")),
    responses(
        (status = 200, description = "What its services answered", body = NodeTest),
        (status = 404, description = "No node has this name"),
    )
)]
pub(crate) async fn test_node(
    State(pacs): State<Pacs>,
    Path(name): Path<String>,
) -> Result<Response, AppError> {
    let node = pacs.named_node(&name)?;
    let services = node.test().await;
    let has_answered = |(_, answer): &(_, Result<(), NodeError>)| match answer {
        Ok(()) => true,
        Err(error) => error.is_answer(),
    };
    pacs.note(node.name(), services.iter().all(has_answered));
    let services: Vec<_> = services.into_iter().map(Into::into).collect();
    let test = NodeTest {
        node: node.name().to_owned(),
        is_reachable: services.iter().all(|test: &ServiceTest| test.is_reachable),
        services,
    };
    Ok(fresh_json(StatusCode::OK, &test))
}

impl From<(&'static str, Result<(), NodeError>)> for ServiceTest {
    fn from((service, answer): (&'static str, Result<(), NodeError>)) -> Self {
        Self {
            service,
            is_reachable: answer.is_ok(),
            reason: answer.err().map(ReasonView::from),
        }
    }
}

/// A line for each service of a node, and whether all answered as they must.
pub async fn test_in_words(node: &Node) -> (Vec<String>, bool) {
    let tests = node.test().await;
    let is_reachable = tests.iter().all(|(_, answer)| answer.is_ok());
    let line = |(service, answer): (&str, Result<(), NodeError>)| match answer {
        Ok(()) => format!("{}: {service}: it answers", node.name()),
        Err(error) => format!("{}: {service}: {error}", node.name()),
    };
    (tests.into_iter().map(line).collect(), is_reachable)
}
