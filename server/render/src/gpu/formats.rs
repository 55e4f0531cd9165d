//! The formats of the pictures that are drawn into.

use wgpu::TextureFormat;

/// Colours, times how much of the pixel is covered: alpha.
pub(super) const COLOR: TextureFormat = TextureFormat::Rgba8Unorm;

/// Heights in mm; far below every height where nothing is.
pub(super) const HEIGHT: TextureFormat = TextureFormat::R32Float;

/// Samples of a pixel of the mesh's depth buffer, where they are offered: `SAMPLES` in `multisampled.wgsl`.
pub(super) const SAMPLES: u32 = 4;

/// What is nearer to the viewer.
pub(super) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
