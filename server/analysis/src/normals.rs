//! The measures of a head on cells of a common space, in which heads are compared with others. It serves experiments alone: no map
//! uses it.
//!
//! The space is affine: the axes of the head itself (the normal of its midsagittal plane, and the principal axes of its brain in
//! that plane), each stretched so that its tissue has the spread of a usual brain.

use glam::{DAffine3, DMat3, DVec3};

use crate::Head;
use crate::block::Block;
use crate::maps::{MapParameters, tissue_of};
use crate::regions::{regions, spread_axes};
use crate::thickness::Thickness;
use crate::undefined::MapsUndefined;

/// The edge of a cell, in mm of a usual brain, and the number of cells along each axis (to the left, front and top).
pub const CELL_MM: f64 = 4.0;
/// See [`CELL_MM`].
pub const CELLS: [usize; 3] = [44, 56, 44];
/// The standard deviation of the inside of a usual skull along each axis, in mm: rounded means of four heads of the study.
const USUAL_SPREAD_MM: DVec3 = DVec3::new(32.0, 40.0, 29.0);
/// The least volume of junction in a cell, in mm³.
const LEAST_JUNCTION_MM3: f64 = 4.0;

/// The measures of a cell: sharpness (1/mm), detail (tissue scale), thickness (mm), mean of all tissue (tissue scale).
pub type CellMeasures = [f32; 4];

/// The cells of a head that contain junction of its cerebrum.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadCells {
    /// From the common space to the patient, LPS mm.
    pub patient_from_common: DAffine3,
    /// The numbers of the cells, x-fastest, ascending, with the means of their measures over the junction.
    pub cells: Vec<(u32, CellMeasures)>,
}

/// The centre of a cell in the common space, in mm.
pub fn cell_centre(cell: u32) -> DVec3 {
    let [nx, ny, nz] = CELLS;
    let index = cell as usize;
    let along = [index % nx, index / nx % ny, index / nx / ny];
    let off = |axis: usize, side: usize| (along[axis] as f64 - (side as f64 - 1.0) / 2.0) * CELL_MM;
    DVec3::new(off(0, nx), off(1, ny), off(2, nz))
}

/// The cell at a position of the common space; `None` outside all cells.
pub fn cell_at(position: DVec3) -> Option<u32> {
    let half = DVec3::from_array(CELLS.map(|side| side as f64 / 2.0));
    let place = (position / CELL_MM + half).floor();
    let side = DVec3::from_array(CELLS.map(|side| side as f64));
    let is_inside = place.cmpge(DVec3::ZERO).all() && place.cmplt(side).all();
    is_inside.then(|| {
        let [x, y, z] = place.to_array().map(|along| along as usize);
        (x + CELLS[0] * (y + CELLS[1] * z)) as u32
    })
}

/// The cells of a head; no cells if it has no axes of its own, or if its regions are in doubt.
///
/// # Errors
/// If the head has no maps.
pub fn head_cells(head: Head<'_>, parameters: &MapParameters) -> Result<HeadCells, MapsUndefined> {
    let (block, values, tissue) = tissue_of(head)?;
    let nothing = HeadCells {
        patient_from_common: DAffine3::IDENTITY,
        cells: Vec::new(),
    };
    let regions = regions(head, &block, &values, parameters.doubt);
    let Some((axes, spread)) = spread_axes(head, &block) else {
        return Ok(nothing);
    };
    if !regions.doubts.is_empty() {
        return Ok(nothing);
    }
    let stretch = DMat3::from_diagonal(spread / USUAL_SPREAD_MM);
    let patient_from_common = axes * DAffine3::from_mat3(stretch);
    let mut sharpness = parameters.sharpness(&block, &values, &tissue);
    sharpness.count_only(&regions);
    let detail = parameters.detail(&block, &values, &sharpness, &tissue);
    let weighted = parameters.weighted(&block, &values, &tissue);
    let thickness = Thickness::new(&block, (&values, tissue.fluid), &weighted);
    let thick = thickness.at(&block, &sharpness.junction, head.plane);
    let at_junction = sharpness.junction.iter().zip(thick).map(|(&voxel, thick)| {
        let index = voxel as usize;
        let [thickness, mean] = thick;
        (
            voxel,
            [sharpness.values[index], detail[index], thickness, mean],
        )
    });
    let cells = means(&block, patient_from_common.inverse(), at_junction);
    Ok(HeadCells {
        patient_from_common,
        cells,
    })
}

/// The means over the voxels of each cell that has enough of them.
fn means(
    block: &Block,
    common_from_patient: DAffine3,
    voxels: impl Iterator<Item = (u32, CellMeasures)>,
) -> Vec<(u32, CellMeasures)> {
    let common_from_voxel = common_from_patient * block.grid.patient_from_voxel();
    let mut sums = vec![([0.0_f64; 4], 0_u32); CELLS.iter().product()];
    for (voxel, measures) in voxels {
        let place = DVec3::from_array(block.grid.voxel(voxel as usize).map(|along| along as f64));
        let cell = cell_at(common_from_voxel.transform_point3(place));
        let is_defined = measures.iter().all(|measure| measure.is_finite());
        if let (Some(cell), true) = (cell, is_defined) {
            let (sums, count) = &mut sums[cell as usize];
            for (sum, measure) in sums.iter_mut().zip(measures) {
                *sum += f64::from(measure);
            }
            *count += 1;
        }
    }
    let voxel_mm3 = block.grid.patient_from_voxel().matrix3.determinant().abs();
    let enough = |count: u32| f64::from(count) * voxel_mm3 >= LEAST_JUNCTION_MM3;
    (0..)
        .zip(sums)
        .filter(|&(_, (_, count))| enough(count))
        .map(|(cell, (sums, count))| (cell, sums.map(|sum| (sum / f64::from(count)) as f32)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::turned;
    use crate::regions::phantom::{BrainPhantom, grid};

    #[test]
    fn a_cell_is_found_at_its_centre_and_nothing_outside() {
        for cell in [0, 1, 43, 44, 12_345, 44 * 56 * 44 - 1] {
            assert_eq!(cell_at(cell_centre(cell)), Some(cell));
        }
        assert_eq!(cell_at(DVec3::new(88.5, 0.0, 0.0)), None);
        assert_eq!(cell_at(DVec3::new(0.0, f64::NAN, 0.0)), None);
    }

    /// A turned head that is a tenth longer has its measures in the same cells.
    #[test]
    fn a_head_of_another_size_and_orientation_has_the_same_cells() {
        let plain = BrainPhantom::PLAIN;
        let longer = DAffine3::from_scale(DVec3::new(1.0, 1.08, 1.0));
        let other = BrainPhantom {
            placed: turned(8.0, -5.0, DVec3::new(4.0, 6.0, -3.0)) * longer * plain.placed,
            ..plain
        };
        let [plain, other] = [plain, other].map(|phantom| {
            let scan = phantom.scan(&grid());
            head_cells(scan.head(), &MapParameters::STANDARD)
                .unwrap()
                .cells
        });
        assert!(plain.len() > 1000, "{} cells", plain.len());
        let thickness = |cells: &[(u32, CellMeasures)], wanted: u32| {
            let found = cells.binary_search_by_key(&wanted, |(cell, _)| *cell);
            found.ok().map(|place| cells[place].1[2])
        };
        let shared: Vec<f32> = (plain.iter())
            .filter_map(|&(cell, measures)| Some(thickness(&other, cell)? - measures[2]))
            .collect();
        let share = shared.len() as f64 / plain.len() as f64;
        let off = shared.iter().map(|off| f64::from(off.abs())).sum::<f64>() / shared.len() as f64;
        println!(
            "{} cells, {share} shared, thickness off by {off} mm",
            plain.len()
        );
        assert!(share > 0.75, "{share}");
        assert!(off < 0.6, "{off}");
    }
}
