//! The parts of a brain that have surfaces of their own, on the working grid.

use geometry::{
    BrainMask, Cut, Envelope, GeometryError, Grid, Mask, block_of, cut_envelope, face_neighbours,
    flood,
};
use glam::DVec3;
use rayon::prelude::*;

use super::{Region, RegionDoubt, Regions, Sheet, TISSUE_FROM, regions};
use crate::block::Block;
use crate::tissue::tissue_of;
use crate::{Head, MapsUndefined};

/// A part of the brain that is closed on its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SurfacePart {
    /// The left half of the cerebrum.
    Left,
    /// The right half of the cerebrum.
    Right,
    /// Both halves, without cerebellum and brain stem.
    Cerebrum,
}

impl SurfacePart {
    pub const ALL: [Self; 3] = [Self::Left, Self::Right, Self::Cerebrum];

    fn has(self, mark: u8) -> bool {
        match self {
            Self::Left => mark & PART == LEFT,
            Self::Right => mark & PART == RIGHT,
            Self::Cerebrum => matches!(mark & PART, LEFT | RIGHT),
        }
    }
}

/// Why a brain has no surfaces of parts.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoDivision {
    /// Its tissue is not seen.
    #[error(transparent)]
    Undefined(#[from] MapsUndefined),
    /// Its regions are not to be believed.
    #[error(transparent)]
    Doubt(RegionDoubt),
}

impl NoDivision {
    /// The stable name, for programs and translations.
    pub fn code(self) -> &'static str {
        match self {
            Self::Undefined(reason) => reason.code(),
            Self::Doubt(doubt) => doubt.code(),
        }
    }
}

// What a voxel belongs to; 0 is outside the envelope.
const LEFT: u8 = 1;
const RIGHT: u8 = 2;
const REMOVED: u8 = 3;
const PART: u8 = 3;
/// Set if no cortex is behind a border here: tissue at the brain stem, and what is deep in the cerebrum.
const NO_CORTEX: u8 = 4;
/// A voxel of the envelope without a region.
const OPEN: u8 = 8;

/// A brain divided into hemispheres, and what is not cerebrum, on its working grid.
#[derive(Debug, Clone)]
pub struct Division {
    grid: Grid,
    marks: Vec<u8>,
    sheet: Sheet,
    /// The columns of the sheet in which tissue joins the hemispheres.
    joining: Vec<bool>,
}

impl Division {
    /// Divides the brain of a head. `known` is a doubt from elsewhere.
    ///
    /// # Errors
    /// If the tissue is not seen, or if there is a doubt about the regions: half a brain is never shown as a hemisphere.
    pub fn new(head: Head<'_>, known: Option<RegionDoubt>) -> Result<Self, NoDivision> {
        if let Some(doubt) = known {
            return Err(NoDivision::Doubt(doubt));
        }
        let (block, values, _) = tissue_of(head)?;
        Self::of(
            head,
            (&block, &values),
            &regions(head, &block, &values, None),
        )
    }

    /// The same, from regions that were found before; `values` is the tissue scale of each voxel of the block.
    pub(crate) fn of(
        head: Head<'_>,
        (block, values): (&Block, &[f32]),
        regions: &Regions,
    ) -> Result<Self, NoDivision> {
        match (regions.doubts.first(), &regions.sheet) {
            (None, Some(sheet)) => Ok(Self {
                grid: head.depth.grid().clone(),
                marks: marks(head, block, (regions, sheet), values),
                joining: sheet.joining(),
                sheet: sheet.clone(),
            }),
            (doubt, _) => Err(NoDivision::Doubt(
                doubt.copied().unwrap_or(RegionDoubt::NoAxes),
            )),
        }
    }

    /// A part of the brain, closed on its own.
    ///
    /// It is the brain within its region, closed by the ball that closes the whole brain, and clipped to the region: the closing
    /// crosses neither the falx nor the tentorium. Where its border runs through tissue it is a fence, not dura.
    ///
    /// # Errors
    /// If the brain is on another grid, or if nothing is left of the part.
    pub fn closed(
        &self,
        part: SurfacePart,
        brain: &BrainMask,
        (radius_mm, cuts): (f64, &[Cut]),
    ) -> Result<Envelope, GeometryError> {
        let brain = brain.mask();
        if brain.grid() != &self.grid {
            return Err(GeometryError::ValueCount {
                values: brain.voxels().len(),
                voxels: self.marks.len(),
            });
        }
        let voxels = brain.voxels().par_iter().zip(&self.marks);
        let own = voxels.map(|(&is_brain, &mark)| is_brain && part.has(mark));
        let own = Mask::new(self.grid.clone(), own.collect())?.cropped()?;
        let closed = cut_envelope(&BrainMask::from_stored(own)?, radius_mm, cuts)?;
        let marks = self.marks_on(closed.grid());
        let closed = closed.clipped(|index| part.has(marks[index]))?;
        let border = border_of(closed.mask());
        let fence = without_specks(closed.mask(), &border, &self.fence(part, &closed, &border));
        Ok(closed.with_fence(fence))
    }

    /// The marks on a block of the working grid; nothing beyond the working grid.
    fn marks_on(&self, grid: &Grid) -> Vec<u8> {
        let block = (self.grid.first_of(grid), grid.size());
        block_of(&self.marks, self.grid.size(), block)
    }

    /// The border voxels of a part at which its border runs through tissue, ascending: at the sheet between the hemispheres through
    /// callosum, thalamus and midbrain, and the ventricles between them; and at the brain stem. Elsewhere it is dura, also where gyri
    /// touch across the falx or the tentorium.
    ///
    /// `closed` is the closed part, on a block of the working grid.
    fn fence(&self, part: SurfacePart, closed: &Envelope, border: &[u32]) -> Vec<u32> {
        let grid = closed.grid();
        let marks = self.marks_on(grid);
        let is_through_tissue = |index: usize, beyond: usize| match marks[beyond] {
            outside if outside & PART == 0 || part.has(outside) => false,
            removed if removed & PART == REMOVED => removed & NO_CORTEX != 0,
            _ if marks[index] & NO_CORTEX != 0 => true,
            _ => {
                let place = |index: usize| {
                    let voxel = grid.voxel(index).map(|along| along as f64);
                    grid.patient_from_voxel().transform_point3(voxel.into())
                };
                self.joining[self.sheet.column(place(index).midpoint(place(beyond)))]
            }
        };
        let voxels = closed.mask().voxels();
        let is_fence = |&index: &u32| {
            face_neighbours(grid.size(), index as usize)
                .any(|(_, beyond)| !voxels[beyond] && is_through_tissue(index as usize, beyond))
        };
        border.iter().copied().filter(is_fence).collect()
    }
}

/// The voxels of an envelope with a neighbour outside, ascending.
fn border_of(closed: &Mask) -> Vec<u32> {
    let [nx, ny, nz] = closed.grid().size();
    let voxels = closed.voxels();
    let mut border = Vec::new();
    // No voxel of an envelope lies on a face of its grid.
    for (z, y) in (1..nz - 1).flat_map(|z| (1..ny - 1).map(move |y| (z, y))) {
        let start = 1 + nx * (y + ny * z);
        let row = |start: usize| &voxels[start..][..nx - 2];
        let [before, after] = [row(start - 1), row(start + 1)];
        let [behind, ahead] = [row(start - nx), row(start + nx)];
        let [below, above] = [row(start - nx * ny), row(start + nx * ny)];
        for (x, _) in row(start).iter().enumerate().filter(|(_, is_in)| **is_in) {
            let is_within = before[x] & after[x] & behind[x] & ahead[x] & below[x] & above[x];
            if !is_within {
                border.push((start + x) as u32);
            }
        }
    }
    border
}

/// How far around a border voxel it is counted whether the border is a fence, in mm.
const SPECK_MM: f64 = 4.0;

/// The border voxels around which most of the border is a fence, ascending: specks of a fence on dura, and of dura in a fence, become
/// what is around them.
fn without_specks(closed: &Mask, border: &[u32], fence: &[u32]) -> Vec<u32> {
    const BORDER: u8 = 1;
    const FENCE: u8 = 2;
    let grid = closed.grid();
    let [nx, ny, _] = grid.size();
    let mut kinds = vec![0; closed.voxels().len()];
    for &index in border {
        kinds[index as usize] = BORDER;
    }
    for &index in fence {
        kinds[index as usize] = FENCE;
    }
    let radius = SPECK_MM / grid.spacing_mm()[0];
    let reach = radius as i64;
    let along = || -reach..=reach;
    let is_near = |[x, y, z]: [i64; 3]| ((x * x + y * y + z * z) as f64) <= radius * radius;
    // Beyond the margin of the block, an offset leads to the next row, where no border is so near.
    let offsets: Vec<i64> = along()
        .flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z])))
        .filter(|offset| is_near(*offset))
        .map(|[x, y, z]| x + nx as i64 * (y + ny as i64 * z))
        .collect();
    let around = |index: u32| {
        let there = offsets.iter().map(move |offset| i64::from(index) + offset);
        there.filter_map(|there| usize::try_from(there).ok())
    };
    let mut is_beside_fence = vec![false; kinds.len()];
    for there in fence.iter().flat_map(|&index| around(index)) {
        if let Some(is_beside) = is_beside_fence.get_mut(there) {
            *is_beside = true;
        }
    }
    let stays = |&index: &u32| {
        let mut counts = [0u32; 3];
        for there in around(index) {
            let kind = kinds.get(there).copied().unwrap_or(0);
            counts[usize::from(kind)] += 1;
        }
        let [_, dura, fence] = counts;
        fence > dura || (fence == dura && kinds[index as usize] == FENCE)
    };
    let beside = border.iter().copied();
    let beside = beside.filter(|&index| is_beside_fence[index as usize]);
    beside.filter(stays).collect()
}

/// The marks of the voxels of the working grid.
///
/// The region of a voxel is that of the nearest voxel of the block, but its side is exact.
fn marks(
    head: Head<'_>,
    block: &Block,
    (regions, sheet): (&Regions, &Sheet),
    values: &[f32],
) -> Vec<u8> {
    let grid = head.depth.grid();
    let [nx, ny, _] = grid.size();
    let block_from_working = block.grid.voxel_from_patient() * grid.patient_from_voxel();
    let step = block_from_working.matrix3.x_axis;
    let last = DVec3::from_array(block.size.map(|side| side as f64 - 1.0));
    let depths = head.depth.values();
    let mut marks = vec![0; depths.len()];
    let fill = |(row, marks): (usize, &mut [u8])| {
        let start = DVec3::from_array([0, row % ny, row / ny].map(|along| along as f64));
        let start = block_from_working.transform_point3(start);
        let is_inside = |&(x, _): &(usize, &mut u8)| depths[row * nx + x] >= 0;
        for (x, mark) in marks.iter_mut().enumerate().filter(is_inside) {
            let place = (start + step * x as f64).clamp(DVec3::ZERO, last);
            let place = (place + 0.5).to_array().map(|along| along as usize);
            let index = block.grid.index(place);
            *mark = match Region::from_code(regions.codes()[index]) {
                Some(Region::BrainStem) if values[index] >= TISSUE_FROM => REMOVED | NO_CORTEX,
                Some(Region::Cerebellum | Region::BrainStem) => REMOVED,
                Some(Region::LeftDeep | Region::RightDeep) => LEFT | NO_CORTEX,
                Some(Region::LeftCerebrum | Region::RightCerebrum) => LEFT,
                None => OPEN,
            };
        }
    };
    marks.par_chunks_mut(nx).enumerate().for_each(fill);
    fill_open(grid, &mut marks);
    let head_from_working = sheet.head_from_patient() * grid.patient_from_voxel();
    let divide = |(row, marks): (usize, &mut [u8])| {
        let start = DVec3::from_array([0, row % ny, row / ny].map(|along| along as f64));
        let start = head_from_working.transform_point3(start);
        let step = head_from_working.matrix3.x_axis;
        for (x, mark) in marks.iter_mut().enumerate() {
            let is_right = || sheet.left_of(start + step * x as f64) < 0.0;
            if *mark & PART == LEFT && is_right() {
                *mark = *mark & NO_CORTEX | RIGHT;
            }
        }
    };
    marks.par_chunks_mut(nx).enumerate().for_each(divide);
    marks
}

/// Gives the voxels without a region that of the nearest ones with one.
fn fill_open(grid: &Grid, marks: &mut [u8]) {
    let size = grid.size();
    let is_open = |mark: u8| mark & OPEN != 0;
    let around = (0..marks.len())
        .filter(|&index| is_open(marks[index]))
        .flat_map(|index| face_neighbours(size, index))
        .filter(|&(_, other)| marks[other] & PART != 0);
    let mut seeds: Vec<u32> = around.map(|(_, other)| other as u32).collect();
    seeds.sort_unstable();
    seeds.dedup();
    // Fluid, as far as its part matters.
    for mark in marks.iter_mut().filter(|mark| is_open(**mark)) {
        *mark = OPEN;
    }
    flood(size, |_| 0, (marks, OPEN), seeds, |mark, _| mark & PART);
}

#[cfg(test)]
pub(super) mod tests {
    use geometry::distance_map;

    use super::*;
    use crate::phantom::{Scan, mirrored};
    use crate::regions::phantom::{BrainPhantom, grid};
    use crate::regions::tests::{cut_scan, turned};

    /// The surface of a part of a brain.
    pub(in crate::regions) fn closed(
        mask: &Mask,
        scan: &Scan,
        division: &Division,
        part: SurfacePart,
    ) -> Envelope {
        let brain = BrainMask::from_mask(mask, scan.volume.grid()).unwrap();
        division.closed(part, &brain, (10.0, &[])).unwrap()
    }

    fn divided(phantom: &BrainPhantom) -> (Scan, Division) {
        let scan = phantom.scan(&grid());
        let division = Division::new(scan.head(), None).unwrap();
        (scan, division)
    }

    #[test]
    fn a_hemisphere_is_closed_on_its_side_and_its_border_is_a_fence_where_the_sheet_cuts_tissue() {
        let phantom = BrainPhantom::PLAIN;
        let (scan, division) = divided(&phantom);
        let mask = phantom.mask(&grid());
        for (part, sign) in [(SurfacePart::Left, 1.0), (SurfacePart::Right, -1.0)] {
            let envelope = closed(&mask, &scan, &division, part);
            let grid = envelope.grid();
            let place = |index: usize| {
                let voxel = grid.voxel(index).map(|along| along as f64);
                grid.patient_from_voxel().transform_point3(voxel.into())
            };
            let inside = envelope.mask().voxels();
            let whole = scan.depth.grid();
            for index in (0..inside.len()).filter(|&index| inside[index]) {
                let place = place(index);
                // The sheet of the phantom lies in the plane x = 0.
                assert!(place.x * sign > -1.5, "{place}");
                let voxel = whole.voxel_from_patient().transform_point3(place);
                assert!(scan.depth.depth_mm(voxel.as_vec3()) > -0.1, "{place}");
            }
            let share = envelope.volume_ml() / 0.5 / 1000.0;
            assert!((0.7..1.5).contains(&share), "{share}");
            let (mut right, mut all) = (0u32, 0u32);
            for &index in envelope.fence() {
                let from_centre = phantom
                    .placed
                    .inverse()
                    .transform_point3(place(index as usize));
                // The fissure is 38 mm deep, also from below: only the middle is tissue to the other side, and nuclei.
                let is_deep = from_centre.y.abs() < 60.0 && (-25.0..42.0).contains(&from_centre.z);
                all += 1;
                right += u32::from(is_deep);
            }
            println!("{part:?}: {all} voxels of fence, {right} in the middle");
            assert!(
                all > 500 && f64::from(right) > 0.95 * f64::from(all),
                "{right} of {all}"
            );
        }
    }

    #[test]
    fn most_of_the_mesial_wall_has_a_depth_below_the_falx() {
        let phantom = BrainPhantom::PLAIN;
        let (scan, division) = divided(&phantom);
        let envelope = closed(&phantom.mask(&grid()), &scan, &division, SurfacePart::Left);
        let distance = distance_map(&envelope);
        let at = |place: DVec3| {
            let place = phantom.placed.transform_point3(place);
            let voxel = envelope
                .grid()
                .voxel_from_patient()
                .transform_point3(place)
                .round();
            let index = envelope
                .grid()
                .index(voxel.to_array().map(|along| along as usize));
            (distance.is_known(index), distance.depth_mm(index).unwrap())
        };
        // 8 mm beside the falx, 20 mm below the vertex and the frontal pole.
        for place in [DVec3::new(8.0, 4.0, 52.0), DVec3::new(8.0, 70.0, 14.0)] {
            let (is_known, depth_mm) = at(place);
            assert!(
                is_known && (depth_mm - 7.5).abs() < 1.6,
                "{place} {depth_mm}"
            );
        }
        // Below the bottom of the fissure, the sheet is the nearest border, and it is no dura.
        let (is_known, depth_mm) = at(DVec3::new(6.0, 4.0, 27.0));
        assert!(!is_known && (depth_mm - 5.5).abs() < 1.6, "{depth_mm}");
    }

    #[test]
    fn a_mirrored_head_has_the_mirrored_parts() {
        let (_, division) = divided(&BrainPhantom::PLAIN);
        let phantom = BrainPhantom {
            placed: mirrored() * BrainPhantom::PLAIN.placed,
            ..BrainPhantom::PLAIN
        };
        let (_, other) = divided(&phantom);
        let (mut same, mut all) = (0u32, 0u32);
        for (index, &mark) in division
            .marks
            .iter()
            .enumerate()
            .filter(|(_, mark)| **mark & PART > 0)
        {
            let voxel = division.grid.voxel(index).map(|along| along as f64);
            let place = division
                .grid
                .patient_from_voxel()
                .transform_point3(voxel.into());
            let there = other.grid.voxel_from_patient() * mirrored();
            let there = there.transform_point3(place).round();
            let size = DVec3::from_array(other.grid.size().map(|side| side as f64));
            if there.cmplt(DVec3::ZERO).any() || there.cmpge(size).any() {
                continue;
            }
            let there = other.marks[other
                .grid
                .index(there.to_array().map(|along| along as usize))];
            let as_seen = match mark & PART {
                LEFT => RIGHT,
                RIGHT => LEFT,
                part => part,
            };
            all += 1;
            same += u32::from(there & PART == as_seen);
        }
        assert!(f64::from(same) > 0.99 * f64::from(all), "{same} of {all}");
    }

    #[test]
    fn half_a_brain_and_a_brain_without_a_fissure_have_no_parts() {
        for phantom in [
            BrainPhantom {
                has_right_half: false,
                ..BrainPhantom::PLAIN
            },
            BrainPhantom {
                fissure_mm: -20.0,
                ..BrainPhantom::PLAIN
            },
        ] {
            let none = Division::new(phantom.scan(&grid()).head(), None);
            assert!(matches!(none, Err(NoDivision::Doubt(_))));
        }
        let scan = BrainPhantom::PLAIN.scan(&grid());
        let none = Division::new(scan.head(), Some(RegionDoubt::PrunedMask));
        assert_eq!(none.unwrap_err().code(), "regions-pruned-mask");
    }

    #[test]
    fn specks_of_a_fence_and_in_a_fence_are_taken_away_and_its_body_stays() {
        let grid = Grid::aligned([50; 3], [1.0; 3], DVec3::splat(-24.5)).unwrap();
        let place = |index: usize| {
            let voxel = grid.voxel(index).map(|along| along as f64);
            grid.patient_from_voxel().transform_point3(voxel.into())
        };
        let count = grid.voxel_count();
        let voxels = (0..count).map(|index| place(index).length() <= 18.0);
        let ball = Mask::new(grid.clone(), voxels.collect()).unwrap();
        let border = border_of(&ball);
        let is_fence = |index: u32| {
            let place = place(index as usize);
            let hole = place.distance(DVec3::new(18.0, 0.0, 0.0)) < 2.5;
            let speck = place.distance(DVec3::new(-18.0, 0.0, 0.0)) < 1.8;
            (place.x > 4.0 && !hole) || speck
        };
        let fence: Vec<u32> = border
            .iter()
            .copied()
            .filter(|&index| is_fence(index))
            .collect();
        let clean = without_specks(&ball, &border, &fence);
        for &index in &border {
            let x = place(index as usize).x;
            let is_in = clean.binary_search(&index).is_ok();
            assert!(is_in == (x > 4.0) || (x - 4.0).abs() < 2.0, "{x} {is_in}");
        }
        assert!(fence.len() > 500 && without_specks(&ball, &border, &[]).is_empty());
    }

    /// How much of each half of a phantom lies in the surface of that half and in that of the other one; `None` with a reason for
    /// no surfaces.
    fn shares(phantom: &BrainPhantom, (scan, mask): (Scan, Mask)) -> Option<[[f64; 2]; 2]> {
        let division = match Division::new(scan.head(), None) {
            Ok(division) => division,
            Err(reason) => {
                assert!(!reason.code().is_empty() && !reason.to_string().is_empty());
                println!("{}: {reason}", reason.code());
                return None;
            }
        };
        let surfaces = [SurfacePart::Left, SurfacePart::Right]
            .map(|part| closed(&mask, &scan, &division, part));
        let own_from_patient = phantom.placed.inverse();
        let halves = [Region::LeftCerebrum, Region::RightCerebrum];
        Some(halves.map(|half| {
            let mut counts = [0u32; 3];
            for index in (0..mask.voxels().len()).filter(|&index| mask.voxels()[index]) {
                let voxel = mask.grid().voxel(index).map(|along| along as f64);
                let place = mask
                    .grid()
                    .patient_from_voxel()
                    .transform_point3(voxel.into());
                let own = own_from_patient.transform_point3(place);
                if phantom.at(own).is_none_or(|(region, _)| region != half) {
                    continue;
                }
                counts[2] += 1;
                for (surface, count) in surfaces.iter().zip(&mut counts) {
                    let grid = surface.grid();
                    let voxel = grid.voxel_from_patient().transform_point3(place).round();
                    let is_in = grid.contains(voxel)
                        && surface.mask().voxels()
                            [grid.index(voxel.to_array().map(|along| along as usize))];
                    *count += u32::from(is_in);
                }
            }
            [0, 1].map(|surface| f64::from(counts[surface]) / f64::from(counts[2]))
        }))
    }

    #[test]
    fn wide_ventricles_and_a_mass_leave_both_hemispheres_whole_or_a_reason() {
        let plain = BrainPhantom::PLAIN;
        let widened = |half_axes_mm: [f64; 3]| BrainPhantom {
            ventricles_mm: DVec3::from_array(half_axes_mm),
            ..plain
        };
        // Beside the falx and across it.
        let mass = |x: f64| BrainPhantom {
            mass: Some((DVec3::new(x, 30.0, 20.0), 24.0)),
            ..plain
        };
        for phantom in [
            widened([11.0, 45.0, 16.0]),
            widened([20.0, 52.0, 24.0]),
            mass(38.0),
            mass(8.0),
        ] {
            let found = shares(&phantom, phantom.scan_and_mask(&grid()));
            println!("{found:.3?}");
            if let Some([[left, left_in_right], [right_in_left, right]]) = found {
                assert!(left > 0.97 && right > 0.97, "{left} {right}");
                assert!(left_in_right < 0.02 && right_in_left < 0.02);
            }
        }
    }

    #[test]
    fn a_turned_or_cut_head_has_both_hemispheres_whole_or_a_reason_and_one_side_and_thick_slices_a_reason()
     {
        let plain = BrainPhantom::PLAIN;
        let turned = BrainPhantom {
            placed: turned([30.0, 0.0, 0.0]) * plain.placed,
            ..plain
        };
        let around = grid().block([-10, -10, -25], [170, 210, 200]).unwrap();
        let check = |found: Option<[[f64; 2]; 2]>| {
            println!("{found:.3?}");
            if let Some([[left, left_in_right], [right_in_left, right]]) = found {
                assert!(left > 0.97 && right > 0.97, "{left} {right}");
                assert!(left_in_right < 0.02 && right_in_left < 0.02);
            }
            found.is_some()
        };
        assert!(check(shares(&turned, turned.scan_and_mask(&around))));
        let size = grid().size();
        for lost in [8, 40] {
            let cut = grid()
                .block([0; 3], [size[0], size[1], size[2] - lost])
                .unwrap();
            assert!(check(shares(&plain, cut_scan(&plain, &cut))) || lost > 8);
        }

        let placed = DVec3::from_array([0, 1, 2].map(|axis| {
            let whole = grid().patient_from_voxel().translation[axis];
            whole + if axis == 2 { 2.0 } else { 0.0 }
        }));
        let thick =
            Grid::aligned([size[0], size[1], size[2] / 5], [1.0, 1.0, 5.0], placed).unwrap();
        let none = Division::new(plain.scan(&thick).head(), None).unwrap_err();
        assert_eq!(none.code(), "coarse-voxels");

        let (volume, mask) = plain.head(&grid());
        let mut one_side = mask.voxels().to_vec();
        for (index, is_brain) in one_side.iter_mut().enumerate() {
            let voxel = grid().voxel(index).map(|along| along as f64);
            *is_brain &= grid().patient_from_voxel().transform_point3(voxel.into()).x > 0.0;
        }
        let one_side = Mask::new(grid(), one_side).unwrap();
        let scan = Scan::new(volume, &one_side);
        assert!(matches!(
            Division::new(scan.head(), None),
            Err(NoDivision::Doubt(_))
        ));
    }
}
