//! The mesh derivation time (section 4.1 and Figure 6).

use crate::agreement::MESH_SIZES;
use geometry::{MeshSize, Paths, shrink_once};

use super::Experiment;
use super::published::{FIGURE_6_MACHINE, TABLE_2, TABLE_2_TRIANGLES};
use crate::{BenchError, Cell, Costs, PowerLaw, PreparedHead, Table, column, readable, timed};

/// The number of meshes per derivation time: one voxel deep, two, and so on.
const DEPTHS: usize = 50;

/// The number of rounds through all depths, because a single look-up takes only microseconds.
const LEAST_MEASURED_S: f64 = 0.02;

/// The derivation times of a mesh of one size.
#[derive(Debug)]
pub(super) struct Derivation {
    pub(super) size: MeshSize,
    /// Making the mesh of the envelope, once.
    mesh: Costs,
    /// Making the table of all depths, once.
    table: Costs,
    /// A depth from the table.
    pub(super) looked_up: Costs,
    /// A depth without a table, along the paths, as in the paper.
    pub(super) walked: Costs,
}

/// The derivation times of all ten sizes.
pub(super) fn measure(experiment: &Experiment<'_>) -> Result<Vec<Derivation>, BenchError> {
    let of = |[contours, points]: [usize; 2]| {
        let size = MeshSize::new(contours, points)?;
        derivation(experiment.head, size, experiment.protocol.repeat)
    };
    MESH_SIZES.into_iter().map(of).collect()
}

/// The depths of the 50 meshes, in mm, limited to the deepest voxel.
fn depths(case: &PreparedHead) -> impl Iterator<Item = f32> + Clone {
    let (spacing_mm, deepest) = (
        case.model().field().spacing_mm(),
        case.distance.max_depth_mm(),
    );
    (1..=DEPTHS).map(move |voxels| (voxels as f32 * spacing_mm).min(deepest))
}

fn derivation(
    case: &PreparedHead,
    size: MeshSize,
    repeat: usize,
) -> Result<Derivation, BenchError> {
    let (mesh, table) = case.table(size)?;
    let depths = depths(case);
    let rounds = {
        let (_, once) = timed(|| depths.clone().for_each(|depth| drop(table.shrink(depth))));
        (LEAST_MEASURED_S / once.wall_s.max(1e-9)).ceil().min(1e6) as usize
    };
    let look_up = || {
        for depth in std::iter::repeat_n(depths.clone(), rounds).flatten() {
            std::hint::black_box(table.shrink(depth));
        }
    };
    let walk = || {
        for depth in depths.clone() {
            let paths = Paths::Forest(&case.forest);
            std::hint::black_box(shrink_once(
                &mesh,
                &case.distance,
                case.model().field(),
                paths,
                depth,
            ));
        }
    };
    let each = |costs: Costs, parts: usize| -> Costs {
        costs
            .all()
            .iter()
            .map(|cost| cost.shared_by(parts))
            .collect()
    };
    Ok(Derivation {
        size,
        mesh: Costs::of(repeat, || {
            geometry::envelope_mesh(case.model().field(), size)
        }),
        table: Costs::of(repeat, || case.table_of(&mesh)),
        looked_up: each(Costs::of(repeat, look_up), rounds * DEPTHS),
        walked: each(Costs::of(repeat, walk), DEPTHS),
    })
}

/// Figure 6: derivation time by mesh size.
pub(super) fn figure_6(derivations: &[Derivation]) -> Table {
    let columns = [
        column("contours", "N_F"),
        column("points", "N_P"),
        column("triangles", "triangles"),
        column("derivation_s", "new depth, s"),
        column("derivation_p95_s", "95 %"),
        column("derivation_cpu_s", "CPU"),
        column("walked_s", "along the paths, s"),
        column("mesh_s", "mesh once, s"),
        column("table_s", "table once, s"),
        column("paper_s", "paper, s"),
    ];
    let title = "Figure 6: mesh derivation time, average of 50 depths";
    let mut table = Table::new("figure_6", title, &columns);
    let machine_f = TABLE_2.iter().find(|row| row.machine == FIGURE_6_MACHINE);
    let median = |costs: &Costs| Cell::from(costs.wall_s().map(|wall| wall.median));
    for row in derivations {
        let is_published = row.size.triangle_count() == TABLE_2_TRIANGLES;
        let paper = machine_f.filter(|_| is_published);
        table.push([
            row.size.contour_count().into(),
            row.size.points_per_contour().into(),
            row.size.triangle_count().into(),
            median(&row.looked_up),
            row.looked_up.wall_s().map(|wall| wall.p95).into(),
            row.looked_up.cpu_s().map(|cpu| cpu.median).into(),
            median(&row.walked),
            median(&row.mesh),
            median(&row.table),
            paper.map(|row| row.derivation_s).into(),
        ]);
    }
    table.note("New depth: from two rows of a table that is made once per mesh size. Along the paths: without the table, as in the paper.");
    table.note("The paper plots machine F; its text states only the number for 1,800 triangles, and that growth is linear.");
    for (key, what) in [
        ("derivation_s", "New depth"),
        ("walked_s", "Along the paths"),
    ] {
        if let Some(law) = PowerLaw::fit(&table.pairs("triangles", key)) {
            let exponent = readable(law.exponent);
            table.note(format!(
                "{what}: grows with the triangles to the power of {exponent}."
            ));
        }
    }
    table
}
