//! The cost of each step of the preparation.

use super::Experiment;
use crate::steps::sums;
use crate::{Costs, Step, Table, column};

/// The table of the steps and their sums for facets and for voxels.
pub(super) fn table(experiment: &Experiment<'_>) -> Table {
    let columns = [
        column("step", "step"),
        column("wall_ms", "wall, ms"),
        column("wall_least_ms", "least"),
        column("wall_p95_ms", "95 %"),
        column("cpu_ms", "CPU, ms"),
        column("cpu_least_ms", "least"),
    ];
    let runs = experiment.runs;
    let title = format!("Setup, step by step: medians of {}", runs.len());
    let mut table = Table::new("setup", title, &columns);
    let mut push = |name: String, costs: &Costs| {
        let (wall, cpu) = (costs.wall_s(), costs.cpu_s());
        table.push([
            name.into(),
            wall.map(|wall| wall.median * 1e3).into(),
            wall.map(|wall| wall.least * 1e3).into(),
            wall.map(|wall| wall.p95 * 1e3).into(),
            cpu.map(|cpu| cpu.median * 1e3).into(),
            cpu.map(|cpu| cpu.least * 1e3).into(),
        ]);
    };
    for step in Step::ALL {
        let costs = runs.iter().map(|run| run.of(step)).collect();
        push(step.to_string(), &costs);
    }
    push("all, for meshes".to_owned(), &mesh_setup(experiment));
    push("all, for voxels".to_owned(), &voxel_setup(experiment));
    table.note("Voxels need no core, forest, mesh or table; pictures need no plane between the hemispheres. Each step is measured once in every \
         preparation.");
    table
}

/// The setup of Table 2.
pub(super) fn mesh_setup(experiment: &Experiment<'_>) -> Costs {
    sums(experiment.runs, Step::is_for_meshes)
}

/// The setup of Table 3.
pub(super) fn voxel_setup(experiment: &Experiment<'_>) -> Costs {
    sums(experiment.runs, Step::is_for_voxels)
}
