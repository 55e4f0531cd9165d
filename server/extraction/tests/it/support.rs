//! Volumes to try, and what is compared.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use extraction::{Extraction, ExtractionError, Network, Opinion, Rating};
use geometry::{BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::wrong_heads::wrong_heads;

/// Goes on to the end.
pub(crate) fn go_on(_: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The network with the published weights; `None`, said loudly, where they are missing.
pub(crate) fn network() -> Option<&'static Network> {
    static NETWORK: OnceLock<Option<Network>> = OnceLock::new();
    let network = NETWORK.get_or_init(|| {
        let put_by_setup = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../demo-data/deepbet/deepbet-1.0.2-py3-none-any.whl"
        );
        let path = std::env::var_os("ISOCORTEX_NETWORK")
            .map_or_else(|| PathBuf::from(put_by_setup), PathBuf::from);
        let wheel = std::fs::read(path).ok()?;
        Some(Network::from_wheel(&wheel).expect("the wheel of deepbet 1.0.2"))
    });
    if network.is_none() {
        eprintln!(
            "SKIPPED: the network's weights are missing; scripts/network.sh fetches them, or ISOCORTEX_NETWORK names their wheel"
        );
    }
    network.as_ref()
}

/// What the network says of a volume in which it finds this.
pub(crate) fn opinion(found: &Extraction) -> Opinion<'_> {
    match found.is_certain() {
        true => Opinion::Brain(&found.closed),
        false => Opinion::Uncertain,
    }
}

/// A file of the folder with real heads; `None`, said loudly, where it is missing.
pub(crate) fn data(name: &str) -> Option<Vec<u8>> {
    let folder = std::env::var_os("ISOCORTEX_TEST_DATA");
    let bytes = folder.and_then(|folder| std::fs::read(Path::new(&folder).join(name)).ok());
    if bytes.is_none() {
        eprintln!("SKIPPED: {name} is not in the folder that ISOCORTEX_TEST_DATA names");
    }
    bytes
}

/// A head of that folder.
pub(crate) fn head(name: &str) -> Option<Volume> {
    let bytes = data(name)?;
    Some(imaging::nifti::read_volume(&bytes, &imaging::Limits::default()).expect("a volume"))
}

/// Another program's mask of such a head, on the working grid.
pub(crate) fn silver(name: &str, volume: &Volume) -> Option<BrainMask> {
    let bytes = data(name)?;
    let mask = imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a mask");
    Some(BrainMask::from_mask(&mask, volume.grid()).expect("a brain"))
}

/// The Dice coefficient of two sets, on the voxels of the first one's grid.
pub(crate) fn dice(a: &Mask, b: &Mask) -> f64 {
    let b_from_a = b.grid().voxel_from_patient() * a.grid().patient_from_voxel();
    let is_in_b = |index: usize| {
        let place = DVec3::from_array(a.grid().voxel(index).map(|along| along as f64));
        let place = b_from_a.transform_point3(place).round();
        let last = DVec3::from_array(b.grid().size().map(|side| (side - 1) as f64));
        let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmple(last).all();
        is_inside && b.voxels()[b.grid().index(place.to_array().map(|along| along as usize))]
    };
    let marked = (0..a.voxels().len()).filter(|&index| a.voxels()[index]);
    let both = marked.filter(|&index| is_in_b(index)).count() as f64;
    let both_ml = both * a.grid().spacing_mm()[0].powi(3) / 1000.0;
    2.0 * both_ml / (a.volume_ml() + b.volume_ml())
}

/// The stored value of intensity 0, which need not be 0: signed values are stored with an offset.
pub(crate) fn black(volume: &Volume) -> f64 {
    let rescale = volume.rescale();
    let stored = -f64::from(rescale.intercept) / f64::from(rescale.slope);
    stored.round().clamp(0.0, 65535.0)
}

/// The same volume on another grid, trilinear; intensity 0 outside of it.
pub(crate) fn resampled(volume: &Volume, grid: &Grid) -> Volume {
    let there_from_here = volume.grid().voxel_from_patient() * grid.patient_from_voxel();
    let black = black(volume) as f32;
    let at = |index: usize| {
        let place = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let place = there_from_here.transform_point3(place).as_vec3();
        volume.sample(place).unwrap_or(black).round() as u16
    };
    let voxels = (0..grid.voxel_count()).map(at).collect();
    Volume::new(grid.clone(), voxels, volume.rescale()).expect("one value for each voxel")
}

/// The same voxels in another order, with the affine that is true for it: axis `i` becomes axis `order[i]`, backwards where
/// `signs` has bit `i`.
pub(crate) fn reordered(volume: &Volume, order: [usize; 3], signs: usize) -> Volume {
    let size = volume.grid().size();
    let mut there_from_here = DAffine3::from_mat3(DMat3::ZERO);
    for axis in 0..3 {
        let is_backwards = signs >> axis & 1 == 1;
        there_from_here.matrix3.col_mut(axis)[order[axis]] = if is_backwards { -1.0 } else { 1.0 };
        if is_backwards {
            there_from_here.translation[order[axis]] = (size[order[axis]] - 1) as f64;
        }
    }
    let affine = volume.grid().patient_from_voxel() * there_from_here;
    let grid = Grid::new(order.map(|axis| size[axis]), affine).expect("a grid");
    let at = |index: usize| {
        let place = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let place = there_from_here.transform_point3(place).round();
        volume.voxels()[volume
            .grid()
            .index(place.to_array().map(|along| along as usize))]
    };
    let voxels = (0..grid.voxel_count()).map(at).collect();
    Volume::new(grid, voxels, volume.rescale()).expect("the same voxels")
}

/// Checks that none of [`wrong_heads`] ends as ok, or without a reason.
pub(crate) fn none_ends_as_ok(find: impl Fn(&Volume) -> Result<Extraction, ExtractionError>) {
    for (name, volume) in wrong_heads() {
        match find(&volume) {
            Ok(found) => {
                let quality = found.quality;
                println!(
                    "{name}: {:?} {:?} {:?}",
                    found.method, quality.rating, quality.reasons
                );
                assert!(quality.rating > Rating::Ok, "{name}");
                assert!(!quality.reasons.is_empty(), "{name}");
            }
            Err(error) => assert!(
                matches!(error, ExtractionError::NoBrain { .. }),
                "{name}: {error}"
            ),
        }
    }
}
