//! Heads for tests: synthetic ones, and real ones if they are available.

use std::path::PathBuf;

use bytes::Bytes;
use geometry::phantom::{PhantomHead, head};
use geometry::{Mask, Volume};

use crate::Source;

/// A coarse phantom head: quick to prepare, with all its parts.
pub fn phantom() -> PhantomHead {
    head(4.0)
}

/// A volume as a file.
pub fn nifti(volume: &Volume) -> Bytes {
    imaging::nifti::write_volume(volume).unwrap().into()
}

/// A mask as a file.
pub fn nifti_mask(mask: &Mask) -> Bytes {
    imaging::nifti::write_mask(mask).unwrap().into()
}

/// The upload of a head with its mask.
pub fn upload(head: &PhantomHead) -> Source {
    Source {
        volume: nifti(&head.volume),
        mask: Some(nifti_mask(&head.brain)),
        ..Source::default()
    }
}

/// A volume with everything outside of a mask on the same grid set to 0.
pub fn stripped(volume: &Volume, mask: &Mask) -> Volume {
    let kept = volume.voxels().iter().zip(mask.voxels());
    let voxels = kept.map(|(&voxel, &keep)| if keep { voxel } else { 0 });
    Volume::new(volume.grid().clone(), voxels.collect(), volume.rescale()).unwrap()
}

/// The folder of real heads from the variable `ISOCORTEX_TEST_DATA`. Reports if there is none.
pub fn real_heads() -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("ISOCORTEX_TEST_DATA").map_or(beside, PathBuf::from);
    if folder.join("colin27").is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no real heads; set ISOCORTEX_TEST_DATA to their folder");
    None
}
