//! The compiled passes.

use wgpu::{
    BindGroup, BindGroupLayout, BindGroupLayoutEntry, BindingResource, BindingType, Buffer, Device,
    PipelineLayout, RenderPipeline, SamplerBindingType, ShaderModule, ShaderSource, ShaderStages,
    TextureSampleType, TextureView, TextureViewDimension,
};

use super::case::CaseViews;
use super::device::OpenDevice;
use super::formats::{COLOR, DEPTH, HEIGHT, SAMPLES};
use super::shaders;

/// The kind of a pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    /// Only the depth of the mesh, with several samples per pixel.
    MeshDepth,
    /// The colours of the mesh, from its depth; alpha is the covered fraction of the pixel.
    MeshResolved,
    /// The colours of the mesh, drawn facet by facet, with one sample per pixel.
    MeshShaded,
    /// The height of the mesh in mm.
    MeshHeight,
    /// The colours of the isosurface.
    TraceShaded,
    /// The height of the isosurface in mm.
    TraceHeight,
}

impl Pass {
    const ALL: [Self; 6] = [
        Self::MeshDepth,
        Self::MeshResolved,
        Self::MeshShaded,
        Self::MeshHeight,
        Self::TraceShaded,
        Self::TraceHeight,
    ];

    /// Whether the triangles of a mesh are drawn, rather than one triangle over the whole picture.
    fn draws_facets(self) -> bool {
        matches!(self, Self::MeshDepth | Self::MeshShaded | Self::MeshHeight)
    }

    fn entry_points(self) -> (&'static str, Option<&'static str>) {
        match self {
            Self::MeshDepth => ("mesh_vertex", None),
            Self::MeshResolved => ("screen_vertex", Some("mesh_resolved")),
            Self::MeshShaded => ("mesh_vertex", Some("mesh_shaded")),
            Self::MeshHeight => ("mesh_vertex", Some("mesh_height")),
            Self::TraceShaded => ("screen_vertex", Some("trace_shaded")),
            Self::TraceHeight => ("screen_vertex", Some("trace_height")),
        }
    }
}

/// The bindings of every pass.
pub(super) struct Bound<'a> {
    pub(super) picture: &'a Buffer,
    pub(super) case: &'a CaseViews,
    /// The texture to use instead of the volume of the case.
    pub(super) base: Option<&'a TextureView>,
    pub(super) overlay: &'a TextureView,
    pub(super) colors: &'a TextureView,
}

/// Every pass of this crate.
#[derive(Debug)]
pub(super) struct Pipelines {
    case_layout: BindGroupLayout,
    linear: wgpu::Sampler,
    depth_layout: BindGroupLayout,
    pipelines: [RenderPipeline; Pass::ALL.len()],
}

impl Pipelines {
    pub(super) fn new(open: &OpenDevice) -> Self {
        let device = &open.device;
        let case_layout = case_layout(device);
        let depth_layout = depth_layout(device);
        let layout = |bind_group_layouts: &[Option<&BindGroupLayout>]| {
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts,
                immediate_size: 0,
            })
        };
        let of_case = layout(&[Some(&case_layout)]);
        let of_case_and_depth = layout(&[Some(&case_layout), Some(&depth_layout)]);
        let module = |label, source: &'static str| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: ShaderSource::Wgsl(source.into()),
            })
        };
        let mesh = module("mesh", shaders::MESH);
        let resolve = module("resolve", shaders::RESOLVE);
        let trace = module("trace", shaders::TRACE);
        let pipelines = Pass::ALL.map(|pass| match pass {
            Pass::MeshResolved => pipeline(open, &of_case_and_depth, &resolve, pass),
            Pass::TraceShaded | Pass::TraceHeight => pipeline(open, &of_case, &trace, pass),
            _ => pipeline(open, &of_case, &mesh, pass),
        });
        let linear = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("linear"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self {
            case_layout,
            linear,
            depth_layout,
            pipelines,
        }
    }

    /// The layout of the bindings of [`Pipelines::bind_case`].
    #[cfg(test)]
    pub(super) fn case_layout(&self) -> &BindGroupLayout {
        &self.case_layout
    }

    /// The pipeline of a pass.
    pub(super) fn get(&self, pass: Pass) -> &RenderPipeline {
        &self.pipelines[pass as usize]
    }

    /// Binds the inputs of every pass.
    pub(super) fn bind_case(&self, device: &Device, bound: &Bound<'_>) -> BindGroup {
        let CaseViews {
            volume,
            field,
            normals,
            smoothed,
        } = bound.case;
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("case"),
            layout: &self.case_layout,
            entries: &[
                entry(0, bound.picture.as_entire_binding()),
                entry(
                    1,
                    BindingResource::TextureView(bound.base.unwrap_or(volume)),
                ),
                entry(2, BindingResource::TextureView(field)),
                entry(3, BindingResource::TextureView(normals)),
                entry(4, BindingResource::TextureView(bound.colors)),
                entry(5, BindingResource::Sampler(&self.linear)),
                entry(6, BindingResource::TextureView(smoothed)),
                entry(7, BindingResource::TextureView(bound.overlay)),
            ],
        })
    }

    /// Binds a depth buffer.
    pub(super) fn bind_depth(&self, device: &Device, depth: &TextureView) -> BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("depth"),
            layout: &self.depth_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: BindingResource::TextureView(depth),
            }],
        })
    }
}

fn entry(binding: u32, ty: BindingType) -> BindGroupLayoutEntry {
    BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::VERTEX_FRAGMENT,
        ty,
        count: None,
    }
}

fn texture(sample_type: TextureSampleType, view_dimension: TextureViewDimension) -> BindingType {
    BindingType::Texture {
        sample_type,
        view_dimension,
        multisampled: sample_type == TextureSampleType::Depth,
    }
}

fn case_layout(device: &Device) -> BindGroupLayout {
    let uniform = BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let filtered = TextureSampleType::Float { filterable: true };
    let plain = TextureSampleType::Float { filterable: false };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("case"),
        entries: &[
            entry(0, uniform),
            entry(1, texture(filtered, TextureViewDimension::D3)),
            entry(2, texture(filtered, TextureViewDimension::D3)),
            entry(3, texture(filtered, TextureViewDimension::D3)),
            entry(4, texture(plain, TextureViewDimension::D2)),
            entry(5, BindingType::Sampler(SamplerBindingType::Filtering)),
            entry(6, texture(filtered, TextureViewDimension::D3)),
            entry(7, texture(filtered, TextureViewDimension::D3)),
        ],
    })
}

fn depth_layout(device: &Device) -> BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("depth"),
        entries: &[entry(
            0,
            texture(TextureSampleType::Depth, TextureViewDimension::D2),
        )],
    })
}

fn pipeline(
    open: &OpenDevice,
    layout: &PipelineLayout,
    module: &ShaderModule,
    pass: Pass,
) -> RenderPipeline {
    let (vertex, fragment) = pass.entry_points();
    let positions = [Some(wgpu::VertexBufferLayout {
        array_stride: 12,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3],
    })];
    let targets = match pass {
        Pass::MeshHeight | Pass::TraceHeight => [Some(HEIGHT.into())],
        _ => [Some(COLOR.into())],
    };
    // Facets are visible from both sides: where a shrunk mesh folds, some are reversed.
    let is_multisampled = pass == Pass::MeshDepth && open.is_multisampled;
    open.device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: fragment,
            layout: Some(layout),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(vertex),
                compilation_options: Default::default(),
                buffers: if pass.draws_facets() { &positions } else { &[] },
            },
            primitive: Default::default(),
            depth_stencil: pass.draws_facets().then(|| wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: wgpu::MultisampleState {
                count: if is_multisampled { SAMPLES } else { 1 },
                ..Default::default()
            },
            fragment: fragment.map(|name| wgpu::FragmentState {
                module,
                entry_point: Some(name),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
}
