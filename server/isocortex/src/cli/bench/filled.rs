//! A store of prepared cases.

use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use measure::Head;

use crate::cli::status::{CliError, ExitStatus};
use case::{CaseId, CaseState, Parameters};
use cases::Library;
use cases::jobs::Workers;
use pipeline::Source;
use storage::{Options, Store};

/// Time for the workers to put their things away.
const GRACE: Duration = Duration::from_secs(60);

/// Two cases of one head differ in the radius of their closing by this, in mm.
const RADIUS_STEP_MM: f64 = 1e-3;

/// A temporary directory.
pub(super) fn temporary_directory() -> Result<tempfile::TempDir, CliError> {
    let made = tempfile::Builder::new()
        .prefix("isocortex-bench-")
        .tempdir();
    made.map_err(|error| {
        let message = format!("no temporary directory can be made: {error}");
        CliError::new(ExitStatus::CannotCreate, message)
    })
}

/// Prepares as many cases of a head as `numbers` has, which tell them apart, in the store of a directory.
pub(super) async fn fill(
    directory: &Path,
    head: &Head,
    numbers: std::ops::Range<usize>,
) -> Result<Vec<CaseId>, CliError> {
    let options = Options {
        queue_limit: numbers.len() + 1,
        ..Options::default()
    };
    let store = Store::open_with(directory, options).await?;
    let library = Library::of(store.clone());
    let workers = Workers::start(library.clone(), rayon::current_num_threads());
    let source = Source {
        volume: Bytes::copy_from_slice(&head.volume),
        mask: Some(Bytes::copy_from_slice(&head.mask)),
        ..Source::default()
    };
    let mut ids = Vec::new();
    for number in numbers {
        let parameters = Parameters {
            closing_radius_mm: 10.0 - RADIUS_STEP_MM * number as f64,
            ..Parameters::default()
        };
        ids.push(library.submit(source.clone(), parameters).await?.case.id);
    }
    let done = wait(&store, &ids).await;
    workers.shut_down(GRACE).await;
    done?;
    Ok(ids)
}

async fn wait(store: &Store, ids: &[CaseId]) -> Result<(), CliError> {
    for id in ids {
        let mut watch = store.subscribe(id);
        while let Some(case) = watch.next().await? {
            match (case.state, case.failure) {
                (CaseState::Ready, _) => break,
                (CaseState::Failed, Some(failure)) => return Err(failure.into()),
                _ => {}
            }
        }
    }
    Ok(())
}
