//! A process killed at any moment loses nothing and leaves nothing half there.
//!
//! The process that is killed is this test program once more, running [`victim`] alone.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use case::{CaseId, CaseState, Parameters};
use cases::Library;
use cases::jobs::start_workers;
use cases::models::{Models, WarmModel};
use geometry::phantom::head;
use pipeline::Source;
use storage::{CaseQuery, Count, Listed, Options, Store};

/// The directory of the store that a victim is to open.
const DIRECTORY: &str = "ISOCORTEX_KILL_DIRECTORY";
/// The radius, in tenths of a millimetre, of the case that it is to make.
const RADIUS: &str = "ISOCORTEX_KILL_RADIUS";

/// The number of kills. [`KILLS`] in the environment asks for more, as `make faults` does.
const STANDARD_KILLS: u32 = 6;
const KILLS: &str = "ISOCORTEX_KILLS";

fn kills() -> u32 {
    std::env::var(KILLS).map_or(STANDARD_KILLS, |kills| kills.parse().unwrap())
}

fn upload() -> Source {
    let head = head(4.0);
    Source {
        volume: imaging::nifti::write_volume(&head.volume).unwrap().into(),
        mask: Some(imaging::nifti::write_mask(&head.brain).unwrap().into()),
        ..Source::default()
    }
}

fn parameters(tenths: u32) -> Parameters {
    Parameters {
        closing_radius_mm: f64::from(tenths) / 10.0,
        ..Parameters::default()
    }
}

/// Uploads, prepares and waits until the case is ready.
async fn make_ready(library: &Library, tenths: u32) -> CaseId {
    let workers = start_workers(library.clone(), 1);
    let submitted = library.submit(upload(), parameters(tenths)).await.unwrap();
    let mut watch = library.store().subscribe(&submitted.case.id);
    loop {
        let case = watch.next().await.unwrap().expect("nobody deletes it");
        if case.state.is_final() {
            assert_eq!(case.state, CaseState::Ready, "{:?}", case.failure);
            break;
        }
    }
    workers.shut_down(Duration::from_secs(60)).await;
    submitted.case.id
}

async fn model(library: &Library, id: &CaseId) -> WarmModel {
    let models = Models::new(library.clone());
    models
        .get(id, case::SurfaceName::Whole)
        .await
        .expect("the case is ready")
}

/// What the killed process does.
#[tokio::test]
#[ignore = "it is started, and killed, by the test below"]
async fn victim() {
    let directory =
        PathBuf::from(std::env::var_os(DIRECTORY).expect("it is started by another test"));
    let tenths = std::env::var(RADIUS).unwrap().parse().unwrap();
    let library = Library::of(Store::open(&directory, Options::default()).await.unwrap());
    make_ready(&library, tenths).await;
}

fn start_victim(directory: &Path, tenths: u32) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "kill::victim", "--ignored", "--test-threads=1"])
        .env(DIRECTORY, directory)
        .env(RADIUS, tenths.to_string())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// A number in 0..1 that nobody foresees.
fn random() -> f64 {
    use std::hash::{BuildHasher, RandomState};
    RandomState::new().hash_one(()) as f64 / u64::MAX as f64
}

fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files
}

/// The source's objects are shared by all cases; each ready case has four of its own, of which the volume may be shared too.
fn assert_nothing_left_over(directory: &Path, ready: u32) {
    assert_eq!(
        files_below(&directory.join("uploads")),
        Vec::<PathBuf>::new()
    );
    let count = |kind: &str| {
        let kind = directory.join("objects").join(kind);
        if kind.exists() {
            files_below(&kind).len()
        } else {
            0
        }
    };
    assert!(count("source-volume") <= 1 && count("source-mask") <= 1);
    for kind in ["volume", "envelope", "forest", "paths"] {
        assert!(
            count(kind) <= ready as usize,
            "{} of {kind} for {ready} cases",
            count(kind)
        );
    }
    assert!(
        files_below(directory)
            .iter()
            .all(|file| !file.to_string_lossy().contains('#'))
    );
}

/// What a killed process left: each case whole, or still to be prepared.
async fn assert_whole(library: &Library) {
    for Listed { case, .. } in library
        .store()
        .cases(&CaseQuery::default(), None, 1000)
        .await
        .unwrap()
        .cases
    {
        match case.state {
            CaseState::Ready => drop(model(library, &case.id).await),
            CaseState::Queued | CaseState::Preparing => {}
            CaseState::Failed => panic!("{:?}", case.failure),
        }
    }
    assert_eq!(library.store().signals().counted(Count::BadObject), 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn kills_at_random_moments_lose_nothing_and_leave_nothing_half_there() {
    let kills = kills();
    let directory = tempfile::tempdir().unwrap();
    let begun = Instant::now();
    assert!(
        start_victim(directory.path(), 100)
            .wait()
            .unwrap()
            .success()
    );
    let mut undisturbed = begun.elapsed();
    let mut killed_at_work = 0;
    for kill in 1..=kills {
        let tenths = 100 + kill;
        let mut victim = start_victim(directory.path(), tenths);
        let moment = undisturbed.mul_f64(random());
        tokio::time::sleep(moment).await;
        match victim.try_wait().unwrap() {
            None => killed_at_work += 1,
            // The machine has become faster since the first was timed.
            Some(_) => undisturbed = moment,
        }
        victim.kill().unwrap();
        victim.wait().unwrap();

        let library = Library::of(
            Store::open(directory.path(), Options::default())
                .await
                .unwrap(),
        );
        eprintln!("kill {kill} of {kills} after {moment:?} of {undisturbed:?}");
        assert_nothing_left_over(directory.path(), kill + 1);
        assert_whole(&library).await;
        make_ready(&library, tenths).await;
        assert_eq!(
            library
                .store()
                .cases(&CaseQuery::default(), None, 1000)
                .await
                .unwrap()
                .cases
                .len(),
            kill as usize + 1
        );
    }
    assert!(
        killed_at_work >= kills / 4,
        "only {killed_at_work} kills met a process at work"
    );
    assert_same_as_undisturbed(directory.path(), kills).await;
}

/// Compares every case with one that was prepared in peace.
async fn assert_same_as_undisturbed(directory: &Path, kills: u32) {
    let survived = Library::of(Store::open(directory, Options::default()).await.unwrap());
    let peaceful = Library::of(Store::in_memory(Options::default()).await.unwrap());
    for tenths in 100..=100 + kills {
        let id = make_ready(&peaceful, tenths).await;
        let [here, there] = [model(&survived, &id).await, model(&peaceful, &id).await];
        assert!(here.model() == there.model(), "{tenths}");
    }
    assert_eq!(survived.store().signals().counted(Count::Rebuild), 0);
}
