//! Pictures of the isosurface.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use axum::response::Response;
use case::CaseId;
use cases::pictures::{EncodedImage, ImageMetadata, PictureRequest, backend_for, encode};
use render::{RenderBackend, Wanted};

use super::depth_headers;
use super::query::{ApiQuery, CasePath, Checked};
use crate::caching::{self, EntityTag, IMMUTABLE, REVALIDATE, Representation, not_modified};
use crate::negotiate::{Coding, media_type};
use crate::problem::{AppError, Problem};
use crate::state::AppState;

/// The media type of every picture.
pub(crate) const PNG: &str = "image/png";

impl Checked for PictureRequest {
    fn check(&self) -> Result<(), AppError> {
        Ok(PictureRequest::check(self)?)
    }
}

/// A picture of the isosurface at a depth
#[utoipa::path(
    get, path = "/v1/cases/{id}/render", tag = "pictures",
    params(("id" = String, Path, description = "The case"), PictureRequest),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png", headers(
            ("X-Isocortex-Renderer" = String, description = "Who drew: `splat`, `mesh` or `trace`"),
            ("X-Isocortex-Device" = String, description = "What drew: `cpu`, or the graphics adapter; `cpu` also where that failed at this picture"),
            ("X-Isocortex-Reduction" = String, description = "Where the volume is too large for the device: how many of its voxels became one, as 2x2x1"),
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this picture"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether more than the maximum was asked for"),
        )),
        (status = 304, description = "The client has it already"),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "PNG is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_render(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    ApiQuery(query): ApiQuery<PictureRequest>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let facts = state.cases.ready(&id).await?;
    let backend = backend_for(query.renderer, &state.cases.graphics).await;
    let named = state.cases.identity(&id, query.annotate).await?;
    let cache_control = caching_of(named.as_deref());
    let tag = tag_of(&id, &query, (&backend, named.as_deref()));
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept", cache_control));
    }
    let model = state.model(&id).await?;
    let picture = state.cases.picture_job(&model, &query, backend).await?;
    let metadata = ImageMetadata::of(Some(&id), &picture.job).named(named.clone());
    let annotate = query.annotate;
    let work = move |is_wanted: &Wanted<'_>| {
        picture
            .draw(is_wanted)
            .and_then(|drawn| encode(drawn, &metadata, annotate))
    };
    let image = state.cases.pool.run_while(work).await??;
    let mut headers = depth_headers(query.depth_mm, facts.max_depth_mm);
    describe(&image, &mut headers);
    Representation {
        headers,
        vary: "accept",
        cache_control,
        ..Representation::immutable(
            tag_of(&id, &query, (&image.backend, named.as_deref())),
            PNG,
            image.png,
        )
    }
    .respond(&request)
}

/// The tag of a picture: renderers differ in their pixels, graphics devices, too, and what is written of the case can be changed.
fn tag_of(
    id: &CaseId,
    query: &PictureRequest,
    (backend, named): (&RenderBackend, Option<&str>),
) -> EntityTag {
    let made = match named {
        Some(named) => format!("{backend} {named}"),
        None => backend.to_string(),
    };
    EntityTag::of_answer(id, "render", query, (&made, Coding::Identity))
}

/// How long a picture can be kept: a case that is named in it can get another label.
pub(super) fn caching_of(named: Option<&str>) -> HeaderValue {
    if named.is_some() {
        REVALIDATE
    } else {
        IMMUTABLE
    }
}

/// What every picture names as its maker.
pub(crate) const SOFTWARE: &str = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));

/// Says in headers who drew, on what, and of how much.
pub(super) fn describe(image: &EncodedImage, headers: &mut HeaderMap) {
    let mut insert = |name, text: &str| {
        caching::insert(headers, HeaderName::from_static(name), text);
    };
    insert("x-isocortex-renderer", image.backend.name());
    insert("x-isocortex-device", &image.backend.device());
    if let Some([x, y, z]) = image.reduction {
        insert("x-isocortex-reduction", &format!("{x}x{y}x{z}"));
    }
}
