//! The axes through both commissures, in which positions are stated.

use case::PlaneFacts;
use case::findings::Finding;
use glam::{DMat3, DVec3};

/// The axes through both commissures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcPc {
    /// The middle between both, LPS mm.
    middle: DVec3,
    /// To the right, to the front and upwards, from LPS.
    axes_from_patient: DMat3,
}

impl AcPc {
    /// Those that a reader has set among findings; `None` if nobody has, or if the plane between the hemispheres is in doubt or they lie
    /// across it.
    pub fn of(findings: &[Finding], plane: &PlaneFacts) -> Option<Self> {
        let set = findings.iter().find(|one| one.states_axes());
        let set = set.filter(|_| !plane.doubtful)?;
        let [anterior, posterior] = *set.points_in_patient else {
            return None;
        };
        let [anterior, posterior] = [anterior, posterior].map(DVec3::from_array);
        // A vector that is nearly nothing has no direction.
        let unit = |vector: DVec3| (vector.length() > 0.1).then(|| vector.normalize());
        let to_front = unit(anterior - posterior)?;
        let to_right = unit(-DVec3::from_array(plane.normal).reject_from_normalized(to_front))?;
        let axes = DMat3::from_cols(to_right, to_front, to_right.cross(to_front));
        Some(Self {
            middle: anterior.midpoint(posterior),
            axes_from_patient: axes.transpose(),
        })
    }

    /// A position (LPS, mm) along these axes, in whole mm.
    pub fn at(&self, position_in_patient: DVec3) -> [i32; 3] {
        let along = self.axes_from_patient * (position_in_patient - self.middle);
        along.to_array().map(|mm| mm.round() as i32)
    }
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
    fn positions_count_from_the_middle_of_both_commissures_to_the_right_front_and_top() {
        // In a head that lies straight, the patient's left is +x of LPS, and the back +y.
        let straight = AcPc::of(
            &[set([[1.0, -12.0, 5.0], [1.0, 14.0, 5.0]])],
            &plane([1.0, 0.0, 0.0]),
        );
        let straight = straight.unwrap();
        assert_eq!(straight.at(DVec3::from_array([1.0, 1.0, 5.0])), [0; 3]);
        assert_eq!(
            straight.at(DVec3::from_array([1.0, -12.0, 5.0])),
            [0, 13, 0]
        );
        assert_eq!(
            straight.at(DVec3::from_array([31.0, 1.0, 5.0])),
            [-30, 0, 0],
            "left"
        );
        assert_eq!(
            straight.at(DVec3::from_array([1.0, 1.0, 25.4])),
            [0, 0, 20],
            "top"
        );
    }

    #[test]
    fn a_turned_head_has_the_same_coordinates() {
        // By 90° about the vertical axis: the face looks to −x, and the left is −y.
        let turned = AcPc::of(
            &[set([[-13.0, 0.0, 0.0], [13.0, 0.0, 0.0]])],
            &plane([0.0, -1.0, 0.0]),
        );
        let turned = turned.unwrap();
        assert_eq!(turned.at(DVec3::from_array([-13.0, 0.0, 0.0])), [0, 13, 0]);
        assert_eq!(turned.at(DVec3::from_array([0.0, -30.0, 7.0])), [-30, 0, 7]);
        // By a nod: what was the top lies to the back, and a plane that is not quite upright becomes so.
        let [sin, cos] = [0.6, 0.8];
        let nodded = [set([
            [0.0, -13.0 * cos, 13.0 * sin],
            [0.0, 13.0 * cos, -13.0 * sin],
        ])];
        let nodded = AcPc::of(&nodded, &plane([0.8, -0.6 * cos, 0.6 * sin])).unwrap();
        assert_eq!(
            nodded.at(DVec3::from_array([0.0, 10.0 * sin, 10.0 * cos])),
            [0, 0, 10]
        );
        assert_eq!(nodded.at(DVec3::from_array([5.0, 0.0, 0.0])), [-5, 0, 0]);
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
