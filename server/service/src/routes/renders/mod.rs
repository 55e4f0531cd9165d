//! Many pictures in one answer: a zip, a contact sheet or an animation.

mod files;
mod plan;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use cases::Cases;
use cases::pictures::{Layout, PictureRequest, PictureSeries};

use self::files::File;
use self::plan::parse;
use super::render::{PNG, with_version};
use crate::routes::asked::CasePath;
use http::conditional::{self, EntityTag};
use http::negotiate::{Coding, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};
use http::sent::MAX_BODY_BYTES;

pub use self::plan::RendersBody;

const ZIP: &str = "application/zip";

/// Many pictures at once
///
/// A JSON object with `renders` (a zip of PNGs, or with `"sheet": true` one contact sheet), `swivel` or `sweep`
/// (animated PNG). At most 256 pictures and 67,108,864 pixels in all.
#[utoipa::path(
    post, path = "/v1/cases/{id}/renders", tag = "pictures",
    params(("id" = String, Path, description = "The case")),
    request_body = RendersBody,
    responses(
        (status = 200, description = "The pictures; a sheet holds the state of each as the PNG text `row 1 column 1` and so on, a JSON object", content((Vec<u8> = "application/zip"), (Vec<u8> = "image/png"), (Vec<u8> = "image/apng")), headers(
            ("X-Isocortex-Renderer" = String, description = "The renderers and devices, each once: `splat on cpu; trace on cpu`"),
            ("ETag" = String, description = "Equal for equal pictures"),
        )),
        (status = 400, description = "The body is invalid; `parameter` is the path of the error"),
        (status = 406, description = "The media type is not accepted"),
        (status = 409, description = "The case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
        (status = 413, description = "The body is too long"),
        (status = 503, description = "Too much work is waiting (`busy`), the pictures took too long, or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn create_renders(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let body = body.map_err(|_| AppError::too_large(MAX_BODY_BYTES as u64))?;
    let plan = parse(&body)?.plan()?;
    let (offered, file): (&'static [&'static str], _) = match plan.layout {
        Layout::Separate => (&[ZIP], ("zip", 0)),
        Layout::Sheet { .. } => (&[PNG], ("sheet", 0)),
        Layout::Animation { frame_time_ms } => (&["image/apng", PNG], ("animation", frame_time_ms)),
    };
    let kind = media_type(&request, offered)?;
    cases.ready(&id).await?;
    let pictures = plan.pictures.iter().map(|picture| picture.asked.clone());
    let asked: (Vec<PictureRequest>, _) = (pictures.collect(), file);
    let series = PictureSeries::of(&cases, &id, plan.pictures).await?;
    let (versions, identity) = (series.versions(), series.identity().map(str::to_owned));
    let file = File::new(plan.layout, asked.0.len());
    let (file, backends) = series
        .draw_each(&cases, (file, Vec::new()), |(file, backends), picture| {
            let backend = picture.drawn.backend.to_string();
            if !backends.contains(&backend) {
                backends.push(backend);
            }
            file.add(picture)
        })
        .await?;
    let body = cases.queue.run(move || file.finish()).await??;
    let mut response = (StatusCode::OK, body).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let name = HeaderName::from_static("x-isocortex-renderer");
    let backends = backends.join("; ");
    conditional::insert(headers, name, &backends);
    let mut made_by = with_version(backends, versions);
    if let Some(identity) = identity {
        made_by = format!("{made_by} {identity}");
    }
    let tag = EntityTag::of_answer(
        &id.to_string(),
        "renders",
        &asked,
        (&made_by, Coding::Identity),
    );
    headers.insert(header::ETAG, tag.header());
    Ok(response)
}
