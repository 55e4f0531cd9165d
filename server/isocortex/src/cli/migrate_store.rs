//! `isocortex migrate-store`.

use std::path::Path;

use case::CaseId;
use clap::Args;
use storage::{BadAddress, Copied, DatabaseAddress, Location, ObjectsAddress, Options, Store};
use tempfile::TempDir;

use super::status::{CliError, ExitStatus};

/// Copy every case of a store into another one
///
/// A store is named by its directory, or by its database and its objects with a comma between them:
/// `postgres://isocortex@db/isocortex,s3://heads`. What is in the other store already is read, and kept if it is whole: run the command
/// again after an interruption, or to bring what is new. Nothing is removed from either store. Stop the servers and workers of the first
/// one before the last run. Passwords come from PGPASSWORD or ~/.pgpass, keys of a bucket from the AWS_ variables.
#[derive(Debug, Clone, Args)]
pub(super) struct MigrateStoreArgs {
    /// The store to read.
    #[arg(long, value_name = "STORE")]
    from: String,
    /// The store to write; made where it is missing.
    #[arg(long, value_name = "STORE")]
    to: String,
}

/// A store that was named on the command line, with what must live as long.
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
            "there is no such directory to copy from; a store elsewhere is `DATABASE,OBJECTS`";
        return Err(CliError::new(ExitStatus::NoInput, message));
    }
    super::block_on(async {
        let from = Named::open(&args.from).await?;
        let to = Named::open(&args.to).await?;
        let mut report = |id: &CaseId, is_whole: bool, copied: &Copied| {
            if !is_whole {
                println!("left out, since its source is missing or damaged: case {id}");
            }
            if copied.cases.is_multiple_of(100) {
                eprintln!("{} cases, {} objects so far", copied.cases, copied.objects);
            }
        };
        let copied = from.store.copy_into(&to.store, &mut report).await?;
        from.store.close().await;
        to.store.close().await;
        println!(
            "copied: {} cases, {} objects, {} bytes; there already: {} objects",
            copied.cases, copied.objects, copied.bytes, copied.kept
        );
        match copied.lost {
            0 => Ok(()),
            lost => {
                let message = format!(
                    "{lost} cases were left out: run `isocortex check-store` on the first store"
                );
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}
