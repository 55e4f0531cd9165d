//! The graphics device of this machine, which is searched once while the server starts.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use render::gpu::{AdapterSummary, GpuError, GpuOptions, GpuPool};
use tokio::sync::watch;

use crate::settings::{GpuUse, Render};

/// How long a picture waits for a slow driver.
const PATIENCE: Duration = Duration::from_secs(5);

/// The graphics device, once it is known whether there is one. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Graphics {
    found: watch::Receiver<Option<Found>>,
}

/// The result of the search for a graphics device.
#[derive(Debug, Clone)]
enum Found {
    Pool(Arc<GpuPool>),
    /// None can be used; the reason, as part of a sentence.
    Nothing(&'static str),
}

impl Found {
    fn pool(&self) -> Option<Arc<GpuPool>> {
        match self {
            Self::Pool(pool) => Some(Arc::clone(pool)),
            Self::Nothing(_) => None,
        }
    }
}

/// The state of the graphics device, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GraphicsState {
    /// Its driver has not answered yet.
    Starting,
    /// There is none; the reason.
    Absent(&'static str),
    Present(AdapterSummary),
}

impl Graphics {
    /// Searches for a graphics device in a separate thread and logs the result once.
    ///
    /// With [`GpuUse::Auto`], no driver is loaded on a machine without graphics hardware: a software driver is slower
    /// than the CPU renderers, and needs more memory than everything else together.
    pub fn start(render: &Render) -> Self {
        let (sender, found) = watch::channel(None);
        let nothing = match render.gpu {
            GpuUse::Off => Some("the configuration turns graphics off"),
            GpuUse::Auto if !may_be_hardware() => Some("this machine has no graphics hardware"),
            GpuUse::Auto | GpuUse::Always => None,
        };
        if let Some(why) = nothing {
            tracing::info!("rendering on the CPU, because {why}");
            sender.send_replace(Some(Found::Nothing(why)));
            return Self { found };
        }
        let render = render.clone();
        let looking = std::thread::Builder::new()
            .name("find-graphics".to_owned())
            .spawn(move || sender.send_replace(Some(find(&render))));
        if let Err(error) = looking {
            // The channel is closed then, which reads as no device.
            tracing::warn!(%error, "cannot start the thread that searches for a graphics device");
        }
        Self { found }
    }

    /// The state at the moment.
    pub fn state(&self) -> GraphicsState {
        match &*self.found.borrow() {
            None => GraphicsState::Starting,
            Some(Found::Nothing(why)) => GraphicsState::Absent(why),
            Some(Found::Pool(pool)) => GraphicsState::Present(pool.adapter().clone()),
        }
    }

    /// The device, if one has been found already.
    pub fn device(&self) -> Option<Arc<GpuPool>> {
        self.found.borrow().as_ref()?.pool()
    }

    /// The device, once its driver has answered; `None` if there is none, or its driver does not answer.
    pub(crate) async fn pool(&self) -> Option<Arc<GpuPool>> {
        let mut found = self.found.clone();
        let known = tokio::time::timeout(PATIENCE, found.wait_for(Option::is_some)).await;
        // Neither a failed search nor an unfinished one has a device.
        known.ok()?.ok()?.as_ref()?.pool()
    }
}

/// Whether this machine has a node of a graphics device: those of Linux's own drivers, of NVIDIA's and AMD's, and of a
/// Windows host. Elsewhere than on Linux it is not known.
fn may_be_hardware() -> bool {
    let nodes = [
        "/dev/dri",
        "/dev/nvidiactl",
        "/dev/kfd",
        "/dev/dxg",
        "/dev/mali0",
    ];
    !cfg!(target_os = "linux") || nodes.iter().any(|node| Path::new(node).exists())
}

fn find(render: &Render) -> Found {
    let takes_software = render.gpu == GpuUse::Always;
    let options = GpuOptions {
        // Whoever asks has a turn, so no more than these are wanted; those whose clients left are passed over.
        queue: render.threads.max(1),
        case_bytes: render.gpu_case_bytes,
        ..GpuOptions::default()
    };
    let started = catch_unwind(AssertUnwindSafe(|| GpuPool::start(options)));
    match started {
        Ok(Ok(pool)) if pool.adapter().is_software && !takes_software => {
            tracing::info!("only a software driver was found; rendering on the CPU");
            Found::Nothing("its only graphics driver is software")
        }
        Ok(Ok(pool)) => {
            let adapter = pool.adapter();
            tracing::info!(
                adapter = adapter.name,
                interface = adapter.interface,
                driver = adapter.driver,
                software = adapter.is_software,
                "graphics device found"
            );
            Found::Pool(Arc::new(pool))
        }
        Ok(Err(error)) => {
            tracing::info!(%error, "no graphics device; rendering on the CPU");
            Found::Nothing(reason(&error))
        }
        Err(_panic) => {
            tracing::warn!("the graphics driver failed during the search; rendering on the CPU");
            Found::Nothing("its graphics driver failed")
        }
    }
}

/// The reason why there is no device, without the message of the driver, which may contain file paths.
fn reason(error: &GpuError) -> &'static str {
    match error {
        GpuError::NoAdapter { .. } => "no graphics adapter and no software Vulkan was found",
        _ => "its graphics device could not be opened",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn graphics_that_are_off_are_known_at_once() {
        let graphics = Graphics::start(&Render::on_cpu());
        assert!(matches!(graphics.state(), GraphicsState::Absent(_)));
        assert!(graphics.pool().await.is_none());
    }

    #[test]
    fn what_a_driver_says_is_not_shown() {
        let error = GpuError::NoDevice {
            reason: "/usr/lib/secret.so".to_owned(),
        };
        assert!(!reason(&error).contains("/usr"));
    }
}
