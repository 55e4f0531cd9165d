use glam::DVec3;

use super::*;
use analysis::testing::{Phantom, Scan, lesion, plain_grid};

fn noisy() -> Scan {
    let phantom = Phantom {
        liveliness: 0.2,
        noise: 24.0,
        ..Phantom::PLAIN
    };
    phantom.scan(&plain_grid())
}

fn blur(centre_in_patient: DVec3) -> Lesion {
    Lesion {
        centre_in_patient,
        radius_mm: 6.0,
        effect: Effect {
            blur_mm: 1.5,
            ..Effect::NONE
        },
        band_to: None,
        seed: 3,
    }
}

/// Mean and variance of the stored values within 4 mm of a place.
fn moments(volume: &Volume, place: DVec3) -> [f64; 2] {
    let grid = volume.grid();
    let near = (0..grid.voxel_count()).filter(|&index| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        grid.patient_from_voxel()
            .transform_point3(voxel)
            .distance(place)
            < 4.0
    });
    let values: Vec<f64> = near
        .map(|index| f64::from(volume.voxels()[index]))
        .collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    [mean, squares / values.len() as f64]
}

#[test]
fn a_sham_changes_nothing_and_a_lesion_its_surroundings_alone() {
    let scan = noisy();
    let ground = Ground::new(scan.head()).unwrap();
    let sham = Lesion {
        effect: Effect::NONE,
        ..blur(lesion())
    };
    assert_eq!(ground.with_lesion(&sham), scan.volume);
    let lesion = blur(lesion());
    let with = ground.with_lesion(&lesion);
    let grid = with.grid();
    let mut changed = 0;
    for index in 0..grid.voxel_count() {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let position = grid.patient_from_voxel().transform_point3(voxel);
        if with.voxels()[index] != scan.volume.voxels()[index] {
            changed += 1;
            assert!(position.distance(lesion.centre_in_patient) < lesion.reach_mm());
        }
    }
    assert!(changed > 300, "{changed}");
}

#[test]
fn a_lesion_in_white_matter_keeps_its_noise_and_its_mean() {
    let scan = noisy();
    let ground = Ground::new(scan.head()).unwrap();
    let centre = DVec3::new(9.0, -4.0, 3.0);
    let before = moments(&scan.volume, centre);
    for thickening_mm in [0.0, 1.0] {
        let mut lesion = blur(centre);
        lesion.effect.thickening_mm = thickening_mm;
        let [mean, variance] = moments(&ground.with_lesion(&lesion), centre);
        assert!((mean - before[0]).abs() < 5.0, "{mean} {before:?}");
        assert!(
            (variance / before[1] - 1.0).abs() < 0.3,
            "{variance} {before:?}"
        );
    }
}

#[test]
fn a_thickening_moves_the_junction_into_white_matter_and_a_darkening_lowers_it() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let centre = lesion();
    // White matter 2 mm below the junction.
    let below = centre * (1.0 - 2.0 / centre.length());
    let at = |effect| {
        let lesion = Lesion {
            effect,
            ..blur(centre)
        };
        let volume = ground.with_lesion(&lesion);
        let voxel = volume.grid().voxel_from_patient().transform_point3(below);
        volume.sample(voxel.as_vec3()).unwrap()
    };
    let plain = at(Effect::NONE);
    let thick = at(Effect {
        thickening_mm: 2.0,
        ..Effect::NONE
    });
    let dark = at(Effect {
        darkening: 0.2,
        ..Effect::NONE
    });
    // Stored values: the contrast is 600. Below the junction by 2 mm, 0.94 of it are reached, and 0.5 two millimetres above that.
    assert!((150.0..330.0).contains(&(plain - thick)), "{plain} {thick}");
    assert!((80.0..140.0).contains(&(plain - dark)), "{plain} {dark}");
}

#[test]
fn places_are_deep_enough_and_the_same_for_a_seed() {
    let scan = noisy();
    let ground = Ground::new(scan.head()).unwrap();
    let places = ground.places(12, 5);
    assert_eq!(places.len(), 12);
    assert_eq!(ground.places(12, 5), places);
    assert_ne!(ground.places(12, 6), places);
    assert!(
        places
            .iter()
            .all(|place| (4.0..28.0).contains(&place.depth_mm))
    );
}

#[test]
fn a_strong_lesion_is_found_at_once_and_false_marks_are_counted() {
    let mark = |x: f64, score| Mark {
        position_in_patient: DVec3::X * x,
        score,
    };
    let marks = [
        mark(50.0, 5.0),
        mark(9.0, 4.0),
        mark(12.0, 3.0),
        mark(30.0, 2.0),
    ];
    let above = |marks: &[Mark], centre| hit(marks, centre, 6.0).map(|(before, _)| before);
    assert_eq!(above(&marks, DVec3::ZERO), Some(1));
    // A mark just beside the lesion is no false one.
    assert_eq!(above(&marks, DVec3::X * 30.0), Some(3));
    assert_eq!(above(&marks, DVec3::X * 100.0), None);
}

#[test]
fn all_simulators_darken_a_band_to_its_end_and_brighten_grey_matter() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let centre = lesion();
    let value = |volume: &Volume, place: DVec3| {
        let voxel = volume.grid().voxel_from_patient().transform_point3(place);
        volume.sample(voxel.as_vec3()).unwrap()
    };
    let (end, beside) = (
        centre * 0.3,
        centre.normalize().any_orthonormal_vector() * 8.0,
    );
    let band = Lesion {
        effect: Effect::NONE,
        band_to: Some(end),
        ..blur(centre)
    };
    let bright = Lesion {
        effect: Effect {
            brightening: 0.12,
            ..Effect::NONE
        },
        ..blur(centre)
    };
    // Grey matter 2 mm above the junction, and white matter on the way to the end.
    let (above, way) = (centre * (1.0 + 2.0 / centre.length()), centre * 0.5);
    for simulator in Simulator::ALL {
        let with = ground.simulated(&band, simulator);
        let change = |volume: &Volume, place| value(volume, place) - value(&scan.volume, place);
        // Stored values: the contrast is 600.
        let darker = change(&with, way);
        assert!((-200.0..-100.0).contains(&darker), "{darker}");
        assert_eq!(change(&with, way + beside), 0.0);
        assert_eq!(change(&with, centre * 0.1), 0.0);
        let brighter = change(&ground.simulated(&bright, simulator), above);
        assert!((30.0..90.0).contains(&brighter), "{brighter}");
    }
}

#[test]
fn a_head_runs_through_with_all_simulators_continues_and_fills_the_page() {
    let scan = noisy();
    let go_on = |_: &Trial| std::ops::ControlFlow::Continue(());
    let reports = Simulator::ALL.map(|simulator| {
        let parameters = StudyParameters {
            lesions: 4,
            shams: 1,
            simulator,
        };
        let study = (&parameters, 7);
        let mut heard = 0;
        let trials = run_head(scan.head(), study, Vec::new(), |trial| {
            heard += 1;
            go_on(trial)
        });
        let trials = trials.unwrap();
        assert_eq!((trials.len(), heard), (5, 5));
        let signs: Vec<Sign> = trials.iter().map(|trial| trial.sign).collect();
        let expected = FOUR_LESIONS.map(|(sign, ..)| sign);
        assert_eq!(signs, [&expected[..], &[Sign::Sham]].concat());
        let stop = |_: &Trial| std::ops::ControlFlow::Break(());
        let first = run_head(scan.head(), study, Vec::new(), stop).unwrap();
        assert_eq!(first, trials[..1]);
        let continued = run_head(scan.head(), study, trials[..4].to_vec(), go_on).unwrap();
        assert_eq!(continued, trials);
        let ground = Ground::new(scan.head()).unwrap();
        let [lesioned, sham] =
            [0, 4].map(|number| ground.simulated(&trials[number].lesion(), simulator));
        assert!(lesioned != scan.volume && sham == scan.volume);
        let head = HeadResult {
            name: "phantom".to_owned(),
            trials,
        };
        (simulator, vec![head])
    });
    let places = |heads: &[HeadResult]| -> Vec<[f64; 3]> {
        let trials = heads[0].trials.iter();
        trials.map(|trial| trial.position_in_patient).collect()
    };
    for (_, heads) in &reports[1..] {
        assert_eq!(places(heads), places(&reports[0].1));
    }
    let text = page(&reports);
    for row in [
        "| blur | `blur` | displaced | 1 |",
        "| thickening | `thickness` | painted | 1 |",
        "| sham | `blur` | painted | 1 |",
        "| mixture | `blur` | widened | 1 |",
        "| from 25 mm on |",
    ] {
        assert!(text.contains(row), "{row} in {text}");
    }
    let highest = reports[0].1[0].trials[4].sightings[0].highest.unwrap();
    assert!(text.contains(&format!("phantom {highest:.2}")), "{text}");
}
