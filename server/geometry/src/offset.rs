//! Grows or shrinks a brain mask by a distance.

use crate::mask::MARGIN;
use crate::runs::{Connectivity, fill_holes, keep_largest_component};
use crate::{BrainMask, GeometryError, MAX_WORKING_SIZE, Mask};

/// The largest offset either way, in mm.
const MAX_OFFSET_MM: f64 = 20.0;

/// Moves the surface of a brain mask outwards by `offset_mm`, or inwards if it is negative.
///
/// The offset is exact: outwards, a voxel belongs to the result if its centre is at most this far from the centre of a
/// voxel of the mask; inwards, if it is further than this from the centre of every voxel outside. The largest component
/// is kept and its holes are filled. The result is on its own working grid. An offset of less than a voxel changes
/// nothing.
///
/// # Errors
/// If the offset is not within −20 to 20 mm, if nothing is left of the mask, or if the new mask needs a working grid of
/// more than [`MAX_WORKING_SIZE`] voxels along a side.
pub fn offset(brain: &BrainMask, offset_mm: f64) -> Result<BrainMask, GeometryError> {
    let refused = |range| GeometryError::Parameter {
        name: "offset_mm",
        value: offset_mm,
        range,
    };
    if !(-MAX_OFFSET_MM..=MAX_OFFSET_MM).contains(&offset_mm) {
        return Err(refused("from -20 to 20"));
    }
    let mask = brain.mask();
    let radius = offset_mm.abs() / mask.grid().spacing_mm()[0];
    if radius < 1.0 {
        return Ok(brain.clone());
    }
    // A bound on memory: the padded grid has at most 0.3 billion voxels.
    let pad = if offset_mm > 0.0 {
        radius.floor() as usize
    } else {
        0
    };
    let size = mask.grid().size().map(|side| side + 2 * pad);
    if radius >= 100.0 || size.iter().product::<usize>() > 300_000_000 {
        return Err(refused("smaller for voxels of this size"));
    }
    let wide = mask.block([-(pad as i64); 3], size)?;
    let moved = if offset_mm > 0.0 {
        wide.dilated(offset_mm)?
    } else {
        wide.eroded(-offset_mm)?
    };
    let mut voxels = moved.voxels().to_vec();
    keep_largest_component(size, &mut voxels, Connectivity::Corners);
    fill_holes(size, &mut voxels);
    let moved = Mask::new(wide.grid().clone(), voxels)?;
    let [first, last] = moved.bounds().ok_or(GeometryError::EmptyMask)?;
    let first_kept = first.map(|voxel| voxel as i64 - MARGIN);
    let size = [0, 1, 2].map(|axis| last[axis] - first[axis] + 1 + 2 * MARGIN as usize);
    if size.iter().any(|&side| side > MAX_WORKING_SIZE) {
        return Err(refused("smaller for a brain of this size"));
    }
    BrainMask::from_stored(moved.block(first_kept, size)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom;

    /// The offset by definition, for every voxel of the grid of the result.
    fn by_definition(brain: &BrainMask, result: &Mask, offset_mm: f64) -> Vec<bool> {
        let mask = brain.mask();
        let spacing = mask.grid().spacing_mm()[0];
        let radius = offset_mm.abs() / spacing;
        let reach = radius.ceil() as i64;
        let shift = mask.grid().voxel_from_patient() * result.grid().patient_from_voxel();
        let shift = shift
            .translation
            .round()
            .to_array()
            .map(|along| along as i64);
        let belongs = |voxel: [i64; 3]| {
            let size = mask.grid().size();
            let inside = (0..3).all(|axis| (0..size[axis] as i64).contains(&voxel[axis]));
            inside && mask.voxels()[mask.grid().index(voxel.map(|place| place as usize))]
        };
        let near = |voxel: [i64; 3], wanted: bool| {
            (-reach..=reach).any(|z| {
                (-reach..=reach).any(|y| {
                    (-reach..=reach).any(|x| {
                        ((x * x + y * y + z * z) as f64) <= radius * radius
                            && belongs([voxel[0] + x, voxel[1] + y, voxel[2] + z]) == wanted
                    })
                })
            })
        };
        (0..result.grid().voxel_count())
            .map(|index| {
                let voxel = result.grid().voxel(index);
                let there = [0, 1, 2].map(|axis| voxel[axis] as i64 + shift[axis]);
                if offset_mm > 0.0 {
                    near(there, true)
                } else {
                    !near(there, false)
                }
            })
            .collect()
    }

    #[test]
    fn an_offset_is_that_of_its_definition() {
        let brain = phantom::two_lobes([7.0, 6.0], 10.0, 3.0);
        for offset_mm in [1.0, 2.3, 4.0, -1.0, -2.0, -2.9] {
            let moved = offset(&brain, offset_mm).unwrap();
            let expected = by_definition(&brain, moved.mask(), offset_mm);
            assert!(moved.mask().voxels() == expected, "{offset_mm} mm");
        }
    }

    #[test]
    fn a_ball_grows_and_shrinks_by_the_offset() {
        let ball = phantom::ellipsoid([20.0; 3], 0.5);
        let radius_mm =
            |brain: &BrainMask| (brain.volume_ml() * 750.0 / std::f64::consts::PI).cbrt();
        for offset_mm in [3.0, -3.0] {
            let moved = offset(&ball, offset_mm).unwrap();
            let off = radius_mm(&moved) - radius_mm(&ball) - offset_mm;
            assert!(off.abs() < 0.3, "{off}");
        }
    }

    #[test]
    fn the_grid_is_the_working_grid_of_the_new_mask() {
        let ball = phantom::ball(10.0);
        for offset_mm in [4.0, -4.0] {
            let moved = offset(&ball, offset_mm).unwrap();
            let again = BrainMask::from_mask(moved.mask(), ball.mask().grid()).unwrap();
            assert!(again == moved, "{offset_mm} mm");
        }
    }

    #[test]
    fn less_than_a_voxel_changes_nothing_and_too_much_is_refused() {
        let ball = phantom::ball(6.0);
        assert!(offset(&ball, 0.9).unwrap() == ball);
        assert_eq!(offset(&ball, -7.0), Err(GeometryError::EmptyMask));
        for bad in [20.5, -21.0, f64::NAN] {
            assert!(matches!(
                offset(&ball, bad),
                Err(GeometryError::Parameter {
                    name: "offset_mm",
                    ..
                })
            ));
        }
    }
}
