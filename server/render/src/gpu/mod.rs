//! The shrunk mesh and the traced isosurface, drawn off screen by a graphics device.
//!
//! A [`GpuPool`] finds the adapter once (a real GPU, or Mesa's software Vulkan) and keeps some threads that own a
//! device each; [`GpuPool::draw`] hands them a [`GpuJob`] through a bounded queue and waits for the picture. The
//! shaders are the WGSL of the folder `shaders/`, which the page uses too; they follow the steps of the CPU renderers
//! under the same names.
//!
//! A lost device is opened again and the picture drawn again. The textures of cases stay on the device, bounded by
//! bytes. A volume that is too large for a texture is drawn from a reduced copy, and the answer reports it.

mod adapter;
mod block;
mod cache;
mod case;
mod device;
mod error;
#[cfg(any(test, feature = "faults"))]
mod fault;
mod formats;
mod gradients;
mod job;
mod layer;
mod layout;
mod pipelines;
mod pixels;
mod pool;
mod reduce;
mod renderer;
mod shaders;
mod target;
#[cfg(test)]
mod tests;
mod texels;
mod uniforms;
mod worker;

pub use adapter::AdapterSummary;
pub use error::GpuError;
#[cfg(any(test, feature = "faults"))]
pub use fault::Fault;
pub use job::{CaseKey, GpuJob, GpuSurface, KeyedModel};
pub use pool::{GpuOptions, GpuPool, GpuTicket};
pub use shaders::{PAGE_SHADERS, PageShader, PageStage};
