//! The upload of a layer.

use axum::extract::multipart::Multipart;
use axum::extract::{FromRequest as _, Request, State};
use axum::response::Response;
use case::{Contrast, LayerKind, LayerParameters, Transform};
use cases::dicom::{Options, Purpose, Space};
use cases::layers::{ReceivedLayer, ReceivedSurfaces};
use cases::{Cases, VolumeFiles};
use serde::Deserialize;
use storage::Spooled;
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
    /// Instead of a volume, a surface with values, or both hemispheres as two parts: a binary surface of FreeSurfer, or GIFTI. Up to four surfaces
    /// without values (white and pial of both hemispheres) are drawn themselves, as labels numbered from 1.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    surface: Option<Vec<String>>,
    /// The values of each surface, in the same order: a `curv` file, an overlay in an MGH file or an annotation of FreeSurfer, or GIFTI. Absent if
    /// the GIFTI files of the surfaces have them, or if the surfaces themselves are drawn.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    values: Option<Vec<String>>,
    /// The T1 that the surface of FreeSurfer belongs to (mri/T1.mgz or mri/orig.mgz), if the footer of the surface does not state its place in
    /// the scanner. Only its header is used.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    t1: Option<String>,
    /// The names of labels, a text file: a line for each, with its number and its name.
    #[schema(format = Binary, content_media_type = "text/plain")]
    labels: Option<String>,
    /// JSON: `name`, unique in the case; `kind` (`mr`, `ct`, `pet`, `map` or `labels`; by default from DICOM, from the
    /// values of surfaces, otherwise `mr`); `unit`; `contrast` of an MR (`t1`, `t2`, `flair` or `other`; by default from DICOM, otherwise from the name);
    /// `transform` (`auto`, `none`, `rigid`, or 4 rows of 4 numbers: the rigid `case_from_layer`, LPS
    /// mm). For DICOM files also `series` and `allow_gaps`, and for NIfTI files `affine`, as for cases. For surfaces `column`, the number
    /// of the values in a file with several, from 1; and `space`, `scanner` or `tkregister`, if the files do not state what their
    /// coordinates are.
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
    column: Option<usize>,
    space: Option<Space>,
}

/// Add a layer
///
/// A further volume of the same head: FLAIR, T2, PET, CT, a map or labels of another program; or values on a surface of its cortex, which
/// become a thin sheet of voxels in the grid of the case, which must be ready. It is read and checked at
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
        (status = 404, description = "There is no such case"),
        (status = 409, description = "The case has too many layers, or another layer has the name; or surfaces are sent, and the case is not ready (`case-not-ready`)"),
        (status = 413, description = "The body is too large, or a surface is (`surface-too-large`)"),
        (status = 415, description = "The body is not a form, its volume is neither NIfTI, MGH nor DICOM, or its surface or values are neither FreeSurfer's nor GIFTI (`surface-not-recognised`)"),
        (status = 422, description = "The volume cannot be used, or it is of another patient than the case (`layer-of-another-patient`): both are from DICOM, and differ in patient id, issuer or date of birth; or the PACS has rejected its images (`images-rejected`). Of surfaces: a file is damaged (`surface-damaged`) or has what is not supported (`surface-unsupported`), the values are missing (`values-missing`), have several columns (`values-column`) or are of another surface (`values-of-another-surface`), a label has different names in the files (`labels-differ`), the place in the scanner is not known (`surface-space-unknown`), nothing lies in the head (`layer-outside-head`), or a parameter does not fit surfaces (`surface-parameters`)"),
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
        files,
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
    let new = match files {
        Files::Volume(_) if sent.column.is_some() || sent.space.is_some() => {
            let known = &"and `space` are only accepted for surfaces";
            return Err(unreadable("column", known));
        }
        Files::Volume(volume) => ReceivedLayer {
            case: id,
            volume,
            options,
            name: sent.name,
            kind: sent.kind,
            unit: sent.unit,
            parameters,
        },
        Files::Surfaces(..) if options != OF_LAYER => {
            let detail = "`series`, `allow_gaps` and `affine` are only accepted for volumes; the form has a surface";
            return Err(AppError::bad_request("parameters-unreadable", detail));
        }
        Files::Surfaces(files, t1) => {
            let surfaces = ReceivedSurfaces {
                case: id,
                files,
                t1,
                space: sent.space,
                column: sent.column,
                name: sent.name,
                kind: sent.kind,
                unit: sent.unit,
                parameters,
            };
            cases.draw_surfaces(surfaces).await?
        }
    };
    let (added, choice) = cases.add_layer(new).await?;
    let address = address_of(&added.layer);
    let view = LayerView::of_layer(&added.layer).choosing(choice);
    Ok(made_at(&address, added.created, &view))
}

/// A form, read to its end.
struct Received {
    files: Files,
    labels: String,
    sent: SentParameters,
    options: Options,
}

/// What a layer is made of.
enum Files {
    Volume(VolumeFiles),
    /// Surfaces with their values, and the T1 that they belong to.
    Surfaces(Vec<(Spooled, Option<Spooled>)>, Option<Spooled>),
}

/// The choice among the files of a volume, where there is none.
const OF_LAYER: Options = Options {
    series: None,
    allow_gaps: false,
    purpose: Purpose::Layer,
    deidentifies: false,
    form: None,
};

/// The most surfaces of a layer: white and pial of both hemispheres.
const MAX_SURFACES: usize = 4;

/// The parts of surfaces.
#[derive(Default)]
struct SurfaceParts {
    surfaces: Vec<Spooled>,
    values: Vec<Spooled>,
    t1: Option<Spooled>,
}

impl SurfaceParts {
    fn are_none(&self) -> bool {
        self.surfaces.is_empty() && self.values.is_empty() && self.t1.is_none()
    }

    fn into_files(self) -> Result<Files, AppError> {
        let (surfaces, values) = (self.surfaces.len(), self.values.len());
        if !(1..=MAX_SURFACES).contains(&surfaces) || (values != surfaces && values != 0) {
            let detail = format!(
                "the form has {surfaces} parts `surface` and {values} parts `values`; send 1 to {MAX_SURFACES} surfaces and as many `values`, or none if the \
                 GIFTI files of the surfaces have them, or to draw the surfaces themselves"
            );
            return Err(AppError::bad_request("surface-parts", detail));
        }
        let values = self.values.into_iter().map(Some);
        let values = values.chain(std::iter::repeat_with(|| None));
        let files = self.surfaces.into_iter().zip(values).collect();
        Ok(Files::Surfaces(files, self.t1))
    }
}

async fn read(incoming: &Incoming<'_>, request: Request) -> Result<Received, AppError> {
    let budget = HeaderBudget::default();
    let request = request.map(|body| budget.watch(body));
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|_| AppError::not_a_form())?;
    let (mut volume, mut labels, mut sent) = (None, None, None);
    let (mut dicom, mut surfaces) = (DicomParts::default(), SurfaceParts::default());
    while let Some(field) = incoming.in_time(form.next_field()).await? {
        budget.end_header();
        let name = field.name().unwrap_or_default().to_owned();
        match name.as_str() {
            "volume" => set_once(&mut volume, &name, incoming.spool(field).await?)?,
            "dicom" => dicom.add(incoming, field).await?,
            "surface" if surfaces.surfaces.len() < MAX_SURFACES => {
                surfaces.surfaces.push(incoming.spool(field).await?);
            }
            "values" if surfaces.values.len() < MAX_SURFACES => {
                surfaces.values.push(incoming.spool(field).await?);
            }
            "t1" => set_once(&mut surfaces.t1, &name, incoming.spool(field).await?)?,
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
            "surface" | "values" => {
                let detail = format!("the form has more than {MAX_SURFACES} parts `{name}`");
                return Err(AppError::bad_request("surface-parts", detail));
            }
            _ => {
                return Err(unknown_part_of(
                    "`volume`, `dicom`, `surface`, `values`, `t1`, `labels` and `parameters`",
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
    let (dicom, has_surfaces) = (dicom.into_directory(), !surfaces.are_none());
    if has_surfaces && (volume.is_some() || dicom.is_some()) {
        let detail = "the form has both a volume and a surface; send only one of them";
        return Err(AppError::bad_request("volume-twice", detail));
    }
    let files = match has_surfaces {
        true => surfaces.into_files()?,
        false => Files::Volume(only_one(volume, dicom)?),
    };
    Ok(Received {
        files,
        labels,
        sent: sent.map_err(|(path, refusal)| unreadable(&path, &refusal))?,
        options: Options {
            purpose: OF_LAYER.purpose,
            ..options
        },
    })
}
