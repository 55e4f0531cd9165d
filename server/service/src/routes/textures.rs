//! The voxels of a case as three-dimensional textures.

use std::future::ready;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;
use utoipa::openapi::schema::{Object, ObjectBuilder, Type};

use super::bodies::{Bodies, BodyKey, BodyKind, Extent};
use super::of_surface;
use crate::routes::asked::{CasePath, Question};
use crate::wire::{self, Texture, Voxels};
use case::SurfaceName;
use cases::Cases;
use cases::pictures::check_count;
use http::conditional::{self, Content, Format};
use http::negotiate::{Coding, media_type};
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

pub(super) const MEDIA_TYPE: &str = "application/octet-stream";

/// The greatest step of the depths.
const MAX_STEP: usize = 16;

/// The format of the intensities.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct VolumeQuery {
    /// 16: as acquired. 8: for a first picture, over the default window and half its width to either side.
    #[serde(default = "all_bits")]
    #[param(schema_with = eight_or_sixteen)]
    bits: u8,
    /// `envelope`: what pictures of surfaces show. `whole`: all that was acquired, which slices show.
    #[serde(default, skip_serializing_if = "Extent::is_default")]
    #[param(inline)]
    extent: Extent,
}

/// The format of the depths.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct DistanceQuery {
    /// The surface from which depth is measured: of the whole brain, or of a part, as for pictures.
    #[serde(default, skip_serializing_if = "SurfaceName::is_whole")]
    #[param(inline)]
    surface: SurfaceName,
    /// Every n-th voxel along each axis, from the first on; 4 is enough for the shading of a first picture.
    #[serde(default = "every_voxel")]
    #[param(minimum = 1, maximum = 16, default = 1)]
    step: usize,
}

fn eight_or_sixteen() -> Object {
    ObjectBuilder::new()
        .schema_type(Type::Integer)
        .enum_values(Some([8, 16]))
        .default(Some(16.into()))
        .build()
}

fn all_bits() -> u8 {
    16
}

fn every_voxel() -> usize {
    1
}

impl Asked for VolumeQuery {
    type Values = Self;

    fn checked(&self) -> Result<Self, AppError> {
        match self.bits {
            8 | 16 => Ok(*self),
            bits => Err(AppError::out_of_range(
                "bits",
                format!("is {bits}; it must be 8 or 16"),
            )),
        }
    }
}

impl Asked for DistanceQuery {
    type Values = Self;

    fn checked(&self) -> Result<Self, AppError> {
        check_count("step", self.step, 1, MAX_STEP)?;
        Ok(*self)
    }
}

/// The intensities, cropped to the envelope or whole
///
/// Unsigned voxels of 16 bits as acquired, or of 8, little-endian, x-fastest; the headers describe them.
#[utoipa::path(
    get, path = "/v1/cases/{id}/volume", tag = "textures",
    params(("id" = String, Path, description = "The case"), VolumeQuery),
    responses(
        (status = 200, description = "The voxels", body = Vec<u8>, content_type = "application/octet-stream", headers(
            ("X-Isocortex-Size" = String, description = "Voxels along x, y and z: `181,217,181`"),
            ("X-Isocortex-Format" = String, description = "`u8`, `u16` or `i16`"),
            ("X-Isocortex-Scale" = f32, description = "Intensity of a stored unit"),
            ("X-Isocortex-Offset" = f32, description = "Intensity of the stored 0"),
            ("X-Isocortex-Patient-From-Voxel" = String, description = "Three rows of the affine from voxel centres to LPS mm"),
        )),
        (status = 206, description = "The requested range"),
        (status = 409, description = "The case is not ready"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_volume(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    ApiQuery { values: query, .. }: ApiQuery<VolumeQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let texture = async || {
        let facts = cases.ready(&id).await?;
        let range = (query.bits == 8).then(|| wire::quick_range(&facts));
        Ok(match query.extent {
            Extent::Envelope => wire::volume_texture(cases.model(&id).await?, range),
            Extent::Whole => wire::volume_texture(cases.whole_volume(&id).await?, range),
        })
    };
    let question = Question::new(id, "volume", &query, &request);
    answer(
        &cases,
        &bodies,
        question,
        Source {
            surface: SurfaceName::Whole,
            kind: BodyKind::Volume(query.bits, query.extent),
            texture,
        },
    )
    .await
}

/// The signed depth on the working grid
///
/// Signed 16-bit voxels, little-endian, x-fastest, positive inside; the headers describe them.
///
/// Outside the envelope, distances are exact up to 6 voxels; farther voxels have the distance of 6 voxels. If the case
/// has `cuts`, a value is the distance to the nearest border, either dura or cut; it is a depth only if the voxel is
/// farther than that, plus one voxel, from each cut.
///
/// Of a part, the lowest bit of each value is not part of the distance: it is 1 where the depth is unknown, because a fence is nearer
/// than the dura.
#[utoipa::path(
    get, path = "/v1/cases/{id}/distance", tag = "textures",
    params(("id" = String, Path, description = "The case"), DistanceQuery),
    responses(
        (status = 200, description = "The voxels", body = Vec<u8>, content_type = "application/octet-stream", headers(
            ("X-Isocortex-Size" = String, description = "Voxels along x, y and z: `181,217,181`"),
            ("X-Isocortex-Format" = String, description = "`u8`, `u16` or `i16`"),
            ("X-Isocortex-Scale" = f32, description = "Depth of a stored unit, in mm"),
            ("X-Isocortex-Offset" = f32, description = "Depth of the stored 0, in mm"),
            ("X-Isocortex-Patient-From-Voxel" = String, description = "Three rows of the affine from voxel centres to LPS mm"),
        )),
        (status = 206, description = "The requested range"),
        (status = 409, description = "The case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
        (status = 416, description = "The range begins beyond the end"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_distance(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    ApiQuery { values: query, .. }: ApiQuery<DistanceQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let texture = async || {
        let model = cases.surface(&id, query.surface).await?;
        Ok(match query.step {
            1 => wire::depth_texture(&model),
            step => wire::coarse_depth_texture(&model, step),
        })
    };
    let question = Question::new(id, "distance", &query, &request);
    answer(
        &cases,
        &bodies,
        question,
        Source {
            kind: BodyKind::Distance(query.step, query.surface),
            surface: query.surface,
            texture,
        },
    )
    .await
}

/// Where a texture comes from.
struct Source<F> {
    kind: BodyKind,
    surface: SurfaceName,
    texture: F,
}

async fn answer(
    cases: &Cases,
    bodies: &Bodies,
    question: Question<'_, impl Serialize>,
    source: Source<impl AsyncFnOnce() -> Result<Texture, AppError>>,
) -> Result<Response, AppError> {
    let Source {
        kind,
        surface,
        texture,
    } = source;
    let (id, request) = (question.id, question.request);
    media_type(request, &[MEDIA_TYPE])?;
    let format = Format::compressed(MEDIA_TYPE, request);
    let format = of_surface(format, MEDIA_TYPE, surface);
    let coding = format.coding();
    let work = async |_| {
        // What is not compressed has its turn here; the other turn is for the compression.
        let texture = {
            let _turn = cases.queue.turn().await?;
            texture().await?
        };
        let headers = layout(&texture);
        let body = match (texture.voxels, coding) {
            (Voxels::Shared(bytes), Coding::Identity) => bytes,
            (voxels, _) => {
                let voxels = ready(Ok::<_, AppError>(voxels));
                let body = bodies.get(BodyKey { id, kind, coding }, voxels, Voxels::bytes);
                body.await?
            }
        };
        Ok(Content {
            headers,
            ..body.into()
        })
    };
    question.answer(cases, format, work).await
}

/// The headers that describe a texture.
pub(super) fn layout(texture: &Texture) -> HeaderMap {
    let size = texture.size.map(|side| side.to_string()).join(",");
    let affine = texture.patient_from_voxel.map(|x| x.to_string()).join(",");
    let mut headers = HeaderMap::new();
    for (name, text) in [
        ("x-isocortex-size", size),
        ("x-isocortex-format", texture.format.to_owned()),
        ("x-isocortex-scale", texture.scale.to_string()),
        ("x-isocortex-offset", texture.offset.to_string()),
        ("x-isocortex-patient-from-voxel", affine),
    ] {
        conditional::insert(&mut headers, HeaderName::from_static(name), &text);
    }
    headers
}
