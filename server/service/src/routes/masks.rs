//! Brain masks: download, replace, check.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use bytes::Bytes;
use cases::dicom::Form;
use cases::{Cases, Error};
use geometry::Mask;
use render::Scene;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::cases::CaseView;
use super::render::PNG;
use super::upload::{Incoming, is_form, refuse_too_large, submitted};
use crate::routes::asked::{CasePath, Question};
use crate::state::Uploads;
use case::{CaseFacts, CaseId, MaskKind, MaskSource, ObjectKind, Parameters};
use cases::pictures::window_of;
use http::conditional::{self, Content, Format};
use http::negotiate::{GZIP, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, Asked, NoQuery};
use pipeline::codec::{decode_brain, decode_envelope};
use storage::{NewMask, Spooled, Version};

/// The brain mask on the working grid
///
/// The mask before closing: on the working grid, one component without holes, moved by `offset_mm`. A gzipped NIfTI-1
/// file, positioned in the patient. Edit it over the volume with any program and upload it with `PUT`. If it is
/// unchanged, the version has the same meshes.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mask", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The mask: 1 in the brain, otherwise 0, in 8 bits (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The requested range"),
        (status = 409, description = "The case is not ready"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_mask(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let wanted = Wanted {
        route: "mask",
        kinds: &[ObjectKind::Mask],
        decode: |bytes| Some(decode_brain(bytes)?.mask().clone()),
    };
    answer(&cases, id, query.asked, &request, wanted).await
}

/// The envelope on the working grid
///
/// The closed mask, whose surface is at depth 0, as a gzipped NIfTI-1 file. Upload an edited one with `PUT
/// …/mask?kind=envelope`.
#[utoipa::path(
    get, path = "/v1/cases/{id}/envelope", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The envelope: 1 inside, otherwise 0, in 8 bits (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The requested range"),
        (status = 409, description = "The case is not ready"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_envelope(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let wanted = Wanted {
        route: "envelope",
        kinds: &[ObjectKind::Envelope],
        decode: |bytes| Some(decode_envelope(bytes)?.mask().clone()),
    };
    answer(&cases, id, query.asked, &request, wanted).await
}

struct Wanted {
    route: &'static str,
    kinds: &'static [ObjectKind],
    decode: fn(&[u8]) -> Option<Mask>,
}

async fn answer(
    cases: &Cases,
    id: CaseId,
    query: NoQuery,
    request: &HeaderMap,
    wanted: Wanted,
) -> Result<Response, AppError> {
    media_type(request, &[GZIP])?;
    let Wanted {
        route,
        kinds,
        decode,
    } = wanted;
    let question = Question::new(id, route, &query, request);
    let pack = move |_: &CaseFacts, payloads: &[Bytes]| {
        imaging::nifti::write_mask(&decode(payloads.first()?)?).ok()
    };
    let work = async |_| {
        let _turn = cases.queue.turn().await?;
        let file = cases.library.load(&id, kinds, pack).await?;
        let mut headers = HeaderMap::new();
        let name = format!("attachment; filename=\"{route}.nii.gz\"");
        conditional::insert(&mut headers, header::CONTENT_DISPOSITION, &name);
        Ok(Content {
            headers,
            ..Bytes::from(file.ok_or(Error::NoSuchCase)?).into()
        })
    };
    question.answer(cases, Format::of(GZIP), work).await
}

/// The differences between a version and its case.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct VersionQuery {
    /// What the mask contains: `brain`, which is closed, or `envelope`, which is not.
    #[param(inline)]
    kind: Option<MaskKind>,
    /// With an empty body: the source of the mask, instead of the mask that was supplied with the case.
    #[param(inline)]
    source: Option<MaskSource>,
    /// Radius of the ball that closes the mask, in mm; by default from the case.
    #[param(minimum = 0, maximum = 50)]
    closing_radius_mm: Option<f64>,
    /// The probability above which the network counts a voxel as brain; by default from the case.
    #[param(minimum = 0.05, maximum = 0.95)]
    threshold: Option<f64>,
    /// How far the surface of the mask is moved outwards before it is closed, in mm. The default is 0 with a mask in
    /// the body, because a downloaded mask is moved already; with an empty body, the default comes from the case.
    #[param(minimum = -20, maximum = 20)]
    offset_mm: Option<f64>,
    /// With a mask in the body: which form of its header is true, if they contradict each other.
    #[param(inline)]
    affine: Option<Affine>,
}

/// A form of a NIfTI header.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Affine {
    Sform,
    Qform,
}

impl From<Affine> for Form {
    fn from(affine: Affine) -> Self {
        match affine {
            Affine::Sform => Self::Sform,
            Affine::Qform => Self::Qform,
        }
    }
}

impl Asked for VersionQuery {
    /// The checked values. Missing ones come from the case.
    type Values = Self;

    fn checked(&self) -> Result<Self, AppError> {
        Parameters::check_numbers(self.closing_radius_mm, self.threshold, self.offset_mm)?;
        Ok(*self)
    }
}

impl VersionQuery {
    /// The parameters of the case, replaced by those of the query.
    fn over(&self, parameters: Parameters) -> Parameters {
        Parameters {
            closing_radius_mm: self
                .closing_radius_mm
                .unwrap_or(parameters.closing_radius_mm),
            mask: self.source.unwrap_or(parameters.mask),
            mask_kind: self.kind.unwrap_or(parameters.mask_kind),
            threshold: self.threshold.unwrap_or(parameters.threshold),
            offset_mm: self.offset_mm.unwrap_or(parameters.offset_mm),
            name: parameters.name,
        }
    }

    /// The version of a case with these parameters, and with the mask from the body if the body is not empty.
    fn version(&self, of: CaseId, case: Parameters, body: Spooled) -> Result<Version, AppError> {
        let body = Some(body).filter(|body| !body.is_empty());
        let (mask, base) = match (body, self.source) {
            (Some(_), Some(_)) => {
                let detail = "is only accepted with an empty body; otherwise the body is the mask";
                return Err(AppError::out_of_range("source", detail));
            }
            (Some(mask), None) => {
                let base = Parameters {
                    closing_radius_mm: case.closing_radius_mm,
                    ..Parameters::default()
                };
                (NewMask::Supplied(mask), base)
            }
            (None, Some(_)) => (NewMask::None, case),
            (None, None) => (NewMask::Kept, case),
        };
        Ok(Version {
            of,
            mask,
            parameters: self.over(base),
        })
    }
}

/// Make a version of a case, with another mask or other parameters
///
/// The body is a mask in NIfTI or MGH, gzipped or not, on any grid. With an empty body, the supplied mask of the case is used
/// again, or the mask is made again from `source`, so that only the parameters differ. The version is a case of its own
/// with the same volume and label, and the original case does not change; their `previous` and `next` name each other.
/// The same mask and parameters always give the same version. For both kinds of mask, the largest component is kept and
/// its holes are filled.
#[utoipa::path(
    put, path = "/v1/cases/{id}/mask", tag = "masks",
    params(("id" = String, Path, description = "The case"), VersionQuery),
    request_body(content = Option<Vec<u8>>, content_type = "application/octet-stream", description = "The mask, NIfTI or MGH, gzipped or not; or empty"),
    responses(
        (status = 202, description = "A new version", body = CaseView, headers(
            ("Location" = String, description = "The address of the case"), ("Retry-After" = u32, description = "Seconds to wait before the first request for its state"),
        )),
        (status = 200, description = "The version already exists", body = CaseView),
        (status = 400, description = "A key or value of the query is invalid, or the body stalled"),
        (status = 413, description = "The body is too large"),
        (status = 415, description = "The body is not a NIfTI file"),
        (status = 422, description = "The mask or a parameter cannot be used"),
        (status = 501, description = "The request needs the network, whose weights are not installed (`network-missing`)"),
        (status = 503, description = "Too many cases are waiting"),
        (status = 507, description = "The disk of the server is full (`storage-full`) or failed (`storage-failed`); nothing was stored"),
    )
)]
pub async fn put_mask(
    State(cases): State<Cases>,
    State(uploads): State<Uploads>,
    CasePath(id): CasePath,
    query: ApiQuery<VersionQuery>,
    request: Request,
) -> Result<Response, AppError> {
    if is_form(request.headers()) {
        let detail = "send the mask itself as the body, not as a form";
        return Err(AppError::bad_request("form-not-wanted", detail));
    }
    refuse_too_large(request.headers(), uploads.limits.max_bytes)?;
    let _room = uploads.begin(&request)?;
    let case = cases.case(&id).await?;
    let body = Incoming::begin(cases.store(), &uploads).await?;
    let mut body = body.spool(request.into_body().into_data_stream()).await?;
    if let Some(affine) = query.values.affine.filter(|_| !body.is_empty()) {
        body = cases.keeping_form(body, affine.into()).await?;
    }
    let version = query.values.version(id, case.parameters, body)?;
    Ok(submitted(cases.submit_version(version).await?, None))
}

/// Nine slices for checking the mask
///
/// Three axial, three coronal and three sagittal slices through the uploaded volume, with the contours at 0, 4, 8, 12
/// and 20 mm below the envelope, and the `quality` of the case.
#[utoipa::path(
    get, path = "/v1/cases/{id}/quality", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 406, description = "PNG is not accepted"),
        (status = 409, description = "The case is not ready"),
        (status = 500, description = "The stored upload is damaged"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_quality(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let question = Question::new(id, "quality", &query.asked, &request);
    let work = async |facts: Arc<CaseFacts>| {
        let model = cases.model(&id).await?;
        let volume = cases.whole_volume(&id).await?;
        let turn = cases.queue.turn().await?;
        let draw = move || {
            // The model is cropped to the mask, so it lacks what the mask missed.
            let scene = Scene {
                volume: &volume,
                ..model.scene()
            };
            let window = window_of(&facts);
            let frame = render::draw_quality_sheet(&scene, window, &lines(&facts));
            let frame = frame.map_err(Error::from)?;
            let texts = render::sheet_texts(&id.to_string(), window);
            render::encode_png(&frame, &texts).map_err(Error::from)
        };
        Ok(Bytes::from(turn.run(draw).await??).into())
    };
    question.answer(&cases, Format::of(PNG), work).await
}

/// The lines about the mask on the sheet.
fn lines(facts: &CaseFacts) -> Vec<String> {
    let Some(quality) = &facts.quality else {
        return vec!["the quality of this mask was not measured".to_owned()];
    };
    let first = format!(
        "{}: {} (brain {:.0} ml, envelope {:.0} ml)",
        quality.method.words(),
        quality.state.name(),
        quality.numbers.brain_ml,
        facts.envelope_ml
    );
    std::iter::once(first)
        .chain(quality.reasons.iter().cloned())
        .collect()
}
