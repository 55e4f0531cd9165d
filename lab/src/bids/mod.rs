//! A trial on real lesions: the heads of a BIDS folder with the lesions that people drew, and controls. It counts what the candidates of
//! the map find, or the marks of another program, by one rule.

mod figures;
mod folder;
mod freeze;
mod head;
mod judge;
mod participants;
mod repeat;
mod report;
mod truth;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use analysis::{BORDERLINE_FROM, UNUSUAL_ABOVE};
use case::PatientSide;
use pipeline::{Extractor, NoNetwork, Pipeline};
use serde::Serialize;
use serde_json::json;

use self::figures::{Figures, JudgedPatient, difference};
use self::folder::{HeadFiles, heads, name_of};
use self::freeze::Frozen;
use self::head::{Finder, Found, FoundLesion, HeadResult, MadeWith, Outcome, PLACES, SEED};
use self::judge::{JudgedHead, MarkList, judge};
use self::participants::{Row, Table};
use self::truth::Lesions;
use crate::BenchError;
use crate::files::write;
use crate::statistics::Interval;

pub use self::folder::Truths;
pub use self::participants::Choice;
pub use self::repeat::{Pair, Repeated, pairs};
pub use self::report::TrialReport;
pub use self::truth::Rules;

/// The age below which a patient is a child, in years.
const CHILD_BELOW: f64 = 16.0;

/// What a trial is made of.
#[derive(Debug, Clone)]
pub struct TrialParameters {
    /// The BIDS folder.
    pub bids: PathBuf,
    /// Where the truths are.
    pub truths: Truths,
    /// The table of participants; `None` for `participants.tsv` of the folder, if there is one.
    pub participants: Option<PathBuf>,
    /// Which participants are patients; `None` for every head with a truth.
    pub patients: Option<Choice>,
    /// Which participants are controls.
    pub controls: Option<Choice>,
    /// Which participants belong to the trial; `None` for all.
    pub split: Option<Choice>,
    /// Which patients were reported as normal when their MR was first read.
    pub mri_negative: Option<Choice>,
    /// Columns of the table whose values are strata.
    pub strata: Vec<String>,
    /// Whether controls are required.
    pub needs_controls: bool,
    /// The weights of the network that extracts brains; `None` for tree pruning.
    pub network: Option<PathBuf>,
    /// The directory for results.
    pub results: PathBuf,
    /// Number of heads at the same time.
    pub jobs: usize,
    /// Whether program and parameters are locked before the first result.
    pub freeze: bool,
    /// Tables with the marks of other programs.
    pub candidates_of: Vec<PathBuf>,
}

/// Whether a head has a lesion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Role {
    Patient,
    Control,
}

/// A head of the trial.
struct Chosen {
    files: HeadFiles,
    role: Role,
    /// Names and values from the table of participants.
    strata: Vec<(String, String)>,
}

/// A head that is left out, or used with a remark.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Remark {
    head: String,
    reason: String,
}

impl Remark {
    fn new(head: &str, reason: impl Into<String>) -> Self {
        Self {
            head: head.to_owned(),
            reason: reason.into(),
        }
    }
}

/// The heads of a folder: those of the trial, those that are left out, and remarks.
struct Selection {
    folders: usize,
    chosen: Vec<Chosen>,
    left_out: Vec<Remark>,
    remarks: Vec<Remark>,
}

/// A head of the trial with its result.
struct Judgeable {
    chosen: Chosen,
    found: Box<Found>,
    lesions: Lesions,
    /// The strata of each lesion.
    strata: Vec<Vec<(String, String)>>,
}

/// Runs a trial, writes `report.html` and `report.json` into the directory of results, and returns the report. `progress` receives a
/// line for each head.
///
/// # Errors
/// If there is no truth or no control, the program or its parameters are not those that were locked, or a file cannot be read or
/// written. Heads that cannot be used are no error; the report lists them.
pub fn run(
    parameters: &TrialParameters,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<TrialReport, BenchError> {
    let mut selection = parameters.select()?;
    let made_with = MadeWith::network(parameters.network.as_deref())?;
    let frozen = parameters.frozen(&selection, &made_with)?;
    let pipeline = pipeline(parameters.network.as_deref(), parameters.jobs)?;
    let finder = Finder {
        pipeline: &pipeline,
        made_with: &made_with,
        results: &parameters.results,
    };
    let results = find_all(&finder, &selection.chosen, parameters.jobs, progress)?;
    let mut judgeable = Vec::new();
    let mut missed = 0;
    for (chosen, result) in selection.chosen.drain(..).zip(results) {
        let name = chosen.files.name.clone();
        match usable(chosen, result) {
            Ok(head) => {
                selection.remarks.extend(remarks(&name, &head));
                judgeable.push(head);
            }
            Err((role, reason)) => {
                missed += usize::from(role == Role::Patient);
                selection.left_out.push(Remark::new(&name, reason));
            }
        }
    }
    selection
        .left_out
        .sort_by(|one, other| one.head.cmp(&other.head));
    let report = parameters.report(&selection, &judgeable, missed, frozen)?;
    let written = |name: &str, bytes: &[u8]| write(&parameters.results.join(name), bytes);
    written("report.html", report.html().as_bytes())?;
    written("report.json", format!("{:#}\n", report.json()).as_bytes())?;
    Ok(report)
}

/// Prepares heads as cases are, several at the same time, with the weights of a network or by tree pruning.
///
/// # Errors
/// If the weights cannot be used.
pub fn pipeline(network: Option<&Path>, jobs: usize) -> Result<Pipeline, BenchError> {
    let extractor = match network {
        None => Extractor::default(),
        Some(path) => Extractor::open(Some(path)).map_err(|error| match error {
            NoNetwork::Unreadable { path, source } => BenchError::Unreadable {
                path,
                reason: source,
            },
            error @ NoNetwork::Unusable { .. } => BenchError::Usage(error.to_string()),
        })?,
    };
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    Ok(Pipeline::new(extractor).with_threads((cores / jobs.max(1)).max(1)))
}

/// The result of each head, in order; the reason if a file of it cannot be read.
fn find_all(
    finder: &Finder<'_>,
    chosen: &[Chosen],
    jobs: usize,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Vec<Result<HeadResult, String>>, BenchError> {
    let next = AtomicUsize::new(0);
    let is_stopped = AtomicBool::new(false);
    let done: Mutex<BTreeMap<usize, Result<HeadResult, String>>> = Mutex::default();
    let work = || -> Result<(), BenchError> {
        while !is_stopped.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(head) = chosen.get(number) else {
                break;
            };
            let found = finder.find(&head.files, head.role == Role::Patient);
            let result = match found {
                Err(error @ (BenchError::Usage(_) | BenchError::Unwritable { .. })) => {
                    is_stopped.store(true, Ordering::Relaxed);
                    return Err(error);
                }
                Err(error) => Err(error.to_string()),
                Ok((result, is_new)) => {
                    if is_new {
                        let (place, count) = (number + 1, chosen.len());
                        let outcome = match &result.outcome {
                            Outcome::Maps(found) => format!("{} candidates", found.marks.len()),
                            Outcome::NoMaps { sentence, .. } => format!("no maps: {sentence}"),
                        };
                        progress(&format!("{place} of {count}, {}: {outcome}", result.head));
                    }
                    Ok(result)
                }
            };
            let mut done = done
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            done.insert(number, result);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1)).map(|_| scope.spawn(work)).collect();
        workers
            .into_iter()
            .try_for_each(|worker| worker.join().expect("a head does not panic"))
    })?;
    let done = done
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    Ok(done.into_values().collect())
}

/// A head that can be judged, or why it cannot.
fn usable(chosen: Chosen, result: Result<HeadResult, String>) -> Result<Judgeable, (Role, String)> {
    let role = chosen.role;
    let kind = match role {
        Role::Patient => "patient",
        Role::Control => "control",
    };
    let refused = |reason: String| (role, format!("{kind} without a result: {reason}"));
    let result = result.map_err(refused)?;
    let found = match result.outcome {
        Outcome::Maps(found) => found,
        Outcome::NoMaps { code, sentence } => {
            return Err((role, format!("{kind} without maps ({code}): {sentence}")));
        }
    };
    let lesions = found.read_lesions(&chosen.files, &Rules::STANDARD);
    let lesions = lesions.map_err(|error| refused(error.to_string()))?;
    if role == Role::Patient && lesions.lesions.is_empty() {
        return Err(refused("its truth has no voxel".to_owned()));
    }
    let strata = found
        .lesions
        .iter()
        .map(|lesion| {
            let mut strata = strata_of(lesion, &found);
            strata.extend(chosen.strata.iter().cloned());
            strata
        })
        .collect();
    Ok(Judgeable {
        chosen,
        found,
        lesions,
        strata,
    })
}

/// The strata of a lesion that follow from the images. Values sort by their size.
fn strata_of(lesion: &FoundLesion, found: &Found) -> Vec<(String, String)> {
    let volume = match lesion.volume_ml {
        ..1.0 => "below 1 ml",
        ..=5.0 => "from 1 to 5 ml",
        _ => "more than 5 ml",
    };
    let depth = match lesion.depth_mm {
        ..8.0 => "below 8 mm",
        ..15.0 => "from 8 to 15 mm",
        _ => "more than 15 mm",
    };
    let edge_mm = found.voxel_mm.into_iter().fold(0.0, f64::max);
    let voxel = match edge_mm {
        ..0.95 => "below 0.95 mm",
        ..=1.05 => "about 1 mm",
        _ => "more than 1.05 mm",
    };
    let side = match lesion.side {
        PatientSide::Left => "left",
        PatientSide::Right => "right",
        PatientSide::Middle => "within 5 mm of the middle",
        PatientSide::Unknown => "in doubt",
    };
    let junction = if lesion.defined_share > 0.0 {
        "where the map is defined"
    } else {
        "where the map is undefined"
    };
    let place = found.truths.first().map_or("", |truth| truth.place.words());
    [
        ("volume", volume),
        ("side", side),
        ("depth of the centre", depth),
        ("largest voxel edge", voxel),
        ("truth", place),
        ("junction", junction),
        ("brain mask", found.mask_state.name()),
    ]
    .map(|(name, value)| (name.to_owned(), value.to_owned()))
    .to_vec()
}

/// What a reader of the report must know of a head that is used.
fn remarks(name: &str, head: &Judgeable) -> Vec<Remark> {
    let mut found = Vec::new();
    let files = &head.chosen.files;
    if files.t1.len() > 1 {
        let used = name_of(&files.t1[0]);
        let count = files.t1.len();
        found.push(Remark::new(
            name,
            format!("{count} T1-weighted volumes; {used} is used"),
        ));
    }
    for truth in &head.found.truths {
        use head::TruthPlace::{FlairDoubtful, FlairMissing};
        if matches!(truth.place, FlairDoubtful | FlairMissing) {
            let (file, place) = (&truth.file, truth.place.words());
            let reason = format!("{file}: {place}; it lies where its header places it");
            found.push(Remark::new(name, reason));
        }
    }
    if head.chosen.role == Role::Patient {
        if head
            .found
            .lesions
            .iter()
            .any(|lesion| lesion.depth_mm <= 0.0)
        {
            let reason = "the centre of a lesion lies outside the brain; check its file";
            found.push(Remark::new(name, reason));
        }
        let least = Rules::STANDARD.least_ml;
        if head.found.lesions[0].volume_ml <= least {
            let reason =
                format!("no part of the truth is larger than {least} ml; the largest counts");
            found.push(Remark::new(name, reason));
        }
    }
    if head.found.places.len() < PLACES {
        found.push(Remark::new(
            name,
            "it has too few cortical places for chance",
        ));
    }
    found
}

impl TrialParameters {
    /// Chooses the heads.
    fn select(&self) -> Result<Selection, BenchError> {
        let files = heads(&self.bids, &self.truths)?;
        let table = self.table()?;
        let mut selection = Selection {
            folders: files.len(),
            chosen: Vec::new(),
            left_out: Vec::new(),
            remarks: Vec::new(),
        };
        if let Some(table) = &table {
            let without_folder = table.rows().filter(|row| {
                let is_of = |head: &HeadFiles| participants::is_same_head(row.id(), &head.name);
                !files.iter().any(is_of)
            });
            for row in without_folder {
                let reason = "in the table of participants, but without a folder";
                selection.left_out.push(Remark::new(row.id(), reason));
            }
        }
        for head in files {
            let row = table.as_ref().and_then(|table| table.row(&head.name));
            match self.role(&head, table.is_some(), row) {
                Ok(role) => selection.chosen.push(Chosen {
                    strata: self.strata(row),
                    files: head,
                    role,
                }),
                Err(reason) => selection.left_out.push(Remark::new(&head.name, reason)),
            }
        }
        let count = |role| {
            let heads = selection.chosen.iter();
            heads.filter(|head| head.role == role).count()
        };
        let listed = |what: &str, advice: &str| {
            let mut text = format!("there is no {what} in {}; {advice}", self.bids.display());
            for Remark { head, reason } in selection.left_out.iter().take(10) {
                text += &format!("\n  {head}: {reason}");
            }
            Err(BenchError::Usage(text))
        };
        if count(Role::Patient) == 0 {
            return listed(
                "patient with a truth",
                "name the files with --truth, and the patients with --patients COLUMN=VALUE",
            );
        }
        if self.needs_controls && count(Role::Control) == 0 {
            return listed(
                "control",
                "name them with --controls COLUMN=VALUE. With --no-controls the trial runs without them, and cannot state how often \
                 sound heads are marked",
            );
        }
        Ok(selection)
    }

    fn table(&self) -> Result<Option<Table>, BenchError> {
        let usual = self.bids.join("participants.tsv");
        let path: Option<&Path> = match &self.participants {
            Some(path) => Some(path),
            None => usual.is_file().then_some(&usual),
        };
        let table = path.map(Table::read).transpose()?;
        let choices = [
            &self.patients,
            &self.controls,
            &self.split,
            &self.mri_negative,
        ];
        let columns = choices.into_iter().flatten().map(|choice| &choice.column);
        for column in columns.chain(&self.strata) {
            match &table {
                Some(table) => table.check_column(column)?,
                None => {
                    return Err(BenchError::Usage(format!(
                        "there is no table with the column {column:?}: {} is missing; name another one with --participants",
                        usual.display()
                    )));
                }
            }
        }
        Ok(table)
    }

    /// The role of a head, or why it is left out.
    fn role(
        &self,
        head: &HeadFiles,
        is_listed: bool,
        row: Option<Row<'_>>,
    ) -> Result<Role, String> {
        if is_listed && row.is_none() {
            return Err("it is not in the table of participants".to_owned());
        }
        let holds = |choice: &Option<Choice>| {
            let choice = choice.as_ref()?;
            Some(row.is_some_and(|row| choice.holds(&row)))
        };
        if let (Some(false), Some(split)) = (holds(&self.split), &self.split) {
            return Err(format!("it is not in the split {split}"));
        }
        let has_truth = !head.truths.is_empty();
        let is_control = holds(&self.controls).unwrap_or(false);
        let is_patient = holds(&self.patients).unwrap_or(has_truth && !is_control);
        let role = match (is_patient, is_control) {
            (true, true) => return Err("it is both a patient and a control".to_owned()),
            (true, false) if !has_truth => return Err("patient without a truth".to_owned()),
            (true, false) => Role::Patient,
            (false, true) if has_truth => return Err("control with a truth".to_owned()),
            (false, true) => Role::Control,
            (false, false) => return Err("it is neither a patient nor a control".to_owned()),
        };
        if head.t1.is_empty() {
            let kind = if is_patient { "patient" } else { "control" };
            return Err(format!(
                "{kind} without a T1-weighted volume (*_T1w.nii.gz)"
            ));
        }
        Ok(role)
    }

    /// The strata from the table of participants.
    fn strata(&self, row: Option<Row<'_>>) -> Vec<(String, String)> {
        let Some(row) = row else {
            return Vec::new();
        };
        let age = match row.age_years() {
            Some(age) if age < CHILD_BELOW => "below 16",
            Some(_) => "from 16 on",
            None => "unknown",
        };
        let mut strata = vec![("age in years".to_owned(), age.to_owned())];
        if let Some(choice) = &self.mri_negative {
            let is_negative = if choice.holds(&row) { "yes" } else { "no" };
            strata.push(("MRI-negative".to_owned(), is_negative.to_owned()));
        }
        for column in &self.strata {
            let value = row.get(column).unwrap_or("unknown");
            strata.push((column.clone(), value.to_owned()));
        }
        strata
    }

    /// Locks the program and its parameters, or checks that they are those that were locked.
    fn frozen(
        &self,
        selection: &Selection,
        made_with: &MadeWith,
    ) -> Result<Option<Frozen>, BenchError> {
        let heads: Vec<_> = selection
            .chosen
            .iter()
            .map(|head| (&head.files.name, head.role))
            .collect();
        let choice = |choice: &Option<Choice>| choice.as_ref().map(ToString::to_string);
        let parameters = json!({
            "made_with": made_with,
            "rules": Rules::STANDARD,
            "truth": self.truths.pattern,
            "patients": choice(&self.patients),
            "controls": choice(&self.controls),
            "split": choice(&self.split),
            "mri_negative": choice(&self.mri_negative),
            "strata": self.strata,
            "heads": heads,
        });
        Frozen::locked(&self.results, parameters, self.freeze)
    }

    fn report(
        &self,
        selection: &Selection,
        heads: &[Judgeable],
        missed: usize,
        frozen: Option<Frozen>,
    ) -> Result<TrialReport, BenchError> {
        let named = || {
            heads
                .iter()
                .map(|head| (head.chosen.files.name.as_str(), head))
        };
        let mut lists = vec![MarkList::own(
            named().map(|(name, head)| (name, &*head.found)),
        )];
        let names: Vec<&str> = named().map(|(name, _)| name).collect();
        for path in &self.candidates_of {
            lists.push(MarkList::of_file(path, &names)?);
        }
        let judged: Vec<Vec<JudgedHead>> = lists.iter().map(|list| judged(list, heads)).collect();
        let patients: Vec<Vec<JudgedPatient<'_>>> = judged
            .iter()
            .map(|judged| {
                let patients = heads.iter().zip(judged);
                patients
                    .filter(|(head, _)| head.chosen.role == Role::Patient)
                    .map(|(head, judged)| JudgedPatient {
                        head: judged,
                        strata: &head.strata,
                    })
                    .collect()
            })
            .collect();
        let controls = |judged: &'_ [JudgedHead]| -> Vec<JudgedHead> {
            let all = heads.iter().zip(judged);
            all.filter(|(head, _)| head.chosen.role == Role::Control)
                .map(|(_, judged)| judged.clone())
                .collect()
        };
        let own_limits = [
            ("above the limit for unusual", UNUSUAL_ABOVE),
            ("above the limit for borderline", BORDERLINE_FROM),
        ];
        let mut figures = Vec::new();
        for (number, list) in lists.iter().enumerate() {
            let controls = controls(&judged[number]);
            let limits: &[(&str, f32)] = if number == 0 { &own_limits } else { &[] };
            figures.push(Figures::of(
                &list.name,
                &patients[number],
                &controls.iter().collect::<Vec<_>>(),
                missed,
                (limits, SEED),
            ));
        }
        let differences: Vec<(String, [Interval; 3])> = lists
            .iter()
            .zip(&patients)
            .skip(1)
            .map(|(list, other)| {
                let name = format!("blur minus {}", list.name);
                (name, difference(&patients[0], other, SEED))
            })
            .collect();
        Ok(TrialReport::new(
            selection,
            heads,
            (&lists, &judged),
            (figures, differences),
            frozen,
        ))
    }
}

/// The marks of a list in each head, judged.
fn judged(list: &MarkList, heads: &[Judgeable]) -> Vec<JudgedHead> {
    heads
        .iter()
        .map(|head| {
            let marks = list.heads.get(&head.chosen.files.name);
            let marks = marks.map_or(&[][..], Vec::as_slice);
            judge(marks, &head.lesions, &head.found, &Rules::STANDARD)
        })
        .collect()
}
