//! Pictures of what was acquired, for which a case need not be ready.

use axum::extract::RawPathParams;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use case::CaseId;
use geometry::{BoundingSphere, Volume};
use render::{Layers, SliceConvention, SliceParameters, SlicePlane, SliceRequest, Window};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::render::PNG;
use super::slices::plane_of;
use crate::state::InProject;
use cases::pictures::{
    Numbers, check_annotation, default_side, default_zoom, encode_slice, picture_size,
    window_of_numbers,
};
use http_support::conditional::{Format, Question};
use http_support::negotiate::media_type;
use http_support::problem::AppError;
use http_support::query::{ApiQuery, Asked, CasePath};

/// A picture of a slice of what was acquired.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct AcquiredQuery {
    /// The LPS coordinate across the plane, in mm; by default the middle of the volume.
    position_mm: Option<f64>,
    /// Width in pixels.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    width: u32,
    /// Height in pixels.
    #[serde(default = "default_side")]
    #[param(minimum = 1, maximum = 4096, default = 512)]
    height: u32,
    /// 1 fits the longest side of the volume into the picture.
    #[serde(default = "default_zoom")]
    #[param(minimum = 0.01, maximum = 100, default = 1)]
    zoom: f64,
    /// The shift of the slice to the right and up, in mm: `x,y`.
    #[param(value_type = Option<String>, example = "0,0")]
    pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: `c,w`; by default from the 2nd to the 98th percentile of all voxels.
    #[param(value_type = Option<String>, example = "80,120")]
    window: Option<Numbers<2>>,
    /// On which side of axial and coronal slices the patient's left is: at the right (radiological) or at the left.
    #[serde(default, skip_serializing_if = "SliceConvention::is_default")]
    #[param(inline)]
    convention: SliceConvention,
    /// Whether to draw the label, day and short id of the case, position, window, scale, directions and the notice into
    /// the picture.
    #[serde(default)]
    #[param(default = false)]
    annotate: bool,
}

/// A checked request for a slice of what was acquired.
#[derive(Debug)]
pub struct AcquiredValues {
    position_mm: Option<f64>,
    window: Option<Window>,
    /// All other values, for the axial plane through the origin.
    request: SliceRequest,
}

impl Asked for AcquiredQuery {
    type Values = AcquiredValues;

    fn checked(&self) -> Result<AcquiredValues, AppError> {
        check_annotation(self.annotate, [self.width, self.height])?;
        let window = self.window.map(window_of_numbers).transpose()?;
        let usual = Window::between(0.0, 1.0);
        let request = SliceRequest::new(SliceParameters {
            convention: self.convention,
            zoom: self.zoom,
            pan_mm: self.pan.map_or([0.0; 2], |Numbers(pan)| pan),
            size: picture_size(self.width, self.height)?,
            ..SliceParameters::new(
                SlicePlane::Axial,
                self.position_mm.unwrap_or(0.0),
                window.unwrap_or(usual),
            )
        })?;
        Ok(AcquiredValues {
            position_mm: self.position_mm,
            window,
            request,
        })
    }
}

/// A slice through the whole acquired volume, also of a case that is not ready
///
/// It shows the head while the case waits and is prepared, and if that fails. It has neither contours nor layers, and its
/// scale is that of the volume; `slices` shows those of a ready case.
#[utoipa::path(
    get, path = "/v1/cases/{id}/acquired/{plane}", tag = "pictures",
    params(
        ("id" = String, Path, description = "The case"),
        ("plane" = inline(SlicePlane), Path, description = "The orientation of the slice"),
        AcquiredQuery,
    ),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 404, description = "No such case or plane"),
        (status = 406, description = "PNG is not accepted"),
        (status = 422, description = "The upload is lost"),
        (status = 503, description = "Too much work is waiting"),
    )
)]
pub async fn get_acquired(
    InProject(cases): InProject,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked, values }: ApiQuery<AcquiredQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let plane = plane_of(&path)?;
    let question = Question {
        id,
        route: "acquired",
        query: &asked,
        request: &request,
    };
    let named = cases.identity(&id, asked.annotate).await?;
    let work = async || {
        let volume = cases.acquired_volume(&id).await?;
        let named = named.clone();
        let picture = cases
            .queue
            .run(move || draw(&volume, &id, plane, values, named.as_deref()));
        Ok(Bytes::from(picture.await??).into())
    };
    let format = Format::of(PNG).variant(plane.name()).named(named.clone());
    question.answer_of_any(&cases, format, work).await
}

/// Draws a slice; with `named`, annotated.
fn draw(
    volume: &Volume,
    case: &CaseId,
    plane: SlicePlane,
    values: AcquiredValues,
    named: Option<&str>,
) -> Result<Vec<u8>, AppError> {
    let bounds = BoundingSphere::of_grid(volume.grid());
    let position_mm = values
        .position_mm
        .unwrap_or_else(|| plane.middle_mm(&bounds));
    let window = values.window.unwrap_or_else(|| {
        let [low, high] = volume.percentiles([0.02, 0.98]);
        Window::between(low, high)
    });
    let request = values.request.shown(plane, position_mm, window);
    let frame = render::draw_acquired_slice(volume, &bounds, &request);
    let projection = request.projection(&bounds);
    let layers = Layers::default();
    Ok(encode_slice(
        frame,
        &request,
        &projection,
        &layers,
        case,
        named,
    )?)
}
