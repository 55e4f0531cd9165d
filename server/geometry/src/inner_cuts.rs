//! Faces of the field of view within a volume: planes beyond which its voxels are exactly constant.
//!
//! A slab that was resampled into a larger box, or a head whose face was removed, ends there as at a face of the volume.
//! Around a brain without its skull the voxels are constant too, but its surface is curved: a plane counts only if far
//! more of the surface lies on it than just below it.

use glam::DVec3;

use crate::{BrainCuts, BrainMask, Cut, Face, Volume};

/// The greatest distance between the end of the brain and the constant voxels, in mm and in native voxels: the greater
/// applies. Masks end up to this far before or beyond the plane.
const NEAR_MM: f64 = 4.0;
const NEAR_VOXELS: usize = 2;

/// The least depth of constant voxels, in mm. Bone is thinner, and the air around a head mostly noisy.
const LEAST_CONSTANT_MM: f64 = 10.0;

/// The least area of a plane, in cm².
const LEAST_CM2: f64 = 5.0;

/// How many times more of the surface must lie on a plane, beside constant voxels, than faces the same way in a layer of the same
/// thickness just below it, beside whatever: on a ball there is as much.
const LEAST_FLATNESS: f64 = 2.5;

/// The greatest angle between a plane and the voxels, as the cosine: 30°.
const LEAST_COSINE: f64 = 0.866;

/// How many planes through three points are tried.
const TRIALS: u32 = 400;

/// The fraction of the surface on a plane that the cut is moved inwards to reach, if the mask ends before the plane.
const REACHED: f64 = 0.9;

/// A plane within a volume that cuts the brain.
#[derive(Debug, Clone, Copy, PartialEq)]
struct InnerCut {
    cut: Cut,
    area_cm2: f64,
}

impl BrainMask {
    /// The faces of the field of view that cut the brain: those of the volume, and those of a smaller field of view within it.
    pub fn cut_by(&self, volume: &Volume) -> BrainCuts {
        let mut cuts = self.cuts(volume.grid());
        let mut area_cm2 = self.cut_area_cm2(volume.grid());
        for inner in inner_cuts(self, volume) {
            if cuts.iter().all(|cut| cut.face != inner.cut.face) {
                cuts.push(inner.cut);
                area_cm2[inner.cut.face as usize] += inner.area_cm2;
            }
        }
        BrainCuts { cuts, area_cm2 }
    }
}

/// The planes of constant voxels that cut a brain; at most one for each face.
fn inner_cuts(brain: &BrainMask, volume: &Volume) -> Vec<InnerCut> {
    let sides = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
    let mut found: Vec<InnerCut> = Vec::new();
    for (axis, is_at_end) in sides {
        let Some(one) = Side::new(brain, volume, axis, is_at_end).cut() else {
            continue;
        };
        match found
            .iter_mut()
            .find(|other| other.cut.face == one.cut.face)
        {
            Some(other) if other.area_cm2 < one.area_cm2 => *other = one,
            Some(_) => {}
            None => found.push(one),
        }
    }
    found
}

/// A place where the surface of a brain faces constant voxels.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Between the last voxel that differs and the first constant one, LPS mm.
    position: DVec3,
    /// How far before it the mask ends, in mm; negative if the mask ends beyond it.
    gap_mm: f64,
}

/// The surface of a brain towards one side of the volume.
struct Side<'a> {
    brain: &'a BrainMask,
    volume: &'a Volume,
    /// The native axis and its sense.
    axis: usize,
    is_at_end: bool,
    /// The unit vector out of the volume, LPS.
    outward: DVec3,
    /// The axis of the working grid that is nearest to it.
    along: usize,
}

impl<'a> Side<'a> {
    fn new(brain: &'a BrainMask, volume: &'a Volume, axis: usize, is_at_end: bool) -> Self {
        let column = volume.grid().patient_from_voxel().matrix3.col(axis);
        let outward = column.normalize() * if is_at_end { 1.0 } else { -1.0 };
        Self {
            brain,
            volume,
            axis,
            is_at_end,
            outward,
            along: outward.abs().max_position(),
        }
    }

    /// The cut on this side.
    fn cut(&self) -> Option<InnerCut> {
        let border = self.border();
        let places: Vec<Place> = border
            .iter()
            .filter_map(|&centre| self.place(centre))
            .collect();
        if self.area_cm2(places.len(), self.outward) < LEAST_CM2 {
            return None;
        }
        let half_mm = self.half_thickness_mm();
        let plane = self.best_plane(&places, half_mm)?;
        let on_plane: Vec<Place> = within(&places, &plane, -half_mm..half_mm).collect();
        let area_cm2 = self.area_cm2(on_plane.len(), plane.outward);
        let mut gaps: Vec<f64> = on_plane.iter().map(|place| place.gap_mm).collect();
        gaps.sort_by(f64::total_cmp);
        let gap_mm = gaps[((gaps.len() - 1) as f64 * REACHED) as usize].max(0.0);
        // The layer below that where the mask ends, in which a curved surface has as much.
        let middle_mm = gaps[gaps.len() / 2];
        let below_mm = -4.0 * half_mm - middle_mm..-2.0 * half_mm - middle_mm;
        let is_below =
            |centre: &&DVec3| below_mm.contains(&(plane.outward.dot(**centre) - plane.offset_mm));
        let below = border.iter().filter(is_below).count();
        let is_flat = on_plane.len() as f64 >= LEAST_FLATNESS * below as f64;
        if area_cm2 < LEAST_CM2 || !is_flat {
            return None;
        }
        Some(InnerCut {
            cut: Cut {
                face: Face::towards(plane.outward),
                inward: -plane.outward,
                offset_mm: gap_mm - plane.offset_mm,
            },
            area_cm2,
        })
    }

    /// Half the thickness of the layer that counts as a plane: a plane that is oblique to the voxels is a staircase.
    fn half_thickness_mm(&self) -> f64 {
        0.55 * self.volume.grid().spacing_mm()[self.axis]
    }

    /// The area of so many places on a plane.
    fn area_cm2(&self, count: usize, outward: DVec3) -> f64 {
        let edge_mm = self.brain.mask().grid().spacing_mm()[0];
        count as f64 * edge_mm * edge_mm / outward[self.along].abs() / 100.0
    }

    /// The centres of the border voxels of the brain that face this side, LPS mm.
    fn border(&self) -> Vec<DVec3> {
        let mask = self.brain.mask();
        let grid = mask.grid();
        let [nx, ny, _] = grid.size();
        let stride = [1, nx, nx * ny][self.along] as isize;
        let step = if self.outward[self.along] > 0.0 {
            stride
        } else {
            -stride
        };
        let faces_out = |index: usize| {
            // A brain mask does not touch the faces of its grid.
            mask.voxels()[index] && !mask.voxels()[index.wrapping_add_signed(step)]
        };
        let voxels = (0..mask.voxels().len()).filter(|&index| faces_out(index));
        let centre = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            grid.patient_from_voxel().transform_point3(voxel)
        };
        voxels.map(centre).collect()
    }

    /// The place that a border voxel of the brain faces, if there are constant voxels.
    fn place(&self, centre: DVec3) -> Option<Place> {
        let working = self.brain.mask().grid();
        let native = self.volume.grid();
        let at = native.voxel_from_patient().transform_point3(centre);
        let nearest = at.round();
        let last = DVec3::from_array(native.size().map(|side| (side - 1) as f64));
        if nearest.cmplt(DVec3::ZERO).any() || nearest.cmpgt(last).any() {
            return None;
        }
        let column = Column::new(self, nearest.to_array().map(|place| place as usize));
        let end = column.end_near(self.near_voxels())?;
        let between = end as f64 + if self.is_at_end { 0.5 } else { -0.5 };
        let mut there = at;
        there[self.axis] = between;
        let position = native.patient_from_voxel().transform_point3(there);
        let edge_mm = working.spacing_mm()[0];
        Some(Place {
            position,
            gap_mm: (position - centre).dot(self.outward) - edge_mm / 2.0,
        })
    }

    fn near_voxels(&self) -> usize {
        let spacing_mm = self.volume.grid().spacing_mm()[self.axis];
        NEAR_VOXELS.max((NEAR_MM / spacing_mm).ceil() as usize)
    }

    /// The plane with the most places, within 30° of this side.
    fn best_plane(&self, places: &[Place], half_mm: f64) -> Option<Plane> {
        let mut random = 1u32;
        let mut pick = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            places[(random >> 8) as usize % places.len()].position
        };
        let through_voxels = (0..TRIALS / 8).map(|_| Some(self.outward));
        let through_three = (TRIALS / 8..TRIALS).map(|_| None);
        let planes = through_voxels
            .chain(through_three)
            .filter_map(|known: Option<DVec3>| {
                let point = pick();
                let outward = known.or_else(|| {
                    let normal = (pick() - point).cross(pick() - point).try_normalize()?;
                    Some(normal * normal.dot(self.outward).signum())
                })?;
                let is_near = outward.dot(self.outward) >= LEAST_COSINE;
                is_near.then(|| Plane {
                    outward,
                    offset_mm: outward.dot(point),
                })
            });
        // Every so many places are enough to choose.
        let sample: Vec<Place> = places
            .iter()
            .step_by(places.len().div_ceil(2000))
            .copied()
            .collect();
        let count = |plane: &Plane| within(&sample, plane, -half_mm..half_mm).count();
        planes.max_by_key(|plane| count(plane))
    }
}

/// The native voxels along the axis of a side, through a voxel.
struct Column<'a> {
    voxels: &'a [u16],
    first: usize,
    stride: usize,
    count: usize,
    start: usize,
    is_at_end: bool,
    least_constant: usize,
}

impl<'a> Column<'a> {
    fn new(side: &Side<'a>, voxel: [usize; 3]) -> Self {
        let grid = side.volume.grid();
        let [nx, ny, _] = grid.size();
        let mut first = voxel;
        first[side.axis] = 0;
        Self {
            voxels: side.volume.voxels(),
            first: grid.index(first),
            stride: [1, nx, nx * ny][side.axis],
            count: grid.size()[side.axis],
            start: voxel[side.axis],
            is_at_end: side.is_at_end,
            least_constant: (LEAST_CONSTANT_MM / grid.spacing_mm()[side.axis]).ceil() as usize,
        }
    }

    /// The stored value so many voxels outwards from the start; `None` outside the volume.
    fn value(&self, outwards: isize) -> Option<u16> {
        let place = self.place(outwards)?;
        Some(self.voxels[self.first + self.stride * place])
    }

    fn place(&self, outwards: isize) -> Option<usize> {
        let step = if self.is_at_end { outwards } else { -outwards };
        let place = self.start.checked_add_signed(step)?;
        (place < self.count).then_some(place)
    }

    /// The last voxel before constant ones, at most `near` voxels from the start: the nearest.
    fn end_near(&self, near: usize) -> Option<usize> {
        let near = near as isize;
        let mut ends: Vec<isize> = (-near..=near).collect();
        ends.sort_by_key(|outwards| outwards.abs());
        let end = ends.into_iter().find(|&outwards| self.ends_at(outwards))?;
        self.place(end)
    }

    /// Whether the voxels after one are constant, and differ from it.
    fn ends_at(&self, outwards: isize) -> bool {
        let (Some(here), Some(next)) = (self.value(outwards), self.value(outwards + 1)) else {
            return false;
        };
        let mut run = outwards + 1..=outwards + self.least_constant as isize;
        here != next && run.all(|place| self.value(place) == Some(next))
    }
}

/// A plane: the points `p` with `outward · p = offset_mm`.
struct Plane {
    outward: DVec3,
    offset_mm: f64,
}

/// The places in a layer along a plane, by their distances beyond it in mm.
fn within<'a>(
    places: &'a [Place],
    plane: &Plane,
    layer_mm: std::ops::Range<f64>,
) -> impl Iterator<Item = Place> + 'a {
    let (outward, offset_mm) = (plane.outward, plane.offset_mm);
    let is_in = move |place: &&Place| layer_mm.contains(&(outward.dot(place.position) - offset_mm));
    places.iter().filter(is_in).copied()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};

    use super::*;
    use crate::{Grid, Mask, Rescale, phantom};

    const SPACING_MM: f64 = 2.0;

    /// A noisy head around an ellipsoid of a brain, in a volume that may be oblique to the patient; voxels in which `is_lost` (LPS mm)
    /// are 0, and so are all voxels around the brain if it is bare.
    fn head(turn: DMat3, is_bare: bool, is_lost: impl Fn(DVec3) -> bool) -> (Volume, BrainMask) {
        let size = [100, 110, 96];
        let matrix3 = turn * SPACING_MM;
        let middle = matrix3 * DVec3::from_array(size.map(|side| (side - 1) as f64 / 2.0));
        let affine = DAffine3 {
            matrix3,
            translation: -middle,
        };
        let grid = Grid::new(size, affine).unwrap();
        let place = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
            affine.transform_point3(voxel)
        };
        let is_brain = |at: DVec3| (at / DVec3::new(66.0, 84.0, 60.0)).length() < 1.0;
        let value = |index: usize| {
            let at = place(index);
            let noise = (index as u32).wrapping_mul(2_654_435_761) >> 26;
            match is_lost(at) || (is_bare && !is_brain(at)) {
                true => 0,
                false if is_brain(at) => 600 + noise as u16,
                false => 20 + noise as u16,
            }
        };
        let voxels = (0..grid.voxel_count()).map(value).collect();
        let brain = (0..grid.voxel_count())
            .map(|index| is_brain(place(index)) && !is_lost(place(index)))
            .collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let mask = Mask::new(grid.clone(), brain).unwrap();
        let brain = BrainMask::from_mask(&mask, &grid).unwrap();
        (Volume::new(grid, voxels, rescale).unwrap(), brain)
    }

    fn faces(cuts: &[InnerCut]) -> Vec<Face> {
        cuts.iter().map(|one| one.cut.face).collect()
    }

    #[test]
    fn zeros_beyond_a_plane_are_a_face_on_each_side() {
        for (face, direction) in Face::ALL.into_iter().zip([
            DVec3::X,
            -DVec3::X,
            DVec3::Y,
            -DVec3::Y,
            DVec3::Z,
            -DVec3::Z,
        ]) {
            let (volume, brain) = head(DMat3::IDENTITY, false, |at| at.dot(direction) > 41.0);
            let cuts = inner_cuts(&brain, &volume);
            assert_eq!(faces(&cuts), [face]);
            assert!((cuts[0].cut.inward + direction).length() < 1e-9);
            assert!(
                (cuts[0].cut.offset_mm + 41.0).abs() < SPACING_MM,
                "{cuts:?}"
            );
            assert!(cuts[0].area_cm2 > 50.0, "{cuts:?}");
        }
    }

    #[test]
    fn the_plane_may_lean_and_the_volume_too() {
        for (turn, lean) in [(0.0, 0.2f64), (0.1, 0.0), (-0.15, 0.3)] {
            let direction = DMat3::from_rotation_x(lean) * DVec3::Z;
            let turn = DMat3::from_rotation_x(turn) * DMat3::from_rotation_y(turn / 2.0);
            let (volume, brain) = head(turn, false, |at| at.dot(direction) > 35.0);
            let cuts = inner_cuts(&brain, &volume);
            assert_eq!(faces(&cuts), [Face::Superior]);
            let off = (-cuts[0].cut.inward).angle_between(direction).to_degrees();
            assert!(off < 2.0, "{off}° {lean}");
            assert!(
                (cuts[0].cut.offset_mm + 35.0).abs() < 1.5 * SPACING_MM,
                "{cuts:?}"
            );
        }
    }

    #[test]
    fn a_whole_brain_is_not_cut_bare_or_not() {
        for is_bare in [false, true] {
            let (volume, brain) = head(DMat3::IDENTITY, is_bare, |_| false);
            assert_eq!(inner_cuts(&brain, &volume), []);
            // Zeros far from the brain are no cut.
            let (volume, brain) = head(DMat3::IDENTITY, is_bare, |at| at.z < -75.0);
            assert_eq!(inner_cuts(&brain, &volume), []);
        }
        // A bare brain that was cut is.
        let (volume, brain) = head(DMat3::IDENTITY, true, |at| at.z < -35.0);
        assert_eq!(faces(&inner_cuts(&brain, &volume)), [Face::Inferior]);
        let bare = phantom::head(4.0);
        let brain = BrainMask::from_mask(&bare.brain, bare.brain.grid()).unwrap();
        assert_eq!(inner_cuts(&brain, &bare.volume), []);
    }
}
