//! The program `isocortex`: see `isocortex --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    isocortex::cli::main()
}
