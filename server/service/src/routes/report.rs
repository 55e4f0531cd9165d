//! The report of a reading.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use cases::Cases;
use cases::report::{POLICY, ReportQuery};

use http_support::conditional::{EntityTag, REVALIDATE, Representation};
use http_support::negotiate::{Coding, media_type};
use http_support::problem::AppError;
use http_support::query::{ApiQuery, CasePath};

const HTML: &str = "text/html; charset=utf-8";

/// The report of a reading: one HTML file, to read, to print and to keep
///
/// For each finding that is not dismissed: the cut and the other side, flipped; three slices and the one across the sulcus; values here and on the other side;
/// what the reader wrote. Then the places of the map, an overview of six views at four depths, what is known of the acquisition,
/// and what is wrong with the mask, on every page. The file needs no script and nothing from elsewhere, and its pictures are
/// lossless. It names the patient only on request.
#[utoipa::path(
    get, path = "/v1/cases/{id}/report", tag = "findings",
    params(("id" = String, Path, description = "The case"), ReportQuery),
    responses(
        (status = 200, description = "The report", body = String, content_type = "text/html"),
        (status = 409, description = "The case or its maps are not ready"),
        (status = 503, description = "Too much work is waiting"),
    )
)]
pub async fn get_report(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked, .. }: ApiQuery<ReportQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &["text/html"])?;
    let body = Bytes::from(cases.report(&id, asked).await?);
    let mut headers = HeaderMap::new();
    headers.insert(
        header::CONTENT_SECURITY_POLICY,
        HeaderValue::from_static(POLICY),
    );
    Representation {
        tag: EntityTag::of_bytes(&body, Coding::Identity),
        media_type: HTML,
        coding: Coding::Identity,
        body,
        headers,
        vary: "accept",
        cache_control: REVALIDATE,
    }
    .respond(&request)
}
