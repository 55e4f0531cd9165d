//! The graphics device of this machine: looked for once, beside the start of the server.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use render::gpu::{AdapterSummary, GpuError, GpuOptions, GpuPool};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// How long a picture that needs to know waits for a driver that is slow to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Whether pictures may be drawn by a graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GpuUse {
    /// Where there is one in hardware.
    #[default]
    Auto,
    /// Where there is any, even if it is a program, which is slower than the processor's own renderers.
    Always,
    /// Never: no driver is loaded.
    Off,
}

/// What the graphics device may be used for, and how much of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GraphicsOptions {
    /// Whether at all.
    pub use_of: GpuUse,
    /// How many pictures are asked for at a time.
    pub at_a_time: usize,
    /// Bytes of the textures of cases.
    pub case_bytes: u64,
}

impl GraphicsOptions {
    /// For one who draws a picture now and then.
    pub fn of_one(use_of: GpuUse) -> Self {
        Self {
            use_of,
            at_a_time: 1,
            case_bytes: GpuOptions::default().case_bytes,
        }
    }
}

/// The graphics device, once it is known whether there is one. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Graphics {
    found: watch::Receiver<Option<Found>>,
}

/// What looking for a graphics device found.
#[derive(Debug, Clone)]
enum Found {
    Pool(Arc<GpuPool>),
    /// None can be used, and why: a sentence without its end.
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

/// What is known of the graphics device, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GraphicsState {
    /// Its driver has not answered yet.
    Starting,
    /// There is none, and why.
    Absent(&'static str),
    /// What draws.
    Present(AdapterSummary),
}

impl Graphics {
    /// Looks for a graphics device in a thread of its own and says once in the log what it found.
    ///
    /// With [`GpuUse::Auto`] no driver is loaded on a machine without graphics hardware: one in software draws more slowly than
    /// the processor's own renderers, and takes more memory than everything else together.
    pub fn start(options: GraphicsOptions) -> Self {
        let (sender, found) = watch::channel(None);
        let nothing = match options.use_of {
            GpuUse::Off => Some("the configuration turns graphics off"),
            GpuUse::Auto if !may_be_hardware() => Some("this machine has no graphics hardware"),
            GpuUse::Auto | GpuUse::Always => None,
        };
        if let Some(why) = nothing {
            tracing::info!("no graphics device, for {why}: the processor draws all pictures");
            sender.send_replace(Some(Found::Nothing(why)));
            return Self { found };
        }
        let looking = std::thread::Builder::new()
            .name("find-graphics".to_owned())
            .spawn(move || sender.send_replace(Some(find(options))));
        if let Err(error) = looking {
            // The channel is closed then, which reads as no device.
            tracing::warn!(%error, "no thread to look for a graphics device");
        }
        Self { found }
    }

    /// What is known by now.
    pub fn state(&self) -> GraphicsState {
        match &*self.found.borrow() {
            None => GraphicsState::Starting,
            Some(Found::Nothing(why)) => GraphicsState::Absent(why),
            Some(Found::Pool(pool)) => GraphicsState::Present(pool.adapter().clone()),
        }
    }

    /// The device, if one is known by now.
    pub fn device(&self) -> Option<Arc<GpuPool>> {
        self.found.borrow().as_ref()?.pool()
    }

    /// The device, once its driver has answered; `None` if there is none, or its driver does not answer.
    pub(crate) async fn pool(&self) -> Option<Arc<GpuPool>> {
        let mut found = self.found.clone();
        let known = tokio::time::timeout(PATIENCE, found.wait_for(Option::is_some)).await;
        // Neither one who looked in vain nor one who has not answered has a device.
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

fn find(options: GraphicsOptions) -> Found {
    let takes_software = options.use_of == GpuUse::Always;
    let options = GpuOptions {
        // Whoever asks has a turn, so no more than these are wanted; those whose clients left are passed over.
        queue: options.at_a_time.max(1),
        case_bytes: options.case_bytes,
        ..GpuOptions::default()
    };
    let started = catch_unwind(AssertUnwindSafe(|| GpuPool::start(options)));
    match started {
        Ok(Ok(pool)) if pool.adapter().is_software && !takes_software => {
            tracing::info!("no graphics device but a program: the processor draws all pictures");
            Found::Nothing("its only graphics device is a program")
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
            tracing::info!(%error, "no graphics device: the processor draws all pictures");
            Found::Nothing(reason(&error))
        }
        Err(_panic) => {
            tracing::warn!(
                "no graphics device, for its driver failed while it was looked at: the processor draws all pictures"
            );
            Found::Nothing("its graphics driver failed")
        }
    }
}

/// Why there is no device, without what a driver says: that may hold paths of files.
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
        let graphics = Graphics::start(GraphicsOptions::of_one(GpuUse::Off));
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
