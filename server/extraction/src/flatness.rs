//! How flat a set of voxels is, in whatever direction it lies.

use geometry::Mask;
use glam::{DMat3, DVec3};

/// The standard deviation of a set along its shortest principal axis, as a fraction of that along its longest one: 1 in a ball, 0 in a
/// plane. Neither a turn of the set nor a cut of its stem changes it much. The voxels of its grid are cubes.
pub(crate) fn flatness(mask: &Mask, centre: DVec3) -> f64 {
    let grid = mask.grid();
    let mut covariance = DMat3::ZERO;
    for index in (0..mask.voxels().len()).filter(|&index| mask.voxels()[index]) {
        let from_centre = DVec3::from_array(grid.voxel(index).map(|along| along as f64)) - centre;
        covariance += DMat3::from_cols(
            from_centre * from_centre.x,
            from_centre * from_centre.y,
            from_centre * from_centre.z,
        );
    }
    let [least, greatest] = outer_eigenvalues(covariance);
    match greatest > 0.0 {
        true => (least.max(0.0) / greatest).sqrt(),
        false => 1.0,
    }
}

/// The least and the greatest eigenvalue of a symmetric matrix, by the roots of its characteristic polynomial.
///
/// Source: Smith, "Eigenvalues of a symmetric 3 × 3 matrix", Communications of the ACM 4 (4), 1961.
fn outer_eigenvalues(matrix: DMat3) -> [f64; 2] {
    let mean = (matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z) / 3.0;
    let rest = matrix - DMat3::from_diagonal(DVec3::splat(mean));
    let spread = rest.to_cols_array().map(|value| value * value);
    let spread = (spread.iter().sum::<f64>() / 6.0).sqrt();
    if spread == 0.0 {
        return [mean; 2];
    }
    let half = (rest * (1.0 / spread)).determinant() / 2.0;
    let angle_rad = half.clamp(-1.0, 1.0).acos() / 3.0;
    let at = |turn_rad: f64| mean + 2.0 * spread * (angle_rad + turn_rad).cos();
    [at(std::f64::consts::TAU / 3.0), at(0.0)]
}

#[cfg(test)]
mod tests {
    use geometry::Grid;
    use glam::DQuat;

    use super::*;

    /// The flatness of an ellipsoid with these half axes, turned about an odd axis.
    fn of_ellipsoid(half_axes: DVec3, angle_rad: f64) -> f64 {
        let grid = Grid::aligned([70; 3], [1.0; 3], DVec3::ZERO).unwrap();
        let centre = DVec3::splat(34.5);
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), angle_rad);
        let is_inside = |index: usize| {
            let place = DVec3::from_array(grid.voxel(index).map(|along| along as f64)) - centre;
            (turn.inverse() * place / half_axes).length() <= 1.0
        };
        let voxels = (0..grid.voxel_count()).map(is_inside).collect();
        flatness(&Mask::new(grid.clone(), voxels).unwrap(), centre)
    }

    #[test]
    fn it_is_the_ratio_of_the_axes_whatever_the_turn() {
        for angle_rad in [0.0, 0.7, 2.0] {
            let flat = of_ellipsoid(DVec3::new(30.0, 20.0, 15.0), angle_rad);
            assert!((flat - 0.5).abs() < 0.01, "{angle_rad}: {flat}");
        }
        assert!((of_ellipsoid(DVec3::splat(20.0), 0.3) - 1.0).abs() < 0.01);
    }
}
