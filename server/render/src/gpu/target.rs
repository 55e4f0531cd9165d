//! Targets for pictures, and their transfer back.

use std::sync::mpsc;
use std::time::Duration;

use wgpu::{
    BindGroup, Buffer, BufferDescriptor, BufferUsages, Color, CommandEncoder, LoadOp, Operations,
    RenderPass, RenderPassColorAttachment, RenderPassDepthStencilAttachment, StoreOp, Texture,
    TextureDescriptor, TextureUsages, TextureView,
};

use super::GpuError;
use super::device::OpenDevice;
use super::formats::{COLOR, DEPTH, HEIGHT, SAMPLES};
use super::pipelines::Pipelines;
use crate::FrameSize;

/// Below every height: `MISS` in `trace.wgsl`.
pub(super) const MISS: f32 = -1e30;

/// Both formats that are read back have four bytes per pixel.
const PIXEL_BYTES: u32 = 4;

/// The time limit for a picture. A driver that exceeds it counts as hanging.
const PATIENCE: Duration = Duration::from_secs(60);

/// A surface, with the size and kind of its picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Plan {
    pub(super) size: FrameSize,
    pub(super) surface: Surface,
    pub(super) output: Output,
}

/// What is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Surface {
    Mesh,
    Trace,
}

/// The value written for each pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    /// Its colour.
    Color,
    /// The height of the surface, in mm.
    Height,
}

/// A target for pictures of one size and kind.
#[derive(Debug)]
pub(super) struct Target {
    pub(super) plan: Plan,
    texture: Texture,
    view: TextureView,
    depth: Depth,
    readback: Buffer,
    row_bytes: u32,
}

/// The depth buffer of a picture.
#[derive(Debug)]
enum Depth {
    /// None is needed.
    None,
    /// One sample per pixel, filled together with the picture.
    Plain(TextureView),
    /// Several samples per pixel, filled before the picture.
    Multisampled { view: TextureView, bound: BindGroup },
}

impl Target {
    /// Textures and a buffer for the pictures of a plan.
    pub(super) fn new(open: &OpenDevice, pipelines: &Pipelines, plan: Plan) -> Self {
        let Plan { size, .. } = plan;
        let texture = |format, sample_count, usage| {
            open.device.create_texture(&TextureDescriptor {
                label: Some("picture"),
                size: wgpu::Extent3d {
                    width: size.width(),
                    height: size.height(),
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let view = |texture: &Texture| texture.create_view(&Default::default());
        let depth = match (plan.surface, plan.output) {
            (Surface::Trace, _) => Depth::None,
            (Surface::Mesh, Output::Color) if open.is_multisampled => {
                let view = view(&texture(DEPTH, SAMPLES, TextureUsages::TEXTURE_BINDING));
                let bound = pipelines.bind_depth(&open.device, &view);
                Depth::Multisampled { view, bound }
            }
            (Surface::Mesh, _) => Depth::Plain(view(&texture(DEPTH, 1, TextureUsages::empty()))),
        };
        let format = match plan.output {
            Output::Color => COLOR,
            Output::Height => HEIGHT,
        };
        let picture = texture(format, 1, TextureUsages::COPY_SRC);
        let row_bytes =
            (PIXEL_BYTES * size.width()).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        Self {
            plan,
            view: view(&picture),
            texture: picture,
            depth,
            readback: open.device.create_buffer(&BufferDescriptor {
                label: Some("readback"),
                size: u64::from(row_bytes) * u64::from(size.height()),
                usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
            row_bytes,
        }
    }

    /// The depth buffer of several samples per pixel, for reading; `None` if the picture needs none.
    pub(super) fn multisampled_depth(&self) -> Option<&BindGroup> {
        match &self.depth {
            Depth::Multisampled { bound, .. } => Some(bound),
            _ => None,
        }
    }

    /// Clears the depth buffer of several samples per pixel.
    pub(super) fn begin_depth<'a>(&self, encoder: &'a mut CommandEncoder) -> RenderPass<'a> {
        let depth = match &self.depth {
            Depth::Multisampled { view, .. } => Some(cleared_depth(view, StoreOp::Store)),
            _ => None,
        };
        begin(encoder, &[], depth)
    }

    /// Begins a picture, which shows only the background.
    pub(super) fn begin_picture<'a>(&self, encoder: &'a mut CommandEncoder) -> RenderPass<'a> {
        let background = match self.plan.output {
            Output::Color => Color::TRANSPARENT,
            Output::Height => Color {
                r: f64::from(MISS),
                ..Color::TRANSPARENT
            },
        };
        let picture = RenderPassColorAttachment {
            view: &self.view,
            depth_slice: None,
            resolve_target: None,
            ops: Operations {
                load: LoadOp::Clear(background),
                store: StoreOp::Store,
            },
        };
        let depth = match &self.depth {
            Depth::Plain(view) => Some(cleared_depth(view, StoreOp::Discard)),
            _ => None,
        };
        begin(encoder, &[Some(picture)], depth)
    }

    /// Copies the finished picture into the buffer that can be read.
    pub(super) fn copy_out(&self, encoder: &mut CommandEncoder) {
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.readback,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.row_bytes),
                    rows_per_image: None,
                },
            },
            self.texture.size(),
        );
    }

    /// Waits for the picture and reads it: `read` gets its rows, each with padding after its pixels.
    pub(super) fn read<T>(
        &self,
        open: &OpenDevice,
        read: impl FnOnce(std::slice::ChunksExact<'_, u8>) -> T,
    ) -> Result<T, GpuError> {
        let failed = |reason: String| open.fault().unwrap_or(GpuError::Failed { reason });
        let (sender, receiver) = mpsc::channel();
        self.readback
            .map_async(wgpu::MapMode::Read, .., move |result| {
                // After a time-out, nobody receives this.
                let _ = sender.send(result);
            });
        let waited = open.device.poll(wgpu::PollType::Wait {
            submission_index: None,
            timeout: Some(PATIENCE),
        });
        if waited.is_err() {
            return Err(GpuError::Lost {
                reason: "it does not answer".to_owned(),
            });
        }
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(failed(error.to_string())),
            Err(_) => return Err(failed("the picture never came".to_owned())),
        }
        let bytes = self
            .readback
            .get_mapped_range(..)
            .map_err(|error| failed(error.to_string()))?;
        let result = read(bytes.chunks_exact(self.row_bytes as usize));
        drop(bytes);
        self.readback.unmap();
        match open.fault() {
            Some(fault) => Err(fault),
            None => Ok(result),
        }
    }
}

fn cleared_depth(view: &TextureView, store: StoreOp) -> RenderPassDepthStencilAttachment<'_> {
    RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(Operations {
            load: LoadOp::Clear(1.0),
            store,
        }),
        stencil_ops: None,
    }
}

fn begin<'a>(
    encoder: &'a mut CommandEncoder,
    color_attachments: &[Option<RenderPassColorAttachment<'_>>],
    depth_stencil_attachment: Option<RenderPassDepthStencilAttachment<'_>>,
) -> RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments,
        depth_stencil_attachment,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}
