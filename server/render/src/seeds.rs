//! A coarse z-buffer of the shell's voxels, in which lines of sight begin.

use geometry::{Grid, ShellVoxel};
use glam::{DAffine3, DVec3};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::rays::single;
use crate::sampler::whole;
use crate::{Projection, RenderRequest, Scene};

/// Thickness of the shell in voxels: the eight voxels around a point of the isosurface have depths no further apart.
const SHELL_THICKNESS: f64 = 2.0;

/// How far above the voxels around it a point of the isosurface may be: √3 voxels, and one for a smoothed surface.
const MARGIN: f32 = 2.75;

/// Voxels projected at once.
const LANES: usize = 64;

/// The nodes of a coarse grid over the picture: about one for a voxel, at least one pixel apart.
///
/// Node (1, 1) is at the picture's top left corner; the nodes reach a node beyond each of its sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lattice {
    /// Pixels from a node to the next.
    pub(crate) pitch: f32,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Whether structures several voxels wide may lie between nodes.
    pub(crate) is_wide: bool,
}

impl Lattice {
    /// Nodes for a picture whose working voxels have edges of `voxel_mm`.
    fn new(projection: &Projection, voxel_mm: f64) -> Self {
        let pitch = (voxel_mm / projection.mm_per_pixel()).max(1.0);
        let count = |side: u32| (f64::from(side) / pitch).ceil() as usize + 3;
        Self {
            pitch: pitch as f32,
            is_wide: pitch * projection.mm_per_pixel() > 2.0 * voxel_mm,
            columns: count(projection.size().width()),
            rows: count(projection.size().height()),
        }
    }

    /// The first of the two nodes between which the centre of pixel `index` lies, and how far from it, 0 to 1.
    pub(crate) fn place(&self, index: usize) -> (usize, f32) {
        let node = (index as f32 + 0.5) / self.pitch + 1.0;
        let first = node as usize;
        (first, node - first as f32)
    }

    /// The pixel coordinate of a node.
    pub(crate) fn pixel(&self, node: usize) -> f32 {
        (node as f32 - 1.0) * self.pitch
    }
}

/// A z-buffer of a shell. A *cell* lies between four nodes; its first node has the cell's column and row.
#[derive(Debug, Clone)]
pub(crate) struct Seeds {
    pub(crate) lattice: Lattice,
    /// The greatest height of a voxel centre in each cell, in voxels; −∞ where there is none. As many as nodes.
    cells: Vec<f32>,
    /// The least height of a voxel centre in each cell, negated; −∞ where there is none.
    depths: Vec<f32>,
}

impl Seeds {
    /// Projects the voxels of the shell [D, D + δ), found by binary search (section 3.3 of the paper).
    pub(crate) fn new(scene: &Scene<'_>, request: &RenderRequest, projection: &Projection) -> Self {
        let grid = scene.shell.grid();
        let voxel_mm = grid.spacing_mm()[0];
        let shell = scene.shell.shell(
            request.parameters().depth_mm as f32,
            (SHELL_THICKNESS * voxel_mm) as f32,
        );
        let lattice = Lattice::new(projection, voxel_mm);
        let cells_from_voxel = CellsFromVoxel::new(&lattice, projection, grid);
        let chunk = shell.len().div_ceil(rayon::current_num_threads()).max(1);
        // The greatest height is the same in whatever order the voxels come.
        let [cells, depths] = shell
            .par_chunks(chunk)
            .map(|voxels| z_buffer(voxels, &cells_from_voxel))
            .reduce_with(|mut extremes, others| {
                for (extreme, others) in extremes.iter_mut().zip(&others) {
                    raise(extreme, others);
                }
                extremes
            })
            .unwrap_or_else(|| [cells_from_voxel.empty(), cells_from_voxel.empty()]);
        Self {
            lattice,
            cells,
            depths,
        }
    }

    /// At each node the greatest height in the four cells around it.
    pub(crate) fn heights(&self) -> Vec<f32> {
        greatest_around(&self.cells, self.lattice.columns, 1, 0)
    }

    /// At each node a height above which no line of sight within a node of it enters the isosurface; −∞ where none
    /// does.
    ///
    /// A voxel beside a point of the isosurface is at most √3 voxels from it,
    /// and so in one of the 4 × 4 cells around each of the four nodes around it.
    pub(crate) fn starts(&self) -> Vec<f32> {
        let mut starts = greatest_around(&self.cells, self.lattice.columns, 2, 1);
        for start in &mut starts {
            *start += MARGIN;
        }
        starts
    }

    /// In each cell a height above which no line of sight within it enters the isosurface; −∞ where none does.
    pub(crate) fn starts_in_cells(&self) -> Vec<f32> {
        let mut starts = greatest_around(&self.cells, self.lattice.columns, 2, 2);
        for start in &mut starts {
            *start += MARGIN;
        }
        starts
    }

    /// In each cell a height under which no line of sight within it enters the isosurface; +∞ where none does.
    pub(crate) fn ends_in_cells(&self) -> Vec<f32> {
        let mut ends = greatest_around(&self.depths, self.lattice.columns, 2, 2);
        for end in &mut ends {
            *end = -*end - MARGIN;
        }
        ends
    }
}

/// From voxels to the cells of a lattice, and to heights in voxels.
struct CellsFromVoxel {
    origin: [f32; 3],
    per_voxel: [[f32; 3]; 3],
    columns: usize,
    rows: usize,
}

impl CellsFromVoxel {
    fn new(lattice: &Lattice, projection: &Projection, grid: &Grid) -> Self {
        let nodes_per_pixel = 1.0 / f64::from(lattice.pitch);
        let scale = DVec3::new(nodes_per_pixel, nodes_per_pixel, 1.0 / grid.spacing_mm()[0]);
        let affine = DAffine3::from_translation(DVec3::new(1.0, 1.0, 0.0))
            * DAffine3::from_scale(scale)
            * projection.frame_from_patient()
            * grid.patient_from_voxel();
        let axes = affine.matrix3;
        Self {
            origin: single(affine.translation),
            per_voxel: [axes.x_axis, axes.y_axis, axes.z_axis].map(single),
            columns: lattice.columns,
            rows: lattice.rows,
        }
    }

    /// No voxel in any cell.
    fn empty(&self) -> Vec<f32> {
        vec![f32::NEG_INFINITY; self.columns * self.rows]
    }

    /// The cell and the height of a voxel; [`Self::outside`] when it lies beside all cells.
    #[inline(always)]
    fn of(&self, voxel: ShellVoxel) -> (u32, f32) {
        let [x, y, z] = voxel.position();
        let [x, y, z] = [x as i32 as f32, y as i32 as f32, z as i32 as f32];
        let [along_x, along_y, along_z] = &self.per_voxel;
        let along = |axis: usize| {
            self.origin[axis] + x * along_x[axis] + y * along_y[axis] + z * along_z[axis]
        };
        let [column, row] = [along(0), along(1)];
        let [last_column, last_row] = [(self.columns - 1) as f32, (self.rows - 1) as f32];
        let inside = (column >= 0.0) & (column < last_column) & (row >= 0.0) & (row < last_row);
        let cell = whole(column).wrapping_add(whole(row).wrapping_mul(self.columns as u32));
        (if inside { cell } else { self.outside() }, along(2))
    }

    fn outside(&self) -> u32 {
        (self.columns * self.rows) as u32
    }
}

/// The greatest heights of the voxels in each cell, and the greatest of their heights negated.
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn z_buffer(voxels: &[ShellVoxel], cells_from_voxel: &CellsFromVoxel) -> [Vec<f32>; 2] {
    let mut cells = cells_from_voxel.empty();
    cells.push(f32::NEG_INFINITY);
    let mut depths = cells.clone();
    let (blocks, rest) = voxels.as_chunks::<LANES>();
    let mut places = [0; LANES];
    let mut heights = [0.0; LANES];
    for block in blocks {
        for lane in 0..LANES {
            (places[lane], heights[lane]) = cells_from_voxel.of(block[lane]);
        }
        for (&place, &height) in places.iter().zip(&heights) {
            raise_one(&mut cells, place, height);
            raise_one(&mut depths, place, -height);
        }
    }
    for &voxel in rest {
        let (place, height) = cells_from_voxel.of(voxel);
        raise_one(&mut cells, place, height);
        raise_one(&mut depths, place, -height);
    }
    cells.pop();
    depths.pop();
    [cells, depths]
}

#[inline(always)]
fn raise_one(cells: &mut [f32], place: u32, height: f32) {
    let cell = &mut cells[place as usize];
    if height > *cell {
        *cell = height;
    }
}

/// Raises each height to another where that is greater.
fn raise(heights: &mut [f32], others: &[f32]) {
    for (height, &other) in heights.iter_mut().zip(others) {
        *height = if other > *height { other } else { *height };
    }
}

/// At each place the greatest value from `before` places before it to `after` places after it, along rows and columns.
fn greatest_around(values: &[f32], columns: usize, before: usize, after: usize) -> Vec<f32> {
    let along_rows = greatest_along(values, 1, before, after, columns);
    greatest_along(&along_rows, columns, before, after, values.len())
}

/// The greatest of the values `stride` apart, within pieces of `piece` values that do not see each other.
fn greatest_along(
    values: &[f32],
    stride: usize,
    before: usize,
    after: usize,
    piece: usize,
) -> Vec<f32> {
    let mut greatest = values.to_vec();
    for (greatest, values) in greatest.chunks_mut(piece).zip(values.chunks(piece)) {
        for steps in 1..=before {
            let shift = (steps * stride).min(values.len());
            raise(&mut greatest[shift..], values);
        }
        for steps in 1..=after {
            raise(greatest, &values[(steps * stride).min(values.len())..]);
        }
    }
    greatest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_greatest_around_is_that_of_its_definition() {
        let [columns, rows] = [7, 5];
        let values: Vec<f32> = (0..columns * rows)
            .map(|index| (index * 29 % 31) as f32)
            .collect();
        for (before, after) in [(1, 0), (2, 1)] {
            let found = greatest_around(&values, columns, before, after);
            for (index, &found) in found.iter().enumerate() {
                let [column, row] = [index % columns, index / columns];
                let mut expected = f32::NEG_INFINITY;
                for row in row.saturating_sub(before)..=(row + after).min(rows - 1) {
                    for column in column.saturating_sub(before)..=(column + after).min(columns - 1)
                    {
                        expected = expected.max(values[column + row * columns]);
                    }
                }
                assert_eq!(found, expected, "{index}");
            }
        }
    }
}
