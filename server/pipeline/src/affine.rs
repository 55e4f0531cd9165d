//! Affines as they are stored.

use glam::{DAffine3, DMat3, DVec3};

/// The rows of an affine.
pub(super) fn rows_of(affine: DAffine3) -> [[f64; 4]; 4] {
    let row = |axis: usize| {
        let matrix = affine.matrix3.row(axis);
        [matrix.x, matrix.y, matrix.z, affine.translation[axis]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// The affine of stored rows.
pub fn affine_of(rows: &[[f64; 4]; 4]) -> DAffine3 {
    let column = |axis: usize| DVec3::new(rows[0][axis], rows[1][axis], rows[2][axis]);
    DAffine3 {
        matrix3: DMat3::from_cols(column(0), column(1), column(2)),
        translation: column(3),
    }
}
