//! What became of the images that came, since the process started.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use strum::IntoStaticStr;

use crate::values::ArrivalSource;

/// What became of images of a PACS, by the way on which they came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum ImageStatus {
    /// They are new, and durable.
    Stored,
    /// They were there already.
    Known,
    /// They took the place of others with the same UID.
    Corrected,
    /// They are no images, or cannot be read.
    Refused,
    /// They are of a class of which nothing is kept.
    Ignored,
    /// They could not be stored.
    Failed,
}

impl ImageStatus {
    /// Its name in metrics.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The counts. The mutex is held for a look-up, never across an await.
#[derive(Debug, Default)]
pub(super) struct ImageCounts(Mutex<HashMap<(&'static str, ImageStatus), u64>>);

impl ImageCounts {
    pub(super) fn came(&self, source: ArrivalSource, status: ImageStatus, count: usize) {
        let mut images = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *images.entry((source.name(), status)).or_default() += count as u64;
    }

    /// By way and status.
    pub(super) fn images(&self) -> Vec<(&'static str, ImageStatus, u64)> {
        let images = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let each = (images.iter()).map(|(&(way, status), &count)| (way, status, count));
        let mut images: Vec<_> = each.collect();
        images.sort_unstable();
        images
    }
}
