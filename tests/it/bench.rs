//! `isocortex bench`, on a small made-up head: every table is there, and numbers are in it.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// The program, built beside this one; `None`, said loudly, where it is not.
fn program() -> Option<PathBuf> {
    let this = std::env::current_exe().expect("this program has a path");
    let folder = this.parent().and_then(Path::parent)?;
    let program = folder.join(format!("isocortex{}", std::env::consts::EXE_SUFFIX));
    if program.is_file() {
        return Some(program);
    }
    assert!(std::env::var_os("CI").is_none(), "build the program first");
    eprintln!("SKIPPED: no isocortex beside the tests; run cargo build --bin isocortex");
    None
}

/// What it prints as JSON with these arguments and a small head.
fn report(arguments: &[&str]) -> Option<Value> {
    let output = Command::new(program()?)
        .args(["bench", "--phantom", "4", "--quick", "--json"])
        .args(["--gpu", "off", "--size", "64"])
        .args(arguments)
        .env_remove("ISOCORTEX_DEMO_VOLUME")
        .env_remove("ISOCORTEX_DEMO_MASK")
        .output()
        .expect("it can be run");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report: Value = serde_json::from_slice(&output.stdout).expect("it prints JSON");
    assert_eq!(report["format"], "isocortex-bench 1");
    Some(report)
}

fn rows<'a>(report: &'a Value, table: &str) -> &'a [Value] {
    let rows = report["tables"][table]["rows"].as_array();
    rows.unwrap_or_else(|| panic!("no table {table}"))
}

fn positive(row: &Value, key: &str) -> f64 {
    let number = row[key].as_f64();
    let number = number.unwrap_or_else(|| panic!("no number {key} in {row}"));
    assert!(number > 0.0, "{key} in {row}");
    number
}

#[test]
fn the_papers_tables_and_figures_are_there_with_its_own_numbers_beside_them() {
    let plots = tempfile::tempdir().expect("a directory");
    let path = plots.path().join("made by it");
    let Some(report) = report(&["--plot", path.to_str().expect("UTF-8")]) else {
        return;
    };
    assert!(report["machine"]["processor"].is_string());
    assert!(
        report["graphics"]
            .as_str()
            .expect("a sentence")
            .contains("turned off")
    );
    assert!(positive(&report["head"], "envelope_voxels") > 10_000.0);
    for step in rows(&report, "setup") {
        positive(step, "wall_ms");
    }
    let table_2 = rows(&report, "table_2");
    assert_eq!((table_2.len(), &table_2[0]["paper_best"]), (5, &5.8.into()));
    positive(&table_2[0], "here");
    positive(&table_2[1], "here");
    for line in rows(&report, "table_3") {
        let (here, best) = (positive(line, "here"), positive(line, "paper_best"));
        let is_time = line["figure"] == "setup, s";
        let ratio = if is_time { best / here } else { here / best };
        assert!((positive(line, "times_best") - ratio).abs() < 1e-9 * ratio);
    }
    let figure_5 = rows(&report, "figure_5");
    let mut painters: Vec<_> = figure_5.iter().map(|row| &row["painter"]).collect();
    assert_eq!(painters.len(), 12, "a row for each size of mesh");
    painters.dedup();
    assert_eq!(painters, ["splat", "mesh", "trace"]);
    for name in ["figure_6", "figure_7"] {
        let triangles = rows(&report, name)
            .iter()
            .map(|row| positive(row, "triangles"));
        let paper = [200, 400, 600, 800, 1800, 2400, 3200, 4000, 6000, 8000].map(f64::from);
        assert_eq!(triangles.collect::<Vec<_>>(), paper);
    }
    let facets = |row: &Value| positive(row, "facet_depth_mean_mm");
    let figure_7 = rows(&report, "figure_7");
    assert!(
        facets(&figure_7[9]) < facets(&figure_7[0]),
        "finer is nearer"
    );
    for plot in [
        "figure_5_envelope",
        "figure_5_inner",
        "figure_6",
        "figure_7",
    ] {
        let svg = std::fs::read_to_string(path.join(format!("{plot}.svg"))).expect("a plot");
        assert!(svg.starts_with("<svg") && svg.contains("triangles"));
    }
}

#[test]
fn growth_has_a_table_of_each_kind_with_its_exponents() {
    let Some(report) = report(&["--growth"]) else {
        return;
    };
    let sizes = [
        ("growth_volume", "voxels", 2),
        ("growth_triangles", "triangles", 4),
        ("growth_pixels", "pixels", 6),
        ("growth_cases", "cases", 2),
    ];
    for (name, size, count) in sizes {
        let found = rows(&report, name);
        assert_eq!(found.len(), count, "{name}");
        assert!(found.iter().all(|row| positive(row, size) > 0.0));
        let notes = report["tables"][name]["notes"].to_string();
        assert!(
            notes.contains("Grows as") || notes.contains("grows as"),
            "{name}: {notes}"
        );
    }
    assert!(
        rows(&report, "growth_threads")
            .iter()
            .any(|row| row["step"] == "all steps")
    );
}

#[test]
fn a_server_of_its_own_answers_every_kind_of_request_without_errors() {
    let Some(report) = report(&["--load"]) else {
        return;
    };
    let found = rows(&report, "load");
    assert_eq!(
        found.len(),
        8,
        "four kinds of request, 1 and 16 connections"
    );
    for row in found {
        positive(row, "requests_per_s");
        assert!(positive(row, "p99_ms") >= positive(row, "p50_ms"));
        assert_eq!(row["errors"], 0, "{row}");
    }
}

#[test]
fn what_cannot_be_measured_is_refused_in_a_sentence() {
    let Some(program) = program() else { return };
    let refused = [
        (&["--phantom", "9"][..], 2, "0.5 to 4"),
        (&["--seconds", "0"], 2, "above 0"),
        (
            &["--volume", "/nowhere.nii", "--mask", "/nowhere.nii"],
            66,
            "cannot be read",
        ),
    ];
    for (arguments, status, words) in refused {
        let output = Command::new(&program).arg("bench").args(arguments).output();
        let output = output.expect("it can be run");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(
            output.status.code(),
            Some(status),
            "{arguments:?}: {errors}"
        );
        assert!(errors.contains(words), "{errors}");
    }
}

#[test]
fn steps_are_done_by_name_between_those_of_other_programs() {
    use std::io::Write as _;
    let Some(program) = program() else { return };
    let folder = tempfile::tempdir().expect("a directory");
    let mut child = Command::new(program)
        .args(["bench", "--phantom", "4", "--quick", "--take-turns"])
        .arg(folder.path())
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("it can be run");
    let mut steps = child.stdin.take().expect("it is piped");
    steps.write_all(b"closing\ndistance\n").expect("it listens");
    drop(steps);
    let output = child.wait_with_output().expect("it ends with its input");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(lines[0]["ready"], true);
    assert!(
        positive(&lines[1], "check") > 10_000.0,
        "voxels of the envelope"
    );
    assert!((30.0..80.0).contains(&positive(&lines[2], "check")), "mm");
    assert!(folder.path().join("envelope.nii.gz").is_file());
}
