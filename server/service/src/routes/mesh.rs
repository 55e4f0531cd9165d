//! The mesh at a depth, its triangles, and all depths at once.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use geometry::{MeshSize, ShrunkMesh};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::bodies::{BodyKey, BodyKind};
use super::depth_headers;
use super::query::{ApiQuery, CasePath, Checked};
use crate::caching::{EntityTag, IMMUTABLE, Representation, coding_for, not_modified};
use crate::negotiate::{Coding, media_type};
use crate::problem::{AppError, Problem};
use crate::state::AppState;
use crate::wire;
use cases::models::PathKind;
use cases::pictures::{check_depth, check_size, default_count};

const POSITIONS: &str = "application/octet-stream";
const GLTF: &str = "model/gltf-binary";
const STL: &str = "model/stl";
const OBJ: &str = "model/obj";
const PLY: &str = "application/ply";

/// The media types of a mesh; the first is the default.
const MESH_TYPES: &[&str] = &[POSITIONS, GLTF, STL, OBJ, PLY];

/// The most points of a mesh of which every depth is sent: their table has some 50 MB.
const MAX_TABULATED_POINTS: usize = 1 << 16;

/// The mesh at a depth.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct MeshQuery {
    /// Depth below the envelope in mm; more than the case's maximum is clamped to it.
    #[serde(default)]
    #[param(minimum = 0, default = 0)]
    depth_mm: f32,
    /// Number of sagittal contours, the paper's N_F.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, the paper's N_P.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
    /// What vertices follow.
    #[serde(default)]
    #[param(inline)]
    paths: PathKind,
}

/// The triangles of a mesh.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TrianglesQuery {
    /// Number of sagittal contours, the paper's N_F.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, the paper's N_P.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
}

/// The paths of a mesh.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PathsQuery {
    /// Number of sagittal contours, the paper's N_F.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, the paper's N_P.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
    /// What vertices follow.
    #[serde(default)]
    #[param(inline)]
    paths: PathKind,
}

impl Checked for MeshQuery {
    fn check(&self) -> Result<(), AppError> {
        check_depth(self.depth_mm)?;
        Ok(check_size(self.contours, self.points)?)
    }
}

impl Checked for TrianglesQuery {
    fn check(&self) -> Result<(), AppError> {
        Ok(check_size(self.contours, self.points)?)
    }
}

impl Checked for PathsQuery {
    fn check(&self) -> Result<(), AppError> {
        check_size(self.contours, self.points)?;
        if self.contours * self.points > MAX_TABULATED_POINTS {
            let detail = format!("times `points` must be at most {MAX_TABULATED_POINTS} here");
            return Err(AppError::out_of_range("contours", detail));
        }
        Ok(())
    }
}

/// The mesh of the isosurface at a depth
///
/// By `Accept`: the positions alone, three little-endian f32 (x, y, z in LPS mm) for each vertex, the points contour by contour and
/// then the two cap centres; or a whole mesh as GLB (y up, metres), STL, OBJ or PLY (LPS mm).
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh", tag = "meshes",
    params(("id" = String, Path, description = "The case"), MeshQuery),
    responses(
        (status = 200, description = "The mesh", headers(
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this mesh"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether more than the maximum was asked for"),
            ("ETag" = String, description = "A strong tag"),
        ), content(
            (Vec<u8> = "application/octet-stream"), (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "model/stl"),
            (String = "model/obj"), (Vec<u8> = "application/ply"),
        )),
        (status = 304, description = "The client has it already"),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "No accepted media type is offered", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_mesh(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    ApiQuery(query): ApiQuery<MeshQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let format = media_type(&request, MESH_TYPES)?;
    let tag = EntityTag::of_answer(&id, "mesh", &query, (format, Coding::Identity));
    let facts = state.cases.ready(&id).await?;
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept", IMMUTABLE));
    }
    let size = MeshSize::new(query.contours, query.points)?;
    let model = state.model(&id).await?;
    let depth_mm = query.depth_mm.min(facts.max_depth_mm);
    let kind = query.paths;
    let at_hand = model.model().default_paths();
    let shrunk = if at_hand.size == size && kind == PathKind::Forest {
        at_hand.shrink(depth_mm)
    } else {
        let shrunk = model.shrink(size, kind, depth_mm);
        state.cases.turnstile.pass(shrunk).await??
    };
    let body = if format == POSITIONS {
        wire::positions(&shrunk)
    } else {
        let encoded = state.cases.pool.run(move || encode(&shrunk, size, format));
        encoded.await?
    };
    Representation {
        headers: depth_headers(query.depth_mm, facts.max_depth_mm),
        vary: "accept",
        ..Representation::immutable(tag, format, body)
    }
    .respond(&request)
}

fn encode(shrunk: &ShrunkMesh, size: MeshSize, format: &str) -> Bytes {
    let triangles = size.triangles();
    let mesh = wire::Mesh {
        shrunk,
        triangles: &triangles,
    };
    let file = match format {
        GLTF => wire::gltf(mesh),
        STL => wire::stl(mesh),
        OBJ => wire::obj(mesh),
        _ => wire::ply(mesh),
    };
    file.into()
}

/// The triangles of every mesh of a size
///
/// Three little-endian u32 vertex numbers for each triangle, counter-clockwise seen from outside. The same for every case and depth.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh/triangles", tag = "meshes",
    params(("id" = String, Path, description = "The case"), TrianglesQuery),
    responses(
        (status = 200, description = "The triangles", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "The client has it already"),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_triangles(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    ApiQuery(query): ApiQuery<TrianglesQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[POSITIONS])?;
    let coding = coding_for(&request);
    let tag = EntityTag::of_answer(&id, "mesh/triangles", &query, (POSITIONS, coding));
    state.cases.ready(&id).await?;
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept-encoding", IMMUTABLE));
    }
    let size = MeshSize::new(query.contours, query.points)?;
    let key = BodyKey {
        id,
        kind: BodyKind::Triangles(size),
        coding,
    };
    let make = move || wire::triangles(&size.triangles());
    let body = state.bodies.get(key, make).await?;
    Representation {
        coding,
        vary: "accept-encoding",
        ..Representation::immutable(tag, POSITIONS, body)
    }
    .respond(&request)
}

/// The mesh at every depth
///
/// With it a client shrinks the mesh by itself. The layout is in the wire README.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh/paths", tag = "meshes",
    params(("id" = String, Path, description = "The case"), PathsQuery),
    responses(
        (status = 200, description = "The table of positions by depth", body = Vec<u8>, content_type = "application/vnd.isocortex.paths"),
        (status = 304, description = "The client has it already"),
        (status = 400, description = "A key or value of the query is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn get_paths(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    ApiQuery(query): ApiQuery<PathsQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    const PATHS: &str = "application/vnd.isocortex.paths";
    media_type(&request, &[PATHS, POSITIONS])?;
    let coding = coding_for(&request);
    let tag = EntityTag::of_answer(&id, "mesh/paths", &query, (PATHS, coding));
    state.cases.ready(&id).await?;
    if tag.is_known_to(&request) {
        return Ok(not_modified(&tag, "accept-encoding", IMMUTABLE));
    }
    let size = MeshSize::new(query.contours, query.points)?;
    let kind = query.paths;
    let model = state.model(&id).await?;
    let table = state
        .cases
        .turnstile
        .pass(model.paths(size, kind))
        .await??;
    let key = BodyKey {
        id,
        kind: BodyKind::Paths(size, kind),
        coding,
    };
    let body = state
        .bodies
        .get(key, move || wire::paths(&table, kind))
        .await?;
    Representation {
        coding,
        vary: "accept-encoding",
        ..Representation::immutable(tag, PATHS, body)
    }
    .respond(&request)
}
