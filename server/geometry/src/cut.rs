//! Faces of the field of view that cut the brain.

use glam::DVec3;

use crate::{BrainMask, Face, Grid};

/// The distance from the edge of the field of view that a voxel must have beyond its depth for the depth to be known, in voxels.
///
/// Depth counts from the centres of border voxels, which at a cut are up to a voxel inside the edge of the field of view. Depths
/// that count from them are therefore up to a voxel less than the distance from the edge. Half a voxel allows for the
/// staircase of an oblique cut, where rounding would otherwise decide from pixel to pixel.
const REACH_VOXELS: f64 = 1.5;

/// A face of the field of view that cuts the brain; beyond it everything is unknown.
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

    /// Whether a depth at a position (LPS mm) is known, because none of `cuts` may be nearer than the dura.
    pub(crate) fn all_leave(
        cuts: &[Self],
        position_in_patient: DVec3,
        depth_mm: f32,
        voxel_mm: f64,
    ) -> bool {
        let least_mm = Self::least_distance_mm(f64::from(depth_mm), voxel_mm);
        cuts.iter()
            .all(|cut| cut.distance_mm(position_in_patient) >= least_mm)
    }

    /// The same face for a brain with its surface, and so the cut, moved inwards by `inwards_mm`.
    pub fn moved_inwards(self, inwards_mm: f64) -> Self {
        Self {
            offset_mm: self.offset_mm + inwards_mm,
            ..self
        }
    }
}

/// What cuts a brain.
#[derive(Debug, Clone, PartialEq)]
pub struct BrainCuts {
    /// The faces of the volume, and planes within it beyond which its voxels are exactly constant; at most one plane for each side,
    /// and none beside a face.
    pub cuts: Vec<Cut>,
    /// The area of the brain on them, in cm², in the order of [`Face::ALL`].
    pub area_cm2: [f64; 6],
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
