//! The program on the command line.

use std::process::{Command, Output};

use crate::head::plain_head;
use crate::several_machines::program;

/// Runs a command of the program; its status, and what it wrote.
pub(crate) fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let output: Output = Command::new(program())
        .args(arguments)
        .env_remove("ISOCORTEX_CONFIG")
        .env_remove("ISOCORTEX_DATA")
        .env_remove("ISOCORTEX_NETWORK")
        .output()
        .unwrap();
    let written = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(written).unwrap())
}

/// The same, which must end well.
pub(crate) fn done(arguments: &[&str]) -> String {
    let (status, written) = run(arguments);
    assert_eq!(status, Some(0), "{arguments:?}: {written}");
    written
}

#[test]
fn a_newcomer_gets_five_lines_and_ten_about_the_machine() {
    let first = done(&[]);
    assert_eq!(first.lines().count(), 5, "{first}");
    for command in ["demo", "serve", "render", "help"] {
        assert!(first.contains(&format!("isocortex {command}")), "{first}");
    }
    let found = done(&["doctor", "--data", "/nowhere/cases", "--gpu", "off"]);
    assert_eq!(found.lines().count(), 10, "{found}");
    let store =
        "ok      store      none in /nowhere/cases; before you serve: `isocortex init-store --data";
    assert!(found.contains(store), "{found}");
    let version = format!("isocortex {}", env!("CARGO_PKG_VERSION"));
    assert!(done(&["--version"]).starts_with(&version));
}

#[test]
fn layers_are_prepared_with_their_case_and_wrong_ones_are_named() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (head, flair, data) = (path("head.nii"), path("flair.nii"), path("data"));
    std::fs::write(&head, plain_head().bytes()).unwrap();
    std::fs::write(&flair, plain_head().bytes()).unwrap();
    let with = |layer: &str, options: &[&str]| {
        let first = ["prepare", &head, "--data", &data, "--layer", layer];
        run(&[&first[..], options].concat())
    };
    let unit = |unit| with(&flair, &["--layer-unit", unit]);

    let (status, written) = unit("a\nb");
    assert_eq!(status, Some(65), "{written}");
    assert!(
        written.contains("layer FLAIR: the unit must have"),
        "{written}"
    );
    let (status, written) = with(&path("none.nii"), &[]);
    assert_eq!(status, Some(66), "{written}");
    let (status, written) = with(&flair, &["--layer-kind", "mr", "--layer-kind", "ct"]);
    assert_eq!(status, Some(2), "{written}");
    assert!(
        written.contains("--layer-kind once for each --layer"),
        "{written}"
    );

    // One that cannot be added keeps no other out, and the case is there.
    let other = format!("T2={flair}");
    let options = [
        "--layer",
        &other,
        "--layer-unit",
        "a\nb",
        "--layer-unit",
        "a.u.",
    ];
    let (status, written) = with(&flair, &options);
    assert_eq!(status, Some(65), "{written}");
    assert!(written.contains("layer T2: placed"), "{written}");
    assert!(written.contains("not all of its layers"), "{written}");
    assert_eq!(written.lines().next().unwrap().len(), 32, "{written}");

    let (status, written) = with(&format!("T2={flair}"), &["--layer-unit", "a.u."]);
    assert_eq!(status, Some(0), "{written}");
    assert!(written.contains("layer T2: "), "{written}");
    let id = written.lines().next().unwrap().to_owned();
    let picture = path("picture.png");
    let drawn = done(&[
        "render", &id, "--layer", "T2", "--data", &data, "--output", &picture,
    ]);
    assert!(std::fs::metadata(&picture).unwrap().len() > 1000, "{drawn}");
}

#[test]
fn a_volume_and_its_case_look_the_same_and_wrong_values_are_named() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (head, data, objects) = (path("head.nii"), path("data"), path("objects"));
    std::fs::write(&head, plain_head().bytes()).unwrap();
    // As for a server.
    let [rows, at] = [
        format!("sqlite://{}", path("rows.sqlite")),
        format!("file://{objects}"),
    ];
    let store = ["--data", &data, "--database", &rows, "--objects", &at];
    let id = done(&[&["prepare", &head], &store[..]].concat());
    assert!(std::fs::exists(path("rows.sqlite")).unwrap());
    assert!(std::fs::read_dir(&objects).unwrap().count() > 1);
    let id = id.lines().next().unwrap().to_owned();
    let keys = [
        "--renderer",
        "mesh",
        "--depth",
        "6",
        "--width",
        "96",
        "--height=96",
    ];
    let drawn = |input: &str, name: &str| {
        let output = path(name);
        done(&[&["render", input, "-o", &output], &store[..], &keys].concat());
        let file = std::fs::read(output).unwrap();
        image::load_from_memory(&file).unwrap().into_rgba8()
    };
    assert_eq!(drawn(&head, "volume.png"), drawn(&id, "case.png"));
    let (status, written) = run(&["render", &head, "-o", &path("none.png"), "--view", "above"]);
    assert_eq!(status, Some(2), "{written}");
    assert!(
        written.contains("`--view` must be one of `left`"),
        "{written}"
    );
    assert!(!std::fs::exists(path("none.png")).unwrap());
}

#[test]
fn voxels_are_written_in_the_grid_of_the_volume_and_wrong_names_are_refused() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let (head, data, folder) = (path("head.nii"), path("data"), path("voxels"));
    std::fs::write(&head, plain_head().bytes()).unwrap();
    let depth = path("depth.nii.gz");
    done(&["render", &head, "--nifti", "depth", "-o", &depth]);
    let values = |file: &str| {
        let file = std::fs::read(file).unwrap();
        imaging::nifti::read_values(&file, &imaging::Limits::default()).unwrap()
    };
    let whole = values(&head);
    let found = values(&depth);
    assert_eq!(found.grid, whole.grid);
    for (depth_mm, intensity) in found.numbers.iter().zip(&whole.numbers) {
        assert!(
            *intensity == 0.0 || *depth_mm >= 0.0,
            "{depth_mm} {intensity}"
        );
    }
    let written = done(&["prepare", &head, "--data", &data, "--nifti", &folder]);
    assert!(
        written.contains("no blur: "),
        "its voxels are coarse: {written}"
    );
    assert_eq!(
        values(&path("voxels/depth.nii.gz")).numbers.len(),
        whole.numbers.len()
    );
    for (options, words) in [
        (
            ["--nifti", "depth", "-o", "depth.png"],
            "name the file *.nii.gz",
        ),
        (
            ["--nifti", "deep", "-o", "a.nii.gz"],
            "invalid value 'deep'",
        ),
    ] {
        let (status, written) = run(&[&["render", &head], &options[..]].concat());
        assert_eq!(status, Some(2), "{written}");
        assert!(written.contains(words), "{written}");
    }
    let (status, written) = run(&[
        "render", &head, "--nifti", "depth", "-o", &depth, "--view", "left",
    ]);
    assert_eq!(status, Some(2), "{written}");
    assert!(written.contains("`--view` is of a picture"), "{written}");
}
