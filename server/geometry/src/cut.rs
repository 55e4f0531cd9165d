//! Faces of the volume that cut the brain.

use glam::DVec3;

use crate::{BrainMask, Face, Grid};

/// The tolerance by which a voxel may be nearer to the edge of the field of view than its depth and still have a known
/// depth, in voxels.
///
/// Depth counts from the centres of border voxels. Border voxels at a cut are less than a voxel inside the edge of the
/// field of view; those of a brain that ends before the outermost voxels are at least a voxel inside. The difference to
/// 1 allows for rounding.
const REACH_VOXELS: f64 = 0.98;

/// A face of the volume that cuts the brain; beyond it everything is unknown.
///
/// The border of the envelope on this face is not dura. A depth is known if the ball from the voxel to the nearest
/// border lies within the field of view: then nothing beyond a face can be nearer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The side of the patient.
    pub face: Face,
    /// Unit vector into the volume, along L, P and S.
    pub inward: DVec3,
    /// The distance of the face from the origin of patient space along `inward`, in mm.
    pub offset_mm: f64,
}

impl Cut {
    /// The distance of a position (LPS mm) from the face, in mm; negative beyond the face.
    pub fn distance_mm(&self, position_in_patient: DVec3) -> f64 {
        self.inward.dot(position_in_patient) - self.offset_mm
    }

    /// The least distance from the face at which a depth is known, in mm, for voxels of `voxel_mm`.
    pub fn least_distance_mm(depth_mm: f64, voxel_mm: f64) -> f64 {
        depth_mm + REACH_VOXELS * voxel_mm
    }

    /// Whether a depth at a position is known.
    pub fn leaves(&self, position_in_patient: DVec3, depth_mm: f64, voxel_mm: f64) -> bool {
        self.distance_mm(position_in_patient) >= Self::least_distance_mm(depth_mm, voxel_mm)
    }

    /// The same face for a brain with its surface, and so the cut, moved inwards by `inwards_mm`.
    pub fn moved_inwards(self, inwards_mm: f64) -> Self {
        Self {
            offset_mm: self.offset_mm + inwards_mm,
            ..self
        }
    }
}

impl BrainMask {
    /// The faces of a volume that cut the brain: those with outermost voxels that belong to it.
    pub fn cuts(&self, volume_grid: &Grid) -> Vec<Cut> {
        let touched = self.touched_voxels(volume_grid);
        let patient_from_voxel = volume_grid.patient_from_voxel();
        let voxel_from_patient = volume_grid.voxel_from_patient().matrix3.transpose();
        let mut cuts = Vec::new();
        for (axis, [first, last]) in touched.into_iter().enumerate() {
            let inward = voxel_from_patient.col(axis).normalize();
            let side = volume_grid.size()[axis] as f64;
            for (count, inward, along) in [(first, inward, -0.5), (last, -inward, side - 0.5)] {
                let on_face = patient_from_voxel.transform_point3(DVec3::AXES[axis] * along);
                if count > 0 {
                    cuts.push(Cut {
                        face: Face::towards(-inward),
                        inward,
                        offset_mm: inward.dot(on_face),
                    });
                }
            }
        }
        cuts
    }
}
