//! Pictures of slices with the contours of isosurfaces.

use axum::extract::{RawPathParams, State};
use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use render::SlicePlane;

use super::render::{PNG, format_with_layers};
use crate::routes::asked::{CasePath, Keys, Question};
use cases::pictures::{SliceKind, SlicePicture, SliceQuery};
use cases::{Cases, Error};
use http::conditional::{self, Content};
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::ApiQuery;

/// How an oblique plane lies in the patient.
const PLANE: HeaderName = HeaderName::from_static("x-isocortex-plane");

/// A slice through the whole acquired volume, with the contours of isosurfaces
///
/// `oblique` is a plane through `position` in any direction, by default the one across the sulcus there. It is sampled from the
/// voxels as they were acquired, like the others. Superior is up, anterior within 30° of an axial plane; the patient's left is
/// where the convention has it, and anterior at the left if the plane is nearer to a sagittal one. An annotated one states its
/// angles: `cor > sag 32° > ax 10°` is a coronal plane turned by 32° to the sagittal and by 10° to the axial one.
#[utoipa::path(
    get, path = "/v1/cases/{id}/slices/{plane}", tag = "pictures",
    params(
        ("id" = String, Path, description = "The case"),
        ("plane" = String, Path, description = "`axial`, `coronal`, `sagittal` or `oblique`"),
        SliceQuery,
    ),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png", headers(("X-Isocortex-Plane" = String, description = "Of an oblique plane, as JSON: `orientation` from patient to view space (quaternion x, y, z, w), `turned_about`, the direction about which `turn_deg` turns it (LPS), and its `angles` in degrees"))),
        (status = 404, description = "No such case or plane"),
        (status = 406, description = "PNG is not accepted"),
        (status = 409, description = "The case is not ready"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_slice(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery {
        asked: Keys(asked),
        values,
    }: ApiQuery<Keys<SliceQuery>>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let kind: SliceKind = named(&path)?;
    let question = Question::new(id, "slices", &asked, &request);
    let slice = SlicePicture::of(&cases, &id, kind, values).await?;
    let format = format_with_layers(kind.name().to_owned(), slice.version());
    let format = format.named(slice.identity().map(str::to_owned));
    let work = async |_| {
        let drawn = slice.draw(&cases).await?;
        let mut headers = HeaderMap::new();
        if let Some(plane) = drawn.plane() {
            let text = serde_json::to_string(&plane).map_err(|_| Error::Internal)?;
            conditional::insert(&mut headers, PLANE, &text);
        }
        Ok(Content {
            body: drawn.png.into(),
            headers,
            ..Content::default()
        })
    };
    question.answer(&cases, format, work).await
}

/// The plane that a path names.
pub(super) fn plane_of(path: &RawPathParams) -> Result<SlicePlane, AppError> {
    named(path)
}

fn named<T: std::str::FromStr>(path: &RawPathParams) -> Result<T, AppError> {
    let plane = path.iter().find(|(name, _)| *name == "plane");
    plane
        .and_then(|(_, text)| text.parse().ok())
        .ok_or_else(AppError::no_such_route)
}
