//! Volumes and masks of real heads, spoiled in known ways or changed harmlessly.

use geometry::{BrainMask, Face, Grid, Mask, Volume, as_position, offset};
use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::support::{black, resampled};
use crate::wrong_heads::{noise, with_axes, with_values};

/// The centre of a grid, LPS mm.
fn middle(grid: &Grid) -> DVec3 {
    let middle = DVec3::from_array(grid.size().map(|side| (side - 1) as f64 / 2.0));
    grid.patient_from_voxel().transform_point3(middle)
}

/// The direction out of a volume at a face.
fn outward(face: Face) -> DVec3 {
    let number = face as usize;
    DVec3::AXES[number / 2] * if number.is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// The axis of a grid that is nearest to a direction, and whether the face there is at its end.
fn axis_towards(grid: &Grid, outward: DVec3) -> (usize, bool) {
    let along = |axis: usize| {
        let column = grid.patient_from_voxel().matrix3.col(axis);
        column.normalize().dot(outward)
    };
    let axis = (0..3).max_by(|&a, &b| along(a).abs().total_cmp(&along(b).abs()));
    let axis = axis.expect("three axes");
    (axis, along(axis) > 0.0)
}

/// The positions of the voxels of a set, LPS mm.
fn positions(set: &Mask) -> impl Iterator<Item = DVec3> {
    let marked = set
        .voxels()
        .iter()
        .enumerate()
        .filter(|(_, marked)| **marked);
    marked.map(|(index, _)| {
        let voxel = as_position(set.grid().voxel(index));
        set.grid().patient_from_voxel().transform_point3(voxel)
    })
}

/// The least and greatest coordinates of a set, LPS mm.
fn bounds(set: &Mask) -> [DVec3; 2] {
    positions(set).fold(
        [DVec3::INFINITY, DVec3::NEG_INFINITY],
        |[low, high], place| [low.min(place), high.max(place)],
    )
}

/// The voxel along an axis of a volume that lies `mm` within a brain's bounds at a face.
fn plane_within(volume: &Grid, brain: &BrainMask, face: Face, mm: f64) -> (usize, bool, usize) {
    let (axis, is_at_end) = axis_towards(volume, outward(face));
    let along = positions(brain.mask())
        .map(|place| volume.voxel_from_patient().transform_point3(place)[axis]);
    let margin = mm / volume.spacing_mm()[axis];
    let plane = match is_at_end {
        true => along.fold(f64::NEG_INFINITY, f64::max) - margin,
        false => along.fold(f64::INFINITY, f64::min) + margin,
    };
    (axis, is_at_end, plane.round() as usize)
}

/// A volume without what lies within `mm` of a brain's bounds at a face.
pub(crate) fn cut(volume: &Volume, brain: &BrainMask, face: Face, mm: f64) -> Volume {
    let grid = volume.grid();
    let (axis, is_at_end, plane) = plane_within(grid, brain, face, mm);
    let mut first = [0; 3];
    let mut size = grid.size();
    if is_at_end {
        size[axis] = plane + 1;
    } else {
        first[axis] = plane as i64;
        size[axis] -= plane;
    }
    resampled(volume, &grid.block(first, size).expect("a block"))
}

/// A volume with zeros in place of what lies within `mm` of a brain's bounds at a face: a slab in a larger box, or a head whose front
/// was removed.
pub(crate) fn zeros(volume: &Volume, brain: &BrainMask, face: Face, mm: f64) -> Volume {
    let (axis, is_at_end, plane) = plane_within(volume.grid(), brain, face, mm);
    let black = black(volume);
    with_values(volume, |stored, voxel| {
        let is_beyond = match is_at_end {
            true => voxel[axis] > plane,
            false => voxel[axis] < plane,
        };
        if is_beyond { black } else { f64::from(stored) }
    })
}

/// A volume of which `kept` tells how much remains above air, by the distance below a brain's top in mm.
fn above_air(volume: &Volume, brain: &BrainMask, kept: impl Fn(f64, [usize; 3]) -> f64) -> Volume {
    let (axis, is_at_end, top) = plane_within(volume.grid(), brain, Face::Superior, 0.0);
    let (air, spacing_mm) = (air(volume), volume.grid().spacing_mm()[axis]);
    with_values(volume, |stored, voxel| {
        let below = top as f64 - voxel[axis] as f64;
        let below_mm = spacing_mm * if is_at_end { below } else { -below };
        air + (f64::from(stored) - air) * kept(below_mm, voxel)
    })
}

/// A volume that fades to air from `mm` below a brain's top upwards.
pub(crate) fn fading(volume: &Volume, brain: &BrainMask, mm: f64) -> Volume {
    above_air(volume, brain, |below_mm, _| {
        (below_mm / mm).clamp(0.0, 1.0).powi(2)
    })
}

/// A volume with faint noise in place of what lies less than `mm` below a brain's top, and above it.
pub(crate) fn ending_in_noise(volume: &Volume, brain: &BrainMask, mm: f64) -> Volume {
    above_air(volume, brain, |below_mm, voxel| match below_mm < mm {
        true => 0.05 * noise(voxel),
        false => 1.0,
    })
}

/// A mask without what lies less than `mm` below its top.
pub(crate) fn lowered(brain: &BrainMask, mm: f64) -> Mask {
    let mask = brain.mask();
    let [_, high] = bounds(mask);
    let grid = mask.grid();
    let voxel = |index: usize| {
        let place = grid
            .patient_from_voxel()
            .transform_point3(as_position(grid.voxel(index)));
        mask.voxels()[index] && place.z < high.z - mm
    };
    let voxels = (0..grid.voxel_count()).map(voxel).collect();
    Mask::new(grid.clone(), voxels).expect("the same grid")
}

/// The same above a plane that leans by an angle, as of a slab that was turned before it was resampled.
pub(crate) fn oblique_zeros(volume: &Volume, brain: &BrainMask, mm: f64, angle_rad: f64) -> Volume {
    let [low, high] = bounds(brain.mask());
    let point = DVec3::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0, high.z - mm);
    let normal = DQuat::from_rotation_x(angle_rad) * DVec3::Z;
    let patient_from_voxel = volume.grid().patient_from_voxel();
    let black = black(volume);
    with_values(volume, |stored, voxel| {
        let place = patient_from_voxel.transform_point3(as_position(voxel));
        if (place - point).dot(normal) > 0.0 {
            black
        } else {
            f64::from(stored)
        }
    })
}

/// A volume whose left half is zero.
pub(crate) fn half(volume: &Volume, brain: &BrainMask) -> Volume {
    let [low, high] = bounds(brain.mask());
    zeros(volume, brain, Face::Left, (high.x - low.x) / 2.0)
}

/// A volume whose slices are said to be another distance apart.
pub(crate) fn stretched(volume: &Volume, factor: f64) -> Volume {
    with_axes(volume, DMat3::from_diagonal(DVec3::new(1.0, 1.0, factor)))
}

/// The stored value of the air, which need not be 0.
fn air(volume: &Volume) -> f64 {
    let mut values: Vec<u16> = volume.voxels().iter().step_by(101).copied().collect();
    values.sort_unstable();
    f64::from(values[values.len() / 50])
}

/// A volume with noise of this fraction of its brain's median.
pub(crate) fn noisy(volume: &Volume, brain: &BrainMask, share: f64) -> Volume {
    let native_from_patient = volume.grid().voxel_from_patient();
    let mut inside: Vec<f32> = positions(brain.mask())
        .step_by(101)
        .filter_map(|place| volume.sample(native_from_patient.transform_point3(place).as_vec3()))
        .collect();
    inside.sort_by(f32::total_cmp);
    let deviation = (f64::from(inside[inside.len() / 2]) - air(volume)) * share;
    // Uniform noise of this standard deviation.
    with_values(volume, |stored, voxel| {
        f64::from(stored) + 1.73 * deviation * noise(voxel)
    })
}

/// A volume with a bias field that changes from e⁻¹·² to e¹·² along its diagonal.
pub(crate) fn biased(volume: &Volume) -> Volume {
    let size = volume.grid().size();
    let air = air(volume);
    let brightest = f64::from(*volume.voxels().iter().max().expect("voxels")) - air;
    let scale = (65535.0 / (brightest * 1.2f64.exp())).min(100.0);
    with_values(volume, |stored, voxel| {
        let along = |axis: usize| voxel[axis] as f64 / size[axis] as f64 * 2.0 - 1.0;
        let field = 1.2 * (along(0) + along(1) - along(2)) / 3.0;
        (f64::from(stored) - air) * field.exp() * scale
    })
}

/// A volume that was acquired with the head rolled by 30° towards a shoulder.
pub(crate) fn rolled(volume: &Volume) -> Volume {
    let turn = DMat3::from_rotation_y(30f64.to_radians());
    resampled(&with_axes(volume, turn), volume.grid())
}

/// A volume with slices of 6 mm.
pub(crate) fn thick(volume: &Volume) -> Volume {
    let grid = volume.grid();
    let (axis, _) = axis_towards(grid, DVec3::Z);
    let share = grid.spacing_mm()[axis] / 6.0;
    let mut scale = DVec3::ONE;
    scale[axis] = 1.0 / share;
    let mut size = grid.size();
    size[axis] = (size[axis] as f64 * share).floor() as usize;
    let affine = grid.patient_from_voxel() * DAffine3::from_scale(scale);
    resampled(volume, &Grid::new(size, affine).expect("a grid"))
}

/// A volume with zeros around a brain.
pub(crate) fn bare(volume: &Volume, brain: &BrainMask) -> Volume {
    let mask = on_grid(brain.mask(), volume.grid(), DAffine3::IDENTITY);
    let grid = volume.grid().clone();
    let black = black(volume);
    with_values(volume, |stored, voxel| {
        if mask.voxels()[grid.index(voxel)] {
            f64::from(stored)
        } else {
            black
        }
    })
}

/// A set on another grid, at the nearest voxels, after it was moved in the patient.
pub(crate) fn on_grid(mask: &Mask, grid: &Grid, how: DAffine3) -> Mask {
    let mask_from_grid =
        mask.grid().voxel_from_patient() * how.inverse() * grid.patient_from_voxel();
    let end = as_position(mask.grid().size());
    let is_marked = |index: usize| {
        // Rounded by the conversion below: a call of `round` for each voxel took a fifth of the time of these tests.
        let place = mask_from_grid.transform_point3(as_position(grid.voxel(index))) + 0.5;
        let is_inside = place.cmpgt(DVec3::ZERO).all() && place.cmplt(end).all();
        is_inside && {
            let place = place.to_array().map(|along| along as usize);
            mask.voxels()[mask.grid().index(place)]
        }
    };
    let voxels = (0..grid.voxel_count()).map(is_marked).collect();
    Mask::new(grid.clone(), voxels).expect("one value for each voxel")
}

/// A mask on the voxels of a volume, moved about the volume's middle.
pub(crate) fn moved(mask: &Mask, volume: &Grid, how: DAffine3) -> Mask {
    let middle = middle(volume);
    let about = DAffine3::from_translation(middle) * how * DAffine3::from_translation(-middle);
    on_grid(mask, volume, about)
}

/// A mask without the voxels at which a condition holds (LPS mm, and as fractions of its bounds along L, P and S).
fn without(mask: &Mask, is_lost: impl Fn(DVec3, DVec3) -> bool) -> Mask {
    let [low, high] = bounds(mask);
    let grid = mask.grid().clone();
    let stays = |index: usize| {
        let place = grid
            .patient_from_voxel()
            .transform_point3(as_position(grid.voxel(index)));
        mask.voxels()[index] && !is_lost(place, (place - low) / (high - low))
    };
    let voxels = (0..grid.voxel_count()).map(stays).collect();
    Mask::new(grid, voxels).expect("the same grid")
}

/// A mask that somebody made for a head, by the head's own brain; the second value is whether it is right.
pub(crate) fn masks(volume: &Volume, brain: &BrainMask) -> Vec<(String, Mask, bool)> {
    let own = brain.mask();
    let grid = volume.grid();
    let edge_mm = own.grid().spacing_mm()[0];
    let grown = |mm: f64| offset(brain, mm).expect("a brain").mask().clone();
    let mut masks = Vec::new();
    let mut add = |what: &str, mask: Mask, is_right: bool| {
        masks.push((what.to_owned(), mask, is_right));
    };
    add("the network's own", own.clone(), true);
    if edge_mm <= 1.0 {
        add("made 2 mm smaller", grown(-2.0), true);
        add("made 2 mm larger", grown(2.0), true);
    }
    add("smoothed by 3 mm", smoothed(brain), true);
    add("in steps of 6 mm", in_steps(own), true);
    for mm in [4.0, 5.0, 8.0] {
        add(&format!("made {mm} mm smaller"), grown(-mm), false);
    }
    if edge_mm <= 1.0 {
        add("made 3 mm smaller", grown(-3.0), false);
    }
    for mm in [4.0, 8.0] {
        add(&format!("made {mm} mm larger"), grown(mm), false);
    }
    let [low, high] = bounds(own);
    for (face, mm) in [
        (Face::Inferior, 15.0),
        (Face::Inferior, 30.0),
        (Face::Inferior, 50.0),
        (Face::Superior, 15.0),
        (Face::Anterior, 20.0),
    ] {
        let outward = outward(face);
        let end = if outward.max_element() > 0.0 {
            high
        } else {
            low
        };
        let most = end.dot(outward) - mm;
        let cut = without(own, |place, _| place.dot(outward) > most);
        add(
            &format!("cut {mm} mm at the {} side", face.name()),
            cut,
            false,
        );
    }
    let middle_x = (low.x + high.x) / 2.0;
    let here = on_grid(own, grid, DAffine3::IDENTITY);
    let in_part = |mm: f64, is_there: &dyn Fn(DVec3) -> bool| {
        let other = grown(mm);
        let there = on_grid(&other, grid, DAffine3::IDENTITY);
        let voxel = |index: usize| {
            let place = as_position(grid.voxel(index));
            let is_there = is_there(grid.patient_from_voxel().transform_point3(place));
            [&here, &there][usize::from(is_there)].voxels()[index]
        };
        let voxels = (0..grid.voxel_count()).map(voxel).collect();
        Mask::new(grid.clone(), voxels).expect("one value for each voxel")
    };
    for mm in [4.0, -4.0] {
        let left = in_part(mm, &|place| place.x > middle_x);
        add(&format!("the left half {mm:+} mm"), left, false);
        let right = in_part(mm, &|place| place.x < middle_x);
        add(&format!("the right half {mm:+} mm"), right, false);
    }
    let middle_y = (low.y + high.y) / 2.0;
    add(
        "the front half 4 mm larger",
        in_part(4.0, &|place| place.y < middle_y),
        false,
    );
    let no_cerebellum = without(own, |_, share| share.y > 0.4 && share.z < 0.3);
    add("without cerebellum and stem", no_cerebellum, false);
    add("one half", without(own, |_, share| share.x > 0.5), false);
    let turned = |axis: DVec3, degrees: f64| {
        DAffine3::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians()))
    };
    let [left, behind, up] = DVec3::AXES;
    for (what, how) in [
        ("5 mm left", DAffine3::from_translation(left * 5.0)),
        ("5 mm in front", DAffine3::from_translation(behind * -5.0)),
        ("5 mm up", DAffine3::from_translation(up * 5.0)),
        ("10 mm left", DAffine3::from_translation(left * 10.0)),
        ("10 mm in front", DAffine3::from_translation(behind * -10.0)),
        ("15 mm up", DAffine3::from_translation(up * 15.0)),
        ("turned by 10° about S", turned(up, 10.0)),
        ("turned by 20° about P", turned(behind, 20.0)),
        ("turned by 30° about L", turned(left, 30.0)),
    ] {
        add(what, moved(own, grid, how), false);
    }
    for (what, axis) in [
        ("mirrored", left),
        ("flipped front to back", behind),
        ("upside down", up),
    ] {
        // As by a program that reverses the nearest axis of the volume.
        let (axis, _) = axis_towards(grid, axis);
        let along = DVec3::AXES[axis];
        let flip = DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::ONE - 2.0 * along),
            translation: along * (grid.size()[axis] - 1) as f64,
        };
        let flip = grid.patient_from_voxel() * flip * grid.voxel_from_patient();
        add(what, on_grid(own, grid, flip), false);
    }
    masks
}

/// The mask of another head, put where this head's is: its centre there, and if `is_scaled` its extents too.
pub(crate) fn of_another(
    other: &BrainMask,
    brain: &BrainMask,
    volume: &Grid,
    is_scaled: bool,
) -> Mask {
    let [low, high] = bounds(brain.mask());
    let [other_low, other_high] = bounds(other.mask());
    let scale = match is_scaled {
        true => (high - low) / (other_high - other_low),
        false => DVec3::ONE,
    };
    let how = DAffine3::from_translation((low + high) / 2.0)
        * DAffine3::from_scale(scale)
        * DAffine3::from_translation(-(other_low + other_high) / 2.0);
    on_grid(other.mask(), volume, how)
}

/// A brain without what is thinner than 3 mm, and without gaps narrower than that.
fn smoothed(brain: &BrainMask) -> Mask {
    let steps = [-1.5, 3.0, -1.5].map(|mm: f64| {
        // At least a voxel, or nothing changes.
        mm.signum() * mm.abs().max(brain.mask().grid().spacing_mm()[0])
    });
    let [first, back, last] = steps;
    let smaller = offset(brain, first).expect("a brain");
    let larger = offset(&smaller, back.max(2.0 * first.abs())).expect("a brain");
    offset(&larger, last).expect("a brain").mask().clone()
}

/// A mask that was drawn on every 6th millimetre.
fn in_steps(mask: &Mask) -> Mask {
    let grid = mask.grid().clone();
    let steps = (6.0 / grid.spacing_mm()[2]).round() as usize;
    let last = grid.size()[2] - 1;
    let drawn = |index: usize| {
        let [x, y, z] = grid.voxel(index);
        let slice = ((z + steps / 2) / steps * steps).min(last);
        mask.voxels()[grid.index([x, y, slice])]
    };
    let voxels = (0..grid.voxel_count()).map(drawn).collect();
    Mask::new(grid, voxels).expect("the same grid")
}
