//! Growth with the threads.

use super::Growth;
use crate::{Costs, MeasureError, MeasuredCase, Painter, Spin, Step, Table, column};

/// Wall times with one thread and with as many as there are, step by step.
pub(super) fn table(growth: &Growth<'_>) -> Result<Table, MeasureError> {
    let columns = [
        column("step", "step"),
        column("threads", "threads"),
        column("wall_one_ms", "wall, 1 thread, ms"),
        column("wall_all_ms", "wall, all, ms"),
        column("faster", "× faster"),
        column("cpu_more", "× the CPU time"),
    ];
    let threads = rayon::current_num_threads();
    let title = format!("Growth with the threads: least of {}", growth.extent.repeat);
    let mut table = Table::new("growth_threads", title, &columns);
    let one = on_threads(growth, 1)?;
    let all = on_threads(growth, threads)?;
    for ((name, one), (_, all)) in one.into_iter().zip(all) {
        let least = |costs: &Costs| costs.wall_s().map_or(f64::NAN, |wall| wall.least * 1e3);
        table.push([
            name.into(),
            threads.into(),
            least(&one).into(),
            least(&all).into(),
            (least(&one) / least(&all)).into(),
            (all.least_s() / one.least_s()).into(),
        ]);
    }
    if threads == 1 {
        table.note("This process may use one thread alone.");
    }
    Ok(table)
}

/// The costs of each step and of a picture, on a pool of so many threads.
fn on_threads(growth: &Growth<'_>, threads: usize) -> Result<Vec<(String, Costs)>, MeasureError> {
    growth
        .tell
        .tell(&format!("growth with the threads: {threads}"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let measure = || {
        let runs: Result<Vec<_>, MeasureError> = (0..growth.extent.repeat.max(1))
            .map(|_| Ok(MeasuredCase::prepare(growth.head, growth.closing_radius_mm)?.1))
            .collect();
        let runs = runs?;
        let of = |step: Step| runs.iter().map(|run| run.of(step)).collect();
        let mut costs: Vec<(String, Costs)> = Step::ALL
            .into_iter()
            .map(|step| (step.to_string(), of(step)))
            .collect();
        costs.push(("all steps".to_owned(), crate::case::sums(&runs, |_| true)));
        for painter in [Painter::Splat, Painter::Trace] {
            let spin = Spin {
                frames: 1,
                seconds: 1.0,
                size: growth.frame(512)?,
                depth_mm: growth.depth_mm,
            };
            let request = spin.request(growth.case, 0)?;
            let draw = || painter.draw(growth.case, request, None);
            let name = format!("frame of 512² by {}", painter.name());
            costs.push((name, Costs::of(growth.extent.repeat * 3, draw)));
        }
        Ok(costs)
    };
    match pool {
        Ok(pool) => pool.install(measure),
        // No threads to be had: what follows is measured on those that there are.
        Err(_) => measure(),
    }
}
