//! `isocortex remove-expired`.

use std::path::PathBuf;

use clap::Args;
use storage::Store;
use storage::upkeep::{self, Removal};

use super::common::{StoreArgs, set_some};
use super::status::{CliError, ExitStatus};
use crate::start::recorded;

/// Remove the cases that are older than a number of days, or list them
///
/// A case is removed if it is ready or failed, its last upload is at least that old, and it is not kept
/// (`PATCH /v1/cases/{id}` with `{"kept": true}`). Its age does not depend on how often it is viewed. Servers and workers
/// with `storage.keep_days` do the same every ten minutes; the store may be in use. Without `--yes` nothing is removed if the
/// clock has jumped, and at most 10 cases a day, or twice as many as came on the busiest one. With it, servers also go on to remove
/// what a PACS has sent (`pacs.keep_days`).
#[derive(Debug, Clone, Args)]
pub(super) struct RemoveExpiredArgs {
    #[command(flatten)]
    store: StoreArgs,
    /// The age in days. [default: `storage.keep_days` in the file]
    #[arg(long, value_name = "DAYS", env = "ISOCORTEX_KEEP_DAYS")]
    keep_days: Option<u64>,
    /// The folder of the audit record, which must exist. [default: `audit.folder` in the file]
    #[arg(long, value_name = "FOLDER", env = "ISOCORTEX_AUDIT")]
    audit: Option<PathBuf>,
    /// Only list the cases.
    #[arg(long)]
    dry_run: bool,
    /// The clock of the database is right, and all of them may go at once.
    #[arg(long, conflicts_with = "dry_run")]
    yes: bool,
}

/// Lists expired cases on standard output, and removes them unless it is a dry run.
pub(super) fn run(args: &RemoveExpiredArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let mut config = args.store.config()?;
    set_some(&mut config.storage.keep_days, args.keep_days.as_ref());
    set_some(&mut config.audit.folder, args.audit.as_ref());
    config.storage.create = false;
    config.check()?;
    let options = config.cases()?;
    // Without an age, `--yes` is about what a PACS has sent.
    let keep = options.store.keep;
    if keep.is_none() && !args.yes {
        let message = "state the age of the cases to remove: `--keep-days DAYS`";
        return Err(CliError::new(ExitStatus::Usage, message));
    }
    super::block_on(async {
        let store = Store::open(options.location, options.store).await?;
        let expired = match keep {
            Some(keep) => upkeep::expired(&store, keep, usize::MAX).await?,
            None => Vec::new(),
        };
        for id in &expired {
            if let Some(case) = store.case(id).await? {
                println!("expired: case {id}, last uploaded {}", case.uploaded_at);
            }
        }
        if args.dry_run {
            println!("would be removed: {} cases", expired.len());
        } else {
            let audit = config.audit()?;
            let removal = match args.yes {
                true => Removal::Confirmed,
                false => Removal::Asked,
            };
            let expired = cases::remove_expired(&store, &recorded(&audit), removal).await;
            audit.shut_down();
            let expired = expired?;
            println!("removed: {} cases", expired.removed);
            if let Some(why) = expired.waiting {
                let message = format!("cases stay: {}", why.sentence());
                return Err(CliError::new(ExitStatus::InputOutput, message));
            }
            if audit.is_full() {
                let message = "the audit record cannot be written, so expired cases stay";
                return Err(CliError::new(ExitStatus::InputOutput, message));
            }
        }
        store.close().await;
        Ok(())
    })
}
