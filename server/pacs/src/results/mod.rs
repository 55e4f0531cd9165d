//! Results of a case as DICOM objects: returned, or sent to a node.

mod compose;
mod directions;
pub(crate) mod draw;
mod findings;
mod mask;
mod moment;
mod outline;
pub(crate) mod request;

use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::rejection::BytesRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use case::{CaseId, JobState};
use serde::Serialize;
use storage::is_id;
use utoipa::ToSchema;

use self::compose::Composer;
use self::request::ResultRequest;
use crate::error::ReasonView;
use crate::state::Pacs;
use crate::values::{NewResult, NotValid, SentResult};
use access::proxy::plain_name;
use access::tokens::Holder;
use http::fresh::{fresh_json, made_at};
use http::negotiate::media_type;
use http::problem::AppError;
use http::sent::json_body;

/// A result that is sent to a node, or was.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = SentResult)]
pub(crate) struct ResultView {
    /// Its name in addresses.
    id: String,
    /// The case that it was made from.
    #[schema(value_type = String)]
    case: CaseId,
    /// The node.
    node: String,
    /// The Study Instance UID. It leads to a patient.
    study: String,
    /// The SOP Instance UID of the result. Equal requests have the same.
    instance: String,
    /// `queued`, `running`, `done` or `failed`.
    state: &'static str,
    /// `withdrawn`, or `closed` if its case or a layer that it shows is, if it does not count any more. It can be withdrawn by a rejection note,
    /// unless it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_valid: Option<&'static str>,
    /// The reason, if it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<ReasonView>,
    /// Attempts so far.
    attempts: u32,
    /// When it was first requested (RFC 3339).
    created_at: String,
}

impl From<SentResult> for ResultView {
    fn from(result: SentResult) -> Self {
        let job = result.job.as_ref();
        // A result of another store has no job here.
        let state = job.map_or(JobState::Done, |job| job.state);
        let failure = job.and_then(|job| job.failure.clone());
        Self {
            id: result.id,
            case: result.what.case,
            node: result.what.node,
            study: result.what.study.as_str().to_owned(),
            instance: result.what.instance.as_str().to_owned(),
            state: state.name(),
            not_valid: result.not_valid.map(NotValid::name),
            reason: failure
                .filter(|_| state == JobState::Failed)
                .map(Into::into),
            attempts: job.map_or(0, |job| job.attempts),
            created_at: result.created_at.to_string(),
        }
    }
}

/// A result as DICOM
///
/// Makes a DICOM object of a picture (Secondary Capture), a sheet of pictures (the same), the envelope or the brain mask (Segmentation on the slices of the source), what readers have marked
/// (Comprehensive 3D SR, or a Segmentation with a segment for each finding; the SR has the conclusion of a `reading`, if one is asked for), the report of a reading (Encapsulated PDF), or a rejection note of results that were sent (Key Object Selection). Patient and study
/// are those of the source. Without `node`, the answer is the object, or its picture for `Accept: image/png`; with `node`, the object is kept and sent there by
/// STOW-RS or C-STORE, again and again for about ten minutes if the node does not answer. Equal requests give one object.
#[utoipa::path(
    post, path = "/v1/cases/{id}/dicom-results", tag = "pacs",
    params(("id" = String, Path, description = "The case")),
    request_body = ResultRequest,
    responses(
        (status = 200, description = "The object, or its picture", content(
            (Vec<u8> = "application/dicom"), (Vec<u8> = "image/png"),
        )),
        (status = 202, description = "It is queued for the node, or was already", body = ResultView, headers(
            ("Location" = String, description = "The address of its state"), ("Retry-After" = u32, description = "Seconds to wait before the first request for it"),
        )),
        (status = 400, description = "The body cannot be read, or a value is invalid"),
        (status = 404, description = "No such case, no node has this name, or no such reading (`no-such-reading`)"),
        (status = 406, description = "A segmentation, findings, a report and a rejection note have no picture"),
        (status = 409, description = "The case is not ready, it is closed (`closed`), the reading is of somebody else and whoever asks has not signed their own (`reading-hidden`), the reading is to be sent and is not signed (`reading-open`), the PACS has images of its series or study as another patient's (`several-patients`), or the result was withdrawn (`withdrawn`)"),
        (status = 422, description = "The case has no patient (`no-patient`), the server keeps no identity (`deidentified`), nothing was marked (`no-findings`), or no frame of reference for a segmentation or findings"),
        (status = 503, description = "Too much work is waiting"),
    )
)]
pub(crate) async fn create_result(
    State(pacs): State<Pacs>,
    Extension(holder): Extension<Holder>,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let no_case = || AppError::from(cases::Error::NoSuchCase);
    let id = CaseId::parse(&id).ok_or_else(no_case)?;
    let is_preview = wants_picture(&headers)?;
    let asked: ResultRequest = json_body(body)?;
    pacs.needs_identity()?;
    let node = asked.node.as_deref().map(|name| pacs.named_node(name));
    let node = node.transpose()?;
    let plan = asked.plan()?;
    let reading = match &asked.reading {
        None => None,
        Some(reader) => {
            let asker = holder.is_named().then_some(&*holder.name);
            let kept = pacs.cases().reading(&id, asker, reader, None).await?;
            if node.is_some() && kept.signed_at.is_none() {
                return Err(AppError::new(
                    StatusCode::CONFLICT,
                    "reading-open",
                    "the reading is not signed; only a signed one is sent to a node",
                ));
            }
            Some((kept, plain_name(reader).to_owned()))
        }
    };
    let composer = Composer::begin(&pacs, id, &asked, plan, reading).await?;
    let store = pacs.store();
    let instance = composer.instance();
    if is_preview {
        return Ok(picture(composer.preview(pacs.cases()).await?));
    }
    let Some(node) = node else {
        let file = composer.file(pacs.cases()).await?;
        return Ok(object(asked.what.name(), file));
    };
    // A result that was made before is sent as it is.
    let known = store.object_of_result(&instance).await?;
    let known = match known {
        Some(name) => pacs.cases().store().object(&name).await.ok(),
        None => None,
    };
    let (study, series) = (composer.study(), composer.series());
    let (layers, withdrawn) = (composer.layers(), composer.withdrawn());
    let file = match known {
        Some(file) => file,
        None => composer.file(pacs.cases()).await?,
    };
    let new = NewResult {
        case: id,
        node: node.name().to_owned(),
        study,
        series,
        instance,
        layers,
        digest: blake3::hash(&file),
    };
    let queued = queue(&pacs, new, file).await?;
    store.withdraw(&withdrawn).await?;
    let address = format!("/v1/dicom-results/{}", queued.id);
    Ok(made_at(&address, true, &ResultView::from(queued)))
}

async fn queue(pacs: &Pacs, new: NewResult, file: Bytes) -> Result<SentResult, AppError> {
    let case = new.case;
    let queued = pacs.store().queue_result(new, file).await;
    if queued.is_err() && pacs.cases().store().case(&case).await?.is_none() {
        return Err(cases::Error::NoSuchCase.into());
    }
    Ok(queued?)
}

/// Whether the client accepts PNG rather than an object.
fn wants_picture(headers: &HeaderMap) -> Result<bool, AppError> {
    // The answer to a request that names a node is JSON.
    let offered = &[
        "application/dicom",
        "application/json",
        "application/dicom+json",
        "image/png",
    ];
    Ok(media_type(headers, offered)? == "image/png")
}

/// The answer with a preview. Captions may be patient data.
fn picture(png: Bytes) -> Response {
    let mut response = Response::new(Body::from(png));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("image/png"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// The answer with an object, which is patient data.
fn object(name: &str, file: Bytes) -> Response {
    let mut response = Response::new(Body::from(file));
    let headers = response.headers_mut();
    let kind = HeaderValue::from_static("application/dicom");
    headers.insert(header::CONTENT_TYPE, kind);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let name = HeaderValue::from_str(&format!("attachment; filename=\"{name}.dcm\""));
    if let Ok(name) = name {
        headers.insert(header::CONTENT_DISPOSITION, name);
    }
    response
}

/// Get a result that is sent
#[utoipa::path(
    get, path = "/v1/dicom-results/{id}", tag = "pacs",
    params(("id" = String, Path, description = "The result")),
    responses(
        (status = 200, description = "How far it is", body = ResultView),
        (status = 404, description = "No such result"),
    )
)]
pub(crate) async fn get_result(
    State(pacs): State<Pacs>,
    Path(id): Path<String>,
) -> Result<Response, AppError> {
    let missing = || {
        AppError::not_found(
            "no-such-result",
            "there is no result with this id; results are forgotten after some days",
        )
    };
    if !is_id(&id) {
        return Err(missing());
    }
    let result = pacs.store().result(&id).await?;
    let view = ResultView::from(result.ok_or_else(missing)?);
    Ok(fresh_json(StatusCode::OK, &view))
}
