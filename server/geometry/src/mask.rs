//! Masks, and the brain mask on the working grid.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::grid::{as_position, block_of, bounds_through};
use crate::runs::{Connectivity, fill_holes, keep_component_with_most_of, keep_largest_component};
use crate::{GeometryError, Grid, MAX_WORKING_SIZE};

/// Voxels between the brain and the faces of the working grid, so that depth can be sampled outside too.
pub(crate) const MARGIN: i64 = 4;

/// Greater than every voxel coordinate, and a power of two, so that adding it to an integer is exact.
const FLOOR_SHIFT: f64 = (1u64 << 32) as f64;

/// A set of voxels on any grid, in any orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    grid: Grid,
    voxels: Vec<bool>,
}

impl Mask {
    /// A mask of the voxels that are `true`, x-fastest.
    ///
    /// # Errors
    /// If the number of values differs from the number of voxels.
    pub fn new(grid: Grid, voxels: Vec<bool>) -> Result<Self, GeometryError> {
        if voxels.len() != grid.voxel_count() {
            return Err(GeometryError::ValueCount {
                values: voxels.len(),
                voxels: grid.voxel_count(),
            });
        }
        Ok(Self { grid, voxels })
    }

    /// The grid of the voxels.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Whether each voxel belongs to the set, x-fastest.
    pub fn voxels(&self) -> &[bool] {
        &self.voxels
    }

    /// Whether the voxel at a position in voxel coordinates belongs to the set; beyond the grid, none does.
    pub fn contains(&self, position_in_voxel: DVec3) -> bool {
        let nearest = self.grid.nearest(position_in_voxel);
        nearest.is_some_and(|index| self.voxels[index])
    }

    /// Volume of the set, in millilitres.
    pub fn volume_ml(&self) -> f64 {
        let voxels = self.voxels.iter().filter(|&&voxel| voxel).count();
        let voxel_mm3 = self.grid.patient_from_voxel().matrix3.determinant().abs();
        voxels as f64 * voxel_mm3 / 1000.0
    }

    /// Checks that the set is valid on a working grid: not empty, on an isotropic grid along the patient axes, not on
    /// its faces.
    pub(crate) fn check_working(&self) -> Result<(), GeometryError> {
        let [first, last] = self.bounds().ok_or(GeometryError::EmptyMask)?;
        let is_aligned = self.grid.is_isotropic()
            && self.grid.reordered_to_patient_axes().as_ref() == Some(&self.grid);
        if !is_aligned {
            return Err(GeometryError::BadAffine {
                what: "not that of a working grid",
            });
        }
        let size = self.grid.size();
        if (0..3).any(|axis| first[axis] == 0 || last[axis] + 1 == size[axis]) {
            return Err(GeometryError::CutEnvelope);
        }
        Ok(())
    }

    /// The fraction of the set inside another grid, 0 to 1; 1 for an empty set.
    pub fn fraction_inside(&self, grid: &Grid) -> f64 {
        let other_from_voxel = grid.voxel_from_patient() * self.grid.patient_from_voxel();
        let centres = [
            DVec3::ZERO,
            as_position(self.grid.size().map(|side| side - 1)),
        ];
        if bounds_through(other_from_voxel, centres)
            .into_iter()
            .all(|corner| grid.contains(corner))
        {
            return 1.0;
        }
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

    /// How many voxels of the set have their centre in a voxel of another set, on any grid.
    pub fn count_within(&self, other: &Self) -> usize {
        let other_from_voxel = other.grid.voxel_from_patient() * self.grid.patient_from_voxel();
        let is_within = |index: usize| {
            let centre = as_position(self.grid.voxel(index));
            other.contains(other_from_voxel.transform_point3(centre))
        };
        let marked = (0..self.voxels.len()).filter(|&index| self.voxels[index]);
        marked.filter(|&index| is_within(index)).count()
    }

    /// The component (6-neighbourhood) with the most voxels of another set on the same grid; among equals, the first.
    /// Empty if none contains any.
    ///
    /// # Errors
    /// If the other set has another number of voxels.
    pub fn component_with_most_of(mut self, other: &Self) -> Result<Self, GeometryError> {
        if other.voxels.len() != self.voxels.len() {
            return Err(GeometryError::ValueCount {
                values: other.voxels.len(),
                voxels: self.voxels.len(),
            });
        }
        let size = self.grid.size();
        keep_component_with_most_of(size, &mut self.voxels, &other.voxels, Connectivity::Faces);
        Ok(self)
    }

    /// The largest component (26-neighbourhood); among equals, the first.
    pub fn largest_component(mut self) -> Self {
        keep_largest_component(self.grid.size(), &mut self.voxels, Connectivity::Corners);
        self
    }

    /// The set with its holes filled: voxels that it separates from the faces of the grid (6-neighbourhood).
    pub fn filled(mut self) -> Self {
        fill_holes(self.grid.size(), &mut self.voxels);
        self
    }

    /// The working grid of a volume around this set, as in [`BrainMask::from_mask`].
    ///
    /// # Errors
    /// If the set is empty.
    pub fn working_grid(&self, volume_grid: &Grid) -> Result<Grid, GeometryError> {
        working_grid(self, volume_grid)
    }

    /// The same mask on the block of its grid that a working grid has around it.
    ///
    /// # Errors
    /// If the mask is empty.
    pub fn cropped(&self) -> Result<Self, GeometryError> {
        let [first, last] = self.bounds().ok_or(GeometryError::EmptyMask)?;
        let first = first.map(|voxel| voxel as i64 - MARGIN);
        let size = [0, 1, 2].map(|axis| (last[axis] as i64 + 1 + MARGIN - first[axis]) as usize);
        self.block(first, size)
    }

    /// The set inside a block of `size` voxels that starts at voxel `first`, which may lie outside the grid.
    pub(crate) fn block(&self, first: [i64; 3], size: [usize; 3]) -> Result<Self, GeometryError> {
        let grid = self.grid.block(first, size)?;
        let voxels = block_of(&self.voxels, self.grid.size(), (first, size));
        Ok(Self { grid, voxels })
    }

    /// First and last voxel of the bounding box of the set; `None` if it is empty.
    pub fn bounds(&self) -> Option<[[usize; 3]; 2]> {
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

    /// Whether the set, interpolated trilinearly between voxel centres, is at least ½ at a position; it is 0 outside
    /// the grid.
    fn is_half_marked(&self, position_in_voxel: DVec3) -> bool {
        // Truncation after a shift is a floor without a library call.
        let base = position_in_voxel
            .to_array()
            .map(|along| (along + FLOOR_SHIFT) as i64 - FLOOR_SHIFT as i64);
        let corners = self.corners(base);
        if corners == [corners[0]; 8] {
            return corners[0];
        }
        let fraction = position_in_voxel - DVec3::from_array(base.map(|place| place as f64));
        let weight = |corner: usize| {
            let offset = DVec3::from_array(corner_offset(corner).map(|place| place as f64));
            (offset * fraction + (1.0 - offset) * (1.0 - fraction)).element_product()
        };
        let share: f64 = (0..8).filter(|&corner| corners[corner]).map(weight).sum();
        share >= 0.5
    }

    /// The values at the corners of the cell that begins at a voxel.
    fn corners(&self, base: [i64; 3]) -> [bool; 8] {
        let [nx, ny, nz] = self.grid.size();
        let is_within = |axis: usize, side: usize| (0..side as i64 - 1).contains(&base[axis]);
        if is_within(0, nx) && is_within(1, ny) && is_within(2, nz) {
            let [x, y, z] = base.map(|place| place as usize);
            let start = x + nx * (y + ny * z);
            let pair = |start: usize| [self.voxels[start], self.voxels[start + 1]];
            let pairs = [0, nx, nx * ny, nx * ny + nx].map(|offset| pair(start + offset));
            std::array::from_fn(|corner| pairs[corner / 2][corner % 2])
        } else {
            std::array::from_fn(|corner| {
                let offset = corner_offset(corner);
                self.is_marked([0, 1, 2].map(|axis| base[axis] + offset[axis]))
            })
        }
    }

    fn is_marked(&self, voxel: [i64; 3]) -> bool {
        let size = self.grid.size();
        let is_inside = (0..3).all(|axis| (0..size[axis] as i64).contains(&voxel[axis]));
        is_inside && self.voxels[self.grid.index(voxel.map(|place| place as usize))]
    }

    /// This set on another grid: voxels with an interpolated value of at least ½, trilinear between centres.
    pub fn resampled(&self, grid: Grid) -> Self {
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
                    *voxel = self.is_half_marked(start + step * x as f64);
                }
            });
        Self { grid, voxels }
    }
}

/// The same affine with entries rounded that are very close to an integer, so that coinciding voxel centres coincide
/// exactly.
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

/// The offsets from the first voxel of a cell to the others.
fn corner_offset(corner: usize) -> [i64; 3] {
    [corner & 1, corner >> 1 & 1, corner >> 2].map(|place| place as i64)
}

/// The voxels of the brain on the working grid: one component without holes.
///
/// The working grid is isotropic, along the patient axes, and surrounds the brain with a margin.
#[derive(Debug, Clone, PartialEq)]
pub struct BrainMask(Mask);

impl BrainMask {
    /// Resamples a mask from its own grid to the working grid of a volume, through the affines.
    ///
    /// The working grid has the smallest spacing of the volume, or the spacing that limits its longest side to
    /// [`MAX_WORKING_SIZE`]. If the grid of the volume is isotropic and along the patient axes, the voxel centres
    /// coincide. The largest component (26-neighbourhood) is kept and its holes are filled. A mask on a coarser grid is
    /// interpolated; its surface is correct within half a voxel.
    ///
    /// # Errors
    /// If the mask is empty, or if less than half of it lies inside the volume.
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

    /// A stored brain mask that [`BrainMask::from_mask`] made before.
    ///
    /// # Errors
    /// If the mask is empty, if its grid is not isotropic along the patient axes, or if the mask touches a face of its
    /// grid.
    pub fn from_stored(mask: Mask) -> Result<Self, GeometryError> {
        mask.check_working()?;
        Ok(Self(mask))
    }

    /// The mask on the working grid.
    pub fn mask(&self) -> &Mask {
        &self.0
    }

    /// Volume of the brain, in millilitres.
    pub fn volume_ml(&self) -> f64 {
        self.0.volume_ml()
    }
}

/// The working grid around a mask.
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
    // The bounds lie half-way between centres, where rounding errors would decide.
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

/// The bounding box of the marked voxels along the patient axes, in LPS mm.
fn patient_bounds(mask: &Mask) -> Result<[DVec3; 2], GeometryError> {
    let [first, last] = mask.bounds().ok_or(GeometryError::EmptyMask)?;
    let (first, last) = (as_position(first) - 0.5, as_position(last) + 0.5);
    Ok(bounds_through(
        mask.grid.patient_from_voxel(),
        [first, last],
    ))
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};

    use super::*;
    use crate::{distance_map, envelope};

    /// A ball of `radius_mm` around `centre` on any grid, by voxel centres.
    fn ball_on(grid: &Grid, centre: DVec3, radius_mm: f64) -> Mask {
        let is_inside = |index| {
            let voxel = as_position(grid.voxel(index));
            grid.patient_from_voxel()
                .transform_point3(voxel)
                .distance(centre)
                <= radius_mm
        };
        let voxels = (0..grid.voxel_count()).map(is_inside).collect();
        Mask::new(grid.clone(), voxels).unwrap()
    }

    fn grid(size: [usize; 3], axes: DMat3, spacing: [f64; 3]) -> Grid {
        let matrix3 = axes * DMat3::from_diagonal(DVec3::from_array(spacing));
        let middle = DVec3::from_array(size.map(|side| (side - 1) as f64 / 2.0));
        Grid::new(
            size,
            DAffine3 {
                matrix3,
                translation: matrix3 * -middle,
            },
        )
        .unwrap()
    }

    #[test]
    fn every_order_of_axes_gives_the_same_mask() {
        let reference = grid([30, 34, 38], DMat3::IDENTITY, [1.5; 3]);
        let centre = DVec3::new(4.0, -3.0, 2.0);
        let expected =
            BrainMask::from_mask(&ball_on(&reference, centre, 14.0), &reference).unwrap();
        for order in crate::AXIS_ORDERS {
            for signs in 0..8 {
                let sign = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
                let column = |axis: usize| DVec3::AXES[order[axis]] * sign(axis);
                let axes = DMat3::from_cols(column(0), column(1), column(2));
                let turned = grid(order.map(|axis| [30, 34, 38][axis]), axes, [1.5; 3]);
                let mask = ball_on(&turned, centre, 14.0);
                assert_eq!(BrainMask::from_mask(&mask, &turned).unwrap(), expected);
            }
        }
    }

    #[test]
    fn thick_and_oblique_slices_give_the_true_depth() {
        let tilted = DMat3::from_quat(DQuat::from_axis_angle(
            DVec3::new(1.0, 2.0, -0.5).normalize(),
            0.3,
        ));
        for (axes, spacing) in [
            (DMat3::IDENTITY, [0.5, 0.5, 1.2]),
            (tilted, [1.0; 3]),
            (tilted, [0.7, 0.7, 1.4]),
        ] {
            let native = grid([90, 90, 60], axes, spacing);
            let (centre, radius) = (DVec3::new(1.0, -2.0, 0.5), 16.0);
            let brain = BrainMask::from_mask(&ball_on(&native, centre, radius), &native).unwrap();
            let distance = distance_map(&envelope(&brain, 2.0).unwrap());
            let working = distance.grid();
            assert!(working.is_isotropic() && working.reordered_to_patient_axes().is_some());
            let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
            assert!((working.spacing_mm()[0] - finest).abs() < 1e-9);
            let coarsest = spacing.into_iter().fold(0.0, f64::max);
            for index in (0..distance.inside().len()).step_by(97) {
                let Some(depth) = distance.depth_mm(index) else {
                    continue;
                };
                let voxel = as_position(working.voxel(index));
                let position = working.patient_from_voxel().transform_point3(voxel);
                let truth = radius - position.distance(centre);
                // Half a native voxel for the staircase of the mask, and half a voxel for the border voxel.
                let error = (f64::from(depth) - truth).abs();
                assert!(error <= coarsest / 2.0 + finest, "{error} at depth {truth}");
            }
        }
    }

    #[test]
    fn a_mask_on_a_coarser_grid_lands_in_its_place() {
        let fine = grid([64; 3], DMat3::IDENTITY, [1.0; 3]);
        let coarse = grid(
            [30, 30, 30],
            DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)),
            [2.0; 3],
        );
        let centre = DVec3::new(6.0, -4.0, 3.0);
        let exact = BrainMask::from_mask(&ball_on(&fine, centre, 15.0), &fine).unwrap();
        let from_coarse = BrainMask::from_mask(&ball_on(&coarse, centre, 15.0), &fine).unwrap();
        let centre_of = |brain: &BrainMask| {
            let grid = brain.mask().grid();
            let marked = (0..grid.voxel_count()).filter(|&index| brain.mask().voxels()[index]);
            let (sum, count) = marked.fold((DVec3::ZERO, 0.0), |(sum, count), index| {
                (sum + as_position(grid.voxel(index)), count + 1.0)
            });
            (
                grid.patient_from_voxel().transform_point3(sum / count),
                count,
            )
        };
        let ((a, count_a), (b, count_b)) = (centre_of(&exact), centre_of(&from_coarse));
        assert!(
            a.distance(centre) < 0.1 && b.distance(centre) < 0.1,
            "{a} {b}"
        );
        assert!(
            (count_a / count_b - 1.0).abs() < 0.05,
            "{count_a} {count_b}"
        );
    }

    #[test]
    fn an_empty_mask_and_one_of_another_head_are_refused() {
        let here = grid([20; 3], DMat3::IDENTITY, [1.0; 3]);
        let empty = Mask::new(here.clone(), vec![false; 8000]).unwrap();
        assert_eq!(
            BrainMask::from_mask(&empty, &here),
            Err(GeometryError::EmptyMask)
        );
        let elsewhere = here.block([200, 0, 0], [20; 3]).unwrap();
        let other = Mask::new(elsewhere, vec![true; 8000]).unwrap();
        let refused = BrainMask::from_mask(&other, &here);
        assert_eq!(
            refused,
            Err(GeometryError::MaskOutsideVolume { percent: 0.0 })
        );
        let half_way = here.block([12, 0, 0], [20; 3]).unwrap();
        let partly = Mask::new(half_way, vec![true; 8000]).unwrap();
        assert!((partly.fraction_inside(&here) - 0.4).abs() < 1e-9);
    }

    #[test]
    fn the_working_grid_stays_within_its_limit() {
        let long = grid([900, 12, 12], DMat3::IDENTITY, [0.5; 3]);
        let full = Mask::new(long.clone(), vec![true; long.voxel_count()]).unwrap();
        let brain = BrainMask::from_mask(&full, &long).unwrap();
        assert!(
            brain
                .mask()
                .grid()
                .size()
                .iter()
                .all(|&side| side <= MAX_WORKING_SIZE)
        );
        assert!(brain.mask().grid().spacing_mm()[0] > 0.5);
    }
}
