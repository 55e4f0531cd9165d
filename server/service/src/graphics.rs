//! The graphics device of this machine: looked for once, beside the start of the server.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use render::gpu::{AdapterSummary, GpuError, GpuOptions, GpuPool};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

use crate::problem::AppError;

/// How long a picture that needs to know waits for a driver that is slow to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Whether pictures may be drawn by a graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum GpuUse {
    /// Where there is one.
    #[default]
    Auto,
    /// Where there is one, and for `auto` and `trace` even if it is a program, which is slower than the processor's own renderers.
    Always,
    /// Never: no driver is loaded.
    Off,
}

/// What the graphics device may be used for, and how much of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GraphicsOptions {
    /// Whether at all.
    pub use_of: GpuUse,
    /// How many threads will ask for pictures at a time.
    pub drawers: usize,
    /// Bytes of the textures of cases.
    pub case_bytes: u64,
}

impl GraphicsOptions {
    /// For one who draws a picture now and then.
    pub fn of_one(use_of: GpuUse) -> Self {
        Self {
            use_of,
            drawers: 1,
            case_bytes: GpuOptions::default().case_bytes,
        }
    }
}

/// The graphics device, once it is known whether there is one. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Graphics {
    found: watch::Receiver<Option<Found>>,
    /// The search, until it begins. Held for moments.
    search: Arc<Mutex<Option<Search>>>,
    /// Whether `auto` and `trace` are drawn by a device that is a program.
    takes_software: bool,
}

/// A search for a graphics device that has not begun.
#[derive(Debug)]
struct Search {
    options: GpuOptions,
    sender: watch::Sender<Option<Found>>,
}

/// What looking for a graphics device found.
#[derive(Debug, Clone)]
enum Found {
    Pool(Arc<GpuPool>),
    /// None can be used, and why: a sentence without its end.
    Nothing(&'static str),
}

/// What is known of the graphics device, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GraphicsState {
    /// There is none in hardware; one in software is opened when a picture asks for it.
    Resting,
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
    /// On a machine without graphics hardware it waits with that until a picture needs a device: the driver in software
    /// takes more memory than everything else together. With [`GpuUse::Always`] it does not wait.
    pub fn start(options: GraphicsOptions) -> Self {
        let (sender, found) = watch::channel(None);
        let takes_software = options.use_of == GpuUse::Always;
        if options.use_of == GpuUse::Off {
            tracing::info!("graphics are turned off: pictures are drawn in software");
            sender.send_replace(Some(Found::Nothing("the configuration turns graphics off")));
            return Self {
                found,
                search: Arc::default(),
                takes_software,
            };
        }
        let options = GpuOptions {
            // Each drawer waits for its picture, so no more than these can be queued.
            queue: options.drawers.max(1),
            case_bytes: options.case_bytes,
            ..GpuOptions::default()
        };
        let search = Arc::new(Mutex::new(Some(Search { options, sender })));
        let graphics = Self {
            found,
            search,
            takes_software,
        };
        if takes_software || may_be_hardware() {
            graphics.begin();
        } else {
            tracing::info!("no graphics device in hardware: pictures are drawn in software");
        }
        graphics
    }

    /// Begins to look for a device, if that has not begun.
    pub fn begin(&self) {
        let search = self
            .search
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let Some(Search { options, sender }) = search else {
            return;
        };
        let looking = std::thread::Builder::new()
            .name("find-graphics".to_owned())
            .spawn(move || sender.send_replace(Some(find(options))));
        if let Err(error) = looking {
            // The channel is closed then, which reads as no device.
            tracing::warn!(%error, "no thread to look for a graphics device");
        }
    }

    fn is_resting(&self) -> bool {
        self.search
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_some()
    }

    /// What is known by now.
    pub fn state(&self) -> GraphicsState {
        match &*self.found.borrow() {
            None if self.is_resting() => GraphicsState::Resting,
            None => GraphicsState::Starting,
            Some(Found::Nothing(why)) => GraphicsState::Absent(why),
            Some(Found::Pool(pool)) => GraphicsState::Present(pool.adapter().clone()),
        }
    }

    /// The device, if one is known by now.
    pub fn device(&self) -> Option<Arc<GpuPool>> {
        match &*self.found.borrow() {
            Some(Found::Pool(pool)) => Some(Arc::clone(pool)),
            _ => None,
        }
    }

    /// The device for what the processor can draw as well, once its driver has answered: one in hardware, if not told otherwise.
    pub(crate) async fn preferred(&self) -> Option<Arc<GpuPool>> {
        if self.is_resting() {
            return None;
        }
        self.pool()
            .await
            .ok()
            .filter(|pool| self.takes_software || !pool.adapter().is_software)
    }

    /// The device, once its driver has answered; `Err` with the reason where there is none.
    pub(crate) async fn pool(&self) -> Result<Arc<GpuPool>, &'static str> {
        self.begin();
        let mut found = self.found.clone();
        let known = tokio::time::timeout(PATIENCE, found.wait_for(Option::is_some)).await;
        match known {
            Ok(Ok(found)) => match &*found {
                Some(Found::Pool(pool)) => Ok(Arc::clone(pool)),
                Some(Found::Nothing(why)) => Err(why),
                None => Err("its graphics driver does not answer"),
            },
            Ok(Err(_closed)) => Err("no graphics device could be looked for"),
            Err(_elapsed) => Err("its graphics driver does not answer"),
        }
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

fn find(options: GpuOptions) -> Found {
    let started = catch_unwind(AssertUnwindSafe(|| GpuPool::start(options)));
    match started {
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
            tracing::info!(%error, "no graphics device: the renderer mesh is not available, all others are");
            Found::Nothing(reason(&error))
        }
        Err(_panic) => {
            tracing::warn!(
                "the graphics driver failed while it was looked at: the renderer mesh is not available"
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

/// What a client is told when the device did not draw what it alone can draw.
pub(crate) fn problem_of(error: &GpuError) -> AppError {
    match error {
        GpuError::NoAdapter { .. } | GpuError::NoDevice { .. } => AppError::NoRenderer {
            renderer: "mesh",
            why: reason(error),
        },
        GpuError::CaseTooLarge { .. } => AppError::NoRenderer {
            renderer: "mesh",
            why: "the case does not fit its graphics device",
        },
        GpuError::Busy => AppError::Busy,
        GpuError::Closed => AppError::Unavailable,
        GpuError::Mesh { .. } => AppError::Internal,
        _ => AppError::GraphicsFailed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn graphics_that_are_off_are_known_at_once() {
        let graphics = Graphics::start(GraphicsOptions::of_one(GpuUse::Off));
        assert!(matches!(graphics.state(), GraphicsState::Absent(_)));
        assert!(graphics.pool().await.unwrap_err().contains("off"));
    }

    #[test]
    fn what_a_driver_says_is_not_shown() {
        let error = GpuError::NoDevice {
            reason: "/usr/lib/secret.so".to_owned(),
        };
        let problem = problem_of(&error).problem();
        assert_eq!(problem.status, 501);
        assert!(!problem.detail.contains("/usr"));
        let lost = GpuError::Lost {
            reason: "/dev/dri".to_owned(),
        };
        assert_eq!(problem_of(&lost).problem().status, 503);
    }
}
