//! `isocortex check-store`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use case::{CaseId, CaseState, LayerId, ObjectKind};
use cases::settings::Render;
use cases::{Adopted, Cases, Library};
use clap::Args;
use pacs::Arrivals;
use storage::upkeep::{self, Amount, Defect};
use storage::{Store, StoreError};

use super::common::{StoreArgs, set_some};
use super::status::{CliError, ExitStatus};
use crate::config::Config;
use crate::start::StartError;

/// Read every row and every object of a store, and report what is missing, damaged or unreferenced
///
/// Standard output has a line for each defect. The store may be in use. The exit status is 0 if no problem was found
/// or all were repaired, and 74 if a problem remains. After a restore of the database, run `--adopt`, then `--repair`.
#[derive(Debug, Clone, Args)]
pub(super) struct CheckStoreArgs {
    #[command(flatten)]
    store: StoreArgs,
    /// The file with the weights for brain extraction. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// First submit again what was uploaded after the backup from which the database was restored, and receive images of a PACS again.
    #[arg(long)]
    adopt: bool,
    /// Compute missing or damaged results again, and prepare cases again that failed though their sources are whole. Deletes nothing. A
    /// lost source must be uploaded again.
    #[arg(long)]
    repair: bool,
    /// At the end remove objects that nothing refers to and that are at least 7 days old.
    #[arg(long)]
    remove_unreferenced: bool,
    /// Remove them also if they are more than 5 % of the store.
    #[arg(long, requires = "remove_unreferenced")]
    yes: bool,
}

/// The defects, by their remedy.
#[derive(Debug, Default)]
struct Defects {
    lost_sources: BTreeSet<CaseId>,
    /// What a reader has marked: it is derived from nothing.
    lost_findings: BTreeSet<CaseId>,
    /// The same of what a reader has concluded.
    lost_readings: BTreeSet<CaseId>,
    to_rebuild: BTreeMap<CaseId, BTreeSet<ObjectKind>>,
    /// Failed cases and layers whose sources are whole.
    to_prepare: BTreeSet<CaseId>,
    layers_to_prepare: BTreeSet<(CaseId, LayerId)>,
    /// The number of images from a PACS, and of results for one.
    lost_for_pacs: usize,
    /// The number of manifests, and of images from a PACS, that no row names.
    to_adopt: usize,
    /// The number of other objects that nothing refers to, which do no harm.
    unreferenced: usize,
}

impl Defects {
    fn add(&mut self, defect: Defect) {
        let (what, id, name) = match defect {
            Defect::Missing(id, name) => ("missing", id, name),
            Defect::Damaged(id, name) => ("damaged", id, name),
            Defect::DamagedFindings(id) => {
                println!("damaged: findings of case {id}");
                self.lost_findings.insert(id);
                return;
            }
            Defect::DamagedReading(id) => {
                println!("damaged: reading of case {id}");
                self.lost_readings.insert(id);
                return;
            }
            Defect::FailedThoughWhole(id) => {
                println!("failed, and its sources are whole: case {id}");
                self.to_prepare.insert(id);
                return;
            }
            Defect::LayerFailedThoughWhole(id, layer) => {
                println!("failed, and its sources are whole: layer {layer} of case {id}");
                self.layers_to_prepare.insert((id, layer));
                return;
            }
            Defect::Unreferenced(name) => {
                println!("unreferenced: {name}");
                match name.kind {
                    ObjectKind::Manifest | ObjectKind::Instance => self.to_adopt += 1,
                    _ => self.unreferenced += 1,
                }
                return;
            }
        };
        let Some(id) = id else {
            println!("{what}: {name}");
            // An image from a PACS, or a result for one: only its sender has it again.
            self.lost_for_pacs += 1;
            return;
        };
        println!("{what}: {} of case {id}", name.kind.name());
        match name.kind.is_source() {
            true => _ = self.lost_sources.insert(id),
            false => _ = self.to_rebuild.entry(id).or_default().insert(name.kind),
        }
    }

    /// The number of cases and objects with a problem.
    fn count(&self) -> usize {
        let mut cases = self.lost_sources.clone();
        cases.extend(self.to_rebuild.keys());
        cases.extend(&self.to_prepare);
        cases.extend(self.layers_to_prepare.iter().map(|(case, _)| case));
        let written = self.lost_findings.len() + self.lost_readings.len();
        cases.len() + written + self.lost_for_pacs + self.to_adopt
    }

    /// Makes again what can be made again. Deletes nothing.
    async fn repair(&mut self, library: &Library) -> Result<(), CliError> {
        let store = library.store();
        for (id, kinds) in std::mem::take(&mut self.to_rebuild) {
            if kinds.contains(&ObjectKind::Manifest) {
                upkeep::restore_manifests(store, &id).await?;
                println!("written again: manifest of case {id}");
            }
            for kind in [ObjectKind::Maps, ObjectKind::Surfaces, ObjectKind::Layer] {
                if kinds.contains(&kind) {
                    println!("made again when it is needed: {} of case {id}", kind.name());
                }
            }
            if kinds.iter().any(|kind| ObjectKind::DERIVED.contains(kind)) {
                self.rebuild(library, id).await?;
            }
        }
        for id in std::mem::take(&mut self.to_prepare) {
            if store.prepare_again(&id, CaseState::Failed).await? {
                println!("will be prepared again: case {id}");
            }
        }
        for (id, layer) in std::mem::take(&mut self.layers_to_prepare) {
            if store
                .prepare_again((&id, &layer), CaseState::Failed)
                .await?
            {
                println!("will be prepared again: layer {layer} of case {id}");
            }
        }
        Ok(())
    }

    async fn rebuild(&mut self, library: &Library, id: CaseId) -> Result<(), CliError> {
        let read = library.load(&id, &ObjectKind::DERIVED, |_, _| Some(()));
        match read.await {
            Ok(Some(())) => println!("rebuilt: case {id}"),
            Ok(None) | Err(StoreError::SourceMissing) => {
                if !self.lost_sources.contains(&id) && library.store().case(&id).await?.is_some() {
                    println!("cannot be rebuilt: case {id}");
                    self.lost_sources.insert(id);
                }
            }
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    /// What to do about what is left.
    fn hint(&self, args: &CheckStoreArgs) -> &'static str {
        if self.to_adopt > 0 && !args.adopt {
            return "no row names some uploads: if the database was restored, run the command with `--adopt`";
        }
        match args.repair {
            false => "run the command with `--repair`",
            true => {
                "bring the missing files back, upload the volumes of these cases again, or delete the cases; restore findings and readings from a backup; send images from a PACS again, and make results again"
            }
        }
    }
}

/// Checks a store, and repairs it on request.
pub(super) fn run(args: &CheckStoreArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let mut config = args.store.config()?;
    set_some(&mut config.prepare.network, args.network.as_ref());
    config.storage.create = false;
    super::block_on(async {
        let cases = open(&config).await?;
        let store = cases.store();
        if args.adopt {
            let mut adopted = cases.adopt().await?;
            let (images, left) = Arrivals::new(cases.clone()).adopt().await?;
            adopted.left.extend(left);
            report(&adopted, images);
        }
        let mut defects = Defects::default();
        let inspected = upkeep::inspect(store, &mut |defect| defects.add(defect)).await?;
        println!(
            "read: {} cases, {} objects, {} bytes",
            inspected.cases, inspected.objects, inspected.bytes
        );
        if args.repair {
            defects.repair(&cases.library).await?;
        }
        match (defects.unreferenced, args.remove_unreferenced) {
            // What could still be adopted must not go because nobody thought of it.
            (_, true) if defects.to_adopt > 0 && !args.yes => {
                println!(
                    "nothing removed: {} uploads or images are named by no row; bring them back by `--adopt`, or remove them by `--yes`",
                    defects.to_adopt
                );
            }
            (_, true) => remove_unreferenced(store, args.yes).await?,
            (0, false) => {}
            (count, false) => println!(
                "unreferenced: {count} objects that do no harm; `--remove-unreferenced` removes those of 7 days"
            ),
        }
        store.close().await;
        match defects.count() {
            0 => Ok(()),
            count => {
                let hint = defects.hint(args);
                let message = format!("{count} cases or objects have a problem; {hint}");
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}

/// Opens a store that exists, and removes nothing of it: the rows may be those of a backup, and the objects newer.
async fn open(config: &Config) -> Result<Cases, CliError> {
    config.check()?;
    let mut options = cases::Options {
        render: Render::on_cpu(),
        ..config.cases()?
    };
    options.store.sweeps_at_start = false;
    options.store.queue_limit = usize::MAX;
    let library = cases::open_library(&options).await;
    Ok(Cases::on(library.map_err(StartError::from)?, &options))
}

fn report(adopted: &Adopted, images: usize) {
    for case in &adopted.cases {
        println!("submitted again: case {case}");
    }
    for (case, layer) in &adopted.layers {
        println!("submitted again: layer {layer} of case {case}");
    }
    for name in &adopted.left {
        println!("cannot be submitted again, because an object is missing or damaged: {name}");
    }
    println!(
        "adopted: {} cases, {} layers, {} images from a PACS",
        adopted.cases.len(),
        adopted.layers.len(),
        images
    );
    println!(
        "not in the objects, and gone since the backup: labels, findings, readings, which cases are kept, names of layers that were changed, and which results were sent"
    );
}

fn words(amount: &Amount) -> String {
    format!("{} objects, {} bytes", amount.objects, amount.bytes)
}

/// Removes objects that nothing refers to, unless they may be uploads that the rows do not know.
async fn remove_unreferenced(store: &Store, is_confirmed: bool) -> Result<(), CliError> {
    let found = upkeep::unreferenced(store).await?;
    println!(
        "unreferenced: {} of at least 7 days, {} younger, of {} in the store",
        words(&found.old),
        words(&found.young),
        words(&found.all)
    );
    let refuse = |message| Err(CliError::new(ExitStatus::InputOutput, message));
    if found.is_newer_than_rows {
        return refuse(
            "nothing was removed: an unreferenced object is younger than every case, so the database may be that of a backup, or of another store; run `check-store --adopt`, or wait until a case was uploaded",
        );
    }
    if found.is_much() && !is_confirmed {
        return refuse(
            "nothing was removed: this is more than 5 % of the store; if the database is the right one, run the command with `--yes`",
        );
    }
    upkeep::remove_unreferenced(store, &found.names).await?;
    println!("removed: {} objects", found.names.len());
    Ok(())
}
