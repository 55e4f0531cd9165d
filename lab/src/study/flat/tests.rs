use geometry::{BrainMask, Grid, Mask, Rescale, Volume, distance_map, envelope};

use super::*;
use crate::study::observer::{Changed, Seen};
use crate::study::random::Random;
use crate::study::{Ground, View};
use analysis::MidsagittalPlane;
use analysis::phantom::{Phantom, lesion, plain_grid};

fn rays() -> Rays {
    Rays {
        centre: DVec3::new(3.0, -5.0, 2.0),
        left: DVec3::X,
        up: DVec3::Z,
        front: DVec3::NEG_Y,
        from_mm: 100.0,
    }
}

#[test]
fn a_cap_of_directions_has_its_area_on_the_map_and_a_point_its_direction() {
    let rays = rays();
    let all = [true, false].map(|is_left| (0..PIXELS).map(move |pixel| on_map(is_left, pixel)));
    let directions: Vec<(OnMap, DVec3)> = all
        .into_iter()
        .flatten()
        .filter_map(|on_map| Some((on_map, rays.direction(on_map)?)))
        .collect();
    for (on_map, direction) in &directions {
        let again = rays.on_map(rays.centre + *direction * 40.0);
        let is_inner = on_map.point.length_squared() < 1.99;
        assert!((direction.length() - 1.0).abs() < 1e-9);
        assert!(!is_inner || again.is_left == on_map.is_left, "{on_map:?}");
        assert!(!is_inner || again.point.distance(on_map.point) < 1e-9);
    }
    let mut random = Random::new(4);
    for _ in 0..200 {
        let [x, y, z] = [(); 3].map(|()| random.normal());
        let middle = DVec3::new(x, y, z).normalize();
        let angle = 0.3 + 0.6 * random.uniform();
        let is_in = |(_, direction): &&(OnMap, DVec3)| middle.dot(*direction) > angle.cos();
        let area = directions.iter().filter(is_in).count() as f64 / PIXELS_PER_RADIUS.powi(2);
        let expected = std::f64::consts::TAU * (1.0 - angle.cos());
        assert!((area / expected - 1.0).abs() < 0.02, "{area} {expected}");
    }
}

#[test]
fn a_pixel_is_the_first_place_from_outside_at_its_depth() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let rays = Rays::new(scan.head());
    let hits = Hits::new(&rays, &scan.depth, &ground.block);
    let patient_from_voxel = ground.block.grid.patient_from_voxel();
    let working_from_patient = scan.depth.grid().voxel_from_patient();
    let depth_at = |position: DVec3| {
        let there = working_from_patient.transform_point3(position);
        depth_at(&scan.depth, there.as_vec3())
    };
    for (number, depth_mm) in DEPTHS_MM.into_iter().enumerate() {
        for index in (0..2 * PIXELS).step_by(97) {
            let voxel = hits.voxels[number * 2 * PIXELS + index].map(f64::from);
            let position = patient_from_voxel.transform_point3(DVec3::from_array(voxel));
            if rays
                .direction(on_map(index < PIXELS, index % PIXELS))
                .is_none()
            {
                assert!(position.is_nan());
                continue;
            }
            assert!((depth_at(position) - depth_mm).abs() < 0.05);
            let outwards = (position - rays.centre).normalize();
            let outer = (1..40).map(|step| depth_at(position + outwards * f64::from(step)));
            assert!(outer.fold(-1.0, f32::max) < depth_mm);
        }
    }
    // The isosurfaces lie in each other.
    assert!(hits.radii_mm.is_sorted_by(|outer, inner| outer > inner));
}

/// Two balls on a rod: the near side of each is behind its far side.
#[test]
fn a_place_behind_another_one_is_not_shown() {
    let grid = Grid::aligned([40, 90, 40], [1.0; 3], DVec3::new(-19.5, -44.5, -19.5)).unwrap();
    let is_inside = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let place = grid.patient_from_voxel().transform_point3(voxel);
        let is_in_ball = |y: f64| place.distance(DVec3::Y * y) < 14.0;
        let is_in_rod = place.x.hypot(place.z) < 4.0 && place.y.abs() < 25.0;
        is_in_ball(-25.0) || is_in_ball(25.0) || is_in_rod
    };
    let inside: Vec<bool> = (0..grid.voxel_count()).map(is_inside).collect();
    let voxels = inside.iter().map(|inside| u16::from(*inside)).collect();
    let rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
    let brain = BrainMask::from_mask(&Mask::new(grid.clone(), inside).unwrap(), &grid).unwrap();
    let depth = DepthField::new(&distance_map(&envelope(&brain, 0.0).unwrap()));
    let head = Head {
        volume: &volume,
        depth: &depth,
        plane: &MidsagittalPlane::new(DVec3::X, 0.0).unwrap(),
    };
    let rays = Rays::new(head);
    assert!(rays.centre.length() < 1.0, "{}", rays.centre);
    let shown = |y: f64| rays.shown(&depth, rays.centre + DVec3::Y * y);
    assert!((5.0..9.0).contains(&shown(32.0).unwrap()));
    assert_eq!(shown(18.0), None);
    let direction = DVec3::Y;
    let first = rays.first_hits(&depth, direction, &[6.0])[0];
    assert!((31.0..34.0).contains(&first), "{first}");
}

#[test]
fn a_blurred_spot_is_the_first_mark_on_the_maps_and_its_patch_is_where_it_is() {
    let phantom = Phantom {
        liveliness: 0.2,
        noise: 12.0,
        has_lesion: true,
        ..Phantom::PLAIN
    };
    let scan = phantom.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let seen = Seen::of(scan.head(), &ground.block, &ground.values);
    let marks = seen.marks(View::FlatMaps);
    let off = marks[0].position_in_patient.distance(lesion());
    assert!(off < 10.0, "{marks:?}");
    let score = seen.at(View::FlatMaps, &scan.depth, lesion());
    let other = scan.plane.reflected(lesion());
    assert!(score > seen.at(View::FlatMaps, &scan.depth, other));

    let offsets = [DVec2::ZERO, DVec2::new(6.0, 0.0), DVec2::new(0.0, 6.0)];
    let patch = seen.flat.patch(&scan.depth, lesion(), offsets.into_iter());
    let [middle, front, up] = [0, 1, 2].map(|number| patch[number].unwrap());
    assert!(middle.distance(lesion()) < 0.5);
    assert!(front.y < middle.y - 2.0 && up.z > middle.z + 2.0);
    for (a, b) in [(front, middle), (up, middle)] {
        // Equal areas, but not equal lengths.
        assert!((3.0..12.0).contains(&a.distance(b)), "{a} {b}");
    }
}

#[test]
fn maps_with_a_change_are_those_of_the_changed_head() {
    let scan = Phantom::PLAIN.scan(&plain_grid());
    let ground = Ground::new(scan.head()).unwrap();
    let block = &ground.block;
    let reach_mm = 8.0;
    let mut changed = ground.values.clone();
    for (index, value) in changed.iter_mut().enumerate() {
        let voxel = DVec3::from_array(block.grid.voxel(index).map(|along| along as f64));
        let position = block.grid.patient_from_voxel().transform_point3(voxel);
        if position.distance(lesion()) < reach_mm {
            *value = 0.3 + 0.5 * *value;
        }
    }
    let seen = |values: &[f32]| Seen::of(scan.head(), block, values);
    let (before, expected) = (seen(&ground.values), seen(&changed));
    let change = Changed {
        centre: lesion(),
        reach_mm,
    };
    let found = before.with(scan.head(), block, &changed, change);
    let count = found.flat.points().count();
    assert_eq!(count, expected.flat.points().count());
    for (found, expected) in found.flat.points().zip(expected.flat.points()) {
        assert_eq!(found.position, expected.position);
        // Beyond 4 mm, a change is only rounding.
        let off = (found.sharpness - expected.sharpness).abs();
        assert!(off < 1e-5, "{found:?} {expected:?}");
    }
    assert!(!found.flat.points().eq(before.flat.points()));
    let same = before.with(scan.head(), block, &ground.values, change);
    assert!(same.flat.points().eq(before.flat.points()));
}
