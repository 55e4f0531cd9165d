use glam::{DQuat, DVec3};

use super::*;
use geometry::{BrainMask, Grid, Mask, Rescale, envelope, phantom};

/// A head as [`intensity_at`] has it, turned and moved.
#[derive(Clone, Copy)]
struct Placed {
    turn: DQuat,
    centre: DVec3,
    has_lesion: bool,
}

impl Placed {
    /// Turned in degrees about the axis from bottom to top (yaw) and about the one from front to back (roll), in this order.
    fn new([yaw, roll]: [f64; 2], centre: DVec3) -> Self {
        let turn =
            DQuat::from_rotation_y(roll.to_radians()) * DQuat::from_rotation_z(yaw.to_radians());
        Self {
            turn,
            centre,
            has_lesion: false,
        }
    }

    fn normal(&self) -> DVec3 {
        self.turn * DVec3::X
    }

    /// The volume and its envelope, at voxels of `spacing_mm`.
    fn scan(&self, spacing_mm: f64) -> (Envelope, Volume) {
        let side = (200.0 / spacing_mm) as usize;
        let grid = Grid::aligned([side; 3], [spacing_mm; 3], DVec3::splat(-100.0)).unwrap();
        let at = |index| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let place = self.turn.inverse() * (voxel * spacing_mm - 100.0 - self.centre);
            let lesion = self.has_lesion && place.distance(DVec3::new(35.0, -20.0, 15.0)) < 14.0;
            let speckle = f64::from((index as u32).wrapping_mul(2_654_435_761) >> 24) / 255.0 - 0.5;
            match intensity_at(place) {
                intensity if intensity > 0.0 && lesion => 40.0 + 60.0 * speckle,
                intensity if intensity > 0.0 => intensity + 60.0 * speckle,
                intensity => intensity,
            }
        };
        scan(grid.clone(), at)
    }
}

/// A volume and the envelope of what is above 0 in it.
fn scan(grid: Grid, intensity: impl Fn(usize) -> f64) -> (Envelope, Volume) {
    let values: Vec<u16> = (0..grid.voxel_count())
        .map(|index| intensity(index).round() as u16)
        .collect();
    let mask = Mask::new(
        grid.clone(),
        values.iter().map(|&value| value > 0).collect(),
    )
    .unwrap();
    let rescale = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    let brain = BrainMask::from_mask(&mask, &grid).unwrap();
    (
        envelope(&brain, 4.0).unwrap(),
        Volume::new(grid, values, rescale).unwrap(),
    )
}

/// A head that is its own mirror image in x alone: narrower in front, with a dark fissure, ventricles and folds.
fn intensity_at(place: DVec3) -> f64 {
    let half_width = 64.0 + 0.1 * place.y;
    let outline = (place / DVec3::new(half_width, 80.0, 58.0)).length();
    if outline > 1.0 || place.z < -40.0 {
        return 0.0;
    }
    let aside = place.x.abs();
    let in_fissure = aside < 2.0 && outline > 0.6;
    let ventricle =
        DVec3::new(aside - 12.0, place.y - 5.0, place.z - 8.0) / DVec3::new(6.0, 26.0, 9.0);
    if in_fissure || ventricle.length() < 1.0 {
        return 100.0;
    }
    let folds = (aside / 6.0).sin() + (place.y / 7.0).sin() + (place.z / 8.0 + aside / 15.0).cos();
    700.0 + 60.0 * folds
}

fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    a.dot(b).clamp(-1.0, 1.0).acos().to_degrees()
}

/// Asserts that the plane found is that of the head, within these bounds at its centre.
fn assert_found(head: Placed, spacing_mm: f64, (most_deg, most_mm): (f64, f64)) {
    let (envelope, volume) = head.scan(spacing_mm);
    let plane = midsagittal_plane(&envelope, &volume);
    let turned = angle_deg(plane.normal(), head.normal());
    let shifted = plane.normal().dot(head.centre) - plane.offset_mm();
    println!("{turned:.3} deg, {shifted:.3} mm from {:?}", head.normal());
    assert!(
        turned < most_deg,
        "{turned} deg: {plane:?}, {:?}",
        head.normal()
    );
    assert!(shifted.abs() < most_mm, "{shifted} mm: {plane:?}");
}

#[test]
fn the_plane_of_a_tilted_and_shifted_head_is_found_within_half_a_degree_and_half_a_millimetre() {
    for (turns, centre) in [
        ([0.0, 0.0], DVec3::ZERO),
        ([8.0, -5.0], DVec3::new(7.3, -4.1, 2.2)),
        ([-15.0, 11.0], DVec3::new(-12.4, 3.0, 5.5)),
        ([3.0, 24.0], DVec3::new(4.0, 9.0, -6.0)),
        ([-27.0, -2.0], DVec3::new(1.5, -8.0, 3.0)),
    ] {
        assert_found(Placed::new(turns, centre), 2.0, (0.5, 0.5));
    }
}

#[test]
fn a_lesion_that_has_no_counterpart_hardly_moves_the_plane() {
    let head = Placed {
        has_lesion: true,
        ..Placed::new([6.0, 9.0], DVec3::new(3.0, 1.0, -2.0))
    };
    assert_found(head, 2.0, (0.5, 0.5));
}

#[test]
fn the_correlation_is_high_for_a_head_that_is_its_own_mirror_image() {
    let (envelope, volume) = Placed::new([8.0, -5.0], DVec3::ZERO).scan(2.0);
    let found = midsagittal_fit(&envelope, &volume);
    assert!(found.correlation > 0.95, "{found:?}");
    let brain = phantom::ball(30.0);
    let grid = brain.mask().grid().clone();
    let (envelope, volume) = scan(grid, |index| {
        500.0 * f64::from(u8::from(brain.mask().voxels()[index]))
    });
    let found = midsagittal_fit(&envelope, &volume);
    assert!((0.0..=1.0).contains(&found.correlation), "{found:?}");
}

#[test]
fn a_ball_gets_a_plane_through_its_centre_near_the_sagittal_one() {
    let brain = phantom::ball(30.0);
    let grid = brain.mask().grid().clone();
    let centre = grid
        .patient_from_voxel()
        .transform_point3(DVec3::from_array(
            grid.size().map(|side| (side - 1) as f64 / 2.0),
        ));
    let (envelope, volume) = scan(grid.clone(), |index| {
        500.0 * f64::from(u8::from(brain.mask().voxels()[index]))
    });
    let plane = midsagittal_plane(&envelope, &volume);
    assert!(angle_deg(plane.normal(), DVec3::X) < 1.0, "{plane:?}");
    let apart = plane.normal().dot(centre) - plane.offset_mm();
    assert!(apart.abs() < 0.1, "{apart} mm: {plane:?}");
}

#[test]
fn a_head_of_one_voxel_has_a_plane() {
    let grid = Grid::aligned([16; 3], [1.0; 3], DVec3::new(5.0, 6.0, 7.0)).unwrap();
    let (envelope, volume) = scan(grid.clone(), |index| {
        if index == grid.index([8, 8, 8]) {
            9.0
        } else {
            0.0
        }
    });
    let plane = midsagittal_plane(&envelope, &volume);
    assert!(angle_deg(plane.normal(), DVec3::X) < 30.1, "{plane:?}");
    let apart = plane.normal().dot(DVec3::new(13.0, 14.0, 15.0)) - plane.offset_mm();
    assert!(apart.abs() < 1.0, "{apart} mm: {plane:?}");
}

#[test]
fn the_plane_is_the_same_to_the_bit_for_any_number_of_threads() {
    let (envelope, volume) = Placed::new([8.0, -5.0], DVec3::ZERO).scan(3.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let plane = pool.install(|| midsagittal_plane(&envelope, &volume));
        let [x, y, z] = plane.normal().to_array();
        [x, y, z, plane.offset_mm()].map(f64::to_bits)
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn a_point_reflected_twice_is_itself_and_one_on_the_plane_stays() {
    let plane = MidsagittalPlane {
        normal: DVec3::new(0.9, 0.3, -0.2).normalize(),
        offset_mm: 11.0,
    };
    let point = DVec3::new(40.0, -3.0, 17.0);
    let other = plane.reflected(point);
    assert!(other.distance(point) > 10.0);
    assert!(plane.reflected(other).distance(point) < 1e-12);
    let on_plane = (point + other) / 2.0;
    assert!(plane.reflected(on_plane).distance(on_plane) < 1e-12);
}
