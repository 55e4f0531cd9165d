//! The readings of a case: what named readers conclude and sign.

use axum::Extension;
use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{RawPathParams, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use case::findings::Finding;
use case::readings::{Reading, Template};
use cases::readings::{KeptReading, has_signed};
use cases::{Cases, Error};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::candidates::quoted;
use super::findings::{CSV, MAX_BYTES};
use super::versioned::{
    JSON, Versioned, answer, as_json, known_tags, precondition_required, represented,
};
use crate::routes::asked::CasePath;
use access::tokens::Holder;
use http::conditional::EntityTag;
use http::fresh::fresh_json;
use http::negotiate::{Coding, media_type};
use http::problem::{AppError, Problem};
use http::query::{ApiQuery, Asked, NoQuery};
use http::sent::json_body_within;

/// Whether a version of a reading may still be changed.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum ReadingPhase {
    /// Its reader may change it.
    Open,
    /// Nobody changes it.
    Signed,
}

impl ReadingPhase {
    fn of(is_signed: bool) -> Self {
        match is_signed {
            true => Self::Signed,
            false => Self::Open,
        }
    }
}

/// A version of a reading in a list.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ListedReading {
    /// The name of the token, or `proxy:` and the name of somebody whom a proxy has signed in.
    reader: String,
    /// From 1; a correction of a signed one is the next.
    version: u32,
    state: ReadingPhase,
    changed_at: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    signed_at: Option<String>,
    /// Whether it is that of whoever asks.
    is_mine: bool,
    /// Whether whoever asks may see what it has.
    is_shown: bool,
}

/// Who has read a case.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ReadingList {
    /// By reader and version.
    readings: Vec<ListedReading>,
}

/// A version of a reading.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ShownReading {
    /// The name of the token, or `proxy:` and the name of somebody whom a proxy has signed in.
    reader: String,
    /// From 1; a correction of a signed one is the next.
    version: u32,
    state: ReadingPhase,
    #[serde(skip_serializing_if = "Option::is_none")]
    signed_at: Option<String>,
    /// Text, at most 10,000 characters.
    conclusion: String,
    /// Those that the conclusion rests on.
    findings: Vec<Finding>,
    /// The conclusion in fixed words.
    template: Template,
}

impl From<KeptReading> for ShownReading {
    fn from(kept: KeptReading) -> Self {
        Self {
            reader: kept.reader,
            version: kept.version,
            state: ReadingPhase::of(kept.signed_at.is_some()),
            signed_at: kept.signed_at.map(|at| at.to_string()),
            conclusion: kept.reading.conclusion,
            findings: kept.reading.findings,
            template: kept.reading.template,
        }
    }
}

/// The answer to a client that did not know the reading as it is: a problem, and the reading.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ReadingChanged {
    #[serde(flatten)]
    problem: Problem,
    #[serde(flatten)]
    reading: ShownReading,
}

impl Versioned for KeptReading {
    const INVALID: &'static str = "reading-invalid";
    const CHANGED: (&'static str, &'static str) = (
        "reading-changed",
        "your reading has changed since you read it; merge your changes with it, and send it again",
    );

    fn tag(&self) -> EntityTag {
        EntityTag::from_digest(self.tag.digest())
    }

    fn shown(self) -> impl Serialize {
        ShownReading::from(self)
    }

    fn changed(self, problem: Problem) -> impl Serialize {
        ReadingChanged {
            problem,
            reading: self.into(),
        }
    }
}

/// The keys of a reading.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct ReadingQuery {
    /// The last one if it is absent.
    version: Option<u32>,
}

impl Asked for ReadingQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// Who has read the case
///
/// The versions of all readings, and when they were signed. A reading is of a named reader: the holder of a token with a name, or somebody whom a proxy has
/// signed in. What it has, others see once it is signed and once they have signed their own (`is_shown`). A version of the case has readings of its own.
#[utoipa::path(
    get, path = "/v1/cases/{id}/readings", tag = "findings",
    params(("id" = String, Path, description = "The case, in any state")),
    responses((status = 200, description = "The readings", body = ReadingList)),
)]
pub async fn list_readings(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let reader = named(&holder).ok();
    let all = cases.readings(&id).await?;
    let sees_others = has_signed(&all, reader);
    let readings = all.into_iter().map(|one| {
        let is_mine = Some(&*one.reader) == reader;
        let is_signed = one.signed_at.is_some();
        ListedReading {
            version: one.version,
            state: ReadingPhase::of(is_signed),
            changed_at: one.changed_at.to_string(),
            signed_at: one.signed_at.map(|at| at.to_string()),
            is_mine,
            is_shown: is_mine || (sees_others && is_signed),
            reader: one.reader,
        }
    });
    let list = ReadingList {
        readings: readings.collect(),
    };
    Ok(fresh_json(StatusCode::OK, &list))
}

/// The reading of a reader
///
/// The last version of one's own (the signed one before an open correction in which nothing is concluded), or the last signed one of somebody else, or the
/// version that the query names. As JSON, or with `Accept: text/csv` as a row with the conclusion and the template.
#[utoipa::path(
    get, path = "/v1/cases/{id}/readings/by/{reader}", tag = "findings",
    params(
        ("id" = String, Path, description = "The case, in any state"),
        ("reader" = String, Path, description = "As in the list"),
        ReadingQuery,
    ),
    responses(
        (status = 200, description = "The reading", content((ShownReading = "application/json"), (String = "text/csv")), headers(("ETag" = String, description = "For `If-None-Match`"))),
        (status = 404, description = "There is no such case, or no such reading (`no-such-reading`)"),
        (status = 409, description = "It is of somebody else, and whoever asks has not signed their own (`reading-hidden`)"),
    )
)]
pub async fn get_reading(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked, .. }: ApiQuery<ReadingQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let kind = media_type(&request, &[JSON, CSV])?;
    let reader = path.iter().find(|(name, _)| *name == "reader");
    let (_, reader) = reader.ok_or(Error::NoSuchReading)?;
    let asker = named(&holder).ok();
    let reading = cases.reading(&id, asker, reader, asked.version).await?;
    if kind == JSON {
        return as_json(reading)?.respond(&request);
    }
    let body = Bytes::from(csv(&reading));
    let tag = EntityTag::of_bytes(&body, Coding::Identity);
    represented(tag, CSV, body).respond(&request)
}

/// A row with the conclusion and the template.
fn csv(kept: &KeptReading) -> String {
    let head = ["reader", "version", "signed_at", "conclusion"];
    let head = [&head[..], &Template::FIELDS].concat().join(",");
    let signed_at = kept.signed_at.map(|at| at.to_string());
    let row = [
        quoted(&kept.reader),
        kept.version.to_string(),
        signed_at.unwrap_or_default(),
        quoted(&kept.reading.conclusion),
    ];
    let words = kept.reading.template.words();
    let words = words.map(|word| word.unwrap_or_default().to_owned());
    let row = [&row[..], &words].concat().join(",");
    format!("{head}\r\n{row}\r\n")
}

/// One's own reading
///
/// Its last version; an empty one that is open if it is not begun. The `ETag` is what a change and a signature must name.
#[utoipa::path(
    get, path = "/v1/cases/{id}/readings/mine", tag = "findings",
    params(("id" = String, Path, description = "The case, in any state")),
    responses(
        (status = 200, description = "The reading", body = ShownReading, headers(("ETag" = String, description = "For `If-Match` and `If-None-Match`"))),
        (status = 403, description = "Whoever asks has no name (`reader-unnamed`)"),
    )
)]
pub async fn get_own_reading(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    let reading = cases.own_reading(&id, named(&holder)?).await?;
    as_json(reading)?.respond(&request)
}

/// Keep one's own reading
///
/// The conclusion, as text and in the fixed words of the template, and the findings that it rests on. Nobody else sees it before it is signed. `If-Match` must have the `ETag` of the reading that the
/// client has changed; otherwise the answer is 412, with the reading as it is. If that one is signed, this is its correction: the next version, which is open.
#[utoipa::path(
    put, path = "/v1/cases/{id}/readings/mine", tag = "findings",
    params(
        ("id" = String, Path, description = "The case"),
        ("If-Match" = String, Header, description = "The `ETag` of the reading that was changed"),
    ),
    request_body = Reading,
    responses(
        (status = 200, description = "The reading as it is now, with the sides and times that the server adds", body = ShownReading, headers(("ETag" = String, description = "The new one"))),
        (status = 400, description = "The body is invalid; `parameter` states where"),
        (status = 403, description = "Whoever asks has no name (`reader-unnamed`)"),
        (status = 409, description = "The case is not ready, or it is closed and the reading is signed: nobody could sign a correction (`closed`)"),
        (status = 412, description = "The reading has changed; the answer has it as it is", body = ReadingChanged, content_type = "application/problem+json", headers(("ETag" = String, description = "The current one"))),
        (status = 413, description = "The body is larger than 4 MiB"),
        (status = 428, description = "`If-Match` is missing"),
    )
)]
pub async fn put_own_reading(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    cases.ready(&id).await?;
    let reader = named(&holder)?;
    let known = known_tags(&request).ok_or_else(precondition_required)?;
    let reading: Reading = json_body_within(MAX_BYTES, body)?;
    answer(cases.keep_reading(&id, reader, &known, reading).await)
}

/// Sign one's own reading
///
/// Nobody changes this version any more; `PUT` begins the next one. Others see it once they have signed their own. The audit record has
/// each signature. The conclusion must not be empty, unless the template states something. `If-Match` must have the `ETag` of the reading as the reader has it; otherwise the answer is 412, with the reading as it is.
#[utoipa::path(
    post, path = "/v1/cases/{id}/readings/mine/signature", tag = "findings",
    params(
        ("id" = String, Path, description = "The case"),
        ("If-Match" = String, Header, description = "The `ETag` of the reading to sign"),
    ),
    responses(
        (status = 200, description = "The reading, signed", body = ShownReading, headers(("ETag" = String, description = "The new one"))),
        (status = 400, description = "Nothing is concluded (`reading-invalid`)"),
        (status = 403, description = "Whoever asks has no name, or a proxy states one that only its digest is known of (`reader-unnamed`)"),
        (status = 409, description = "The case is closed (`closed`), or this version is signed already (`reading-signed`); nothing is signed twice"),
        (status = 412, description = "The reading has changed; the answer has it as it is", body = ReadingChanged, content_type = "application/problem+json", headers(("ETag" = String, description = "The current one"))),
        (status = 428, description = "`If-Match` is missing"),
    )
)]
pub async fn sign_own_reading(
    State(cases): State<Cases>,
    Extension(holder): Extension<Holder>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    let reader = named(&holder)?;
    if !holder.is_readable() {
        return Err(unnamed(
            "nobody could read who has signed: the proxy states a name with spaces, with letters beyond ASCII or of more than 128 characters; let `proxy.user_header` name a header with a plain name, such as the account",
        ));
    }
    let known = known_tags(&request).ok_or_else(precondition_required)?;
    answer(cases.sign_reading(&id, reader, &known).await)
}

/// The name of whoever asks, who answers for a reading with it, and whose preferences are kept.
pub(super) fn named(holder: &Holder) -> Result<&str, AppError> {
    match holder.is_named() {
        true => Ok(&holder.name),
        false => Err(unnamed(
            "a reading and preferences are kept for somebody with a name; sign in by a proxy, or use a token with a name",
        )),
    }
}

fn unnamed(detail: &'static str) -> AppError {
    AppError::new(StatusCode::FORBIDDEN, "reader-unnamed", detail)
}
