//! Rotation frame rates: Tables 2 and 3, and Figure 5.

use crate::agreement::MESH_SIZES;
use geometry::MeshSize;
use render::{RenderBackend, SizedMesh};

use super::derivation::Derivation;
use super::published::{Range, TABLE_2, TABLE_2_TRIANGLES, TABLE_3, rates, times};
use super::{Experiment, setup};
use crate::rotation::backend_label;
use crate::{BenchError, Cell, Costs, Rate, Spin, Summary, Table, column};

/// The frames of four turns, for facets.
const FOUR_TURNS: usize = 1440;
/// The frames of one turn, for voxels.
const ONE_TURN: usize = 360;

/// The rates of one backend, at depth 0 and at the inner depth.
#[derive(Debug)]
pub(super) struct Spun {
    /// Its name.
    painter: &'static str,
    /// The mesh that was drawn, if any.
    size: Option<MeshSize>,
    is_splat: bool,
    envelope: Rate,
    inner: Rate,
}

/// The rates of every backend; backends that draw meshes use each of the ten sizes.
pub(super) fn measure(experiment: &Experiment<'_>) -> Result<Vec<Spun>, BenchError> {
    let mut spins = Vec::new();
    for backend in experiment.backends {
        if !backend.needs_mesh() {
            spins.push(spun(experiment, backend, None)?);
            continue;
        }
        for [contours, points] in MESH_SIZES {
            let size = MeshSize::new(contours, points)?;
            spins.push(spun(experiment, backend, Some(size))?);
        }
    }
    Ok(spins)
}

fn spun(
    experiment: &Experiment<'_>,
    backend: &RenderBackend,
    size: Option<MeshSize>,
) -> Result<Spun, BenchError> {
    let (head, protocol) = (experiment.head, experiment.protocol);
    let table = size.map(|size| head.table(size)).transpose()?;
    let rate = |depth_mm: f32| {
        let mesh = table.as_ref().map(|(_, table)| SizedMesh {
            size: table.size,
            mesh: table.shrink(depth_mm),
        });
        let what = size.map_or_else(String::new, |size| {
            format!(", {} triangles", size.triangle_count())
        });
        let name = backend_label(backend);
        (experiment.progress)(&format!("frame rate of {name}{what} at {depth_mm:.1} mm"));
        let spin = Spin {
            frames: size.map_or(ONE_TURN, |_| FOUR_TURNS),
            seconds: protocol.seconds,
            size: protocol.size,
            depth_mm,
        };
        spin.rate(head, backend, mesh)
    };
    Ok(Spun {
        painter: backend_label(backend),
        size,
        is_splat: matches!(backend, RenderBackend::Splat),
        envelope: rate(0.0)?,
        inner: rate(protocol.inner_depth_mm(head))?,
    })
}

/// One line of a table, with the published figures.
struct Line {
    name: String,
    here: Option<f64>,
    /// The worse and the better end of the measured spread.
    spread: Option<[f64; 2]>,
    cpu: Option<f64>,
    paper: Range,
    /// Whether more is better.
    is_rate: bool,
}

impl Line {
    fn time(name: &str, costs: &Costs, paper: Range) -> Self {
        let wall = costs.wall_s();
        Self {
            name: name.to_owned(),
            here: wall.map(|wall| wall.median),
            spread: wall.map(|wall| [wall.p95, wall.p5]),
            cpu: costs.cpu_s().map(|cpu| cpu.median),
            paper,
            is_rate: false,
        }
    }

    fn rate(name: &str, rate: Option<&Rate>, paper: Range) -> Self {
        let spread = |wall: &Summary| [1.0 / wall.p95, 1.0 / wall.p5];
        Self {
            name: name.to_owned(),
            here: rate.map(|rate| rate.frames_per_s),
            spread: rate.map(|rate| spread(&rate.wall_s)),
            cpu: rate.and_then(|rate| rate.cpu_s),
            paper,
            is_rate: true,
        }
    }

    /// The rate at which isosurfaces of different depths are shown: each one is derived and drawn once.
    ///
    /// Source: the paper, section 4. Its formula should read 1 / (1 / RFR + MDT).
    fn changing_rate(name: &str, rate: Option<&Rate>, derivation: &Costs, paper: Range) -> Self {
        let derivation = derivation.wall_s().map(|wall| wall.median);
        let here = rate.zip(derivation);
        Self {
            name: name.to_owned(),
            here: here.map(|(rate, derivation)| changing(rate.frames_per_s, derivation)),
            spread: None,
            cpu: None,
            paper,
            is_rate: true,
        }
    }

    fn cells(self) -> Vec<Cell> {
        let better = |than: f64| {
            self.here.map(|here| {
                if self.is_rate {
                    here / than
                } else {
                    than / here
                }
            })
        };
        vec![
            self.name.into(),
            self.here.into(),
            self.spread.map(|[worse, _]| worse).into(),
            self.spread.map(|[_, better]| better).into(),
            self.cpu.into(),
            self.paper.best.into(),
            self.paper.worst.into(),
            better(self.paper.best).into(),
            better(self.paper.worst).into(),
        ]
    }
}

/// Frames per second if each one has another depth.
fn changing(frames_per_s: f64, derivation_s: f64) -> f64 {
    1.0 / (1.0 / frames_per_s + derivation_s)
}

fn beside_paper(name: &'static str, title: String, lines: Vec<Line>) -> Table {
    let columns = [
        column("figure", ""),
        column("here", "here"),
        column("here_worse", "worst 5 %"),
        column("here_better", "best 5 %"),
        column("cpu_s", "CPU, s"),
        column("paper_best", "paper, best"),
        column("paper_worst", "paper, worst"),
        column("times_best", "× its best"),
        column("times_worst", "× its worst"),
    ];
    let mut table = Table::new(name, title, &columns);
    for line in lines {
        table.push(line.cells());
    }
    table
}

/// Table 2: 1,800 triangles.
pub(super) fn table_2(
    experiment: &Experiment<'_>,
    spins: &[Spun],
    derivations: &[Derivation],
) -> Table {
    let is_published =
        |size: Option<MeshSize>| size.is_some_and(|s| s.triangle_count() == TABLE_2_TRIANGLES);
    let spun = spins.iter().find(|spun| is_published(spun.size));
    let derivation = derivations.iter().find(|row| is_published(Some(row.size)));
    let of = |figure: fn(&super::published::MeshRow) -> f64| TABLE_2.iter().map(figure);
    let envelope = rates(of(|row| row.envelope_fps));
    let inner = rates(of(|row| row.inner_fps));
    let mdt = times(of(|row| row.derivation_s));
    let nothing = Costs::default();
    let looked_up = derivation.map_or(&nothing, |row| &row.looked_up);
    let walked = derivation.map_or(&nothing, |row| &row.walked);
    let lines = vec![
        Line::time(
            "setup, s",
            &setup::mesh_setup(experiment),
            times(of(|row| row.setup_s)),
        ),
        Line::rate(
            "envelope, frames/s",
            spun.map(|spun| &spun.envelope),
            envelope,
        ),
        Line::rate("inner, frames/s", spun.map(|spun| &spun.inner), inner),
        Line::time("new depth (MDT), s", looked_up, mdt),
        Line::time("new depth without table, s", walked, mdt),
        Line::changing_rate(
            "envelope, changing depth, frames/s",
            spun.map(|spun| &spun.envelope),
            looked_up,
            rates(of(|row| changing(row.envelope_fps, row.derivation_s))),
        ),
        Line::changing_rate(
            "inner, changing depth, frames/s",
            spun.map(|spun| &spun.inner),
            looked_up,
            rates(of(|row| changing(row.inner_fps, row.derivation_s))),
        ),
    ];
    let painter = experiment.mesh_backend().map_or("not drawn", backend_label);
    let title = format!("Table 2: a mesh of 1,800 triangles (30 × 30), {painter}");
    let mut table = beside_paper("table_2", title, lines);
    match spun {
        Some(spun) => table.note(format!(
            "The first picture, including the upload of the textures: {:.3} s. A frame here is drawn and read back.",
            spun.envelope.first_s
        )),
        None => table.note("Frame rates of meshes were not requested."),
    }
    table.note("Changing depth: 1 / (1 / frame rate + time of a new depth), also for the paper, which states no such rates.");
    table.note(frames_note(experiment));
    table
}

/// Table 3: voxel projection.
pub(super) fn table_3(experiment: &Experiment<'_>, spins: &[Spun]) -> Table {
    let spun = spins.iter().find(|spun| spun.is_splat);
    let of = |figure: fn(&super::published::VoxelRow) -> f64| TABLE_3.iter().map(figure);
    let lines = vec![
        Line::time(
            "setup, s",
            &setup::voxel_setup(experiment),
            times(of(|row| row.setup_s)),
        ),
        Line::rate(
            "envelope, frames/s",
            spun.map(|spun| &spun.envelope),
            rates(of(|row| row.envelope_fps)),
        ),
        Line::rate(
            "inner, frames/s",
            spun.map(|spun| &spun.inner),
            rates(of(|row| row.inner_fps)),
        ),
    ];
    let mut table = beside_paper(
        "table_3",
        "Table 3: voxel projection, in software".to_owned(),
        lines,
    );
    table.note(frames_note(experiment));
    table
}

fn frames_note(experiment: &Experiment<'_>) -> String {
    let protocol = &experiment.protocol;
    let (width, height) = (protocol.size.width(), protocol.size.height());
    let inner = protocol.inner_depth_mm(experiment.head);
    format!(
        "Frames of {width} × {height} pixels, lit; inner is {inner:.1} mm deep. The paper states neither."
    )
}

/// Figure 5: frame rates by mesh size, and those of the renderers without a mesh.
pub(super) fn figure_5(experiment: &Experiment<'_>, spins: &[Spun]) -> Table {
    let columns = [
        column("painter", "drawn by"),
        column("triangles", "triangles"),
        column("envelope_fps", "envelope, frames/s"),
        column("inner_fps", "inner, frames/s"),
        column("envelope_frame_ms", "envelope, ms"),
        column("envelope_frame_p95_ms", "95 %"),
        column("envelope_cpu_ms", "CPU, ms"),
        column("inner_frame_ms", "inner, ms"),
        column("inner_frame_p95_ms", "95 %"),
        column("inner_cpu_ms", "CPU, ms"),
    ];
    let title = "Figure 5: rotation frame rate by mesh size; median time of one frame";
    let mut table = Table::new("figure_5", title, &columns);
    for spun in spins {
        let Spun {
            envelope, inner, ..
        } = spun;
        let ms = |seconds: f64| Cell::from(seconds * 1e3);
        table.push([
            spun.painter.into(),
            spun.size.map(MeshSize::triangle_count).into(),
            envelope.frames_per_s.into(),
            inner.frames_per_s.into(),
            ms(envelope.wall_s.median),
            ms(envelope.wall_s.p95),
            envelope.cpu_s.map(|s| s * 1e3).into(),
            ms(inner.wall_s.median),
            ms(inner.wall_s.p95),
            inner.cpu_s.map(|s| s * 1e3).into(),
        ]);
    }
    table.note("The paper's figure is a plot; its text states the numbers for 1,800 triangles (Table 2): 15 to 1,172 and 70 to 1,172 frames/s.");
    table.note(frames_note(experiment));
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_depth_for_each_frame_costs_its_derivation() {
        assert!((changing(100.0, 0.03) - 25.0).abs() < 1e-12);
        // Machine I of the paper.
        assert!((changing(424.0, 0.110) - 8.9).abs() < 0.01);
    }
}
