//! Pictures of what was acquired, for which a case need not be ready.

use axum::extract::{RawPathParams, State};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use cases::Cases;
use cases::pictures::AcquiredQuery;
use render::SlicePlane;

use super::render::PNG;
use super::slices::plane_of;
use crate::routes::asked::{CasePath, Keys, Question};
use http::conditional::Format;
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::ApiQuery;

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
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_acquired(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery {
        asked: Keys(asked),
        values,
    }: ApiQuery<Keys<AcquiredQuery>>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[PNG])?;
    let plane = plane_of(&path)?;
    let question = Question::new(id, "acquired", &asked, &request);
    let named = cases.identity(&id, asked.annotate).await?;
    let work = async || {
        let volume = cases.acquired_volume(&id).await?;
        let named = named.clone();
        let picture = cases
            .queue
            .run(move || values.draw(&volume, &id, plane, named.as_deref()));
        Ok(Bytes::from(picture.await??).into())
    };
    let format = Format::of(PNG).variant(plane.name()).named(named.clone());
    question.answer_of_any(&cases, format, work).await
}
