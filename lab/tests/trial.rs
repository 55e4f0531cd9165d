//! The trial on a made-up BIDS folder: phantoms with lesions of the simulator.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use analysis::{Head, midsagittal_plane};
use bench::study::{Effect, Ground, Lesion};
use geometry::{BrainMask, DepthField, Grid, Mask, Rescale, Volume, distance_map, envelope};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use imaging::nifti;
use serde_json::Value;

/// The edge of a voxel, as large as maps allow in comfort, so that a head takes little time.
const SPACING_MM: f64 = 1.5;
/// The radius of the lesions.
const RADIUS_MM: f64 = 9.0;

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isocortex-bench"));
    command.arg("study").args(arguments);
    command.env_remove("ISOCORTEX_NETWORK");
    command.output().expect("it can be run")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// The skull-stripped phantom.
fn phantom() -> (Volume, Mask) {
    let head = geometry::phantom::head(SPACING_MM);
    let voxels = head.volume.voxels().iter().zip(head.brain.voxels());
    let stripped = voxels.map(|(&value, &is_brain)| if is_brain { value.max(1) } else { 0 });
    let grid = head.volume.grid().clone();
    let volume = Volume::new(grid, stripped.collect(), head.volume.rescale()).expect("a volume");
    (volume, head.brain)
}

/// The phantom with a blur at a place of the simulator, and the centre of the blur.
struct WithLesion {
    volume: Volume,
    centre: DVec3,
}

fn with_lesions(count: usize) -> Vec<WithLesion> {
    let (volume, mask) = phantom();
    let brain = BrainMask::from_mask(&mask, volume.grid()).expect("a brain");
    let envelope = envelope(&brain, 10.0).expect("an envelope");
    let depth = DepthField::new(&distance_map(&envelope));
    let plane = midsagittal_plane(&envelope, &volume);
    let ground = Ground::new(Head {
        volume: &volume,
        depth: &depth,
        plane: &plane,
    });
    let ground = ground.expect("the phantom has maps");
    let places = ground.places(count, 5);
    places
        .into_iter()
        .zip(1..)
        .map(|(place, seed)| {
            let lesion = Lesion {
                centre_in_patient: place.position_in_patient,
                radius_mm: RADIUS_MM,
                effect: Effect {
                    blur_mm: 2.5,
                    ..Effect::NONE
                },
                band_to: None,
                seed,
            };
            WithLesion {
                volume: ground.with_lesion(&lesion),
                centre: place.position_in_patient,
            }
        })
        .collect()
}

/// A ball on a grid.
fn ball(grid: &Grid, centre: DVec3) -> Mask {
    let is_inside = |index: usize| {
        let voxel = DVec3::from_array(grid.voxel(index).map(|along| along as f64));
        let position = grid.patient_from_voxel().transform_point3(voxel);
        position.distance(centre) < RADIUS_MM
    };
    let voxels = (0..grid.voxel_count()).map(is_inside).collect();
    Mask::new(grid.clone(), voxels).expect("a mask")
}

/// The same voxels at another place.
fn moved(grid: &Grid, by: DAffine3) -> Grid {
    Grid::new(grid.size(), by * grid.patient_from_voxel()).expect("a grid")
}

struct Folder {
    root: tempfile::TempDir,
    centres: Vec<DVec3>,
}

impl Folder {
    fn write(&self, path: &str, bytes: &[u8]) {
        let path = self.root.path().join(path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, bytes).expect("a file");
    }

    fn image(&self, path: &str, volume: &Volume) {
        self.write(path, &nifti::write_volume(volume).expect("a volume"));
    }

    fn mask(&self, path: &str, mask: &Mask) {
        self.write(path, &nifti::write_mask(mask).expect("a mask"));
    }

    /// Three patients whose truths are on the T1, on another grid and on a FLAIR that lies elsewhere; two controls; and heads with
    /// everything that can be wrong.
    fn made_up() -> Self {
        let folder = Self {
            root: tempfile::tempdir().expect("a directory"),
            centres: Vec::new(),
        };
        let lesions = with_lesions(3);
        let grid = lesions[0].volume.grid().clone();
        folder.image("sub-01/anat/sub-01_T1w.nii.gz", &lesions[0].volume);
        folder.image("sub-01/anat/sub-01_run-2_T1w.nii.gz", &lesions[0].volume);
        folder.mask(
            "sub-01/anat/sub-01_roi.nii.gz",
            &ball(&grid, lesions[0].centre),
        );

        folder.image("sub-02/anat/sub-02_T1w.nii.gz", &lesions[1].volume);
        let turned = DAffine3 {
            matrix3: DMat3::from_quat(DQuat::from_rotation_z(0.2))
                * DMat3::from_diagonal(DVec3::new(2.0, 2.0, 3.1)),
            translation: DVec3::new(-95.0, -120.0, -90.0),
        };
        let other = Grid::new([110, 110, 60], turned).expect("a grid");
        folder.mask(
            "sub-02/anat/sub-02_T1w_roi.nii.gz",
            &ball(&other, lesions[1].centre),
        );

        folder.image("sub-03/anat/sub-03_T1w.nii.gz", &lesions[2].volume);
        let elsewhere = DAffine3::from_rotation_translation(
            DQuat::from_rotation_x(0.1),
            DVec3::new(6.0, -9.0, 4.0),
        );
        let flair_grid = moved(&grid, elsewhere);
        // The contrast of a FLAIR: grey matter is brighter than white matter, fluid is dark.
        let flair = lesions[2].volume.voxels().iter().map(|&value| match value {
            0 => 0,
            value if value < 350 => 60 + value / 10,
            value => 1300 - value,
        });
        let flair = Volume::new(
            flair_grid.clone(),
            flair.collect(),
            Rescale {
                slope: 1.0,
                intercept: 0.0,
            },
        );
        folder.image("sub-03/anat/sub-03_FLAIR.nii.gz", &flair.expect("a volume"));
        let centre = elsewhere.transform_point3(lesions[2].centre);
        folder.mask(
            "sub-03/anat/sub-03_FLAIR_roi.nii.gz",
            &ball(&flair_grid, centre),
        );

        // A third of the size of a head: its brain is smaller than any.
        let small = moved(&grid, DAffine3::from_scale(DVec3::splat(0.3)));
        let voxels = lesions[0].volume.voxels().to_vec();
        let small = Volume::new(small, voxels, lesions[0].volume.rescale()).expect("a volume");
        folder.image("sub-04/anat/sub-04_T1w.nii.gz", &small);
        folder.mask(
            "sub-04/anat/sub-04_roi.nii.gz",
            &ball(small.grid(), DVec3::ZERO),
        );

        let (sound, _) = phantom();
        folder.image("sub-05/anat/sub-05_T1w.nii.gz", &sound);
        folder.image("sub-06/ses-1/anat/sub-06_ses-1_T1w.nii.gz", &sound);
        folder.mask("sub-07/anat/sub-07_roi.nii.gz", &ball(&grid, DVec3::ZERO));
        folder.image("sub-08/anat/sub-08_T1w.nii.gz", &sound);
        folder.image("sub-09/anat/sub-09_T1w.nii.gz", &sound);
        folder.mask("sub-09/anat/sub-09_roi.nii.gz", &ball(&grid, DVec3::ZERO));
        folder.write("sub-10/anat/sub-10_T1w.nii.gz", b"not read");
        folder.write("sub-12/anat/sub-12_T1w.nii.gz", b"no NIfTI");
        let empty = Mask::new(grid.clone(), vec![false; grid.voxel_count()]).expect("a mask");
        folder.image("sub-13/anat/sub-13_T1w.nii.gz", &lesions[0].volume);
        folder.mask("sub-13/anat/sub-13_roi.nii.gz", &empty);
        folder.write(
            "participants.tsv",
            b"participant_id\tgroup\tage\tsplit\nsub-01\tfcd\t12\ttest\nsub-02\tfcd\t40\ttest\nsub-03\tfcd\t30\ttest\n\
              sub-04\tfcd\t30\ttest\nsub-05\thc\t30\ttest\nsub-06\thc\t30\ttest\nsub-07\tfcd\t3\ttest\n\
              sub-08\tfcd\tn/a\ttest\nsub-09\thc\t50\ttest\nsub-11\tfcd\t5\ttest\nsub-12\thc\t1\ttest\nsub-13\tfcd\t1\ttest\n",
        );
        Self {
            centres: lesions.iter().map(|lesion| lesion.centre).collect(),
            ..folder
        }
    }

    fn arguments<'a>(&'a self, results: &'a Path) -> Vec<&'a str> {
        let fixed = [
            "--like",
            "bonn",
            "--bids",
            text(self.root.path()),
            "--results",
        ];
        [&fixed[..], &[text(results)]].concat()
    }
}

/// All files of a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries
        .map(|entry| {
            let path: PathBuf = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy();
            (name.into_owned(), std::fs::read(&path).expect("a file"))
        })
        .collect()
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

/// The reasons for the heads that are left out.
fn left_out(report: &Value) -> BTreeMap<&str, &str> {
    let heads = report["left_out"].as_array().expect("a list");
    heads
        .iter()
        .map(|remark| {
            let text = |key: &str| remark[key].as_str().expect("a text");
            (text("head"), text("reason"))
        })
        .collect()
}

#[test]
fn a_made_up_folder_is_judged_locked_and_continued_after_a_kill() {
    let folder = Folder::made_up();
    let [whole, cut] = [(); 2].map(|()| tempfile::tempdir().expect("a directory"));
    let mut arguments = folder.arguments(whole.path());
    arguments.extend(["--freeze", "--jobs", "2"]);
    let output = run(&arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report = read_json(&whole.path().join("report.json"));
    heads_are_judged_or_listed(&report);
    truths_are_where_they_belong(&folder, whole.path());
    let html = std::fs::read_to_string(whole.path().join("report.html")).expect("a report");
    let frozen = read_json(&whole.path().join("frozen.json"));
    assert!(html.contains(frozen["program"].as_str().expect("a hash")));
    for head in 1..=13 {
        assert!(html.contains(&format!("sub-{head:02}")), "sub-{head:02}");
    }
    assert!(!html.contains("<script") && !html.contains("src="));

    // A run that is killed after its first head leaves the same bytes when it is repeated.
    let mut arguments = folder.arguments(cut.path());
    arguments.extend(["--freeze", "--jobs", "1"]);
    let mut process = Command::new(env!("CARGO_BIN_EXE_isocortex-bench"))
        .arg("study")
        .args(&arguments)
        .env_remove("ISOCORTEX_NETWORK")
        .stderr(Stdio::null())
        .spawn()
        .expect("it can be run");
    let first = cut.path().join("sub-01.json");
    while !first.exists() && process.try_wait().expect("a process").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    process.kill().expect("a process");
    process.wait().expect("a process");
    assert!(first.exists() && !cut.path().join("report.json").exists());
    let output = run(&arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && !errors.contains("sub-01"),
        "{errors}"
    );
    let mut left = contents(cut.path());
    left.retain(|name, _| !name.ends_with(".part"));
    assert!(left == contents(whole.path()), "{:?}", left.keys());

    other_parameters_are_refused(&folder, whole.path());
    other_marks_are_judged_by_the_same_rule(&folder, whole.path());
}

fn heads_are_judged_or_listed(report: &Value) {
    assert_eq!(report["patients"], 3);
    assert_eq!(report["controls"], 2);
    let list = &report["lists"][0];
    assert_eq!(list["shares"][0]["lesions"], 3);
    let found = &list["shares"][0]["found"];
    assert!(found[2]["value"].as_f64() >= Some(0.6), "{found}");
    // The patients without maps count as missed.
    let missed = &list["shares"][2];
    assert_eq!(missed["lesions"], 5, "{missed}");
    let chance = list["chance"].as_array().expect("a list");
    assert_eq!(chance.len(), 2);
    let at_random = chance[1]["found"][1]["value"].as_f64().expect("a share");
    assert!((0.0..0.4).contains(&at_random), "{at_random}");
    assert!(list["area"]["value"].is_number());
    assert_eq!(list["thresholds"].as_array().map(Vec::len), Some(5));
    let strata = list["strata"].as_array().expect("a list");
    let names: Vec<&str> = strata.iter().filter_map(|row| row[0].as_str()).collect();
    for name in ["volume", "side", "truth", "age in years", "split"] {
        assert!(names.contains(&name), "{names:?}");
    }
    let reasons = left_out(report);
    for (head, words) in [
        ("sub-04", "patient without maps"),
        ("sub-07", "patient without a T1-weighted volume"),
        ("sub-08", "patient without a truth"),
        ("sub-09", "control with a truth"),
        ("sub-10", "not in the table of participants"),
        ("sub-11", "without a folder"),
        ("sub-12", "control without maps"),
        ("sub-13", "its truth has no voxel"),
    ] {
        let reason = reasons.get(head).expect(head);
        assert!(reason.contains(words), "{head}: {reason}");
    }
    assert_eq!(reasons.len(), 8, "{reasons:?}");
    let remarks = report["remarks"].to_string();
    assert!(remarks.contains("sub-01_T1w.nii.gz is used") || remarks.contains("run-2_T1w"));
}

/// The truth on the FLAIR comes to the T1, and the one on another grid keeps its place.
fn truths_are_where_they_belong(folder: &Folder, results: &Path) {
    let places = ["t1", "t1", "flair_registered"];
    for (number, (centre, place)) in (1..).zip(folder.centres.iter().zip(places)) {
        let result = read_json(&results.join(format!("sub-{number:02}.json")));
        let found = &result["outcome"]["maps"];
        assert_eq!(found["truths"][0]["place"], place);
        let there = &found["lesions"][0]["centre_in_patient"];
        let there = DVec3::from_array([0, 1, 2].map(|axis| there[axis].as_f64().expect("mm")));
        assert!(there.distance(*centre) < 1.5, "{there} {centre}");
        let volume = found["lesions"][0]["volume_ml"].as_f64().expect("ml");
        assert!((2.6..3.5).contains(&volume), "{volume}");
        assert!(found["lesions"][0]["defined_share"].as_f64() > Some(0.02));
    }
}

fn other_parameters_are_refused(folder: &Folder, results: &Path) {
    let refused = |arguments: &[&str], words: &str| {
        let output = run(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(words), "{errors}");
    };
    let mut other = folder.arguments(results);
    other.extend(["--stratum", "group"]);
    refused(&other, "locked with other parameters: strata");
    let copy = tempfile::tempdir().expect("a directory");
    std::fs::copy(results.join("sub-05.json"), copy.path().join("sub-05.json")).expect("a copy");
    let mut late = folder.arguments(copy.path());
    late.push("--freeze");
    refused(&late, "--freeze comes too late");
    // A truth that was drawn again does not belong to the results.
    let truth = folder.root.path().join("sub-01/anat/sub-01_roi.nii.gz");
    let before = std::fs::read(&truth).expect("a file");
    std::fs::copy(
        folder.root.path().join("sub-09/anat/sub-09_roi.nii.gz"),
        &truth,
    )
    .expect("a copy");
    refused(&folder.arguments(results), "was made from other files");
    std::fs::write(&truth, before).expect("a file");
}

fn other_marks_are_judged_by_the_same_rule(folder: &Folder, results: &Path) {
    let mut table = "participant_id,x,y,z,score\n".to_owned();
    for (number, centre) in (1..).zip(&folder.centres) {
        // NIfTI points to the right and to the front.
        let [x, y, z] = [-centre.x, -centre.y, centre.z];
        table += &format!("sub-{number:02},{x},{y},{z},0.9\n");
    }
    table += "sub-05,0,0,0,0.1\nsub-99,0,0,0,1\n";
    let marks = results.parent().expect("a folder").join(format!(
        "{}.csv",
        results.file_name().expect("a name").to_string_lossy()
    ));
    std::fs::write(&marks, table).expect("a file");
    let mut arguments = folder.arguments(results);
    arguments.extend(["--candidates-of", text(&marks), "--json"]);
    let output = run(&arguments);
    std::fs::remove_file(&marks).expect("a file");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let other = &report["lists"][1];
    assert_eq!(other["shares"][0]["found"][0]["value"], 1.0);
    assert_eq!(other["area"]["value"], 1.0);
    assert_eq!(other["chance"][0]["found"][2]["value"], 0.0);
    assert_eq!(report["differences"].as_array().map(Vec::len), Some(1));
    let remarks = report["remarks"].to_string();
    assert!(remarks.contains("sub-99") && remarks.contains("has no mark for it"));
}

#[test]
fn a_folder_without_what_a_trial_needs_is_refused_before_any_work() {
    let folder = tempfile::tempdir().expect("a directory");
    let results = tempfile::tempdir().expect("a directory");
    let touch = |path: &str, text: &str| {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    };
    let refused = |more: &[&str], words: &[&str]| {
        let fixed = [
            "--bids",
            text(folder.path()),
            "--results",
            text(results.path()),
        ];
        let output = run(&[&fixed[..], more].concat());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        for word in words {
            assert!(errors.contains(word), "{errors}");
        }
    };
    refused(&[], &["no folder sub-*"]);
    touch("sub-1/anat/sub-1_T1w.nii.gz", "");
    refused(&[], &["no patient with a truth", "--truth"]);
    touch("sub-1/anat/sub-1_roi.nii.gz", "");
    touch("sub-2/anat/sub-2_T1w.nii.gz", "");
    refused(
        &[],
        &["no control", "--no-controls", "sub-2: it is neither"],
    );
    refused(&["--like", "bonn"], &["\"group\"", "--participants"]);
    touch("participants.tsv", "participant_id\tage\nsub-1\t3\n");
    refused(
        &["--like", "bonn"],
        &["no column \"group\"", "participant_id, age"],
    );
    refused(&["--head", "a=b.nii"], &["--bids", "--head"]);
    refused(&["--jobs", "0"], &["between 1 and 64"]);
    refused(&["--patients", "fcd"], &["COLUMN=VALUE"]);
    let found = std::fs::read_dir(results.path()).expect("a folder").count();
    assert_eq!(found, 0, "nothing was written");
}
