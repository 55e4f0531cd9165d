//! The mesh at a depth, its triangles, and all depths at once.

mod values;

use cases::Cases;
use std::future::ready;
use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, header};
use axum::response::Response;
use bytes::Bytes;
use geometry::{DeformableModel, MeshSize, PathTable, ShrunkMesh};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use self::values::{Changing, Values, VertexValues};
use super::bodies::{Bodies, BodyKey, BodyKind};
use super::{depth_headers, of_surface};
use crate::routes::asked::{CasePath, Question};
use crate::wire::{self, VolumeGeometry};
use case::SurfaceName;
use cases::models::PathKind;
use cases::nifti::native_grid;
use cases::pictures::{DepthMm, ShownDepth, default_count, mesh_size};
use http::conditional::{self, Content, Format};
use http::negotiate::media_type;
use http::problem::AppError;
use http::query::{ApiQuery, Asked};

const POSITIONS: &str = "application/octet-stream";
const GLTF: &str = "model/gltf-binary";
pub(super) const STL: &str = "model/stl";
const OBJ: &str = "model/obj";
const PLY: &str = "application/ply";
const GIFTI: &str = "model/gifti+xml";
const FREESURFER: &str = "application/x-freesurfer";

/// The media types of a mesh; the first is the default.
const MESH_TYPES: &[&str] = &[POSITIONS, GLTF, STL, OBJ, PLY, GIFTI, FREESURFER];

/// Those of a solid.
const SOLID_TYPES: &[&str] = MESH_TYPES.split_at(1).1;

/// The greatest number of points of a mesh with all depths; its table has about 50 MB.
const MAX_TABULATED_POINTS: usize = 1 << 16;

/// The depths of `by_depth=true`, in mm.
const DEPTHS_MM: std::ops::RangeInclusive<u8> = 0..=30;

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
    /// no contours and no paths, and is GLB, STL, OBJ, PLY, GIFTI or FreeSurfer's.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[param(default = false)]
    solid: bool,
    /// The format, instead of `Accept`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(inline)]
    format: Option<FileFormat>,
    /// Instead of the mesh, a value of each of its vertices, as GIFTI or as FreeSurfer's `curv`; NaN where it is undefined or the depth
    /// is unknown. Of findings and places, labels: 0 where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[param(inline)]
    values: Option<VertexValues>,
    /// Whether to answer with the values at each depth from 0 to 30 mm, in steps of 1 mm, as the columns of one GIFTI file; NaN also where a
    /// path ends before the depth. A vertex keeps its number at all depths.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[param(default = false)]
    by_depth: bool,
}

/// A format of complete meshes.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum FileFormat {
    Glb,
    Stl,
    Obj,
    Ply,
    Gifti,
    Freesurfer,
}

impl FileFormat {
    fn media_type(self) -> &'static str {
        match self {
            Self::Glb => GLTF,
            Self::Stl => STL,
            Self::Obj => OBJ,
            Self::Ply => PLY,
            Self::Gifti => GIFTI,
            Self::Freesurfer => FREESURFER,
        }
    }
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
        if self.by_depth {
            let refused = |detail: &str| Err(AppError::out_of_range("by_depth", detail));
            if self.values.is_none_or(VertexValues::are_labels) {
                return refused("needs `values` that are not labels");
            }
            if self.solid || self.depth_mm > 0.0 {
                return refused("is not accepted with `solid` or `depth_mm`: it has every depth");
            }
            check_tabulated(self.contours, self.points)?;
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
        check_tabulated(self.contours, self.points)?;
        Ok(size)
    }
}

fn check_tabulated(contours: usize, points: usize) -> Result<(), AppError> {
    if contours * points > MAX_TABULATED_POINTS {
        let detail =
            format!("times `points` must be at most {MAX_TABULATED_POINTS} for this request");
        return Err(AppError::out_of_range("contours", detail));
    }
    Ok(())
}

/// The mesh of the isosurface at a depth
///
/// Depending on `Accept`: only the positions, three little-endian f32 (x, y, z in LPS mm) for each vertex, the points
/// contour by contour and then the two cap centres, NaN if the depth there is unknown; or a complete mesh as GLB (y up, metres),
/// STL, OBJ or PLY (LPS mm), GIFTI (scanner RAS mm), or a surface of FreeSurfer (`tkregister` RAS mm, with the geometry of the volume).
/// With `solid=true` the isosurface itself, closed, in one of these. With `values` no mesh, but a value or label of each of its vertices.
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
            (String = "model/obj"), (Vec<u8> = "application/ply"), (String = "model/gifti+xml"), (Vec<u8> = "application/x-freesurfer"),
        )),
        (status = 409, description = "The case or its maps are not ready, the maps are undefined, or the case has only the surface of the whole brain: `no-surfaces`"),
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
    let format = match asked.format {
        Some(format) => format.media_type(),
        None => media_type(&request, types)?,
    };
    if asked.values.is_some() && ![GIFTI, FREESURFER].contains(&format) {
        let detail = "are written as GIFTI or for FreeSurfer alone; add `format=gifti` or `format=freesurfer`";
        return Err(AppError::out_of_range("values", detail));
    }
    if asked.by_depth && format != GIFTI {
        let detail = "is written as GIFTI alone; add `format=gifti`";
        return Err(AppError::out_of_range("by_depth", detail));
    }
    let question = Question::new(id, "mesh", &asked, &request);
    let changing = Changing::of(asked.values, &cases, &id).await?;
    let work = async |_| {
        let model = cases.surface(&id, asked.surface).await?;
        let (size, depth) = (values.size, values.depth.shown_in(model.facts()));
        let source = changing.read(&cases, &id).await?;
        let volume = native_grid(model.facts())?;
        let form = Form {
            media_type: format,
            surface: asked.surface,
            values: asked.values.map(|of| Values { of, source }),
            volume: VolumeGeometry::of(&volume),
        };
        let name = form.name(depth.mm, asked.by_depth);
        let mut content = if asked.by_depth {
            let turn = cases.queue.turn().await?;
            let table = model.paths(size, asked.paths).await?;
            let model = Arc::clone(model.model());
            let work = move || encode_by_depth(&table, &model, &form);
            turn.run(work).await?.into()
        } else if asked.solid {
            let turn = cases.queue.turn().await?;
            let model = Arc::clone(model.model());
            let work = move || encode_solid(&model, depth.mm, &form);
            let (body, lacking) = turn.run(work).await??;
            content(body, depth, &lacking)
        } else {
            let shrunk = model.shrink(size, asked.paths, depth.mm);
            let (body, lacking) = if format == POSITIONS && model.has_at_hand(size, asked.paths) {
                // This takes microseconds, so it does not wait for a turn.
                encode(shrunk.await?, model.model(), size, &form)
            } else {
                let turn = cases.queue.turn().await?;
                let (shrunk, model) = (shrunk.await?, Arc::clone(model.model()));
                turn.run(move || encode(shrunk, &model, size, &form))
                    .await?
            };
            content(body, depth, &lacking)
        };
        if let Some(name) = name {
            let name = format!("attachment; filename=\"{name}\"");
            conditional::insert(&mut content.headers, header::CONTENT_DISPOSITION, &name);
        }
        Ok(content)
    };
    let version = changing.version();
    let variant = match &version {
        Some(version) => format!("{format} {version}"),
        None => format.to_owned(),
    };
    let format = Format::of(format).variant(&variant);
    let format = of_surface(format, &variant, asked.surface);
    let format = match version {
        Some(_) => format.revalidated(),
        None => format,
    };
    question.answer(&cases, format, work).await
}

/// What is written of a mesh.
struct Form {
    media_type: &'static str,
    surface: SurfaceName,
    /// Of the vertices, instead of the mesh.
    values: Option<Values>,
    /// What FreeSurfer places a surface by.
    volume: VolumeGeometry,
}

impl Form {
    /// The name of the file; programs know by it what the file holds, and FreeSurfer also of which half.
    fn name(&self, depth_mm: f32, is_by_depth: bool) -> Option<String> {
        let surface = self.surface.name();
        let half = match self.surface {
            SurfaceName::Left => "lh",
            SurfaceName::Right => "rh",
            SurfaceName::Whole | SurfaceName::Cerebrum => surface,
        };
        let values = self.values.as_ref().map(|values| values.of);
        let name = match (self.media_type, values) {
            (GIFTI, None) => format!("{surface}-{depth_mm}mm.surf.gii"),
            (GIFTI, Some(of)) if is_by_depth => format!("{surface}.{}.func.gii", of.name()),
            (GIFTI, Some(of)) => {
                let kind = if of.are_labels() { "label" } else { "shape" };
                format!("{surface}-{depth_mm}mm.{}.{kind}.gii", of.name())
            }
            (FREESURFER, None) => format!("{half}.{depth_mm}mm"),
            (FREESURFER, Some(of)) => format!("{half}.{depth_mm}mm.{}", of.name()),
            _ => return None,
        };
        Some(name)
    }

    /// A mesh in a surface, or values of its vertices, as a file.
    fn file(
        &self,
        shrunk: &ShrunkMesh,
        triangles: &[[u32; 3]],
        model: &DeformableModel,
        unknown: &[usize],
    ) -> Bytes {
        let mesh = wire::Mesh {
            depth_mm: shrunk.depth_mm,
            positions_in_patient: &shrunk.positions_in_patient,
            triangles,
        };
        let file = match (self.media_type, &self.values) {
            (GLTF, _) => wire::gltf(mesh),
            (STL, _) => wire::stl(mesh),
            (OBJ, _) => wire::obj(mesh),
            (PLY, _) => wire::ply(mesh),
            (FREESURFER, None) => wire::freesurfer(mesh, &self.volume),
            (_, None) => wire::gifti(mesh, self.surface),
            (kind, Some(values)) => {
                let found = numbers(values, shrunk, model, unknown);
                let name = values.of.name();
                match kind {
                    FREESURFER => wire::freesurfer_values(mesh, &found),
                    _ if values.of.are_labels() => {
                        let found: Vec<_> = found.iter().map(|&number| number as u16).collect();
                        let table = (name, &values.labels()[..]);
                        wire::gifti_labels(mesh, self.surface, table, &found)
                    }
                    _ => wire::gifti_values(mesh, self.surface, name, &found),
                }
            }
        };
        file.into()
    }
}

/// The values of the vertices of a mesh: NaN, or the label 0, where there is none.
fn numbers(
    values: &Values,
    shrunk: &ShrunkMesh,
    model: &DeformableModel,
    unknown: &[usize],
) -> Vec<f32> {
    let none = match values.of.are_labels() {
        true => 0.0,
        false => f32::NAN,
    };
    let value = |position: &[f32; 3]| {
        let position = Vec3::from_array(*position).as_dvec3();
        values.at(model, position).unwrap_or(none)
    };
    let mut found: Vec<_> = shrunk.positions_in_patient.iter().map(value).collect();
    for &vertex in unknown {
        found[vertex] = none;
    }
    found
}

/// The values of the vertices at each depth.
fn encode_by_depth(table: &PathTable, model: &DeformableModel, form: &Form) -> Bytes {
    let Some(values) = &form.values else {
        return Bytes::new();
    };
    let column = |depth_mm: u8| {
        let depth_mm = f32::from(depth_mm);
        let shrunk = table.shrink(depth_mm);
        // What is asked of a depth that the case has not.
        if shrunk.depth_mm < depth_mm {
            return (depth_mm, vec![f32::NAN; shrunk.positions_in_patient.len()]);
        }
        let mut lacking = shrunk.unknown_vertices(model.field());
        lacking.extend(shrunk.shallow_vertices(model.field()));
        (depth_mm, numbers(values, &shrunk, model, &lacking))
    };
    let columns: Vec<_> = DEPTHS_MM.map(column).collect();
    wire::gifti_columns(form.surface, values.of.name(), &columns).into()
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

/// A mesh: its positions, or a file without the triangles that touch a vertex of unknown depth or have no area. Programs that read such
/// files expect a position for each vertex.
fn encode(
    mut shrunk: ShrunkMesh,
    model: &DeformableModel,
    size: MeshSize,
    form: &Form,
) -> (Bytes, Lacking) {
    let unknown = shrunk.unknown_vertices(model.field());
    let lacking = Lacking {
        unknown: unknown.len(),
        shallow: shrunk.shallow_count(model.field()),
    };
    if form.media_type == POSITIONS {
        for vertex in unknown {
            shrunk.positions_in_patient[vertex] = [f32::NAN; 3];
        }
        return (wire::positions(&shrunk.positions_in_patient), lacking);
    }
    let triangles = wire::known_triangles(&shrunk, size, &unknown);
    (form.file(&shrunk, &triangles, model, &unknown), lacking)
}

/// The isosurface at a depth as a file.
fn encode_solid(
    model: &DeformableModel,
    depth_mm: f32,
    form: &Form,
) -> Result<(Bytes, Lacking), AppError> {
    let solid = render::solid(model, depth_mm.into());
    if solid.triangles.is_empty() {
        let detail = "is so great that nothing is left of a solid; choose a smaller one";
        return Err(AppError::out_of_range("depth_mm", detail));
    }
    let vertices = ShrunkMesh {
        depth_mm,
        positions_in_patient: solid.positions_in_patient,
    };
    let unknown = vertices.unknown_vertices(model.field());
    let lacking = Lacking {
        unknown: unknown.len(),
        shallow: 0,
    };
    let file = form.file(&vertices, &solid.triangles, model, &unknown);
    Ok((file, lacking))
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
