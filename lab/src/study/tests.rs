use glam::DVec3;

use super::hotelling::area;
use super::run::run_head;
use super::*;
use analysis::phantom::{Phantom, Scan, lesion, on_junction, plain_grid};

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

/// O2 knows the place, and places lie in the middle between grey and white: a thickening turns that very point grey.
#[test]
fn a_thickening_is_seen_at_its_place_but_not_at_the_centre_of_its_patch() {
    let scan = noisy();
    let ground = Ground::new(scan.head()).unwrap();
    let number_of = 30;
    let place = |number: usize| {
        // A spiral with equal areas between its points.
        let z = 1.0 - (2 * number + 1) as f64 / number_of as f64;
        let angle = 2.4 * number as f64;
        let from_axis = (1.0 - z * z).sqrt();
        let direction = DVec3::new(from_axis * angle.cos(), from_axis * angle.sin(), z);
        let grid = &ground.block.grid;
        let voxel = grid
            .voxel_from_patient()
            .transform_point3(on_junction(direction));
        grid.patient_from_voxel().transform_point3(voxel.round())
    };
    let value = |values: &[f32], position: DVec3| {
        let grid = &ground.block.grid;
        let voxel = grid.voxel_from_patient().transform_point3(position).round();
        let voxel = voxel.to_array().map(|along| along as usize);
        f64::from(values[grid.index(voxel)])
    };
    let (mut at_places, mut at_centres) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for place in (0..number_of).map(place) {
        let mut lesion = blur(place);
        lesion.effect = Effect {
            thickening_mm: 2.0,
            ..Effect::NONE
        };
        let volume = ground.with_lesion(&lesion);
        let head = Head {
            volume: &volume,
            ..scan.head()
        };
        let (_, with, _) = tissue_of(head).unwrap();
        for (kind, values) in [&with, &ground.values].into_iter().enumerate() {
            let centre = patches::centre(head, &ground.block, values, place);
            assert!(centre.distance(place) < 5.0, "{centre} {place}");
            // Darker is more suspicious.
            at_places[kind].push(-value(values, place));
            at_centres[kind].push(-value(values, centre));
        }
    }
    let at_place = area(&at_places[0], &at_places[1]);
    let at_centre = area(&at_centres[0], &at_centres[1]);
    assert!(at_place > 0.95, "{at_place}");
    // Two standard errors of 30 against 30.
    assert!((at_centre - 0.5).abs() < 0.15, "{at_centre}");
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
fn a_head_runs_through_and_a_report_comes_of_it() {
    let scan = noisy();
    let parameters = StudyParameters {
        lesions: 3,
        shams: 2,
        patches: 3,
        normals: 40,
        ..StudyParameters::QUICK
    };
    let mut heard = 0;
    let trials = run_head(scan.head(), &parameters, Vec::new(), |_, count| {
        heard += 1;
        assert_eq!(count, 6);
        std::ops::ControlFlow::Continue(())
    })
    .unwrap();
    assert_eq!((trials.len(), heard), (6, 6));
    let ground = Ground::new(scan.head()).unwrap();
    let [lesioned, sham] = [0, 4].map(|number| ground.with_lesion(&trials[number].lesion()));
    assert!(lesioned != scan.volume && sham == scan.volume);
    let are_shams: Vec<bool> = trials
        .iter()
        .map(|trial| trial.sign == Sign::Sham)
        .collect();
    assert_eq!(are_shams, [false, false, true, false, true, true]);
    let are_searched: Vec<bool> = trials.iter().map(|trial| trial.is_searched).collect();
    assert_eq!(are_searched, [true, true, true, true, true, false]);
    let without_patches = StudyParameters {
        patches: 0,
        ..parameters
    };
    let stop = |_: &Trial, _| std::ops::ControlFlow::Break(());
    let first = run_head(scan.head(), &without_patches, Vec::new(), stop).unwrap();
    assert_eq!(first, trials[..1], "patches change nothing in the search");
    let go_on = |_: &Trial, _| std::ops::ControlFlow::Continue(());
    let continued = run_head(scan.head(), &parameters, first, go_on).unwrap();
    assert_eq!(continued, trials);
    for sighting in trials.iter().flat_map(|trial| &trial.sightings) {
        assert!((0.0..=1.0).contains(&sighting.known));
    }
    let head = HeadResult {
        name: "phantom".to_owned(),
        is_tuned: false,
        trials,
    };
    // Six channels need more than five patches.
    let larger = HeadResult {
        trials: [&head.trials[..]; 3].concat(),
        ..head.clone()
    };
    let twice = Report::new(&parameters, vec![larger.clone(), larger]);
    let report = Report::new(&parameters, vec![head]);
    assert!(
        report.known_place().is_empty(),
        "O2 needs another head to learn from"
    );
    let rows = twice.known_place();
    assert_eq!((rows[0].counts, rows[2].counts), ([9, 9], [18, 18]));
    for area in rows.iter().flat_map(|row| row.o1.iter().chain(&row.o2)) {
        assert!((0.0..=1.0).contains(area), "{rows:?}");
    }
    assert!(twice.table(&Criteria::STANDARD).contains("O1 / O2"));
    let table = report.table(&Criteria::STANDARD);
    assert!(
        table.contains("| phantom | 3 |") && table.contains("(c) V9 minus V10"),
        "{table}"
    );
}

#[test]
fn maps_alone_show_what_they_show_among_all_views_and_both_simulators_run_through() {
    let scan = noisy();
    let all = StudyParameters {
        lesions: 1,
        shams: 1,
        normals: 40,
        ..StudyParameters::QUICK
    };
    let maps = StudyParameters {
        views: &View::OF_MAPS,
        ..all
    };
    let go_on = |_: &Trial, _| std::ops::ControlFlow::Continue(());
    let run = |parameters| run_head(scan.head(), parameters, Vec::new(), go_on).unwrap();
    let [of_all, of_maps] = [&all, &maps].map(run);
    for (of_all, of_maps) in of_all.iter().zip(&of_maps) {
        let places = View::OF_MAPS.map(|view| View::ALL.iter().position(|one| *one == view));
        let expected = places.map(|place| of_all.sightings[place.unwrap()]);
        assert_eq!(of_maps.sightings, expected);
        assert!(of_maps.channels.is_empty());
    }
    let painted = StudyParameters {
        simulator: Simulator::Painted,
        shams: 1,
        ..maps.with_thickenings_alone(7.0, 2.0)
    };
    let trials = run(&painted);
    let signs: Vec<Sign> = trials.iter().map(|trial| trial.sign).collect();
    assert_eq!(signs, [Sign::Thickening, Sign::Sham]);
    let head = HeadResult {
        name: "phantom".to_owned(),
        is_tuned: false,
        trials,
    };
    let report = Report::new(&painted, vec![head]);
    assert!(report.known_place().is_empty());
    assert_eq!(report.verdicts(&Criteria::STANDARD).len(), 1, "shams alone");
    let table = report.table(&Criteria::STANDARD);
    assert!(
        table.contains("V11 list of thickness") && !table.contains("V4"),
        "{table}"
    );
    assert!(table.contains("| shams | 1 |"), "{table}");
}

#[test]
fn both_simulators_paint_a_band_to_its_end_and_brighten_grey_matter() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let centre = lesion();
    let value = |volume: &Volume, place: DVec3| {
        let voxel = volume.grid().voxel_from_patient().transform_point3(place);
        volume.sample(voxel.as_vec3()).unwrap()
    };
    let (end, beside) = (centre * 0.3, centre.any_orthonormal_vector() * 8.0);
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
fn the_page_has_four_lesions_and_shams_of_both_simulators_by_place() {
    let scan = noisy();
    let parameters = StudyParameters {
        lesions: 4,
        shams: 1,
        normals: 40,
        ..StudyParameters::QUICK
    };
    let go_on = |_: &Trial, _| std::ops::ControlFlow::Continue(());
    let reports = Simulator::ALL.map(|simulator| {
        let parameters = parameters.with_four_lesions(simulator);
        let trials = run_head(scan.head(), &parameters, Vec::new(), go_on).unwrap();
        let signs: Vec<Sign> = trials.iter().map(|trial| trial.sign).collect();
        let expected = FOUR_LESIONS.map(|(sign, ..)| sign);
        assert_eq!(signs, [&expected[..], &[Sign::Sham]].concat());
        let head = HeadResult {
            name: "phantom".to_owned(),
            is_tuned: false,
            trials,
        };
        Report::new(&parameters, vec![head])
    });
    let places = |report: &Report| -> Vec<[f64; 3]> {
        let trials = report.heads[0].trials.iter();
        trials.map(|trial| trial.position_in_patient).collect()
    };
    assert_eq!(places(&reports[0]), places(&reports[1]));
    let text = page(&reports);
    for row in [
        "| blur | `blur` | displaced | 1 |",
        "| thickening | `thickness` | painted | 1 |",
        "| sham | `blur` | painted | 1 |",
        "| from 25 mm on |",
    ] {
        assert!(text.contains(row), "{row} in {text}");
    }
    let highest = reports[0].heads[0].trials[4].sightings[2].highest.unwrap();
    assert!(text.contains(&format!("phantom {highest:.2}")), "{text}");
}
