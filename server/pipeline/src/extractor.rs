//! Extracts brains, one at a time.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use extraction::{Extraction, ExtractionError, Network, predict, prune};
use geometry::Volume;

use super::failure::{cancelled, from_geometry};
use case::{Failure, FailureKind, MaskSource};

/// The file with the network's weights, as it is published.
pub const NETWORK_FILE: &str = "deepbet-1.0.2-py3-none-any.whl";

/// The probability above which a voxel is brain, where nobody says another.
const USUAL_THRESHOLD: f32 = 0.5;

/// How often a preparation that waits for its turn looks whether it is still wanted.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Extracts brains: with the network where there is one, else by tree pruning. One at a time, for each takes hundreds of
/// megabytes and every core.
#[derive(Debug, Default)]
pub struct Extractor {
    network: Option<Network>,
    /// Held while a brain is extracted.
    turn: Mutex<()>,
}

/// The network cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NoNetwork {
    /// The file cannot be read.
    #[error("the network's weights {} cannot be read: {source}", .path.display())]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is something else.
    #[error("the network's weights {} cannot be used: {source}", .path.display())]
    Unusable {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: ExtractionError,
    },
}

impl Extractor {
    /// With the network of a file, or of [`NETWORK_FILE`] beside the program or a folder above it; without one where there is
    /// none.
    ///
    /// # Errors
    /// When the file that was named, or found, cannot be read or is something else.
    pub fn open(file: Option<&Path>) -> Result<Self, NoNetwork> {
        let Some(path) = file.map(Path::to_owned).or_else(beside_the_program) else {
            return Ok(Self::default());
        };
        let wheel = std::fs::read(&path).map_err(|source| NoNetwork::Unreadable {
            path: path.clone(),
            source,
        })?;
        let network = Network::from_wheel(&wheel);
        let network = network.map_err(|source| NoNetwork::Unusable { path, source })?;
        Ok(Self {
            network: Some(network),
            turn: Mutex::default(),
        })
    }

    /// Whether there is a network.
    pub(super) fn has_network(&self) -> bool {
        self.network.is_some()
    }

    /// How brains are extracted, in words.
    pub fn words(&self) -> &'static str {
        match self.network {
            Some(_) => "by the network",
            None => "by tree pruning, for there are no network weights",
        }
    }

    /// The brain of a volume, when its turn comes.
    ///
    /// `source` names the method: [`MaskSource::Network`], [`MaskSource::Pruning`], else the one that does better. `threshold` is
    /// the probability above which a voxel is brain, where the network finds it; `observe` is told the share of the work that
    /// is done.
    ///
    /// # Errors
    /// When there is nothing that can be a brain, the network is wanted and missing, or `cancelled` is raised.
    pub(super) fn extract(
        &self,
        volume: &Volume,
        (source, threshold): (MaskSource, f64),
        observe: &dyn Fn(f32),
        is_cancelled: &AtomicBool,
    ) -> Result<Extraction, Failure> {
        let _turn = self.await_turn(is_cancelled)?;
        let go_on = |done: f32| {
            observe(done);
            if is_cancelled.load(Ordering::Relaxed) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let threshold = threshold as f32;
        let found = match (source, &self.network) {
            (MaskSource::Network, None) => return Err(network_missing()),
            (MaskSource::Network, Some(network)) => predict(volume, network, threshold, &go_on),
            (MaskSource::Pruning, Some(_)) => prune(volume, &go_on),
            (_, network) => extraction::extract(volume, network.as_ref(), threshold, &go_on),
        };
        found.map_err(from_extraction)
    }

    /// What the network finds in a volume for which a mask was supplied, when its turn comes; `None` if there is no network.
    ///
    /// # Errors
    /// When it finds nothing, or `cancelled` is raised.
    pub(super) fn second_opinion(
        &self,
        volume: &Volume,
        is_cancelled: &AtomicBool,
    ) -> Result<Option<Extraction>, ExtractionError> {
        let Some(network) = &self.network else {
            return Ok(None);
        };
        let turn = self.await_turn(is_cancelled);
        let _turn = turn.map_err(|_| ExtractionError::Cancelled)?;
        let go_on = |_: f32| {
            if is_cancelled.load(Ordering::Relaxed) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        predict(volume, network, USUAL_THRESHOLD, &go_on).map(Some)
    }

    fn await_turn(&self, is_cancelled: &AtomicBool) -> Result<MutexGuard<'_, ()>, Failure> {
        loop {
            if is_cancelled.load(Ordering::Relaxed) {
                return Err(cancelled());
            }
            match self.turn.try_lock() {
                Ok(turn) => return Ok(turn),
                // Whoever panicked left nothing half done.
                Err(TryLockError::Poisoned(turn)) => return Ok(turn.into_inner()),
                Err(TryLockError::WouldBlock) => std::thread::sleep(LOOK_EVERY),
            }
        }
    }
}

fn beside_the_program() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let folders = program.ancestors().skip(1).take(2);
    folders
        .map(|folder| folder.join(NETWORK_FILE))
        .find(|file| file.is_file())
}

/// The network is asked for, and there is none.
pub(super) fn network_missing() -> Failure {
    Failure::new(
        FailureKind::NotSupported,
        "network-missing",
        "the parameter `mask` asks for the network, whose weights this server does not have: leave it away, or say `pruning`",
    )
}

pub(super) fn from_extraction(error: ExtractionError) -> Failure {
    match error {
        ExtractionError::Cancelled => cancelled(),
        ExtractionError::Geometry(error) => from_geometry(error),
        other => Failure::unusable(
            "no-brain-found",
            format!("{other}; supply a mask of the brain as the part `mask` of the upload"),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preparation_that_is_cancelled_waits_no_longer_for_its_turn() {
        let extractor = Extractor::default();
        let _busy = extractor.turn.lock().unwrap();
        let cancelled = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| extractor.await_turn(&cancelled).map(drop));
            std::thread::sleep(2 * LOOK_EVERY);
            assert!(!waiting.is_finished());
            cancelled.store(true, Ordering::Relaxed);
            assert_eq!(waiting.join().unwrap().unwrap_err().name, "cancelled");
        });
    }

    #[test]
    fn a_file_that_is_no_network_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"a fruit").unwrap();
        let error = Extractor::open(Some(file.path())).unwrap_err().to_string();
        assert!(error.contains("weights"), "{error}");
        let nowhere = Extractor::open(Some(Path::new("/nowhere/weights"))).unwrap_err();
        assert!(matches!(nowhere, NoNetwork::Unreadable { .. }));
    }
}
