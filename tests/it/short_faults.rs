//! The programs of `tests/faults/` that have a short form, each for some seconds; `make faults` runs the long ones.

use std::path::Path;
use std::process::Command;

use crate::several_machines::program;

/// The status with which such a program ends if this machine does not allow what it does.
const SKIPPED: i32 = 77;

/// Runs a program; fails if one of its expectations is not met.
fn holds(name: &str) {
    holds_with(name, &[]);
}

/// The same with further words.
fn holds_with(name: &str, words: &[&str]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("faults");
    let run = Command::new("python3")
        .arg(folder.join(name))
        .arg("--short")
        .args(words)
        .env("ISOCORTEX_BINARY", program())
        .env_remove("ISOCORTEX_FAULTS_TABLE")
        .output();
    let Ok(run) = run else {
        assert!(std::env::var("CI").is_err(), "python3 is missing");
        return eprintln!("SKIPPED: python3 is missing");
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
fn a_full_disk_is_said_and_got_over() {
    holds("full_disk.py");
}

#[test]
fn a_failing_disk_is_said_and_got_over() {
    holds("failing_disk.py");
}

#[test]
fn every_flipped_bit_is_found_and_none_is_served() {
    holds("flipped_bits.py");
}

#[test]
fn one_study_is_one_case_however_often_it_is_uploaded_deleted_or_cut_off() {
    holds("same_study.py");
}

#[test]
fn objects_that_vanish_are_made_again_with_the_same_bytes_on_both_back_ends() {
    holds("vanished.py");
}

#[test]
fn cases_that_are_too_old_go_completely_unless_they_are_kept() {
    holds("expired_cases.py");
}

#[test]
fn every_case_is_prepared_once_though_workers_are_killed() {
    holds("killed_workers.py");
}

#[test]
fn a_kill_while_a_pacs_stores_or_is_sent_to_loses_nothing_and_doubles_nothing() {
    holds("killed_neighbour.py");
}

#[test]
fn seen_cases_are_served_while_the_object_store_is_away() {
    holds_with("away.py", &["objects"]);
}

#[test]
fn a_rolling_restart_behind_the_proxy_fails_no_request() {
    holds("rolling_restart.py");
}

#[test]
fn a_rolling_upgrade_over_a_schema_version_fails_no_request() {
    holds("rolling_upgrade.py");
}

#[test]
fn mixed_use_with_attackers_leaves_nothing_behind() {
    holds("soak.py");
}

#[test]
fn a_lost_server_moves_its_own_cases_alone() {
    holds("lost_server.py");
}

#[test]
fn the_processes_of_the_compose_file_lead_from_the_readme_to_a_picture() {
    holds("compose_cluster.py");
}

#[test]
fn the_files_for_kubernetes_are_sound_and_agree_with_the_compose_file() {
    holds("kubernetes_files.py");
}
