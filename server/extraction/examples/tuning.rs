//! Chooses the lengths of tree pruning on some heads and reports it on others: prints every step, and a table.
//!
//! `cargo run --release --example tuning -- WHEEL CHOSEN_ON… -- REPORTED_ON…`, with volumes as NIfTI. The reference of a
//! head is the brain that the network finds in it. One length after the other is moved to its best value, in rounds,
//! until none moves. A length moves only if the mean Dice coefficient rises by at least 0.0005.

use std::ops::ControlFlow;
use std::path::Path;

use extraction::{Network, PruningParameters, predict, prune_with};
use geometry::{BrainMask, Mask, Volume};
use glam::DVec3;
use imaging::{Limits, nifti};

type Failure = Box<dyn std::error::Error>;

/// The least gain for which a length is moved.
const LEAST_GAIN: f64 = 0.0005;

/// A length, how it is set, and its candidates.
type Choice = (
    &'static str,
    fn(&mut PruningParameters) -> &mut f64,
    &'static [f64],
);

const CHOICES: [Choice; 9] = [
    ("erosion_mm", |p| &mut p.erosion_mm, &[3.0, 4.0, 5.0, 6.0]),
    ("reach_mm", |p| &mut p.reach_mm, &[30.0, 35.0, 40.0, 50.0]),
    ("scalp_mm", |p| &mut p.scalp_mm, &[3.0, 4.0, 5.0, 6.0, 8.0]),
    ("core_mm", |p| &mut p.core_mm, &[20.0, 25.0, 30.0]),
    (
        "head_closing_mm",
        |p| &mut p.head_closing_mm,
        &[4.0, 6.0, 8.0],
    ),
    (
        "white_share",
        |p| &mut p.white_share,
        &[0.6, 0.65, 0.7, 0.75, 0.8],
    ),
    (
        "opening_mm",
        |p| &mut p.opening_mm,
        &[2.0, 2.5, 3.0, 4.0, 5.0],
    ),
    ("closing_mm", |p| &mut p.closing_mm, &[6.0, 8.0, 10.0, 14.0]),
    ("dura_mm", |p| &mut p.dura_mm, &[0.5, 1.0, 1.5, 2.0, 2.5]),
];

struct Head {
    name: String,
    volume: Volume,
    reference: Mask,
}

impl Head {
    fn read(path: &str, network: &Network) -> Result<Self, Failure> {
        let volume = nifti::read_volume(&std::fs::read(path)?, &Limits::default())?;
        let found = predict(&volume, network, 0.5, &go_on)?;
        let parts = Path::new(path).components().rev().take(2);
        let name: Vec<_> = parts
            .map(|part| part.as_os_str().to_string_lossy())
            .collect();
        Ok(Self {
            name: name.join(" of "),
            volume,
            reference: found.brain.mask().clone(),
        })
    }

    /// The Dice coefficient of the pruned brain and the reference, and the volume of the pruned brain in ml.
    fn judge(&self, parameters: &PruningParameters) -> [f64; 2] {
        let found = prune_with(&self.volume, parameters, &go_on).ok();
        let brain = found.and_then(|mask| BrainMask::from_mask(&mask, self.volume.grid()).ok());
        brain.map_or([0.0, 0.0], |brain| {
            [
                dice(brain.mask(), &self.reference),
                brain.mask().volume_ml(),
            ]
        })
    }
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [wheel, heads @ ..] = &arguments[..] else {
        return Err("arguments: WHEEL CHOSEN_ON… -- REPORTED_ON…".into());
    };
    let network = Network::from_wheel(&std::fs::read(wheel)?)?;
    let mut halves = heads.split(|argument| argument == "--").map(|half| {
        let heads = half.iter().map(|path| Head::read(path, &network));
        heads.collect::<Result<Vec<_>, _>>()
    });
    let chosen_on = halves.next().ok_or("no heads to choose on")??;
    let reported_on = halves.next().ok_or("no heads to report on")??;

    let start = PruningParameters::STANDARD;
    let mut best = start;
    let mut score = mean(&chosen_on, &best);
    println!("{score:.4} at the start");
    let mut has_moved = true;
    while has_moved {
        has_moved = false;
        for (name, length, candidates) in CHOICES {
            let before = *length(&mut best);
            for &candidate in candidates.iter().filter(|&&other| other != before) {
                let mut tried = best;
                *length(&mut tried) = candidate;
                let found = mean(&chosen_on, &tried);
                println!("{found:.4} with {name} {candidate}");
                if found >= score + LEAST_GAIN {
                    (best, score, has_moved) = (tried, found, true);
                }
            }
        }
    }
    println!("{best:?}");
    println!("| head | | Dice before | ml | Dice after | ml |\n|---|---|---|---|---|---|");
    for (half, heads) in [("chosen on", &chosen_on), ("reported", &reported_on)] {
        for head in heads {
            let [before, after] = [start, best].map(|parameters| head.judge(&parameters));
            println!(
                "| {} | {half} | {:.4} | {:.0} | {:.4} | {:.0} |",
                head.name, before[0], before[1], after[0], after[1]
            );
        }
        let [before, after] = [start, best].map(|parameters| mean(heads, &parameters));
        println!("| mean | {half} | {before:.4} | | {after:.4} | |");
    }
    Ok(())
}

fn go_on(_: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn mean(heads: &[Head], parameters: &PruningParameters) -> f64 {
    let sum: f64 = heads.iter().map(|head| head.judge(parameters)[0]).sum();
    sum / heads.len() as f64
}

/// The Dice coefficient of two masks, at the voxels of the first.
fn dice(one: &Mask, other: &Mask) -> f64 {
    let (here, there) = (one.grid(), other.grid());
    let there_from_here = there.voxel_from_patient() * here.patient_from_voxel();
    let last = DVec3::from_array(there.size().map(|side| (side - 1) as f64));
    let is_in_other = |index: usize| {
        let place = DVec3::from_array(here.voxel(index).map(|along| along as f64));
        let place = there_from_here.transform_point3(place).round();
        let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmple(last).all();
        is_inside && other.voxels()[there.index(place.to_array().map(|along| along as usize))]
    };
    let marked = (0..one.voxels().len()).filter(|&index| one.voxels()[index]);
    let both = marked.filter(|&index| is_in_other(index)).count() as f64;
    let both_ml = both * here.spacing_mm()[0].powi(3) / 1000.0;
    2.0 * both_ml / (one.volume_ml() + other.volume_ml())
}
