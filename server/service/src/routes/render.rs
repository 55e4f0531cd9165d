//! Pictures of the isosurface.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use case::CaseId;
use cases::pictures::{Drawer, Finished, PictureRequest, Story, finish};
use render::Wanted;
use render::gpu::GpuCase as _;

use super::depth_headers;
use super::query::{ApiQuery, CasePath, Checked};
use crate::caching::{self, EntityTag, IMMUTABLE, Representation, not_modified};
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
    let drawer = Drawer::choose(query.renderer, &state.cases.graphics).await;
    let tag = tag_of(&id, &query, &drawer);
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept", IMMUTABLE));
    }
    let model = state.model(&id).await?;
    let drawing = state.cases.drawing(&model, &query, drawer).await?;
    let story = Story::of(Some(&id), &drawing.request, &model.scene());
    let annotate = query.annotate;
    let work = move |is_wanted: &Wanted<'_>| {
        drawing
            .draw(is_wanted)
            .and_then(|drawn| finish(drawn, &story, annotate))
    };
    let finished = state.cases.pool.run_while(work).await??;
    let mut headers = depth_headers(query.depth_mm, facts.max_depth_mm);
    describe(&finished, &mut headers);
    Representation {
        headers,
        vary: "accept",
        ..Representation::immutable(tag_of(&id, &query, &finished.drawer), PNG, finished.png)
    }
    .respond(&request)
}

/// The tag of a picture: renderers differ in their pixels, and graphics devices, too.
fn tag_of(id: &CaseId, query: &PictureRequest, drawer: &Drawer) -> EntityTag {
    EntityTag::of_answer(id, "render", query, (&drawer.tag(), Coding::Identity))
}

/// What every picture names as its maker.
pub(crate) const SOFTWARE: &str = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));

/// Says in headers who drew, on what, and of how much.
pub(super) fn describe(finished: &Finished, headers: &mut HeaderMap) {
    let mut insert = |name, text: &str| {
        caching::insert(headers, HeaderName::from_static(name), text);
    };
    insert("x-isocortex-renderer", finished.drawer.name());
    insert("x-isocortex-device", &finished.drawer.device());
    if let Some([x, y, z]) = finished.reduction {
        insert("x-isocortex-reduction", &format!("{x}x{y}x{z}"));
    }
}
