//! Cases: list, get, delete.

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::StatusCode;
use axum::response::Response;
use cases::{Cases, Error};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::layers::MapsView;
use crate::routes::asked::CasePath;
use case::{
    Case, CaseChange, CaseFacts, CaseId, CaseState, Closed, CutFacts, ImageRun, MaskKind,
    Parameters, PlaneFacts, Progress, Quality, SphereFacts, SurfaceName,
};
use cases::dicom::Choice;
use cases::pictures::{check_count, window_of};
use http::fresh::fresh_json;
use http::problem::{AppError, Problem};
use http::query::{ApiQuery, Asked, MAX_PAGE, NoQuery, usual_page};
use http::sent::json_body;
use storage::Cursor;

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
    /// Whether it is never removed because of its age.
    kept: bool,
    /// Whether it is in the trash: lists leave it out. Absent if it is not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    trashed: bool,
    /// Why it is closed; absent if it is open. `corrected`: the PACS has sent another image under the UID of one that it was made of: another
    /// patient, another place, or other pixels; `rejected`: the PACS has rejected an image that it was made of. Nothing of a closed case is sent
    /// to a node. All answers that show the case have the reason in `X-Isocortex-Closed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    closed: Option<&'static str>,
    /// When the server will remove it because of its age (RFC 3339); absent if it will not.
    #[serde(skip_serializing_if = "Option::is_none")]
    expires_at: Option<String>,
    /// Radius of the ball that closes the brain mask, in mm.
    closing_radius_mm: f64,
    /// What the mask contains: `brain`, or `envelope`, which is not closed.
    mask_kind: MaskKind,
    /// The probability above which the network counts a voxel as brain.
    threshold: f64,
    /// How far the surface of the mask was moved outwards, in mm.
    offset_mm: f64,
    /// The case that this is a version of, with another mask or other parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    previous: Option<CaseId>,
    /// The versions of this case, oldest first.
    #[schema(value_type = Vec<String>)]
    next: Vec<CaseId>,
    /// Present while the case is being prepared.
    #[serde(skip_serializing_if = "Option::is_none")]
    progress: Option<Progress>,
    /// Present if the case has failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Problem>,
    /// Present if the case is ready.
    #[serde(flatten)]
    ready: Option<ReadyView>,
    /// The choice among the DICOM files; only in the answer to their upload.
    #[serde(skip_serializing_if = "Option::is_none")]
    dicom: Option<Choice>,
    /// Addresses of everything about it.
    links: Links,
}

impl CaseView {
    /// A case in the answer to an upload of DICOM files.
    pub(super) fn choosing(self, choice: Option<Choice>) -> Self {
        Self {
            dicom: choice,
            ..self
        }
    }
}

/// The facts about a ready case.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct ReadyView {
    /// The surface that `max_depth_mm`, `envelope_ml` and `envelope_sphere` describe; absent if it is that of the whole brain.
    #[serde(skip_serializing_if = "SurfaceName::is_whole")]
    surface: SurfaceName,
    /// The working grid.
    grid: GridView,
    /// The volume as it was acquired.
    volume: VolumeView,
    /// Depth of the deepest voxel below the envelope.
    max_depth_mm: f32,
    /// The faces of the volume that cut the brain; absent if there are none. They do not count as dura: if such a face
    /// is nearer than the depth, the depth is unknown, and pictures are bare there.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    cuts: Vec<CutFacts>,
    /// The version of the preparation.
    pipeline: u32,
    /// Volume of the envelope.
    envelope_ml: f64,
    /// The sphere around the envelope that zoom 1 fits into a picture.
    envelope_sphere: SphereFacts,
    /// The plane at which the head is most like its mirror image, for views that compare the hemispheres.
    midsagittal: PlaneFacts,
    /// Intensities and how to show them.
    intensity: IntensityView,
    /// The quality of the mask. If it is `review` or `failed`, the header
    /// `X-Isocortex-Quality` of all answers that show the case has the same value.
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
    /// The state of the maps of the junction of grey and white matter; only in the answer about one case.
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
    /// Numbers (from 1) of the slices that were missing among the DICOM files and are interpolated between their
    /// neighbours.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    interpolated_slices: Vec<usize>,
    /// The scanner's name of the sequence and its times in ms, such as `*tfl3d1, TR 2300, TE 2.98, TI 900`; absent if
    /// unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    sequence: Option<String>,
    /// The number of the DICOM series; absent if unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    series_number: Option<i64>,
    /// The numbers of the DICOM images (of the frames, if one image has them all) that are slices of the volume, along its third
    /// axis, in runs of even steps; interpolated slices are in none. Absent if unknown, or if two images have the same number.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    images: Vec<ImageRun>,
    /// How many voxels were not finite numbers and are shown as 0; absent if none.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_finite_voxels: Option<u64>,
    /// How many voxels lay so far beyond all others that they are shown as the end of the range; absent if none.
    #[serde(skip_serializing_if = "Option::is_none")]
    clipped_voxels: Option<u64>,
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

/// A DICOM window (PS3.3 C.11.2.1.2, LINEAR), for `window=c,w`.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct WindowView {
    /// Its centre.
    center: f64,
    /// Its width.
    width: f64,
}

/// The time of a step.
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
    /// Nine slices for checking the mask.
    quality: String,
    /// Slices: append `/axial`, `/coronal`, `/sagittal` or `/oblique`.
    slices: String,
    /// Slices through what was acquired, also while the case is not ready: append `/axial`, `/coronal` or `/sagittal`.
    acquired: String,
    /// Its layers: what was added to it, and its maps.
    layers: String,
    /// Places where the junction of grey and white matter is less sharp than in its surroundings and on the other side.
    candidates: String,
    /// What readers have marked and written; `PUT` replaces it.
    findings: String,
    /// The report of the reading, for people.
    report: String,
    /// The profile through a point: append `?position=x,y,z`.
    profile: String,
    /// The identity of the patient, for a ready case from DICOM.
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
            acquired: below("acquired"),
            layers: below("layers"),
            candidates: below("candidates"),
            findings: below("findings"),
            report: below("report"),
            profile: below("profile"),
            dicom: is_dicom.then(|| below("dicom")),
            this,
        }
    }
}

/// The address of a case.
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
            closed: case.closed.map(Closed::name),
            kept: case.kept,
            trashed: case.trashed,
            expires_at: case.expires_at.map(|time| time.to_string()),
            progress: case.progress,
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
        let dicom = facts.dicom;
        let known = dicom.as_ref();
        let voxels = facts.voxels.as_ref();
        let count = |count: Option<u64>| count.filter(|&count| count > 0);
        Self {
            surface: SurfaceName::Whole,
            grid: GridView {
                size: facts.grid_size,
                spacing_mm: facts.spacing_mm,
                patient_from_voxel: facts.patient_from_voxel,
            },
            volume: VolumeView {
                size: facts.native_size,
                spacing_mm: facts.native_spacing_mm,
                patient_from_voxel: facts.native_patient_from_voxel,
                sequence: known.and_then(|dicom| dicom.sequence.clone()),
                series_number: known.and_then(|dicom| dicom.series_number),
                images: known.map_or_else(Vec::new, |dicom| dicom.images.clone()),
                not_finite_voxels: count(voxels.map(|voxels| voxels.not_finite)),
                clipped_voxels: count(voxels.map(|voxels| voxels.clipped)),
                interpolated_slices: dicom
                    .map(|dicom| dicom.interpolated_slices)
                    .unwrap_or_default(),
            },
            max_depth_mm: facts.max_depth_mm,
            cuts: facts.cuts,
            pipeline: facts.pipeline,
            envelope_ml: facts.envelope_ml,
            envelope_sphere: facts.envelope_sphere,
            midsagittal: facts.midsagittal,
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

/// A page of the list of cases.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct CasePage {
    /// Newest first.
    cases: Vec<CaseView>,
    /// The value of `after` for the next page; absent on the last page.
    #[serde(skip_serializing_if = "Option::is_none")]
    next: Option<String>,
}

/// The query for a page of the list.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ListQuery {
    /// The `next` of the previous page.
    after: Option<String>,
    /// The greatest number of cases on a page.
    #[serde(default = "usual_page")]
    #[param(minimum = 1, maximum = 200, default = 50)]
    limit: usize,
}

/// A checked query for a page.
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

/// The cases, newest first
#[utoipa::path(
    get, path = "/v1/cases", tag = "cases", params(ListQuery),
    responses(
        (status = 200, description = "A page of the list", body = CasePage),
    )
)]
pub async fn list_cases(
    State(cases): State<Cases>,
    query: ApiQuery<ListQuery>,
) -> Result<Response, AppError> {
    let ListValues { after, limit } = query.values;
    let all = storage::CaseQuery {
        trashed: Some(false),
        ..Default::default()
    };
    let page = cases.store().cases(&all, after.as_ref(), limit).await?;
    let listed = page.cases.into_iter();
    let page = CasePage {
        cases: listed.map(|listed| listed.case.into()).collect(),
        next: page.next.map(|cursor| cursor.to_string()),
    };
    Ok(fresh_json(StatusCode::OK, &page))
}

/// Which surface of a case is described.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CaseQuery {
    /// The surface that `max_depth_mm`, `envelope_ml` and `envelope_sphere` describe: of the whole brain, or of a part, as for pictures.
    #[serde(default, skip_serializing_if = "SurfaceName::is_whole")]
    #[param(inline)]
    surface: SurfaceName,
}

impl Asked for CaseQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// One case
#[utoipa::path(
    get, path = "/v1/cases/{id}", tag = "cases",
    params(("id" = String, Path, description = "The case"), CaseQuery),
    responses(
        (status = 200, description = "The case", body = CaseView),
        (status = 409, description = "A part is asked for, and the case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
    )
)]
pub async fn get_case(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked, .. }: ApiQuery<CaseQuery>,
) -> Result<Response, AppError> {
    let view = view_of_surface(&cases, &id, asked.surface).await?;
    Ok(fresh_json(StatusCode::OK, &view))
}

/// A case with the state of its maps and the facts of one of its surfaces.
///
/// # Errors
/// Of a part, as [`Cases::surface`].
pub(super) async fn view_of_surface(
    cases: &Cases,
    id: &CaseId,
    surface: SurfaceName,
) -> Result<CaseView, AppError> {
    let mut view = view_of(cases, id).await?;
    if !surface.is_whole() {
        cases.ready(id).await?;
        let model = cases.surface(id, surface).await?;
        let maps = view.ready.and_then(|whole| whole.maps);
        view.ready = Some(ReadyView {
            surface,
            maps,
            ..ReadyView::from(model.facts().clone())
        });
    }
    Ok(view)
}

/// A case with the state of its maps.
async fn view_of(cases: &Cases, id: &CaseId) -> Result<CaseView, AppError> {
    let mut view = CaseView::from(cases.case(id).await?);
    if let Some(ready) = &mut view.ready {
        ready.maps = Some(MapsView::from(&cases.library.maps(id).await?));
    }
    Ok(view)
}

/// Rename a case, keep it, or put it into the trash
///
/// Lists leave a case in the trash out; everything else about it is as before, until it is deleted or taken out. A kept
/// case is never removed because of its age, even if the server removes others (`storage.keep_days`). It can still be
/// deleted. The label does not affect the id. A version of the case is a case of its own.
#[utoipa::path(
    patch, path = "/v1/cases/{id}", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    request_body = CaseChange,
    responses(
        (status = 200, description = "The case as it is now", body = CaseView),
        (status = 400, description = "The body is invalid"),
        (status = 422, description = "The label cannot be used"),
    )
)]
pub async fn patch_case(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    let change: CaseChange = json_body(body)?;
    if let Some(name) = &change.name {
        Parameters::check_name(name).map_err(Error::from)?;
    }
    if !cases.store().change_case(&id, &change).await? {
        return Err(Error::NoSuchCase.into());
    }
    Ok(fresh_json(StatusCode::OK, &view_of(&cases, &id).await?))
}

/// Delete a case and everything computed from it
#[utoipa::path(
    delete, path = "/v1/cases/{id}", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 204, description = "The case was deleted"),
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
