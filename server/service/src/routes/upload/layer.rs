//! The upload of a layer.

use axum::extract::multipart::Multipart;
use axum::extract::{FromRequest as _, Request, State};
use axum::response::Response;
use case::{Contrast, LayerKind, LayerParameters, Transform};
use cases::dicom::{Options, Purpose};
use cases::layers::ReceivedLayer;
use cases::{Cases, VolumeFiles};
use serde::Deserialize;
use utoipa::ToSchema;

use super::form::{only_one, read_parameters, set_once, take_options, unknown_part_of, unreadable};
use super::parts::{DicomParts, Incoming};
use super::refuse_early;
use crate::routes::asked::CasePath;
use crate::routes::layers::{LayerView, address_of};
use crate::state::Uploads;
use http::form_body::HeaderBudget;
use http::fresh::made_at;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};
use http::sent::from_json;

/// The most bytes of the names of labels.
const MAX_LABELS_BYTES: usize = 256 << 10;

/// The parts of the upload of a layer.
#[derive(Debug, ToSchema)]
#[expect(dead_code, reason = "describes the form; parts are read one by one")]
pub struct LayerForm {
    /// The volume: NIfTI or MGH, gzipped or not; or a zip of DICOM files, or one (multi-frame) DICOM file:
    /// MR, CT or PET.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    volume: Option<String>,
    /// DICOM files of a series, one per part, or zips of them, instead of `volume`.
    #[schema(format = Binary, content_media_type = "application/dicom")]
    dicom: Option<Vec<String>>,
    /// The names of labels, a text file: a line for each, with its number and its name.
    #[schema(format = Binary, content_media_type = "text/plain")]
    labels: Option<String>,
    /// JSON: `name`, unique in the case; `kind` (`mr`, `ct`, `pet`, `map` or `labels`; by default from DICOM, otherwise
    /// `mr`); `unit`; `contrast` of an MR (`t1`, `t2`, `flair` or `other`; by default from DICOM, otherwise from the name);
    /// `transform` (`auto`, `none`, `rigid`, or 4 rows of 4 numbers: the rigid `case_from_layer`, LPS
    /// mm). For DICOM files also `series` and `allow_gaps`, and for NIfTI files `affine`, as for cases.
    parameters: Option<String>,
}

/// The part `parameters`, besides the choice among DICOM files.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SentParameters {
    name: Option<String>,
    kind: Option<LayerKind>,
    unit: Option<String>,
    contrast: Option<Contrast>,
    transform: Transform,
}

/// Add a layer
///
/// A further volume of the same head: FLAIR, T2, PET, CT, a map or labels of another program. It is read and checked at
/// once; its preparation, which finds its place, is queued. The same volume and parameters always give the same layer.
#[utoipa::path(
    post, path = "/v1/cases/{id}/layers", tag = "layers",
    params(("id" = String, Path, description = "The case")),
    request_body(content = LayerForm, content_type = "multipart/form-data"),
    responses(
        (status = 202, description = "A new layer", body = LayerView, headers(
            ("Location" = String, description = "The address of the layer"), ("Retry-After" = u32, description = "Seconds to wait before the first request for its state"),
        )),
        (status = 200, description = "The layer already exists", body = LayerView),
        (status = 400, description = "The form cannot be read"),
        (status = 409, description = "The case has too many layers, or another layer has the name"),
        (status = 413, description = "The body is too large"),
        (status = 415, description = "The body is not a form, or its volume is neither NIfTI nor DICOM"),
        (status = 422, description = "The volume cannot be used, or it is of another patient than the case (`layer-of-another-patient`): both are from DICOM, and differ in patient id, issuer or date of birth; or the PACS has rejected its images (`images-rejected`)"),
        (status = 503, description = "Too much work is waiting"),
        (status = 507, description = "The disk of the server is full (`storage-full`) or failed (`storage-failed`); nothing was stored"),
    )
)]
pub async fn create_layer(
    State(cases): State<Cases>,
    State(uploads): State<Uploads>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: Request,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    refuse_early(request.headers(), uploads.limits.max_bytes)?;
    let _room = uploads.begin(&request)?;
    let incoming = Incoming::begin(cases.store(), &uploads).await?;
    let Received {
        volume,
        labels,
        sent,
        options,
    } = read(&incoming, request).await?;
    let parameters = LayerParameters {
        transform: sent.transform,
        labels: LayerParameters::parse_labels(&labels)?,
        contrast: sent.contrast,
        ..LayerParameters::default()
    };
    let new = ReceivedLayer {
        case: id,
        volume,
        options,
        name: sent.name,
        kind: sent.kind,
        unit: sent.unit,
        parameters,
    };
    let (added, choice) = cases.add_layer(new).await?;
    let address = address_of(&added.layer);
    let view = LayerView::of_layer(&added.layer).choosing(choice);
    Ok(made_at(&address, added.created, &view))
}

/// A form, read to its end.
struct Received {
    volume: VolumeFiles,
    labels: String,
    sent: SentParameters,
    options: Options,
}

async fn read(incoming: &Incoming<'_>, request: Request) -> Result<Received, AppError> {
    let budget = HeaderBudget::default();
    let request = request.map(|body| budget.watch(body));
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|_| AppError::not_a_form())?;
    let (mut volume, mut labels, mut sent) = (None, None, None);
    let mut dicom = DicomParts::default();
    while let Some(field) = incoming.in_time(form.next_field()).await? {
        budget.end_header();
        let name = field.name().unwrap_or_default().to_owned();
        match name.as_str() {
            "volume" => set_once(&mut volume, &name, incoming.spool(field).await?)?,
            "dicom" => dicom.add(incoming, field).await?,
            "labels" => {
                let text = incoming.short(field, MAX_LABELS_BYTES).await?;
                let too_large =
                    || format!("the part `labels` is larger than {MAX_LABELS_BYTES} bytes");
                let text = text.ok_or_else(|| AppError::part_too_large(too_large()))?;
                set_once(&mut labels, &name, text)?;
            }
            "parameters" => {
                set_once(&mut sent, &name, read_parameters(incoming, field).await?)?;
            }
            _ => {
                return Err(unknown_part_of(
                    "`volume`, `dicom`, `labels` and `parameters`",
                ));
            }
        }
        budget.begin_header();
    }
    let mut object = sent.unwrap_or_default();
    let options = take_options(&mut object)?;
    let sent = from_json(serde_json::Value::Object(object));
    let labels = String::from_utf8(labels.unwrap_or_default());
    let labels = labels.map_err(|_| {
        AppError::bad_request("labels-unreadable", "the part `labels` is not UTF-8 text")
    })?;
    Ok(Received {
        volume: only_one(volume, dicom.into_directory())?,
        labels,
        sent: sent.map_err(|(path, refusal)| unreadable(&path, &refusal))?,
        options: Options {
            purpose: Purpose::Layer,
            ..options
        },
    })
}
