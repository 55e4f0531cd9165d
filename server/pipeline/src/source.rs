//! An upload, and its volume.

use bytes::Bytes;
use case::{CutFacts, Failure, Quality};
use geometry::Volume;
use imaging::nifti::{Form, Replaced};

use crate::Limits;
use crate::failure::from_imaging;

/// The greatest magnitude of an intensity, and the greatest width of a window, as for the window of a picture.
const MOST_INTENSITY: f64 = 1e9;

/// The least difference between the darkest and the brightest voxel. DICOM offsets the centre and width of a window by
/// 0.5 and 1, so that double precision leaves about seven digits of this.
const LEAST_RANGE: f64 = 1e-9;

#[derive(Debug, Clone, Default)]
pub struct Source {
    pub volume: Bytes,
    /// The brain mask, if one was supplied.
    pub mask: Option<Bytes>,
    /// The identifying attributes as JSON of [`Attributes`](imaging::dicom::Attributes), if the volume comes from
    /// DICOM.
    pub dicom: Option<Bytes>,
    /// The brain from an earlier extraction, which a rebuilt case keeps.
    pub brain: Option<StoredBrain>,
}

/// A stored brain that was extracted or rated.
#[derive(Debug, Clone)]
pub struct StoredBrain {
    /// The payload of [`ObjectKind::Mask`](case::ObjectKind::Mask).
    pub mask: Bytes,
    pub quality: Quality,
    /// The faces of the field of view that cut it.
    pub cuts: Vec<CutFacts>,
}

/// The whole acquired volume of an upload.
///
/// # Errors
/// A [`Failure`] that states what is wrong with it.
pub fn read_volume(source: &Source, limits: &Limits) -> Result<Volume, Failure> {
    imaging::nifti::read_volume(&source.volume, limits).map_err(from_imaging)
}

/// A NIfTI file with one of the two forms of its header alone.
///
/// # Errors
/// A [`Failure`] that states what is wrong with it, or that it does not have the form.
pub fn keeping_form(bytes: &[u8], form: Form, limits: &Limits) -> Result<Vec<u8>, Failure> {
    imaging::nifti::keeping_form(bytes, form, limits).map_err(from_imaging)
}

/// The volume of an upload, after a check that its intensities can be shown, and the voxels that were replaced.
pub(super) fn read_sound_volume(
    source: &Source,
    limits: &Limits,
) -> Result<(Volume, Replaced), Failure> {
    let (volume, replaced) =
        imaging::nifti::read_counted(&source.volume, limits).map_err(from_imaging)?;
    check_intensities(&volume)?;
    Ok((volume, replaced))
}

/// Whether the file of the volume or of the mask does not state its axes.
pub(super) fn are_axes_assumed(source: &Source, limits: &Limits) -> Result<bool, Failure> {
    let files = [Some(&source.volume), source.mask.as_ref()];
    for file in files.into_iter().flatten() {
        if imaging::nifti::are_axes_assumed(file, limits).map_err(from_imaging)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Checks that the intensities differ and fit into a window.
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
    // A window is wider than its ramp by 1.
    if is_within && range >= LEAST_RANGE && range + 1.0 <= MOST_INTENSITY {
        return Ok(());
    }
    let detail = format!(
        "the intensities run from {least:e} to {greatest:e}; they must be within -1e9 to 1e9 and differ by 1e-9 to 1e9; scale the \
         volume"
    );
    Err(Failure::unusable("intensity-range", detail))
}
