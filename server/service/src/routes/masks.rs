//! The mask in the user's hands: had, edited elsewhere and put back, and looked at.

use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use bytes::Bytes;
use cases::{Cases, Error};
use geometry::Mask;
use render::Scene;
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::cases::CaseView;
use super::query::{ApiQuery, Asked, CasePath, NoQuery};
use super::render::PNG;
use super::upload::{Incoming, is_form, refuse_too_large, submitted};
use crate::conditional::{self, Content, Format, Question};
use crate::negotiate::media_type;
use crate::problem::{AppError, Problem};
use crate::state::Uploads;
use case::{CaseFacts, CaseId, Failure, MaskKind, MaskSource, ObjectKind, Parameters};
use cases::pictures::window_of;
use pipeline::codec::{decode_brain, decode_envelope};
use pipeline::read_volume;
use storage::{NewMask, Spooled, Version};

/// What a packed NIfTI file is.
pub(super) const GZIP: &str = "application/gzip";

/// The brain mask on the working grid
///
/// The mask as it was closed: on the working grid, one component without holes, moved by `offset_mm`. A packed NIfTI-1 file in
/// its place in the patient, to be edited over the volume by any program and put back by `PUT`. Put back unchanged it gives
/// the same meshes.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mask", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The mask: 1 in the brain, else 0, in 8 bits (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The range asked for"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "The range lies beyond the end", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
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
/// The closed mask, whose surface is at depth 0, as a packed NIfTI-1 file. Edited, it is put back by `PUT …/mask?kind=envelope`.
#[utoipa::path(
    get, path = "/v1/cases/{id}/envelope", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The envelope: 1 inside, else 0, in 8 bits (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The range asked for"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 416, description = "The range lies beyond the end", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
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

/// Which mask is asked for.
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
    let question = Question {
        id,
        route,
        query: &query,
        request,
    };
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

/// How a version differs from its case.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct VersionQuery {
    /// What the mask shows: `brain`, which is closed, or `envelope`, which is not.
    #[param(inline)]
    kind: Option<MaskKind>,
    /// With an empty body: where the mask comes from, instead of what was supplied with the case.
    #[param(inline)]
    source: Option<MaskSource>,
    /// Radius of the ball that closes the mask, in mm; that of the case where it is not given.
    #[param(minimum = 0, maximum = 50)]
    closing_radius_mm: Option<f64>,
    /// The probability above which a voxel is brain where the brain is extracted; that of the case where it is not given.
    #[param(minimum = 0.05, maximum = 0.95)]
    threshold: Option<f64>,
    /// By how much the mask's surface is moved outwards before it is closed, in mm. Where it is not given: 0 with a mask in
    /// the body, since one that was had from here is moved already; that of the case with an empty body.
    #[param(minimum = -20, maximum = 20)]
    offset_mm: Option<f64>,
}

impl Asked for VersionQuery {
    /// The same: what is not given is the case's, so that the parameters are whole only with the case.
    type Values = Self;

    fn checked(&self) -> Result<Self, AppError> {
        self.over(Parameters::default()).check()?;
        Ok(*self)
    }
}

impl VersionQuery {
    /// Parameters with those of the query in their place.
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

    /// The version of a case whose parameters these are, with a mask in the body if that is not empty.
    fn version(&self, of: CaseId, case: Parameters, body: Spooled) -> Result<Version, AppError> {
        let body = Some(body).filter(|body| !body.is_empty());
        let (mask, base) = match (body, self.source) {
            (Some(_), Some(_)) => {
                let detail = "is for an empty body: the mask in the body is the source";
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
/// The body is a mask in NIfTI, packed or not, on any grid. With an empty body the mask stays what was supplied with the case,
/// or is found anew as `source` says; then only the parameters differ. The version is a case of its own, of the same volume and
/// with the same label, and the case stays as it is; `previous` and `next` of the two name each other. The same mask and
/// parameters again are the same version. Of either kind of mask the largest component is kept and its holes are filled.
#[utoipa::path(
    put, path = "/v1/cases/{id}/mask", tag = "masks",
    params(("id" = String, Path, description = "The case"), VersionQuery),
    request_body(content = Option<Vec<u8>>, content_type = "application/octet-stream", description = "The mask, NIfTI-1 or NIfTI-2, `.nii` or `.nii.gz`; or nothing"),
    responses(
        (status = 202, description = "A new version", body = CaseView, headers(
            ("Location" = String, description = "Where it is"), ("Retry-After" = u32, description = "Seconds after which to look"),
        )),
        (status = 200, description = "The version was there already", body = CaseView),
        (status = 400, description = "A key or value of the query is wrong, or the body stalled", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "The body is too large", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "The body is no NIfTI file", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "The mask or a parameter cannot be used", body = Problem, content_type = "application/problem+json"),
        (status = 501, description = "The network is asked for, whose weights this server does not have (`network-missing`)", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many cases wait", body = Problem, content_type = "application/problem+json"),
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
        return Err(AppError::Upload {
            kind: "form-not-wanted",
            detail: "send the mask as the body itself, not in a form".to_owned(),
        });
    }
    refuse_too_large(request.headers(), uploads.limits.max_bytes)?;
    let _room = uploads.begin()?;
    let case = cases.case(&id).await?;
    let body = Incoming::begin(cases.store(), &uploads);
    let body = body.spool(request.into_body().into_data_stream()).await?;
    let version = query.values.version(id, case.parameters, body)?;
    Ok(submitted(cases.submit_version(version).await?, None))
}

/// Nine slices to judge the mask by
///
/// Three axial, coronal and sagittal slices each through the volume as it was uploaded, with the contours at 0, 4, 8, 12 and
/// 20 mm below the envelope, and the `quality` of the case.
#[utoipa::path(
    get, path = "/v1/cases/{id}/quality", tag = "masks",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "PNG is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 500, description = "The stored upload is damaged", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_quality(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    query: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let question = Question {
        id,
        route: "quality",
        query: &query.asked,
        request: &request,
    };
    let work = async |facts: Arc<CaseFacts>| {
        let model = cases.model(&id).await?;
        let turn = cases.queue.turn().await?;
        let names = cases.store().rows().objects(&id).await?;
        let source = cases.library.source(&id, &names).await?;
        let source = source.ok_or_else(Failure::source_damaged)?;
        let limits = cases.library.limits();
        let draw = move || {
            // What the mask left out is not in the model, which is cropped to it.
            let volume = read_volume(&source, &limits)?;
            let scene = Scene {
                volume: &volume,
                ..model.scene()
            };
            let window = window_of(&facts);
            let frame = render::draw_quality_sheet(&scene, window, &lines(&facts))?;
            let texts = render::sheet_texts(&id.to_string(), window);
            Ok::<_, AppError>(render::encode_png(&frame, &texts)?)
        };
        Ok(Bytes::from(turn.run(draw).await??).into())
    };
    question.answer(&cases, Format::of(PNG), work).await
}

/// What the sheet says of the mask.
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
