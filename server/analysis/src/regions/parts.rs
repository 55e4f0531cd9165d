//! The cerebrum, the cerebellum and the brain stem on the lattice, by a watershed.

use geometry::flood;
use glam::{DVec2, DVec3};

use super::lattice::{CELL_ML, Lattice, STEP_MM};

/// The marks of the cells.
pub(super) const OPEN: u8 = 0;
pub(super) const CEREBRUM: u8 = 1;
pub(super) const CEREBELLUM: u8 = 2;
pub(super) const STEM: u8 = 3;
pub(super) const OUTSIDE: u8 = 255;
/// A cell of the fence between brain stem and cerebrum, while they are flooded.
const FENCE: u8 = 254;

/// The tissue scale from which a cell is white matter, which seeds are.
const WHITE_FROM: f32 = 0.6;
/// The tissue scale from which a cell is tissue, where the width of the stem is measured.
const TISSUE_FROM: f32 = 0.35;

// All lengths below are in mm of a head of usual size, along its axes. They were read off six heads, on which the places
// differ by less than half of the radii.

/// Everything above this is cerebrum, and everything in front of that.
const CEREBRUM_ABOVE_MM: f64 = 8.0;
const CEREBRUM_BEFORE_MM: f64 = 25.0;
const CEREBRUM_FROM_DEPTH_MM: f32 = 4.0;
/// The middle of the white matter of the left half of the cerebellum, and the radius of its seeds.
const CEREBELLUM_MM: DVec3 = DVec3::new(20.0, -45.0, -38.0);
const CEREBELLUM_RADIUS_MM: f64 = 12.0;
/// The midbrain, where the axis of the stem begins, and the direction in which it goes down, both (y, z).
const MIDBRAIN_MM: DVec2 = DVec2::new(-8.0, -16.0);
const DOWNWARDS: DVec2 = DVec2::new(-0.44, -0.898);
/// The radius around the axis in which the width of the stem is measured, and which the fence closes.
const STEM_REACH_MM: f64 = 20.0;
/// Where the narrowest place of the stem may be, along its axis, and half the thickness of a level.
const NECK_MM: [i32; 2] = [-4, 12];
const LEVEL_MM: f64 = 2.0;
/// Half the thickness of the fence.
const FENCE_MM: f64 = 1.6;
/// From the neck to the seeds of the midbrain above it, and of the pons and the medulla below it; and their radii.
const SEEDS_ABOVE_MM: [f64; 2] = [-18.0, -6.0];
const SEEDS_BELOW_MM: [f64; 2] = [7.0, 45.0];
const ABOVE_RADIUS_MM: f64 = 18.0;
const BELOW_RADIUS_MM: f64 = 7.0;
/// How far below the neck the pons is widest.
const PONS_MM: [i32; 2] = [8, 22];

/// Levels of the flood: the darker, the higher.
const LEVELS_A_UNIT: f32 = 50.0;
const MOST_LEVEL: f32 = 200.0;

/// The level of a tissue scale in a flood: white matter is lowest, fluid highest.
pub(super) fn level(value: f32) -> u16 {
    ((1.0 - value) * LEVELS_A_UNIT).clamp(0.0, MOST_LEVEL) as u16
}

/// The parts of a brain on the lattice.
#[derive(Debug, Clone)]
pub(super) struct Parts {
    /// The part of each cell, [`OUTSIDE`] outside the envelope.
    pub(super) marks: Vec<u8>,
    /// The volume of the seeds of the left and right cerebrum, of the left and right cerebellum, and of the stem, in ml.
    pub(super) seeds_ml: [f64; 5],
    /// The cross-section of the stem where it is narrowest and where the pons is widest, in cm².
    pub(super) neck_cm2: f64,
    pub(super) pons_cm2: f64,
}

/// A place beside the axis of the stem.
struct BesideStem {
    /// Along the axis, downwards.
    along_mm: f64,
    from_axis_mm: f64,
}

impl BesideStem {
    fn of(place: DVec3) -> Self {
        let from_midbrain = DVec2::new(place.y, place.z) - MIDBRAIN_MM;
        let along_mm = from_midbrain.dot(DOWNWARDS);
        let beside = from_midbrain - DOWNWARDS * along_mm;
        Self {
            along_mm,
            from_axis_mm: beside.length().hypot(place.x),
        }
    }
}

/// Divides a brain: seeds of white matter, a fence across the brain stem where it is narrowest, and a watershed along the
/// dark tentorium.
pub(super) fn parts(lattice: &Lattice) -> Parts {
    let [narrowest, neck_cm2, pons_cm2] = neck(lattice);
    let mut marks = Vec::with_capacity(lattice.values.len());
    let mut seeds = Vec::new();
    let mut fence = Vec::new();
    let mut seeds_ml = [0.0; 5];
    for (index, (&value, &depth)) in lattice.values.iter().zip(&lattice.depths).enumerate() {
        if depth < 0.0 {
            marks.push(OUTSIDE);
            continue;
        }
        let place = lattice.usual_position(index);
        let stem = BesideStem::of(place);
        let from_neck = stem.along_mm - narrowest;
        let is_fence = from_neck.abs() < FENCE_MM && stem.from_axis_mm < STEM_REACH_MM;
        let mark = match seed(value, depth, place, (from_neck, stem.from_axis_mm)) {
            _ if is_fence => FENCE,
            Some(mark) => mark,
            None => OPEN,
        };
        let on_right = usize::from(place.x < 0.0);
        match mark {
            FENCE => fence.push(index),
            CEREBRUM => seeds_ml[on_right] += CELL_ML,
            CEREBELLUM => seeds_ml[2 + on_right] += CELL_ML,
            STEM => seeds_ml[4] += CELL_ML,
            _ => {}
        }
        if !matches!(mark, FENCE | OPEN) {
            seeds.push(index as u32);
        }
        marks.push(mark);
    }
    let level = |index: usize| level(lattice.values[index]);
    let order = flood(lattice.size, level, (&mut marks, OPEN), seeds, |mark, _| {
        mark
    });
    for cell in fence {
        marks[cell] = OPEN;
    }
    flood(lattice.size, level, (&mut marks, OPEN), order, |mark, _| {
        mark
    });
    // What no seed reaches: pieces beside the brain.
    for mark in &mut marks {
        if *mark == OPEN {
            *mark = OUTSIDE;
        }
    }
    Parts {
        marks,
        seeds_ml,
        neck_cm2,
        pons_cm2,
    }
}

/// The part of which a cell is a seed.
fn seed(value: f32, depth_mm: f32, place: DVec3, (from_neck, from_axis): (f64, f64)) -> Option<u8> {
    if value < WHITE_FROM {
        return None;
    }
    let is_high = place.z > CEREBRUM_ABOVE_MM || place.y > CEREBRUM_BEFORE_MM;
    let within = |[from, to]: [f64; 2]| (from..to).contains(&from_neck);
    if is_high && depth_mm > CEREBRUM_FROM_DEPTH_MM {
        return Some(CEREBRUM);
    }
    if within(SEEDS_ABOVE_MM) && from_axis < ABOVE_RADIUS_MM {
        return Some(CEREBRUM);
    }
    if within(SEEDS_BELOW_MM) && from_axis < BELOW_RADIUS_MM {
        return Some(STEM);
    }
    let from_middle = DVec3::new(place.x.abs(), place.y, place.z) - CEREBELLUM_MM;
    (from_middle.length() < CEREBELLUM_RADIUS_MM).then_some(CEREBELLUM)
}

/// Where the stem is narrowest along its axis, in mm of a usual head; its cross-section there, and that of the pons, in
/// cm².
fn neck(lattice: &Lattice) -> [f64; 3] {
    let first = NECK_MM[0];
    let count = (NECK_MM[1] + PONS_MM[1] - first) as usize + 1;
    let mut areas = vec![0.0; count];
    // The volume of a cell over the thickness of a level, in cm².
    let cell_cm2 = STEP_MM.powi(3) / (2.0 * LEVEL_MM * lattice.scale) / 100.0;
    for (index, &value) in lattice.values.iter().enumerate() {
        if value < TISSUE_FROM {
            continue;
        }
        let stem = BesideStem::of(lattice.usual_position(index));
        if stem.from_axis_mm > STEM_REACH_MM {
            continue;
        }
        let from = (stem.along_mm - LEVEL_MM).ceil() as i32 - first;
        let to = (stem.along_mm + LEVEL_MM).floor() as i32 - first;
        for level in from.max(0)..=to.min(count as i32 - 1) {
            areas[level as usize] += cell_cm2;
        }
    }
    let at = |level: i32| areas[(level - first) as usize];
    let narrowest = (NECK_MM[0]..=NECK_MM[1]).min_by(|&a, &b| at(a).total_cmp(&at(b)));
    let narrowest = narrowest.expect("there are levels");
    let pons = (narrowest + PONS_MM[0]..=narrowest + PONS_MM[1]).map(at);
    [
        f64::from(narrowest),
        at(narrowest),
        pons.fold(0.0, f64::max),
    ]
}
