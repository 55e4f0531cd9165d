//! Sentences of the paper that state a number or can be tested by one.

mod closest;
mod contours;
mod degenerate;
mod shells;

use crate::{BenchError, PreparedHead, Table};

pub(super) use contours::busiest_slice;
#[cfg(test)]
pub(super) use degenerate::degenerate_count;

/// Contours and points of the meshes of Figure 4, with 450 and 3,840 triangles. The paper states only these numbers;
/// the pairs are our choice.
pub(super) const COARSE_AND_FINE: [[usize; 2]; 2] = [[15, 15], [48, 40]];

/// The depths of the shrunk meshes, in mm.
pub(super) const DEPTHS_MM: [f32; 4] = [0.0, 10.0, 20.0, 30.0];

/// The tables: contours of slices, degenerate triangles, distances from the closest point, voxels of shells.
pub(super) fn tables(head: &PreparedHead) -> Result<Vec<Table>, BenchError> {
    Ok(vec![
        contours::table(head),
        degenerate::table(head)?,
        closest::table(head)?,
        shells::table(head),
    ])
}
