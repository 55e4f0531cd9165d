//! Opens a lost device again.

use super::GpuError;
use super::adapter::Adapter;
use super::renderer::{GpuLimits, GpuRenderer};

/// Attempts at a picture: the second is on a new device, or with memory freed.
const ATTEMPTS: usize = 2;

/// Draws on a device, and opens another if it is lost.
#[derive(Debug)]
pub(super) struct GpuWorker {
    adapter: Adapter,
    limits: GpuLimits,
    renderer: Option<GpuRenderer>,
    reopened: u64,
    /// The number of attempts for which exhausted memory is simulated.
    #[cfg(any(test, feature = "faults"))]
    shortages: u32,
    /// Whether the next attempt must panic.
    #[cfg(any(test, feature = "faults"))]
    panics: bool,
}

impl GpuWorker {
    /// Opens a device of `adapter`.
    pub(super) fn new(adapter: Adapter, limits: GpuLimits) -> Result<Self, GpuError> {
        let renderer = GpuRenderer::open(&adapter, limits)?;
        Ok(Self {
            adapter,
            limits,
            renderer: Some(renderer),
            reopened: 0,
            #[cfg(any(test, feature = "faults"))]
            shortages: 0,
            #[cfg(any(test, feature = "faults"))]
            panics: false,
        })
    }

    /// The number of times that the device was opened again.
    #[cfg(test)]
    pub(super) fn reopened(&self) -> u64 {
        self.reopened
    }

    /// Draws. If the device is lost, draws again on a new one; if memory is exhausted, frees everything else and draws
    /// again.
    pub(super) fn attempt<T>(
        &mut self,
        mut draw: impl FnMut(&mut GpuRenderer) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let mut result = Err(GpuError::Closed);
        for _ in 0..ATTEMPTS {
            #[cfg(any(test, feature = "faults"))]
            self.fail_on_request();
            result = self.renderer().and_then(&mut draw);
            match &result {
                Err(GpuError::Lost { .. }) => self.renderer = None,
                Err(GpuError::OutOfMemory | GpuError::Failed { .. }) => self.free_memory(),
                _ => return result,
            }
        }
        result
    }

    /// Simulates a fault of the device.
    #[cfg(any(test, feature = "faults"))]
    pub(super) fn meet(&mut self, fault: super::fault::Fault) {
        match (fault, &self.renderer) {
            (super::fault::Fault::OutOfMemory(attempts), _) => self.shortages = attempts,
            (super::fault::Fault::Panic, _) => self.panics = true,
            (super::fault::Fault::Loss, Some(renderer)) => renderer.open.device.destroy(),
            (super::fault::Fault::Loss, None) => {}
        }
    }

    /// Panics, or lets the driver report exhausted memory, if a test requested it.
    #[cfg(any(test, feature = "faults"))]
    fn fail_on_request(&mut self) {
        assert!(!std::mem::take(&mut self.panics), "a fault for a test");
        if let (Some(renderer), 1..) = (&self.renderer, self.shortages) {
            self.shortages -= 1;
            renderer.open.run_short();
        }
    }

    /// Drops the device; the next picture opens another.
    pub(super) fn give_up(&mut self) {
        self.renderer = None;
    }

    fn free_memory(&mut self) {
        if let Some(renderer) = &mut self.renderer {
            renderer.free_memory();
        }
    }

    /// The device, opened again if there is none. The adapter may be gone too, so it is searched again.
    fn renderer(&mut self) -> Result<&mut GpuRenderer, GpuError> {
        let renderer = match self.renderer.take() {
            Some(renderer) => renderer,
            None => {
                self.reopened += 1;
                self.adapter = Adapter::find()?;
                GpuRenderer::open(&self.adapter, self.limits)?
            }
        };
        Ok(self.renderer.insert(renderer))
    }
}
