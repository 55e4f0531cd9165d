//! Uploads: streamed to the store's disk, checked, queued.

use std::path::Path;
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::Response;
use imaging::{Format, sniff};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;
use utoipa::ToSchema;

use super::cases::{CaseView, address_of, fresh_json};
use super::query::{ApiQuery, NoQuery};
use super::refusals::without_input;
use crate::conditional;
use crate::form_body::HeaderBudget;
use crate::pace::is_too_slow;
use crate::problem::{AppError, Problem};
use crate::state::Uploads;
use case::{CaseId, CaseState, Parameters};
use cases::Cases;
use cases::dicom::{Choice, Options, Reading, SeriesName};
use pipeline::{Source, check};
use storage::{Spooled, StoreError, Submitted, Upload};

/// The most bytes of the part `parameters`.
const MAX_PARAMETERS_BYTES: usize = 64 << 10;

/// The most parts named `dicom`: a series has a few hundred.
const MAX_DICOM_PARTS: usize = 20_000;

/// What tells the kind of a file, packed or not.
const SNIFFED_BYTES: u64 = 64 << 10;

/// How much of a DICOM file is written at once.
const WRITE_BUFFER_BYTES: usize = 256 << 10;

/// Seconds after which it is worth asking for a new case.
const RETRY_SECONDS: HeaderValue = HeaderValue::from_static("1");

/// The parts of an upload.
#[derive(Debug, ToSchema)]
pub struct UploadForm {
    /// The MR volume: NIfTI-1 or NIfTI-2, `.nii` or `.nii.gz`; or a zip of DICOM files, or one (multi-frame) DICOM file.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    volume: Option<String>,
    /// DICOM files of a series, one a part, or zips of them, instead of `volume`.
    #[schema(format = Binary, content_media_type = "application/dicom")]
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    dicom: Vec<String>,
    /// The brain mask, in NIfTI, on any grid. Not needed where the volume holds nothing but the brain.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    #[expect(dead_code, reason = "describes the form; parts are read one by one")]
    mask: Option<String>,
    /// JSON: `closing_radius_mm` (0 to 50), `mask` (where none is supplied: `auto`, `volume`, `network` or `pruning`), `mask_kind` (`brain` or
    /// `envelope`), `threshold` (0.05 to 0.95), `offset_mm` (-20 to 20), and `name`, a label. Of DICOM
    /// files also `series`, the series to take by its number, instance UID or token, and `allow_gaps`: true interpolates
    /// single missing slices, and says which. `keep_name`: true leaves a case that is there already the label that it has.
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
        (status = 501, description = "The network is asked for, whose weights this server does not have (`network-missing`)", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many cases wait", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_case(
    State(cases): State<Cases>,
    State(uploads): State<Uploads>,
    _no_query: ApiQuery<NoQuery>,
    request: Request,
) -> Result<Response, AppError> {
    refuse_early(request.headers(), uploads.limits.max_bytes)?;
    let _room = uploads.begin()?;
    let form = read_form(&cases, &uploads, request).await?;
    let parameters = form.parameters.clone();
    parameters.check()?;
    let keep_name = form.keep_name;
    let (upload, choice) = form.into_upload(&cases).await?;
    let parameters = named(&cases, &upload, parameters, keep_name).await?;
    let parameters = check_unless_known(&cases, &upload, parameters).await?;
    let accepted = cases.store().submit_upload(upload, parameters).await?;
    Ok(submitted(accepted, choice))
}

/// The answer that names a case, and what was chosen among DICOM files: 202 where it is new.
pub(super) fn submitted(submitted: Submitted, choice: Option<Choice>) -> Response {
    let status = if submitted.created {
        StatusCode::ACCEPTED
    } else {
        StatusCode::OK
    };
    let address = address_of(&submitted.case.id);
    let mut response: Response<Body> =
        fresh_json(status, &CaseView::from(submitted.case).choosing(choice));
    let headers = response.headers_mut();
    conditional::insert(headers, header::LOCATION, &address);
    if submitted.created {
        headers.insert(header::RETRY_AFTER, RETRY_SECONDS);
    }
    response
}

/// Refuses at once what cannot be prepared, so that nothing of it gets into the store. What is in the store was checked before.
/// Answers the parameters with which it will be prepared.
async fn check_unless_known(
    cases: &Cases,
    upload: &Upload,
    parameters: Parameters,
) -> Result<Parameters, AppError> {
    let id = upload.case_id(&parameters);
    if is_known(cases, &id).await? {
        return Ok(parameters);
    }
    let start = upload.volume.head(SNIFFED_BYTES).await?;
    let _room = cases.room_to_check(&start).await?;
    // The same may have been accepted while this one waited.
    if is_known(cases, &id).await? {
        return Ok(parameters);
    }
    let source = Source {
        volume: upload.volume.read().await?,
        mask: match &upload.mask {
            Some(mask) => Some(mask.read().await?),
            None => None,
        },
        ..Source::default()
    };
    check_now(cases, source, parameters).await
}

/// The parameters, without their label where a case that is there already keeps its own.
async fn named(
    cases: &Cases,
    upload: &Upload,
    parameters: Parameters,
    keep_name: bool,
) -> Result<Parameters, AppError> {
    let id = upload.case_id(&parameters);
    let keeps = keep_name && cases.store().case(&id).await?.is_some();
    Ok(Parameters {
        name: parameters.name.filter(|_| !keeps),
        ..parameters
    })
}

/// Whether a case was accepted before.
pub(super) async fn is_known(cases: &Cases, id: &CaseId) -> Result<bool, AppError> {
    let known = cases.store().case(id).await?;
    Ok(known.is_some_and(|case| case.state != CaseState::Failed))
}

/// Refuses what cannot be prepared; the parameters with which it will be.
pub(super) async fn check_now(
    cases: &Cases,
    source: Source,
    parameters: Parameters,
) -> Result<Parameters, AppError> {
    let (limits, has_network) = (cases.library.limits(), cases.library.has_network());
    let check = move || check(&source, parameters, &limits, has_network);
    Ok(cases.queue.run(check).await??)
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
async fn read_form(cases: &Cases, uploads: &Uploads, request: Request) -> Result<Form, AppError> {
    let budget = HeaderBudget::default();
    let request = request.map(|body| budget.watch(body));
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|_| AppError::UnsupportedMediaType)?;
    let limits = PartLimits::of(uploads);
    let (mut volume, mut mask, mut parameters) = (None, None, None);
    let mut dicom = DicomParts::default();
    while let Some(field) = in_time(limits, form.next_field()).await? {
        budget.end_header();
        let name = field.name().unwrap_or_default().to_owned();
        match name.as_str() {
            "volume" => set_once(
                &mut volume,
                &name,
                spool(cases, uploads, limits, field).await?,
            )?,
            "mask" => set_once(
                &mut mask,
                &name,
                spool(cases, uploads, limits, field).await?,
            )?,
            "parameters" => {
                set_once(
                    &mut parameters,
                    &name,
                    read_parameters(limits, field).await?,
                )?;
            }
            "dicom" => dicom.add(cases, uploads, limits, field).await?,
            _ => return Err(unknown_part()),
        }
        budget.begin_header();
    }
    let volume = match (volume, dicom.directory) {
        (Some(volume), None) => Volume::File(volume),
        (None, Some(directory)) => Volume::Dicom(directory),
        (None, None) => {
            return Err(AppError::Upload {
                kind: "volume-missing",
                detail: "the form has no part named `volume`, and none named `dicom`".to_owned(),
            });
        }
        (Some(_), Some(_)) => {
            return Err(AppError::Upload {
                kind: "volume-twice",
                detail: "the form has parts named `volume` and `dicom`; send one or the other"
                    .to_owned(),
            });
        }
    };
    let SentParameters {
        parameters,
        options,
        keep_name,
    } = parameters.unwrap_or_default();
    Ok(Form {
        volume,
        mask,
        parameters,
        options,
        keep_name,
    })
}

/// A form, read to its end.
struct Form {
    volume: Volume,
    mask: Option<Spooled>,
    parameters: Parameters,
    options: Options,
    keep_name: bool,
}

/// The part `parameters`.
#[derive(Default)]
struct SentParameters {
    parameters: Parameters,
    /// What is to be chosen among DICOM files.
    options: Options,
    /// Whether a case that is there already keeps its label.
    keep_name: bool,
}

/// The volume as it was sent.
enum Volume {
    /// One file, of any kind.
    File(Spooled),
    /// DICOM files in a directory.
    Dicom(TempDir),
}

impl Form {
    /// DICOM files, which content tells, become a volume.
    async fn into_upload(self, cases: &Cases) -> Result<(Upload, Option<Choice>), AppError> {
        let options = &self.options;
        let reading = match self.volume {
            Volume::Dicom(directory) => read_dicom(cases, directory.path(), options).await?,
            Volume::File(file) => match sniff(&file.head(SNIFFED_BYTES).await?) {
                Format::Zip | Format::Dicom => read_dicom(cases, file.path(), options).await?,
                _ if *options != Options::default() => return Err(not_of_nifti()),
                _ => {
                    let upload = Upload {
                        volume: file,
                        mask: self.mask,
                        dicom: None,
                    };
                    return Ok((upload, None));
                }
            },
        };
        let upload = Upload {
            volume: cases.store().spool_all(reading.volume).await?,
            mask: self.mask,
            dicom: Some(cases.store().spool_all(reading.attributes).await?),
        };
        Ok((upload, Some(reading.choice)))
    }
}

async fn read_dicom(cases: &Cases, input: &Path, options: &Options) -> Result<Reading, AppError> {
    let scratch = cases.store().scratch();
    Ok(cases.dicom.read(input, options, &scratch).await?)
}

fn not_of_nifti() -> AppError {
    AppError::Upload {
        kind: "parameters-unreadable",
        detail: "`series` and `allow_gaps` are for DICOM files, and `volume` is none".to_owned(),
    }
}

/// DICOM files, one after the other, under numbers for names.
#[derive(Default)]
struct DicomParts {
    directory: Option<TempDir>,
    count: usize,
    bytes: u64,
}

impl DicomParts {
    async fn add(
        &mut self,
        cases: &Cases,
        uploads: &Uploads,
        limits: PartLimits,
        mut field: Field<'_>,
    ) -> Result<(), AppError> {
        if self.count == MAX_DICOM_PARTS {
            let detail = format!("the form has more than {MAX_DICOM_PARTS} parts named `dicom`");
            return Err(AppError::PartTooLarge { detail });
        }
        let directory = match &mut self.directory {
            Some(directory) => directory,
            empty => empty.insert(cases.store().spool_directory().await?),
        };
        let path = directory.path().join(self.count.to_string());
        self.count += 1;
        let disk = |error| AppError::from(StoreError::Disk(error));
        let file = tokio::fs::File::create_new(path).await.map_err(disk)?;
        let mut file = tokio::io::BufWriter::with_capacity(WRITE_BUFFER_BYTES, file);
        while let Some(bytes) = in_time(limits, field.chunk()).await? {
            self.bytes += bytes.len() as u64;
            if self.bytes > limits.bytes {
                let detail = format!(
                    "the parts named `dicom` are larger than the limit of {} bytes together",
                    limits.bytes
                );
                return Err(AppError::PartTooLarge { detail });
            }
            uploads.metrics.uploaded(bytes.len());
            file.write_all(&bytes).await.map_err(disk)?;
        }
        file.flush().await.map_err(disk)
    }
}

/// The name is not repeated: it may be anything, such as a patient's.
fn unknown_part() -> AppError {
    AppError::Upload {
        kind: "unknown-part",
        detail: "the form has a part that is none of `volume`, `dicom`, `mask` and `parameters`"
            .to_owned(),
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
    pub(super) fn of(uploads: &Uploads) -> Self {
        Self {
            bytes: uploads.limits.max_bytes,
            idle: uploads.limits.idle,
            whole: uploads.limits.whole,
            end: Instant::now() + uploads.limits.whole,
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
            _ if is_too_slow(&error) => too_slow(),
            _ => AppError::Upload {
                kind: "form-unreadable",
                detail: "the form cannot be read; was the upload cut off?".to_owned(),
            },
        })
}

/// The answer to a client that sends next to nothing.
pub(super) fn too_slow() -> AppError {
    AppError::Upload {
        kind: "upload-stalled",
        detail: "the upload came too slowly; send it again over a faster connection".to_owned(),
    }
}

/// Streams a part to the store's disk.
async fn spool(
    cases: &Cases,
    uploads: &Uploads,
    limits: PartLimits,
    mut field: Field<'_>,
) -> Result<Spooled, AppError> {
    let mut spool = cases.store().spool().await?;
    while let Some(bytes) = in_time(limits, field.chunk()).await? {
        if spool.len() + bytes.len() as u64 > limits.bytes {
            return Err(limits.too_large());
        }
        uploads.metrics.uploaded(bytes.len());
        spool.write(bytes).await?;
    }
    Ok(spool.finish().await?)
}

async fn read_parameters(
    limits: PartLimits,
    mut field: Field<'_>,
) -> Result<SentParameters, AppError> {
    let mut text = Vec::new();
    while let Some(bytes) = in_time(limits, field.chunk()).await? {
        if text.len() + bytes.len() > MAX_PARAMETERS_BYTES {
            let detail =
                format!("the part `parameters` is larger than {MAX_PARAMETERS_BYTES} bytes");
            return Err(AppError::PartTooLarge { detail });
        }
        text.extend_from_slice(&bytes);
    }
    let unreadable = |error: &dyn std::fmt::Display| AppError::Upload {
        kind: "parameters-unreadable",
        detail: format!(
            "the part `parameters` {}",
            without_input(&error.to_string())
        ),
    };
    // By way of an object, because a list of the values in order would be taken as well.
    let mut object: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(&text).map_err(|error| unreadable(&error))?;
    let options = take_options(&mut object).map_err(|what| unreadable(&what))?;
    let keep_name = take_flag(&mut object, "keep_name")
        .ok_or_else(|| unreadable(&"`keep_name` is true or false"))?;
    let parameters = serde_json::from_value(serde_json::Value::Object(object));
    Ok(SentParameters {
        parameters: parameters.map_err(|error| unreadable(&error))?,
        options,
        keep_name,
    })
}

/// Takes a flag out of the parameters: false where it is missing, `None` where it is neither true nor false.
fn take_flag(object: &mut serde_json::Map<String, serde_json::Value>, name: &str) -> Option<bool> {
    match object.remove(name) {
        None => Some(false),
        Some(value) => value.as_bool(),
    }
}

/// Takes out of the parameters what is no part of the preparation.
fn take_options(
    object: &mut serde_json::Map<String, serde_json::Value>,
) -> Result<Options, &'static str> {
    use serde_json::Value;
    let series = match object.remove("series") {
        None | Some(Value::Null) => None,
        Some(Value::Number(number)) => Some(number.to_string()),
        Some(Value::String(text)) => Some(text),
        Some(_) => return Err("`series` is a number or a text"),
    };
    let series = series.map(|text| SeriesName::parse(&text));
    if series == Some(None) {
        return Err("`series` is a number, an instance UID or a token of a series");
    }
    let allow_gaps = take_flag(object, "allow_gaps").ok_or("`allow_gaps` is true or false")?;
    Ok(Options {
        series: series.flatten(),
        allow_gaps,
    })
}
