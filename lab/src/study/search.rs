//! A search through a whole head: marks, highest first, and the number of false marks above a lesion.

use glam::DVec3;

/// A mark within this distance of the centre of a lesion is a hit, in mm.
pub const HIT_MM: f64 = 10.0;

/// A mark of an observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// The position, LPS mm.
    pub position_in_patient: DVec3,
    /// The score; higher is more suspicious.
    pub score: f32,
}

/// The number of false marks above the highest mark that hits a lesion; `None` if no mark hits it.
///
/// Marks are in descending order. Marks within the radius of the lesion plus a margin are not false.
pub fn false_marks_above(marks: &[Mark], centre: DVec3, radius_mm: f64) -> Option<usize> {
    let hit = marks
        .iter()
        .position(|mark| mark.position_in_patient.distance(centre) <= HIT_MM)?;
    let is_false =
        |mark: &&Mark| mark.position_in_patient.distance(centre) > HIT_MM + radius_mm / 2.0;
    Some(marks[..hit].iter().filter(is_false).count())
}
