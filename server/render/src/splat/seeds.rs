//! The shell's voxels in a z-buffer.

use geometry::{Grid, ShellVoxel};
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::Projection;
use crate::rays::single;

/// The nodes of a coarse grid over the picture: about one for a voxel, at least one pixel apart.
///
/// Node (1, 1) is at the picture's top left corner; the nodes reach a node beyond each of its sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice {
    /// Pixels from a node to the next.
    pub(super) pitch: f32,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Lattice {
    /// Nodes for a picture whose working voxels have edges of `voxel_mm`.
    pub(super) fn new(projection: &Projection, voxel_mm: f64) -> Self {
        let pitch = (voxel_mm / projection.mm_per_pixel()).max(1.0);
        let count = |side: u32| (f64::from(side) / pitch).ceil() as usize + 3;
        Self {
            pitch: pitch as f32,
            columns: count(projection.size().width()),
            rows: count(projection.size().height()),
        }
    }

    /// A pixel coordinate in nodes.
    #[inline]
    pub(super) fn node(&self, pixel: f32) -> f32 {
        pixel / self.pitch + 1.0
    }

    /// The pixel coordinate of a node.
    pub(super) fn pixel(&self, node: usize) -> f32 {
        (node as f32 - 1.0) * self.pitch
    }
}

/// How far above the voxels around it a point of the isosurface may be: √3 voxels, and one for a smoothed surface.
const MARGIN: f32 = 2.75;

/// A z-buffer of the shell: at each node the greatest height of a voxel around it, in voxels; −∞ where there is none.
#[derive(Debug, Clone)]
pub(super) struct Seeds {
    pub(super) lattice: Lattice,
    pub(super) heights: Vec<f32>,
}

/// Projects the voxels of a shell. A voxel reaches the four nodes around its centre.
///
/// A voxel beside a point of the isosurface is at most √3 voxels from it, and so
/// within two nodes of it: [`Seeds::starts`] looks at all of those.
pub(super) fn splat(
    shell: &[ShellVoxel],
    grid: &Grid,
    projection: &Projection,
    voxel_mm: f64,
) -> Seeds {
    let lattice = Lattice::new(projection, voxel_mm);
    let scale = DVec3::new(
        1.0 / f64::from(lattice.pitch),
        1.0 / f64::from(lattice.pitch),
        1.0 / voxel_mm,
    );
    let lattice_from_voxel = DAffine3::from_translation(DVec3::new(1.0, 1.0, 0.0))
        * DAffine3::from_scale(scale)
        * projection.frame_from_patient()
        * grid.patient_from_voxel();
    let chunk = shell.len().div_ceil(rayon::current_num_threads()).max(1);
    // The greatest height is the same in whatever order the voxels come.
    let heights = shell
        .par_chunks(chunk)
        .map(|voxels| z_buffer(voxels, &lattice, &lattice_from_voxel))
        .reduce_with(|mut heights, others| {
            for (height, other) in heights.iter_mut().zip(others) {
                *height = height.max(other);
            }
            heights
        })
        .unwrap_or_else(|| empty(&lattice));
    Seeds { lattice, heights }
}

fn empty(lattice: &Lattice) -> Vec<f32> {
    vec![f32::NEG_INFINITY; lattice.columns * lattice.rows]
}

fn z_buffer(voxels: &[ShellVoxel], lattice: &Lattice, lattice_from_voxel: &DAffine3) -> Vec<f32> {
    let mut heights = empty(lattice);
    let [along_x, along_y, along_z] = [
        single(lattice_from_voxel.matrix3.x_axis),
        single(lattice_from_voxel.matrix3.y_axis),
        single(lattice_from_voxel.matrix3.z_axis),
    ];
    let origin = single(lattice_from_voxel.translation);
    let [columns, rows] = [lattice.columns as i32, lattice.rows as i32];
    for voxel in voxels {
        let [x, y, z] = voxel.position().map(|coordinate| coordinate as f32);
        let [column, row, height]: [f32; 3] = std::array::from_fn(|axis| {
            origin[axis] + x * along_x[axis] + y * along_y[axis] + z * along_z[axis]
        });
        let [left, top] = [column.floor() as i32, row.floor() as i32];
        if left >= 0 && top >= 0 && left + 1 < columns && top + 1 < rows {
            let first = (left + top * columns) as usize;
            for start in [first, first + lattice.columns] {
                for node in &mut heights[start..start + 2] {
                    *node = node.max(height);
                }
            }
        }
    }
    heights
}

impl Seeds {
    /// At each node a height above which no line of sight within a node of it enters the isosurface; −∞ where none does.
    pub(super) fn starts(&self) -> Vec<f32> {
        let Lattice { columns, rows, .. } = self.lattice;
        let across = |row: usize, column: usize| {
            let nodes = &self.heights[row * columns..(row + 1) * columns];
            let [left, right] = [column.saturating_sub(1), (column + 1).min(columns - 1)];
            nodes[left].max(nodes[column]).max(nodes[right])
        };
        let widened: Vec<f32> = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| across(row, column)))
            .collect();
        let mut starts = Vec::with_capacity(widened.len());
        for row in 0..rows {
            let [above, below] = [row.saturating_sub(1), (row + 1).min(rows - 1)];
            for column in 0..columns {
                let highest = widened[above * columns + column]
                    .max(widened[row * columns + column])
                    .max(widened[below * columns + column]);
                starts.push(highest + MARGIN);
            }
        }
        starts
    }
}
