//! The part of the native grid that contains the brain, and the depth of its voxels.

use geometry::{DepthField, Grid, Volume};
use glam::{DAffine3, DVec3, Vec3};

use crate::spans::Spans;

/// The least depth of tissue, in mm; above it there are dura and vessels.
pub(crate) const TISSUE_FROM_MM: f32 = 2.0;
/// The least depth of the junction, in mm.
pub(crate) const DEEP_FROM_MM: f32 = 3.0;

/// The depth outside the working grid, in mm.
const OUTSIDE_MM: f32 = -1.0;
/// The greatest difference of depth between two neighbours of the working grid, in voxels: 1 for a distance, and what
/// rounding to steps of 1/128 adds.
const MOST_A_VOXEL: f32 = 1.01;
/// More than the rounding errors of a depth, in mm.
const ROUNDING_MM: f32 = 0.01;

/// The depth class of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Zone {
    /// Less than 2 mm deep.
    Outside,
    Tissue,
    /// From 3 mm on, where the junction of grey and white matter may be.
    Deep,
}

/// The smallest block of a volume that contains all of its tissue.
#[derive(Debug, Clone)]
pub struct Block {
    /// Its part of the grid of the volume.
    pub grid: Grid,
    /// The first voxel, in voxels of the volume.
    pub first: [usize; 3],
    /// The number of voxels along each axis.
    pub size: [usize; 3],
    /// The edges of a voxel, in mm.
    pub spacing_mm: [f64; 3],
    /// The class of each voxel, x-fastest.
    pub zones: Vec<Zone>,
}

impl Block {
    /// `None` if no voxel of the volume is deep enough.
    pub(crate) fn new(volume: &Volume, depth: &DepthField) -> Option<Self> {
        let [first, last] = bounds(volume.grid(), depth)?;
        let size = [0, 1, 2].map(|axis| last[axis] - first[axis] + 1);
        let grid = volume
            .grid()
            .block(first.map(|voxel| voxel as i64), size)
            .ok()?;
        let zones = zones(&grid, depth);
        let block = Self {
            first,
            size,
            spacing_mm: grid.spacing_mm(),
            grid,
            zones,
        };
        block.zones.contains(&Zone::Deep).then_some(block)
    }

    pub(crate) fn voxel_count(&self) -> usize {
        self.zones.len()
    }

    /// The voxels at which the junction may be, ascending.
    pub(crate) fn deep_voxels(&self) -> Vec<u32> {
        let voxels = (0..).zip(&self.zones);
        let deep = voxels.filter(|(_, zone)| **zone == Zone::Deep);
        deep.map(|(voxel, _)| voxel).collect()
    }

    /// The part of each row that contains all voxels of a zone or of a deeper one.
    pub(crate) fn spans(&self, from: Zone) -> Spans {
        Spans::around(self.size, &self.zones, |&zone| zone >= from)
    }

    /// The stored values of a row of the volume, by its number among the rows of this block.
    pub(crate) fn row<'a>(&self, volume: &'a Volume, number: usize) -> &'a [u16] {
        let [nx, ny, _] = self.size;
        let [x, y, z] = self.first;
        let start = volume.grid().index([x, y + number % ny, z + number / ny]);
        &volume.voxels()[start..start + nx]
    }

    /// Converts a length in mm to voxels of each axis.
    pub fn in_voxels(&self, length_mm: f64) -> [f64; 3] {
        self.spacing_mm.map(|spacing| length_mm / spacing)
    }
}

/// First and last voxel of the block of a grid that contains everything deeper than [`TISSUE_FROM_MM`].
fn bounds(native: &Grid, depth: &DepthField) -> Option<[[usize; 3]; 2]> {
    let [nx, ny, _] = depth.grid().size();
    let least = (TISSUE_FROM_MM / depth.spacing_mm() * DepthField::STEPS_PER_VOXEL) as i16;
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (number, row) in depth.values().chunks_exact(nx).enumerate() {
        let Some(first) = row.iter().position(|&value| value >= least) else {
            continue;
        };
        let last = row.iter().rposition(|&value| value >= least)?;
        for x in [first, last] {
            let voxel = DVec3::from_array([x, number % ny, number / ny].map(|place| place as f64));
            low = low.min(voxel);
            high = high.max(voxel);
        }
    }
    if low.x > high.x {
        return None;
    }
    let native_from_working = native.voxel_from_patient() * depth.grid().patient_from_voxel();
    let corners = (0..8).map(|corner: usize| {
        let end = |axis: usize| {
            if corner >> axis & 1 > 0 {
                high[axis]
            } else {
                low[axis]
            }
        };
        native_from_working.transform_point3(DVec3::new(end(0), end(1), end(2)))
    });
    let (low, high) = corners.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(low, high), corner| (low.min(corner), high.max(corner)),
    );
    let side = DVec3::from_array(native.size().map(|side| side as f64 - 1.0));
    let (low, high) = (
        (low - 1.0).floor().max(DVec3::ZERO),
        (high + 1.0).ceil().min(side),
    );
    let as_voxel = |place: DVec3| place.to_array().map(|place| place as usize);
    low.cmple(high)
        .all()
        .then(|| [as_voxel(low), as_voxel(high)])
}

fn zones(grid: &Grid, depth: &DepthField) -> Vec<Zone> {
    let [nx, ny, nz] = grid.size();
    let working_from_voxel = depth.grid().voxel_from_patient() * grid.patient_from_voxel();
    let step = working_from_voxel.matrix3.x_axis;
    let slope = MOST_A_VOXEL * step.abs().element_sum() as f32 * depth.spacing_mm();
    let mut zones = Vec::with_capacity(nx * ny * nz);
    let whole = in_whole_voxels(working_from_voxel);
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        if let Some(affine) = &whole {
            push_row(&mut zones, nx, slope, |x| affine.value(depth, [x, y, z]));
        } else {
            let start = DVec3::new(0.0, y as f64, z as f64);
            let start = working_from_voxel.transform_point3(start);
            let place = |x: usize| (start + step * x as f64).as_vec3();
            push_row(&mut zones, nx, slope, |x| depth_inside(depth, place(x)));
        }
    }
    zones
}

/// Appends the zones of a row. Its depths are in mm, `None` outside the working grid; from one voxel to the next, they
/// differ by at most `slope`.
///
/// Most voxels are so far from a limit that the zone of the voxels after them is the same.
fn push_row(
    zones: &mut Vec<Zone>,
    count: usize,
    slope: f32,
    depth_mm: impl Fn(usize) -> Option<f32>,
) {
    let (mut x, mut here) = (0, depth_mm(0));
    while x < count {
        let to_limit = here.map_or(0.0, |depth| {
            let [deep, tissue] = [DEEP_FROM_MM, TISSUE_FROM_MM].map(|limit| (depth - limit).abs());
            deep.min(tissue) - ROUNDING_MM
        });
        let zone = zone(here.unwrap_or(OUTSIDE_MM));
        let far = (x + (to_limit / slope) as usize).min(count - 1);
        let there = (far > x).then(|| depth_mm(far)).flatten();
        // The working grid is convex: if the far voxel is inside, so are all up to it.
        let next = if there.is_some() { far } else { x + 1 };
        zones.resize(zones.len() + next - x, zone);
        here = there.or_else(|| (next < count).then(|| depth_mm(next)).flatten());
        x = next;
    }
}

fn zone(depth_mm: f32) -> Zone {
    // A depth equal to the limit may have been rounded down.
    let depth_mm = depth_mm + 1e-4;
    match depth_mm {
        _ if depth_mm >= DEEP_FROM_MM => Zone::Deep,
        _ if depth_mm >= TISSUE_FROM_MM => Zone::Tissue,
        _ => Zone::Outside,
    }
}

/// The depth at a position in voxels of the working grid, in mm; negative outside that grid.
pub fn depth_at(depth: &DepthField, place: Vec3) -> f32 {
    depth_inside(depth, place).unwrap_or(OUTSIDE_MM)
}

/// The same, `None` outside that grid.
fn depth_inside(depth: &DepthField, place: Vec3) -> Option<f32> {
    let size = Vec3::from_array(depth.grid().size().map(|side| side as f32 - 1.0));
    let is_inside = place.cmpge(Vec3::ZERO).all() && place.cmple(size).all();
    is_inside.then(|| depth.depth_mm(place))
}

/// Maps one grid to another with coinciding voxel centres.
struct WholeVoxels {
    columns: [[i64; 3]; 3],
    offset: [i64; 3],
}

impl WholeVoxels {
    fn value(&self, depth: &DepthField, voxel: [usize; 3]) -> Option<f32> {
        let place = |axis: usize| {
            let along = |from: usize| self.columns[from][axis] * voxel[from] as i64;
            self.offset[axis] + along(0) + along(1) + along(2)
        };
        let size = depth.grid().size();
        let there = [place(0), place(1), place(2)];
        if (0..3).any(|axis| !(0..size[axis] as i64).contains(&there[axis])) {
            return None;
        }
        let index = depth.grid().index(there.map(|place| place as usize));
        let mm_per_step = depth.spacing_mm() / DepthField::STEPS_PER_VOXEL;
        Some(f32::from(depth.values()[index]) * mm_per_step)
    }
}

fn in_whole_voxels(affine: DAffine3) -> Option<WholeVoxels> {
    let entries = affine.to_cols_array();
    let is_whole = entries
        .iter()
        .all(|entry| (entry - entry.round()).abs() < 1e-4);
    let column = |number: usize| [0, 1, 2].map(|axis| entries[3 * number + axis].round() as i64);
    is_whole.then(|| WholeVoxels {
        columns: [column(0), column(1), column(2)],
        offset: column(3),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::{Phantom, plain_grid, turned};

    #[test]
    fn zones_are_those_of_the_depth_of_each_voxel() {
        let turned = turned(10.0, 9.0, DVec3::new(2.3, -1.7, 0.4));
        let grid = plain_grid();
        let oblique = Grid::new(grid.size(), turned * grid.patient_from_voxel()).unwrap();
        for grid in [grid, oblique] {
            let scan = Phantom::PLAIN.scan(&grid);
            // Larger than the working grid of the envelope, on all sides.
            let size = grid.size().map(|side| side + 60);
            let around = grid.block([-30; 3], size).unwrap();
            let working_from_voxel =
                scan.depth.grid().voxel_from_patient() * around.patient_from_voxel();
            let found = zones(&around, &scan.depth);
            assert!(found.iter().filter(|zone| **zone == Zone::Deep).count() > 100_000);
            for (index, found) in found.into_iter().enumerate() {
                let voxel = around.voxel(index).map(|along| along as f64);
                let place = working_from_voxel.transform_point3(DVec3::from_array(voxel));
                let depth_mm = depth_at(&scan.depth, place.as_vec3());
                // The rows of an oblique grid are added up differently, by less than this.
                let is_at_limit = [DEEP_FROM_MM, TISSUE_FROM_MM]
                    .into_iter()
                    .any(|limit| (depth_mm + 1e-4 - limit).abs() < 1e-4);
                assert!(
                    found == zone(depth_mm) || is_at_limit,
                    "{voxel:?} at {depth_mm} mm"
                );
            }
        }
    }
}
