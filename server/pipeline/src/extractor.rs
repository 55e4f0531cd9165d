//! Extracts brains, one at a time.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::Duration;

use extraction::{Extraction, ExtractionError, Method, Network, closed, predict, prune};
use geometry::{DistanceMap, Grid, Volume};
use imaging::nifti::Replaced;

use super::failure::{cancelled, from_geometry};
use super::voxels::voxel_facts;
use crate::codec::{decode_brain, encode_brain};
use case::{Failure, FailureKind, MaskSource, VoxelFacts};

/// The published file with the weights of the network.
pub const NETWORK_FILE: &str = "deepbet-1.0.2-py3-none-any.whl";

/// The default probability above which a voxel is brain.
const USUAL_THRESHOLD: f32 = 0.5;

/// How many brains are remembered; each takes some ten kilobytes.
const REMEMBERED: usize = 64;

/// How often a waiting preparation checks whether it was cancelled.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Extracts brains with the network, if there is one, or by tree pruning. One at a time, because each extraction uses
/// hundreds of megabytes and every core.
#[derive(Debug, Default)]
pub struct Extractor {
    network: Option<Network>,
    /// The BLAKE3 hash of the file with its weights, in hexadecimal.
    weights: Option<String>,
    /// Held while a brain is extracted.
    turn: Mutex<Memory>,
}

/// What the network found in the last volumes, so that several masks of one head ask it once.
#[derive(Debug, Default)]
struct Memory(VecDeque<(VolumeKey, Option<Vec<u8>>)>);

/// What tells volumes apart.
type VolumeKey = (VoxelFacts, Grid);

fn key_of(volume: &Volume) -> VolumeKey {
    (
        voxel_facts(volume, &Replaced::default()),
        volume.grid().clone(),
    )
}

impl Memory {
    /// The encoded brain of a volume, or `None` in it if the network was not certain; `None` if it was not asked.
    fn recall(&self, key: &VolumeKey) -> Option<&Option<Vec<u8>>> {
        let (_, brain) = self.0.iter().find(|(known, _)| known == key)?;
        Some(brain)
    }

    fn remember(&mut self, key: VolumeKey, found: &Extraction) {
        if self.recall(&key).is_none() {
            self.0.truncate(REMEMBERED - 1);
            let brain = found.is_certain().then(|| encode_brain(&found.brain));
            self.0.push_front((key, brain));
        }
    }
}

/// The reason why the network cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NoNetwork {
    /// The file cannot be read.
    #[error("the network's weights {} cannot be read: {source}; make the file readable, or name another in ISOCORTEX_NETWORK", .path.display())]
    Unreadable {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The file does not contain the weights.
    #[error("the network's weights {} cannot be used: {source}; fetch the file again", .path.display())]
    Unusable {
        path: PathBuf,
        source: ExtractionError,
    },
}

impl Extractor {
    /// With the network from a file, or from [`NETWORK_FILE`] if it came with the program ([`shipped`]); without a network if
    /// there is no such file.
    ///
    /// # Errors
    /// If the named or found file cannot be read or does not contain the weights.
    pub fn open(file: Option<&Path>) -> Result<Self, NoNetwork> {
        let Some(path) = file.map(Path::to_owned).or_else(|| shipped(NETWORK_FILE)) else {
            return Ok(Self::default());
        };
        let wheel = std::fs::read(&path).map_err(|source| NoNetwork::Unreadable {
            path: path.clone(),
            source,
        })?;
        let weights = Some(blake3::hash(&wheel).to_hex().to_string());
        let network = Network::from_wheel(&wheel);
        let network = network.map_err(|source| NoNetwork::Unusable { path, source })?;
        Ok(Self {
            network: Some(network),
            weights,
            turn: Mutex::default(),
        })
    }

    /// Whether there is a network.
    pub fn has_network(&self) -> bool {
        self.network.is_some()
    }

    /// The BLAKE3 hash of the file with the weights of the network, in hexadecimal; `None` without a network.
    pub fn weights_blake3(&self) -> Option<&str> {
        self.weights.as_deref()
    }

    /// A description of the method, for the log.
    pub fn words(&self) -> &'static str {
        match self.network {
            Some(_) => "by the network",
            None => "by tree pruning, because the network's weights are not installed",
        }
    }

    /// Extracts the brain of a volume after waiting for its turn.
    ///
    /// `source` selects the method: [`MaskSource::Network`], [`MaskSource::Pruning`], otherwise the better one.
    /// `threshold` is the probability above which the network counts a voxel as brain. `observe` receives the finished
    /// fraction.
    ///
    /// # Errors
    /// If nothing can be a brain, if the network is requested but missing, or if `cancelled` is set.
    pub(super) fn extract(
        &self,
        volume: &Volume,
        source: MaskSource,
        threshold: f64,
        observe: &dyn Fn(f32),
        is_cancelled: &AtomicBool,
    ) -> Result<Extraction, Failure> {
        let mut turn = self.await_turn(is_cancelled)?;
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
        let found = found.map_err(from_extraction)?;
        if found.method == Method::Network && threshold == USUAL_THRESHOLD {
            turn.remember(key_of(volume), &found);
        }
        Ok(found)
    }

    /// The depth below the envelope of the brain that the network finds, for comparison with a mask that came with the upload, after
    /// waiting for its turn; `None` without a network, and `None` in it if the network is not certain.
    ///
    /// What it found in a volume is remembered.
    ///
    /// # Errors
    /// If it finds nothing, or `cancelled` is set.
    pub(super) fn second_opinion(
        &self,
        volume: &Volume,
        is_cancelled: &AtomicBool,
    ) -> Result<Option<Option<DistanceMap>>, ExtractionError> {
        let Some(network) = &self.network else {
            return Ok(None);
        };
        let key = key_of(volume);
        let turn = self.await_turn(is_cancelled);
        let mut turn = turn.map_err(|_| ExtractionError::Cancelled)?;
        if let Some(known) = turn.recall(&key) {
            let brain = known.as_deref().and_then(decode_brain);
            let closed = brain.map(|brain| closed(&brain, volume)).transpose()?;
            return Ok(Some(closed.map(|(distance, _)| distance)));
        }
        let go_on = |_: f32| {
            if is_cancelled.load(Ordering::Relaxed) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let found = predict(volume, network, USUAL_THRESHOLD, &go_on)?;
        turn.remember(key, &found);
        Ok(Some(found.is_certain().then_some(found.closed)))
    }

    fn await_turn(&self, is_cancelled: &AtomicBool) -> Result<MutexGuard<'_, Memory>, Failure> {
        loop {
            if is_cancelled.load(Ordering::Relaxed) {
                return Err(cancelled());
            }
            match self.turn.try_lock() {
                Ok(turn) => return Ok(turn),
                // A panic leaves nothing half done.
                Err(TryLockError::Poisoned(turn)) => return Ok(turn.into_inner()),
                Err(TryLockError::WouldBlock) => std::thread::sleep(LOOK_EVERY),
            }
        }
    }
}

/// A file that came with the program: beside it, in the folder above, or in `share/isocortex` of that folder, where packages
/// install it.
pub fn shipped(name: &str) -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let beside = program.parent()?;
    let above = beside.parent().unwrap_or(beside);
    let folders = [beside, above, &above.join("share/isocortex")];
    let files = folders.map(|folder| folder.join(name));
    files.into_iter().find(|file| file.is_file())
}

/// The failure of a request for the network without its weights.
pub(super) fn network_missing() -> Failure {
    Failure::new(
        FailureKind::NotSupported,
        "network-missing",
        "`mask=network` needs weights that are not installed; omit it or use `mask=pruning`",
    )
}

pub(super) fn from_extraction(error: ExtractionError) -> Failure {
    match error {
        ExtractionError::Cancelled => cancelled(),
        ExtractionError::Geometry(error) => from_geometry(error),
        other => Failure::unusable(
            "no-brain-found",
            format!("{other}; upload a brain mask as the part `mask`"),
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
    fn what_the_network_found_is_remembered_for_the_last_volumes() {
        let volume = geometry::phantom::head(4.0).volume;
        let mut found = prune(&volume, &|_| ControlFlow::Continue(())).unwrap();
        let mut memory = Memory::default();
        let key = key_of(&volume);
        assert_eq!(memory.recall(&key), None);
        memory.remember(key.clone(), &found);
        assert_eq!(memory.recall(&key), Some(&None), "it was not certain");

        (found.quality.agreement, found.quality.uncertain) = (Some(0.98), Some(0.01));
        let numbered = |number: usize| {
            let mut other = key.clone();
            other.0.profiles[0][0] ^= 1 + number as u64;
            other
        };
        for number in 0..REMEMBERED {
            memory.remember(numbered(number), &found);
        }
        assert_eq!(memory.recall(&key), None, "it is forgotten");
        let kept = memory.recall(&numbered(0)).unwrap().as_deref().unwrap();
        assert_eq!(decode_brain(kept).unwrap(), found.brain);
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
