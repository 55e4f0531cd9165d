//! `isocortex check-store`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use case::{CaseId, ObjectKind};
use cases::Library;
use clap::Args;
use storage::{Defect, ObjectName};

use super::common::{StoreArgs, set_some};
use super::status::{CliError, ExitStatus};
use crate::start;

/// Read every row and every object of a store, and report what is missing, damaged or unreferenced
///
/// Standard output has a line for each defect. The store may be in use. The exit status is 0 if no problem was found
/// or all were repaired, and 74 if a problem remains.
#[derive(Debug, Clone, Args)]
pub(super) struct CheckStoreArgs {
    #[command(flatten)]
    store: StoreArgs,
    /// The file with the weights for brain extraction. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// Compute missing or damaged results again, and remove unreferenced objects. A lost source must be uploaded again.
    #[arg(long)]
    repair: bool,
}

/// The defects, by their remedy.
#[derive(Debug, Default)]
struct Defects {
    lost_sources: BTreeSet<CaseId>,
    /// What a reader has marked: it is derived from nothing.
    lost_findings: BTreeSet<CaseId>,
    to_rebuild: BTreeSet<CaseId>,
    /// The number of images from a PACS, and of results for one.
    lost_for_pacs: usize,
    unreferenced: Vec<ObjectName>,
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
            Defect::MissingForPacs(name) => return self.add_lost("missing", name),
            Defect::DamagedForPacs(name) => return self.add_lost("damaged", name),
            Defect::Unreferenced(name) => {
                println!("unreferenced: {name}");
                return self.unreferenced.push(name);
            }
        };
        println!("{what}: {} of case {id}", name.kind.name());
        match name.kind.is_source() {
            true => self.lost_sources.insert(id),
            false => self.to_rebuild.insert(id),
        };
    }

    /// An image from a PACS, or a result for one: only its sender has it again.
    fn add_lost(&mut self, what: &str, name: ObjectName) {
        println!("{what}: {name}");
        self.lost_for_pacs += 1;
    }

    /// The number of cases and objects with a problem.
    fn count(&self) -> usize {
        let cases: BTreeSet<_> = self.lost_sources.union(&self.to_rebuild).collect();
        cases.len() + self.lost_findings.len() + self.lost_for_pacs + self.unreferenced.len()
    }

    /// Rebuilds cases and removes unreferenced objects.
    async fn repair(&mut self, library: &Library) -> Result<(), CliError> {
        for id in std::mem::take(&mut self.to_rebuild) {
            let read = library.load(&id, &ObjectKind::DERIVED, |_, _| Some(()));
            if read.await?.is_some() {
                println!("rebuilt: case {id}");
            } else if !self.lost_sources.contains(&id) && library.store().case(&id).await?.is_some()
            {
                println!("cannot be rebuilt: case {id}");
                self.lost_sources.insert(id);
            }
        }
        let unreferenced = std::mem::take(&mut self.unreferenced);
        library.store().remove_unreferenced(&unreferenced).await?;
        if !unreferenced.is_empty() {
            println!("removed: {} objects", unreferenced.len());
        }
        Ok(())
    }
}

/// Checks a store, and repairs it on request.
pub(super) fn run(args: &CheckStoreArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let mut config = args.store.config()?;
    set_some(&mut config.prepare.network, args.network.as_ref());
    super::block_on(async {
        config.cases()?.location.must_exist().await?;
        let library = start::open_library(&config).await?;
        let mut defects = Defects::default();
        let inspected = library
            .store()
            .inspect(&mut |defect| defects.add(defect))
            .await?;
        println!(
            "read: {} cases, {} objects, {} bytes",
            inspected.cases, inspected.objects, inspected.bytes
        );
        if args.repair {
            defects.repair(&library).await?;
        }
        library.store().close().await;
        match defects.count() {
            0 => Ok(()),
            count => {
                let hint = match args.repair {
                    false => "run the command with `--repair`",
                    true => {
                        "upload the volumes of these cases again, or delete the cases; restore findings from a backup; send images from a PACS again, and make results again"
                    }
                };
                let message = format!("{count} cases or objects have a problem; {hint}");
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}
