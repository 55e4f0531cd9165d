//! `isocortex-bench` on a small made-up head: every table is there, and numbers are in it.

use std::path::Path;
use std::process::{Command, Output};

use geometry::{Grid, Volume};
use glam::{DAffine3, DVec3};
use serde_json::Value;

/// Runs the program on a small head.
fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_isocortex-bench"))
        .args(arguments)
        .env_remove("ISOCORTEX_DEMO_VOLUME")
        .env_remove("ISOCORTEX_DEMO_MASK")
        .env_remove("ISOCORTEX_NETWORK")
        .output()
        .expect("it can be run")
}

/// What it prints as JSON.
fn report(arguments: &[&str]) -> Value {
    let output = run(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    serde_json::from_slice(&output.stdout).expect("it prints JSON")
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
    let mut arguments = vec!["paper", "--phantom", "4", "--quick", "--json", "--cpu-only"];
    arguments.extend(["--size", "64", "--plot", path.to_str().expect("UTF-8")]);
    let report = report(&arguments);
    assert_eq!(report["format"], "isocortex-bench 1");
    assert!(report["machine"]["processor"].is_string());
    assert_eq!(report["graphics"], "not used");
    assert!(positive(&report["head"], "envelope_voxels") > 10_000.0);
    let setup = rows(&report, "setup");
    assert_eq!(setup.len(), 15, "13 steps and two sums");
    for step in setup {
        positive(step, "wall_ms");
    }
    let table_2 = rows(&report, "table_2");
    assert_eq!((table_2.len(), &table_2[0]["paper_best"]), (7, &5.8.into()));
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

/// Width and height of a PNG, from its header.
fn size_of_png(bytes: &[u8]) -> [u32; 2] {
    assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n"));
    [16, 20].map(|at| u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes")))
}

#[test]
fn the_papers_figures_are_drawn() {
    let folder = tempfile::tempdir().expect("a directory");
    let path = folder.path().join("made by it");
    let mut arguments = vec!["paper", "--phantom", "2", "--quick", "--json", "--cpu-only"];
    arguments.extend(["--renderer", "splat", "--size", "32", "--seconds", "0.01"]);
    arguments.extend(["--pictures", path.to_str().expect("UTF-8")]);
    let report = report(&arguments);
    assert_eq!(rows(&report, "figure_4").len(), 8);
    assert_eq!(rows(&report, "contours").len(), 3);
    for row in rows(&report, "closest") {
        // The closest point is at least as near as ours; a vertex lies up to a voxel off the voxels of the envelope.
        let closest = positive(row, "closest_mm");
        assert!(closest + 2.0 > positive(row, "depth_mm"), "{row}");
        assert!(positive(row, "flow_mm") > closest - 2.0, "{row}");
    }
    for row in rows(&report, "shells") {
        assert!(positive(row, "share") < 0.5, "{row}");
    }
    let drawn = [
        ("figure_1_envelope", [4, 190]),
        ("figure_2_meshes", [4, 220]),
        ("figure_3_distances_and_paths", [4, 240]),
        ("figure_4_shrunk_meshes", [4, 220]),
        ("figure_7_a_to_e", [5, 150]),
        ("figure_7_f_to_j", [5, 150]),
        ("figure_7_k", [5, 150]),
        ("figure_8_lowest_part", [4, 190]),
        ("poles", [2, 256]),
    ];
    for (name, [columns, cell]) in drawn {
        let bytes = std::fs::read(path.join(format!("{name}.png"))).expect("a picture");
        let [width, height] = size_of_png(&bytes);
        assert!(
            (columns * cell..columns * cell + 200).contains(&width),
            "{name}: {width}"
        );
        assert!(height > cell, "{name}: {height}");
        // A blank picture of this size takes less.
        assert!(bytes.len() > 3000, "{name}: {} bytes", bytes.len());
    }
    for name in ["figure_5_envelope", "figure_5_inner", "figure_6"] {
        let svg = std::fs::read_to_string(path.join(format!("{name}.svg"))).expect("a plot");
        assert!(svg.starts_with("<svg") && svg.contains("triangles"));
    }
}

/// The study, with the least number of blurs that the list has to find in the made-up head.
#[test]
fn the_study_finds_most_blurs_and_reuses_its_results() {
    let folder = tempfile::tempdir().expect("a directory");
    let results = folder.path().to_str().expect("UTF-8");
    let arguments = |lesions| {
        let fixed = ["study", "--json", "--shams", "1", "--results", results];
        [&fixed[..], &["--lesions", lesions]].concat()
    };
    let first = report(&arguments("8"));
    let reports = first.as_array().expect("two simulators");
    assert_eq!(reports.len(), 2);
    for report in reports {
        let trials = report[1][0]["trials"].as_array().expect("trials");
        assert_eq!(trials.len(), 9);
        let blurs = trials.iter().filter(|trial| trial["sign"] == "blur");
        let found = blurs.filter(|blur| {
            let above = &blur["sightings"][0]["false_marks"];
            above.as_u64().is_some_and(|above| above < 5)
        });
        assert!(found.count() >= 1, "{report:#}");
    }
    let again = run(&arguments("8"));
    assert!(
        again.stderr.is_empty(),
        "a head with results is not run again"
    );
    let again: Value = serde_json::from_slice(&again.stdout).expect("it prints JSON");
    assert_eq!(again, first);
    // A run with other parameters must not take these results for its own.
    let refused = run(&arguments("3"));
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert!(!refused.status.success() && refused.stdout.is_empty());
    assert!(errors.contains("lesions 8, not 3"), "{errors}");
    assert!(errors.contains("--results"), "{errors}");
}

/// Writes a volume as NIfTI and returns the path.
fn written(folder: &Path, volume: &Volume) -> String {
    let path = folder.join("head.nii.gz");
    let bytes = imaging::nifti::write_volume(volume).expect("a volume can be written");
    std::fs::write(&path, bytes).expect("the folder can be written");
    path.to_str().expect("UTF-8").to_owned()
}

#[test]
fn the_brain_of_a_head_without_a_mask_is_extracted_for_the_study() {
    let folder = tempfile::tempdir().expect("a directory");
    let head = written(folder.path(), &geometry::phantom::head(1.0).volume);
    let results = folder.path().to_str().expect("UTF-8");
    let named = format!("bare={head}");
    let output = run(&[
        "study",
        "--head",
        &named,
        "--lesions",
        "1",
        "--shams",
        "0",
        "--json",
        "--results",
        results,
    ]);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert!(
        errors.contains("bare: the mask was made by tree pruning; its rating is review: "),
        "{errors}"
    );
    let report: Value = serde_json::from_slice(&output.stdout).expect("it prints JSON");
    assert_eq!(report[0][1][0]["name"], "bare");
    let no_network = run(&[
        "study",
        "--head",
        "other=/nowhere.nii",
        "--network",
        "/nowhere.whl",
        "--results",
        results,
    ]);
    assert_eq!(no_network.status.code(), Some(66));
}

#[test]
fn a_volume_without_a_brain_is_refused_by_the_study_with_the_reason() {
    let folder = tempfile::tempdir().expect("a directory");
    let head = geometry::phantom::head(1.0).volume;
    // A third of the size of a head: its brain is smaller than any.
    let axes = head.grid().patient_from_voxel() * DAffine3::from_scale(DVec3::splat(0.7));
    let grid = Grid::new(head.grid().size(), axes).expect("a grid");
    let small = Volume::new(grid, head.voxels().to_vec(), head.rescale()).expect("a volume");
    let empty = Volume::new(
        head.grid().clone(),
        vec![7; head.grid().voxel_count()],
        head.rescale(),
    );
    let empty = empty.expect("a volume");
    let results = folder.path().to_str().expect("UTF-8");
    for (volume, reason) in [
        (&small, "rated failed (the mask has"),
        (&empty, "no brain was found"),
    ] {
        let named = format!("head={}", written(folder.path(), volume));
        let output = run(&["study", "--head", &named, "--results", results]);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(65), "{errors}");
        assert!(
            errors.contains(reason) && errors.contains("; give a mask"),
            "{errors}"
        );
    }
}

#[test]
fn a_study_that_was_killed_continues_and_its_results_are_the_same_bytes() {
    let [whole, cut] = [(); 2].map(|()| tempfile::tempdir().expect("a directory"));
    let arguments = |folder: &tempfile::TempDir| {
        let folder = folder.path().to_str().expect("UTF-8").to_owned();
        let fixed = ["study", "--lesions", "8", "--shams", "4", "--results"];
        [&fixed.map(str::to_owned)[..], &[folder]].concat()
    };
    let study = |folder| {
        let arguments = arguments(folder);
        let output = run(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{errors}");
        let results = ["displaced", "painted"].map(|simulator| {
            let result = folder.path().join(simulator).join("made-up.json");
            std::fs::read(result).expect("a result")
        });
        (errors, results)
    };
    let (errors, expected) = study(&whole);
    assert_eq!(errors.lines().count(), 24, "{errors}");

    let unfinished = cut.path().join("displaced/made-up.unfinished");
    let mut process = Command::new(env!("CARGO_BIN_EXE_isocortex-bench"))
        .args(arguments(&cut))
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("it can be run");
    let stored = || std::fs::read_to_string(&unfinished).unwrap_or_default();
    while stored().lines().count() < 4 && process.try_wait().expect("a process").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    process.kill().expect("a process");
    process.wait().expect("a process");
    assert!(!cut.path().join("displaced/made-up.json").exists());
    // A line for the parameters, and one for each trial; the last one is cut off.
    let kept = stored().lines().count() - 2;
    let mut torn = stored().trim_end().to_owned();
    torn.truncate(torn.len() - 9);
    std::fs::write(&unfinished, torn).expect("a file");

    let (errors, found) = study(&cut);
    assert_eq!(errors.lines().count(), 24 - kept, "{errors}");
    assert!(kept > 0 && found == expected);
    assert!(!unfinished.exists());
}

#[test]
fn one_renderer_may_be_asked_for() {
    let mut arguments = vec!["paper", "--phantom", "4", "--quick", "--json", "--cpu-only"];
    arguments.extend(["--size", "32", "--renderer", "trace"]);
    let report = report(&arguments);
    let figure_5 = rows(&report, "figure_5");
    assert_eq!(
        (figure_5.len(), &figure_5[0]["painter"]),
        (1, &"trace".into())
    );
}

#[test]
fn agreement_is_told_as_a_table_a_plot_and_markdown() {
    let plots = tempfile::tempdir().expect("a directory");
    let path = plots.path().to_str().expect("UTF-8");
    let mut arguments = vec![
        "agreement",
        "--phantom",
        "4",
        "--size",
        "32",
        "--plot",
        path,
    ];
    arguments.push("--json");
    let report = report(&arguments);
    let found = rows(&report, "agreement");
    assert_eq!(found.len(), 10);
    assert!(positive(&found[9], "mean_5mm") < positive(&found[0], "mean_5mm"));
    let svg = std::fs::read_to_string(plots.path().join("agreement.svg")).expect("a plot");
    assert!(svg.contains("30 mm deep"));
    let output = run(&["agreement", "--phantom", "4", "--size", "32", "--markdown"]);
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(text.starts_with("| triangles | 0 mm |"), "{text}");
}

#[test]
fn a_step_is_taken_alone_and_leaves_the_envelope() {
    let folder = tempfile::tempdir().expect("a directory");
    let envelope = folder.path().join("envelope.nii.gz");
    let path = envelope.to_str().expect("UTF-8");
    let found = report(&["step", "distance", "--phantom", "4", "--envelope", path]);
    assert_eq!(found["step"], "distance");
    positive(&found, "wall_s");
    assert!((30.0..80.0).contains(&positive(&found, "check")), "mm");
    assert!(envelope.is_file());
}

#[test]
fn what_cannot_be_measured_is_refused_in_a_sentence() {
    let refused = [
        (&["paper", "--phantom", "9"][..], 2, "0.5 to 4"),
        (&["paper", "--seconds", "0"], 2, "above 0"),
        (&["step", "cerebellum"], 2, "closing, distance"),
        (&["study", "--head", "=t1.nii.gz"], 2, "valid name"),
        (&["study", "--head", "t1.nii.gz"], 2, "NAME=VOLUME"),
        (&["study", "--head", "a=t1.nii.gz,"], 2, "NAME=VOLUME"),
        (
            &[
                "paper",
                "--volume",
                "/nowhere.nii",
                "--mask",
                "/nowhere.nii",
            ],
            66,
            "cannot be read",
        ),
        (
            &["agreement", "--phantom", "4", "--plot", "/dev/null/plots"],
            73,
            "cannot be written",
        ),
    ];
    for (arguments, status, words) in refused {
        let output = run(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(
            output.status.code(),
            Some(status),
            "{arguments:?}: {errors}"
        );
        assert!(errors.contains(words), "{errors}");
    }
}
