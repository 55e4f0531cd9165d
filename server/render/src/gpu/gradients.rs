//! The gradient of the depth at voxel centres.

use geometry::DepthField;
use rayon::prelude::*;

/// Central differences of a field, per voxel, in 1/127: the values that [`DepthField::gradient`] interpolates.
///
/// The fourth byte is 127 where a fence makes the depth unknown, else 0. On the faces of the grid, where a neighbour is missing, all
/// are 0.
pub(super) fn gradients(field: &DepthField) -> Vec<[i8; 4]> {
    let [nx, ny, nz] = field.grid().size();
    let values = field.values();
    let plane = nx * ny;
    let scale = 127.0 / (2.0 * DepthField::STEPS_PER_VOXEL);
    let difference = |index: usize, stride: usize| {
        let steps = f32::from(values[index + stride]) - f32::from(values[index - stride]);
        (steps * scale).round() as i8
    };
    let mut gradients = vec![[0; 4]; values.len()];
    let fence = |x: usize, row: usize| {
        let voxel = [x, row % ny, row / ny].map(|along| along as i64);
        let fenced = field.fenced();
        i8::MAX * i8::from(fenced.is_some_and(|fenced| fenced.contains(voxel)))
    };
    gradients
        .par_chunks_exact_mut(nx)
        .enumerate()
        .for_each(|(row, gradients)| {
            let is_inner = |place: usize, side: usize| place > 0 && place + 1 < side;
            if is_inner(row % ny, ny) && is_inner(row / ny, nz) {
                for (x, gradient) in gradients.iter_mut().enumerate().take(nx - 1).skip(1) {
                    let index = row * nx + x;
                    *gradient = [
                        difference(index, 1),
                        difference(index, nx),
                        difference(index, plane),
                        fence(x, row),
                    ];
                }
            }
        });
    gradients
}

#[cfg(test)]
mod tests {
    use geometry::{BrainMask, envelope, phantom};
    use glam::Vec3;

    use super::*;

    #[test]
    fn the_gradient_at_a_voxel_is_that_of_the_field() {
        let brain: BrainMask = phantom::ball(9.0);
        let field = DepthField::new(&geometry::distance_map(&envelope(&brain, 0.0).unwrap()));
        let gradients = gradients(&field);
        let [nx, ny, nz] = field.grid().size();
        for (index, gradient) in gradients.iter().enumerate() {
            let [x, y, z] = field.grid().voxel(index);
            let is_inner =
                (1..nx - 1).contains(&x) && (1..ny - 1).contains(&y) && (1..nz - 1).contains(&z);
            let place = Vec3::from([x, y, z].map(|coordinate| coordinate as f32));
            let expected = if is_inner {
                field.gradient(place)
            } else {
                Vec3::ZERO
            };
            let [x, y, z, _] = gradient.map(|part| f32::from(part) / 127.0);
            assert!((Vec3::new(x, y, z) - expected).abs().max_element() <= 0.5 / 127.0 + 2e-3);
        }
    }
}
