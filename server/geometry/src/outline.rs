//! Measures of points that somebody has marked.

use glam::DVec3;

/// The length of the straight lines that join points in their order, in the unit of the points.
pub fn length_of(points: &[DVec3]) -> f64 {
    points
        .windows(2)
        .map(|pair| pair[0].distance(pair[1]))
        .sum()
}

/// The area that a closed outline has in the plane in which it is largest, in the square of the unit of the points: half the length
/// of the sum of the cross products of its corners (Newell's method).
pub fn flat_area_of(outline: &[DVec3]) -> f64 {
    let Some(&first) = outline.first() else {
        return 0.0;
    };
    let from_first: Vec<_> = outline.iter().map(|&corner| corner - first).collect();
    let products = from_first.windows(2).map(|pair| pair[0].cross(pair[1]));
    products.sum::<DVec3>().length() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_in_any_plane_has_its_length_and_its_area() {
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
        let corners = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0]];
        let at = |[x, y]: [f64; 2]| turn * DVec3::new(x, y, 0.0) + DVec3::splat(100.0);
        let square = corners.map(at);
        assert!((length_of(&square) - 9.0).abs() < 1e-9);
        assert!((flat_area_of(&square) - 9.0).abs() < 1e-9);
        // A corner that lies 4 mm off the plane.
        let mut bent = square;
        bent[2] += turn * DVec3::Z * 4.0;
        assert!((9.0..21.0).contains(&flat_area_of(&bent)));
        assert_eq!((length_of(&[]), flat_area_of(&[])), (0.0, 0.0));
        assert_eq!(flat_area_of(&square[..2]), 0.0);
    }
}
