//! The hot steps of every crate on a small fixed head, for timing and for counting instructions.
//!
//! `scripts/bench.sh` counts them and compares with the recorded base.

mod geometry_steps;
mod head;
mod imaging_steps;
mod render_steps;

use std::process::ExitCode;

fn main() -> ExitCode {
    // A single thread: a count is then the same in every run.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    let pool = pool.use_current_thread().build_global();
    pool.expect("the first pool of this program");
    let steps = [
        imaging_steps::steps(),
        geometry_steps::steps(),
        render_steps::steps(),
    ];
    bench::counted::run(&steps.concat())
}
