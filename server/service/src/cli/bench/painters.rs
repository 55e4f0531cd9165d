//! Who draws on this machine.

use std::sync::Arc;

use measure::Painter;
use render::gpu::{GpuError, GpuOptions, GpuPool};

use crate::cli::status::{CliError, ExitStatus};
use crate::drawing::device_name;
use crate::graphics::GpuUse;
use crate::routes::render::Renderer;

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

    /// Those that were `asked` for; where none was, all that the machine has.
    ///
    /// # Errors
    /// When facets were asked for by name and there is no graphics device.
    pub(super) fn open(asked: &[Renderer], use_of: GpuUse) -> Result<Self, CliError> {
        let wants = |renderer| {
            asked.is_empty() || asked.contains(&Renderer::Auto) || asked.contains(&renderer)
        };
        let mut all = Vec::new();
        if wants(Renderer::Splat) {
            all.push(Painter::Splat);
        }
        if wants(Renderer::Trace) {
            all.push(Painter::Trace);
        }
        if !wants(Renderer::Mesh) && !wants(Renderer::Trace) {
            return Ok(Self {
                all,
                ..Self::none()
            });
        }
        match device(use_of) {
            Ok(pool) => {
                let graphics = device_name(pool.adapter());
                if wants(Renderer::Mesh) {
                    all.push(Painter::Mesh(Arc::clone(&pool)));
                }
                // Traced by a driver in software is slower than by the program itself.
                if wants(Renderer::Trace) && !pool.adapter().is_software {
                    all.push(Painter::GpuTrace(pool));
                }
                Ok(Self { all, graphics })
            }
            Err(why) if asked.contains(&Renderer::Mesh) => {
                let message = format!("meshes cannot be drawn: {why}");
                Err(CliError::new(ExitStatus::Unavailable, message))
            }
            Err(why) => Ok(Self {
                all,
                graphics: format!("none: {why}"),
            }),
        }
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
        let painters = Painters::open(&[], GpuUse::Off).unwrap();
        assert_eq!(painters.all.len(), 2);
        assert_eq!(painters.graphics, "none: graphics are turned off");
    }

    #[test]
    fn facets_that_were_asked_for_by_name_must_be_drawn() {
        let error = Painters::open(&[Renderer::Mesh], GpuUse::Off).unwrap_err();
        assert_eq!(error.status, ExitStatus::Unavailable);
    }

    #[test]
    fn one_renderer_may_be_asked_for() {
        let painters = Painters::open(&[Renderer::Splat], GpuUse::Auto).unwrap();
        assert!(matches!(painters.all[..], [Painter::Splat]));
    }
}
