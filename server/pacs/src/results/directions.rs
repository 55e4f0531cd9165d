//! Where the patient's directions lie in pictures, in the terms of DICOM.

use cases::pictures::CheckedPicture;
use glam::DVec3;
use imaging::dicom::write::Laterality;

/// The patient's directions along and against +L, +P and +H (PS3.3 C.7.6.1.1.1).
const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['H', 'F']];

/// How far a direction may be off an axis and still count as the axis: 1 less the cosine of 0.8°.
const TOLERANCE: f64 = 1e-4;

/// The axis and the letter of a direction of the patient; `None` if it is oblique.
fn letter(direction: DVec3) -> Option<char> {
    let axis = (0..3).find(|&axis| direction[axis].abs() > 1.0 - TOLERANCE)?;
    Some(LETTERS[axis][usize::from(direction[axis] < 0.0)])
}

/// A direction of the view, in patient space.
fn in_patient(picture: &CheckedPicture, direction: DVec3) -> DVec3 {
    picture.camera().orientation().inverse() * direction
}

/// The value that all pictures share.
fn common<T: PartialEq>(
    pictures: &[CheckedPicture],
    value: impl Fn(&CheckedPicture) -> T,
) -> Option<T> {
    let mut values = pictures.iter().map(value);
    let first = values.next()?;
    values.all(|other| other == first).then_some(first)
}

/// The directions along the rows and down the columns, if all pictures show the head from the same of the six standard
/// directions.
pub(super) fn of_rows_and_columns(pictures: &[CheckedPicture]) -> Option<[char; 2]> {
    let directions = |picture: &CheckedPicture| {
        let [row, column] =
            [DVec3::X, DVec3::NEG_Y].map(|direction| letter(in_patient(picture, direction)));
        Some([row?, column?])
    };
    common(pictures, directions).flatten()
}

/// The side of the brain that is seen: one of them only if every picture shows it from exactly there.
pub(super) fn laterality(pictures: &[CheckedPicture]) -> Laterality {
    let seen_from = |picture: &CheckedPicture| letter(in_patient(picture, DVec3::Z));
    match common(pictures, seen_from).flatten() {
        Some('L') => Laterality::Left,
        Some('R') => Laterality::Right,
        _ => Laterality::Both,
    }
}

#[cfg(test)]
mod tests {
    use cases::pictures::PictureRequest;
    use render::NamedView;

    use super::*;

    fn seen(view: NamedView) -> CheckedPicture {
        let request = PictureRequest {
            view: Some(view),
            ..PictureRequest::default()
        };
        request.checked().unwrap()
    }

    #[test]
    fn the_six_views_have_their_directions_and_sides() {
        for (view, directions, side) in [
            (NamedView::Left, ['P', 'F'], Laterality::Left),
            (NamedView::Right, ['A', 'F'], Laterality::Right),
            (NamedView::Anterior, ['L', 'F'], Laterality::Both),
            (NamedView::Posterior, ['R', 'F'], Laterality::Both),
            (NamedView::Superior, ['R', 'P'], Laterality::Both),
            (NamedView::Inferior, ['L', 'P'], Laterality::Both),
        ] {
            let pictures = [seen(view), seen(view)];
            assert_eq!(of_rows_and_columns(&pictures), Some(directions), "{view:?}");
            assert_eq!(laterality(&pictures), side, "{view:?}");
        }
    }

    #[test]
    fn oblique_and_different_views_have_none_and_show_both_sides() {
        let left = seen(NamedView::Left);
        let oblique = left.asked.turned(0.17).unwrap().checked().unwrap();
        for pictures in [vec![oblique], vec![left, seen(NamedView::Right)]] {
            assert_eq!(of_rows_and_columns(&pictures), None);
            assert_eq!(laterality(&pictures), Laterality::Both);
        }
    }
}
