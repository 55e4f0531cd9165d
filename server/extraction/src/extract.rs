//! Both extraction methods behind one function.

use geometry::Volume;

use crate::axes::with_other_axes;
use crate::methods::{Extraction, predict, pruned};
use crate::quality::Because;
use crate::rating::Rating;
use crate::{ExtractionError, Network, Observe};

/// The fraction of the work for the first method; the second is rarely needed.
const FIRST_SHARE: f32 = 0.9;

/// If the two passes agree less than this and the shape of the mask does not match the axes, other axes are tried.
const DOUBTFUL_AGREEMENT: f64 = 0.95;

/// Finds the brain in a T1-weighted head, in any orientation and at any spacing.
///
/// With a network, the brain is where the probability exceeds `threshold` (0.5 is the surface of the training; less
/// makes the brain larger). Without a network, or if its result is [`Rating::Failed`] and pruning does better,
/// [`prune`](crate::prune) is used. `observe` receives the finished fraction several times a second and can stop the work. The result
/// is byte-identical for any number of threads.
///
/// If the network is uncertain and the shape of its result does not match the axes of the volume, the 23 other axes
/// without mirroring are tried. If the network finds a brain with one of them, that brain is returned, placed by the
/// header of the volume, and [`Quality::other_patient_from_voxel`](crate::Quality::other_patient_from_voxel) contains the corrected affine.
///
/// A result rated [`Rating::Failed`] is returned too; the caller must report it.
///
/// # Errors
/// If nothing in the volume can be a brain, or if `observe` stops the work.
pub fn extract(
    volume: &Volume,
    network: Option<&Network>,
    threshold: f32,
    observe: Observe<'_>,
) -> Result<Extraction, ExtractionError> {
    let Some(network) = network else {
        return pruned(volume, Because::NoNetwork, observe);
    };
    let first = predict(volume, network, threshold, &|done| {
        observe(FIRST_SHARE * done)
    });
    if let Ok(found) = &first
        && found.quality.agreement.unwrap_or_default() < DOUBTFUL_AGREEMENT
        && found.quality.doubts_axes()
    {
        let tell = |_: f32| observe(FIRST_SHARE);
        if let Some(other) = with_other_axes(volume, network, threshold, &tell)? {
            return Ok(other);
        }
    }
    let is_in_doubt = match &first {
        Ok(found) => found.quality.rating == Rating::Failed,
        Err(error) => *error != ExtractionError::Cancelled,
    };
    if !is_in_doubt {
        return first;
    }
    let second = pruned(volume, Because::NetworkFailed, &|done| {
        observe(FIRST_SHARE + (1.0 - FIRST_SHARE) * done)
    });
    match (first, second) {
        (_, Err(ExtractionError::Cancelled)) => Err(ExtractionError::Cancelled),
        (first, Ok(second)) if second.quality.rating < Rating::Failed || first.is_err() => {
            Ok(second)
        }
        (first, _) => first,
    }
}
