//! The report of a reading.

use ::report::{POLICY, ReportFormat, ReportQuery};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use cases::Cases;
use cases::report::ReportSubject;

use crate::routes::asked::{CasePath, Keys};
use access::audited::NamesPatient;
use http::conditional::{EntityTag, NO_STORE, REVALIDATE, Representation};
use http::negotiate::{Coding, media_type};
use http::problem::AppError;
use http::query::ApiQuery;

const HTML: &str = "text/html";
const PDF: &str = "application/pdf";

/// The report of a reading: one file, to read, to print and to keep
///
/// For each finding that is not dismissed: the cut and the other side, flipped; three slices and the one across the sulcus; values here and on the other side;
/// what the reader wrote. Then the places of the map, those that stand out first, an overview of six views at four depths, what is known of the acquisition,
/// and what is wrong with the mask, on every page. It is HTML, which needs no script and nothing from elsewhere, or with `Accept: application/pdf` a PDF on pages
/// that A4 and Letter hold. Its pictures are lossless. It names the patient only on request; no cache may
/// store it then.
#[utoipa::path(
    get, path = "/v1/cases/{id}/report", tag = "findings",
    params(("id" = String, Path, description = "The case"), ReportQuery),
    responses(
        (status = 200, description = "The report", content((String = "text/html"), (Vec<u8> = "application/pdf"))),
        (status = 406, description = "Neither HTML nor PDF is accepted"),
        (status = 409, description = "The case or its maps are not ready"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_report(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery {
        asked: Keys(asked), ..
    }: ApiQuery<Keys<ReportQuery>>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let is_pdf = media_type(&request, &[HTML, PDF])? == PDF;
    let mut headers = HeaderMap::new();
    let (format, media_type) = match is_pdf {
        true => (ReportFormat::Pdf, PDF),
        false => {
            let policy = HeaderValue::try_from(format!("{POLICY}; frame-ancestors 'none'"));
            headers.extend(policy.map(|policy| (header::CONTENT_SECURITY_POLICY, policy)));
            (ReportFormat::Html, "text/html; charset=utf-8")
        }
    };
    let cache_control = match asked.patient {
        true => NO_STORE,
        false => REVALIDATE,
    };
    let subject = ReportSubject::OfCase;
    let body = cases.report(&id, asked, format, subject).await?;
    let mut response = Representation {
        tag: EntityTag::of_bytes(&body, Coding::Identity),
        media_type,
        coding: Coding::Identity,
        body,
        headers,
        vary: "accept",
        cache_control,
    }
    .respond(&request)?;
    if asked.patient {
        response.extensions_mut().insert(NamesPatient);
    }
    Ok(response)
}
