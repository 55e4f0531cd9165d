//! The report of a reading.

use ::report::{Language, POLICY, ReportFormat, ReportQuery};
use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use case::CaseId;
use cases::Cases;
use cases::report::{AskedReport, ReportSubject};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::readings::named;
use crate::routes::asked::CasePath;
use access::audited::NamesPatient;
use access::proxy::plain_name;
use access::tokens::Holder;
use http::conditional::{EntityTag, NO_STORE, REVALIDATE, Representation};
use http::negotiate::{Coding, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

const HTML: &str = "text/html";
const PDF: &str = "application/pdf";

/// The keys of a report.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct ReportKeys {
    /// The language: `en` or `pt-BR`.
    #[serde(default)]
    #[param(inline)]
    language: Language,
    /// Whether to name the patient and the study, if the case was created from DICOM. The report is patient data then.
    #[serde(default)]
    #[param(default = false)]
    patient: bool,
    /// The reader of the reading that it is of: the last version of one's own, or the last signed one of somebody else, as `…/readings/by/{reader}`
    /// shows it. The report has its conclusion above all, and who has signed it when. Without this key, the report is that of the findings of the case.
    reading: Option<String>,
}

impl ReportKeys {
    /// The report that they ask for.
    pub async fn report(
        &self,
        cases: &Cases,
        id: &CaseId,
        holder: &Holder,
        format: ReportFormat,
    ) -> Result<AskedReport<'static>, AppError> {
        let reading = match &self.reading {
            None => None,
            Some(reader) => {
                let asker = named(holder).ok();
                let reading = cases.reading(id, asker, reader, None).await?;
                Some((reading, plain_name(reader).to_owned()))
            }
        };
        Ok(AskedReport {
            query: ReportQuery {
                language: self.language,
                patient: self.patient,
            },
            format,
            subject: ReportSubject::OfCase,
            reading,
        })
    }
}

impl Asked for ReportKeys {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// The report of a reading: one file, to read, to print and to keep
///
/// For each finding that is not dismissed: the cut, three slices and the one across the sulcus, each beside the same of the other side, flipped; values here and on the other side;
/// what the reader wrote. Then the places of the map, those that stand out first, an overview of six views at four depths, what is known of the acquisition,
/// and what is wrong with the mask, on every page. It is HTML, which needs no script and nothing from elsewhere, or with `Accept: application/pdf` a PDF on pages
/// that A4 and Letter hold. Its pictures are lossless. It names the patient only on request; no cache may
/// store it then.
#[utoipa::path(
    get, path = "/v1/cases/{id}/report", tag = "findings",
    params(("id" = String, Path, description = "The case"), ReportKeys),
    responses(
        (status = 200, description = "The report", content((String = "text/html"), (Vec<u8> = "application/pdf"))),
        (status = 406, description = "Neither HTML nor PDF is accepted"),
        (status = 404, description = "There is no such case, or no such reading (`no-such-reading`)"),
        (status = 409, description = "The case or its maps are not ready, or the reading is of somebody else and whoever asks has not signed their own (`reading-hidden`)"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_report(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    ApiQuery { asked, .. }: ApiQuery<ReportKeys>,
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
    let report = asked.report(&cases, &id, &holder, format).await?;
    let body = cases.report(&id, report).await?;
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
