//! The voxels of a layer, as bytes and as NIfTI.

use std::sync::Arc;

use axum::extract::{RawPathParams, State};
use axum::http::{HeaderMap, header};
use axum::response::Response;
use case::{CaseId, Layer};
use cases::library::LayerVoxels;
use cases::pictures::ChosenLayer;
use cases::{Cases, Error};

use super::{layer_of, map_of};
use crate::routes::asked::{CasePath, Question};
use crate::routes::bodies::{Bodies, BodyKey, BodyKind};
use crate::routes::nifti::nifti_file;
use crate::routes::textures::{MEDIA_TYPE, layout};
use crate::wire;
use http::conditional::{self, Content, Format};
use http::negotiate::{GZIP, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};

/// The layer that the path names.
async fn chosen(cases: &Cases, id: &CaseId, path: &RawPathParams) -> Result<ChosenLayer, AppError> {
    Ok(match map_of(path) {
        Some(name) => cases.map(id, name).await?,
        None => ChosenLayer::Layer(Arc::new(cases.layer(id, &layer_of(path)?).await?)),
    })
}

/// Distinguishes answers with different versions of a layer.
fn variant(layer: &ChosenLayer) -> String {
    match layer {
        ChosenLayer::Map { name, .. } => format!("{} {}", name.name(), layer.version()),
        ChosenLayer::Layer(_) => layer.version(),
    }
}

/// The voxels of a layer
///
/// x-fastest, little-endian, with the affine into the patient space of the case; 0 is undefined, and any other number
/// has the value number × scale + offset. The headers give format, scale and offset. Interpolate between defined voxels
/// only. A map of the case has one byte per voxel on a block of the grid of the volume. An added layer has its own
/// voxels around the envelope: two bytes per voxel, or for a label map one byte, the number of a label from 1 (after
/// 255, numbers begin again), which must not be interpolated.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}/volume", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The name of a map, or the id or name of an added layer"),
    ),
    responses(
        (status = 200, description = "The voxels", body = Vec<u8>, content_type = "application/octet-stream", headers(
            ("X-Isocortex-Size" = String, description = "Voxels along x, y and z: `181,217,181`"),
            ("X-Isocortex-Format" = String, description = "`u8` or `u16`"),
            ("X-Isocortex-Scale" = f32, description = "Value of a step from one number to the next"),
            ("X-Isocortex-Offset" = f32, description = "Value that the number 0 would have, although it means undefined"),
            ("X-Isocortex-Undefined" = u8, description = "The number of undefined voxels: 0"),
            ("X-Isocortex-Patient-From-Voxel" = String, description = "Three rows of the affine from voxel centres to LPS mm of the case"),
        )),
        (status = 206, description = "The requested range"),
        (status = 404, description = "No such case or layer"),
        (status = 409, description = "The case or the layer is not ready, or the layer is undefined"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_layer_volume(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked: query, .. }: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let layer = chosen(&cases, &id, &path).await?;
    media_type(&request, &[MEDIA_TYPE])?;
    let question = Question::new(id, "layers/volume", &query, &request);
    let format = Format::compressed(MEDIA_TYPE, &request)
        .variant(variant(&layer))
        .revalidated();
    let coding = format.coding();
    let work = async |_| {
        let (texture, kind) = match &layer {
            ChosenLayer::Map { name, of_layer } => {
                let maps = layer.maps(&cases.library, &id).await?;
                let texture = wire::layer_texture(maps.grid(), maps.layer(*name));
                (texture, BodyKind::Map(*name, *of_layer))
            }
            ChosenLayer::Layer(row) => {
                let voxels = cases.library.layer_voxels(row).await?;
                (
                    wire::added_layer_texture(voxels)?,
                    BodyKind::AddedLayer(row.id),
                )
            }
        };
        let mut headers = layout(&texture);
        let undefined = header::HeaderName::from_static("x-isocortex-undefined");
        conditional::insert(&mut headers, undefined, "0");
        let key = BodyKey { id, kind, coding };
        let voxels = std::future::ready(Ok::<_, AppError>(texture.voxels));
        let body = bodies.get(key, voxels, wire::Voxels::bytes).await?;
        Ok(Content {
            headers,
            ..body.into()
        })
    };
    question.answer(&cases, format, work).await
}

/// A layer as NIfTI
///
/// A gzipped NIfTI-1 file in single precision, NaN if undefined (0 in a label map), positioned in the patient space of the case. A map
/// is in the grid of the acquired volume; an added layer has the voxels of `volume`.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}/nifti", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The name of a map, or the id or name of an added layer"),
    ),
    responses(
        (status = 200, description = "The layer (.nii.gz)", body = Vec<u8>, content_type = "application/gzip"),
        (status = 206, description = "The requested range"),
        (status = 404, description = "No such case or layer"),
        (status = 409, description = "The case or the layer is not ready, or the layer is undefined"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_layer_nifti(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    path: RawPathParams,
    ApiQuery { asked: query, .. }: ApiQuery<NoQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let layer = chosen(&cases, &id, &path).await?;
    media_type(&request, &[GZIP])?;
    let question = Question::new(id, "layers/nifti", &query, &request);
    let format = Format::of(GZIP).variant(variant(&layer)).revalidated();
    let work = async |_| {
        let (file, name) = match &layer {
            ChosenLayer::Map { name, .. } => {
                let file = cases.nifti(&id, (*name).into()).await?;
                (file.bytes, name.name().to_owned())
            }
            ChosenLayer::Layer(row) => {
                let voxels = cases.library.layer_voxels(row).await?;
                let file = cases.queue.run(move || layer_as_nifti(&voxels)).await??;
                (file, file_name(row))
            }
        };
        Ok(nifti_file(&name, file))
    };
    question.answer(&cases, format, work).await
}

/// The kind of a layer and the first digits of its id; its name may be anything.
fn file_name(layer: &Layer) -> String {
    let id = layer.id.to_string();
    format!("{}-{}", layer.parameters.kind.name(), &id[..8])
}

fn layer_as_nifti(voxels: &LayerVoxels) -> Result<Vec<u8>, Error> {
    let numbers = pipeline::layers::numbers_of(&voxels.volume, &voxels.facts, voxels.kind);
    let grid = voxels.grid_in_case()?;
    imaging::nifti::write_numbers(&grid, &numbers).map_err(|_| Error::Internal)
}
