//! The regions of a brain, voxel by voxel: the left and right cerebrum, the cerebellum and the brain stem.
//!
//! 1. The head gets axes of its own: the normal of the midsagittal plane and the principal axes of the brain in that plane.
//!    Along them, the parts of brains lie at places that differ little (`lattice`).
//! 2. On cells of 2 mm, a watershed from seeds of white matter divides the cerebrum from cerebellum and brain stem along
//!    the dark tentorium, and across the brain stem where it is narrowest (`parts`).
//! 3. The same watershed, on the voxels within about 4 mm of the border that was found.
//! 4. The cerebrum is divided by the sheet between the hemispheres (`falx`).
//! 5. What is no cortex in the cerebrum is left out: on the cells, a watershed with white matter as its ridge divides
//!    nuclei and ventricles from the cortex (`deep`); and 3 mm beside a cut through tissue.
//!
//! Volumes, symmetry and the brightness of the borders say whether the result is to be believed (`doubt`). If not, nothing
//! is taken off.

mod deep;
mod division;
mod doubt;
mod falx;
mod lattice;
mod parts;
#[cfg(any(test, feature = "testing"))]
pub mod phantom;
#[cfg(test)]
mod real;
#[cfg(test)]
mod tests;

use geometry::{Grid, flood};
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;

pub use self::division::{Division, NoDivision, SurfacePart};
pub use self::doubt::{RegionDoubt, RegionNumbers};
pub use self::falx::Sheet;
use self::lattice::Lattice;
use self::parts::{CEREBELLUM, CEREBRUM, OPEN, OUTSIDE, Parts, STEM};
use crate::Head;
use crate::block::Block;

/// A region of the brain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Region {
    /// The left half of the cerebrum.
    LeftCerebrum = 1,
    /// The right half of the cerebrum.
    RightCerebrum = 2,
    Cerebellum = 3,
    /// The brain stem below the midbrain.
    BrainStem = 4,
    /// What is no cortex in the left half of the cerebrum: nuclei, the midbrain, edges of ventricles, and 3 mm beside a cut
    /// through tissue.
    LeftDeep = 5,
    /// The same in the right half.
    RightDeep = 6,
}

impl Region {
    /// All regions, in the order of their codes.
    pub const ALL: [Self; 6] = [
        Self::LeftCerebrum,
        Self::RightCerebrum,
        Self::Cerebellum,
        Self::BrainStem,
        Self::LeftDeep,
        Self::RightDeep,
    ];

    /// Whether it may have cortex whose junction counts.
    pub fn counts(self) -> bool {
        matches!(self, Self::LeftCerebrum | Self::RightCerebrum)
    }

    /// The region of a code; `None` for 0, outside the brain.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&region| region as u8 == code)
    }
}

/// The regions of a brain on a block of the grid of the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Regions {
    grid: Grid,
    codes: Vec<u8>,
    /// The sheet between the hemispheres; `None` if the head has no axes.
    pub sheet: Option<Sheet>,
    /// The measures; `None` if nothing could be measured.
    pub numbers: Option<RegionNumbers>,
    /// Why the regions are not to be believed. If there is a doubt, everything is cerebrum.
    pub doubts: Vec<RegionDoubt>,
}

impl Regions {
    /// The grid: a block of the grid of the volume.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The codes of the regions, x-fastest; 0 outside the brain.
    pub fn codes(&self) -> &[u8] {
        &self.codes
    }

    /// The region of a position (LPS mm).
    pub fn at(&self, position_in_patient: DVec3) -> Option<Region> {
        let voxel_from_patient = self.grid.voxel_from_patient();
        let position_in_voxel = voxel_from_patient.transform_point3(position_in_patient);
        let index = self.grid.nearest(position_in_voxel)?;
        Region::from_code(self.codes[index])
    }
}

/// Divides the brain of a head; `values` is the tissue scale of each voxel of the block.
///
/// `known` is a doubt from elsewhere. The result is the same for any number of threads. It turns and mirrors with the head.
pub fn regions(
    head: Head<'_>,
    block: &Block,
    values: &[f32],
    known: Option<RegionDoubt>,
) -> Regions {
    let Some(lattice) = Lattice::new(head, block, values) else {
        return Regions {
            grid: block.grid.clone(),
            codes: vec![Region::LeftCerebrum as u8; block.voxel_count()],
            sheet: None,
            numbers: None,
            doubts: vec![RegionDoubt::NoAxes],
        };
    };
    let parts = parts::parts(&lattice);
    let sheet = Sheet::new(head, block, values, &lattice);
    let deep = deep::deep(&lattice, &parts.marks);
    let numbers = doubt::measure(&lattice, (&parts, &deep), &sheet);
    let mut doubts = Vec::from_iter(doubt::one_hemisphere(&lattice));
    doubts.extend(known);
    doubts.extend(doubt::of_voxels(head));
    doubts.extend(doubt::doubts(head, &lattice, &parts, &numbers));
    let mut codes = refined(&lattice, &parts, block, values);
    if !doubts.is_empty() {
        for code in codes.iter_mut().filter(|code| **code != OUTSIDE) {
            *code = CEREBRUM;
        }
    }
    divide(&mut codes, block, &sheet);
    if doubts.is_empty() {
        leave_out_deep(&mut codes, block, (&lattice, &deep));
        leave_out_rim(&mut codes, block, values);
    }
    Regions {
        grid: block.grid.clone(),
        codes,
        sheet: Some(sheet),
        numbers: Some(numbers),
        doubts,
    }
}

/// The parts of the voxels of a block: those of the cells far from a border, and a watershed between.
fn refined(lattice: &Lattice, parts: &Parts, block: &Block, values: &[f32]) -> Vec<u8> {
    let cubes = cubes(lattice, &sure(lattice, &parts.marks));
    let [nx, ny, _] = block.size;
    let cell_from_voxel = lattice.patient_from_cell().inverse() * block.grid.patient_from_voxel();
    let step = cell_from_voxel.matrix3.x_axis.as_vec3();
    let size = lattice.size.map(|side| side as f32 - 1.0);
    let mut marks = vec![OUTSIDE; block.voxel_count()];
    marks
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, marks)| {
            let start = DVec3::from_array([0, row % ny, row / ny].map(|along| along as f64));
            let start = cell_from_voxel.transform_point3(start).as_vec3();
            for (x, mark) in marks.iter_mut().enumerate() {
                let cell = start + step * x as f32;
                let is_inside = cell.min_element() >= 0.0
                    && cell.x < size[0]
                    && cell.y < size[1]
                    && cell.z < size[2];
                if is_inside {
                    let [x, y, z] = cell.to_array().map(|along| along as usize);
                    *mark = cubes[x + lattice.size[0] * (y + lattice.size[1] * z)];
                }
            }
        });
    let open = (0u32..).zip(&marks).filter(|(_, mark)| **mark == OPEN);
    let around = open.flat_map(|(index, _)| geometry::face_neighbours(block.size, index as usize));
    let mut seeds: Vec<u32> = around
        .filter(|&(_, neighbour)| (CEREBRUM..=STEM).contains(&marks[neighbour]))
        .map(|(_, neighbour)| neighbour as u32)
        .collect();
    seeds.sort_unstable();
    seeds.dedup();
    let level = |index: usize| parts::level(values[index]);
    flood(block.size, level, (&mut marks, OPEN), seeds, |mark, _| mark);
    marks
}

/// The marks of the cells whose neighbours have the same mark or none; the others are open.
fn sure(lattice: &Lattice, marks: &[u8]) -> Vec<u8> {
    let [nx, ny, nz] = lattice.size;
    let mut sure = marks.to_vec();
    // Along one axis after the other: the whole cube of 27.
    for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        let before = sure.clone();
        for (index, mark) in sure.iter_mut().enumerate() {
            let place = index / stride % side;
            let differs = |other: u8| other != OUTSIDE && other != before[index];
            let has_other = (place > 0 && differs(before[index - stride]))
                || (place + 1 < side && differs(before[index + stride]));
            if *mark != OUTSIDE && has_other {
                *mark = OPEN;
            }
        }
    }
    sure
}

/// The mark of each cube between eight cells, by its first cell: the only one of them besides [`OUTSIDE`], or open.
fn cubes(lattice: &Lattice, marks: &[u8]) -> Vec<u8> {
    let [nx, ny, nz] = lattice.size;
    let mut cubes = marks.to_vec();
    let joined = |one: u8, other: u8| match (one, other) {
        (OUTSIDE, mark) | (mark, OUTSIDE) => mark,
        _ if one == other => one,
        _ => OPEN,
    };
    for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        for index in 0..cubes.len() {
            if index / stride % side + 1 < side {
                cubes[index] = joined(cubes[index], cubes[index + stride]);
            }
        }
    }
    cubes
}

/// Turns marks into codes of regions: the cerebrum is divided at the sheet.
fn divide(marks: &mut [u8], block: &Block, sheet: &Sheet) {
    let [nx, ny, _] = block.size;
    let head_from_voxel: DAffine3 = sheet.head_from_patient() * block.grid.patient_from_voxel();
    let step = head_from_voxel.matrix3.x_axis;
    marks
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, marks)| {
            let start = DVec3::from_array([0, row % ny, row / ny].map(|along| along as f64));
            let start = head_from_voxel.transform_point3(start);
            for (x, mark) in marks.iter_mut().enumerate() {
                *mark = match *mark {
                    CEREBRUM if sheet.left_of(start + step * x as f64) >= 0.0 => {
                        Region::LeftCerebrum as u8
                    }
                    CEREBRUM => Region::RightCerebrum as u8,
                    CEREBELLUM => Region::Cerebellum as u8,
                    STEM => Region::BrainStem as u8,
                    _ => 0,
                };
            }
        });
}

/// Leaves out the voxels of the cerebrum whose nearest cell is deep.
fn leave_out_deep(codes: &mut [u8], block: &Block, (lattice, deep): (&Lattice, &[u8])) {
    let [nx, ny, _] = block.size;
    let cell_from_voxel = lattice.patient_from_cell().inverse() * block.grid.patient_from_voxel();
    let step = cell_from_voxel.matrix3.x_axis.as_vec3();
    let size = Vec3::from_array(lattice.size.map(|side| side as f32));
    codes
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, codes)| {
            let start = DVec3::from_array([0, row % ny, row / ny].map(|along| along as f64));
            let start = cell_from_voxel.transform_point3(start).as_vec3() + 0.5;
            for (x, code) in codes.iter_mut().enumerate() {
                let left_out = match Region::from_code(*code) {
                    Some(Region::LeftCerebrum) => Region::LeftDeep,
                    Some(Region::RightCerebrum) => Region::RightDeep,
                    _ => continue,
                };
                let cell = start + step * x as f32;
                if cell.cmpge(Vec3::ZERO).all() && cell.cmplt(size).all() {
                    let [x, y, z] = cell.to_array().map(|along| along as usize);
                    if deep[x + lattice.size[0] * (y + lattice.size[1] * z)] == deep::DEEP {
                        *code = left_out as u8;
                    }
                }
            }
        });
}

/// The distance from a cut through tissue within which nothing counts, in mm.
const RIM_MM: f64 = 3.0;
/// The tissue scale from which a cut runs through tissue. The tentorium, and grey matter that touches it from both sides,
/// are darker.
const TISSUE_FROM: f32 = 0.25;

/// Leaves out the cerebrum beside a cut through tissue.
fn leave_out_rim(codes: &mut [u8], block: &Block, values: &[f32]) {
    let is_removed = |code: u8| code == Region::Cerebellum as u8 || code == Region::BrainStem as u8;
    let is_cerebrum =
        |code: u8| code == Region::LeftCerebrum as u8 || code == Region::RightCerebrum as u8;
    let mut cut = Vec::new();
    for (index, _) in codes
        .iter()
        .enumerate()
        .filter(|(_, code)| is_removed(**code))
    {
        let is_cut = values[index] >= TISSUE_FROM
            && geometry::face_neighbours(block.size, index)
                .any(|(_, other)| is_cerebrum(codes[other]) && values[other] >= TISSUE_FROM);
        if is_cut {
            cut.push(block.grid.voxel(index));
        }
    }
    let reach = block.in_voxels(RIM_MM).map(|reach| reach as i64);
    let along = |axis: usize| -reach[axis]..=reach[axis];
    let offsets: Vec<[i64; 3]> = along(2)
        .flat_map(|z| along(1).flat_map(move |y| along(0).map(move |x| [x, y, z])))
        .filter(|offset| {
            let squared = |axis: usize| (offset[axis] as f64 * block.spacing_mm[axis]).powi(2);
            squared(0) + squared(1) + squared(2) <= RIM_MM * RIM_MM
        })
        .collect();
    for voxel in cut {
        for offset in &offsets {
            let there = [0, 1, 2].map(|axis| voxel[axis] as i64 + offset[axis]);
            if (0..3).any(|axis| !(0..block.size[axis] as i64).contains(&there[axis])) {
                continue;
            }
            let code = &mut codes[block.grid.index(there.map(|along| along as usize))];
            *code = match *code {
                code if code == Region::LeftCerebrum as u8 => Region::LeftDeep as u8,
                code if code == Region::RightCerebrum as u8 => Region::RightDeep as u8,
                code => code,
            };
        }
    }
}
