//! The page's vertex shader shrinks the mesh as the table does.

use geometry::PathTable;
use wgpu::{
    BindGroup, BindGroupLayout, BindGroupLayoutEntry, BindingType, BufferUsages, Extent3d,
    RenderPipeline, ShaderStages, TextureFormat, TextureView, TextureViewDimension,
};

use super::super::device::OpenDevice;
use super::super::formats::{DEPTH, HEIGHT};
use super::super::layout::Paths;
use super::super::renderer::GpuRenderer;
use super::super::target::{Output, Plan, Surface, Target};
use super::super::{GpuError, GpuJob, GpuSurface, pixels, shaders};
use super::support::{Case, LIMITS, parameters, trace, worker};
use crate::NamedView;
use crate::settle::settled;

/// Texels per line of the textures of the table: a prime number, so that lines break within rows and pieces.
const LINE: usize = 127;

/// A vertex shader that draws the shrunk vertex directly.
const DRAWN_VERTEX: &str = "
    @vertex
    fn drawn_vertex(@builtin(vertex_index) vertex: u32) -> OnFacet {
        return on_facet(shrunk_position(vertex));
    }
";

/// A texture of whole numbers, line after line, as the page makes them.
fn texture(
    open: &OpenDevice,
    format: TextureFormat,
    texel_bytes: usize,
    bytes: &[u8],
) -> TextureView {
    let lines = (bytes.len() / texel_bytes).div_ceil(LINE).max(1);
    let mut padded = bytes.to_vec();
    padded.resize(lines * LINE * texel_bytes, 0);
    let size = Extent3d {
        width: LINE as u32,
        height: lines as u32,
        depth_or_array_layers: 1,
    };
    let texture = open.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some((LINE * texel_bytes) as u32),
        rows_per_image: None,
    };
    open.queue
        .write_texture(texture.as_image_copy(), &padded, layout, size);
    texture.create_view(&Default::default())
}

/// The pieces of a table in the bytes that the service sends.
fn piece_bytes(table: &PathTable) -> Vec<u8> {
    let bytes = table.pieces.iter().flat_map(|piece| {
        let depths = piece.depths_mm.iter().flat_map(|depth| depth.to_le_bytes());
        let ends = piece
            .ends
            .as_flattened()
            .iter()
            .flat_map(|place| place.to_le_bytes());
        piece
            .vertex
            .to_le_bytes()
            .into_iter()
            .chain(depths)
            .chain(ends)
    });
    bytes.collect()
}

fn paths(table: &PathTable, depth_mm: f32) -> Paths {
    let row = ((depth_mm / table.row_mm) as usize).min(table.row_count() - 2);
    let [first, end] = [table.first_piece[row], table.first_piece[row + 1]];
    Paths {
        origin_in_patient: table.origin_in_patient,
        step_mm: table.step_mm,
        depth_mm,
        row_mm: table.row_mm,
        row: row as u32,
        vertex_count: table.size.vertex_count() as u32,
        first_piece: first,
        piece_count: end - first,
        _padding_0: Default::default(),
    }
}

fn layout(open: &OpenDevice) -> BindGroupLayout {
    let entry = |binding, ty| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX,
        ty,
        count: None,
    };
    let texture = BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Uint,
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    let uniform = BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    open.device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[entry(0, uniform), entry(1, texture), entry(2, texture)],
        })
}

fn bind(
    open: &OpenDevice,
    layout: &BindGroupLayout,
    table: &PathTable,
    depth_mm: f32,
) -> BindGroup {
    let uniform = open.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size_of::<Paths>() as u64,
        usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    open.queue
        .write_buffer(&uniform, 0, bytemuck::bytes_of(&paths(table, depth_mm)));
    let rows: Vec<[u16; 4]> = table.rows.iter().map(|&[x, y, z]| [x, y, z, 0]).collect();
    let rows = texture(
        open,
        TextureFormat::Rgba16Uint,
        8,
        bytemuck::cast_slice(&rows),
    );
    let pieces = texture(open, TextureFormat::R32Uint, 4, &piece_bytes(table));
    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
    open.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &[
            entry(0, uniform.as_entire_binding()),
            entry(1, wgpu::BindingResource::TextureView(&rows)),
            entry(2, wgpu::BindingResource::TextureView(&pieces)),
        ],
    })
}

fn pipeline(renderer: &GpuRenderer, layout: &BindGroupLayout) -> RenderPipeline {
    let device = &renderer.open.device;
    let source = [shaders::SHRUNK_MESH, DRAWN_VERTEX].concat();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(renderer.pipelines.case_layout()), Some(layout)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("drawn_vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("mesh_height"),
            compilation_options: Default::default(),
            targets: &[Some(HEIGHT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// The heights of the mesh that the shader shrinks; everything else is unchanged from the previous picture.
fn heights(
    renderer: &mut GpuRenderer,
    job: &GpuJob,
    table: &PathTable,
) -> Result<Vec<f32>, GpuError> {
    let parameters = job.request.parameters();
    let layout = layout(&renderer.open);
    let pipeline = pipeline(renderer, &layout);
    let bound = bind(&renderer.open, &layout, table, parameters.depth_mm as f32);
    let triangles = renderer.triangles(table.size);
    let plan = Plan {
        size: parameters.size,
        surface: Surface::Mesh,
        output: Output::Height,
    };
    let target = Target::new(&renderer.open, &renderer.pipelines, plan);
    let bindings = renderer.bind(&job.call())?;
    let mut encoder = renderer
        .open
        .device
        .create_command_encoder(&Default::default());
    let mut pass = target.begin_picture(&mut encoder);
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &bindings, &[]);
    pass.set_bind_group(1, &bound, &[]);
    pass.set_index_buffer(triangles.slice(..), wgpu::IndexFormat::Uint32);
    pass.draw_indexed(0..(triangles.size() / 4) as u32, 0, 0..1);
    drop(pass);
    target.copy_out(&mut encoder);
    renderer.open.queue.submit([encoder.finish()]);
    target.read(&renderer.open, |rows| {
        pixels::heights(parameters.size, rows)
    })
}

#[test]
fn the_vertex_shader_shrinks_as_the_table_does() {
    let Some(mut worker) = worker(LIMITS) else {
        return;
    };
    let case = Case::ball(30);
    let table = case.forest_table(25, 31);
    assert!(!table.pieces.is_empty(), "finer pieces are tested, too");
    for depth_mm in [
        0.0,
        0.004,
        0.02,
        0.6,
        3.0,
        7.77,
        20.3,
        f64::from(table.max_depth_mm),
    ] {
        let shrunk = table.shrink(depth_mm as f32);
        let mesh = settled(&shrunk, &case.scene()).into_owned();
        // Near the envelope, vertices move along gradients, which the device stores in 8 bits.
        let tolerance = if mesh == shrunk { 1e-3 } else { 0.05 };
        let surface = GpuSurface::Mesh {
            size: table.size,
            mesh,
        };
        let job = GpuJob {
            surface,
            ..trace(&case, parameters(NamedView::Anterior, depth_mm))
        };
        let [expected, found] = worker
            .attempt(|renderer| {
                let hits = renderer.heights(&job.call())?;
                Ok([hits, heights(renderer, &job, &table)?])
            })
            .unwrap();
        let is_apart = |(expected, found): &(&f32, &f32)| {
            expected.is_finite() != found.is_finite() || (*expected - *found).abs() > tolerance
        };
        let apart = expected.iter().zip(&found).filter(is_apart).count();
        let covered = found.iter().filter(|height| height.is_finite()).count();
        // Devices round the places of vertices differently, which moves the silhouette.
        let allowed = 4 + covered / 250;
        assert!(
            apart <= allowed,
            "{apart} of {covered} pixels at {depth_mm} mm"
        );
        assert!(
            covered > 100 || depth_mm > 25.0,
            "{covered} pixels at {depth_mm} mm"
        );
    }
}
