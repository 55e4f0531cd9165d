//! `isocortex bids`: a made-up BIDS folder, its derivatives, and a run that is killed and goes on.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use analysis::testing::brain::{self, BrainPhantom, SimulatedLayer};
use geometry::{BrainMask, Mask, Rescale, Volume};
use glam::{DAffine3, DQuat, DVec3};
use imaging::Limits;
use imaging::nifti::{read_mask, read_values, read_volume, write_volume};
use serde_json::Value;

use crate::head::plain_head;
use crate::heads::data;
use crate::interface::gifti_arrays;
use crate::several_machines::program;

/// A FLAIR that is brighter at one place on the patient's left, in a space of its own.
fn flair() -> SimulatedLayer {
    SimulatedLayer {
        brighter: 0.35,
        case_from_layer: DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(0.1),
            DVec3::new(6.0, -8.0, 4.0),
        ),
        ..SimulatedLayer::FLAIR
    }
}

/// A head without anything around its envelope, so that no network is needed.
fn head() -> Volume {
    let grid = brain::grid();
    let (volume, mask) = BrainPhantom::PLAIN.head(&grid);
    let brain = BrainMask::from_mask(&mask, &grid).unwrap();
    let closed = geometry::envelope(&brain, 10.0).unwrap();
    let closed = closed.mask().resampled(grid.clone());
    within(&volume, &closed)
}

/// The stored values of a volume, 0 outside a mask on its grid.
fn within(volume: &Volume, mask: &Mask) -> Volume {
    let kept = volume.voxels().iter().zip(mask.voxels());
    let voxels = kept.map(|(&voxel, &keep)| if keep { voxel } else { 0 });
    let unscaled = Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    Volume::new(volume.grid().clone(), voxels.collect(), unscaled).unwrap()
}

/// Two volumes in one file.
fn four_dimensional() -> Vec<u8> {
    let mut file = plain_head().bytes();
    let voxels = file[352..].to_vec();
    file[40..42].copy_from_slice(&4i16.to_le_bytes());
    file[48..50].copy_from_slice(&2i16.to_le_bytes());
    file.extend(voxels);
    file
}

struct Folder(tempfile::TempDir);

impl Folder {
    /// Two heads that can be done, and four that cannot.
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        let described = br#"{"Name": "made up", "BIDSVersion": "1.10.0"}"#;
        folder.write("dataset_description.json", described);
        folder.write(
            "sub-1/anat/sub-1_T1w.nii.gz",
            &write_volume(&head()).unwrap(),
        );
        let layer = BrainPhantom::PLAIN.other_contrast(&flair());
        folder.write(
            "sub-1/anat/sub-1_FLAIR.nii.gz",
            &write_volume(&layer).unwrap(),
        );
        let coarse = "sub-2/ses-a b/anat/sub-2_ses-a b_run-1_T1w.nii";
        folder.write(coarse, &plain_head().bytes());
        folder.write("sub-2/ses-a b/anat/sub-2_ses-a b_run-1_T1w.json", b"{");
        folder.write("sub-3/anat/sub-3_T1w.nii", &four_dimensional());
        let whole = write_volume(&head()).unwrap();
        folder.write("sub-4/anat/sub-4_T1w.nii.gz", &whole[..whole.len() / 2]);
        folder.write("sub-5/func/sub-5_bold.nii", b"");
        fs::create_dir_all(folder.path("sub-6/anat")).unwrap();
        let link = folder.path("sub-6/anat/sub-6_T1w.nii.gz");
        std::os::unix::fs::symlink("../../.git/annex/objects/none", link).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        fs::write(self.path(name), bytes).unwrap();
    }

    fn out(&self, name: &str) -> PathBuf {
        self.path("derivatives/isocortex").join(name)
    }

    fn command(&self, options: &[&str]) -> Command {
        let mut command = Command::new(program());
        command
            .arg("bids")
            .args([self.0.path(), &self.out("")])
            .arg("participant")
            .args(options)
            .env_remove("ISOCORTEX_NETWORK")
            .env("ISOCORTEX_ATLAS", "none");
        command
    }

    /// Runs the command to its end; its status, and what it wrote.
    fn run(&self, options: &[&str]) -> (Option<i32>, String) {
        let output = self.command(options).output().unwrap();
        let written = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(written).unwrap())
    }

    /// The columns of the summary of each head.
    fn summary(&self) -> BTreeMap<String, Vec<String>> {
        let text = fs::read_to_string(self.out("summary.tsv")).unwrap();
        let mut rows = text.lines().map(|line| line.split('\t').map(str::to_owned));
        let head: Vec<_> = rows.next().unwrap().collect();
        assert_eq!(head[..4], ["head", "state", "reason", "seconds"]);
        rows.map(|mut row| (row.next().unwrap(), row.collect()))
            .collect()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.out(name)).unwrap()).unwrap()
    }

    /// The value of a volume at a position (LPS mm).
    fn value(&self, name: &str, place: DVec3) -> f32 {
        let file = fs::read(self.out(name)).unwrap();
        let values = read_values(&file, &Limits::default()).unwrap();
        let grid = values.grid;
        assert_eq!(grid.size(), brain::grid().size(), "{name}");
        let index = grid.nearest(grid.voxel_from_patient().transform_point3(place));
        values.numbers[index.unwrap()]
    }
}

/// The names and the times of all files below a folder.
fn times(folder: &Path) -> BTreeMap<PathBuf, std::time::SystemTime> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        if entry.path().is_dir() {
            found.extend(times(&entry.path()));
        } else {
            found.insert(entry.path(), entry.metadata().unwrap().modified().unwrap());
        }
    }
    found
}

#[test]
fn a_run_that_is_killed_goes_on_and_a_head_that_cannot_be_done_ends_no_run() {
    let folder = Folder::new();
    // Killed as soon as the first head is done.
    let mut first = folder.command(&[]).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let mut lines = BufReader::new(first.stderr.take().unwrap());
    lines.read_line(&mut line).unwrap();
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(line.starts_with("[1/6] sub-1 done in "), "{line}");
    let anat = |name: &str| format!("sub-1/anat/sub-1_{name}");
    let before = times(&folder.out("sub-1"));

    let (status, written) = folder.run(&[]);
    assert_eq!(status, Some(65), "{written}");
    assert!(written.contains("[1/6] sub-1 is done already"), "{written}");
    assert!(written.contains("2 of 6 heads are done"), "{written}");
    assert_eq!(times(&folder.out("sub-1")), before);
    let rows = folder.summary();
    for (name, state, words) in [
        ("sub-1", "done", "n/a"),
        ("sub-2_ses-a b_run-1", "done", "n/a"),
        ("sub-3", "refused", "volume"),
        ("sub-4", "refused", ""),
        ("sub-5", "refused", "no T1-weighted volume"),
        ("sub-6", "refused", "datalad get"),
    ] {
        let row = &rows[name];
        assert_eq!(row[0], state, "{name}: {row:?}");
        assert!(row[1].contains(words), "{name}: {row:?}");
    }
    assert!(
        rows["sub-2_ses-a b_run-1"]
            .last()
            .unwrap()
            .contains("is no JSON")
    );
    assert_eq!(rows["sub-1"][5], "registered");
    assert_eq!(
        rows["sub-2_ses-a b_run-1"][4], "undefined",
        "its voxels are coarse"
    );
    let page = fs::read_to_string(folder.out("summary.html")).unwrap();
    assert!(
        page.contains("sub-2/figures/sub-2_ses-a%20b_run-1_desc-cut.png"),
        "{page}"
    );
    assert!(
        fs::metadata(folder.out("sub-1/figures/sub-1_desc-cut.png"))
            .unwrap()
            .len()
            > 1000
    );
    assert!(fs::metadata(folder.out("sub-1.html")).unwrap().len() > 10_000);

    // Left is left: the FLAIR is bright on the left, and its place was found.
    let (middle, _) = SimulatedLayer::FLAIR.lesion;
    let mirrored = middle * DVec3::new(-1.0, 1.0, 1.0);
    let sides =
        [middle, mirrored].map(|place| folder.value(&anat("desc-sides_dseg.nii.gz"), place));
    assert_eq!(sides, [1.0, 2.0]);
    let depth = folder.value(&anat("desc-depth_map.nii.gz"), middle);
    assert!((3.0..30.0).contains(&depth), "{depth}");
    assert_eq!(folder.value(&anat("desc-brain_mask.nii.gz"), middle), 1.0);
    let places = fs::read_to_string(folder.out(&anat("desc-places.tsv"))).unwrap();
    let highest = places
        .lines()
        .find(|line| line.starts_with("flair\t1\t"))
        .unwrap();
    let fields: Vec<_> = highest.split('\t').collect();
    let [x, y, z] = [2, 3, 4].map(|column| fields[column].parse::<f64>().unwrap());
    assert!(DVec3::new(-x, -y, z).distance(middle) < 10.0, "{highest}");
    assert_eq!(fields[6], "left");
    let moved = folder.json(&anat("from-FLAIR_to-T1w_mode-image_xfm.json"));
    assert_eq!(moved["Verdict"], "registered");
    let rows: [[f64; 4]; 4] = serde_json::from_value(moved["Matrix"].clone()).unwrap();
    let truth = flair()
        .case_from_layer
        .transform_point3(DVec3::new(10.0, 20.0, 30.0));
    // RAS.
    let found = [0, 1, 2].map(|axis| {
        rows[axis][0] * -10.0 + rows[axis][1] * -20.0 + rows[axis][2] * 30.0 + rows[axis][3]
    });
    let found = DVec3::new(-found[0], -found[1], found[2]);
    assert!(found.distance(truth) < 1.0, "{found} {truth}");
    let record = folder.json(&anat("desc-brain_mask.json"));
    assert!(record["Midsagittal"]["Normal"][0].as_f64().unwrap() < -0.99);
    assert_eq!(record["VoxelMm"], serde_json::json!([1.0, 1.0, 1.0]));
    assert_eq!(
        (&record["Type"], &record["Maps"]["State"]),
        (&"Brain".into(), &"ready".into())
    );
    assert_eq!(record["Sources"][0], "bids:raw:sub-1/anat/sub-1_T1w.nii.gz");

    // A head whose volumes change is done again, and no other; what it no longer has goes.
    fs::remove_file(folder.path("sub-1/anat/sub-1_FLAIR.nii.gz")).unwrap();
    let (_, written) = folder.run(&["--participant-label", "1", "sub-2"]);
    assert!(written.contains("[1/2] sub-1 done in "), "{written}");
    assert!(
        written.contains("sub-2_ses-a b_run-1 is done already"),
        "{written}"
    );
    assert!(
        !folder
            .out(&anat("from-FLAIR_to-T1w_mode-image_xfm.json"))
            .exists()
    );
    assert!(!folder.out(&anat("desc-flair_map.nii.gz")).exists());

    // The summary has all heads, also those that were not asked for.
    let (status, written) = folder.run(&["--participant-label", "2"]);
    assert_eq!(status, Some(0), "{written}");
    let states = folder.summary().into_values().map(|row| row[0].clone());
    let states: Vec<_> = states.collect();
    let expected = ["done", "done", "pending", "pending", "refused", "refused"];
    assert_eq!(states, expected);
}

#[test]
fn the_halves_of_a_real_head_are_written_as_surfaces_on_their_sides() {
    let Some(heads) = data() else { return };
    let folder = Folder(tempfile::tempdir().unwrap());
    let read = |name: &str| fs::read(heads.join("csi1").join(name)).unwrap();
    let volume = read_volume(&read("t1.nii.gz"), &Limits::default()).unwrap();
    let mask = read_mask(&read("mask_dura.nii.gz"), &Limits::default()).unwrap();
    let head = write_volume(&within(&volume, &mask)).unwrap();
    folder.write("sub-1/anat/sub-1_T1w.nii.gz", &head);
    let (status, written) = folder.run(&["--skip-bids-validation"]);
    assert_eq!(status, Some(0), "{written}");
    for (half, sign) in [("L", -1.0), ("R", 1.0)] {
        for depth in ["0mm", "8mm"] {
            let name = format!("sub-1/anat/sub-1_hemi-{half}_desc-{depth}_cut.surf.gii");
            let file = fs::read(folder.out(&name)).unwrap();
            let [(_, positions), (_, triangles)] = &gifti_arrays(&file)[..] else {
                panic!("{name}")
            };
            // RAS.
            let x = positions
                .iter()
                .step_by(3)
                .map(|&bits| f64::from(f32::from_bits(bits)));
            let mean = x.sum::<f64>() / (positions.len() / 3) as f64;
            assert!((15.0..40.0).contains(&(mean * sign)), "{name}: {mean}");
            assert!(triangles.len() > 3 * 10_000, "{name}");
        }
    }
}

#[test]
fn a_folder_that_is_none_and_an_output_of_another_program_are_refused_in_words() {
    let root = tempfile::tempdir().unwrap();
    let path = |name: &str| root.path().join(name).display().to_string();
    let run = |options: &[&str]| crate::command_line::run(&[&["bids"], options].concat());
    let (bids, out) = (path("bids"), path("out"));
    let (status, written) = run(&[&bids, &out, "participant"]);
    assert_eq!(status, Some(66), "{written}");
    fs::create_dir_all(path("bids/sub-1/anat")).unwrap();
    let (status, written) = run(&[&bids, &out, "participant"]);
    assert_eq!(status, Some(66), "{written}");
    assert!(written.contains("--skip-bids-validation"), "{written}");
    let (status, written) = run(&[&bids, &out, "participant", "--participant-label", "2"]);
    assert_eq!(status, Some(66), "{written}");
    let skip = "--skip-bids-validation";
    let (status, written) = run(&[&bids, &out, "participant", skip, "--participant-label", "2"]);
    assert_eq!(status, Some(66), "{written}");
    assert!(
        written.contains("there is no sub-2 in the folder; it has sub-1"),
        "{written}"
    );
    let (status, written) = run(&[&bids, &bids, "participant", skip]);
    assert_eq!(status, Some(73), "{written}");
    assert!(written.contains("is the BIDS folder itself"), "{written}");
    fs::create_dir(&out).unwrap();
    let other = r#"{"Name": "x", "BIDSVersion": "1.9.0", "GeneratedBy": [{"Name": "fMRIPrep"}]}"#;
    fs::write(path("out/dataset_description.json"), other).unwrap();
    let (status, written) = run(&[&bids, &out, "participant", skip]);
    assert_eq!(status, Some(73), "{written}");
    assert!(written.contains("made by another program"), "{written}");
}
