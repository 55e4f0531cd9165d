//! Phantoms whose parts are known, and real heads.

use geometry::{BrainMask, DepthField, Grid, Mask, Volume, cut_envelope, distance_map};
use glam::{DAffine3, DQuat, DVec3};

use super::phantom::{BrainPhantom, grid};
use super::{Region, RegionDoubt, Regions, TISSUE_FROM, regions};
use crate::phantom::{Scan, mirrored};
use crate::tissue::tissue_of;

pub(super) fn of(scan: &Scan) -> Regions {
    let (block, values, _) = tissue_of(scan.head()).expect("a tissue scale");
    regions(scan.head(), &block, &values, None)
}

/// The Dice coefficient of the voxels of some regions with those of the phantom.
fn dice(phantom: &BrainPhantom, found: &Regions, wanted: &[Region]) -> f64 {
    let own_from_voxel = phantom.placed.inverse() * found.grid().patient_from_voxel();
    let (mut both, mut total) = (0u32, 0u32);
    for (index, &code) in found.codes().iter().enumerate() {
        let voxel = DVec3::from_array(found.grid().voxel(index).map(|along| along as f64));
        let Some((truth, value)) = phantom.at(own_from_voxel.transform_point3(voxel)) else {
            continue;
        };
        // Fluid belongs to nobody.
        if value < -0.8 {
            continue;
        }
        let is_true = wanted.contains(&truth);
        let found = Region::from_code(code).map(part);
        let is_found = found.is_some_and(|region| wanted.contains(&region));
        both += u32::from(is_true && is_found);
        total += u32::from(is_true) + u32::from(is_found);
    }
    2.0 * f64::from(both) / f64::from(total)
}

const CEREBRUM: [Region; 2] = [Region::LeftCerebrum, Region::RightCerebrum];
const REMOVED: [Region; 2] = [Region::Cerebellum, Region::BrainStem];

fn check(phantom: &BrainPhantom) {
    let found = of(&phantom.scan(&grid()));
    println!("{:.3?}", found.numbers);
    assert_eq!(found.doubts, [], "{:?}", found.numbers);
    let whole = [
        dice(phantom, &found, &CEREBRUM),
        dice(phantom, &found, &REMOVED),
    ];
    let parts = [CEREBRUM, REMOVED]
        .concat()
        .iter()
        .map(|&region| dice(phantom, &found, &[region]))
        .collect::<Vec<f64>>();
    println!("{whole:.4?} {parts:.4?}");
    assert!(whole.iter().all(|dice| *dice >= 0.98), "{whole:?}");
    assert!(parts[..3].iter().all(|dice| *dice >= 0.98), "{parts:?}");
    // The peduncles have no border to the stem.
    assert!(parts[3] >= 0.80, "{parts:?}");
}

#[test]
fn the_parts_of_a_phantom_are_found() {
    check(&BrainPhantom::PLAIN);
}

/// The share of the voxels of one brain that count whose region is that of the voxel at the same place of another, which is placed
/// by `moved`; `as_seen` is what a region becomes there.
fn agreement(
    one: (&Regions, impl Fn(usize) -> bool),
    other: &Regions,
    moved: DAffine3,
    as_seen: impl Fn(Region) -> Region,
) -> f64 {
    let (one, counts) = one;
    let (mut same, mut count) = (0u32, 0u32);
    for (index, &code) in one.codes().iter().enumerate() {
        let Some(region) = Region::from_code(code).filter(|_| counts(index)) else {
            continue;
        };
        let voxel = DVec3::from_array(one.grid().voxel(index).map(|along| along as f64));
        let place = moved.transform_point3(one.grid().patient_from_voxel().transform_point3(voxel));
        if let Some(there) = other.at(place) {
            count += 1;
            same += u32::from(part(there) == part(as_seen(region)));
        }
    }
    f64::from(same) / f64::from(count)
}

/// The part of the brain of a region: what is left out of the cerebrum belongs to it.
fn part(region: Region) -> Region {
    match region {
        Region::LeftDeep => Region::LeftCerebrum,
        Region::RightDeep => Region::RightCerebrum,
        other => other,
    }
}

fn mirrored_region(region: Region) -> Region {
    match region {
        Region::LeftCerebrum => Region::RightCerebrum,
        Region::RightCerebrum => Region::LeftCerebrum,
        Region::LeftDeep => Region::RightDeep,
        Region::RightDeep => Region::LeftDeep,
        other => other,
    }
}

/// Turned about all three axes, and moved.
pub(super) fn turned(degrees: [f64; 3]) -> DAffine3 {
    let [x, y, z] = degrees.map(f64::to_radians);
    let turn = DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
    DAffine3::from_rotation_translation(turn, DVec3::new(3.3, -5.4, 2.7))
}

#[test]
fn the_parts_turn_and_mirror_with_a_phantom_that_is_sampled_again() {
    let plain = of(&BrainPhantom::PLAIN.scan(&grid()));
    let around = grid().block([-25, -10, -25], [200, 210, 200]).unwrap();
    for (moved, is_mirrored) in [
        (turned([12.0, 0.0, 0.0]), false),
        (turned([-6.0, 7.0, -8.0]), false),
        (mirrored(), true),
    ] {
        let phantom = BrainPhantom {
            placed: moved * BrainPhantom::PLAIN.placed,
            ..BrainPhantom::PLAIN
        };
        let found = of(&phantom.scan(&around));
        assert_eq!(found.doubts, []);
        let as_seen = |region| {
            if is_mirrored {
                mirrored_region(region)
            } else {
                region
            }
        };
        let same = agreement((&plain, |_| true), &found, moved, as_seen);
        println!("{same:.5}");
        // Other noise, and voxels between the others: a third of a voxel along every border.
        assert!(same >= 0.995, "{same}");
    }
}

/// The same voxels with another affine.
fn placed(volume: &Volume, mask: &Mask, moved: DAffine3) -> Scan {
    let at = |grid: &Grid| Grid::new(grid.size(), moved * grid.patient_from_voxel()).unwrap();
    let there = Volume::new(
        at(volume.grid()),
        volume.voxels().to_vec(),
        volume.rescale(),
    )
    .unwrap();
    Scan::new(
        there,
        &Mask::new(at(mask.grid()), mask.voxels().to_vec()).unwrap(),
    )
}

#[test]
fn the_parts_turn_and_mirror_with_the_voxels() {
    let (volume, mask) = BrainPhantom::PLAIN.head(&grid());
    let kept = check_moved(&volume, &mask);
    assert!(kept.iter().all(|kept| kept.all >= 0.999), "{kept:?}");
}

/// The shares of voxels that keep their part in a turned or mirrored head.
#[derive(Debug)]
pub(super) struct Kept {
    /// Of all voxels.
    pub(super) all: f64,
    /// Of those that are tissue: in fluid there is no border to be found.
    pub(super) tissue: f64,
    /// Of those that lie farther than [`NEAR`] from every border between parts.
    pub(super) far: f64,
}

/// How far from a border a voxel is near it, in voxels along each axis.
const NEAR: usize = 2;

/// Compares a head with itself, turned twice and mirrored.
pub(super) fn check_moved(volume: &Volume, mask: &Mask) -> Vec<Kept> {
    let scan = placed(volume, mask, DAffine3::IDENTITY);
    let plain = of(&scan);
    assert_eq!(plain.doubts, []);
    let (_, values, _) = tissue_of(scan.head()).expect("a tissue scale");
    let is_near = near_borders(&plain);
    let moves = [
        (turned([25.0, 0.0, 0.0]), false),
        (turned([-9.0, 6.0, 14.0]), false),
        (mirrored(), true),
    ];
    let kept = moves.map(|(moved, is_mirrored)| {
        let found = of(&placed(volume, mask, moved));
        assert_eq!(found.doubts, []);
        let as_seen = |region| {
            if is_mirrored {
                mirrored_region(region)
            } else {
                region
            }
        };
        let share =
            |counts: &dyn Fn(usize) -> bool| agreement((&plain, counts), &found, moved, as_seen);
        Kept {
            all: share(&|_| true),
            tissue: share(&|index| values[index] >= TISSUE_FROM),
            far: share(&|index| !is_near[index]),
        }
    });
    println!("{kept:.5?}");
    kept.into()
}

/// The voxels around which there is more than one part of the brain.
fn near_borders(regions: &Regions) -> Vec<bool> {
    let [nx, ny, nz] = regions.grid().size();
    // A bit for each part.
    let of_code = |&code: &u8| Region::from_code(code).map_or(0, |region| 1 << part(region) as u8);
    let mut around: Vec<u8> = regions.codes().iter().map(of_code).collect();
    for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        let before = around.clone();
        for (index, parts) in around.iter_mut().enumerate() {
            let place = index / stride % side;
            let first = index - place.min(NEAR) * stride;
            let last = index + (side - 1 - place).min(NEAR) * stride;
            let beside = (first..=last).step_by(stride);
            *parts = beside.fold(0, |parts, index| parts | before[index]);
        }
    }
    around.iter().map(|parts| parts.count_ones() > 1).collect()
}

#[test]
fn a_head_turned_by_thirty_degrees_is_divided_right_and_hydrocephalus_and_a_mass_are_or_are_doubted()
 {
    let widened = |half_axes_mm: [f64; 3]| BrainPhantom {
        ventricles_mm: DVec3::from_array(half_axes_mm),
        ..BrainPhantom::PLAIN
    };
    let mass = BrainPhantom {
        mass: Some((DVec3::new(38.0, 30.0, 20.0), 24.0)),
        ..BrainPhantom::PLAIN
    };
    let pitched = BrainPhantom {
        placed: turned([30.0, 0.0, 0.0]) * BrainPhantom::PLAIN.placed,
        ..BrainPhantom::PLAIN
    };
    let around = grid().block([-10, -10, -25], [170, 210, 200]).unwrap();
    for (phantom, may_doubt) in [
        (mass, true),
        (pitched, false),
        (widened([11.0, 45.0, 16.0]), false),
        (widened([20.0, 52.0, 24.0]), true),
    ] {
        let found = of(&phantom.scan(&around));
        let whole = [
            dice(&phantom, &found, &CEREBRUM),
            dice(&phantom, &found, &REMOVED),
        ];
        println!("{whole:.4?} {:.3?} {:?}", found.numbers, found.doubts);
        let is_right = found.doubts.is_empty() && whole.iter().all(|dice| *dice >= 0.98);
        let is_doubted = !found.doubts.is_empty() && nothing_is_taken_off(&found);
        assert!(
            is_right || (may_doubt && is_doubted),
            "{whole:?} {:?}",
            found.doubts
        );
    }
}

/// What a doubtful brain is: all cerebrum.
fn nothing_is_taken_off(found: &Regions) -> bool {
    found
        .codes()
        .iter()
        .all(|&code| code <= Region::RightCerebrum as u8)
}

#[test]
fn half_a_brain_is_doubted_and_nothing_is_taken_off() {
    let phantom = BrainPhantom {
        has_right_half: false,
        ..BrainPhantom::PLAIN
    };
    let found = of(&phantom.scan(&grid()));
    println!("{:.3?} {:?}", found.numbers, found.doubts);
    assert!(is_called_half(&found));
    assert!(nothing_is_taken_off(&found));
}

/// Whether the first doubt is that a hemisphere is missing.
fn is_called_half(found: &Regions) -> bool {
    let first = found.doubts.first();
    matches!(first, Some(RegionDoubt::OneHemisphere { width }) if *width < 0.5)
}

#[test]
fn a_brain_without_a_fissure_is_doubted() {
    let phantom = BrainPhantom {
        fissure_mm: -20.0,
        ..BrainPhantom::PLAIN
    };
    let found = of(&phantom.scan(&grid()));
    println!("{:.3?} {:?}", found.numbers, found.doubts);
    assert!(
        found
            .doubts
            .iter()
            .any(|doubt| doubt.code() == "no-fissure"),
        "{:?}",
        found.doubts
    );
    assert!(nothing_is_taken_off(&found));
}

#[test]
fn a_volume_that_ends_within_the_cerebellum_is_doubted() {
    let whole = grid();
    for lost in [25, 32, 45] {
        let size = whole.size();
        let cut = whole
            .block([0, 0, lost], [size[0], size[1], size[2] - lost as usize])
            .unwrap();
        let (scan, _) = cut_scan(&BrainPhantom::PLAIN, &cut);
        let found = of(&scan);
        println!("{lost}: {:.3?} {:?}", found.numbers, found.doubts);
        assert!(
            !found.doubts.is_empty() && nothing_is_taken_off(&found),
            "{lost}"
        );
    }
}

/// Whether the regions of a scan are doubted and nothing is taken off, or else right.
fn is_right_or_doubted(phantom: &BrainPhantom, found: &Regions) -> bool {
    let whole = [
        dice(phantom, found, &CEREBRUM),
        dice(phantom, found, &REMOVED),
    ];
    println!("{whole:.4?} {:.3?} {:?}", found.numbers, found.doubts);
    let is_right = found.doubts.is_empty() && whole.iter().all(|dice| *dice >= 0.98);
    is_right || (!found.doubts.is_empty() && nothing_is_taken_off(found))
}

#[test]
fn thick_slices_are_doubted_and_have_no_maps() {
    let size = grid().size();
    for (axis, spacing_mm) in [(0, [5.0, 1.0, 1.0]), (2, [1.0, 1.0, 5.0])] {
        let mut fewer = size;
        fewer[axis] /= 5;
        let voxel = DVec3::splat(0.5) * (DVec3::from_array(spacing_mm) - 1.0);
        let origin = grid().patient_from_voxel().transform_point3(voxel);
        let thick = Grid::aligned(fewer, spacing_mm, origin).unwrap();
        let scan = BrainPhantom::PLAIN.scan(&thick);
        let block = crate::block::Block::new(&scan.volume, &scan.depth).unwrap();
        let values: Vec<f32> = (0..block.voxel_count())
            .map(|index| {
                let voxel = DVec3::from_array(block.grid.voxel(index).map(|along| along as f64));
                let place = block.grid.patient_from_voxel().transform_point3(voxel);
                let own = BrainPhantom::PLAIN.placed.inverse().transform_point3(place);
                BrainPhantom::PLAIN.at(own).map_or(-1.8, |(_, value)| value) as f32
            })
            .collect();
        let found = regions(scan.head(), &block, &values, None);
        assert_eq!(found.doubts[0].code(), "regions-coarse-voxels");
        assert!(nothing_is_taken_off(&found));
        assert_eq!(scan.maps().unwrap_err().code(), "coarse-voxels");
    }
}

/// The envelope of a volume that ends within the brain is closed at the cut, as the pipeline does it.
pub(super) fn cut_scan(phantom: &BrainPhantom, cut: &Grid) -> (Scan, Mask) {
    let (mut scan, mask) = phantom.scan_and_mask(cut);
    let brain = BrainMask::from_mask(&mask, cut).unwrap();
    let envelope = cut_envelope(&brain, 10.0, &brain.cut_by(&scan.volume).cuts).unwrap();
    scan.depth = DepthField::new(&distance_map(&envelope));
    (scan, mask)
}

#[test]
fn a_volume_that_is_cut_at_the_vertex_is_divided_right_or_doubted() {
    let size = grid().size();
    for lost in [8, 20, 40] {
        let cut = grid()
            .block([0; 3], [size[0], size[1], size[2] - lost])
            .unwrap();
        let (scan, _) = cut_scan(&BrainPhantom::PLAIN, &cut);
        let found = of(&scan);
        assert!(is_right_or_doubted(&BrainPhantom::PLAIN, &found), "{lost}");
        // What is still whole is not doubted for a finger's breadth.
        assert!(lost > 8 || found.doubts.is_empty(), "{:?}", found.doubts);
    }
}

#[test]
fn a_mask_of_one_side_on_a_whole_head_is_doubted() {
    let (volume, mask) = BrainPhantom::PLAIN.head(&grid());
    for is_wanted in [|x: f64| x > 0.0, |x: f64| x > -6.0, |x: f64| x < 0.0] {
        let mut voxels = mask.voxels().to_vec();
        for (index, is_brain) in voxels.iter_mut().enumerate() {
            let voxel = DVec3::from_array(grid().voxel(index).map(|along| along as f64));
            let place = grid().patient_from_voxel().transform_point3(voxel);
            *is_brain &= is_wanted(place.x);
        }
        let mask = Mask::new(grid(), voxels).unwrap();
        let found = of(&Scan::new(volume.clone(), &mask));
        println!("{:.3?} {:?}", found.numbers, found.doubts);
        assert!(is_called_half(&found) && nothing_is_taken_off(&found));
    }
}

#[test]
fn places_outside_the_cerebrum_are_kept_apart() {
    let maps = BrainPhantom::PLAIN.scan(&grid()).maps().unwrap();
    assert_eq!(maps.regions.doubts, []);
    let is_there = |places: &[crate::Candidate], counts: bool| {
        !places.is_empty() && places.iter().all(|place| place.region.counts() == counts)
    };
    assert!(is_there(&maps.candidates, true), "{:?}", maps.candidates);
    assert!(is_there(&maps.elsewhere, false), "{:?}", maps.elsewhere);
    for place in maps.candidates.iter().chain(&maps.elsewhere) {
        let region = maps.regions.at(place.position_in_patient);
        assert_eq!(region, Some(place.region));
    }
}
