//! Pictures off screen, and their way back.

use std::sync::mpsc;
use std::time::Duration;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, Color, CommandEncoder, LoadOp, Operations, RenderPass,
    RenderPassColorAttachment, RenderPassDepthStencilAttachment, StoreOp, Texture,
    TextureDescriptor, TextureFormat, TextureUsages, TextureView,
};

use super::GpuError;
use super::device::OpenDevice;
use super::pipelines::{Kind, Output, samples};
use crate::FrameSize;

/// Colours, times how much of the pixel is covered: alpha.
pub(super) const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;

/// Heights in mm; far below every height where nothing is.
pub(super) const HEIGHT: TextureFormat = TextureFormat::R32Float;

/// What is nearer to the viewer.
pub(super) const DEPTH: TextureFormat = TextureFormat::Depth32Float;

/// Below every height: `MISS` in `trace.wgsl`.
pub(super) const MISS: f32 = -1e30;

/// Both formats that are read back have four bytes a pixel.
const PIXEL_BYTES: u32 = 4;

/// How long a picture may take. A driver that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Where pictures of one size and kind are drawn.
#[derive(Debug)]
pub(super) struct Target {
    size: FrameSize,
    kind: Kind,
    output: Output,
    texture: Texture,
    view: TextureView,
    /// Several samples a pixel, that are brought together in `view`.
    multisampled: Option<TextureView>,
    depth: Option<TextureView>,
    readback: Buffer,
    row_bytes: u32,
}

impl Target {
    /// Textures and a buffer for pictures of `size`.
    pub(super) fn new(open: &OpenDevice, size: FrameSize, kind: Kind, output: Output) -> Self {
        let format = match output {
            Output::Color => COLOR,
            Output::Height => HEIGHT,
        };
        let samples = samples(open, kind, output);
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
        let view = |texture: Texture| texture.create_view(&Default::default());
        let picture = texture(format, 1, TextureUsages::COPY_SRC);
        let row_bytes =
            (PIXEL_BYTES * size.width()).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        Self {
            size,
            kind,
            output,
            view: picture.create_view(&Default::default()),
            texture: picture,
            multisampled: (samples > 1)
                .then(|| view(texture(format, samples, TextureUsages::empty()))),
            depth: (kind == Kind::Mesh)
                .then(|| view(texture(DEPTH, samples, TextureUsages::empty()))),
            readback: open.device.create_buffer(&BufferDescriptor {
                label: Some("readback"),
                size: u64::from(row_bytes) * u64::from(size.height()),
                usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
            row_bytes,
        }
    }

    /// Whether this is what a picture needs.
    pub(super) fn suits(&self, size: FrameSize, kind: Kind, output: Output) -> bool {
        (self.size, self.kind, self.output) == (size, kind, output)
    }

    /// Begins a picture of nothing but background.
    pub(super) fn begin<'a>(&self, encoder: &'a mut CommandEncoder) -> RenderPass<'a> {
        let background = match self.output {
            Output::Color => Color::TRANSPARENT,
            Output::Height => Color {
                r: f64::from(MISS),
                ..Color::TRANSPARENT
            },
        };
        let store = |is_kept| {
            if is_kept {
                StoreOp::Store
            } else {
                StoreOp::Discard
            }
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("picture"),
            color_attachments: &[Some(RenderPassColorAttachment {
                view: self.multisampled.as_ref().unwrap_or(&self.view),
                depth_slice: None,
                resolve_target: self.multisampled.as_ref().map(|_| &self.view),
                ops: Operations {
                    load: LoadOp::Clear(background),
                    store: store(self.multisampled.is_none()),
                },
            })],
            depth_stencil_attachment: self.depth.as_ref().map(|view| {
                RenderPassDepthStencilAttachment {
                    view,
                    depth_ops: Some(Operations {
                        load: LoadOp::Clear(1.0),
                        store: StoreOp::Discard,
                    }),
                    stencil_ops: None,
                }
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }

    /// Copies the finished picture to where it can be read.
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

    /// Waits for the picture and reads it: `read` gets its rows, each with padding behind its pixels.
    pub(super) fn read<T>(
        &self,
        open: &OpenDevice,
        read: impl FnOnce(std::slice::ChunksExact<'_, u8>) -> T,
    ) -> Result<T, GpuError> {
        let failed = |reason: String| open.fault().unwrap_or(GpuError::Failed { reason });
        let (sender, receiver) = mpsc::channel();
        self.readback
            .map_async(wgpu::MapMode::Read, .., move |result| {
                // Nobody waits any more when the device hangs.
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
