//! A head on a small lattice along its own axes, on which its parts are easy to describe.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

use crate::Head;
use crate::block::{Block, Zone, depth_at};

/// The edge of a cell, in mm.
pub(super) const STEP_MM: f64 = 2.0;
/// Cells around the tissue: it begins 2 mm below the envelope.
const MARGIN: f64 = 3.0;
/// The stride of the voxels from which moments are taken.
const MOMENTS_STRIDE: usize = 3;
/// The tissue scale outside the volume.
const OUTSIDE: f32 = -2.0;

/// A head along its own axes: x from the midsagittal plane to the left, y along the long axis of the brain to the front,
/// z upwards, in mm from the centroid of the brain in that plane.
///
/// The axes turn with the head, and the lattice is its own mirror image at the plane.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    pub(super) size: [usize; 3],
    /// From positions along the axes of the head, in mm, to the patient.
    pub(super) patient_from_head: DAffine3,
    /// The position of the first cell along the axes of the head, in mm.
    first: DVec3,
    /// The mean tissue scale of each cell, x-fastest.
    pub(super) values: Vec<f32>,
    /// The depth of each cell below the envelope, in mm; negative outside.
    pub(super) depths: Vec<f32>,
    /// The edge of a cube with the volume of the envelope relative to that of a usual brain.
    pub(super) scale: f64,
}

/// The volume of a usual envelope, in ml.
const USUAL_ML: f64 = 1600.0;

impl Lattice {
    /// `None` if the tissue has no long axis, or if the plane lies on its side.
    pub(super) fn new(head: Head<'_>, block: &Block, values: &[f32]) -> Option<Self> {
        let places: Vec<DVec3> = tissue(block).collect();
        let patient_from_head = patient_from_head(head, &places)?;
        let head_from_patient = patient_from_head.inverse();
        let (low, high) = places.iter().fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(low, high), &place| {
                let place = head_from_patient.transform_point3(place);
                (low.min(place), high.max(place))
            },
        );
        let low = (low / STEP_MM).floor() - MARGIN;
        let high = (high / STEP_MM).ceil() + MARGIN;
        let half = high.x.max(-low.x);
        let (low, high) = (low.with_x(-half), high.with_x(half));
        let mut lattice = Self {
            size: (high - low).to_array().map(|side| side as usize + 1),
            patient_from_head,
            first: low * STEP_MM,
            values: Vec::new(),
            depths: Vec::new(),
            scale: 1.0,
        };
        lattice.fill(head, block, values);
        let inside = lattice.depths.iter().filter(|depth| **depth >= 0.0).count();
        lattice.scale = (inside as f64 * CELL_ML / USUAL_ML).cbrt();
        Some(lattice)
    }

    pub(super) fn cell(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [index % nx, index / nx % ny, index / nx / ny]
    }

    /// The position of a cell along the axes of the head, in mm.
    pub(super) fn position(&self, index: usize) -> DVec3 {
        self.first + DVec3::from_array(self.cell(index).map(|along| along as f64)) * STEP_MM
    }

    /// The same, in mm of a head of usual size.
    pub(super) fn usual_position(&self, index: usize) -> DVec3 {
        self.position(index) / self.scale
    }

    /// The positions of the first and the last cell along the axes of the head, in mm.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let side = DVec3::from_array(self.size.map(|side| side as f64 - 1.0));
        (self.first, self.first + side * STEP_MM)
    }

    /// From cells to positions along the axes of the head.
    fn head_from_cell(&self) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::splat(STEP_MM)),
            translation: self.first,
        }
    }

    pub(super) fn patient_from_cell(&self) -> DAffine3 {
        self.patient_from_head * self.head_from_cell()
    }

    fn fill(&mut self, head: Head<'_>, block: &Block, values: &[f32]) {
        let patient_from_cell = self.patient_from_cell();
        let voxel_from_cell = block.grid.voxel_from_patient() * patient_from_cell;
        let working_from_cell = head.depth.grid().voxel_from_patient() * patient_from_cell;
        let corners: [Vec3; 8] = std::array::from_fn(|corner| {
            let off = |axis: usize| (corner >> axis & 1) as f64 / 2.0 - 0.25;
            let off = DVec3::new(off(0), off(1), off(2));
            (voxel_from_cell.matrix3 * off).as_vec3() + 0.5
        });
        let [nx, ny, _] = self.size;
        let size = Vec3::from_array(block.size.map(|side| side as f32));
        let cell = |place: DVec3| {
            let depth = depth_at(
                head.depth,
                working_from_cell.transform_point3(place).as_vec3(),
            );
            if depth < 0.0 {
                return (OUTSIDE, depth);
            }
            let centre = voxel_from_cell.transform_point3(place).as_vec3();
            let (mut sum, mut count) = (0.0, 0u8);
            for corner in corners {
                let voxel = centre + corner;
                if voxel.cmpge(Vec3::ZERO).all() && voxel.cmplt(size).all() {
                    sum += values[block
                        .grid
                        .index(voxel.to_array().map(|along| along as usize))];
                    count += 1;
                }
            }
            let mean = if count > 0 {
                sum / f32::from(count)
            } else {
                OUTSIDE
            };
            (mean, depth)
        };
        let rows = (0..self.size[1] * self.size[2]).into_par_iter();
        let cells = rows.flat_map_iter(|row| {
            (0..nx).map(move |x| {
                cell(DVec3::from_array(
                    [x, row % ny, row / ny].map(|along| along as f64),
                ))
            })
        });
        (self.values, self.depths) = cells.unzip();
    }
}

/// The volume of a cell, in ml.
pub(super) const CELL_ML: f64 = STEP_MM * STEP_MM * STEP_MM / 1000.0;

/// The voxels of tissue, every few along each axis, in patient space.
fn tissue(block: &Block) -> impl Iterator<Item = DVec3> + '_ {
    let along = |axis: usize| (0..block.size[axis]).step_by(MOMENTS_STRIDE);
    let voxels =
        along(2).flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| [x, y, z])));
    voxels
        .filter(|&voxel| block.zones[block.grid.index(voxel)] >= Zone::Tissue)
        .map(|voxel| {
            let voxel = DVec3::from_array(voxel.map(|along| along as f64));
            block.grid.patient_from_voxel().transform_point3(voxel)
        })
}

/// The axes of a head: the normal of its midsagittal plane, and the principal axes of its brain in that plane.
fn patient_from_head(head: Head<'_>, places: &[DVec3]) -> Option<DAffine3> {
    let centroid = places.iter().sum::<DVec3>() / places.len() as f64;
    let left = head.plane.normal();
    let up = (DVec3::Z - left * left.z).try_normalize()?;
    let front = left.cross(up);
    let (mut along, mut across, mut upright) = (0.0, 0.0, 0.0);
    for place in places {
        let off = *place - centroid;
        let (y, z) = (front.dot(off), up.dot(off));
        along += y * y;
        across += y * z;
        upright += z * z;
    }
    // The angle of the long axis above the front.
    let angle = 0.5 * (2.0 * across).atan2(along - upright);
    let (sin, cos) = angle.sin_cos();
    let is_finite = angle.is_finite() && centroid.is_finite();
    is_finite.then(|| DAffine3 {
        matrix3: DMat3::from_cols(left, front * cos + up * sin, up * cos - front * sin),
        translation: centroid - left * (left.dot(centroid) - head.plane.offset_mm()),
    })
}
