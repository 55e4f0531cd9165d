//! "Some of its 2D cross-sections may contain two or more contours" (section 3.1).

use glam::DVec3;
use render::SlicePlane;

use crate::{PreparedHead, Table, column};

/// The pieces of a slice of the envelope: their sizes in voxels, the largest first.
type Pieces = Vec<usize>;

/// The numbers of contours of all slices along the axes of the working grid.
pub(super) fn table(head: &PreparedHead) -> Table {
    let columns = [
        column("plane", "slices"),
        column("slices", "number"),
        column("with_several", "with several contours"),
        column("most", "most contours"),
        column("beside_largest_share", "voxels beside the largest one"),
    ];
    let title = "Figure 1: outer contours of the slices of the envelope";
    let mut table = Table::new("contours", title, &columns);
    for plane in SlicePlane::ALL {
        let slices: Vec<Pieces> = slices(head, plane)
            .filter(|pieces| !pieces.is_empty())
            .collect();
        let several = slices.iter().filter(|pieces| pieces.len() > 1).count();
        let voxels: usize = slices.iter().flatten().sum();
        let largest: usize = slices.iter().map(|pieces| pieces[0]).sum();
        table.push([
            plane.name().into(),
            slices.len().into(),
            several.into(),
            slices.iter().map(Vec::len).max().unwrap_or(0).into(),
            (1.0 - largest as f64 / voxels.max(1) as f64).into(),
        ]);
    }
    table.note("Pieces are connected over 8 neighbours. The mesh follows the largest contour of sagittal slices.");
    table
}

/// The position of the slice with the most contours, in LPS mm; among equals, with the largest second one.
pub(in crate::paper) fn busiest_slice(head: &PreparedHead, plane: SlicePlane) -> f64 {
    let numbered = slices(head, plane).enumerate();
    let busiest = numbered.max_by_key(|(_, pieces)| (pieces.len(), pieces.get(1).copied()));
    let (number, _) = busiest.unwrap_or_default();
    let mut voxel = DVec3::ZERO;
    voxel[plane.axis()] = number as f64;
    let grid = head.distance.grid();
    grid.patient_from_voxel().transform_point3(voxel)[plane.axis()]
}

/// The pieces of each slice across an axis.
fn slices(head: &PreparedHead, plane: SlicePlane) -> impl Iterator<Item = Pieces> {
    let size = head.distance.grid().size();
    (0..size[plane.axis()]).map(move |number| pieces(head, plane.axis(), number))
}

fn pieces(head: &PreparedHead, axis: usize, number: usize) -> Pieces {
    let grid = head.distance.grid();
    let [across, down] = [(axis + 1) % 3, (axis + 2) % 3];
    let [width, height] = [grid.size()[across], grid.size()[down]];
    let is_inside = |x: usize, y: usize| {
        let mut voxel = [number; 3];
        (voxel[across], voxel[down]) = (x, y);
        head.distance.inside()[grid.index(voxel)]
    };
    let mut left: Vec<bool> = (0..width * height)
        .map(|index| is_inside(index % width, index / width))
        .collect();
    let mut pieces = Pieces::new();
    for start in 0..left.len() {
        if !std::mem::take(&mut left[start]) {
            continue;
        }
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&index) = piece.get(next) {
            next += 1;
            let [x, y] = [index % width, index / width];
            for y in y.saturating_sub(1)..(y + 2).min(height) {
                for x in x.saturating_sub(1)..(x + 2).min(width) {
                    if std::mem::take(&mut left[y * width + x]) {
                        piece.push(y * width + x);
                    }
                }
            }
        }
        pieces.push(piece.len());
    }
    pieces.sort_unstable_by(|a, b| b.cmp(a));
    pieces
}
