//! The checks of every renderer, on the graphics device.

use std::sync::Arc;

use super::super::{GpuOptions, GpuPool};
use super::support::skip;
use crate::RenderBackend;
use crate::conformance::{Limits, check};

fn pool() -> Option<Arc<GpuPool>> {
    let pool = GpuPool::start(GpuOptions::default());
    pool.map_err(|error| skip(&error)).ok().map(Arc::new)
}

#[test]
fn the_device_traces_as_a_renderer_must() {
    let Some(pool) = pool() else { return };
    // 0.02 mm of 1.25.
    let limits = Limits {
        depth_voxels: 0.016,
        mean_difference: 1.0,
    };
    check(RenderBackend::GpuTrace(pool), limits);
}

#[test]
fn the_mesh_does_what_a_renderer_must() {
    let Some(pool) = pool() else { return };
    let limits = Limits {
        depth_voxels: 0.5,
        mean_difference: 3.0,
    };
    check(RenderBackend::GpuMesh(pool), limits);
}
