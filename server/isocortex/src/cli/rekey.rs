//! `isocortex rekey`.

use clap::Args;
use storage::{KeyId, Rekeyed, Store};

use super::common::StoreArgs;
use super::status::{CliError, ExitStatus};

/// Encrypt every object of a store with its current key
///
/// The current key is the first line of the key file; objects that are not encrypted, or with another of its keys, are written
/// again. If the first line is `none`, all are decrypted. The store may be in use, if all its servers and workers have the same key file.
/// After an interruption, run the command again. It ends with the keys that are no longer needed.
#[derive(Debug, Clone, Args)]
pub(super) struct RekeyArgs {
    #[command(flatten)]
    store: StoreArgs,
}

fn report(rekeyed: &Rekeyed) {
    let seen = rekeyed.written + rekeyed.kept;
    if seen.is_multiple_of(1024) && seen > 0 {
        eprintln!("{seen} objects so far");
    }
}

/// Encrypts a store again.
pub(super) fn run(args: &RekeyArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let config = args.store.config()?;
    if config.storage.key_file.is_none() {
        let message = "name the file with the keys: `--key-file FILE` (`isocortex key new`)";
        return Err(CliError::new(ExitStatus::Usage, message));
    }
    let options = config.cases()?;
    super::block_on(async {
        options.location.must_exist().await?;
        let store = Store::open_at(&options.location, options.store).await?;
        let rekeyed = store.rekey(&mut report).await?;
        store.close().await;
        match rekeyed.key {
            Some(key) => println!(
                "encrypted with the key {key}: {} objects; encrypted with it before: {} objects",
                rekeyed.written, rekeyed.kept
            ),
            None => println!(
                "decrypted: {} objects; not encrypted before: {} objects",
                rekeyed.written, rekeyed.kept
            ),
        }
        for name in &rekeyed.damaged {
            println!("damaged, and left as it is: {name}");
        }
        if !rekeyed.retired.is_empty() {
            let ids: Vec<_> = rekeyed.retired.iter().map(KeyId::to_string).collect();
            println!(
                "no longer needed by this store, but perhaps by its backups: {}",
                ids.join(", ")
            );
        }
        match rekeyed.damaged.len() {
            0 => Ok(()),
            count => {
                let message = format!(
                    "{count} objects are damaged; run `isocortex check-store --repair`, and then this command again"
                );
                Err(CliError::new(ExitStatus::InputOutput, message))
            }
        }
    })
}
