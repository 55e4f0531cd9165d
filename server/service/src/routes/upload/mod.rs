//! Uploads: streamed to the disk of the store, checked, queued.

mod form;
pub mod layer;
mod parts;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use case::MaskSource;
use cases::dicom::Choice;
use cases::{Cases, VolumeFiles};
use storage::Submitted;
use utoipa::ToSchema;

use self::form::Form;
use super::cases::{CaseView, address_of};
use crate::state::Uploads;
use http::fresh::made_at;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};

pub(super) use self::parts::Incoming;

/// The parts of an upload.
#[derive(Debug, ToSchema)]
#[expect(dead_code, reason = "describes the form; parts are read one by one")]
pub struct UploadForm {
    /// The MR volume: NIfTI or MGH, gzipped or not; a zip of DICOM files, or one (multi-frame) DICOM file; or a zip of the folder of a
    /// FreeSurfer or FastSurfer subject, whose brain becomes the mask, and whose surfaces and regions become layers.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    volume: Option<String>,
    /// DICOM files of a series, one per part, or zips of them, instead of `volume`; or the files of a FreeSurfer or FastSurfer subject, each with its
    /// path below the folder as the file name, such as `mri/T1.mgz`. No other file name is looked at.
    #[schema(format = Binary, content_media_type = "application/dicom")]
    dicom: Option<Vec<String>>,
    /// The brain mask, NIfTI, on any grid. Not needed if the volume is skull-stripped or the brain is to be extracted.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    mask: Option<String>,
    /// JSON: `closing_radius_mm` (0 to 50), `mask` (if none is supplied: `auto`, `volume`, `network` or `pruning`),
    /// `mask_kind` (`brain` or `envelope`), `threshold` (0.05 to 0.95), `offset_mm` (-20 to 20), and `name`, a label.
    /// For DICOM files also `series`, the number, instance UID or token of the series to read, and `allow_gaps`: true
    /// interpolates single missing slices and lists them. For NIfTI files `affine`, `sform` or `qform`: which form of the headers of
    /// volume and mask is true, if they contradict each other. A case that has a label keeps it, unless `keep_name` is false. DICOM
    /// files without `name` are named after their series.
    parameters: Option<String>,
}

/// Upload a volume
///
/// The volume is read and checked at once, and its preparation is queued. The same input and parameters always give the
/// same case.
#[utoipa::path(
    post, path = "/v1/cases", tag = "cases",
    request_body(content = UploadForm, content_type = "multipart/form-data"),
    responses(
        (status = 202, description = "A new case", body = CaseView, headers(
            ("Location" = String, description = "The address of the case"), ("Retry-After" = u32, description = "Seconds to wait before the first request for its state"),
        )),
        (status = 200, description = "The case already exists", body = CaseView),
        (status = 400, description = "The form cannot be read"),
        (status = 413, description = "The body is too large"),
        (status = 415, description = "The body is not a form"),
        (status = 422, description = "The volume or mask cannot be used; or a file of a subject cannot, which `detail` names, with the types of surfaces as layers"),
        (status = 501, description = "The request needs the network, whose weights are not installed (`network-missing`)"),
        (status = 503, description = "Too many cases are waiting"),
        (status = 507, description = "The disk of the server is full (`storage-full`) or failed (`storage-failed`); nothing was stored"),
    )
)]
pub async fn create_case(
    State(cases): State<Cases>,
    State(uploads): State<Uploads>,
    _no_query: ApiQuery<NoQuery>,
    request: Request,
) -> Result<Response, AppError> {
    refuse_early(request.headers(), uploads.limits.max_bytes)?;
    let _room = uploads.begin(&request)?;
    let incoming = Incoming::begin(cases.store(), &uploads).await?;
    let Form {
        mut volume,
        mut mask,
        sent,
    } = Form::read(&incoming, request).await?;
    // Before the DICOM files are read, which takes long.
    sent.parameters.check()?;
    let mut layers = Vec::new();
    if let Some(subject) = cases.subject(&volume).await? {
        volume = VolumeFiles::One(subject.volume);
        // A mask that was sent, or a method, counts more.
        if sent.parameters.mask == MaskSource::default() {
            mask = mask.or(subject.mask);
        }
        layers = subject.layers;
    }
    let (upload, choice) = cases.upload(volume, mask, &sent.options).await?;
    let of_dicom = sent.options.series.is_some() || sent.options.allow_gaps;
    if choice.is_none() && of_dicom {
        return Err(not_of_nifti());
    }
    if choice.is_some() && sent.options.form.is_some() && upload.mask.is_none() {
        return Err(not_of_dicom());
    }
    let accepted = cases.submit(upload, sent.parameters, sent.renames).await?;
    cases.add_subject(&accepted.case.id, layers).await?;
    Ok(submitted(accepted, choice))
}

/// The answer with a case and the choice among DICOM files: 202 if the case is new.
pub(super) fn submitted(submitted: Submitted, choice: Option<Choice>) -> Response {
    let address = address_of(&submitted.case.id);
    let view = CaseView::from(submitted.case).choosing(choice);
    made_at(&address, submitted.created, &view)
}

fn not_of_nifti() -> AppError {
    let detail =
        "`series` and `allow_gaps` are only accepted for DICOM files; `volume` is not DICOM";
    AppError::bad_request("parameters-unreadable", detail)
}

fn not_of_dicom() -> AppError {
    let detail = "`affine` is only accepted for NIfTI files; `volume` is DICOM";
    AppError::bad_request("parameters-unreadable", detail)
}

/// Rejects a request before its body is read, if possible.
fn refuse_early(headers: &HeaderMap, limit_bytes: u64) -> Result<(), AppError> {
    if !is_form(headers) {
        return Err(AppError::not_a_form());
    }
    refuse_too_large(headers, limit_bytes)
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Whether the headers announce a form.
pub(super) fn is_form(headers: &HeaderMap) -> bool {
    text(headers, header::CONTENT_TYPE)
        .is_some_and(|kind| kind.to_ascii_lowercase().starts_with("multipart/form-data"))
}

/// Rejects a body with too large an announced length.
pub(super) fn refuse_too_large(headers: &HeaderMap, limit_bytes: u64) -> Result<(), AppError> {
    let length: Option<u64> =
        text(headers, header::CONTENT_LENGTH).and_then(|length| length.parse().ok());
    let limit_of_form = limit_bytes.saturating_add(super::FORM_OVERHEAD_BYTES);
    if length.is_some_and(|length| length > limit_of_form) {
        return Err(AppError::too_large(limit_bytes));
    }
    Ok(())
}
