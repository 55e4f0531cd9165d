//! Affines as they are stored.

use glam::DAffine3;

/// The rows of an affine.
pub(super) fn rows_of(affine: DAffine3) -> [[f64; 4]; 4] {
    let row = |axis: usize| {
        let matrix = affine.matrix3.row(axis);
        [matrix.x, matrix.y, matrix.z, affine.translation[axis]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}
