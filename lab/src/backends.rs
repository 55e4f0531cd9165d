//! The backends of this machine.

use std::sync::Arc;

use render::RenderBackend;
use render::gpu::{GpuOptions, GpuPool};

/// The measured backends.
#[derive(Debug)]
pub struct Backends {
    /// The backends.
    pub all: Vec<RenderBackend>,
    /// The graphics device and its driver, or the reason why there is none.
    pub graphics: String,
}

impl Backends {
    /// Only those on the CPU.
    pub fn on_cpu() -> Self {
        let all = vec![
            RenderBackend::Splat,
            RenderBackend::Mesh,
            RenderBackend::Trace,
        ];
        let graphics = "not used".to_owned();
        Self { all, graphics }
    }

    /// All backends of this machine: those on the CPU, then those on its graphics device.
    pub fn open() -> Self {
        let Self { mut all, .. } = Self::on_cpu();
        let pool = match GpuPool::start(GpuOptions::default()) {
            Ok(pool) => Arc::new(pool),
            Err(error) => {
                let graphics = format!("none: {error}");
                return Self { all, graphics };
            }
        };
        let graphics = pool.adapter().line();
        all.push(RenderBackend::GpuMesh(Arc::clone(&pool)));
        all.push(RenderBackend::GpuTrace(pool));
        Self { all, graphics }
    }

    /// The backends for tables of frame rates: hardware comes first, and tracing with a software driver is omitted,
    /// because it is slower than on the CPU.
    pub fn for_rates(mut self) -> Self {
        let is_software =
            |backend: &RenderBackend| backend.adapter().map(|adapter| adapter.is_software);
        self.all
            .retain(|backend| backend.needs_mesh() || is_software(backend) != Some(true));
        self.all
            .sort_by_key(|backend| is_software(backend) != Some(false));
        self
    }

    /// Only the backends with these names, or all if no names are given.
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
