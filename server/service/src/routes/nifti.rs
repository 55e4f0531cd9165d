//! What is known of each voxel of a case, as NIfTI.

use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::Response;
use bytes::Bytes;
use case::VoxelValues;
use cases::Cases;
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use crate::routes::asked::{CasePath, Question};
use http::conditional::{self, Content, Format};
use http::negotiate::{GZIP, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

/// What voxels have values of.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct NiftiQuery {
    /// What the voxels have values of.
    #[param(inline)]
    values: VoxelValues,
}

impl Asked for NiftiQuery {
    type Values = ();

    fn checked(&self) -> Result<(), AppError> {
        Ok(())
    }
}

/// What is known of each voxel, as NIfTI
///
/// A gzipped NIfTI-1 file in the grid of the acquired volume, for programs that show or measure it with that volume: the brain, the depth
/// below the envelope, sides, regions, a map, or the places that a map lists. Labels are numbers in 16 bits, with their names in a
/// comment of the file; everything else but the brain is in single precision.
#[utoipa::path(
    get, path = "/v1/cases/{id}/nifti", tag = "textures",
    params(("id" = String, Path, description = "The case"), NiftiQuery),
    responses(
        (status = 200, description = "The file (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The requested range"),
        (status = 406, description = "`application/gzip` is not accepted"),
        (status = 409, description = "The case or its maps are not ready, or the maps are undefined"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_nifti(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked: query, .. }: ApiQuery<NiftiQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[GZIP])?;
    let question = Question::new(id, "nifti", &query, &request);
    let format = match cases.nifti_version(&id, query.values).await? {
        Some(version) => Format::of(GZIP).variant(version).revalidated(),
        None => Format::of(GZIP),
    };
    let work = async |_| {
        let file = cases.nifti(&id, query.values).await?;
        Ok(nifti_file(query.values.name(), file.bytes))
    };
    question.answer(&cases, format, work).await
}

/// A file to keep under a name.
pub(super) fn nifti_file(name: &str, file: Vec<u8>) -> Content {
    let mut headers = HeaderMap::new();
    let disposition = format!("attachment; filename=\"{name}.nii.gz\"");
    conditional::insert(&mut headers, header::CONTENT_DISPOSITION, &disposition);
    Content {
        headers,
        ..Bytes::from(file).into()
    }
}
