//! `isocortex migrate-store`.

use std::path::Path;

use case::CaseId;
use clap::Args;
use storage::{BadAddress, Copied, DatabaseAddress, Location, ObjectsAddress, Options, Store};
use tempfile::TempDir;

use super::status::{CliError, ExitStatus};

/// Copy every case of a store into another one
///
/// Name a store by its directory, or by its database and its objects with a comma between them:
/// `postgres://isocortex@db/isocortex,s3://heads`. Intact objects that the target already has are read but not copied,
/// so run the command again after an interruption, or to copy new cases. Nothing is removed from either store. Stop the
/// servers and workers of the source before the last run. Passwords come from PGPASSWORD or ~/.pgpass, the keys of a
/// bucket from the AWS_ variables.
#[derive(Debug, Clone, Args)]
pub(super) struct MigrateStoreArgs {
    /// The store to read.
    #[arg(long, value_name = "STORE")]
    from: String,
    /// The store to write; created if missing.
    #[arg(long, value_name = "STORE")]
    to: String,
}

/// A store from the command line, with its temporary folder, if it needs one.
struct Named {
    store: Store,
    _folder: Option<TempDir>,
}

impl Named {
    async fn open(text: &str) -> Result<Self, CliError> {
        let wrong = |error: BadAddress| CliError::new(ExitStatus::Usage, error);
        let (location, folder) = match text.split_once(',') {
            None if text.contains("://") => return Err(wrong(BadAddress::Objects)),
            None => (Location::from(Path::new(text)), None),
            Some((database, objects)) => {
                let folder = tempfile::Builder::new().prefix("isocortex-").tempdir();
                let folder = folder.map_err(storage::StoreError::from)?;
                let location = Location {
                    folder: folder.path().to_owned(),
                    database: Some(DatabaseAddress::parse(database).map_err(wrong)?),
                    objects: Some(ObjectsAddress::parse(objects).map_err(wrong)?),
                };
                (location, Some(folder))
            }
        };
        Ok(Self {
            store: Store::open_at(&location, Options::default()).await?,
            _folder: folder,
        })
    }
}

/// Copies a store.
pub(super) fn run(args: &MigrateStoreArgs) -> Result<(), CliError> {
    super::keep_files_private();
    if !args.from.contains(',') && !Path::new(&args.from).is_dir() {
        let message =
            "the directory to copy from does not exist; name any other store as `DATABASE,OBJECTS`";
        return Err(CliError::new(ExitStatus::NoInput, message));
    }
    super::block_on(async {
        let from = Named::open(&args.from).await?;
        let to = Named::open(&args.to).await?;
        let mut report = |id: &CaseId, is_whole: bool, copied: &Copied| {
            if !is_whole {
                println!("not copied, because its source is missing or damaged: case {id}");
            }
            if copied.cases.is_multiple_of(100) {
                eprintln!("{} cases, {} objects so far", copied.cases, copied.objects);
            }
        };
        let copied = from.store.copy_into(&to.store, &mut report).await?;
        from.store.close().await;
        to.store.close().await;
        println!(
            "copied: {} cases, {} objects, {} bytes; already there: {} objects",
            copied.cases, copied.objects, copied.bytes, copied.kept
        );
        match copied.lost {
            0 => Ok(()),
            lost => {
                let message = format!(
                    "{lost} cases were not copied; run `isocortex check-store` on the source"
                );
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}
