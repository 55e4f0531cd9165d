//! Continues a brain beyond the faces of the volume that cut it.
//!
//! On each face the outline of the cut is found, without the sulci that it opens, and a second outline slightly deeper
//! in the brain. Beyond the face the outline is extrapolated linearly from the two: a straight wall stays straight, a
//! cone stays a cone, and there is no corner at the face for the closing to fill.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::grid::as_position;
use crate::runs::fill_holes;
use crate::transform::{MAX_DISTANCE, transformed};
use crate::{BrainMask, Cut, GeometryError, Grid, Mask};

/// The greatest distance by which a brain is continued beyond a face, in mm; otherwise twice the radius of the closing,
/// which no ball exceeds.
const MOST_MM: f64 = 60.0;

/// The depth of the second outline below the face, in mm and in voxels: the greater applies.
const DEEPER_MM: f64 = 5.0;
const DEEPER_VOXELS: f64 = 4.0;

/// The depth of the first outline below the face, in voxels.
const AT_FACE_VOXELS: f64 = 0.75;

/// The greatest distance from an outline that matters, in mm.
const FARTHEST_MM: f64 = 40.0;

/// The inset of the continued brain from its outline, in voxels: steps of the outline must not protrude, or the closing
/// would fill the corners beside them.
const WITHIN_VOXELS: f64 = 1.0;

/// The greatest widening of an outline per millimetre beyond the face.
const STEEPEST_WIDENING: f64 = 1.0;

/// A brain on a grid with room beyond the cuts.
#[derive(Debug)]
pub(crate) struct Extended {
    mask: Mask,
    /// The first voxel of the working grid in this one.
    first: [usize; 3],
    working: Grid,
}

impl Extended {
    /// Continues a brain beyond its cuts, as far as the closing reaches.
    pub(crate) fn new(
        brain: &BrainMask,
        closing_radius_mm: f64,
        cuts: &[Cut],
    ) -> Result<Self, GeometryError> {
        let working = brain.mask().grid().clone();
        let reach_mm = (2.0 * closing_radius_mm).min(MOST_MM) + working.spacing_mm()[0];
        let [before, after] = room(&working, reach_mm, cuts);
        let size = [0, 1, 2].map(|axis| before[axis] + working.size()[axis] + after[axis]);
        let block = brain
            .mask()
            .block(before.map(|voxels| -(voxels as i64)), size)?;
        let mut extended = Self {
            mask: block,
            first: before,
            working,
        };
        for cut in cuts {
            if let Some(outlines) = Outlines::new(&extended.mask, cut, closing_radius_mm) {
                extended.mask = outlines.continued(&extended.mask, reach_mm)?;
            }
        }
        Ok(extended)
    }

    /// The brain, with its continuation beyond the cuts.
    pub(crate) fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The part of a set on this grid that lies on the working grid, not on its faces, and before all cuts.
    pub(crate) fn cropped(&self, set: &Mask, cuts: &[Cut]) -> Vec<bool> {
        let size = self.working.size();
        let patient_from_voxel = self.working.patient_from_voxel();
        let is_kept = |index: usize| {
            let voxel = self.working.voxel(index);
            let there = [0, 1, 2].map(|axis| voxel[axis] + self.first[axis]);
            let is_inner = (0..3).all(|axis| 0 < voxel[axis] && voxel[axis] + 1 < size[axis]);
            is_inner && set.voxels()[set.grid().index(there)] && {
                let position = patient_from_voxel.transform_point3(as_position(voxel));
                cuts.iter().all(|cut| cut.distance_mm(position) > -1e-6)
            }
        };
        (0..self.working.voxel_count())
            .into_par_iter()
            .map(is_kept)
            .collect()
    }
}

/// The number of voxels added before and after the working grid along each axis.
fn room(working: &Grid, reach_mm: f64, cuts: &[Cut]) -> [[usize; 3]; 2] {
    let mut room = [[0; 3]; 2];
    for cut in cuts {
        for (axis, inward) in cut.inward.to_array().into_iter().enumerate() {
            let outward = -inward;
            let voxels = (outward.abs() * reach_mm / working.spacing_mm()[0]).ceil() as usize;
            let side = &mut room[usize::from(outward > 0.0)][axis];
            // An oblique face extends beyond the sides of the grid by less than this.
            *side = voxels.max(*side);
        }
    }
    room
}

/// The outlines of a brain on a face that cuts it and deeper, as signed distances in voxels: positive inside.
struct Outlines<'a> {
    cut: &'a Cut,
    plane: Plane,
    at_face: Vec<f32>,
    deeper: Vec<f32>,
    /// Their depths below the face, in mm.
    depths_mm: [f64; 2],
}

/// A lattice along a face.
struct Plane {
    /// A point on the face, LPS mm.
    origin: DVec3,
    across: [DVec3; 2],
    size: [usize; 2],
    pitch_mm: f64,
}

impl Plane {
    /// A lattice that covers the projection of a grid onto a face, with a margin. On a face along the axes of the grid,
    /// it meets voxel centres.
    fn new(grid: &Grid, cut: &Cut, margin: usize) -> Self {
        let pitch_mm = grid.spacing_mm()[0];
        let normal = cut.inward.abs().max_position();
        let along = [0, 1, 2].map(|axis| DVec3::AXES[axis]);
        let others = [(normal + 1) % 3, (normal + 2) % 3];
        let first = (along[others[0]] - cut.inward * cut.inward[others[0]]).normalize();
        let across = [first, cut.inward.cross(first)];
        let start = grid.patient_from_voxel().translation;
        let start = start - cut.inward * cut.distance_mm(start);
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        for corner in 0..8 {
            let voxel = [0, 1, 2].map(|axis| (grid.size()[axis] - 1) * (corner >> axis & 1));
            let corner = grid
                .patient_from_voxel()
                .transform_point3(as_position(voxel));
            let place = DVec2::from_array(across.map(|axis| (corner - start).dot(axis)));
            low = low.min(place);
            high = high.max(place);
        }
        let margin = margin as f64;
        let low = (low / pitch_mm).round() - margin;
        let high = (high / pitch_mm).round() + margin;
        let origin = start + (across[0] * low.x + across[1] * low.y) * pitch_mm;
        let size = (high - low + 1.0).to_array().map(|side| side as usize);
        Self {
            origin,
            across,
            size,
            pitch_mm,
        }
    }

    /// The section of a set at a depth below the face.
    fn section(&self, set: &Mask, inward: DVec3, depth_mm: f64) -> Vec<bool> {
        let [width, height] = self.size;
        let voxel_from_patient = set.grid().voxel_from_patient();
        let at = |index: usize| {
            let [u, v] = [index % width, index / width].map(|place| place as f64 * self.pitch_mm);
            let position =
                self.origin + self.across[0] * u + self.across[1] * v + inward * depth_mm;
            set.contains(voxel_from_patient.transform_point3(position))
        };
        (0..width * height).into_par_iter().map(at).collect()
    }

    /// The lattice coordinates of a position.
    fn place(&self, position: DVec3) -> DVec2 {
        let from_origin = position - self.origin;
        DVec2::from_array(self.across.map(|axis| from_origin.dot(axis))) / self.pitch_mm
    }

    /// Values of the lattice between its points; `None` beyond it.
    fn between(&self, values: &[f32], place: DVec2) -> Option<f64> {
        let [width, height] = self.size;
        let last = DVec2::new((width - 1) as f64, (height - 1) as f64);
        if place.cmplt(DVec2::ZERO).any() || place.cmpge(last).any() {
            return None;
        }
        let (first, part) = (place.floor(), place - place.floor());
        let start = first.x as usize + width * first.y as usize;
        let value = |offset: usize| f64::from(values[start + offset]);
        let row = |offset: usize| value(offset) * (1.0 - part.x) + value(offset + 1) * part.x;
        Some(row(0) * (1.0 - part.y) + row(width) * part.y)
    }
}

impl<'a> Outlines<'a> {
    /// The outlines of a set; `None` if nothing of it lies on the face.
    fn new(set: &Mask, cut: &'a Cut, closing_radius_mm: f64) -> Option<Self> {
        let voxel_mm = set.grid().spacing_mm()[0];
        let radius = closing_radius_mm / voxel_mm;
        let plane = Plane::new(set.grid(), cut, radius.ceil() as usize + 2);
        let at_face_mm = AT_FACE_VOXELS * voxel_mm;
        let depths_mm = [
            at_face_mm,
            at_face_mm + DEEPER_MM.max(DEEPER_VOXELS * voxel_mm),
        ];
        let farthest = (FARTHEST_MM / voxel_mm).min(f64::from(MAX_DISTANCE)) as u8;
        let [at_face, deeper] = depths_mm.map(|depth_mm| plane.section(set, cut.inward, depth_mm));
        if !at_face.contains(&true) {
            return None;
        }
        let [at_face, deeper] = [at_face, deeper].map(|section| {
            signed_distance(plane.size, &outline(plane.size, &section, radius), farthest)
        });
        Some(Self {
            cut,
            plane,
            at_face,
            deeper,
            depths_mm,
        })
    }

    /// The set, continued beyond the face.
    fn continued(&self, set: &Mask, reach_mm: f64) -> Result<Mask, GeometryError> {
        let grid = set.grid();
        let patient_from_voxel = grid.patient_from_voxel();
        let goes_on = |index: usize| {
            let position = patient_from_voxel.transform_point3(as_position(grid.voxel(index)));
            let beyond_mm = -self.cut.distance_mm(position);
            (0.0..=reach_mm).contains(&beyond_mm) && self.holds(position, beyond_mm)
        };
        let voxels = set.voxels().par_iter().enumerate();
        let voxels = voxels.map(|(index, &is_set)| is_set || goes_on(index));
        Mask::new(grid.clone(), voxels.collect())
    }

    fn holds(&self, position: DVec3, beyond_mm: f64) -> bool {
        let place = self.plane.place(position);
        let between = |values| self.plane.between(values, place);
        let (Some(at_face), Some(deeper)) = (between(&self.at_face), between(&self.deeper)) else {
            return false;
        };
        let [face_mm, deeper_mm] = self.depths_mm;
        let most = STEEPEST_WIDENING / self.plane.pitch_mm;
        let widening = ((at_face - deeper) / (deeper_mm - face_mm)).min(most);
        at_face + widening * (beyond_mm + face_mm) >= WITHIN_VOXELS
    }
}

/// A section closed by a disc, without holes: its outline without sulci.
fn outline([width, height]: [usize; 2], section: &[bool], radius: f64) -> Vec<bool> {
    let bound = radius.floor() as u8 + 1;
    let within = (radius * radius).floor() as u16;
    let size = [width, height, 1];
    let mut to_set = bounds(section, true, bound);
    let mut to_rest = transformed(size, &mut to_set, 0, |squared| {
        if squared <= within { bound } else { 0 }
    });
    let closed = transformed(size, &mut to_rest, 0, |squared| squared > within);
    // Between two full planes, a hole of the section is a hole of the block.
    let full = vec![true; closed.len()];
    let mut block = [&full[..], &closed, &full].concat();
    fill_holes([width, height, 3], &mut block);
    block[closed.len()..2 * closed.len()].to_vec()
}

/// Distances to the border of a section, which lies between its voxels, up to `farthest` voxels: positive inside.
fn signed_distance([width, height]: [usize; 2], section: &[bool], farthest: u8) -> Vec<f32> {
    let size = [width, height, 1];
    let distance = |value: bool| {
        let mut bounds = bounds(section, value, farthest);
        transformed(size, &mut bounds, 0, |squared| f32::from(squared).sqrt())
    };
    let pairs = distance(false).into_iter().zip(distance(true));
    pairs
        .map(|(to_rest, to_set)| {
            if to_set == 0.0 {
                to_rest - 0.5
            } else {
                0.5 - to_set
            }
        })
        .collect()
}

/// Bounds of the distances to the pixels of a section that equal `value`.
fn bounds(section: &[bool], value: bool, bound: u8) -> Vec<u8> {
    let bound = |&is_set: &bool| if is_set == value { 0 } else { bound };
    section.iter().map(bound).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Cut, DistanceMap, Face, cut_envelope, distance_map, envelope, phantom};

    /// A head with only a block of its grid in the field of view, and its brain cut accordingly.
    fn cut_brain(mask: &Mask, field: &Grid) -> (BrainMask, Vec<Cut>) {
        let field_from_voxel = field.voxel_from_patient() * mask.grid().patient_from_voxel();
        let is_seen = |index: usize| {
            field.contains(field_from_voxel.transform_point3(as_position(mask.grid().voxel(index))))
        };
        let voxels = (0..mask.voxels().len()).map(|index| mask.voxels()[index] && is_seen(index));
        let seen = Mask::new(mask.grid().clone(), voxels.collect()).unwrap();
        let brain = BrainMask::from_mask(&seen, field).unwrap();
        let cuts = brain.cuts(field);
        (brain, cuts)
    }

    /// A grid without the part within `mm` of the bounds of a mask at a face.
    fn without(mask: &Mask, face: Face, mm: f64) -> Grid {
        let grid = mask.grid();
        let number = Face::ALL.iter().position(|&other| other == face).unwrap();
        let [first, last] = mask.bounds().unwrap();
        let axis = number / 2;
        let voxels = (mm / grid.spacing_mm()[axis]).round() as usize;
        let mut start = [0; 3];
        let mut size = grid.size();
        if number % 2 == 0 {
            size[axis] = last[axis] + 1 - voxels;
        } else {
            start[axis] = (first[axis] + voxels) as i64;
            size[axis] -= first[axis] + voxels;
        }
        grid.block(start, size).unwrap()
    }

    /// Compares the depths of a cut brain with those of the whole one: the number of known depths, and their
    /// differences in mm.
    fn differences(whole: &DistanceMap, cut: &DistanceMap, cuts: &[Cut]) -> Vec<f64> {
        let voxel_mm = whole.grid().spacing_mm()[0];
        let whole_from_cut = whole.grid().voxel_from_patient() * cut.grid().patient_from_voxel();
        let mut differences = Vec::new();
        for index in 0..cut.grid().voxel_count() {
            let voxel = as_position(cut.grid().voxel(index));
            let position = cut.grid().patient_from_voxel().transform_point3(voxel);
            let there = whole_from_cut.transform_point3(voxel).round();
            let last = as_position(whole.grid().size().map(|side| side - 1));
            if there.cmplt(DVec3::ZERO).any() || there.cmpgt(last).any() {
                assert!(cut.depth_mm(index).is_none());
                continue;
            }
            let there = whole
                .grid()
                .index(there.to_array().map(|place| place as usize));
            let Some(truth_mm) = whole.depth_mm(there).map(f64::from) else {
                continue;
            };
            // The remaining dura is nearer than the cut.
            let is_nearer = cuts
                .iter()
                .all(|cut| cut.distance_mm(position) >= truth_mm + 2.0 * voxel_mm);
            match cut.depth_mm(index).map(f64::from) {
                Some(depth_mm) if cut.is_known(index) => {
                    differences.push((depth_mm - truth_mm).abs());
                }
                depth_mm => assert!(!is_nearer, "{position}: {depth_mm:?} mm for {truth_mm} mm"),
            }
        }
        differences
    }

    fn worst(differences: &[f64]) -> f64 {
        differences.iter().copied().fold(0.0, f64::max)
    }

    #[test]
    fn a_brain_cut_at_any_face_has_the_depths_of_the_whole_one_where_dura_is_nearer() {
        let whole_brain = phantom::ellipsoid([35.0, 43.0, 33.0], 2.0);
        let whole = distance_map(&envelope(&whole_brain, 10.0).unwrap());
        for face in Face::ALL {
            for mm in [6.0, 20.0, 50.0] {
                let field = without(whole_brain.mask(), face, mm);
                let (brain, cuts) = cut_brain(whole_brain.mask(), &field);
                assert_eq!(cuts.iter().map(|cut| cut.face).collect::<Vec<_>>(), [face]);
                let cut = distance_map(&cut_envelope(&brain, 10.0, &cuts).unwrap());
                let found = differences(&whole, &cut, &cuts);
                let name = face.name();
                println!(
                    "{name} {mm}: {} known, {:.2} mm",
                    found.len(),
                    worst(&found)
                );
                assert!(found.len() > 1000, "{name} {mm}: {}", found.len());
                assert!(worst(&found) <= 0.5, "{name} {mm}: {}", worst(&found));
                let unknown = (0..cut.inside().len())
                    .filter(|&index| cut.inside()[index] && !cut.is_known(index));
                assert!(unknown.count() > 100, "{name} {mm}");
            }
        }
    }

    #[test]
    fn sulci_that_a_face_opens_are_closed_as_in_the_whole_head() {
        let head = phantom::head(2.0);
        let whole_brain = BrainMask::from_mask(&head.brain, head.brain.grid()).unwrap();
        let whole = distance_map(&envelope(&whole_brain, 10.0).unwrap());
        for face in Face::ALL {
            let field = without(&head.brain, face, 30.0);
            let (brain, cuts) = cut_brain(&head.brain, &field);
            let cut = distance_map(&cut_envelope(&brain, 10.0, &cuts).unwrap());
            let mut found = differences(&whole, &cut, &cuts);
            found.sort_by(f64::total_cmp);
            let most = found[found.len() * 999 / 1000];
            println!(
                "{}: {most:.2} mm, at most {:.2} mm",
                face.name(),
                worst(&found)
            );
            assert!(most <= 0.5, "{}: {most}", face.name());
        }
    }

    #[test]
    fn two_cuts_and_an_oblique_field_of_view_are_no_dura_either() {
        let whole_brain = phantom::ellipsoid([35.0, 43.0, 33.0], 2.0);
        let whole = distance_map(&envelope(&whole_brain, 10.0).unwrap());
        let mask = whole_brain.mask();
        let both = without(mask, Face::Inferior, 24.0);
        let edge = without(mask, Face::Posterior, 16.0);
        let both = both
            .block([0; 3], [both.size()[0], edge.size()[1], both.size()[2]])
            .unwrap();
        let turned = {
            let turn = glam::DMat3::from_rotation_x(0.2) * glam::DMat3::from_rotation_y(-0.1);
            let matrix3 = turn * 2.0;
            let size = [90, 100, 56];
            let middle = matrix3 * as_position(size.map(|side| side / 2));
            let translation = DVec3::new(0.0, 0.0, 30.0) - middle;
            Grid::new(
                size,
                glam::DAffine3 {
                    matrix3,
                    translation,
                },
            )
            .unwrap()
        };
        for (field, faces, most_mm) in [
            (both, vec![Face::Posterior, Face::Inferior], 0.5),
            (turned, vec![Face::Inferior], 1.5),
        ] {
            let (brain, cuts) = cut_brain(mask, &field);
            assert_eq!(cuts.iter().map(|cut| cut.face).collect::<Vec<_>>(), faces);
            let cut = distance_map(&cut_envelope(&brain, 10.0, &cuts).unwrap());
            let mut found = differences(&whole, &cut, &cuts);
            found.sort_by(f64::total_cmp);
            let usual = found[found.len() * 99 / 100];
            println!("{faces:?}: {usual:.2} mm, at most {:.2} mm", worst(&found));
            assert!(
                usual <= 0.5 && worst(&found) <= most_mm,
                "{}",
                worst(&found)
            );
        }
    }

    #[test]
    fn a_brain_that_ends_before_the_faces_is_not_cut() {
        let brain = phantom::ellipsoid([20.0, 24.0, 18.0], 1.5);
        let mask = brain.mask();
        assert_eq!(brain.cuts(mask.grid()), []);
        let whole = envelope(&brain, 10.0).unwrap();
        assert_eq!(cut_envelope(&brain, 10.0, &[]).unwrap(), whole);
    }

    #[test]
    fn a_volume_that_is_all_brain_has_no_known_depth() {
        let grid = Grid::aligned([20, 18, 16], [1.0; 3], DVec3::ZERO).unwrap();
        let mask = Mask::new(grid.clone(), vec![true; grid.voxel_count()]).unwrap();
        let brain = BrainMask::from_mask(&mask, &grid).unwrap();
        let cuts = brain.cuts(&grid);
        assert_eq!(cuts.len(), 6);
        let distance = distance_map(&cut_envelope(&brain, 10.0, &cuts).unwrap());
        assert!((distance.envelope().volume_ml() - 20.0 * 18.0 * 16.0 / 1000.0).abs() < 1e-9);
        assert!(
            (0..distance.inside().len())
                .all(|index| !distance.inside()[index] || !distance.is_known(index))
        );
    }
}
