//! Uploads: streamed to the store's disk, checked, queued.

use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use utoipa::ToSchema;

use super::cases::{CaseView, address_of, fresh_json};
use super::query::{ApiQuery, NoQuery};
use crate::caching;
use crate::case::{CaseId, CaseState, Parameters};
use crate::prepare::{Source, check};
use crate::problem::{AppError, Problem};
use crate::state::AppState;
use crate::store::{Spooled, Submitted, Upload};

/// The most bytes of the part `parameters`.
const MAX_PARAMETERS_BYTES: usize = 64 << 10;

/// Seconds after which it is worth asking for a new case.
const RETRY_SECONDS: HeaderValue = HeaderValue::from_static("1");

/// The parts of an upload.
#[derive(Debug, ToSchema)]
pub struct UploadForm {
    /// The MR volume: NIfTI-1 or NIfTI-2, `.nii` or `.nii.gz`.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    volume: String,
    /// The brain mask, in NIfTI, on any grid. Not needed where the volume holds nothing but the brain.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    mask: Option<String>,
    /// JSON: `closing_radius_mm` (0 to 50), `mask` (where none is supplied: `auto` or `volume`), `mask_kind` (`brain` or
    /// `envelope`), `threshold` (0.05 to 0.95), `offset_mm` (-20 to 20), and `name`, a label.
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    parameters: Option<String>,
}

/// Upload a volume
///
/// It is read and checked at once; its preparation is queued. The same input and parameters again are the same case.
#[utoipa::path(
    post, path = "/v1/cases", tag = "cases",
    request_body(content = UploadForm, content_type = "multipart/form-data"),
    responses(
        (status = 202, description = "A new case", body = CaseView, headers(
            ("Location" = String, description = "Where it is"), ("Retry-After" = u32, description = "Seconds after which to look"),
        )),
        (status = 200, description = "The case was there already", body = CaseView),
        (status = 400, description = "The form cannot be read", body = Problem, content_type = "application/problem+json"),
        (status = 401, description = "A token is wanted", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "The body is too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "It is no form", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "The volume or mask cannot be used", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many cases wait", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_case(
    State(state): State<AppState>,
    _no_query: ApiQuery<NoQuery>,
    request: Request,
) -> Result<Response, AppError> {
    refuse_early(request.headers(), state.max_upload_bytes)?;
    let form = Multipart::from_request(request, &state)
        .await
        .map_err(|_| AppError::UnsupportedMediaType)?;
    let (upload, parameters) = read_form(&state, form).await?;
    parameters.check()?;
    check_unless_known(&state, &upload, &parameters).await?;
    Ok(submitted(
        state.store.submit_upload(upload, parameters).await?,
    ))
}

/// The answer that names a case: 202 where it is new.
pub(super) fn submitted(submitted: Submitted) -> Response {
    let status = if submitted.created {
        StatusCode::ACCEPTED
    } else {
        StatusCode::OK
    };
    let address = address_of(&submitted.case.id);
    let mut response: Response<Body> = fresh_json(status, &CaseView::from(submitted.case));
    let headers = response.headers_mut();
    caching::insert(headers, header::LOCATION, &address);
    if submitted.created {
        headers.insert(header::RETRY_AFTER, RETRY_SECONDS);
    }
    response
}

/// Refuses at once what cannot be prepared, so that nothing of it gets into the store. What is in the store was checked before.
async fn check_unless_known(
    state: &AppState,
    upload: &Upload,
    parameters: &Parameters,
) -> Result<(), AppError> {
    let mask = upload.mask.as_ref().map(Spooled::digest);
    let id = CaseId::of(upload.volume.digest(), mask, parameters);
    if is_known(state, &id).await? {
        return Ok(());
    }
    let source = Source {
        volume: upload.volume.read().await?,
        mask: match &upload.mask {
            Some(mask) => Some(mask.read().await?),
            None => None,
        },
        ..Source::default()
    };
    check_now(state, source, parameters).await
}

/// Whether a case was accepted before.
pub(super) async fn is_known(state: &AppState, id: &CaseId) -> Result<bool, AppError> {
    let known = state.store.case(id).await?;
    Ok(known.is_some_and(|case| case.state != CaseState::Failed))
}

/// Refuses what cannot be prepared.
pub(super) async fn check_now(
    state: &AppState,
    source: Source,
    parameters: &Parameters,
) -> Result<(), AppError> {
    let (limits, parameters) = (state.upload_limits, parameters.clone());
    let check = move || check(&source, &parameters, &limits);
    Ok(state.pool.run(check).await??)
}

/// Refuses what can be refused before the body is read.
fn refuse_early(headers: &HeaderMap, limit_bytes: u64) -> Result<(), AppError> {
    if !is_form(headers) {
        return Err(AppError::UnsupportedMediaType);
    }
    refuse_too_large(headers, limit_bytes)
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Whether a body is said to be a form.
pub(super) fn is_form(headers: &HeaderMap) -> bool {
    text(headers, header::CONTENT_TYPE)
        .is_some_and(|kind| kind.to_ascii_lowercase().starts_with("multipart/form-data"))
}

/// Refuses a body that is said to be too large.
pub(super) fn refuse_too_large(headers: &HeaderMap, limit_bytes: u64) -> Result<(), AppError> {
    let length: Option<u64> =
        text(headers, header::CONTENT_LENGTH).and_then(|length| length.parse().ok());
    let limit_of_form = limit_bytes.saturating_add(super::FORM_OVERHEAD_BYTES);
    if length.is_some_and(|length| length > limit_of_form) {
        return Err(AppError::TooLarge { limit_bytes });
    }
    Ok(())
}

/// Reads the parts in whatever order they come.
async fn read_form(
    state: &AppState,
    mut form: Multipart,
) -> Result<(Upload, Parameters), AppError> {
    let limits = PartLimits::of(state);
    let (mut volume, mut mask, mut parameters) = (None, None, None);
    while let Some(field) = in_time(limits, form.next_field()).await? {
        let name = field.name().unwrap_or_default().to_owned();
        match name.as_str() {
            "volume" => set_once(&mut volume, &name, spool(state, limits, field).await?)?,
            "mask" => set_once(&mut mask, &name, spool(state, limits, field).await?)?,
            "parameters" => {
                set_once(
                    &mut parameters,
                    &name,
                    read_parameters(limits, field).await?,
                )?;
            }
            "dicom" => {
                return Err(AppError::NotImplemented {
                    what: "reading DICOM",
                });
            }
            _ => return Err(unknown_part()),
        }
    }
    let volume = volume.ok_or_else(|| AppError::Upload {
        kind: "volume-missing",
        detail: "the form has no part named `volume`".to_owned(),
    })?;
    Ok((Upload { volume, mask }, parameters.unwrap_or_default()))
}

/// The name is not repeated: it may be anything, such as a patient's.
fn unknown_part() -> AppError {
    AppError::Upload {
        kind: "unknown-part",
        detail: "the form has a part that is none of `volume`, `mask` and `parameters`".to_owned(),
    }
}

fn set_once<T>(slot: &mut Option<T>, name: &str, value: T) -> Result<(), AppError> {
    if slot.is_some() {
        return Err(AppError::Upload {
            kind: "part-twice",
            detail: format!("the form has two parts named `{name}`"),
        });
    }
    *slot = Some(value);
    Ok(())
}

/// What an upload may take.
#[derive(Clone, Copy)]
pub(super) struct PartLimits {
    /// Bytes of a file.
    pub(super) bytes: u64,
    /// Time until the next bytes come.
    idle: Duration,
    /// Time for the whole upload.
    whole: Duration,
    /// When that is over.
    end: Instant,
}

impl PartLimits {
    /// Those of an upload that begins now.
    pub(super) fn of(state: &AppState) -> Self {
        Self {
            bytes: state.max_upload_bytes,
            idle: state.upload_idle,
            whole: state.upload_timeout,
            end: Instant::now() + state.upload_timeout,
        }
    }

    /// Waits for the next piece of an upload, but not for ever.
    pub(super) async fn await_next<T>(
        &self,
        piece: impl Future<Output = T>,
    ) -> Result<T, AppError> {
        let left = self.end.saturating_duration_since(Instant::now());
        let wait = self.idle.min(left);
        let piece = tokio::time::timeout(wait, piece).await;
        piece.map_err(|_elapsed| {
            let detail = if wait < self.idle {
                format!("the upload took more than {} seconds", self.whole.as_secs())
            } else {
                format!("nothing more came for {} seconds", self.idle.as_secs())
            };
            AppError::Upload {
                kind: "upload-stalled",
                detail,
            }
        })
    }

    /// The answer to a body that cannot be read any further.
    pub(super) fn too_large(&self) -> AppError {
        AppError::TooLarge {
            limit_bytes: self.bytes,
        }
    }
}

/// Waits for the next piece of the form.
async fn in_time<T>(
    limits: PartLimits,
    piece: impl Future<Output = Result<T, MultipartError>>,
) -> Result<T, AppError> {
    limits
        .await_next(piece)
        .await?
        .map_err(|error| match error.status() {
            StatusCode::PAYLOAD_TOO_LARGE => limits.too_large(),
            _ => AppError::Upload {
                kind: "form-unreadable",
                detail: "the form cannot be read; was the upload cut off?".to_owned(),
            },
        })
}

/// Streams a part to the store's disk.
async fn spool(
    state: &AppState,
    limits: PartLimits,
    mut field: Field<'_>,
) -> Result<Spooled, AppError> {
    let mut spool = state.store.spool().await?;
    while let Some(bytes) = in_time(limits, field.chunk()).await? {
        if spool.len() + bytes.len() as u64 > limits.bytes {
            return Err(limits.too_large());
        }
        state.metrics.uploaded(bytes.len());
        spool.write(bytes).await?;
    }
    Ok(spool.finish().await?)
}

async fn read_parameters(limits: PartLimits, mut field: Field<'_>) -> Result<Parameters, AppError> {
    let mut text = Vec::new();
    while let Some(bytes) = in_time(limits, field.chunk()).await? {
        if text.len() + bytes.len() > MAX_PARAMETERS_BYTES {
            return Err(AppError::TooLarge {
                limit_bytes: MAX_PARAMETERS_BYTES as u64,
            });
        }
        text.extend_from_slice(&bytes);
    }
    // By way of an object, because a list of the values in order would be taken as well.
    let object = serde_json::from_slice(&text).map(serde_json::Value::Object);
    object
        .and_then(serde_json::from_value)
        .map_err(|error| AppError::Upload {
            kind: "parameters-unreadable",
            detail: format!("the part `parameters` cannot be read: {error}"),
        })
}
