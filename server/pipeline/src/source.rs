//! What was uploaded, and its volume.

use bytes::Bytes;
use case::{Failure, Quality};
use geometry::Volume;

use crate::Limits;
use crate::failure::from_imaging;

/// The greatest magnitude of an intensity, and the greatest width of a window: those of a picture's window.
const MOST_INTENSITY: f64 = 1e9;

/// The least difference between the darkest and the brightest voxel. A window's centre and width are counted from 0.5 and from 1, as
/// DICOM has it, so that double precision has no more than seven digits left of this.
const LEAST_RANGE: f64 = 1e-9;

/// What was uploaded.
#[derive(Debug, Clone, Default)]
pub struct Source {
    /// The volume, as it came.
    pub volume: Bytes,
    /// The mask of the brain, as it came; `None` where none was supplied.
    pub mask: Option<Bytes>,
    /// Whose head it is, as JSON of [`Attributes`](imaging::dicom::Attributes), where the volume was made of DICOM files.
    pub dicom: Option<Bytes>,
    /// The brain as it was extracted before: a case that is made again keeps it.
    pub brain: Option<StoredBrain>,
}

/// An extracted brain, as it is stored.
#[derive(Debug, Clone)]
pub struct StoredBrain {
    /// The payload of [`ObjectKind::Mask`](case::ObjectKind::Mask).
    pub mask: Bytes,
    /// What was found out about it.
    pub quality: Quality,
}

/// The volume of an upload, whole, as it was acquired.
///
/// # Errors
/// A [`Failure`] that names what is wrong with it.
pub fn read_volume(source: &Source, limits: &Limits) -> Result<Volume, Failure> {
    imaging::nifti::read_volume(&source.volume, limits).map_err(from_imaging)
}

/// The volume of an upload, whose intensities can be shown.
pub(super) fn read_sound_volume(source: &Source, limits: &Limits) -> Result<Volume, Failure> {
    let volume = read_volume(source, limits)?;
    check_intensities(&volume)?;
    Ok(volume)
}

/// Whether the intensities differ, and a window can tell them apart.
pub(super) fn check_intensities(volume: &Volume) -> Result<(), Failure> {
    let [least, greatest] = volume.intensity_range().map(f64::from);
    if least >= greatest {
        let detail = format!(
            "every voxel around the brain has the intensity {least}; there is nothing to show"
        );
        return Err(Failure::unusable("volume-constant", detail));
    }
    let is_within = least >= -MOST_INTENSITY && greatest <= MOST_INTENSITY;
    let range = greatest - least;
    // The window of a ramp is wider by 1.
    if is_within && range >= LEAST_RANGE && range + 1.0 <= MOST_INTENSITY {
        return Ok(());
    }
    let detail = format!(
        "the intensities run from {least:e} to {greatest:e}; they must lie within -1e9 to 1e9 and differ by 1e-9 to 1e9, or no window \
         shows them: scale the volume"
    );
    Err(Failure::unusable("intensity-range", detail))
}
