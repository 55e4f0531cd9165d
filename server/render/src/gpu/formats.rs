//! The formats of render targets.

use wgpu::TextureFormat;

/// Colours, multiplied by alpha, the covered fraction of the pixel.
pub(super) const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;

/// Heights in mm; the background is far below every height.
pub(super) const HEIGHT: TextureFormat = TextureFormat::R32Float;

/// Samples per pixel of the depth buffer of a mesh, if the device offers them: `SAMPLES` in `multisampled.wgsl`.
pub(super) const SAMPLES: u32 = 4;

/// The nearer fragment wins.
pub(super) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
