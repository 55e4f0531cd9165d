//! `isocortex init-store` and `isocortex new-store-id`.

use clap::Args;
use storage::{Opening, Options, Store};

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
    open_and_print(&args.store, Opening::OrMake)
}

/// Gives a store another id.
pub(super) fn new_id(args: &NewStoreIdArgs) -> Result<(), CliError> {
    open_and_print(&args.store, Opening::WithNewId)
}

/// Opens a store and prints its id.
fn open_and_print(store: &StoreArgs, opening: Opening) -> Result<(), CliError> {
    super::keep_files_private();
    let location = store.config()?.cases()?.location;
    let options = Options {
        opening,
        ..store_options()
    };
    super::block_on(async {
        let store = Store::open(location, options).await?;
        println!("{}", store.id().await?);
        store.close().await;
        Ok(())
    })
}
