//! The kinds of jobs of the application, and what runs them.

mod headers;
mod layer;
mod maps;
mod prepare;
mod rebuild;

use std::sync::Arc;
use std::time::Duration;

use storage::Store;
use storage::upkeep::{self, Expired, Removal};

use crate::library::Library;
use crate::removal::{BeforeRemoval, DailyWarning, remove_expired};
use crate::runner::{Runner, Terms, Work};

use self::layer::PrepareLayer;
use self::maps::ComputeMaps;
use self::prepare::PrepareCase;
use self::rebuild::Rebuild;

/// How long the rows of ended jobs stay, for lists and metrics.
const KEEP_ENDED: Duration = Duration::from_secs(7 * 24 * 3600);

/// How often to search for expired cases, and for objects that a killed process left behind.
const COLLECT_EVERY: Duration = Duration::from_secs(600);

/// Starts `count` workers on the current runtime. Each prepares one case or layer at a time; maps and rebuilds come one
/// by one beside them, because they use every core.
pub fn start_workers(library: Library, count: usize) -> Runner {
    let store = library.store().clone();
    let mut lanes: Vec<Vec<Arc<dyn Work>>> = Vec::new();
    for _ in 0..count {
        lanes.push(vec![
            Arc::new(PrepareCase(library.clone())),
            Arc::new(PrepareLayer(library.clone())),
        ]);
    }
    if count > 0 {
        lanes.push(vec![Arc::new(Rebuild(library.clone()))]);
        if library.makes_maps() {
            lanes.push(vec![Arc::new(ComputeMaps(library.clone()))]);
        }
    }
    let mut runner = Runner::start(&store, lanes);
    let before = library.before_removal().clone();
    let waiting = Arc::<DailyWarning>::default();
    runner.repeat(COLLECT_EVERY, move || {
        clean_up(store.clone(), before.clone(), Arc::clone(&waiting))
    });
    runner
}

/// Prepares one case; `false` if none waits.
#[cfg(test)]
pub(crate) async fn prepare_one(library: &Library) -> bool {
    let work = Arc::new(PrepareCase(library.clone()));
    crate::runner::once(library.store(), work).await
}

/// Prepares one layer; `false` if none waits.
#[cfg(test)]
pub(crate) async fn prepare_one_layer(library: &Library) -> bool {
    let work = Arc::new(PrepareLayer(library.clone()));
    crate::runner::once(library.store(), work).await
}

/// The terms of the preparation of cases and of what belongs to them.
fn usual_terms(library: &Library) -> Terms {
    let options = library.store().options();
    Terms {
        max_attempts: options.max_attempts,
        retry_after: options.retry_after,
        longest: options.longest_preparation,
    }
}

/// Removes cases that are older than they are kept, jobs that ended some days ago, and objects that nobody needs. What waits is
/// logged once a day.
async fn clean_up(store: Store, before: BeforeRemoval, waiting: Arc<DailyWarning>) {
    match remove_expired(&store, &before, Removal::Automatic).await {
        Ok(Expired {
            removed,
            waiting: why,
        }) => {
            if removed > 0 {
                tracing::info!(removed, "cases older than storage.keep_days were removed");
            }
            if let Some(why) = waiting.to_say(why) {
                let cases = upkeep::row_counts(&store)
                    .await
                    .ok()
                    .map(|counts| counts.expired);
                tracing::warn!(
                    cases,
                    "cases older than storage.keep_days stay: {}",
                    why.sentence()
                );
            }
        }
        Err(error) => tracing::warn!(
            error = &error as &dyn std::error::Error,
            "cannot remove expired cases"
        ),
    }
    if let Err(error) = store.forget_jobs(KEEP_ENDED).await {
        tracing::warn!(
            error = &error as &dyn std::error::Error,
            "jobs that ended some days ago will be forgotten later"
        );
    }
    if let Err(error) = store.collect().await {
        tracing::warn!(
            error = &error as &dyn std::error::Error,
            "cannot remove left-over objects"
        );
    }
}
