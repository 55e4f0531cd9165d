//! What becomes of cases, layers and results while a PACS sends, corrects, rejects and lifts, beside a naive fold over its messages.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use bytes::Bytes;
use case::Closed;
use case::images::{Fingerprint, Image};
use case::series::Uid;
use cases::Cases;
use cases::testing::application;
use proptest::prelude::*;
use storage::tables::{made, series};
use storage::{Made, Replaced};

use super::*;
use crate::identity::Rejection;
use crate::series::tests::with_tables;
use crate::values::{ArrivalSource, ArrivalState, NewInstance, Reception};
use crate::values::{NewResult, ResultSeries, SEND};

/// The study and the UID of each series. All but the third are heads, and in the last one no image was acquired.
const PLACES: [(&str, &str); 4] = [
    ("1.2", "1.2.1"),
    ("1.2", "1.2.2"),
    ("1.2", "1.2.3"),
    ("1.5", "1.5.1"),
];

/// The series in which images were acquired.
const ACQUIRED: usize = 3;

/// The series of the layers.
const OF_LAYERS: usize = 2;

/// Findings that a reader saves; the first one is of a reader who deletes all.
const FINDINGS: [&str; 3] = ["[]", "[1]", "[2]"];

/// Images of a series.
const IMAGES: usize = 3;

fn uid(text: &str) -> Uid {
    Uid::parse(text).unwrap()
}

fn uids(series: usize) -> SeriesUids {
    let (study, series) = PLACES[series];
    SeriesUids {
        study: uid(study),
        series: uid(series),
    }
}

/// An image is named by the series in which it was acquired and its number, wherever it is sent later.
type ImageName = (usize, usize);

fn uid_of((series, number): ImageName) -> Uid {
    uid(&format!("{}.{number}", PLACES[series].1))
}

/// What a file of an image is: its series, and a version of its contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Version {
    series: usize,
    contents: u8,
    is_lossy: bool,
}

fn contents(name: ImageName, version: Version) -> String {
    format!("{name:?} {version:?}")
}

fn print(name: ImageName, version: Version) -> Fingerprint {
    let digest = blake3::hash(contents(name, version).as_bytes()).to_hex();
    Fingerprint::new(&digest[..32], version.is_lossy, Vec::new()).unwrap()
}

/// A step of the PACS, of a user, or of misfortune.
#[derive(Debug, Clone)]
enum Step {
    /// Sends images of a series, each as this version.
    Send {
        of: usize,
        numbers: Vec<usize>,
        version: Version,
    },
    Reject {
        of: usize,
        numbers: Vec<usize>,
        within: usize,
        may_return: bool,
    },
    /// Lifts the latest rejection.
    Lift,
    /// Uploads the images of a series as this version.
    Upload {
        of: usize,
        version: Version,
    },
    /// Reads a series that is due. It may be killed before it is settled, after images came meanwhile.
    Read {
        is_killed: bool,
    },
    /// Asks for a result of a case to be sent.
    Ask {
        case: usize,
    },
    /// Takes a result to be sent.
    Take,
    /// Saves the findings of a case.
    Mark {
        case: usize,
        findings: usize,
    },
    Delete {
        case: usize,
    },
    /// Deletes the first layer of a case.
    DeleteLayer {
        case: usize,
    },
    /// Everything that is in memory is gone.
    Kill,
    /// A week passes, after which files are forgotten.
    Week,
}

/// A few images are compressed with loss.
fn version_in(series: std::ops::Range<usize>) -> impl Strategy<Value = Version> {
    let lossy = proptest::bool::weighted(0.1);
    (series, 0..2_u8, lossy).prop_map(|(series, contents, is_lossy)| Version {
        series,
        contents,
        is_lossy,
    })
}

fn numbers() -> impl Strategy<Value = Vec<usize>> {
    prop_oneof![
        3 => Just((0..IMAGES).collect::<Vec<_>>()),
        1 => proptest::sample::subsequence((0..IMAGES).collect::<Vec<_>>(), 1..=IMAGES),
    ]
}

/// Mostly, images stay in their series. Others move to another series or study.
fn step() -> impl Strategy<Value = Step> {
    let of = || 0..ACQUIRED;
    let version = || version_in(0..PLACES.len());
    let own = (numbers(), version_in(of())).prop_map(|(numbers, version)| Step::Send {
        of: version.series,
        numbers,
        version,
    });
    let anywhere = (of(), numbers(), version()).prop_map(|(of, numbers, version)| Step::Send {
        of,
        numbers,
        version,
    });
    prop_oneof![
        6 => own,
        1 => anywhere,
        2 => (of(), numbers(), 0..PLACES.len(), any::<bool>()).prop_map(|(of, numbers, within, may_return)| {
            Step::Reject { of, numbers, within, may_return }
        }),
        1 => Just(Step::Lift),
        1 => (of(), version()).prop_map(|(of, version)| Step::Upload { of, version }),
        6 => proptest::bool::weighted(0.2).prop_map(|is_killed| Step::Read { is_killed }),
        2 => (0..9_usize).prop_map(|case| Step::Ask { case }),
        2 => Just(Step::Take),
        2 => (0..9_usize, 0..FINDINGS.len()).prop_map(|(case, findings)| Step::Mark { case, findings }),
        1 => (0..9_usize).prop_map(|case| Step::Delete { case }),
        1 => (0..9_usize).prop_map(|case| Step::DeleteLayer { case }),
        1 => Just(Step::Kill),
        1 => Just(Step::Week),
    ]
}

/// What must be so, by the messages alone.
#[derive(Debug, Default)]
struct Fold {
    /// The last version of each image that a PACS has sent.
    last: BTreeMap<ImageName, Version>,
    /// What is rejected in which series, and whether it counts again when it comes again; oldest first.
    rejected: Vec<(BTreeSet<ImageName>, usize, bool)>,
}

impl Fold {
    /// Whether an image is taken. One that has lost something replaces nothing, so it is taken only where the other one is kept.
    fn send(&mut self, name: ImageName, version: Version, kept: Option<Version>) -> bool {
        let last = self
            .last
            .get(&name)
            .filter(|last| version.is_lossy && !last.is_lossy);
        match last {
            Some(last) if kept != Some(*last) || last.series != version.series => return false,
            Some(_) => {}
            None => drop(self.last.insert(name, version)),
        }
        for (names, within, may_return) in &mut self.rejected {
            if *may_return && *within == version.series {
                names.remove(&name);
            }
        }
        self.rejected.retain(|(names, ..)| !names.is_empty());
        true
    }

    /// The latest note about an image counts, but one that may not return stays so.
    fn reject(&mut self, names: &[ImageName], within: usize, may_return: bool) {
        let mut forever = BTreeSet::new();
        for (named, of, may_return) in &mut self.rejected {
            if *of == within {
                for name in names {
                    if named.remove(name) && !*may_return {
                        forever.insert(*name);
                    }
                }
            }
        }
        self.rejected.retain(|(names, ..)| !names.is_empty());
        let names: BTreeSet<_> = names.iter().copied().collect();
        // One note has rows of both kinds then; they are lifted together, and return one by one.
        let (forever, returning): (BTreeSet<_>, BTreeSet<_>) = names
            .into_iter()
            .partition(|name| !may_return || forever.contains(name));
        for (names, may_return) in [(forever, false), (returning, true)] {
            if !names.is_empty() {
                self.rejected.push((names, within, may_return));
            }
        }
    }

    fn is_rejected(&self, name: ImageName) -> bool {
        let last = self.last.get(&name);
        self.rejected.iter().any(|(names, within, _)| {
            names.contains(&name) && last.is_none_or(|last| last.series == *within)
        })
    }

    /// Why something is closed that was made of these images.
    fn closed(&self, made_of: &BTreeMap<ImageName, Version>) -> Option<Closed> {
        let is_another = |(name, version): (&ImageName, &Version)| {
            self.last.get(name).is_some_and(|last| last != version)
        };
        if made_of.iter().any(is_another) {
            return Some(Closed::Corrected);
        }
        let mut names = made_of.keys();
        names
            .any(|name| self.is_rejected(*name))
            .then_some(Closed::Rejected)
    }
}

/// A server whose child copies a volume and its description from a folder, and what it must do.
struct World {
    place: TempDir,
    folder: TempDir,
    arrivals: Arrivals,
    fold: Fold,
    /// Of which images each case was made.
    made: BTreeMap<String, BTreeMap<ImageName, Version>>,
    /// Files that were acknowledged and must be there.
    kept: BTreeMap<ImageName, Version>,
    /// What readers have saved of each case.
    findings: BTreeMap<String, String>,
    /// Of which images the layers were made that each result shows, by its UID.
    results: Vec<(Uid, Vec<BTreeMap<ImageName, Version>>)>,
    /// How far the clock of the rows is ahead.
    ahead: Duration,
}

async fn open(place: &Path, folder: &Path) -> Arrivals {
    let store = Store::open(place, with_tables());
    Arrivals::new(application(store.await.unwrap(), &copy_from(folder)))
}

fn copy_from(folder: &Path) -> String {
    format!(
        r#"order=$(/bin/cat); output=${{order#*\"output\":\"}}; /bin/cp {}/* "${{output%%\"*}}""#,
        folder.display()
    )
}

impl World {
    async fn new() -> Self {
        let [place, folder] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let volume = pipeline::testing::nifti(&pipeline::testing::phantom().volume);
        let room = vec![0; storage::Spooled::START as usize];
        let file = [&room[..], &volume].concat();
        std::fs::write(folder.path().join("volume.nii.gz"), file).unwrap();
        Self {
            arrivals: open(place.path(), folder.path()).await,
            place,
            folder,
            fold: Fold::default(),
            made: BTreeMap::new(),
            kept: BTreeMap::new(),
            findings: BTreeMap::new(),
            results: Vec::new(),
            ahead: Duration::ZERO,
        }
    }

    fn store(&self) -> &PacsStore {
        self.arrivals.store()
    }

    fn cases(&self) -> &Cases {
        &self.arrivals.cases
    }

    fn pass(&mut self, by: Duration) {
        self.ahead += by;
        self.cases().store().pass_time(by);
    }

    async fn send(&mut self, name: ImageName, version: Version) {
        let file = contents(name, version);
        let file = self.cases().store().spools().of(file.into()).await.unwrap();
        let image = NewInstance {
            uids: uids(version.series),
            accession_number: None,
            sop_instance_uid: uid_of(name),
            digest: *file.digest(),
            label: None,
            fingerprint: Some(print(name, version)),
        };
        let received = self
            .store()
            .receive(vec![(image, file)], ArrivalSource::CStore);
        let is_taken = received.await.unwrap() != [Reception::Refused];
        let kept = self.kept.get(&name).copied();
        assert_eq!(is_taken, self.fold.send(name, version, kept), "{version:?}");
        if self.fold.last.get(&name) == Some(&version) {
            self.kept.insert(name, version);
        }
    }

    /// What the child finds in these images.
    fn describe(&self, of: &BTreeMap<ImageName, Version>) {
        let (_, first) = of.first_key_value().unwrap();
        let images: Vec<_> = (of.iter())
            .map(|(name, version)| {
                let print = print(*name, *version).to_string();
                let print = serde_json::json!({
                    "contents": &print[..32], "corners_mm": [], "is_lossy": version.is_lossy,
                });
                (uid_of(*name), print)
            })
            .collect();
        let instances: Vec<_> = (of.keys())
            .map(|name| serde_json::json!({"sop_class_uid": "1.3", "sop_instance_uid": uid_of(*name)}))
            .collect();
        // The kind of the contents is part of the id of the case.
        let versions: Vec<_> = of
            .values()
            .map(|version| format!("{} {}", version.contents, version.is_lossy))
            .collect();
        let is_head = first.series != OF_LAYERS;
        let (study, series) = PLACES[first.series];
        let outcome = serde_json::json!({"read": {
            "attributes": {
                "attributes": [
                    ["PatientID", "P-1"],
                    ["StudyInstanceUID", study],
                    ["SeriesInstanceUID", series],
                    ["StudyDescription", versions.join(" ")],
                ],
                "instances": instances,
                "interpolated_slices": [],
            },
            "series": {
                "number": 1,
                "modality": "MR",
                "name": if is_head { "T1" } else { "FLAIR" },
                "size": [9, 9, 9],
                "is_volume": true,
                "token": "01234567",
            },
            "is_t1": is_head,
            "others": [],
            "ignored_files": 0,
            "unread": [],
            "images": images,
        }});
        let file = self.folder.path().join("outcome.json");
        std::fs::write(file, outcome.to_string()).unwrap();
    }

    /// Reads a series that is due; whether there was one.
    async fn read(&mut self, is_killed: bool) -> bool {
        self.pass(Duration::from_secs(60));
        let terms = DueTerms {
            stable: Duration::ZERO,
            patience: Duration::ZERO,
        };
        self.store().queue_due_series(&terms).await.unwrap();
        let Some(claim) = self.cases().store().claim(SERIES, 1000).await.unwrap() else {
            return false;
        };
        let due = self.store().series_to_read(&claim).await.unwrap().unwrap();
        let mut of = BTreeMap::new();
        for image in &due.images {
            let name = name_of(&image.uid);
            let file = self.cases().store().object(&image.object).await.unwrap();
            of.insert(name, version_of(name, &file));
        }
        if !of.is_empty() {
            self.describe(&of);
        }
        let before: BTreeSet<_> = self.made.keys().cloned().collect();
        let outcome = self
            .arrivals
            .read_series(&due, &ArrivalOptions::default())
            .await;
        let outcome = outcome.unwrap();
        if let Outcome::Case(case) = &outcome {
            let case = case.to_string();
            // A case that was there has all these images; a new one is made of them.
            match self.made.get(&case).filter(|_| before.contains(&case)) {
                Some(made) => assert!(of.keys().all(|name| made.contains_key(name))),
                None => {
                    self.made.insert(case.clone(), of.clone());
                    self.inherit(&case).await;
                }
            }
            self.follow(&case, &of);
        }
        if is_killed {
            self.pass(Duration::from_secs(3600));
            return true;
        }
        assert!(self.store().settle(&claim, &outcome).await.unwrap());
        true
    }

    /// A new version has the findings of its case, unless it replaces one that is closed.
    async fn inherit(&mut self, case: &str) {
        let id = CaseId::parse(case).unwrap();
        let held = self.cases().store().case(&id).await.unwrap().unwrap();
        let Some(previous) = held.previous else {
            return;
        };
        if (self.closed(&id).is_some() || self.closed(&previous).is_none())
            && let Some(findings) = self.findings.get(&previous.to_string())
        {
            self.findings.insert(case.to_owned(), findings.clone());
        }
    }

    /// A case that is made again is made of what came last.
    fn follow(&mut self, case: &str, of: &BTreeMap<ImageName, Version>) {
        let made = self.made.get_mut(case).unwrap();
        for (name, version) in of {
            if self.fold.last.get(name) == Some(version) {
                made.insert(*name, *version);
            }
        }
    }

    async fn upload(&mut self, of: usize, version: Version) {
        let all: BTreeMap<_, _> = (0..IMAGES).map(|number| ((of, number), version)).collect();
        self.describe(&all);
        let directory = self.cases().store().spools().directory().await.unwrap();
        let files = VolumeFiles::Dicom(directory);
        let read = self.cases().upload(files, None, &Options::default()).await;
        let (upload, _) = read.unwrap();
        let submitted = self
            .cases()
            .submit(upload, Parameters::default(), false)
            .await;
        let case = submitted.unwrap().case.id.to_string();
        self.made.entry(case.clone()).or_insert_with(|| all.clone());
        self.follow(&case, &all);
    }

    fn case(&self, number: usize) -> Option<CaseId> {
        let count = self.made.len();
        let case = self.made.keys().nth(number.checked_rem(count)?)?;
        CaseId::parse(case)
    }

    async fn images_of(&self, case: &CaseId, layer: &LayerId) -> Vec<Image> {
        let mut connection = self.cases().store().connect().await.unwrap();
        let of = made::of(&mut connection, &Made::layer(case, layer)).await;
        of.unwrap()
    }

    async fn ask(&mut self, case: CaseId) {
        let number = self.results.len();
        let file = Bytes::from(format!("result {number}"));
        let (mut layers, mut made_of) = (Vec::new(), Vec::new());
        for layer in self.cases().store().layers(&case).await.unwrap() {
            let of = self.images_of(&case, &layer.id).await;
            made_of.push(of.iter().map(known).collect());
            layers.push(layer.id);
        }
        let instance = uid(&format!("2.25.{}", 10 + number));
        let new = NewResult {
            case,
            node: "pacs".to_owned(),
            study: uid("1.2"),
            series: ResultSeries {
                sop_class_uid: uid("1.3"),
                series_uid: uid("2.25.1"),
            },
            instance: instance.clone(),
            layers,
            digest: blake3::hash(&file),
        };
        self.store().queue_result(new, file).await.unwrap();
        self.results.push((instance, made_of));
    }

    /// Nothing closed is sent. Whether anything was.
    async fn take(&self) -> bool {
        let Some(claim) = self.cases().store().claim(SEND, 1000).await.unwrap() else {
            return false;
        };
        let result = self.store().result(&claim.key).await.unwrap().unwrap();
        assert_eq!(
            self.closed(&result.what.case),
            None,
            "it is of a closed case"
        );
        let mut results = self.results.iter();
        let (_, layers) = results
            .find(|(uid, _)| *uid == result.what.instance)
            .unwrap();
        for made_of in layers {
            assert_eq!(self.fold.closed(made_of), None, "it shows a closed layer");
        }
        assert!(self.cases().store().finish(&claim, Ok(())).await.unwrap());
        true
    }

    fn closed(&self, case: &CaseId) -> Option<Closed> {
        self.fold.closed(&self.made[&case.to_string()])
    }

    async fn mark(&mut self, case: CaseId, findings: &str) {
        let store = self.cases().store();
        let version = store.findings(&case).await.unwrap().version;
        let replaced = store.replace_findings(&case, version, findings.to_owned());
        assert!(matches!(replaced.await.unwrap(), Replaced::Done(_)));
        self.findings.insert(case.to_string(), findings.to_owned());
    }

    async fn delete(&mut self, case: CaseId) {
        // Its series go with it, so that nothing of the patient stays.
        for series in 0..PLACES.len() {
            let SeriesUids { study, series: one } = uids(series);
            let query = SeriesQuery::Study(study, Some(one));
            for arrival in self.store().arrivals_of(&query).await.unwrap() {
                let became = [ArrivalState::Case, ArrivalState::Layer].contains(&arrival.state);
                if became && arrival.case == Some(case) {
                    self.kept.retain(|_, version| version.series != series);
                }
            }
        }
        self.cases().store().delete(&case).await.unwrap();
        self.made.remove(&case.to_string());
        self.findings.remove(&case.to_string());
    }

    async fn step(&mut self, step: &Step) {
        match step {
            Step::Send {
                of,
                numbers,
                version,
            } => {
                for number in numbers {
                    self.send((*of, *number), *version).await;
                }
            }
            Step::Reject {
                of,
                numbers,
                within,
                may_return,
            } => {
                let names: Vec<_> = numbers.iter().map(|number| (*of, *number)).collect();
                let instances = names.iter().map(|name| uid_of(*name)).collect();
                let rejection = Rejection {
                    may_return: *may_return,
                    series: vec![(uids(*within), instances)],
                };
                let rejected = self
                    .store()
                    .reject(&rejection, ArrivalSource::Stow, "somebody");
                rejected.await.unwrap();
                self.fold.reject(&names, *within, *may_return);
                self.pass(Duration::from_secs(1));
            }
            Step::Lift => {
                let rejections = self.store().rejections(1).await.unwrap();
                let Some(latest) = rejections.first() else {
                    assert_eq!(self.fold.rejected, []);
                    return;
                };
                assert!(self.store().lift(&latest.id).await.unwrap());
                let is_of = |uids: SeriesUids| {
                    (uids.study.as_str(), uids.series.as_str())
                        == (latest.study.as_str(), latest.series.as_str())
                };
                let within = (0..PLACES.len()).find(|series| is_of(uids(*series)));
                let Some((.., last, _)) = self.fold.rejected.last().cloned() else {
                    panic!("nothing is rejected");
                };
                assert_eq!(within, Some(last));
                let mut lifted = latest.images;
                while lifted > 0 {
                    lifted -= self.fold.rejected.pop().unwrap().0.len();
                }
            }
            Step::Upload { of, version } => self.upload(*of, *version).await,
            Step::Read { is_killed } => drop(self.read(*is_killed).await),
            Step::Ask { case } => {
                if let Some(case) = self.case(*case) {
                    self.ask(case).await;
                }
            }
            Step::Take => drop(self.take().await),
            Step::Mark { case, findings } => {
                if let Some(case) = self.case(*case) {
                    self.mark(case, FINDINGS[*findings]).await;
                }
            }
            Step::Delete { case } => {
                if let Some(case) = self.case(*case) {
                    self.delete(case).await;
                }
            }
            Step::DeleteLayer { case } => {
                if let Some(case) = self.case(*case)
                    && let Some(layer) = self.cases().store().layers(&case).await.unwrap().first()
                {
                    self.cases().delete_layer(&case, &layer.id).await.unwrap();
                }
            }
            Step::Kill => {
                self.arrivals = open(self.place.path(), self.folder.path()).await;
                self.cases().store().pass_time(self.ahead);
            }
            Step::Week => {
                self.pass(Duration::from_secs(7 * 24 * 3600));
                while self.read(false).await {}
                self.pass(Duration::from_secs(7 * 24 * 3600));
                self.store()
                    .forget(Duration::from_secs(3 * 24 * 3600), Removal::Confirmed)
                    .await
                    .unwrap();
                self.kept.clear();
            }
        }
    }

    /// The rows are what the messages say.
    async fn check(&self) {
        for (case, made) in &self.made {
            let findings = self.findings.get(case).map_or(FINDINGS[0], String::as_str);
            let case = CaseId::parse(case).unwrap();
            let saved = self.cases().store().findings(&case).await.unwrap();
            assert_eq!(saved.document, findings, "of {case}");
            let held = self.cases().store().case(&case).await.unwrap().unwrap();
            assert_eq!(held.closed, self.fold.closed(made), "{case} of {made:?}");
            for layer in self.cases().store().layers(&case).await.unwrap() {
                let of = self.images_of(&case, &layer.id).await;
                let of = of.iter().map(known);
                assert_eq!(layer.closed, self.fold.closed(&of.collect()));
            }
        }
        for (name, version) in &self.kept {
            let images = self.store().images_of(&uids(version.series)).await.unwrap();
            let (_, object) = images
                .iter()
                .find(|(uid, _)| *uid == uid_of(*name))
                .unwrap();
            let file = self.cases().store().object(object).await.unwrap();
            assert_eq!(version_of(*name, &file), *version);
        }
    }
}

/// Every version of an image.
fn versions() -> impl Iterator<Item = Version> {
    (0..PLACES.len() * 4).map(|number| Version {
        series: number / 4,
        contents: u8::from(number & 1 > 0),
        is_lossy: number & 2 > 0,
    })
}

/// An image as a test knows it.
fn known(image: &Image) -> (ImageName, Version) {
    let name = name_of(&image.uid);
    let is_it = |version: &Version| print(name, *version) == image.fingerprint;
    (name, versions().find(is_it).unwrap())
}

fn name_of(uid: &Uid) -> ImageName {
    let (series, number) = uid.as_str().rsplit_once('.').unwrap();
    let series = PLACES.iter().position(|(_, known)| *known == series);
    let series = series.unwrap();
    (series, number.parse().unwrap())
}

fn version_of(name: ImageName, file: &[u8]) -> Version {
    let is_it = |version: &Version| contents(name, *version).as_bytes() == file;
    versions().find(is_it).unwrap()
}

async fn live(steps: &[Step]) {
    let mut world = World::new().await;
    // A head with findings and a layer, and a result that shows both.
    let read = || Step::Read { is_killed: false };
    let first = [
        send_all(0, 0),
        read(),
        send_all(2, 0),
        read(),
        Step::Mark {
            case: 0,
            findings: 1,
        },
        Step::Ask { case: 0 },
    ];
    for step in first.iter().chain(steps) {
        world.step(step).await;
        world.check().await;
    }
    // In the end, everything is read.
    while world.read(false).await {}
    world.check().await;
    // What waits is sent, or has failed for good.
    while world.take().await {}
}

fn send_all(of: usize, contents: u8) -> Step {
    let version = Version {
        series: of,
        contents,
        is_lossy: false,
    };
    let numbers = (0..IMAGES).collect();
    Step::Send {
        of,
        numbers,
        version,
    }
}

#[tokio::test]
async fn a_result_of_two_layers_with_two_versions_of_one_image_is_not_sent() {
    let read = || Step::Read { is_killed: false };
    // The layer is corrected while the case of its head is, so that the new head has a layer of each version.
    let steps = [
        send_all(2, 1),
        send_all(1, 0),
        read(),
        send_all(0, 0),
        send_all(2, 0),
        read(),
        read(),
        Step::Ask { case: 0 },
        Step::Ask { case: 1 },
    ];
    live(&steps).await;
}

#[tokio::test]
async fn a_case_that_is_not_found_by_its_series_is_found_when_that_is_read_again() {
    let mut world = World::new().await;
    world.step(&send_all(0, 0)).await;
    assert!(world.read(true).await);
    let store = world.cases().store().clone();
    let found = async || {
        let query = SeriesQuery::Study(uids(0).study, None);
        let found = series::cases_of(&mut store.connect().await.unwrap(), &query).await;
        found.unwrap()
    };
    let made = found().await;
    assert_eq!(made.len(), 1);
    let (mut transaction, _) = store.write().await.unwrap();
    let lost = transaction.execute("DELETE FROM case_series", Vec::new());
    lost.await.unwrap();
    transaction.commit().await.unwrap();
    assert_eq!(found().await, []);
    assert!(world.read(false).await);
    assert_eq!(found().await, made);
}

#[tokio::test]
async fn a_lossy_image_does_not_take_the_place_of_one_that_is_not_kept_any_more() {
    let lossy = Step::Send {
        of: 0,
        numbers: vec![0],
        version: Version {
            series: 0,
            contents: 0,
            is_lossy: true,
        },
    };
    live(&[Step::Week, lossy, send_all(0, 0)]).await;
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 24,
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    })]

    /// Each of these guards was removed once, and the test failed:
    ///
    /// | guard | place | what fails |
    /// |---|---|---|
    /// | an image that came is judged | `images::arrive` | a case is open that is corrected |
    /// | what a note names is judged | `images::reject` | a case is open that is rejected |
    /// | what is lifted is judged | `images::lift` | a case stays rejected |
    /// | what is made is judged | `tables::made::make` | a case of old images is open |
    /// | layers and results are judged too | `images::judge_made` | a layer is open |
    /// | an image that may not return stays rejected | `images::arrive` | a case opens when it comes again |
    /// | a lossy image is refused where the other one is not kept | `images::arrive` | it is taken |
    /// | what is closed is not claimed | `PacsTables::refusal` | a result of a closed case is taken |
    /// | a correction takes the place of the file | `arrivals::replace` | the file has other contents |
    #[test]
    fn the_rows_are_what_the_messages_say(steps in prop::collection::vec(step(), 1..24)) {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .unwrap();
        runtime.block_on(live(&steps));
    }
}
