//! Draws on one device.

use std::borrow::Cow;
use std::collections::VecDeque;

use geometry::{MeshSize, ShrunkMesh};
use wgpu::{
    BindGroup, Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, RenderPass,
    TextureView,
};

use super::adapter::Adapter;
use super::block::Block;
use super::cache::Cache;
use super::case::{CasePlan, CaseTextures};
use super::device::OpenDevice;
use super::job::Call;
use super::layer::{LayerTexture, layer_bytes};
use super::layout::Picture;
use super::pipelines::{Bound, Pass, Pipelines};
use super::target::{Output, Plan, Surface, Target};
use super::uniforms::LayerTextures;
use super::{CaseKey, GpuError, GpuJob, GpuSurface, pixels, uniforms};
use crate::settle::settled;
use crate::shade::pixel_format;
use crate::{ColorMap, Hits, KeyedLayer, LayerKey, RenderedFrame};

/// The textures of larger pictures are not kept.
const KEPT_PIXELS: usize = 2 << 20;

/// The memory for layers is this fraction of the memory for cases.
const LAYERS_PART: u64 = 4;

/// The number of kinds and sizes of pictures whose textures are kept.
const KEPT_TARGETS: usize = 4;

/// The number of mesh sizes whose triangles are kept.
const KEPT_MESHES: usize = 8;

/// Limits of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct GpuLimits {
    /// Bytes for the textures of all cases together; layers have a quarter of this in addition.
    pub(super) case_bytes: u64,
    /// The longest side of a 3-D texture, if it must be less than the limit of the device.
    pub(super) max_side_3d: Option<u32>,
}

/// A device with its passes, the textures of cases and the targets of pictures.
#[derive(Debug)]
pub(super) struct GpuRenderer {
    pub(super) open: OpenDevice,
    limits: GpuLimits,
    pub(super) pipelines: Pipelines,
    picture: Buffer,
    colors: TextureView,
    no_overlay: TextureView,
    pub(super) cases: Cache<CaseKey, CaseTextures>,
    layers: Cache<LayerKey, LayerTexture>,
    targets: VecDeque<Target>,
    triangles: VecDeque<(MeshSize, Buffer)>,
    vertices: Option<Buffer>,
}

impl GpuRenderer {
    /// Opens a device and compiles its shaders.
    pub(super) fn open(adapter: &Adapter, limits: GpuLimits) -> Result<Self, GpuError> {
        let open = OpenDevice::open(adapter)?;
        let pipelines = Pipelines::new(&open);
        let renderer = Self {
            picture: open.device.create_buffer(&BufferDescriptor {
                label: Some("picture"),
                size: size_of::<Picture>() as u64,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            colors: colors(&open),
            no_overlay: LayerTexture::none(&open),
            layers: Cache::new(limits.case_bytes / LAYERS_PART),
            pipelines,
            limits,
            cases: Cache::new(limits.case_bytes),
            targets: VecDeque::new(),
            triangles: VecDeque::new(),
            vertices: None,
            open,
        };
        renderer.open.fault().map_or(Ok(renderer), Err)
    }

    pub(super) fn free_memory(&mut self) {
        self.cases.clear();
        self.layers.clear();
        self.targets.clear();
        self.triangles.clear();
        self.vertices = None;
    }

    pub(super) fn draw(&mut self, job: &GpuJob) -> Result<RenderedFrame, GpuError> {
        let call = &job.call();
        let surface = surface_of(call);
        let call = &Call {
            surface: &surface,
            ..*call
        };
        let parameters = call.request.parameters();
        let format = pixel_format(parameters, &call.scene.layers);
        let size = parameters.size;
        let frame = self.run(call, Output::Color, |target, open| {
            target.read(open, |rows| pixels::frame(size, format, rows))
        })?;
        let reduction = self.cases.get(call.key).map(|case| case.maps.reduction);
        Ok(RenderedFrame {
            frame,
            reduction: reduction.filter(|&factors| factors != [1; 3]),
        })
    }

    /// Finds the point that each pixel shows.
    pub(super) fn hits(&mut self, job: &GpuJob) -> Result<Hits, GpuError> {
        let call = job.call();
        let surface = surface_of(&call);
        let heights_mm = self.heights(&Call {
            surface: &surface,
            ..call
        })?;
        Ok(Hits::new(call.request.view(&call.scene), heights_mm))
    }

    /// The height of each pixel's point above the plane through the centre of the target, in mm; −∞ for the background. A
    /// mesh is not smoothed.
    pub(super) fn heights(&mut self, call: &Call<'_>) -> Result<Vec<f32>, GpuError> {
        let size = call.request.parameters().size;
        self.run(call, Output::Height, |target, open| {
            target.read(open, |rows| pixels::heights(size, rows))
        })
    }

    fn run<T>(
        &mut self,
        call: &Call<'_>,
        output: Output,
        read: impl FnOnce(&Target, &OpenDevice) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        self.prepare(call)?;
        let (surface, triangles) = match call.surface {
            GpuSurface::Mesh { size, mesh } => (Surface::Mesh, Some(self.mesh(*size, mesh)?)),
            GpuSurface::Trace => (Surface::Trace, None),
        };
        let size = call.request.parameters().size;
        let target = self.target(Plan {
            size,
            surface,
            output,
        });
        let bindings = self.bind(call)?;
        let block = Block::around(call);
        let queue = &self.open.queue;
        let mut encoder = self
            .open
            .device
            .create_command_encoder(&CommandEncoderDescriptor::default());
        if target.multisampled_depth().is_some() {
            let mut pass = target.begin_depth(&mut encoder);
            pass.set_bind_group(0, &bindings, &[]);
            self.fill(&mut pass, Pass::MeshDepth, triangles.as_ref());
        }
        let mut pass = target.begin_picture(&mut encoder);
        pass.set_bind_group(0, &bindings, &[]);
        let Block {
            corner: [x, y],
            size: [width, height],
        } = block;
        pass.set_scissor_rect(x, y, width, height);
        if let Some(depth) = target.multisampled_depth() {
            pass.set_bind_group(1, depth, &[]);
            self.fill(&mut pass, Pass::MeshResolved, None);
        } else {
            self.fill(&mut pass, one_pass(surface, output), triangles.as_ref());
        }
        drop(pass);
        target.copy_out(&mut encoder);
        queue.submit([encoder.finish()]);
        let result = read(&target, &self.open);
        if size.pixel_count() <= KEPT_PIXELS && result.is_ok() {
            self.targets.push_front(target);
            self.targets.truncate(KEPT_TARGETS);
        }
        result
    }

    /// Draws the triangles of a mesh, or one triangle over the whole picture.
    fn fill(&self, render: &mut RenderPass<'_>, pass: Pass, triangles: Option<&Buffer>) {
        render.set_pipeline(self.pipelines.get(pass));
        match (triangles, &self.vertices) {
            (Some(triangles), Some(vertices)) => {
                render.set_vertex_buffer(0, vertices.slice(..));
                render.set_index_buffer(triangles.slice(..), wgpu::IndexFormat::Uint32);
                render.draw_indexed(0..(triangles.size() / 4) as u32, 0, 0..1);
            }
            _ => render.draw(0..3, 0..1),
        }
    }

    /// Writes the uniforms of a picture and binds its textures, which the device has already.
    pub(super) fn bind(&mut self, call: &Call<'_>) -> Result<BindGroup, GpuError> {
        let layers = LayerTextures {
            base: self.layer(call.layers.base.as_ref())?,
            overlay: self.layer(call.layers.overlay.as_ref().map(|(layer, _)| layer))?,
        };
        let case = self.cases.get(call.key).ok_or(GpuError::OutOfMemory)?;
        let picture = uniforms::picture(&call.scene, call.request, &case.maps, &layers);
        let bytes = bytemuck::bytes_of(&picture);
        self.open.queue.write_buffer(&self.picture, 0, bytes);
        let overlay = layers.overlay.as_ref().map(|overlay| &overlay.view);
        let bound = Bound {
            picture: &self.picture,
            case: &case.views,
            base: layers.base.as_ref().map(|base| &base.view),
            overlay: overlay.unwrap_or(&self.no_overlay),
            colors: &self.colors,
        };
        Ok(self.pipelines.bind_case(&self.open.device, &bound))
    }

    /// The texture of a layer, uploaded if necessary.
    fn layer(&mut self, keyed: Option<&KeyedLayer>) -> Result<Option<LayerTexture>, GpuError> {
        let Some(KeyedLayer { key, layer }) = keyed else {
            return Ok(None);
        };
        if let Some(texture) = self.layers.get(*key) {
            return Ok(Some(texture.clone()));
        }
        let bytes = layer_bytes(layer);
        self.layers.make_room(bytes);
        let texture = LayerTexture::upload(&self.open, layer, self.max_side())?;
        if let Some(fault) = self.open.fault() {
            return Err(fault);
        }
        self.layers.insert(*key, texture.clone(), bytes);
        Ok(Some(texture))
    }

    /// The longest side of a 3-D texture.
    fn max_side(&self) -> u32 {
        let max_side = self.open.max_side_3d;
        max_side.min(self.limits.max_side_3d.unwrap_or(max_side))
    }

    /// Uploads the textures of the case if necessary.
    fn prepare(&mut self, call: &Call<'_>) -> Result<(), GpuError> {
        let Call { key, scene, .. } = *call;
        if self.cases.get(key).is_some() {
            return Ok(());
        }
        let plan = CasePlan::new(&scene, self.max_side(), self.cases.limit())?;
        self.cases.make_room(plan.bytes);
        let textures = CaseTextures::upload(&self.open, &scene, &plan);
        if let Some(fault) = self.open.fault() {
            return Err(fault);
        }
        self.cases.insert(key, textures, plan.bytes);
        Ok(())
    }

    /// Uploads the vertices of a mesh and returns its triangles.
    fn mesh(&mut self, size: MeshSize, mesh: &ShrunkMesh) -> Result<Buffer, GpuError> {
        let positions = &mesh.positions_in_patient;
        if positions.len() != size.vertex_count() {
            return Err(GpuError::Mesh {
                found: positions.len(),
                expected: size.vertex_count(),
            });
        }
        let bytes: &[u8] = bytemuck::cast_slice(positions);
        let vertices = self.vertices.take();
        let vertices = vertices
            .filter(|buffer| buffer.size() >= bytes.len() as u64)
            .unwrap_or_else(|| self.buffer("vertices", BufferUsages::VERTEX, bytes.len()));
        self.open.queue.write_buffer(&vertices, 0, bytes);
        self.vertices = Some(vertices);
        Ok(self.triangles(size))
    }

    /// The triangles of a size of mesh.
    pub(super) fn triangles(&mut self, size: MeshSize) -> Buffer {
        let known = self.triangles.iter().position(|(known, _)| *known == size);
        let triangles = match known.and_then(|place| self.triangles.remove(place)) {
            Some((_, triangles)) => triangles,
            None => {
                let triangles = size.triangles();
                let bytes: &[u8] = bytemuck::cast_slice(&triangles);
                let buffer = self.buffer("triangles", BufferUsages::INDEX, bytes.len());
                self.open.queue.write_buffer(&buffer, 0, bytes);
                buffer
            }
        };
        self.triangles.push_front((size, triangles.clone()));
        self.triangles.truncate(KEPT_MESHES);
        triangles
    }

    fn buffer(&self, label: &str, usage: BufferUsages, bytes: usize) -> Buffer {
        self.open.device.create_buffer(&BufferDescriptor {
            label: Some(label),
            size: bytes as u64,
            usage: usage | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// The target of a picture: one from an earlier picture, if it fits.
    fn target(&mut self, plan: Plan) -> Target {
        let known = self.targets.iter().position(|kept| kept.plan == plan);
        known
            .and_then(|place| self.targets.remove(place))
            .unwrap_or_else(|| Target::new(&self.open, &self.pipelines, plan))
    }
}

/// The surface to draw: near the envelope, a mesh without terraces.
fn surface_of<'a>(call: &Call<'a>) -> Cow<'a, GpuSurface> {
    match call.surface {
        GpuSurface::Mesh { size, mesh } => match settled(mesh, &call.scene) {
            Cow::Borrowed(_) => Cow::Borrowed(call.surface),
            Cow::Owned(mesh) => Cow::Owned(GpuSurface::Mesh { size: *size, mesh }),
        },
        GpuSurface::Trace => Cow::Borrowed(call.surface),
    }
}

/// The pass that draws without a depth buffer of several samples per pixel.
fn one_pass(surface: Surface, output: Output) -> Pass {
    match (surface, output) {
        (Surface::Mesh, Output::Color) => Pass::MeshShaded,
        (Surface::Mesh, Output::Height) => Pass::MeshHeight,
        (Surface::Trace, Output::Color) => Pass::TraceShaded,
        (Surface::Trace, Output::Height) => Pass::TraceHeight,
    }
}

/// The colour maps, one per row.
fn colors(open: &OpenDevice) -> TextureView {
    let texels: Vec<[u8; 4]> = ColorMap::ALL
        .into_iter()
        .flat_map(|map| {
            map.table()
                .map(|[red, green, blue]| [red, green, blue, 255])
        })
        .collect();
    let size = wgpu::Extent3d {
        width: 256,
        height: ColorMap::ALL.len() as u32,
        depth_or_array_layers: 1,
    };
    let texture = open.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("colors"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(4 * size.width),
        rows_per_image: None,
    };
    let bytes = bytemuck::cast_slice(&texels);
    open.queue
        .write_texture(texture.as_image_copy(), bytes, layout, size);
    texture.create_view(&Default::default())
}
