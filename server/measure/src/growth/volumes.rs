//! Growth with the volume.

use geometry::MeshSize;

use super::{Growth, note_exponents};
use crate::case::Step;
use crate::head::Scan;
use crate::{
    Cell, Costs, MeasureError, MeasuredCase, StepCosts, Table, column, peak_memory_mib,
    reset_peak_memory,
};

/// Sides of the cubes; between the first and the second comes the volume as it is.
const SIDES: [usize; 4] = [128, 256, 384, 512];

/// CPU times of the steps by the volume's voxels.
pub(super) fn table(growth: &Growth<'_>) -> Result<Table, MeasureError> {
    let columns = [
        column("size", "volume"),
        column("voxels", "voxels"),
        column("inside", "inside"),
        column("mask_ms", "mask"),
        column("closing_ms", "closing"),
        column("distance_ms", "distance"),
        column("core_ms", "core"),
        column("forest_ms", "forest"),
        column("field_ms", "field"),
        column("mesh_ms", "mesh"),
        column("table_ms", "table"),
        column("shell_ms", "shell"),
        column("normals_ms", "normals"),
        column("all_ms", "all, ms"),
        column("new_depth_us", "depth, µs"),
        column("memory_mib", "MiB"),
    ];
    let title = format!(
        "Growth with the volume: CPU ms, least of {}, 1,800 triangles",
        growth.extent.repeat
    );
    let mut table = Table::new("growth_volume", title, &columns);
    let (volume, mask) = growth.head.read()?;
    let native = Scan { volume, mask };
    let is_within = |side: &usize| *side <= growth.extent.volume_side;
    let mut sizes = vec![None];
    sizes.extend(SIDES.into_iter().filter(is_within).map(Some));
    for size in sizes {
        let scan = match size {
            None => native.clone(),
            Some(side) => native.in_cube(side)?,
        };
        table.push(row(growth, &scan)?);
    }
    table
        .rows
        .sort_by_key(|row| row[1].number().unwrap_or(0.0) as u64);
    let keys: Vec<&str> = columns[3..15].iter().map(|column| column.key).collect();
    note_exponents(&mut table, "voxels", &keys);
    table.note("The cubes hold the head interpolated, with the same share of the voxels inside. MiB: the most memory held, the volume itself included.");
    Ok(table)
}

fn row(growth: &Growth<'_>, scan: &Scan) -> Result<Vec<Cell>, MeasureError> {
    let size = scan.volume.grid().size();
    let name = size.map(|side| side.to_string()).join("×");
    growth.tell.tell(&format!("growth with the volume: {name}"));
    reset_peak_memory();
    let mut runs = Vec::new();
    let mut last = None;
    for _ in 0..growth.extent.repeat.max(1) {
        let mut costs = StepCosts::default();
        last = None;
        last.replace(MeasuredCase::of_scan(
            scan,
            growth.closing_radius_mm,
            &mut costs,
        )?);
        runs.push(costs);
    }
    let case = last.expect("at least one run");
    let memory = peak_memory_mib();
    let (_, paths) = case.table(MeshSize::STANDARD)?;
    let depth_us = 1e3 * super::triangles::look_up_ms(&paths, case.distance.max_depth_mm());
    let least_ms = |costs: Costs| costs.least_s() * 1e3;
    let mut cells: Vec<Cell> = vec![
        name.into(),
        case.volume_voxels.into(),
        case.inside_voxels().into(),
    ];
    let steps = Step::ALL
        .into_iter()
        .filter(|step| !matches!(step, Step::Reading | Step::Crop));
    cells.extend(
        steps.map(|step| Cell::from(least_ms(runs.iter().map(|run| run.of(step)).collect()))),
    );
    cells.push(least_ms(crate::case::sums(&runs, |step| step != Step::Reading)).into());
    cells.extend([depth_us.into(), memory.into()]);
    Ok(cells)
}
