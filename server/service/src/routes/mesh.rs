//! The mesh at a depth, its triangles, and all depths at once.

use cases::Cases;
use std::future::ready;
use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName};
use axum::response::Response;
use bytes::Bytes;
use geometry::{DeformableModel, DepthField, MeshSize, PathTable, ShrunkMesh};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

use super::bodies::{Bodies, BodyKey, BodyKind};
use super::{depth_headers, of_surface};
use crate::routes::asked::{CasePath, Question};
use crate::wire;
use case::SurfaceName;
use cases::models::PathKind;
use cases::pictures::{DepthMm, ShownDepth, default_count, mesh_size};
use http::conditional::{self, Content, Format};
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

const POSITIONS: &str = "application/octet-stream";
const GLTF: &str = "model/gltf-binary";
const STL: &str = "model/stl";
const OBJ: &str = "model/obj";
const PLY: &str = "application/ply";

/// The media types of a mesh; the first is the default.
const MESH_TYPES: &[&str] = &[POSITIONS, GLTF, STL, OBJ, PLY];

/// Those of a solid.
const SOLID_TYPES: &[&str] = MESH_TYPES.split_at(1).1;

/// The greatest number of points of a mesh with all depths; its table has about 50 MB.
const MAX_TABULATED_POINTS: usize = 1 << 16;

/// The mesh at a depth.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct MeshQuery {
    /// Depth below the envelope in mm; a greater depth than the maximum of the case is clamped to it.
    #[serde(default)]
    #[param(minimum = 0, default = 0)]
    depth_mm: f32,
    /// The surface below which depth is measured: of the whole brain, or of a part, as for pictures.
    #[serde(default, skip_serializing_if = "SurfaceName::is_whole")]
    #[param(inline)]
    surface: SurfaceName,
    /// Number of contours, N_F in the paper: sagittal, or coronal for the surfaces `left` and `right`.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, N_P in the paper.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
    /// The paths of the vertices.
    #[serde(default)]
    #[param(inline)]
    paths: PathKind,
    /// Whether to answer with the isosurface itself, as a closed mesh, which `renderer=trace` shows: for printing and planning. It has
    /// no contours and no paths, and is GLB, STL, OBJ or PLY.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[param(default = false)]
    solid: bool,
}

/// The triangles of a mesh.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TrianglesQuery {
    /// Number of contours, N_F in the paper.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, N_P in the paper.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
}

/// The paths of a mesh.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PathsQuery {
    /// The surface: of the whole brain, or of a part, as for pictures.
    #[serde(default, skip_serializing_if = "SurfaceName::is_whole")]
    #[param(inline)]
    surface: SurfaceName,
    /// Number of contours, N_F in the paper: sagittal, or coronal for the surfaces `left` and `right`.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 512, default = 30)]
    contours: usize,
    /// Number of points on each contour, N_P in the paper.
    #[serde(default = "default_count")]
    #[param(minimum = 3, maximum = 1024, default = 30)]
    points: usize,
    /// The paths of the vertices.
    #[serde(default)]
    #[param(inline)]
    paths: PathKind,
}

/// A checked request for a mesh at a depth.
#[derive(Debug)]
pub struct MeshValues {
    depth: DepthMm,
    size: MeshSize,
}

impl Asked for MeshQuery {
    type Values = MeshValues;

    fn checked(&self) -> Result<MeshValues, AppError> {
        let values = MeshValues {
            depth: DepthMm::new(self.depth_mm)?,
            size: mesh_size(self.contours, self.points)?,
        };
        for (key, is_given) in [
            ("contours", self.contours != default_count()),
            ("points", self.points != default_count()),
            ("paths", self.paths != PathKind::default()),
        ] {
            if self.solid && is_given {
                let detail =
                    "is not accepted with `solid=true`, which has the vertices of the isosurface";
                return Err(AppError::out_of_range(key, detail));
            }
        }
        Ok(values)
    }
}

impl Asked for TrianglesQuery {
    type Values = MeshSize;

    fn checked(&self) -> Result<MeshSize, AppError> {
        Ok(mesh_size(self.contours, self.points)?)
    }
}

impl Asked for PathsQuery {
    type Values = MeshSize;

    fn checked(&self) -> Result<MeshSize, AppError> {
        let size = mesh_size(self.contours, self.points)?;
        if self.contours * self.points > MAX_TABULATED_POINTS {
            let detail =
                format!("times `points` must be at most {MAX_TABULATED_POINTS} for this request");
            return Err(AppError::out_of_range("contours", detail));
        }
        Ok(size)
    }
}

/// The mesh of the isosurface at a depth
///
/// Depending on `Accept`: only the positions, three little-endian f32 (x, y, z in LPS mm) for each vertex, the points
/// contour by contour and then the two cap centres, NaN if the depth there is unknown; or a complete mesh as GLB (y up, metres),
/// STL, OBJ or PLY (LPS mm). With `solid=true` the isosurface itself, closed, in one of these.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh", tag = "meshes",
    params(("id" = String, Path, description = "The case"), MeshQuery),
    responses(
        (status = 200, description = "The mesh", headers(
            ("X-Isocortex-Depth-Mm" = f32, description = "The depth of this mesh"),
            ("X-Isocortex-Depth-Clamped" = bool, description = "Whether the requested depth exceeded the maximum"),
            ("X-Isocortex-Unknown-Vertices" = usize, description = "How many vertices have no known depth, because a face that cuts the brain, or the fence of a part, is nearer than the dura; their positions are NaN in `application/octet-stream`, and the other formats leave out their triangles; a solid is closed there, too"),
            ("X-Isocortex-Shallow-Vertices" = usize, description = "How many vertices are shallower than the mesh, because their paths end before its depth"),
            ("ETag" = String, description = "A strong tag"),
        ), content(
            (Vec<u8> = "application/octet-stream"), (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "model/stl"),
            (String = "model/obj"), (Vec<u8> = "application/ply"),
        )),
        (status = 409, description = "The case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_mesh(
    State(cases): State<Cases>,
    CasePath(id): CasePath,
    ApiQuery { asked, values }: ApiQuery<MeshQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    let types = if asked.solid { SOLID_TYPES } else { MESH_TYPES };
    let format = media_type(&request, types)?;
    let question = Question::new(id, "mesh", &asked, &request);
    let work = async |_| {
        let model = cases.surface(&id, asked.surface).await?;
        let (size, depth) = (values.size, values.depth.shown_in(model.facts()));
        if asked.solid {
            let turn = cases.queue.turn().await?;
            let model = Arc::clone(model.model());
            let work = move || encode_solid(&model, depth.mm, format);
            let (body, lacking) = turn.run(work).await??;
            return Ok(content(body, depth, &lacking));
        }
        let shrunk = model.shrink(size, asked.paths, depth.mm);
        let (body, lacking) = if format == POSITIONS && model.has_at_hand(size, asked.paths) {
            // This takes microseconds, so it does not wait for a turn.
            encode(shrunk.await?, model.model().field(), (size, format))
        } else {
            let turn = cases.queue.turn().await?;
            let (shrunk, model) = (shrunk.await?, Arc::clone(model.model()));
            let work = move || encode(shrunk, model.field(), (size, format));
            turn.run(work).await?
        };
        Ok(content(body, depth, &lacking))
    };
    let format = of_surface(Format::of(format), format, asked.surface);
    question.answer(&cases, format, work).await
}

/// How many vertices of a mesh have no true depth.
struct Lacking {
    unknown: usize,
    shallow: usize,
}

fn content(body: Bytes, depth: ShownDepth, lacking: &Lacking) -> Content {
    let mut headers = depth_headers(depth);
    for (name, count) in [
        ("x-isocortex-unknown-vertices", lacking.unknown),
        ("x-isocortex-shallow-vertices", lacking.shallow),
    ] {
        let name = HeaderName::from_static(name);
        conditional::insert(&mut headers, name, &count.to_string());
    }
    Content {
        headers,
        ..body.into()
    }
}

fn encode(
    mut shrunk: ShrunkMesh,
    field: &DepthField,
    (size, format): (MeshSize, &str),
) -> (Bytes, Lacking) {
    let unknown = shrunk.unknown_vertices(field);
    let lacking = Lacking {
        unknown: unknown.len(),
        shallow: shrunk.shallow_count(field),
    };
    if format == POSITIONS {
        for vertex in unknown {
            shrunk.positions_in_patient[vertex] = [f32::NAN; 3];
        }
        return (wire::positions(&shrunk.positions_in_patient), lacking);
    }
    (encode_file(&shrunk, &unknown, size, format), lacking)
}

/// The isosurface at a depth as a file.
fn encode_solid(
    model: &DeformableModel,
    depth_mm: f32,
    format: &str,
) -> Result<(Bytes, Lacking), AppError> {
    let solid = render::solid(model, depth_mm.into());
    if solid.triangles.is_empty() {
        let detail = "is so great that nothing is left of a solid; choose a smaller one";
        return Err(AppError::out_of_range("depth_mm", detail));
    }
    let is_known = |position: &&[f32; 3]| {
        let position = Vec3::from_array(**position).as_dvec3();
        model.field().is_known(position, depth_mm)
    };
    let positions = &solid.positions_in_patient;
    let lacking = Lacking {
        unknown: positions.len() - positions.iter().filter(is_known).count(),
        shallow: 0,
    };
    let mesh = wire::Mesh {
        depth_mm,
        positions_in_patient: positions,
        triangles: &solid.triangles,
    };
    Ok((file(mesh, format), lacking))
}

/// A mesh as a file, without the triangles that touch a vertex of unknown depth or have no area. Programs that read such files expect
/// a position for each vertex.
fn encode_file(shrunk: &ShrunkMesh, unknown: &[usize], size: MeshSize, format: &str) -> Bytes {
    let mut is_known = vec![true; shrunk.positions_in_patient.len()];
    for &vertex in unknown {
        is_known[vertex] = false;
    }
    let mut triangles = size.triangles();
    triangles.retain(|triangle| {
        let corners = triangle.map(|vertex| shrunk.positions_in_patient[vertex as usize]);
        let [a, b, c] = corners.map(|corner| Vec3::from_array(corner).as_dvec3());
        let is_known = triangle.iter().all(|&vertex| is_known[vertex as usize]);
        is_known && (b - a).cross(c - a) != DVec3::ZERO
    });
    let mesh = wire::Mesh {
        depth_mm: shrunk.depth_mm,
        positions_in_patient: &shrunk.positions_in_patient,
        triangles: &triangles,
    };
    file(mesh, format)
}

fn file(mesh: wire::Mesh<'_>, format: &str) -> Bytes {
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
/// Three little-endian u32 vertex numbers for each triangle, counter-clockwise seen from outside. The same for every
/// case and depth.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh/triangles", tag = "meshes",
    params(("id" = String, Path, description = "The case"), TrianglesQuery),
    responses(
        (status = 200, description = "The triangles", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 409, description = "The case is not ready"),
    )
)]
pub async fn get_triangles(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    ApiQuery {
        asked,
        values: size,
    }: ApiQuery<TrianglesQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    media_type(&request, &[POSITIONS])?;
    let question = Question::new(id, "mesh/triangles", &asked, &request);
    let format = Format::compressed(POSITIONS, &request);
    let coding = format.coding();
    let work = async |_| {
        let kind = BodyKind::Triangles(size);
        let encode = |size: MeshSize| wire::triangles(&size.triangles());
        let size = ready(Ok::<_, AppError>(size));
        let body = bodies.get(BodyKey { id, kind, coding }, size, encode);
        Ok(body.await?.into())
    };
    question.answer(&cases, format, work).await
}

/// The mesh at every depth
///
/// With this table, a client computes the mesh at any depth itself. The README of `wire` describes the layout.
#[utoipa::path(
    get, path = "/v1/cases/{id}/mesh/paths", tag = "meshes",
    params(("id" = String, Path, description = "The case"), PathsQuery),
    responses(
        (status = 200, description = "The table of positions by depth", body = Vec<u8>, content_type = "application/vnd.isocortex.paths"),
        (status = 409, description = "The case is not ready, or has only the surface of the whole brain: `no-surfaces`"),
        (status = 503, description = "Too much work is waiting (`busy`), or the stored upload is missing (`source-missing`)"),
    )
)]
pub async fn get_paths(
    State(cases): State<Cases>,
    State(bodies): State<Bodies>,
    CasePath(id): CasePath,
    ApiQuery {
        asked,
        values: size,
    }: ApiQuery<PathsQuery>,
    request: HeaderMap,
) -> Result<Response, AppError> {
    const PATHS: &str = "application/vnd.isocortex.paths";
    media_type(&request, &[PATHS, POSITIONS])?;
    let question = Question::new(id, "mesh/paths", &asked, &request);
    // The layout counts in the tag.
    let format = Format::compressed(PATHS, &request).variant("paths 2");
    let format = of_surface(format, "paths 2", asked.surface);
    let coding = format.coding();
    let work = async |_| {
        let paths = asked.paths;
        let model = cases.surface(&id, asked.surface).await?;
        let kind = BodyKind::Paths(size, paths, asked.surface);
        let on_envelope = Arc::clone(model.model());
        let encode = move |table: Arc<PathTable>| {
            let field = on_envelope.field();
            let astray = wire::Astray {
                unknown: table.shrink(0.0).unknown_vertices(field).len(),
                shallow: table.shallow_counts(field),
            };
            wire::paths(&table, paths, &astray)
        };
        let table = model.paths(size, paths);
        let body = bodies.get(BodyKey { id, kind, coding }, table, encode);
        Ok(body.await?.into())
    };
    question.answer(&cases, format, work).await
}
