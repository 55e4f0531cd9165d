//! Who draws on this machine.

use std::sync::Arc;

use measure::Painter;
use render::gpu::{GpuError, GpuOptions, GpuPool};

use cases::pictures::GpuUse;
use cases::pictures::device_name;
use render::choice::Renderer;

/// The renderers that are measured.
#[derive(Debug)]
pub(super) struct Painters {
    /// All of them.
    pub(super) all: Vec<Painter>,
    /// The graphics device and its driver, or why there is none.
    pub(super) graphics: String,
}

impl Painters {
    /// Nobody draws.
    pub(super) fn none() -> Self {
        Self {
            all: Vec::new(),
            graphics: "not asked for".to_owned(),
        }
    }

    /// Those that were `asked` for; where none was, all that the machine has. A device in hardware comes first.
    pub(super) fn open(asked: &[Renderer], use_of: GpuUse) -> Self {
        let wants = |renderer| {
            asked.is_empty() || asked.contains(&Renderer::Auto) || asked.contains(&renderer)
        };
        let mut all = Vec::new();
        if wants(Renderer::Splat) {
            all.push(Painter::Splat);
        }
        if wants(Renderer::Mesh) {
            all.push(Painter::Mesh);
        }
        if wants(Renderer::Trace) {
            all.push(Painter::Trace);
        }
        if !wants(Renderer::Mesh) && !wants(Renderer::Trace) {
            return Self {
                all,
                ..Self::none()
            };
        }
        let pool = match device(use_of) {
            Ok(pool) => pool,
            Err(why) => {
                let graphics = format!("none: {why}");
                return Self { all, graphics };
            }
        };
        let is_software = pool.adapter().is_software;
        let graphics = device_name(pool.adapter());
        let first = if is_software { all.len() } else { 0 };
        // Traced by a driver in software is slower than by the program itself.
        if wants(Renderer::Trace) && !is_software {
            all.insert(first, Painter::GpuTrace(Arc::clone(&pool)));
        }
        if wants(Renderer::Mesh) {
            all.insert(first, Painter::GpuMesh(pool));
        }
        Self { all, graphics }
    }
}

fn device(use_of: GpuUse) -> Result<Arc<GpuPool>, String> {
    if use_of == GpuUse::Off {
        return Err("graphics are turned off".to_owned());
    }
    let pool = GpuPool::start(GpuOptions::default());
    pool.map(Arc::new)
        .map_err(|error: GpuError| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_graphics_the_processor_is_measured_and_the_reason_is_told() {
        let painters = Painters::open(&[], GpuUse::Off);
        let expected = [Painter::Splat, Painter::Mesh, Painter::Trace].map(|one| one.name());
        assert_eq!(
            painters.all.iter().map(Painter::name).collect::<Vec<_>>(),
            expected
        );
        assert_eq!(painters.graphics, "none: graphics are turned off");
    }

    #[test]
    fn one_renderer_may_be_asked_for() {
        let painters = Painters::open(&[Renderer::Splat], GpuUse::Auto);
        assert!(matches!(painters.all[..], [Painter::Splat]));
    }
}
