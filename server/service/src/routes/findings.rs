//! The findings of a case: what readers have marked and written.

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{RawPathParams, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use case::findings::{Certainty, Finding};
use case::{CaseId, Gyrus, MapName, PatientSide};
use cases::Cases;
use cases::findings::Findings;
use pipeline::finding_solid::solid_of;
use pipeline::findings::BRUSH_RADIUS_MM;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::candidates::{quoted, standard_fields};
use super::mesh::STL;
use super::versioned::{
    JSON, Versioned, answer, as_json, known_tags, precondition_required, represented,
};
use crate::routes::asked::{CasePath, not_a_case_id};
use crate::wire;
use http::conditional::{EntityTag, Representation};
use http::negotiate::{Coding, GZIP, media_type};
use http::problem::{AppError, Problem};
use http::query::{ApiQuery, NoQuery};
use http::sent::json_body_within;

pub(super) const CSV: &str = "text/csv";
const DICOM: &str = "application/dicom";

/// The longest list of findings, in bytes.
pub(super) const MAX_BYTES: usize = 4 << 20;

/// What readers have marked and written about a case.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FindingList {
    /// In the order in which they were sent; at most 1,000, with at most 20,000 points together.
    findings: Vec<Finding>,
}

/// The answer to a client that did not know the findings as they are: a problem, and the findings.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct FindingsChanged {
    #[serde(flatten)]
    problem: Problem,
    /// As they are stored.
    findings: Vec<Finding>,
}

/// What readers have marked and written
///
/// As JSON, or with `Accept: text/csv` as CSV with a row for each point, or with `Accept: application/gzip` as labels: a
/// gzipped NIfTI-1 file on the grid of the acquired volume, of what was neither dismissed nor unconfirmed, without the commissures (`acpc`). A label is the number
/// that page and report give its finding, from 1, and covers what a brush of 3 mm would; a comment in the file has the names. With `Accept: model/stl`, the same findings are
/// a binary STL in LPS mm: balls around points, and tubes along lines, outlines and trajectories, with a radius of 1.5 mm; more than 3,000 of them have six sides and pointed ends. Findings lie in the patient:
/// they are at the same place in every picture of the case. The `ETag` of the JSON is what a change must name.
#[utoipa::path(
    get, path = "/v1/cases/{id}/findings", tag = "findings",
    params(("id" = String, Path, description = "The case, in any state")),
    responses(
        (status = 200, description = "The findings; an empty list if there are none", content((FindingList = "application/json"), (String = "text/csv"), (Vec<u8> = "application/gzip"), (Vec<u8> = "model/stl")), headers(("ETag" = String, description = "For `If-Match` and `If-None-Match`"))),
        (status = 409, description = "The case is not ready, so labels have no grid, or an STL would be empty (`no-findings`)"),
    )
)]
pub async fn get_findings(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let kind = media_type(&request, &[JSON, CSV, GZIP, STL])?;
    let findings = cases.findings(&id).await?;
    match kind {
        CSV => {
            let body = Bytes::from(csv(&findings.list));
            let tag = EntityTag::of_bytes(&body, Coding::Identity);
            represented(tag, CSV, body).respond(&request)
        }
        GZIP => {
            let body = Bytes::from(cases.finding_labels(&id).await?);
            attachment(GZIP, body, "attachment; filename=\"findings.nii.gz\"").respond(&request)
        }
        STL => {
            let Findings { mut list, .. } = findings;
            list.retain(Finding::is_kept);
            if list.is_empty() {
                let detail = "the case has no findings, or only dismissed or unconfirmed ones; mark or confirm something first";
                return Err(AppError::new(StatusCode::CONFLICT, "no-findings", detail));
            }
            let write = move || wire::stl_of_tubes(&solid_of(&list), BRUSH_RADIUS_MM);
            let body = Bytes::from(cases.queue.run(write).await?);
            attachment(STL, body, "attachment; filename=\"findings.stl\"").respond(&request)
        }
        _ => as_json(findings)?.respond(&request),
    }
}

/// A file that a browser saves under its name.
fn attachment(media_type: &'static str, body: Bytes, name: &'static str) -> Representation {
    let tag = EntityTag::of_bytes(&body, Coding::Identity);
    let mut file = represented(tag, media_type, body);
    let name = HeaderValue::from_static(name);
    file.headers.insert(header::CONTENT_DISPOSITION, name);
    file
}

/// Replace what readers have marked and written
///
/// The body is the whole list, or with `Content-Type: application/dicom` a measurement report or a segmentation that this program has
/// made of findings of the same patient (`POST …/dicom-results`). A segmentation has no dismissed ones, and neither has unconfirmed ones: those of the case stay. `If-Match` must have the `ETag` of the list that the client has changed, so that nobody
/// undoes what somebody else wrote meanwhile: the answer is then 412, with the findings as they are. A new case has the
/// empty list, with an `ETag` as well. An answer with 200 has the stored list, with the sides and times that the server
/// adds, and comes after they are durable. A version of the case begins with a copy; from then on each has its own.
#[utoipa::path(
    put, path = "/v1/cases/{id}/findings", tag = "findings",
    params(
        ("id" = String, Path, description = "The case"),
        ("If-Match" = String, Header, description = "The `ETag` of the list that was changed"),
    ),
    request_body(content((FindingList = "application/json"), (Vec<u8> = "application/dicom"))),
    responses(
        (status = 200, description = "The findings as they are now", body = FindingList, headers(("ETag" = String, description = "The new one"))),
        (status = 400, description = "The body is invalid; `parameter` states where"),
        (status = 409, description = "The case is not ready, or the file is about another patient or another frame of reference, or of images that were rejected or moved since, or of a case that is not here (`findings-elsewhere`)"),
        (status = 412, description = "Somebody has changed the findings; the answer has them as they are", body = FindingsChanged, content_type = "application/problem+json", headers(("ETag" = String, description = "The current one"))),
        (status = 413, description = "The body is larger than 4 MiB"),
        (status = 415, description = "The body should be a DICOM file, and is none"),
        (status = 422, description = "The DICOM file is damaged, or is no report or segmentation of findings of this program"),
        (status = 428, description = "`If-Match` is missing"),
    )
)]
pub async fn put_findings(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    cases.ready(&id).await?;
    let known = known_tags(&request).ok_or_else(precondition_required)?;
    let replaced = if is_dicom(&request) {
        let file = body.map_err(|_| AppError::too_large(MAX_BYTES as u64))?;
        match cases.findings_of_dicom(&id, file).await {
            Ok(findings) => cases.replace_findings(&id, &known, findings).await,
            Err(refused) => Err(refused),
        }
    } else {
        let FindingList { findings } = json_body_within(MAX_BYTES, body)?;
        cases.replace_findings(&id, &known, findings).await
    };
    answer(replaced)
}

/// Take over the findings of another case
///
/// Adds the findings of the case `other`, in any state, to those of a case that is ready and open. Their positions (LPS mm)
/// stay as they are. **Whether both heads lie in one place is not verified**, neither by patient nor by frame of reference: the reader looks.
/// So each one is added with `is_unconfirmed`, until a client sends it without (`PUT`). A finding whose id is there already is not added
/// again. If one lies outside the volume of the case, none is added. `If-Match` as for `PUT`; the answer is the whole list.
#[utoipa::path(
    post, path = "/v1/cases/{id}/findings/from/{other}", tag = "findings",
    params(
        ("id" = String, Path, description = "The case that is to have them"),
        ("other" = String, Path, description = "The case that has them"),
        ("If-Match" = String, Header, description = "The `ETag` of the findings of the case that is to have them"),
    ),
    responses(
        (status = 200, description = "The findings as they are now", body = FindingList, headers(("ETag" = String, description = "The new one"))),
        (status = 400, description = "Together they are too many (`findings-invalid`)"),
        (status = 404, description = "One of the cases is not here"),
        (status = 409, description = "The case is not ready (`case-not-ready`) or closed (`closed`), or a finding lies outside its volume (`findings-elsewhere`)"),
        (status = 412, description = "Somebody has changed the findings; the answer has them as they are", body = FindingsChanged, content_type = "application/problem+json", headers(("ETag" = String, description = "The current one"))),
        (status = 428, description = "`If-Match` is missing"),
    )
)]
pub async fn take_over_findings(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    cases.ready(&id).await?;
    let known = known_tags(&request).ok_or_else(precondition_required)?;
    let other = path.iter().find(|(name, _)| *name == "other");
    let other = other.and_then(|(_, text)| CaseId::parse(text));
    let other = other.ok_or_else(not_a_case_id)?;
    answer(cases.take_over_findings(&id, &known, &other).await)
}

/// Whether the body is a DICOM file.
fn is_dicom(request: &HeaderMap) -> bool {
    let kind = request.get(header::CONTENT_TYPE);
    let kind = kind.and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let essence = kind.split(';').next().unwrap_or_default();
    essence.trim().eq_ignore_ascii_case(DICOM)
}

impl Versioned for Findings {
    const INVALID: &'static str = "findings-invalid";
    const CHANGED: (&'static str, &'static str) = (
        "findings-changed",
        "somebody has changed the findings since you read them; merge your changes with them, and send them again",
    );

    fn tag(&self) -> EntityTag {
        EntityTag::from_digest(self.version.digest())
    }

    fn shown(self) -> impl Serialize {
        FindingList {
            findings: self.list,
        }
    }

    fn changed(self, problem: Problem) -> impl Serialize {
        FindingsChanged {
            problem,
            findings: self.list,
        }
    }
}

/// A name, and what is in the column of a finding, the number of a point and the point.
type Column = (&'static str, fn(&Finding, usize, [f64; 3]) -> String);

/// The columns of the CSV, which has a row for each point.
const COLUMNS: [Column; 22] = [
    ("finding", |finding, _, _| finding.id.clone()),
    ("kind", |finding, _, _| finding.kind.name().to_owned()),
    ("point", |_, number, _| number.to_string()),
    ("left_mm", |_, _, [x, _, _]| x.to_string()),
    ("posterior_mm", |_, _, [_, y, _]| y.to_string()),
    ("superior_mm", |_, _, [_, _, z]| z.to_string()),
    ("depth_mm", |finding, _, _| finding.depth_mm.to_string()),
    ("side", |finding, _, _| {
        word(finding.side.map(PatientSide::name))
    }),
    ("certainty", |finding, _, _| {
        word(finding.certainty.map(Certainty::name))
    }),
    ("dismissed", |finding, _, _| {
        finding.is_dismissed.to_string()
    }),
    ("map", |finding, _, _| {
        word(finding.from_map.map(MapName::name))
    }),
    ("label", |finding, _, _| quoted(&finding.label)),
    ("note", |finding, _, _| quoted(&finding.note)),
    ("colour", |finding, _, _| finding.colour.clone()),
    ("author", |finding, _, _| {
        quoted(finding.author.as_deref().unwrap_or_default())
    }),
    ("created_at", |finding, _, _| {
        word(finding.created_at.as_deref())
    }),
    ("changed_at", |finding, _, _| {
        word(finding.changed_at.as_deref())
    }),
    ("gyrus", |finding, _, _| {
        word(finding.gyrus.map(Gyrus::name))
    }),
    ("unconfirmed", |finding, _, _| {
        finding.is_unconfirmed.to_string()
    }),
    ("mni152", |finding, _, _| standard(finding, 0)),
    ("talairach", |finding, _, _| standard(finding, 1)),
    ("ac_pc", |finding, _, _| standard(finding, 2)),
];

/// Where the middle of a finding is in other heads, in one of three spaces.
fn standard(finding: &Finding, space: usize) -> String {
    standard_fields(finding.standard)[space].clone()
}

/// A field that is empty where there is nothing.
fn word(known: Option<&str>) -> String {
    known.unwrap_or_default().to_owned()
}

fn csv(findings: &[Finding]) -> String {
    let mut rows = vec![COLUMNS.map(|(name, _)| name.to_owned()).join(",")];
    for finding in findings {
        for (number, &point) in (1..).zip(&finding.points_in_patient) {
            rows.push(COLUMNS.map(|(_, of)| of(finding, number, point)).join(","));
        }
    }
    rows.iter().map(|row| format!("{row}\r\n")).collect()
}
