//! Parses addresses: the id of the case in the path, and the keys of the query.

use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_path_to_error::Error;
use utoipa::IntoParams;
use utoipa::openapi::path::ParameterIn;

use crate::problem::AppError;
use crate::refusals::{Refusal, known_keys};
use crate::sent::from_query;
use case::CaseId;
use cases::pictures::{
    AcquiredQuery, CheckedAcquired, CheckedPicture, CheckedSlice, PictureRequest, SliceQuery,
};
use cases::report::ReportQuery;

/// The case in the path.
#[derive(Debug, Clone, Copy)]
pub struct CasePath(pub CaseId);

impl<S: Send + Sync> FromRequestParts<S> for CasePath {
    type Rejection = AppError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, AppError> {
        let params = RawPathParams::from_request_parts(parts, state).await;
        let params = params.map_err(|_| AppError::NotACaseId)?;
        let id = params.iter().find(|(name, _)| *name == "id");
        let id = id.and_then(|(_, text)| CaseId::parse(text));
        id.map(Self).ok_or(AppError::NotACaseId)
    }
}

/// The greatest number of entries on a page of a list.
pub const MAX_PAGE: usize = 200;

/// The number of entries on a page, if the client asks for none.
pub fn usual_page() -> usize {
    50
}

/// A parsed query whose values are not checked yet.
pub trait Asked: DeserializeOwned {
    /// The checked values.
    type Values;

    /// The values.
    ///
    /// # Errors
    /// [`AppError::Query`] that names the key.
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
/// [`AppError::Query`] that names the key.
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
            return AppError::UnknownKey {
                known: known_keys(known),
            };
        }
        Refusal::KeyTwice { key } => ("query-key-twice", key.into(), "is given twice".to_owned()),
        Refusal::MissingKey { key } => ("query-key-missing", key.into(), "is missing".to_owned()),
        _ if path == "depth_mm" => ("depth-not-a-number", path.into(), refusal.to_string()),
        _ => ("query-value-unreadable", path.into(), refusal.to_string()),
    };
    AppError::Query {
        kind,
        parameter,
        detail,
    }
}

/// The keys of a query, each with its description.
pub fn keys<T: IntoParams>() -> Vec<(String, String)> {
    let keys = T::into_params(|| Some(ParameterIn::Query)).into_iter();
    keys.map(|key| (key.name, key.description.unwrap_or_default()))
        .collect()
}

impl Asked for PictureRequest {
    type Values = CheckedPicture;

    fn checked(&self) -> Result<CheckedPicture, AppError> {
        Ok(PictureRequest::checked(self)?)
    }
}

impl Asked for SliceQuery {
    type Values = CheckedSlice;

    fn checked(&self) -> Result<CheckedSlice, AppError> {
        Ok(SliceQuery::checked(self)?)
    }
}

impl Asked for AcquiredQuery {
    type Values = CheckedAcquired;

    fn checked(&self) -> Result<CheckedAcquired, AppError> {
        Ok(AcquiredQuery::checked(self)?)
    }
}

impl Asked for ReportQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
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

#[cfg(test)]
mod tests {
    use cases::pictures::{DepthMm, Numbers};

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        #[serde(default)]
        depth_mm: f32,
        window: Option<Numbers<2>>,
        side: Option<Side>,
        count: Option<u32>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Side {
        Left,
        Right,
        Both,
    }

    impl Asked for Example {
        type Values = DepthMm;

        fn checked(&self) -> Result<DepthMm, AppError> {
            Ok(DepthMm::new(self.depth_mm)?)
        }
    }

    fn refusal(text: &str) -> (String, String) {
        let problem = parse::<Example>(text).unwrap_err().problem();
        let kind = problem.kind.rsplit(':').next().unwrap().to_owned();
        (kind, problem.parameter.unwrap_or_default())
    }

    #[test]
    fn values_are_read() {
        let read = |text| parse::<Example>(text).unwrap();
        let query = read("depth_mm=8.5&window=40,80");
        assert_eq!(query.values, DepthMm::new(8.5).unwrap());
        assert_eq!(query.asked.window, Some(Numbers([40.0, 80.0])));
        assert_eq!(read("").asked.depth_mm, 0.0);
        let query = read("side=both&count=3").asked;
        assert!(matches!(query.side, Some(Side::Both)));
        assert_eq!(query.count, Some(3));
    }

    #[test]
    fn values_that_cannot_be_read_are_refused_in_words() {
        let words = [
            ("depth_mm=abc", "`depth_mm` must be a number"),
            ("depth_mm=", "`depth_mm` must be a number"),
            (
                "window=1",
                "`window` cannot be read: 2 numbers with commas are required, not 1",
            ),
            ("side=up", "`side` must be one of `left`, `right`, `both`"),
            ("count=-1", "`count` must be a whole number, not negative"),
            ("count=", "`count` must be a whole number, not negative"),
        ];
        for (text, expected) in words {
            let error = parse::<Example>(text).unwrap_err();
            assert_eq!(error.to_string(), expected);
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let expected = [
            ("depth_mm=abc", "depth-not-a-number", "depth_mm"),
            ("depth_mm=NaN", "depth-not-a-number", "depth_mm"),
            ("depth_mm=inf", "depth-not-a-number", "depth_mm"),
            ("depth_mm=-1", "depth-negative", "depth_mm"),
            ("deep=1", "query-unknown-key", ""),
            ("depth_mm=1&depth_mm=2", "query-key-twice", "depth_mm"),
            ("window=1", "query-value-unreadable", "window"),
            ("window=1,nan", "query-value-unreadable", "window"),
        ];
        for (text, kind, parameter) in expected {
            assert_eq!(
                refusal(text),
                (kind.to_owned(), parameter.to_owned()),
                "{text}"
            );
        }
    }
}
