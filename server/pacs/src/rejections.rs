//! What rejection notes have rejected, and how that is lifted.

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Serialize;
use storage::is_id;
use utoipa::ToSchema;

use crate::state::Pacs;
use crate::values::Rejected;
use http::fresh::fresh_json;
use http::problem::AppError;

/// The most rejections of an answer.
const MOST: usize = 200;

/// The latest rejections.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct RejectionList {
    /// Newest first, 200 at most.
    rejections: Vec<Rejected>,
}

/// List what was rejected
///
/// What rejection notes have rejected and nobody has lifted since, newest first. Cases, layers and results that were made of these images
/// are closed. Its UIDs are patient data; no cache may store them.
#[utoipa::path(
    get, path = "/v1/rejections", tag = "pacs",
    responses((status = 200, description = "The latest rejections", body = RejectionList)),
)]
pub(crate) async fn list_rejections(State(pacs): State<Pacs>) -> Result<Response, AppError> {
    let list = RejectionList {
        rejections: pacs.store().rejections(MOST).await?,
    };
    Ok(fresh_json(StatusCode::OK, &list))
}

/// Lift a rejection
///
/// The images count again: what was made of them is open, unless they were corrected since, and those that are kept are read again.
#[utoipa::path(
    delete, path = "/v1/rejections/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The rejection")),
    responses(
        (status = 204, description = "It is lifted"),
        (status = 404, description = "No such rejection"),
    )
)]
pub(crate) async fn lift_rejection(
    State(pacs): State<Pacs>,
    Path(id): Path<String>,
) -> Result<StatusCode, AppError> {
    let lifted = match is_id(&id) {
        true => pacs.store().lift(&id).await?,
        false => false,
    };
    if !lifted {
        return Err(AppError::not_found(
            "no-such-rejection",
            "there is no rejection with this id; it may be lifted already",
        ));
    }
    tracing::info!(rejection = id, "a rejection was lifted");
    Ok(StatusCode::NO_CONTENT)
}
