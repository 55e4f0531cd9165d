//! `isocortex-bench`: the experiments of the paper, on this machine.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
