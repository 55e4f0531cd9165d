//! A search through a whole head: marks, highest first, and the number of false marks above a lesion.

use glam::DVec3;

/// A mark within this distance of the centre of a lesion is a hit, in mm.
const HIT_MM: f64 = 10.0;

/// A mark of an observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// The position, LPS mm.
    pub position_in_patient: DVec3,
    /// The score; higher is more suspicious.
    pub score: f32,
}

/// The highest mark that hits a lesion, and the number of false marks above it; `None` if no mark hits it.
///
/// Marks are in descending order. Marks within the radius of the lesion plus a margin are not false.
pub fn hit(marks: &[Mark], centre: DVec3, radius_mm: f64) -> Option<(usize, Mark)> {
    let mut false_marks = 0;
    for mark in marks {
        match mark.position_in_patient.distance(centre) {
            distance if distance <= HIT_MM => return Some((false_marks, *mark)),
            distance if distance <= HIT_MM + radius_mm / 2.0 => {}
            _ => false_marks += 1,
        }
    }
    None
}
