//! Parses the keys of queries.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_path_to_error::Error;
use utoipa::IntoParams;
use utoipa::openapi::path::ParameterIn;

use crate::problem::AppError;
use crate::refusals::{Refusal, known_keys};
use crate::sent::from_query;

/// The greatest number of entries on a page of a list.
pub const MAX_PAGE: usize = 200;

/// The number of entries on a page, if the client asks for none.
pub fn usual_page() -> usize {
    50
}

/// A parsed query whose values are not checked yet.
pub trait Asked: DeserializeOwned {
    type Values;

    /// The values.
    ///
    /// # Errors
    /// An error that names the key.
    fn checked(&self) -> Result<Self::Values, AppError>;
}

/// A checked query, with known keys and valid values.
#[derive(Debug, Clone)]
pub struct ApiQuery<T: Asked> {
    /// The query as requested, which identifies the answer.
    pub asked: T,
    pub values: T::Values,
}

impl<S: Send + Sync, T: Asked> FromRequestParts<S> for ApiQuery<T> {
    type Rejection = AppError;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, AppError> {
        parse(parts.uri.query().unwrap_or_default())
    }
}

/// Reads and checks a query.
///
/// # Errors
/// An error that names the key.
pub fn parse<T: Asked>(text: &str) -> Result<ApiQuery<T>, AppError> {
    let asked: T = from_query(text).map_err(unreadable)?;
    Ok(ApiQuery {
        values: asked.checked()?,
        asked,
    })
}

fn unreadable(error: Error<Refusal>) -> AppError {
    let path = error.path().to_string();
    let refusal = error.into_inner();
    let (kind, parameter, detail) = match refusal {
        Refusal::UnknownKey { known } => {
            // The key is not repeated, because it may be anything, such as the name of a patient.
            let detail = format!("the query has an unknown key; {}", known_keys(known));
            return AppError::bad_request("query-unknown-key", detail);
        }
        Refusal::KeyTwice { key } => ("query-key-twice", key, "is given twice".to_owned()),
        Refusal::MissingKey { key } => ("query-key-missing", key, "is missing".to_owned()),
        _ if path == "depth_mm" => ("depth-not-a-number", path.as_str(), refusal.to_string()),
        _ => ("query-value-unreadable", path.as_str(), refusal.to_string()),
    };
    AppError::invalid(kind, parameter, detail)
}

/// The keys of a query, each with its description.
pub fn keys<T: IntoParams>() -> Vec<(String, String)> {
    let keys = T::into_params(|| Some(ParameterIn::Query)).into_iter();
    keys.map(|key| (key.name, key.description.unwrap_or_default()))
        .collect()
}

/// The query of an address that accepts no keys.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoQuery {}

impl Asked for NoQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}
