//! Pictures of the isosurface.

use axum::extract::State;
use std::sync::Arc;

use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use case::CaseFacts;
use cases::pictures::{
    CheckedPicture, EncodedImage, PictureLayers, PictureRequest, PictureSeries, SeriesPicture,
    ShownDepth, backend_for, positions, shown_depth, warm_jobs,
};
use cases::{Cases, Error};
use render::RenderBackend;

use super::depth_headers;
use crate::routes::asked::{CasePath, Keys, Question};
use crate::wire;
use http::conditional::{self, Content, Format};
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::ApiQuery;

/// The media type of every picture.
pub(crate) const PNG: &str = "image/png";

/// The media type of the positions of pixels.
const POSITIONS: &str = "application/octet-stream";

/// The largest number of pixels whose positions are sent in one answer, which then has 48 MiB.
const MAX_POSITIONS: usize = 1 << 22;

/// A picture of the isosurface at a depth, or the positions of its pixels
///
/// With `Accept: application/octet-stream`, the answer is what the centre of each pixel shows: three little-endian f32 (x, y, z in
/// LPS mm), row by row from the top left, NaN where there is no surface. Window, colours, light, layers and annotation have no
/// influence on it. At the edge of a picture, pixels without a position may be covered by up to a half.
#[utoipa::path(
    get, path = "/v1/cases/{id}/render", tag = "pictures",
    params(("id" = String, Path, description = "The case"), PictureRequest),
    responses(
        (status = 200, description = "The picture, or the positions of its pixels", content(
            (Vec<u8> = "image/png"), (Vec<u8> = "application/octet-stream"),
        ), headers(
            ("X-Isocortex-Renderer" = String, description = "The renderer: `splat`, `mesh` or `trace`"),
            ("X-Isocortex-Device" = String, description = "The device: `cpu`, or the graphics adapter; `cpu` also if the adapter failed at this picture"),
            ("X-Isocortex-Reduction" = String, description = "If the volume is too large for the device: how many of its voxels became one, such as 2x2x1"),
            ("X-Isocortex-Size" = String, description = "With positions: width and height in pixels, such as `512,512`"),
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this picture"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether the requested depth exceeded the maximum"),
        )),
        (status = 409, description = "The case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_render(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery {
        asked: Keys(asked),
        values: picture,
    }: ApiQuery<Keys<PictureRequest>>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let media = media_type(&request, &[PNG, POSITIONS])?;
    let question = Question::new(id, "render", &asked, &request);
    // Before the backend, because finding a graphics device may take seconds, and a missing case none.
    cases.ready(&id).await?;
    if media == POSITIONS {
        let backend = backend_for(&asked, &cases.graphics).await;
        return answer_positions(question, &cases, &picture, backend).await;
    }
    let series = PictureSeries::of(&cases, &id, [picture]).await?;
    // The pixels differ between renderers and between graphics devices.
    let versions = series.versions();
    let named = series.identity().map(str::to_owned);
    let format = format_with_layers(series.backends(), versions.clone()).named(named);
    let work = async |_: Arc<CaseFacts>| {
        let keep = |image: &mut Option<(ShownDepth, EncodedImage)>, picture: SeriesPicture| {
            *image = Some((picture.depth, picture.encoded()?));
            Ok(())
        };
        let image = series.draw_each(&cases, None, keep).await?;
        let (depth, image) = image.ok_or(Error::Internal)?;
        let mut headers = depth_headers(depth);
        describe(&image, &mut headers);
        Ok(Content {
            variant: Some(with_version(image.backend.to_string(), versions)),
            body: image.png.into(),
            headers,
        })
    };
    question.answer(&cases, format, work).await
}

/// Answers with the position in LPS mm of each pixel of a picture.
async fn answer_positions(
    question: Question<'_, PictureRequest>,
    cases: &Cases,
    picture: &CheckedPicture,
    backend: RenderBackend,
) -> Result<Response, AppError> {
    let PictureRequest { width, height, .. } = *question.query;
    if width as usize * height as usize > MAX_POSITIONS {
        let detail =
            format!("times `height` must be at most {MAX_POSITIONS} pixels for their positions");
        return Err(AppError::out_of_range("width", detail));
    }
    let id = question.id;
    // Positions differ between renderers and between graphics devices, as pixels do.
    let version = question.query.version();
    let variant_of =
        |backend: &RenderBackend| with_version(format!("{POSITIONS} {backend}"), version.clone());
    let format = Format::of(POSITIONS).variant(variant_of(&backend));
    let format = match version {
        None => format,
        Some(_) => format.revalidated(),
    };
    let work = async |_: Arc<CaseFacts>| {
        let models = cases.surfaces_of(&id, &picture.asked).await?;
        let turn = cases.queue.turn().await?;
        let layers = PictureLayers::default();
        let jobs = warm_jobs(&models, picture, &layers, &backend).await?;
        let (positions, backend) = positions(jobs, &turn).await?;
        let body = turn.run(move || wire::positions(&positions)).await?;
        let mut headers = depth_headers(shown_depth(&models, picture));
        describe_backend(&backend, &mut headers);
        let size = HeaderName::from_static("x-isocortex-size");
        conditional::insert(&mut headers, size, &format!("{width},{height}"));
        Ok(Content {
            variant: Some(variant_of(&backend)),
            body,
            headers,
        })
    };
    question.answer(cases, format, work).await
}

/// The format of a picture. A picture with layers must be validated before each use, because their versions and names
/// may change.
pub(super) fn format_with_layers(variant: String, version: Option<String>) -> Format {
    let has_layers = version.is_some();
    let format = Format::of(PNG).variant(with_version(variant, version));
    if has_layers {
        format.revalidated()
    } else {
        format
    }
}

/// Distinguishes pictures with different versions of layers.
pub(super) fn with_version(variant: String, version: Option<String>) -> String {
    match version {
        Some(version) => format!("{variant}; {version}"),
        None => variant,
    }
}

/// Adds the headers with renderer, device and reduction.
fn describe(image: &EncodedImage, headers: &mut HeaderMap) {
    describe_backend(&image.backend, headers);
    if let Some([x, y, z]) = image.reduction {
        let name = HeaderName::from_static("x-isocortex-reduction");
        conditional::insert(headers, name, &format!("{x}x{y}x{z}"));
    }
}

/// Adds the headers with renderer and device.
fn describe_backend(backend: &RenderBackend, headers: &mut HeaderMap) {
    let mut insert = |name, text: &str| {
        conditional::insert(headers, HeaderName::from_static(name), text);
    };
    insert("x-isocortex-renderer", backend.name());
    insert("x-isocortex-device", &backend.device());
}
