//! Cases as clients see them: listed, looked at, deleted.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use cases::{Cases, Error};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::layers::MapsView;
use super::query::{ApiQuery, Asked, CasePath, NoQuery};
use crate::problem::{AppError, Problem};
use case::Quality;
use case::{Case, CaseFacts, CaseId, CaseState, CutFacts, MaskKind};
use cases::dicom::Choice;
use cases::pictures::{check_count, window_of};
use storage::Cursor;

/// The largest number of cases on a page.
const MAX_PAGE: usize = 200;

/// A case.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = Case)]
pub struct CaseView {
    /// 32 lower-case hexadecimal digits: a digest of the input and its parameters.
    #[schema(value_type = String)]
    id: CaseId,
    /// The label given at the upload.
    name: Option<String>,
    /// `queued`, `preparing`, `ready` or `failed`.
    #[schema(value_type = String)]
    state: CaseState,
    /// When it was uploaded (RFC 3339).
    created_at: String,
    /// Radius of the ball that closes the brain mask, in mm.
    closing_radius_mm: f64,
    /// What the mask shows: `brain`, or `envelope`, which is not closed.
    mask_kind: MaskKind,
    /// The probability above which a voxel is brain, where the brain is extracted.
    threshold: f64,
    /// By how much the mask was made larger, in mm.
    offset_mm: f64,
    /// The case of which it is a version, with another mask or other parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    previous: Option<CaseId>,
    /// Its own versions, oldest first.
    #[schema(value_type = Vec<String>)]
    next: Vec<CaseId>,
    /// While it is being prepared.
    #[serde(skip_serializing_if = "Option::is_none")]
    progress: Option<ProgressView>,
    /// Once it has failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Problem>,
    /// Once it is ready.
    #[serde(flatten)]
    ready: Option<ReadyView>,
    /// What was chosen among the DICOM files; in the answer to their upload alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    dicom: Option<Choice>,
    /// Addresses of what there is of it.
    links: Links,
}

impl CaseView {
    /// A case as it is answered to the upload of DICOM files.
    pub(super) fn choosing(self, choice: Option<Choice>) -> Self {
        Self {
            dicom: choice,
            ..self
        }
    }
}

/// How far a preparation has come.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ProgressView {
    /// `reading`, `extracting`, `mask`, `closing`, `distance`, `core`, `forest`, `mesh` or `storing`.
    stage: &'static str,
    /// 0 to 1, of the whole preparation.
    fraction: f32,
}

/// What is known of a case that is ready.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ReadyView {
    /// The working grid.
    grid: GridView,
    /// The volume as it was acquired.
    volume: VolumeView,
    /// Depth of the deepest voxel below the envelope.
    max_depth_mm: f32,
    /// The faces of the volume that cut the brain; absent if none does. Their border is no dura: a depth is unknown, and pictures are
    /// bare, where such a face is nearer than the depth.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    cuts: Vec<CutFacts>,
    /// Which version of the preparation made the case. Cases of version 1 were prepared before cuts were known.
    pipeline: u32,
    /// Volume enclosed by the envelope.
    envelope_ml: f64,
    /// The sphere around the envelope that zoom 1 fits into a picture.
    envelope_sphere: SphereView,
    /// The plane at which the head is most like its mirror image, which views that compare the hemispheres mirror at; absent
    /// where the case was prepared before it was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    midsagittal: Option<PlaneView>,
    /// Intensities and how to show them.
    intensity: IntensityView,
    /// How far the mask can be trusted; absent where it was prepared before that was measured. Where it says `review` or
    /// `failed`, so does the header `X-Isocortex-Quality` of whatever shows the case.
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
    /// How far the maps of the junction of grey and white matter are; in the answer about one case alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<MapsView>,
    /// Wall time of each step of the preparation, in ms.
    timings: Vec<TimingView>,
}

/// The grid of the mask, the distance map and the forest: isotropic, along the patient axes L, P and S.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct GridView {
    /// Voxels along L, P and S.
    size: [usize; 3],
    /// Edge of a voxel.
    spacing_mm: f64,
    /// Rows of the affine from voxel centres to LPS mm.
    patient_from_voxel: [[f64; 4]; 4],
}

/// The volume as it was acquired.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct VolumeView {
    /// Voxels.
    size: [usize; 3],
    /// Edges of a voxel.
    spacing_mm: [f64; 3],
    /// Rows of the affine from voxel centres to LPS mm.
    patient_from_voxel: [[f64; 4]; 4],
    /// Numbers of the slices, from 1, that were missing among the DICOM files and are interpolated between their neighbours.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    interpolated_slices: Vec<usize>,
    /// The scanner's name of the sequence and its times in ms, such as `*tfl3d1, TR 2300, TE 2.98, TI 900`; absent if it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    sequence: Option<String>,
}

/// A sphere in the patient.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct SphereView {
    /// Its centre, LPS mm.
    center_in_patient: [f64; 3],
    /// Its radius.
    radius_mm: f64,
}

/// A plane in the patient: the points `p` with `normal · p = offset_mm`.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct PlaneView {
    /// The direction across it, to the patient's left: of length 1, LPS.
    normal: [f64; 3],
    /// Its distance from the origin of patient space, along the normal.
    offset_mm: f64,
}

/// Intensities and how to show them.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct IntensityView {
    /// The least.
    min: f32,
    /// The greatest.
    max: f32,
    /// The default window: 2nd to 98th percentile inside the envelope.
    window: WindowView,
}

/// A DICOM window (PS3.3 C.11.2.1.2, LINEAR), as `window=c,w` takes it.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct WindowView {
    /// Its centre.
    center: f64,
    /// Its width.
    width: f64,
}

/// How long a step took.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct TimingView {
    /// The step.
    stage: &'static str,
    /// Its wall time.
    ms: f64,
}

/// Addresses, relative to the server.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct Links {
    /// The case itself.
    #[serde(rename = "self")]
    this: String,
    /// Its progress as server-sent events.
    events: String,
    /// The mesh at a depth.
    mesh: String,
    /// The triangles of every mesh of a size.
    triangles: String,
    /// The mesh at every depth.
    paths: String,
    /// Its intensities as a texture.
    volume: String,
    /// Its depths as a texture.
    distance: String,
    /// A picture of the isosurface.
    render: String,
    /// The brain mask, as a NIfTI file; `PUT` another to make a version.
    mask: String,
    /// The envelope, as a NIfTI file.
    envelope: String,
    /// Nine slices to judge the mask by.
    quality: String,
    /// Slices: append `/axial`, `/coronal` or `/sagittal`.
    slices: String,
    /// Its layers: maps of the junction of grey and white matter.
    layers: String,
    /// Places where that junction is less sharp than around it and on the other side.
    candidates: String,
    /// What lies along the way through a point: append `?position=x,y,z`.
    profile: String,
    /// Whose head it is, of a ready case that was made of DICOM files.
    #[serde(skip_serializing_if = "Option::is_none")]
    dicom: Option<String>,
}

impl Links {
    fn of(id: &CaseId, is_dicom: bool) -> Self {
        let this = address_of(id);
        let below = |name: &str| format!("{this}/{name}");
        Self {
            events: below("events"),
            mesh: below("mesh"),
            triangles: below("mesh/triangles"),
            paths: below("mesh/paths"),
            volume: below("volume"),
            distance: below("distance"),
            render: below("render"),
            mask: below("mask"),
            envelope: below("envelope"),
            quality: below("quality"),
            slices: below("slices"),
            layers: below("layers"),
            candidates: below("candidates"),
            profile: below("profile"),
            dicom: is_dicom.then(|| below("dicom")),
            this,
        }
    }
}

/// Where a case is.
pub(crate) fn address_of(id: &CaseId) -> String {
    format!("/v1/cases/{id}")
}

impl From<Case> for CaseView {
    fn from(case: Case) -> Self {
        Self {
            id: case.id,
            links: Links::of(
                &case.id,
                case.facts
                    .as_ref()
                    .is_some_and(|facts| facts.dicom.is_some()),
            ),
            dicom: None,
            name: case.parameters.name,
            closing_radius_mm: case.parameters.closing_radius_mm,
            mask_kind: case.parameters.mask_kind,
            threshold: case.parameters.threshold,
            offset_mm: case.parameters.offset_mm,
            previous: case.previous,
            next: case.next,
            state: case.state,
            created_at: case.created_at.to_string(),
            progress: case.progress.map(|progress| ProgressView {
                stage: progress.stage.name(),
                fraction: progress.fraction,
            }),
            error: case
                .failure
                .map(|failure| AppError::from(failure).problem()),
            ready: case.facts.map(ReadyView::from),
        }
    }
}

impl From<CaseFacts> for ReadyView {
    fn from(facts: CaseFacts) -> Self {
        let window = window_of(&facts);
        Self {
            grid: GridView {
                size: facts.grid_size,
                spacing_mm: facts.spacing_mm,
                patient_from_voxel: facts.patient_from_voxel,
            },
            volume: VolumeView {
                size: facts.native_size,
                spacing_mm: facts.native_spacing_mm,
                patient_from_voxel: facts.native_patient_from_voxel,
                sequence: facts
                    .dicom
                    .as_ref()
                    .and_then(|dicom| dicom.sequence.clone()),
                interpolated_slices: facts
                    .dicom
                    .map(|dicom| dicom.interpolated_slices)
                    .unwrap_or_default(),
            },
            max_depth_mm: facts.max_depth_mm,
            cuts: facts.cuts,
            pipeline: facts.pipeline,
            envelope_ml: facts.envelope_ml,
            envelope_sphere: SphereView {
                center_in_patient: facts.envelope_sphere.center_in_patient,
                radius_mm: facts.envelope_sphere.radius_mm,
            },
            midsagittal: facts.midsagittal.map(|plane| PlaneView {
                normal: plane.normal,
                offset_mm: plane.offset_mm,
            }),
            intensity: IntensityView {
                min: facts.intensity_min,
                max: facts.intensity_max,
                window: WindowView {
                    center: window.centre(),
                    width: window.width(),
                },
            },
            quality: facts.quality,
            maps: None,
            timings: facts
                .timings
                .into_iter()
                .map(|(stage, ms)| TimingView {
                    stage: stage.name(),
                    ms,
                })
                .collect(),
        }
    }
}

/// A part of the list of cases.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct CasePage {
    /// Newest first.
    cases: Vec<CaseView>,
    /// Give it as `after` for the next page; absent on the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

fn default_limit() -> usize {
    50
}

/// Which part of the list.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ListQuery {
    /// The `next` of the page before.
    after: Option<String>,
    /// The most cases on a page.
    #[serde(default = "default_limit")]
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: usize,
}

/// A part of the list that there can be.
#[derive(Debug)]
pub struct ListValues {
    after: Option<Cursor>,
    limit: usize,
}

impl Asked for ListQuery {
    type Values = ListValues;

    fn checked(&self) -> Result<ListValues, AppError> {
        check_count("limit", self.limit, 1, MAX_PAGE)?;
        let unknown = || AppError::out_of_range("after", "is not the `next` of a page");
        let cursor = |text: &String| Cursor::parse(text).ok_or_else(unknown);
        Ok(ListValues {
            after: self.after.as_ref().map(cursor).transpose()?,
            limit: self.limit,
        })
    }
}

/// An answer that changes with time.
pub(crate) fn fresh_json(status: StatusCode, body: &impl Serialize) -> Response {
    let mut response = (status, Json(body)).into_response();
    response
        .headers_mut()
        .insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// The cases, newest first
#[utoipa::path(
    get, path = "/v1/cases", tag = "cases", params(ListQuery),
    responses(
        (status = 200, description = "A page of the list", body = CasePage),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 401, description = "A token is wanted", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn list_cases(
    State(cases): State<Cases>,
    query: ApiQuery<ListQuery>,
) -> Result<Response, AppError> {
    let ListValues { after, limit } = query.values;
    let page = cases.store().cases(after, limit).await?;
    let page = CasePage {
        cases: page.cases.into_iter().map(CaseView::from).collect(),
        next: page.next.map(|cursor| cursor.to_string()),
    };
    Ok(fresh_json(StatusCode::OK, &page))
}

/// One case
#[utoipa::path(
    get, path = "/v1/cases/{id}", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "The case", body = CaseView),
        (status = 401, description = "A token is wanted", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_case(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let mut view = CaseView::from(cases.case(&id).await?);
    if let Some(ready) = &mut view.ready {
        ready.maps = Some(MapsView::from(&cases.library.maps(&id).await?));
    }
    Ok(fresh_json(StatusCode::OK, &view))
}

/// Delete a case and all that was computed of it
#[utoipa::path(
    delete, path = "/v1/cases/{id}", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 204, description = "It is gone"),
        (status = 401, description = "A token is wanted", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn delete_case(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<StatusCode, AppError> {
    if cases.delete(&id).await? {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Error::NoSuchCase.into())
    }
}
