//! Checks whether the border of a mask is the border of a brain: brain inside, something darker outside.

use geometry::{DistanceMap, Grid, Volume};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// The distances inside and outside the border at which intensities are sampled, in mm.
const WITHIN_MM: [f32; 4] = [3.0, 4.5, 6.0, 7.5];
const AROUND_MM: [f32; 3] = [2.0, 3.5, 5.0];

/// The depth at which a skull-stripped brain has fluid and the surface of the cortex, in mm.
const SHALLOW_MM: f64 = 1.0;

/// Where scalp is looked for beyond the border, in mm, and how bright it is at least, on the scale of [`LIKE_BRAIN`].
const SCALP_MM: [f32; 14] = [
    4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0, 30.0,
];
const SCALP: f32 = 0.2;

/// The least room between the border and the end of the volume, in mm, for scalp to be expected there.
const ROOM_MM: f32 = 14.0;

/// The approximate number of sampled border points.
const PLACES: usize = 10_000;

/// The fewest border points by which a side is judged.
const LEAST_PLACES: u32 = 100;

/// The depth below which the inside of the brain begins, in mm.
const INSIDE_MM: f32 = 18.0;

/// The intensities of the rim of a brain, where 0 is the darkest value and 1 the median of the inside.
const LIKE_BRAIN: std::ops::RangeInclusive<f32> = 0.4..=1.3;

/// How much darker the surroundings of a brain are, on the same scale.
const DARKER: f32 = 0.1;

/// The step for the gradient of the depth, in voxels.
const STEP: isize = 2;

/// How far a mask is moved to test whether its border fits better elsewhere, in mm and in radians.
const SHIFT_MM: f64 = 4.0;
const TURN_RAD: f64 = 0.08;

/// How well the border of a mask fits the volume: fractions of border points with brain on the inner side and something
/// darker on the outer side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rim {
    /// With the mask in place.
    pub here: f64,
    /// The greatest with the mask moved by a few millimetres or degrees; it is less if the mask is in the right place.
    pub elsewhere: f64,
    /// The greatest with the mask flipped along an axis of the volume, as by a program that reverses an axis.
    pub flipped: f64,
}

/// How well the border of a mask fits. `None` if the mask is too thin, or its border lies in a cut.
pub(crate) fn rim(volume: &Volume, distance: &DistanceMap) -> Option<Rim> {
    let scale = Scale::of(volume, distance)?;
    let border = border(distance);
    let share = |how: DAffine3| share(volume, &scale, &border, how);
    let here = share(DAffine3::IDENTITY)?;
    let middle = border.iter().map(|place| place.position).sum::<DVec3>() / border.len() as f64;
    let most = |moves: Vec<DAffine3>| moves.into_iter().filter_map(share).fold(0.0, f64::max);
    Some(Rim {
        here,
        elsewhere: most(moves(middle)),
        flipped: most(flips(volume.grid()).to_vec()),
    })
}

/// The share of the border, towards each side in the order of [`geometry::Face::ALL`], beyond which there is nothing but air although the volume
/// goes on; 0 where too little of the border faces a side.
pub(crate) fn without_scalp(volume: &Volume, distance: &DistanceMap) -> Option<[f64; 6]> {
    let scale = Scale::of(volume, distance)?;
    let native_from_patient = volume.grid().voxel_from_patient();
    let (mut bare, mut all) = ([0u32; 6], [0u32; 6]);
    for place in border(distance) {
        let outwards = -place.inwards;
        // Within 45° of one side.
        if outwards.abs().max_element() < std::f64::consts::FRAC_1_SQRT_2 {
            continue;
        }
        let at = |mm: f32| {
            let position = place.position + outwards * f64::from(mm);
            scale.at(volume, native_from_patient, position)
        };
        if at(ROOM_MM).is_none() {
            continue;
        }
        let axis = outwards.abs().max_position();
        let face = 2 * axis + usize::from(outwards[axis] < 0.0);
        all[face] += 1;
        bare[face] += u32::from(
            SCALP_MM
                .into_iter()
                .filter_map(at)
                .all(|value| value < SCALP),
        );
    }
    let share = |face: usize| match all[face] >= LEAST_PLACES {
        true => f64::from(bare[face]) / f64::from(all[face]),
        false => 0.0,
    };
    Some([0, 1, 2, 3, 4, 5].map(share))
}

/// The median intensity of a skull-stripped brain [`SHALLOW_MM`] below its border, where 0 is the darkest value and 1 the median of the
/// inside. What is 0 there, in fissures that the zeros follow, does not count.
pub(crate) fn brightness_of_rim(volume: &Volume, distance: &DistanceMap) -> Option<f64> {
    let scale = Scale::of(volume, distance)?;
    let native_from_patient = volume.grid().voxel_from_patient();
    let shallow = border(distance)
        .into_iter()
        .map(|place| place.position + place.inwards * SHALLOW_MM);
    let values = shallow.filter_map(|position| scale.at(volume, native_from_patient, position));
    let mut values: Vec<f32> = values.filter(|&value| value > 0.0).collect();
    let rank = values.len().checked_sub(1)? / 2;
    let median = *values.select_nth_unstable_by(rank, f32::total_cmp).1;
    Some(f64::from(median))
}

/// The affines that flip the voxels of a grid along its axes.
pub(crate) fn flips(grid: &Grid) -> [DAffine3; 3] {
    let flip = |axis: usize| {
        let along = DVec3::AXES[axis];
        let flipped = DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::ONE - 2.0 * along),
            translation: along * (grid.size()[axis] - 1) as f64,
        };
        grid.patient_from_voxel() * flipped * grid.voxel_from_patient()
    };
    [0, 1, 2].map(flip)
}

/// A border point, in LPS mm, and the direction to the inside.
struct Place {
    position: DVec3,
    inwards: DVec3,
}

fn border(distance: &DistanceMap) -> Vec<Place> {
    let grid = distance.grid();
    let is_border = |&index: &usize| {
        distance.inside()[index] && distance.squared()[index] == 0 && distance.is_known(index)
    };
    let border: Vec<usize> = (0..grid.voxel_count()).filter(is_border).collect();
    let stride = (border.len() / PLACES).max(1);
    let place = |&index: &usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
        Some(Place {
            position: grid.patient_from_voxel().transform_point3(voxel),
            inwards: inwards(distance, index)?.as_dvec3(),
        })
    };
    border.iter().step_by(stride).filter_map(place).collect()
}

/// Shifts along the patient axes, and turns about them through a centre.
fn moves(middle: DVec3) -> Vec<DAffine3> {
    let both = |axis: DVec3| [axis, -axis];
    let axes = DVec3::AXES.into_iter().flat_map(both);
    let about = |axis: DVec3| {
        DAffine3::from_translation(middle)
            * DAffine3::from_axis_angle(axis, TURN_RAD)
            * DAffine3::from_translation(-middle)
    };
    axes.flat_map(|axis| [DAffine3::from_translation(axis * SHIFT_MM), about(axis)])
        .collect()
}

/// The fraction of border points that look like the border of a brain after a movement.
fn share(volume: &Volume, scale: &Scale, border: &[Place], how: DAffine3) -> Option<f64> {
    let native_from_patient = volume.grid().voxel_from_patient() * how;
    let looks_like_a_brain = |place: &Place| {
        let at = |mm: f32| {
            let position = place.position + place.inwards * f64::from(mm);
            scale.at(volume, native_from_patient, position)
        };
        let within = mean(WITHIN_MM.map(at).into_iter())?;
        let around = mean(AROUND_MM.map(|mm| at(-mm)).into_iter())?;
        Some(LIKE_BRAIN.contains(&within) && around < within - DARKER)
    };
    let looks: Vec<bool> = border.par_iter().filter_map(looks_like_a_brain).collect();
    let like_a_brain = looks.iter().filter(|&&looks| looks).count();
    (!looks.is_empty()).then(|| like_a_brain as f64 / looks.len() as f64)
}

/// Stored values on a scale with 0 for the darkest value of the volume and 1 for the median of the inside of the brain.
struct Scale {
    dark: f32,
    per_stored: f32,
}

impl Scale {
    fn of(volume: &Volume, distance: &DistanceMap) -> Option<Self> {
        let grid = distance.grid();
        let native_from_working = volume.grid().voxel_from_patient() * grid.patient_from_voxel();
        let is_deep = |&index: &usize| {
            distance.is_known(index)
                && distance
                    .depth_mm(index)
                    .is_some_and(|depth_mm| depth_mm >= INSIDE_MM)
        };
        let deep = (0..grid.voxel_count()).step_by(7).filter(is_deep);
        let mut inside: Vec<f32> = deep
            .filter_map(|index| {
                let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
                volume.sample(native_from_working.transform_point3(voxel).as_vec3())
            })
            .collect();
        let rank = inside.len() / 2;
        if inside.is_empty() {
            return None;
        }
        let median = *inside.select_nth_unstable_by(rank, f32::total_cmp).1;
        let dark = f32::from(volume.voxels().iter().copied().min()?);
        (median > dark).then(|| Self {
            dark,
            per_stored: 1.0 / (median - dark),
        })
    }

    /// The value of a volume at a position (LPS mm); `None` outside.
    fn at(&self, volume: &Volume, native_from_patient: DAffine3, position: DVec3) -> Option<f32> {
        let stored = volume.sample(native_from_patient.transform_point3(position).as_vec3())?;
        Some((stored - self.dark) * self.per_stored)
    }
}

/// The unit vector from a border voxel to the inside; `None` if the depth has no gradient there.
fn inwards(distance: &DistanceMap, index: usize) -> Option<Vec3> {
    let grid = distance.grid();
    let [nx, ny, _] = grid.size();
    let voxel = grid.voxel(index);
    let signed = |axis: usize, step: isize| {
        let place = voxel[axis].checked_add_signed(step)?;
        if place >= grid.size()[axis] {
            return None;
        }
        let stride = [1, nx, nx * ny][axis] as isize;
        let there = index.checked_add_signed(step * stride)?;
        let depth = f32::from(distance.squared()[there]).sqrt();
        Some(if distance.inside()[there] {
            depth
        } else {
            -depth
        })
    };
    let slope = |axis: usize| Some(signed(axis, STEP)? - signed(axis, -STEP)?);
    Vec3::new(slope(0)?, slope(1)?, slope(2)?).try_normalize()
}

fn mean(values: impl Iterator<Item = Option<f32>>) -> Option<f32> {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values.flatten() {
        sum += value;
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}
