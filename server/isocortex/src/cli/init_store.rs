//! `isocortex init-store` and `isocortex new-store-id`.

use clap::Args;
use storage::{Options, Store};

use super::common::StoreArgs;
use super::status::CliError;
use crate::config::store_options;

/// Make a new store, and print its id
///
/// Run it once, before `serve` or `work` is started for the first time. These open a store that is there, so that a folder that is not mounted,
/// or a mistyped address, is an error and not a new, empty store. A store that is there stays as it is.
#[derive(Debug, Clone, Args)]
pub(super) struct InitStoreArgs {
    #[command(flatten)]
    store: StoreArgs,
}

/// Give the copy of a store an id of its own, and print it
///
/// A copy that was made by other means than `migrate-store` (a copied folder; a dump of the database with a copy of the bucket) has the id of its
/// original, and must not be used beside it before this command. Stop the servers and workers of the copy first. Afterwards, its database opens
/// with its own objects alone.
#[derive(Debug, Clone, Args)]
pub(super) struct NewStoreIdArgs {
    #[command(flatten)]
    store: StoreArgs,
}

/// Makes a store.
pub(super) fn init(args: &InitStoreArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let location = args.store.config()?.cases()?.location;
    let options = Options {
        create: true,
        ..store_options()
    };
    super::block_on(async { print_id(Store::open_at(&location, options).await?).await })
}

/// Gives a store another id.
pub(super) fn new_id(args: &NewStoreIdArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let location = args.store.config()?.cases()?.location;
    super::block_on(async {
        print_id(Store::open_with_new_id(&location, store_options()).await?).await
    })
}

async fn print_id(store: Store) -> Result<(), CliError> {
    println!("{}", store.id().await?);
    store.close().await;
    Ok(())
}
