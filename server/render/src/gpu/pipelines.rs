//! The passes, ready to be run.

use wgpu::{
    BindGroup, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType, Buffer, Device,
    RenderPipeline, SamplerBindingType, ShaderModule, ShaderSource, ShaderStages,
    TextureSampleType, TextureView, TextureViewDimension,
};

use super::device::OpenDevice;
use super::shaders;
use super::target::{COLOR, DEPTH, HEIGHT};

/// What is written for each pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    /// Its colour; alpha is how much of it is covered.
    Color,
    /// The height of the surface, in mm.
    Height,
}

/// What is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Mesh,
    Trace,
}

/// Every pass of this crate.
#[derive(Debug)]
pub(super) struct Pipelines {
    layout: BindGroupLayout,
    mesh: [RenderPipeline; 2],
    trace: [RenderPipeline; 2],
}

impl Pipelines {
    /// Compiles the shaders.
    pub(super) fn new(open: &OpenDevice) -> Self {
        let device = &open.device;
        let layout = bind_group_layout(device);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("pictures"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = |label, source: &'static str| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: ShaderSource::Wgsl(source.into()),
            })
        };
        let mesh = module("mesh", shaders::MESH);
        let trace = module("trace", shaders::TRACE);
        let pipeline = |kind, output| {
            let module = match kind {
                Kind::Mesh => &mesh,
                Kind::Trace => &trace,
            };
            pipeline(open, &pipeline_layout, module, kind, output)
        };
        Self {
            mesh: [Output::Color, Output::Height].map(|output| pipeline(Kind::Mesh, output)),
            trace: [Output::Color, Output::Height].map(|output| pipeline(Kind::Trace, output)),
            layout,
        }
    }

    /// The pass that draws `kind` into `output`.
    pub(super) fn get(&self, kind: Kind, output: Output) -> &RenderPipeline {
        let both = match kind {
            Kind::Mesh => &self.mesh,
            Kind::Trace => &self.trace,
        };
        &both[output as usize]
    }

    /// Binds what every pass is given: volume, field and normals among it.
    pub(super) fn bind(
        &self,
        device: &Device,
        picture: &Buffer,
        [volume, field, normals]: [&TextureView; 3],
        colors: &TextureView,
    ) -> BindGroup {
        let linear = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("linear"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("case"),
            layout: &self.layout,
            entries: &[
                entry(0, picture.as_entire_binding()),
                entry(1, BindingResource::TextureView(volume)),
                entry(2, BindingResource::TextureView(field)),
                entry(3, BindingResource::TextureView(normals)),
                entry(4, BindingResource::TextureView(colors)),
                entry(5, BindingResource::Sampler(&linear)),
            ],
        })
    }
}

fn bind_group_layout(device: &Device) -> BindGroupLayout {
    let entry = |binding, ty| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT,
        ty,
        count: None,
    };
    let texture = |view_dimension, filterable| BindingType::Texture {
        sample_type: TextureSampleType::Float { filterable },
        view_dimension,
        multisampled: false,
    };
    let uniform = BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("case"),
        entries: &[
            entry(0, uniform),
            entry(1, texture(TextureViewDimension::D3, true)),
            entry(2, texture(TextureViewDimension::D3, true)),
            entry(3, texture(TextureViewDimension::D3, true)),
            entry(4, texture(TextureViewDimension::D2, false)),
            entry(5, BindingType::Sampler(SamplerBindingType::Filtering)),
        ],
    })
}

fn pipeline(
    open: &OpenDevice,
    layout: &wgpu::PipelineLayout,
    module: &ShaderModule,
    kind: Kind,
    output: Output,
) -> RenderPipeline {
    let [vertex, fragment] = match (kind, output) {
        (Kind::Mesh, Output::Color) => ["mesh_vertex", "mesh_shaded"],
        (Kind::Mesh, Output::Height) => ["mesh_vertex", "mesh_height"],
        (Kind::Trace, Output::Color) => ["trace_vertex", "trace_shaded"],
        (Kind::Trace, Output::Height) => ["trace_vertex", "trace_height"],
    };
    let positions = [Some(wgpu::VertexBufferLayout {
        array_stride: 12,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3],
    })];
    let is_mesh = kind == Kind::Mesh;
    // Facets are seen from both sides: where a shrunk mesh folds, some are turned round.
    open.device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment),
            layout: Some(layout),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(vertex),
                compilation_options: Default::default(),
                buffers: if is_mesh { &positions } else { &[] },
            },
            primitive: Default::default(),
            depth_stencil: is_mesh.then(|| wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: wgpu::MultisampleState {
                count: samples(open, kind, output),
                ..Default::default()
            },
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some(fragment),
                compilation_options: Default::default(),
                targets: &[Some(
                    match output {
                        Output::Color => COLOR,
                        Output::Height => HEIGHT,
                    }
                    .into(),
                )],
            }),
            multiview_mask: None,
            cache: None,
        })
}

/// Samples of a pixel: several for the mesh's colours, whose edges are straight lines.
pub(super) fn samples(open: &OpenDevice, kind: Kind, output: Output) -> u32 {
    match (kind, output) {
        (Kind::Mesh, Output::Color) => open.samples,
        _ => 1,
    }
}
