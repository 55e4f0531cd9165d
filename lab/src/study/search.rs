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

/// What a mark is to a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// It finds the lesion.
    Hit,
    /// It is too near to be false, and too far to find the lesion.
    Near,
    /// It is false.
    False,
}

/// The number of false marks before the first hit; `None` if there is none.
pub fn false_marks_before_hit(touches: impl IntoIterator<Item = Touch>) -> Option<usize> {
    let mut before = 0;
    for touch in touches {
        match touch {
            Touch::Hit => return Some(before),
            Touch::Near => {}
            Touch::False => before += 1,
        }
    }
    None
}

/// The highest mark that hits a lesion, and the number of false marks above it; `None` if no mark hits it.
///
/// Marks are in descending order. Marks within the radius of the lesion plus a margin are not false.
pub fn hit(marks: &[Mark], centre: DVec3, radius_mm: f64) -> Option<(usize, Mark)> {
    let touch = |mark: &Mark| match mark.position_in_patient.distance(centre) {
        distance if distance <= HIT_MM => Touch::Hit,
        distance if distance <= HIT_MM + radius_mm / 2.0 => Touch::Near,
        _ => Touch::False,
    };
    let before = false_marks_before_hit(marks.iter().map(touch))?;
    let hit = marks.iter().find(|mark| touch(mark) == Touch::Hit)?;
    Some((before, *hit))
}
