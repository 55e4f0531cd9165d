//! Where the field of view ends inside of the brain.

use glam::DVec3;

use crate::{BrainMask, Face, Grid};

/// How much nearer to the edge of the field of view than its depth a voxel may lie and still have a known depth, in voxels.
///
/// Depth counts from the centres of border voxels. Those of a cut lie less than a voxel within the edge of the field of view, those
/// of a brain that ends before the outermost voxels at least a voxel; the difference to 1 is for rounding.
const REACH_VOXELS: f64 = 0.98;

/// A face of the volume that cuts the brain: what lies beyond is unknown.
///
/// The border of the envelope on this face is no dura. A depth is known if the ball that it stands for, which reaches from a voxel
/// to the nearest border, lies within the field of view: nothing beyond a face can be nearer then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The patient's side at which it lies.
    pub face: Face,
    /// Unit vector into the volume, along L, P and S.
    pub inward: DVec3,
    /// How far the face lies from the origin of the patient space along `inward`, in mm.
    pub offset_mm: f64,
}

impl Cut {
    /// How far within the field of view a position lies (LPS mm), in mm; negative beyond the face.
    pub fn distance_mm(&self, position_in_patient: DVec3) -> f64 {
        self.inward.dot(position_in_patient) - self.offset_mm
    }

    /// How far from the face a position must lie for a depth to be known there, in mm, if voxels have edges of `voxel_mm`.
    pub fn least_distance_mm(depth_mm: f64, voxel_mm: f64) -> f64 {
        depth_mm + REACH_VOXELS * voxel_mm
    }

    /// Whether a depth measured at a position is known.
    pub fn leaves(&self, position_in_patient: DVec3, depth_mm: f64, voxel_mm: f64) -> bool {
        self.distance_mm(position_in_patient) >= Self::least_distance_mm(depth_mm, voxel_mm)
    }

    /// The same face for a brain whose surface was moved inwards by `inwards_mm`, and the cut with it.
    pub fn moved_inwards(self, inwards_mm: f64) -> Self {
        Self {
            offset_mm: self.offset_mm + inwards_mm,
            ..self
        }
    }
}

impl BrainMask {
    /// The faces of a volume that cut the brain: those whose outermost voxels it reaches.
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
