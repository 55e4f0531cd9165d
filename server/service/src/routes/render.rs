//! Pictures of the isosurface.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use case::CaseFacts;
use cases::Cases;
use cases::pictures::{
    CheckedPicture, EncodedImage, ImageMetadata, LayerChoice, PictureRequest, backend_for, encode,
    warm_job,
};
use pipeline::maps::MAPS_FORMAT;

use super::depth_headers;
use super::query::{ApiQuery, Asked, CasePath};
use crate::conditional::{self, Content, Format, Question};
use crate::negotiate::media_type;
use crate::problem::{AppError, Problem};

/// The media type of every picture.
pub(crate) const PNG: &str = "image/png";

impl Asked for PictureRequest {
    type Values = CheckedPicture;

    fn checked(&self) -> Result<CheckedPicture, AppError> {
        Ok(PictureRequest::checked(self)?)
    }
}

/// A picture of the isosurface at a depth
#[utoipa::path(
    get, path = "/v1/cases/{id}/render", tag = "pictures",
    params(("id" = String, Path, description = "The case"), PictureRequest),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png", headers(
            ("X-Isocortex-Renderer" = String, description = "The renderer: `splat`, `mesh` or `trace`"),
            ("X-Isocortex-Device" = String, description = "The device: `cpu`, or the graphics adapter; `cpu` also if the adapter failed at this picture"),
            ("X-Isocortex-Reduction" = String, description = "If the volume is too large for the device: how many of its voxels became one, such as 2x2x1"),
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this picture"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether the requested depth exceeded the maximum"),
        )),
        (status = 304, description = "The client already has this answer"),
        (status = 400, description = "A key or value of the query is invalid", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "PNG is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work is waiting", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_render(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery {
        asked,
        values: picture,
    }: ApiQuery<PictureRequest>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let question = Question {
        id,
        route: "render",
        query: &asked,
        request: &request,
    };
    // Before the backend, because finding a graphics device may take seconds, and a missing case none.
    cases.ready(&id).await?;
    let backend = backend_for(asked.renderer, &cases.graphics).await;
    // The pixels differ between renderers and between graphics devices.
    let layers = asked.layers();
    let named = cases.identity(&id, asked.annotate).await?;
    let format = format_with_layers(backend.to_string(), &layers).named(named.clone());
    let work = async |facts: Arc<CaseFacts>| {
        let model = cases.model(&id).await?;
        let turn = cases.queue.turn().await?;
        let keyed = layers.of_case(&cases.library, &id).await?;
        let job = warm_job(&model, &picture, keyed, backend).await?;
        let metadata = ImageMetadata::of(Some(&id), &job.job).named(named);
        let drawn = job.draw(&turn).await?;
        let annotate = asked.annotate;
        let image = turn
            .run(move || encode(drawn, &metadata, annotate))
            .await??;
        let mut headers = depth_headers(picture.depth.shown_in(&facts));
        describe(&image, &mut headers);
        Ok(Content {
            variant: Some(with_maps_format(image.backend.to_string(), &layers)),
            body: image.png.into(),
            headers,
        })
    };
    question.answer(&cases, format, work).await
}

/// The format of a picture. A picture with layers must be validated before each use, because the version of the maps
/// may change.
pub(super) fn format_with_layers(variant: String, layers: &LayerChoice) -> Format {
    let format = Format::of(PNG).variant(with_maps_format(variant, layers));
    if layers.is_any() {
        format.revalidated()
    } else {
        format
    }
}

/// Distinguishes pictures with different versions of maps.
pub(super) fn with_maps_format(variant: String, layers: &LayerChoice) -> String {
    if layers.is_any() {
        format!("{variant}; maps {MAPS_FORMAT}")
    } else {
        variant
    }
}

/// The program name in every picture.
pub(crate) const SOFTWARE: &str = concat!("Isocortex ", env!("CARGO_PKG_VERSION"));

/// Adds the headers with renderer, device and reduction.
pub(super) fn describe(image: &EncodedImage, headers: &mut HeaderMap) {
    let mut insert = |name, text: &str| {
        conditional::insert(headers, HeaderName::from_static(name), text);
    };
    insert("x-isocortex-renderer", image.backend.name());
    insert("x-isocortex-device", &image.backend.device());
    if let Some([x, y, z]) = image.reduction {
        insert("x-isocortex-reduction", &format!("{x}x{y}x{z}"));
    }
}
