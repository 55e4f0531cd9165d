//! The list of series that came, and those that somebody takes although they were refused.

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use case::series::SeriesQuery;
use case::{CaseId, CaseState};
use cases::pictures::check_count;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use storage::{Cursor, is_id};
use utoipa::{IntoParams, ToSchema};

use crate::error::ReasonView;
use crate::state::Pacs;
use crate::values::{Arrival, ArrivalQuery, ArrivalState, Taken, TakenAs};
use http::fresh::fresh_json;
use http::problem::AppError;
use http::query::{ApiQuery, Asked, MAX_PAGE, usual_page};
use http::sent::json_body;

/// The longest text to look for in labels, in characters.
const MAX_TEXT: usize = 100;

/// A series that came from a PACS. Its UIDs are patient data.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Arrival)]
pub(crate) struct ArrivalView {
    /// Its name in addresses.
    id: String,
    /// The Study Instance UID.
    study: String,
    /// The Series Instance UID.
    series: String,
    /// `stow`, `c-store` or `retrieval`.
    source: &'static str,
    /// Description or protocol of the series, and the date of the study; absent if the store keeps no identities.
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<String>,
    /// `receiving` until nothing has come for a while, then `case`, `layer` or `nothing`.
    state: &'static str,
    /// The reason, if it became a layer or nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// How somebody took it, if it had been refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    taken: Option<Taken>,
    /// The reason for which it was refused before it was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<ReasonView>,
    /// The case that it became, or that has it as a layer; omitted if its images were corrected or rejected since.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    case: Option<CaseId>,
    /// Images so far.
    instances: usize,
    /// Images that took the place of others with the same UID since the series was read before.
    corrected: usize,
    /// Objects that are no images and were not kept.
    ignored: usize,
    /// Objects that were refused, as often as they were sent. The latest 100 series of which nothing else has come are listed.
    refused_objects: usize,
    /// Why the last of them was refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    last_refusal: Option<String>,
    /// How many there are, if the sender has stated it.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<usize>,
    /// When its first image came (RFC 3339).
    first_at: String,
    /// When its last image came (RFC 3339).
    last_at: String,
}

impl From<Arrival> for ArrivalView {
    fn from(arrival: Arrival) -> Self {
        Self {
            state: arrival.state.name(),
            id: arrival.id,
            study: arrival.uids.study.as_str().to_owned(),
            series: arrival.uids.series.as_str().to_owned(),
            source: arrival.source.name(),
            label: arrival.label,
            reason: arrival.reason.map(Into::into),
            taken: arrival.taken,
            refused: arrival.refused.map(Into::into),
            case: arrival.case,
            instances: arrival.instances,
            corrected: arrival.corrected,
            ignored: arrival.ignored,
            refused_objects: arrival.refused_objects,
            last_refusal: arrival.last_refusal,
            expected: arrival.expected,
            first_at: arrival.first_at.to_string(),
            last_at: arrival.last_at.to_string(),
        }
    }
}

/// A page of series.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct ArrivalList {
    /// Newest first.
    arrivals: Vec<ArrivalView>,
    /// The value of `after` for the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// Which series, and which page.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct PageQuery {
    /// `receiving`, `case`, `layer` or `nothing`.
    state: Option<String>,
    /// A case: series that became it, or a layer of it.
    case: Option<String>,
    /// A part of the label, 1 to 100 characters, whether in upper or lower case.
    text: Option<String>,
    /// The first image came at this time (RFC 3339) or later.
    since: Option<String>,
    /// The first image came before this time (RFC 3339).
    until: Option<String>,
    /// The number of series.
    #[serde(default = "usual_page")]
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: usize,
    /// `next` of the page before.
    after: Option<String>,
}

/// A query for a page whose values are valid.
#[derive(Debug)]
pub(crate) struct Checked<Query> {
    pub(crate) of: Query,
    pub(crate) after: Option<Cursor>,
    pub(crate) limit: usize,
}

impl<Query> Checked<Query> {
    /// The page after `after`, as a client wrote it.
    pub(crate) fn new(of: Query, after: &Option<String>, limit: usize) -> Result<Self, AppError> {
        check_count("limit", limit, 1, MAX_PAGE)?;
        let after = value("after", after, "`next` of the page before", Cursor::parse)?;
        Ok(Self { of, after, limit })
    }
}

/// A value of the query, if there is one.
pub(crate) fn value<T>(
    key: &str,
    text: &Option<String>,
    rule: &str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Option<T>, AppError> {
    // What the client wrote may be anything, so it is not repeated.
    let parsed = text
        .as_ref()
        .map(|text| parse(text).ok_or_else(|| AppError::wrong_value(key, rule)));
    parsed.transpose()
}

impl Asked for PageQuery {
    type Values = Checked<ArrivalQuery>;

    fn checked(&self) -> Result<Self::Values, AppError> {
        let a_case = "the id of a case: 32 hexadecimal digits";
        let a_state = "`receiving`, `case`, `layer` or `nothing`";
        let a_time = "a time such as `2026-11-23T00:00:00Z`";
        let a_text = format!("1 to {MAX_TEXT} characters");
        let text = |text: &str| {
            (1..=MAX_TEXT)
                .contains(&text.chars().count())
                .then(|| text.to_owned())
        };
        let time = |text: &str| text.parse::<Timestamp>().ok();
        let of = ArrivalQuery {
            state: value("state", &self.state, a_state, ArrivalState::from_name)?,
            case: value("case", &self.case, a_case, CaseId::parse)?,
            text: value("text", &self.text, &a_text, text)?,
            since: value("since", &self.since, a_time, time)?,
            until: value("until", &self.until, a_time, time)?,
        };
        Checked::new(of, &self.after, self.limit)
    }
}

/// List series from a PACS
///
/// Every series that came in the last days, what became of it, and why. Conditions are combined: a series must fulfil each of
/// them. Its UIDs are patient data; no cache may store them.
#[utoipa::path(
    get, path = "/v1/arrivals", tag = "pacs", params(PageQuery),
    responses(
        (status = 200, description = "A page of series", body = ArrivalList),
        (status = 400, description = "A key of the query is unknown or its value invalid"),
    )
)]
pub(crate) async fn list_arrivals(
    State(pacs): State<Pacs>,
    ApiQuery { values: asked, .. }: ApiQuery<PageQuery>,
) -> Result<Response, AppError> {
    let store = pacs.store();
    let (arrivals, next) = store
        .arrivals(&asked.of, asked.after.as_ref(), asked.limit)
        .await?;
    let page = ArrivalList {
        arrivals: arrivals.into_iter().map(Into::into).collect(),
        next: next.map(|cursor| cursor.to_string()),
    };
    Ok(fresh_json(StatusCode::OK, &page))
}

/// Get a series from a PACS
#[utoipa::path(
    get, path = "/v1/arrivals/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The arrival")),
    responses(
        (status = 200, description = "The series", body = ArrivalView),
        (status = 404, description = "No such arrival"),
    )
)]
pub(crate) async fn get_arrival(
    State(pacs): State<Pacs>,
    Path(id): Path<String>,
) -> Result<Response, AppError> {
    let view = ArrivalView::from(arrival(&pacs, &id).await?);
    Ok(fresh_json(StatusCode::OK, &view))
}

async fn arrival(pacs: &Pacs, id: &str) -> Result<Arrival, AppError> {
    let found = match is_id(id) {
        true => pacs.store().arrival(id).await?,
        false => None,
    };
    found.ok_or_else(|| {
        AppError::not_found(
            "no-such-arrival",
            "there is no arrival with this id; arrivals are forgotten after some days",
        )
    })
}

/// Take a series that was refused
///
/// Reads it again, as a case or as a layer of the case of its study, whatever its names and timing indicate. Why it was
/// refused stays visible (`refused`). A series that became a layer can be taken as a case, too. Images that come later are
/// read in the same way.
#[utoipa::path(
    post, path = "/v1/arrivals/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The arrival")),
    request_body = Taken,
    responses(
        (status = 202, description = "The series, which is read as soon as all its images are there", body = ArrivalView),
        (status = 400, description = "The body cannot be read"),
        (status = 404, description = "No such arrival"),
        (status = 409, description = "It is a case already (`arrival-not-refused`), none of its images is kept (`no-images`), or there is no case of its study that it could be a layer of (`no-case-of-study`)"),
    )
)]
pub(crate) async fn take_arrival(
    State(pacs): State<Pacs>,
    Path(id): Path<String>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let wanted: Taken = json_body(body)?;
    let found = arrival(&pacs, &id).await?;
    let conflict = |kind, detail| Err(AppError::new(StatusCode::CONFLICT, kind, detail));
    let state = found.state;
    let is_layer_again = state == ArrivalState::Layer && wanted.kind == TakenAs::Layer;
    if state == ArrivalState::Case || is_layer_again {
        let detail = "the series was not refused: it is a case or a layer already";
        return conflict("arrival-not-refused", detail);
    }
    if found.instances == 0 {
        let detail = "none of the images of the series is kept; send it again";
        return conflict("no-images", detail);
    }
    if wanted.kind == TakenAs::Layer && !has_case(&pacs, &found).await? {
        let detail = "there is no case of the study that the series could be a layer of; take a T1-weighted series of it first";
        return conflict("no-case-of-study", detail);
    }
    pacs.store().take(&id, &wanted).await?;
    tracing::info!(
        arrival = id,
        "a series is taken, whatever it was refused for"
    );
    let view = ArrivalView::from(arrival(&pacs, &id).await?);
    Ok(fresh_json(StatusCode::ACCEPTED, &view))
}

/// Whether the study of a series has a case that can have layers.
async fn has_case(pacs: &Pacs, arrival: &Arrival) -> Result<bool, AppError> {
    let study = SeriesQuery::Study(arrival.uids.study.clone(), None);
    let heads = pacs.arrivals().heads(&study).await?;
    Ok(heads
        .iter()
        .any(|head| head.case.state != CaseState::Failed))
}
