//! Registrations of a made-up head with itself, as another scan might show it.

use std::sync::LazyLock;

use geometry::{BrainMask, Envelope, Grid, Rescale, Volume, envelope, phantom};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::metric::{BINS, Comparison};
use super::pose::{Motion, Pose};
use super::samples::{Range, Samples};
use super::{Doubt, Image, Pair, Registration, Verdict, register};
use crate::regions::phantom::{BrainPhantom, SimulatedLayer, grid as grid_of_brain};

struct Head {
    volume: Volume,
    envelope: Envelope,
}

static HEAD: LazyLock<Head> = LazyLock::new(|| {
    let head = phantom::head(2.0);
    let brain = BrainMask::from_mask(&head.brain, head.volume.grid()).expect("a brain");
    Head {
        envelope: envelope(&brain, 10.0).expect("a radius within range"),
        volume: head.volume,
    }
});

const PLAIN: Rescale = Rescale {
    slope: 1.0,
    intercept: 0.0,
};

/// A rigid motion.
fn motion(turn: DVec3, shift: DVec3) -> DAffine3 {
    DAffine3::from_translation(shift) * DAffine3::from_quat(DQuat::from_scaled_axis(turn))
}

/// The head on another grid, moved: `truth` carries the layer's positions to the case's.
fn layer(grid: Grid, truth: DAffine3, contrast: impl Fn(f32) -> f32) -> Volume {
    let head_from_voxel =
        HEAD.volume.grid().voxel_from_patient() * truth * grid.patient_from_voxel();
    let value = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        let place = head_from_voxel.transform_point3(voxel).as_vec3();
        HEAD.volume
            .sample(place)
            .map_or(0, |stored| contrast(stored) as u16)
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    Volume::new(grid, voxels, PLAIN).expect("one value for each voxel")
}

/// A grid around the origin with axes that are turned.
fn grid(size: [usize; 3], spacing_mm: DVec3, axes: DMat3) -> Grid {
    let axes = axes * DMat3::from_diagonal(spacing_mm);
    let half = DVec3::from_array(size.map(|side| (side - 1) as f64 / 2.0));
    let affine = DAffine3 {
        matrix3: axes,
        translation: axes * -half,
    };
    Grid::new(size, affine).expect("a grid within range")
}

fn inverted(stored: f32) -> f32 {
    1000.0 - stored
}

/// How far apart two transforms place points 80 mm from the middle, at most.
fn apart_mm(a: DAffine3, b: DAffine3) -> f64 {
    let ends = DVec3::AXES
        .into_iter()
        .flat_map(|axis| [axis * 80.0, axis * -80.0]);
    let distances = ends.map(|end| a.transform_point3(end).distance(b.transform_point3(end)));
    distances.fold(0.0, f64::max)
}

fn registered(layer: &Volume) -> Registration {
    register(&HEAD.volume, &HEAD.envelope, layer)
}

#[test]
fn a_motion_is_found_in_another_contrast_and_on_other_voxels() {
    let truth = motion(DVec3::new(0.2, -0.15, 0.22), DVec3::new(9.0, -12.0, 7.0));
    let axes = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.05, 0.02, -0.04)));
    let layer = layer(
        grid([90, 110, 64], DVec3::new(2.2, 2.0, 3.0), axes),
        truth,
        inverted,
    );
    let found = registered(&layer);
    assert_eq!(found.verdict, Verdict::Registered, "{found:?}");
    assert!(apart_mm(found.case_from_layer, truth) < 0.3, "{found:?}");
    assert!(found.nmi_after > found.nmi_before + 0.05, "{found:?}");
    assert!(
        found.overlap > 0.95 && found.residual_mm.unwrap() < 0.6,
        "{found:?}"
    );
}

#[test]
fn the_order_of_the_voxel_axes_does_not_matter() {
    let truth = motion(DVec3::new(-0.1, 0.1, 0.05), DVec3::new(-4.0, 6.0, 3.0));
    // Slices from back to front, rows that run upwards, from left to right.
    let axes = DMat3::from_cols(DVec3::NEG_X, DVec3::Z, DVec3::NEG_Y);
    let layer = layer(
        grid([96, 90, 44], DVec3::new(2.0, 2.0, 5.0), axes),
        truth,
        |stored| stored,
    );
    let found = registered(&layer);
    assert_eq!(found.verdict, Verdict::Registered, "{found:?}");
    assert!(apart_mm(found.case_from_layer, truth) < 0.6, "{found:?}");
}

#[test]
fn half_of_the_head_is_enough() {
    let truth = motion(DVec3::new(0.1, 0.2, 0.0), DVec3::new(5.0, 5.0, -10.0));
    let half = grid([100, 110, 96], DVec3::splat(2.0), DMat3::IDENTITY)
        .block([50, 0, 0], [50, 110, 96])
        .expect("a part of a grid");
    let found = registered(&layer(half, truth, inverted));
    assert_eq!(found.verdict, Verdict::Registered, "{found:?}");
    assert!(apart_mm(found.case_from_layer, truth) < 0.5, "{found:?}");
    assert!((0.3..0.7).contains(&found.overlap), "{found:?}");
}

#[test]
fn a_layer_that_lies_right_is_left_where_it_is() {
    let same = grid([90, 110, 90], DVec3::splat(2.1), DMat3::IDENTITY);
    let found = registered(&layer(same, DAffine3::IDENTITY, inverted));
    assert_eq!(found.verdict, Verdict::Unchanged, "{found:?}");
    assert_eq!(found.case_from_layer, DAffine3::IDENTITY);
}

#[test]
fn the_same_volumes_give_the_same_bytes() {
    let truth = motion(DVec3::new(0.1, 0.0, 0.1), DVec3::new(3.0, 2.0, 1.0));
    let layer = layer(
        grid([60, 70, 60], DVec3::splat(3.0), DMat3::IDENTITY),
        truth,
        inverted,
    );
    assert_eq!(registered(&layer), registered(&layer));
}

#[test]
fn what_shows_no_head_is_not_registered() {
    let place = grid([60, 70, 60], DVec3::splat(3.0), DMat3::IDENTITY);
    let failed = |layer: &Volume| {
        let found = registered(layer);
        assert_eq!(found.case_from_layer, DAffine3::IDENTITY, "{found:?}");
        match found.verdict {
            Verdict::Failed(doubt) => doubt,
            other => panic!("{other:?}: {found:?}"),
        }
    };
    let even = layer(place.clone(), DAffine3::IDENTITY, |_| 7.0);
    let flat = Volume::new(place.clone(), vec![7; place.voxel_count()], PLAIN).unwrap();
    assert_eq!(failed(&flat), Doubt::NoContrast);
    assert!(matches!(failed(&even), Doubt::Parts | Doubt::NoContrast));
    let speckle = |index: usize| ((index as u32).wrapping_mul(2_654_435_761) >> 20) as u16;
    let noise = (0..place.voxel_count()).map(speckle).collect();
    let noise = Volume::new(place, noise, PLAIN).unwrap();
    assert_eq!(failed(&noise), Doubt::Parts);
}

#[test]
fn too_little_of_the_head_is_not_registered() {
    let slices = grid([100, 110, 6], DVec3::splat(2.0), DMat3::IDENTITY);
    let found = registered(&layer(slices, DAffine3::IDENTITY, inverted));
    assert_eq!(found.verdict, Verdict::Failed(Doubt::Overlap), "{found:?}");
    let one = grid([100, 110, 1], DVec3::splat(2.0), DMat3::IDENTITY);
    let found = registered(&layer(one, DAffine3::IDENTITY, inverted));
    assert_eq!(found.verdict, Verdict::Failed(Doubt::Overlap), "{found:?}");
}

#[test]
fn a_header_that_is_false_by_a_quarter_turn_is_not_registered() {
    let place = grid([110, 110, 110], DVec3::splat(2.0), DMat3::IDENTITY);
    let quarter_turn = motion(DVec3::Z * std::f64::consts::FRAC_PI_2, DVec3::ZERO);
    let found = registered(&layer(place, quarter_turn, inverted));
    assert!(matches!(found.verdict, Verdict::Failed(_)), "{found:?}");
}

#[test]
fn a_mirrored_head_is_not_registered() {
    let place = grid([90, 110, 90], DVec3::splat(2.0), DMat3::IDENTITY);
    let truth = motion(DVec3::new(0.1, 0.0, 0.1), DVec3::new(3.0, 2.0, 1.0));
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let found = registered(&layer(place, mirror * truth, inverted));
    assert_eq!(found.verdict, Verdict::Failed(Doubt::Mirrored), "{found:?}");
    assert_eq!(found.case_from_layer, DAffine3::IDENTITY);
}

fn comparison(layer: &Volume) -> Comparison {
    Pair::new(&HEAD.volume, &HEAD.envelope, layer).comparison(1, None)
}

#[test]
fn the_slope_is_the_differences_of_the_score() {
    let truth = motion(DVec3::new(0.05, 0.0, 0.02), DVec3::new(2.0, 1.0, 0.0));
    let place = grid([120, 130, 120], DVec3::splat(2.0), DMat3::IDENTITY);
    let comparison = comparison(&layer(place, truth, inverted));
    let pose = Pose::identity(DVec3::new(3.0, -2.0, 1.0));
    let (score, slope) = comparison.score_and_slope(pose);
    assert_eq!(score, comparison.score(pose));
    let moved = |motion: Motion| comparison.score(pose.after(motion)).nmi;
    let shift = |shift: DVec3| Motion {
        shift,
        ..Motion::default()
    };
    let turn = |turn: DVec3| Motion {
        turn,
        ..Motion::default()
    };
    let stretch = |stretch: DVec3| Motion {
        stretch,
        ..Motion::default()
    };
    let shear = |shear: DVec3| Motion {
        shear,
        ..Motion::default()
    };
    let step = 0.02;
    for axis in DVec3::AXES {
        let difference = |motion: &dyn Fn(DVec3) -> Motion, step: f64| {
            (moved(motion(axis * step)) - moved(motion(axis * -step))) / (2.0 * step)
        };
        let differences = [
            difference(&shift, step),
            difference(&turn, step / 60.0),
            difference(&stretch, step / 60.0),
            difference(&shear, step / 60.0),
        ];
        let slopes = [slope.shift, slope.turn, slope.stretch, slope.shear];
        let slopes = slopes.map(|slope| axis.dot(slope));
        for (slope, difference) in slopes.into_iter().zip(differences) {
            let tolerance = 0.05 * difference.abs() + 2e-4;
            assert!(
                (slope - difference).abs() < tolerance,
                "{slope} {difference} {axis}"
            );
        }
    }
}

#[test]
fn two_volumes_tell_all_or_nothing_of_one_another() {
    // Two intensities, in halves of a block along x and along z.
    let size = [20, 20, 20];
    let halves = |axis: usize| Image::new(&halved(size, axis), 0.5);
    let (along_x, along_z) = (halves(0), halves(2));
    let place = |index: usize| {
        let [x, y, z] = [index % 18, index / 18 % 18, index / 324];
        Vec3::new(x as f32, y as f32, z as f32) + 0.25
    };
    let places: Vec<Vec3> = (0..18 * 18 * 18)
        .map(place)
        .filter(|place| !(8.0..11.0).contains(&place.x) && !(8.0..11.0).contains(&place.z))
        .collect();
    let score = |layer: &Image| {
        let samples = Samples::new(&places, DVec3::ZERO, &along_x, BINS);
        let comparison = Comparison::new(samples, layer, Range::of(&layer.values));
        comparison.score(Pose::identity(DVec3::ZERO)).nmi
    };
    // The window spreads each of the two bins of the layer alike: entropy w, and H(layer) = ln 2 + w. The places are not
    // split quite evenly, which both hold alike.
    let window: [f64; 4] = [1.0 / 48.0, 23.0 / 48.0, 23.0 / 48.0, 1.0 / 48.0];
    let spread = -window.iter().map(|share| share * share.ln()).sum::<f64>();
    let share = places.iter().filter(|place| place.x < 9.0).count() as f64 / places.len() as f64;
    let two = -(share * share.ln() + (1.0 - share) * (1.0 - share).ln());
    let all = (two + two + spread) / (two + spread);
    assert!(
        (score(&along_x) - all).abs() < 1e-3,
        "{} {all}",
        score(&along_x)
    );
    assert!((score(&along_z) - 1.0).abs() < 1e-6, "{}", score(&along_z));
}

/// 100 in one half of a block of voxels of 1 mm, 900 in the other.
fn halved(size: [usize; 3], axis: usize) -> Volume {
    let grid = Grid::aligned(size, [1.0; 3], DVec3::ZERO).expect("a small grid");
    let value = |index: usize| {
        if 2 * grid.voxel(index)[axis] < size[axis] {
            100
        } else {
            900
        }
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    Volume::new(grid, voxels, PLAIN).expect("one value for each voxel")
}

#[test]
fn a_coarser_image_keeps_the_places_of_a_ramp() {
    let grid = grid(
        [40, 80, 48],
        DVec3::new(1.0, 0.7, 3.0),
        DMat3::from_rotation_x(0.2),
    );
    let value = |index: usize| {
        let [x, y, z] = grid.voxel(index);
        (100 + 3 * x + 5 * y + 11 * z) as u16
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    let volume = Volume::new(grid.clone(), voxels, PLAIN).expect("one value for each voxel");
    let coarse = Image::new(&volume, 2.0).coarser(4.0);
    assert_eq!(coarse.size, [10, 13, 48]);
    let place = grid
        .patient_from_voxel()
        .transform_point3(DVec3::new(19.3, 42.1, 24.7));
    let voxel = coarse.patient_from_voxel.inverse().transform_point3(place);
    let value = coarse.sample(voxel).expect("it is inside");
    let expected = 100.0 + 3.0 * 19.3 + 5.0 * 42.1 + 11.0 * 24.7;
    assert!((value - expected).abs() < 0.05, "{value} {expected}");
}

/// A nearly symmetric head fits its mirror image about as well as itself, the more so if the contrast is weak.
#[test]
fn a_flair_of_weak_contrast_is_registered_and_a_mirrored_or_a_misplaced_one_is_not() {
    let phantom = BrainPhantom::PLAIN;
    let around = grid_of_brain();
    let scan = phantom.scan(&around);
    let brain = BrainMask::from_mask(&phantom.mask(&around), &around).unwrap();
    let envelope = envelope(&brain, 10.0).unwrap();
    let found = |tissues, case_from_layer| {
        let layer = SimulatedLayer {
            spacing_mm: [2.0; 3],
            tissues,
            case_from_layer,
            ..SimulatedLayer::WEAK_FLAIR
        };
        register(&scan.volume, &envelope, &phantom.other_contrast(&layer))
    };
    let weak = SimulatedLayer::WEAK_FLAIR.tissues;
    let truth = motion(DVec3::new(0.1, -0.05, 0.08), DVec3::new(5.0, -8.0, 3.0));
    assert_eq!(found(weak, truth).verdict, Verdict::Registered);
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mirrored = found(weak, truth * mirrored).verdict;
    assert_eq!(mirrored, Verdict::Failed(Doubt::Mirrored));
    // The coil makes the layer up to a third brighter on one side than in the middle. A contrast of 6 % is then placed 2 mm beside the truth.
    let misplaced = found([800.0, 1060.0, 1000.0], truth);
    let corner = DVec3::new(60.0, 80.0, 60.0);
    let [here, there] = [misplaced.best_case_from_layer, truth]
        .map(|from_layer| from_layer.transform_point3(corner));
    assert!(here.distance(there) > 1.5, "{}", here.distance(there));
    assert_eq!(misplaced.verdict, Verdict::Failed(Doubt::Parts));
}
