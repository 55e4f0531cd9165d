//! A device that is opened anew when it is lost.

use super::GpuError;
use super::host::Host;
use super::studio::{Studio, StudioLimits};

/// How often a picture is tried: once more on a new device, or with its memory freed.
const ATTEMPTS: usize = 2;

/// Draws on a device, and goes on with another when that is lost.
#[derive(Debug)]
pub(super) struct Painter {
    host: Host,
    limits: StudioLimits,
    studio: Option<Studio>,
    reopened: u64,
    /// Attempts that are to find no memory.
    #[cfg(feature = "faults")]
    shortages: u32,
}

impl Painter {
    /// Opens a device of `host`.
    pub(super) fn new(host: Host, limits: StudioLimits) -> Result<Self, GpuError> {
        let studio = Studio::open(&host, limits)?;
        Ok(Self {
            host,
            limits,
            studio: Some(studio),
            reopened: 0,
            #[cfg(feature = "faults")]
            shortages: 0,
        })
    }

    /// How often the device was opened anew.
    #[cfg(test)]
    pub(super) fn reopened(&self) -> u64 {
        self.reopened
    }

    /// Draws; on a lost device, once more on a new one; without memory, once more with everything else freed.
    pub(super) fn attempt<T>(
        &mut self,
        mut draw: impl FnMut(&mut Studio) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let mut result = Err(GpuError::Closed);
        for _ in 0..ATTEMPTS {
            #[cfg(feature = "faults")]
            self.run_short();
            result = self.studio().and_then(&mut draw);
            match &result {
                Err(GpuError::Lost { .. }) => self.studio = None,
                Err(GpuError::OutOfMemory | GpuError::Failed { .. }) => self.free_memory(),
                _ => return result,
            }
        }
        result
    }

    /// Breaks the device.
    #[cfg(feature = "faults")]
    pub(super) fn meet(&mut self, fault: super::pool::Fault) {
        match (fault, &self.studio) {
            (super::pool::Fault::OutOfMemory(attempts), _) => self.shortages = attempts,
            (super::pool::Fault::Loss, Some(studio)) => studio.open.device.destroy(),
            (super::pool::Fault::Loss, None) => {}
        }
    }

    /// Lets the driver say that there is no memory, if it is to.
    #[cfg(feature = "faults")]
    fn run_short(&mut self) {
        if let (Some(studio), 1..) = (&self.studio, self.shortages) {
            self.shortages -= 1;
            studio.open.run_short();
        }
    }

    /// Gives the device up: the next picture opens another.
    pub(super) fn give_up(&mut self) {
        self.studio = None;
    }

    fn free_memory(&mut self) {
        if let Some(studio) = &mut self.studio {
            studio.free_memory();
        }
    }

    /// The device, opened anew if there is none. Its adapter may have gone with it and is looked for again.
    fn studio(&mut self) -> Result<&mut Studio, GpuError> {
        let studio = match self.studio.take() {
            Some(studio) => studio,
            None => {
                self.reopened += 1;
                self.host = Host::find()?;
                Studio::open(&self.host, self.limits)?
            }
        };
        Ok(self.studio.insert(studio))
    }
}
