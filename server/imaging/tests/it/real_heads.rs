//! Heads from scanners. They are not part of the project; without them, these tests report it and are skipped.

use std::fs;
use std::path::{Path, PathBuf};

use geometry::Volume;
use glam::DVec3;
use imaging::{Format, Limits, nifti, sniff};

/// The folder of real heads, from the variable `ISOCORTEX_TEST_DATA`; reports if there is none.
pub(crate) fn test_data() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("ISOCORTEX_TEST_DATA").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no real heads; set ISOCORTEX_TEST_DATA to their folder");
    None
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let is_nifti = |path: &PathBuf| path.to_string_lossy().ends_with(".nii.gz");
    entries.filter(is_nifti).collect()
}

fn read(path: &Path) -> Volume {
    let bytes = fs::read(path).unwrap();
    nifti::read_volume(&bytes, &Limits::default())
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn all_heads_and_masks_decode() {
    let Some(folder) = test_data() else { return };
    let folders = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let files: Vec<_> = folders
        .filter(|path| path.is_dir())
        .flat_map(|folder| files_in(&folder))
        .collect();
    assert!(files.len() > 60, "only {} files", files.len());
    for path in files {
        let volume = read(&path);
        let bytes = fs::read(&path).unwrap();
        assert_eq!(sniff(&bytes), Format::NiftiGz);
        let mask = nifti::read_mask(&bytes, &Limits::default()).unwrap();
        assert_eq!(mask.grid(), volume.grid());
        let inside = mask.voxels().iter().filter(|&&belongs| belongs).count();
        assert!(inside > 0, "{}", path.display());
    }
}

#[test]
fn the_skull_stripped_colin_is_its_own_mask() {
    let Some(folder) = test_data() else { return };
    let bytes = fs::read(folder.join("colin27/ch2bet.nii.gz")).unwrap();
    let mask = nifti::read_mask(&bytes, &Limits::default()).unwrap();
    let volume = nifti::read_volume(&bytes, &Limits::default()).unwrap();
    let lit = volume.voxels().iter().map(|&stored| stored > 0);
    assert!(lit.eq(mask.voxels().iter().copied()));
    let litres = mask.voxels().iter().filter(|&&belongs| belongs).count() as f64 * 1e-6;
    assert!((1.0..2.5).contains(&litres), "a brain of {litres} l");
}

/// Intensity of the voxel that is nearest to a place of the patient.
fn nearest(volume: &Volume, position: DVec3) -> Option<f32> {
    let grid = volume.grid();
    let voxel = grid.voxel_from_patient().transform_point3(position).round();
    grid.contains(voxel).then(|| {
        let index = grid.index(voxel.to_array().map(|position| position as usize));
        volume.intensity(volume.voxels()[index].into())
    })
}

#[test]
fn a_brain_is_the_same_in_all_48_orders_of_its_axes() {
    let Some(folder) = test_data() else { return };
    let folder = folder.join("orient48");
    let reference = read(&folder.join("RAS.nii.gz"));
    let files = files_in(&folder);
    assert_eq!(files.len(), 48);
    for path in files {
        let volume = read(&path);
        assert_eq!(volume.voxels().len(), reference.voxels().len());
        for index in (0..reference.voxels().len()).step_by(97) {
            let voxel = reference
                .grid()
                .voxel(index)
                .map(|position| position as f64);
            let patient = reference.grid().patient_from_voxel();
            let position = patient.transform_point3(DVec3::from_array(voxel));
            let expected = reference.intensity(reference.voxels()[index].into());
            assert_eq!(
                nearest(&volume, position),
                Some(expected),
                "{}",
                path.display()
            );
        }
    }
}

#[test]
fn another_reader_finds_the_same_colin() {
    let Some(folder) = test_data() else { return };
    let path = folder.join("colin27/ch2.nii.gz");
    let volume = read(&path);
    let theirs = nifti_crate::ReaderOptions::new().read_file(&path).unwrap();
    let raw = nifti_crate::NiftiObject::into_volume(theirs).into_raw_data();
    assert!(
        volume
            .voxels()
            .iter()
            .copied()
            .eq(raw.iter().map(|&byte| u16::from(byte)))
    );
}
