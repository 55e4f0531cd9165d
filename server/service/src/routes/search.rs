//! Cases by what they are, what they have and whose they are, in the order that a worklist needs. The request is in
//! a body, because addresses are logged.

use access::audited::NamesPatient;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::StatusCode;
use axum::response::Response;
use case::series::{AccessionNumber, PatientDigest, Uid};
use case::{CaseState, QualityState};
use cases::Cases;
use cases::search::{Found, FoundPage};
use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use storage::{CaseQuery, Cursor, Has, Order, Status};
use utoipa::ToSchema;

use super::cases::CaseView;
use http::fresh::fresh_json;
use http::problem::AppError;
use http::query::{ApiQuery, MAX_PAGE, NoQuery, usual_page};
use http::sent::json_body;

/// The longest part of a label to look for, in characters.
const MAX_LABEL: usize = 100;

/// Which cases to find. Conditions are combined: a case must fulfil each of them.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseSearch {
    /// A part of the label, 1 to 100 characters, whether in upper or lower case.
    label: Option<String>,
    /// `queued`, `preparing`, `ready` or `failed`.
    state: Option<String>,
    /// The first day on which they came, in UTC, such as `2026-11-01`.
    from: Option<String>,
    /// The last day on which they came, in UTC; the same as `from` for one day.
    to: Option<String>,
    /// The Study Instance UID.
    study: Option<String>,
    /// The Series Instance UID.
    series: Option<String>,
    /// The accession number, exactly.
    accession_number: Option<String>,
    /// The Patient ID, exactly.
    patient_id: Option<String>,
    /// A part of the label or of the name of somebody who has written findings, or the beginning of the id: 1 to 100 characters.
    text: Option<String>,
    /// What is to be done: `preparing` (also if it waits for that), `failed`, `new` (ready, and nothing is written about it), `begun`, or `signed` (by all
    /// who have begun a reading).
    status: Option<String>,
    /// The rating of the mask: `ok`, `review` or `failed`.
    mask: Option<String>,
    /// A part of the name of a layer, 1 to 100 characters, whether in upper or lower case.
    layer: Option<String>,
    /// A part of the name of somebody who has written findings, 1 to 100 characters, whether in upper or lower case.
    reader: Option<String>,
    /// What there is at least one of: `places` that stand out, `findings` that were not dismissed, or `layers`.
    has: Option<String>,
    /// Whether they are in the trash.
    #[serde(default)]
    trashed: bool,
    /// `newest` (the default), `oldest`, `label` (numbers by their value), `places` or `findings`: the most first.
    sort: Option<String>,
    /// Whether the answer states whose they are. If it does, and if a condition is a study, a series, an accession number or a patient,
    /// that is recorded in the audit record each time; a list that is asked for again and again does without.
    #[serde(default = "yes")]
    #[schema(default = true)]
    patients: bool,
    /// The number of cases to pass over, in any order; the answer then has their `total`. Not together with `after`.
    skip: Option<usize>,
    /// The number of cases.
    #[serde(default = "usual_page")]
    #[schema(minimum = 1, maximum = 200, default = 50)]
    limit: usize,
    /// `next` of the page before, newest first.
    after: Option<String>,
}

fn yes() -> bool {
    true
}

/// A case that was found. It leads to a patient.
#[derive(Serialize, ToSchema)]
#[schema(as = FoundCase)]
struct FoundView {
    #[serde(flatten)]
    case: CaseView,
    /// What is to be done, as in the conditions.
    status: &'static str,
    /// How many places of its maps stand out; absent if that is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    places: Option<u32>,
    /// The number of findings, without places that were dismissed.
    finding_count: u32,
    /// Who has written findings, as they named themselves; absent if nobody has.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    readers: Vec<String>,
    /// The names of its layers; absent without one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    layers: Vec<String>,
    /// The Study Instance UID, for a case from DICOM.
    #[serde(skip_serializing_if = "Option::is_none")]
    study: Option<String>,
    /// The Series Instance UID, for a case from DICOM.
    #[serde(skip_serializing_if = "Option::is_none")]
    series: Option<String>,
    /// The accession number of the study.
    #[serde(skip_serializing_if = "Option::is_none")]
    accession_number: Option<String>,
    /// Name, id with its issuer, and date of birth: `Müller, Änne · P-77 (HOSPITAL) · * 1967-03-12`.
    #[serde(skip_serializing_if = "Option::is_none")]
    patient: Option<String>,
}

impl From<Found> for FoundView {
    fn from(found: Found) -> Self {
        let series = found.series.as_ref();
        let number = series.and_then(|series| series.accession_number.as_ref());
        let patient = found.patient.map(|patient| patient.words());
        Self {
            study: series.map(|series| series.uids.study.as_str().to_owned()),
            series: series.map(|series| series.uids.series.as_str().to_owned()),
            accession_number: number.map(|number| number.as_str().to_owned()),
            patient: patient.filter(|words| !words.is_empty()),
            status: found.listed.status.name(),
            places: found.listed.places,
            finding_count: found.listed.findings,
            readers: found.listed.readers,
            layers: found.listed.layers,
            case: found.listed.case.into(),
        }
    }
}

/// A page of cases that were found.
#[derive(Serialize, ToSchema)]
#[schema(as = FoundPage)]
struct FoundPageView {
    /// In the order that was asked for.
    cases: Vec<FoundView>,
    /// The value of `after` for the next page, newest first; absent on the last page, and in another order.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
    /// How many cases fulfil the conditions; only with `skip`.
    #[serde(skip_serializing_if = "Option::is_none")]
    total: Option<u64>,
}

/// The value of a key, if it is given. What the client wrote may be patient data, so it is not repeated.
fn value<T>(
    key: &str,
    text: Option<&String>,
    rule: &str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Option<T>, AppError> {
    let parsed = text.map(|text| parse(text).ok_or_else(|| AppError::wrong_in_body(key, rule)));
    parsed.transpose()
}

/// When a day begins in UTC.
fn begin(day: Date) -> Option<Timestamp> {
    Some(day.to_zoned(TimeZone::UTC).ok()?.timestamp())
}

impl CaseSearch {
    fn query(&self) -> Result<CaseQuery, AppError> {
        let a_uid = "a UID: digits and points, at most 64";
        let a_day = "a day such as `2026-11-01`";
        let label = |text: &str| {
            let length = text.chars().count();
            (1..=MAX_LABEL).contains(&length).then(|| text.to_owned())
        };
        let day = |text: &str| text.parse::<Date>().ok();
        let order = value(
            "sort",
            self.sort.as_ref(),
            "`newest`, `oldest`, `label`, `places` or `findings`",
            Order::from_name,
        )?;
        Ok(CaseQuery {
            text: value("text", self.text.as_ref(), "1 to 100 characters", label)?,
            status: value(
                "status",
                self.status.as_ref(),
                "`preparing`, `failed`, `new`, `begun` or `signed`",
                Status::from_name,
            )?,
            mask: value(
                "mask",
                self.mask.as_ref(),
                "`ok`, `review` or `failed`",
                QualityState::from_name,
            )?,
            layer: value("layer", self.layer.as_ref(), "1 to 100 characters", label)?,
            reader: value("reader", self.reader.as_ref(), "1 to 100 characters", label)?,
            has: value(
                "has",
                self.has.as_ref(),
                "`places`, `findings` or `layers`",
                Has::from_name,
            )?,
            trashed: Some(self.trashed),
            order: order.unwrap_or_default(),
            skip: self.skip,
            label: value("label", self.label.as_ref(), "1 to 100 characters", label)?,
            state: value(
                "state",
                self.state.as_ref(),
                "`queued`, `preparing`, `ready` or `failed`",
                CaseState::from_name,
            )?,
            since: value("from", self.from.as_ref(), a_day, |text| begin(day(text)?))?,
            until: value("to", self.to.as_ref(), a_day, |text| {
                begin(day(text)?.tomorrow().ok()?)
            })?,
            study: value("study", self.study.as_ref(), a_uid, Uid::parse)?,
            series: value("series", self.series.as_ref(), a_uid, Uid::parse)?,
            accession_number: value(
                "accession_number",
                self.accession_number.as_ref(),
                "1 to 16 characters",
                AccessionNumber::parse,
            )?,
            patient: value(
                "patient_id",
                self.patient_id.as_ref(),
                "at least one character",
                PatientDigest::of,
            )?,
        })
    }
}

/// Find cases
///
/// The cases that fulfil all conditions of the body; without a condition, all that are not in the trash. The answer shows patients, which
/// is recorded in the audit record, unless the body forgoes them; no cache may store it.
#[utoipa::path(
    post, path = "/v1/cases/search", tag = "cases",
    request_body = CaseSearch,
    responses(
        (status = 200, description = "A page of the cases that were found", body = FoundPageView),
        (status = 400, description = "The body cannot be read, or a value is invalid"),
    )
)]
pub async fn search_cases(
    State(cases): State<Cases>,
    _no_query: ApiQuery<NoQuery>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let asked: CaseSearch = json_body(body)?;
    if !(1..=MAX_PAGE).contains(&asked.limit) {
        return Err(AppError::wrong_in_body("limit", "1 to 200"));
    }
    let query = asked.query()?;
    let has_cursor = query.order == Order::Newest && query.skip.is_none();
    let cursor = "`next` of the page before, newest first and without `skip`";
    let parse = |text: &str| Cursor::parse(text).filter(|_| has_cursor);
    let after = value("after", asked.after.as_ref(), cursor, parse)?;
    let FoundPage { cases, next, total } = cases
        .search(&query, after.as_ref(), asked.limit, asked.patients)
        .await?;
    let page = FoundPageView {
        cases: cases.into_iter().map(FoundView::from).collect(),
        next: next.map(|cursor| cursor.to_string()),
        total,
    };
    let mut response = fresh_json(StatusCode::OK, &page);
    // What is found by whose it is tells whose it is.
    let is_of_patient = query.study.is_some()
        || query.series.is_some()
        || query.accession_number.is_some()
        || query.patient.is_some();
    if asked.patients || is_of_patient {
        response.extensions_mut().insert(NamesPatient);
    }
    Ok(response)
}
