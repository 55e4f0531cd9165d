//! Steps with countable instructions, which do not depend on other load of the machine.

use std::process::ExitCode;

use crate::{Costs, Machine, readable};

/// The number of timings of a step.
const TIMES: usize = 10;

/// A step, and its input.
#[derive(Clone, Copy)]
pub struct Counted {
    /// Its name, as in the recorded base.
    pub name: &'static str,
    /// Prepares the input, outside the count, and returns the step.
    pub make: fn() -> Box<dyn FnMut()>,
}

/// The main function of a program of steps.
///
/// `--list` prints their names. `--count NAME` performs that step once, within [`isocortex_counted_step`]. `--vectors`
/// prints the vector instructions of the CPU, or those that the counter emulates. Without arguments it prints the time
/// of each step: the least of ten.
pub fn run(steps: &[Counted]) -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["--list"] => steps.iter().for_each(|step| println!("{}", step.name)),
        ["--count", name] => {
            let Some(step) = steps.iter().find(|step| step.name == name) else {
                eprintln!("there is no step {name}");
                return ExitCode::FAILURE;
            };
            let mut step = (step.make)();
            isocortex_counted_step(&mut step);
        }
        ["--vectors"] => println!("{}", Machine::this().vectors),
        // `cargo bench` adds --bench.
        [] | ["--bench"] => steps.iter().for_each(time),
        _ => {
            eprintln!("arguments: --list, --vectors, --count NAME, or none");
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// Performs a step. The counter of instructions recognises this function by its unique name.
#[inline(never)]
pub fn isocortex_counted_step(step: &mut dyn FnMut()) {
    step();
}

fn time(step: &Counted) {
    let mut run = (step.make)();
    let costs = Costs::of(TIMES, || isocortex_counted_step(&mut run));
    let least_ms = costs.least_s() * 1e3;
    println!("{:>12} ms  {}", readable(least_ms), step.name);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counted_step_is_done_once() {
        let mut count = 0;
        isocortex_counted_step(&mut || count += 1);
        assert_eq!(count, 1);
    }
}
