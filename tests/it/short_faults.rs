//! Four programs of `tests/faults/` in their short forms; `make faults` runs all of them in full.

use std::path::Path;
use std::process::Command;

use crate::several_machines::program;

/// The status with which such a program ends if this machine does not allow what it does.
const SKIPPED: i32 = 77;

/// Runs a program; fails if one of its expectations is not met.
fn holds(name: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("faults");
    let run = Command::new("python3")
        .arg(folder.join(name))
        .arg("--short")
        .env("ISOCORTEX_BINARY", program())
        .env_remove("ISOCORTEX_FAULTS_TABLE")
        .output();
    let Ok(run) = run else {
        return crate::skipped("python3 is missing");
    };
    let written = [run.stdout, run.stderr].concat();
    let written = String::from_utf8_lossy(&written);
    match run.status.code() {
        Some(0) => {}
        Some(SKIPPED) => eprintln!("SKIPPED: {written}"),
        _ => panic!("{written}"),
    }
}

#[test]
fn a_power_cut_loses_nothing_that_was_acknowledged() {
    holds("power_cuts.py");
}

#[test]
fn a_kill_at_a_system_call_leaves_nothing_torn() {
    holds("kill_points.py");
}

#[test]
fn every_flipped_bit_is_found_and_none_is_served() {
    holds("flipped_bits.py");
}

#[test]
fn a_kill_while_a_pacs_stores_or_is_sent_to_loses_nothing_and_doubles_nothing() {
    holds("killed_neighbour.py");
}
