//! `isocortex migrate-store`.

use std::path::Path;

use clap::Args;
use pacs::{CopiedStep, CopyCounts, PacsStore};
use storage::upkeep::{self, Copied, CopyStep};
use storage::{BadAddress, DatabaseAddress, Location, ObjectsAddress, Opening, Options, Store};
use tempfile::TempDir;

use super::status::{CliError, ExitStatus};
use crate::config::store_options;

/// Copy every case of a store into another one, with the images from a PACS and the results for one
///
/// Name a store by its directory, or by its database and its objects with a comma between them:
/// `postgres://isocortex@db/isocortex,s3://heads`. Intact objects that the target already has are read but not copied,
/// so run the command again after an interruption, or to copy new cases. Nothing is removed from either store. Stop the
/// servers and workers of the source before the last run. Passwords come from ~/.pgpass, the keys of a bucket from
/// the file that AWS_SHARED_CREDENTIALS_FILE names.
#[derive(Debug, Clone, Args)]
pub(super) struct MigrateStoreArgs {
    /// The store to read.
    #[arg(long, value_name = "STORE")]
    from: String,
    /// The store to write. If it is missing, it is made, with an id of its own.
    #[arg(long, value_name = "STORE")]
    to: String,
    /// Leave out the images that came from a PACS and the results that go to one, and count them.
    #[arg(long)]
    without_images: bool,
}

/// A store from the command line, with its temporary folder, if it needs one.
struct Named {
    location: Location,
    _folder: Option<TempDir>,
}

impl Named {
    fn parse(text: &str) -> Result<Self, CliError> {
        let wrong = |error: BadAddress| CliError::new(ExitStatus::Usage, error);
        let (location, folder) = match text.split_once(',') {
            None if text.contains("://") => return Err(wrong(BadAddress::Objects)),
            None => (Location::from(Path::new(text)), None),
            Some((database, objects)) => {
                let folder = tempfile::Builder::new().prefix("isocortex-").tempdir();
                let folder = folder.map_err(storage::StoreError::from)?;
                let location = Location {
                    database: Some(DatabaseAddress::parse(database).map_err(wrong)?),
                    objects: Some(ObjectsAddress::parse(objects).map_err(wrong)?),
                    ..Location::from(folder.path())
                };
                (location, Some(folder))
            }
        };
        Ok(Self {
            location,
            _folder: folder,
        })
    }

    async fn open(self, opening: Opening) -> Result<PacsStore, CliError> {
        let options = Options {
            opening,
            ..store_options()
        };
        let store = Store::open(self.location, options).await?;
        Ok(PacsStore::new(store))
    }
}

fn report(step: CopyStep, copied: &Copied) {
    match step {
        CopyStep::Case(_) if copied.cases.is_multiple_of(100) => {
            eprintln!("{} cases, {} objects so far", copied.cases, copied.objects);
        }
        CopyStep::Case(_) => {}
        CopyStep::LostCase(id) => {
            println!("not copied, because its source is missing or damaged: case {id}");
        }
    }
}

fn report_of_pacs(step: CopiedStep, copied: &CopyCounts) {
    match step {
        CopiedStep::Done if copied.series.is_multiple_of(100) => {
            eprintln!("{} so far", words(copied));
        }
        CopiedStep::Done => {}
        CopiedStep::Lost(name) => println!("not copied: {name}"),
    }
}

fn words(of_pacs: &CopyCounts) -> String {
    format!(
        "{} series with {} images, {} results",
        of_pacs.series, of_pacs.images, of_pacs.results
    )
}

/// Copies a store.
pub(super) fn run(args: &MigrateStoreArgs) -> Result<(), CliError> {
    super::keep_files_private();
    super::block_on(async {
        let [from, to] = [&args.from, &args.to].map(|store| Named::parse(store));
        let (from, to) = (from?, to?);
        let source = from.open(Opening::Existing).await?;
        let target = to.open(Opening::OrMake).await?;
        // What is made of images is judged by them.
        source.copy_images_into(&target).await?;
        let mut copied = upkeep::copy_into(source.store(), target.store(), &mut report).await?;
        let of_pacs = match args.without_images {
            true => source.count().await?,
            false => (source.copy_series_into(&target, &mut copied, &mut report_of_pacs)).await?,
        };
        source.store().close().await;
        target.store().close().await;
        println!(
            "copied: {} cases, {} objects, {} bytes; already there: {} objects",
            copied.cases, copied.objects, copied.bytes, copied.kept
        );
        match args.without_images {
            true => println!("for the PACS, not copied: {}", words(&of_pacs)),
            false => println!("for the PACS, copied: {}", words(&of_pacs)),
        }
        match copied.lost {
            0 => Ok(()),
            lost => {
                let message = format!(
                    "{lost} cases, images or results were not copied; run `isocortex check-store` on the source"
                );
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}
