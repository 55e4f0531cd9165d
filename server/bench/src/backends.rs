//! Who can draw on this machine.

use std::sync::Arc;

use render::RenderBackend;
use render::gpu::{GpuOptions, GpuPool};

/// The backends that are measured.
#[derive(Debug)]
pub struct Backends {
    /// All of them.
    pub all: Vec<RenderBackend>,
    /// The graphics device and its driver, or why there is none.
    pub graphics: String,
}

impl Backends {
    /// Those of the CPU alone.
    pub fn on_cpu() -> Self {
        let all = vec![
            RenderBackend::Splat,
            RenderBackend::Mesh,
            RenderBackend::Trace,
        ];
        let graphics = "not used".to_owned();
        Self { all, graphics }
    }

    /// All that this machine has. A device in hardware comes first.
    pub fn open() -> Self {
        let Self { mut all, .. } = Self::on_cpu();
        let pool = match GpuPool::start(GpuOptions::default()) {
            Ok(pool) => Arc::new(pool),
            Err(error) => {
                let graphics = format!("none: {error}");
                return Self { all, graphics };
            }
        };
        let adapter = pool.adapter().clone();
        let graphics = format!(
            "{} ({}, {})",
            adapter.name, adapter.interface, adapter.driver
        );
        if adapter.is_software {
            // Tracing by a driver in software is slower than by the program itself.
            all.push(RenderBackend::GpuMesh(pool));
        } else {
            let device = [
                RenderBackend::GpuMesh(Arc::clone(&pool)),
                RenderBackend::GpuTrace(pool),
            ];
            all.splice(0..0, device);
        }
        Self { all, graphics }
    }

    /// Only the backends of these names, or all if there are none.
    pub fn only(mut self, names: &[&str]) -> Self {
        let is_wanted =
            |backend: &RenderBackend| names.is_empty() || names.contains(&backend.name());
        self.all.retain(is_wanted);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_backend_may_be_chosen_by_its_name() {
        let names = |backends: Backends| {
            let names = backends.all.iter().map(RenderBackend::name);
            names.collect::<Vec<_>>()
        };
        assert_eq!(
            names(Backends::on_cpu().only(&[])),
            ["splat", "mesh", "trace"]
        );
        assert_eq!(names(Backends::on_cpu().only(&["trace"])), ["trace"]);
    }
}
