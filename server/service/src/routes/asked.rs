//! What the routes of a case are asked: the id in the path, the keys of the query, and answers that never change.

use std::sync::Arc;

use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::HeaderMap;
use axum::http::request::Parts;
use axum::response::Response;
use case::{CaseFacts, CaseId};
use cases::Cases;
use cases::pictures::{
    AcquiredQuery, CheckedAcquired, CheckedPicture, CheckedSlice, PictureRequest, SliceQuery,
};
use http::conditional::{Content, EntityTag, Format};
use http::problem::AppError;
use http::query::Asked;
use serde::{Deserialize, Serialize};

/// The case in the path.
#[derive(Debug, Clone, Copy)]
pub struct CasePath(pub CaseId);

impl<S: Send + Sync> FromRequestParts<S> for CasePath {
    type Rejection = AppError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, AppError> {
        let params = RawPathParams::from_request_parts(parts, state).await;
        let params = params.map_err(|_| not_a_case_id())?;
        let id = params.iter().find(|(name, _)| *name == "id");
        let id = id.and_then(|(_, text)| CaseId::parse(text));
        id.map(Self).ok_or_else(not_a_case_id)
    }
}

/// The path contains no case id.
pub fn not_a_case_id() -> AppError {
    AppError::not_found(
        "not-a-case-id",
        "the id of a case has 32 lower-case hexadecimal digits",
    )
}

/// A question about a case whose answer never changes.
#[derive(Debug)]
pub struct Question<'a, Q> {
    pub id: CaseId,
    /// The rest of the route.
    pub route: &'static str,
    pub query: &'a Q,
    /// The headers of the request.
    pub request: &'a HeaderMap,
}

impl<'a, Q: Serialize> Question<'a, Q> {
    pub fn new(id: CaseId, route: &'static str, query: &'a Q, request: &'a HeaderMap) -> Self {
        Self {
            id,
            route,
            query,
            request,
        }
    }

    /// Answers a question about a ready case: with 304 and without any work if the client has the answer, otherwise
    /// with the result of `work`.
    ///
    /// # Errors
    /// As [`Cases::ready`] and [`Format::respond`], and those of `work`.
    pub async fn answer(
        self,
        cases: &Cases,
        format: Format,
        work: impl AsyncFnOnce(Arc<CaseFacts>) -> Result<Content, AppError>,
    ) -> Result<Response, AppError> {
        let facts = cases.ready(&self.id).await?;
        self.respond(format, async || work(facts).await).await
    }

    /// The same about a case in any state, on which the answer does not depend.
    ///
    /// # Errors
    /// As [`Cases::case`] and [`Format::respond`], and those of `work`.
    pub async fn answer_of_any(
        self,
        cases: &Cases,
        format: Format,
        work: impl AsyncFnOnce() -> Result<Content, AppError>,
    ) -> Result<Response, AppError> {
        cases.case(&self.id).await?;
        self.respond(format, work).await
    }

    async fn respond(
        self,
        format: Format,
        work: impl AsyncFnOnce() -> Result<Content, AppError>,
    ) -> Result<Response, AppError> {
        let id = self.id.to_string();
        let tag_of =
            |negotiated: (&str, _)| EntityTag::of_answer(&id, self.route, self.query, negotiated);
        format.respond(self.request, tag_of, work).await
    }
}

/// The keys of a picture, a slice or an acquired image.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Keys<T>(pub T);

impl Asked for Keys<PictureRequest> {
    type Values = CheckedPicture;

    fn checked(&self) -> Result<CheckedPicture, AppError> {
        Ok(self.0.checked()?)
    }
}

impl Asked for Keys<SliceQuery> {
    type Values = CheckedSlice;

    fn checked(&self) -> Result<CheckedSlice, AppError> {
        Ok(self.0.checked()?)
    }
}

impl Asked for Keys<AcquiredQuery> {
    type Values = CheckedAcquired;

    fn checked(&self) -> Result<CheckedAcquired, AppError> {
        Ok(self.0.checked()?)
    }
}

#[cfg(test)]
mod tests {
    use cases::pictures::{DepthMm, Numbers};
    use http::query::parse;

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
