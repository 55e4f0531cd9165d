//! Whole heads with a known junction.

use geometry::{Grid, Mask, Volume};
use glam::{DAffine3, DMat3, DVec3};

use crate::phantom::{
    Phantom, Scan, WIDTH_MM, lesion, mirrored, on_junction, plain_grid, sample, turned,
};

use crate::{JunctionWidth, MapKind, Maps, MapsUndefined};

/// The phantom's contrast in intensities.
const CONTRAST: f32 = 300.0;

/// Points of the phantom's junction in the head's own coordinates, away from its fluid.
fn junction_points() -> impl Iterator<Item = DVec3> {
    (0..400).map(|number| {
        let height = 1.0 - 2.0 * (f64::from(number) + 0.5) / 400.0;
        let angle = f64::from(number) * 2.399_963;
        let radius = (1.0 - height * height).sqrt();
        on_junction(DVec3::new(
            radius * angle.cos(),
            radius * angle.sin(),
            height,
        ))
    })
}

#[test]
fn a_head_that_is_its_own_mirror_image_stands_out_nowhere() {
    let maps = Phantom::PLAIN.scan(&plain_grid()).maps().unwrap();
    for kind in [
        MapKind::Asymmetry,
        MapKind::IntensityAsymmetry,
        MapKind::Blur,
    ] {
        let map = maps.map(kind);
        let values = (0..map.codes().len()).map(|index| map.value(index));
        let worst = values
            .filter(|value| !value.is_nan())
            .fold(0.0, |worst, value| {
                // Blur is one-sided: below zero, the junction is sharp.
                f32::max(
                    worst,
                    if kind == MapKind::Blur {
                        value
                    } else {
                        value.abs()
                    },
                )
            });
        println!("{}: at most {worst:.2}", kind.name());
        assert!(worst < 1.0, "{}: {worst}", kind.name());
    }
}

#[test]
fn the_width_of_the_junction_is_right_within_a_tenth_on_oblique_and_uneven_voxels() {
    let oblique = DAffine3 {
        matrix3: DMat3::from_rotation_z(0.26) * DMat3::from_diagonal(DVec3::new(0.9, 1.2, -0.95)),
        translation: DVec3::ZERO,
    };
    let size = [136, 122, 120];
    let middle =
        oblique.transform_vector3(DVec3::from_array(size.map(|side| f64::from(side) / 2.0)));
    let oblique = DAffine3::from_translation(-middle) * oblique;
    let oblique = Grid::new(size.map(|side| side as usize), oblique).unwrap();
    for grid in [plain_grid(), oblique] {
        let maps = Phantom::PLAIN.scan(&grid).maps().unwrap();
        let (mut seen, mut worst) = (0, 0.0f64);
        for point in junction_points() {
            // Partial volume moves the means of the classes; the phantom knows its own contrast.
            let contrast = (maps.tissue.white - maps.tissue.grey) / CONTRAST;
            let sharpness = sample(maps.map(MapKind::Sharpness), point) * contrast;
            let Some(JunctionWidth::Mm(width)) = maps.widths.width(sharpness) else {
                panic!("{point}: {sharpness}");
            };
            seen += 1;
            worst = worst.max((f64::from(width) / WIDTH_MM - 1.0).abs());
        }
        println!("{:?}: off by at most {worst:.3}", grid.spacing_mm());
        assert!(seen == 400 && worst < 0.10, "{seen} {worst}");
    }
}

#[test]
fn a_blurred_place_is_the_first_candidate_and_shows_on_its_own_side_alone() {
    let phantom = Phantom {
        has_lesion: true,
        liveliness: 0.2,
        noise: 24.0,
        ..Phantom::PLAIN
    };
    let maps = phantom.scan(&plain_grid()).maps().unwrap();
    assert!(
        (maps.tissue.noise - 0.04).abs() < 0.005,
        "{:?}",
        maps.tissue
    );
    let first = maps.candidates[0];
    let apart = first.position_in_patient.distance(lesion());
    assert!(apart < 6.0, "{first:?} is {apart} mm from {}", lesion());
    assert!(first.position_in_patient.x > 5.0, "it is on the left");
    assert!((7.0..14.0).contains(&first.depth_mm), "{first:?}");
    assert!(
        first.score > 1.5 && first.score > 2.0 * maps.candidates[1].score,
        "{:?}",
        &maps.candidates[..2]
    );
    assert!((6.0..20.0).contains(&first.size_mm), "{first:?}");
    let other = mirrored().transform_point3(lesion());
    let [own, other] = [lesion(), other].map(|place| sample(maps.map(MapKind::Blur), place));
    assert!(own > 1.5 && other < 0.5, "{own} {other}");
    let asymmetry = sample(maps.map(MapKind::Asymmetry), lesion());
    assert!(asymmetry < -1.5, "{asymmetry}");
}

#[test]
fn candidates_are_apart_and_descend() {
    let phantom = Phantom {
        liveliness: 0.4,
        noise: 30.0,
        ..Phantom::PLAIN
    };
    let candidates = phantom.scan(&plain_grid()).maps().unwrap().candidates;
    assert!(candidates.len() > 20);
    assert!(candidates.is_sorted_by(|a, b| a.score >= b.score));
    for (number, candidate) in candidates.iter().enumerate() {
        for other in &candidates[..number] {
            let apart = candidate
                .position_in_patient
                .distance(other.position_in_patient);
            assert!(apart >= 10.0 - 1e-9, "{apart}");
        }
    }
}

/// The greatest difference of `blur` at the junction between two heads that are placed differently.
fn greatest_difference(
    (first, first_placed): (&Maps, DAffine3),
    (second, second_placed): (&Maps, DAffine3),
) -> f32 {
    // At the lesion and opposite to it z is so great that three tenths of it are a few percent.
    let is_ordinary = |point: &DVec3| {
        let twin = DVec3::new(-point.x, point.y, point.z);
        point.distance(lesion()) > 12.0 && twin.distance(lesion()) > 12.0
    };
    let mut differences: Vec<f32> = junction_points()
        .filter(is_ordinary)
        .map(|point| {
            let [a, b] = [(first, first_placed), (second, second_placed)].map(|(maps, placed)| {
                sample(maps.map(MapKind::Blur), placed.transform_point3(point))
            });
            (a - b).abs()
        })
        .collect();
    assert!(differences.iter().all(|difference| !difference.is_nan()));
    differences.sort_by(f32::total_cmp);
    println!(
        "median {:.3}, 95 % {:.3}, most {:.3}",
        differences[differences.len() / 2],
        differences[differences.len() * 95 / 100],
        differences[differences.len() - 1]
    );
    differences[differences.len() - 1]
}

#[test]
fn a_turned_head_and_a_mirrored_one_have_the_same_z_within_three_tenths() {
    let phantom = Phantom {
        has_lesion: true,
        liveliness: 0.3,
        ..Phantom::PLAIN
    };
    let plain = phantom.scan(&plain_grid()).maps().unwrap();
    for placed in [
        turned(10.0, 0.0, DVec3::new(1.3, -0.4, 0.7)),
        turned(-4.0, 9.0, DVec3::ZERO),
        mirrored(),
    ] {
        let other = Phantom { placed, ..phantom };
        let other = other.scan(&plain_grid()).maps().unwrap();
        let worst = greatest_difference((&plain, DAffine3::IDENTITY), (&other, placed));
        assert!(worst < 0.3, "{placed:?}: {worst}");
        let [first, second] = [&plain, &other].map(|maps| maps.candidates[0]);
        let moved = placed.transform_point3(first.position_in_patient);
        assert!(moved.distance(second.position_in_patient) < 2.5);
        let is_mirrored = placed.matrix3.determinant() < 0.0;
        let [first, second] = [first, second].map(|place| place.position_in_patient.x > 0.0);
        assert_eq!(first != second, is_mirrored);
    }
}

#[test]
fn a_head_without_enough_contrast_or_with_coarse_voxels_has_no_maps_and_a_reason() {
    let noisy = Phantom {
        noise: 200.0,
        ..Phantom::PLAIN
    };
    let refused = noisy.scan(&plain_grid()).maps();
    assert!(
        matches!(
            refused,
            Err(MapsUndefined::LowContrast { .. } | MapsUndefined::NoWhiteMatter)
        ),
        "{refused:?}"
    );
    let origin = DVec3::new(-56.0, -66.0, -52.0);
    let coarse = Grid::aligned([114, 134, 50], [1.0, 1.0, 2.1], origin).unwrap();
    let refused = Phantom::PLAIN.scan(&coarse).maps().unwrap_err();
    assert!(matches!(refused, MapsUndefined::CoarseVoxels { .. }));
    assert!(refused.to_string().contains("2.10 mm"), "{refused}");
    // A fruit: one flesh, and noise.
    let flesh = Phantom {
        contrast: 0.0,
        noise: 40.0,
        ..Phantom::PLAIN
    };
    let refused = flesh.scan(&plain_grid()).maps();
    assert!(
        matches!(
            refused,
            Err(MapsUndefined::LowContrast { .. } | MapsUndefined::NoWhiteMatter)
        ),
        "{refused:?}"
    );
}

#[test]
fn if_half_of_the_mask_is_empty_that_is_the_reason() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let mut voxels = scan.volume.voxels().to_vec();
    let side = plain_grid().size()[0];
    for (index, voxel) in voxels.iter_mut().enumerate() {
        if index % side < side / 2 {
            *voxel = 0;
        }
    }
    let volume = Volume::new(plain_grid(), voxels, scan.volume.rescale()).unwrap();
    let refused = Scan { volume, ..scan }.maps().unwrap_err();
    assert_eq!(refused.code(), "empty-volume", "{refused}");
}

#[test]
fn the_noise_of_voxels_of_two_millimetres_is_measured_and_their_head_has_maps() {
    let size = [57, 67, 53];
    let origin = DVec3::from_array(size.map(|side| -((side - 1) as f64)));
    let grid = Grid::aligned(size, [2.0; 3], origin).unwrap();
    let phantom = Phantom {
        noise: 24.0,
        ..Phantom::PLAIN
    };
    let maps = phantom.scan(&grid).maps().unwrap();
    let noise = maps.tissue.noise;
    assert!((noise - 0.04).abs() < 0.008, "{noise}");
}

#[test]
fn white_matter_in_thin_sheets_is_too_little_for_the_noise_and_large_voxels_are_the_reason() {
    // Every other 4 mm from left to right is grey matter.
    let reason = |spacing_mm: f64| {
        let size = [114.0, 134.0, 106.0].map(|side: f64| (side / spacing_mm) as usize);
        let origin = DVec3::from_array(size.map(|side| (side - 1) as f64 * -spacing_mm / 2.0));
        let grid = Grid::aligned(size, [spacing_mm; 3], origin).unwrap();
        let Scan { volume, .. } = Phantom::PLAIN.scan(&grid);
        let stored = volume.voxels().iter().enumerate().map(|(index, &value)| {
            let sheet = (grid.voxel(index)[0] as f64 * spacing_mm / 4.0) as usize;
            if sheet.is_multiple_of(2) {
                value.min(1500)
            } else {
                value
            }
        });
        let sheets = Volume::new(grid.clone(), stored.collect(), volume.rescale()).unwrap();
        let inside = volume.voxels().iter().map(|&value| value > 0).collect();
        let mask = Mask::new(grid, inside).unwrap();
        Scan::new(sheets, &mask).maps().map(|_| ()).unwrap_err()
    };
    let coarse = reason(2.0);
    assert_eq!(coarse.code(), "noise-unknown", "{coarse}");
    assert!(coarse.to_string().contains("2.00 mm"), "{coarse}");
    assert_eq!(reason(1.0), MapsUndefined::NoWhiteMatter);
}

#[test]
fn maps_are_the_same_to_the_bit_for_any_number_of_threads() {
    let scan = Phantom {
        noise: 20.0,
        ..Phantom::PLAIN
    }
    .scan(&plain_grid());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| scan.maps()).unwrap()
    };
    assert_eq!(with(1), with(3));
}
