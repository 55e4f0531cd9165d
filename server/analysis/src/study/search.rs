//! A search through a whole head: marks, highest first, and how many false ones lie above a lesion.

use glam::DVec3;

/// A mark within this distance of a lesion's centre hits it, in mm.
pub const HIT_MM: f64 = 10.0;

/// A mark of an observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// LPS mm.
    pub position_in_patient: DVec3,
    /// Higher is more suspicious.
    pub score: f32,
}

/// How many false marks lie above the highest mark that hits a lesion; `None` if no mark hits it.
///
/// Marks descend. Marks within the lesion's radius and a margin of it are none of the false ones.
pub fn false_marks_above(marks: &[Mark], centre: DVec3, radius_mm: f64) -> Option<usize> {
    let hit = marks
        .iter()
        .position(|mark| mark.position_in_patient.distance(centre) <= HIT_MM)?;
    let is_false =
        |mark: &&Mark| mark.position_in_patient.distance(centre) > HIT_MM + radius_mm / 2.0;
    Some(marks[..hit].iter().filter(is_false).count())
}
