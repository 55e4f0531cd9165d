//! Which voxels belong to the brain.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::runs::{Connectivity, fill_holes, keep_largest_component};
use crate::{GeometryError, Grid, MAX_WORKING_SIZE};

/// Voxels between the brain and the faces of the working grid, so that depth can be sampled outside too.
const MARGIN: i64 = 4;

/// A set of voxels of a grid, as it was supplied: on any grid, in any orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    grid: Grid,
    voxels: Vec<bool>,
}

impl Mask {
    /// A mask of the voxels that are `true`, x-fastest.
    ///
    /// # Errors
    /// When the number of values is not that of the grid's voxels.
    pub fn new(grid: Grid, voxels: Vec<bool>) -> Result<Self, GeometryError> {
        if voxels.len() != grid.voxel_count() {
            return Err(GeometryError::ValueCount {
                values: voxels.len(),
                voxels: grid.voxel_count(),
            });
        }
        Ok(Self { grid, voxels })
    }

    /// Where the voxels are.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Whether each voxel belongs to the set, x-fastest.
    pub fn voxels(&self) -> &[bool] {
        &self.voxels
    }

    /// How much of the set lies inside of another grid, 0 to 1; 1 for an empty set.
    pub fn fraction_inside(&self, grid: &Grid) -> f64 {
        let other_from_voxel = grid.voxel_from_patient() * self.grid.patient_from_voxel();
        let marked = (0..self.voxels.len())
            .into_par_iter()
            .filter(|&index| self.voxels[index]);
        let (count, inside) = marked
            .map(|index| {
                let position =
                    other_from_voxel.transform_point3(as_position(self.grid.voxel(index)));
                (1u64, u64::from(grid.contains(position)))
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        if count == 0 {
            1.0
        } else {
            inside as f64 / count as f64
        }
    }

    /// First and last voxel of the smallest block around the set; `None` when it is empty.
    pub(crate) fn bounds(&self) -> Option<[[usize; 3]; 2]> {
        let [nx, ny, _] = self.grid.size();
        let mut first = [usize::MAX; 3];
        let mut last = [0; 3];
        let mut any_in_column = vec![false; nx];
        for (row, voxels) in self.voxels.chunks_exact(nx).enumerate() {
            let mut any = false;
            for (column, &voxel) in any_in_column.iter_mut().zip(voxels) {
                *column |= voxel;
                any |= voxel;
            }
            if any {
                for (axis, place) in [(1, row % ny), (2, row / ny)] {
                    first[axis] = first[axis].min(place);
                    last[axis] = last[axis].max(place);
                }
            }
        }
        first[0] = any_in_column.iter().position(|&any| any)?;
        last[0] = any_in_column.iter().rposition(|&any| any)?;
        Some([first, last])
    }

    /// Share of the set at a position, trilinear between voxel centres; outside of the grid there is none of it.
    fn share_at(&self, position_in_voxel: DVec3) -> f64 {
        let base = position_in_voxel.floor();
        let corners = self.corners(base);
        if corners == [corners[0]; 8] {
            return f64::from(u8::from(corners[0]));
        }
        let fraction = position_in_voxel - base;
        let weight = |corner: usize| {
            let offset = corner_offset(corner);
            (offset * fraction + (1.0 - offset) * (1.0 - fraction)).element_product()
        };
        (0..8).filter(|&corner| corners[corner]).map(weight).sum()
    }

    /// Whether each corner of the cell that begins at a voxel is marked.
    fn corners(&self, base: DVec3) -> [bool; 8] {
        let [nx, ny, nz] = self.grid.size();
        let is_within = |place: f64, side: usize| place >= 0.0 && place < (side - 1) as f64;
        if is_within(base.x, nx) && is_within(base.y, ny) && is_within(base.z, nz) {
            let [x, y, z] = base.to_array().map(|place| place as usize);
            let start = x + nx * (y + ny * z);
            let pair = |start: usize| [self.voxels[start], self.voxels[start + 1]];
            let pairs = [0, nx, nx * ny, nx * ny + nx].map(|offset| pair(start + offset));
            std::array::from_fn(|corner| pairs[corner / 2][corner % 2])
        } else {
            std::array::from_fn(|corner| self.is_marked(base + corner_offset(corner)))
        }
    }

    fn is_marked(&self, voxel: DVec3) -> bool {
        let size = self.grid.size();
        let is_inside = (0..3).all(|axis| voxel[axis] >= 0.0 && voxel[axis] < size[axis] as f64);
        is_inside
            && self.voxels[self
                .grid
                .index(voxel.to_array().map(|place| place as usize))]
    }

    /// This set on another grid: voxels of which at least half lies in it, trilinear between centres.
    fn resampled(&self, grid: Grid) -> Self {
        let [nx, ny, _] = grid.size();
        let source_from_target = self.grid.voxel_from_patient() * grid.patient_from_voxel();
        let source_from_target = snapped_to_integers(source_from_target);
        let mut voxels = vec![false; grid.voxel_count()];
        voxels
            .par_chunks_mut(nx)
            .enumerate()
            .for_each(|(row, voxels)| {
                let start = as_position([0, row % ny, row / ny]);
                let start = source_from_target.transform_point3(start);
                let step = source_from_target.matrix3.x_axis;
                for (x, voxel) in voxels.iter_mut().enumerate() {
                    let position = start + step * x as f64;
                    *voxel = if position == position.round() {
                        self.is_marked(position)
                    } else {
                        self.share_at(position) >= 0.5
                    };
                }
            });
        Self { grid, voxels }
    }
}

/// The same affine with entries a hair from an integer moved onto it, so that voxel centres that coincide do so exactly.
fn snapped_to_integers(affine: DAffine3) -> DAffine3 {
    let entries = affine.to_cols_array();
    let whole = entries.map(f64::round);
    let is_close = entries
        .iter()
        .zip(&whole)
        .all(|(entry, whole)| (entry - whole).abs() < 1e-3);
    if is_close {
        DAffine3::from_cols_array(&whole)
    } else {
        affine
    }
}

/// The way from a cell's first voxel to its others.
fn corner_offset(corner: usize) -> DVec3 {
    as_position([corner & 1, corner >> 1 & 1, corner >> 2])
}

fn as_position(voxel: [usize; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|place| place as f64))
}

/// The voxels of the brain on the working grid: one component without holes.
///
/// The working grid is isotropic, lies along the patient axes and surrounds the brain with a margin.
#[derive(Debug, Clone, PartialEq)]
pub struct BrainMask(Mask);

impl BrainMask {
    /// Brings a mask from its own grid to the working grid of a volume, through the affines.
    ///
    /// The working grid has the volume's smallest spacing, or what brings its longest side down to
    /// [`MAX_WORKING_SIZE`]. Where the volume's grid is isotropic and lies along the patient axes, its voxel
    /// centres are the volume's own. The largest component (26-neighbourhood) is kept and its holes are
    /// filled. A mask on a coarser grid is interpolated, so that its surface is right within half a voxel.
    ///
    /// # Errors
    /// When the mask is empty, or when less than half of it lies inside of the volume.
    pub fn from_mask(mask: &Mask, volume_grid: &Grid) -> Result<Self, GeometryError> {
        if mask.bounds().is_none() {
            return Err(GeometryError::EmptyMask);
        }
        let inside = mask.fraction_inside(volume_grid);
        if inside < 0.5 {
            return Err(GeometryError::MaskOutsideVolume {
                percent: inside * 100.0,
            });
        }
        let mut brain = mask.resampled(working_grid(mask, volume_grid)?);
        let size = brain.grid.size();
        keep_largest_component(size, &mut brain.voxels, Connectivity::Corners);
        fill_holes(size, &mut brain.voxels);
        if brain.voxels.iter().any(|&voxel| voxel) {
            Ok(Self(brain))
        } else {
            Err(GeometryError::EmptyMask)
        }
    }

    /// The mask on the working grid.
    pub fn mask(&self) -> &Mask {
        &self.0
    }
}

/// The grid around a mask on which all later steps work.
fn working_grid(mask: &Mask, volume_grid: &Grid) -> Result<Grid, GeometryError> {
    let [low, high] = patient_bounds(mask)?;
    let native = volume_grid
        .reordered_to_patient_axes()
        .filter(Grid::is_isotropic);
    let finest = volume_grid
        .spacing_mm()
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let room = (MAX_WORKING_SIZE as i64 - 2 * MARGIN - 2) as f64;
    let spacing = finest.max((high - low).max_element() / room);
    let lattice = match native {
        Some(native) if spacing == finest => native,
        _ => Grid::aligned([1; 3], [spacing; 3], low + spacing / 2.0)?,
    };
    // The bounds lie half-way between centres, where rounding alone could go either way.
    let first = (lattice.voxel_from_patient().transform_point3(low) - 0.25)
        .ceil()
        .to_array();
    let last = (lattice.voxel_from_patient().transform_point3(high) + 0.25)
        .floor()
        .to_array();
    let first = first.map(|voxel| voxel as i64 - MARGIN);
    let last = last.map(|voxel| voxel as i64 + MARGIN);
    lattice.block(
        first,
        [0, 1, 2].map(|axis| (last[axis] - first[axis] + 1) as usize),
    )
}

/// The corners of the block along the patient axes that holds the marked voxels, in LPS mm.
fn patient_bounds(mask: &Mask) -> Result<[DVec3; 2], GeometryError> {
    let [first, last] = mask.bounds().ok_or(GeometryError::EmptyMask)?;
    let (first, last) = (as_position(first) - 0.5, as_position(last) + 0.5);
    let corners = (0..8).map(|corner| {
        let is_last = glam::BVec3::new(corner & 1 > 0, corner & 2 > 0, corner & 4 > 0);
        mask.grid
            .patient_from_voxel()
            .transform_point3(DVec3::select(is_last, last, first))
    });
    let outward = |[low, high]: [DVec3; 2], corner: DVec3| [low.min(corner), high.max(corner)];
    Ok(corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], outward))
}
