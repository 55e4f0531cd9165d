//! The kinds of jobs of the application, and what runs them.

mod headers;
mod layer;
mod maps;
mod prepare;
mod rebuild;
mod series;

use std::sync::Arc;
use std::time::Duration;

use audit::{Action, Audit, Event, EventKind, Outcome, project_named};
use case::CaseId;
use storage::{Store, StoreError};

use crate::application::Cases;
use crate::arrivals::ArrivalOptions;
use crate::library::Library;
use crate::runner::{Runner, Terms, Work};

use self::layer::PrepareLayer;
use self::maps::ComputeMaps;
use self::prepare::PrepareCase;
use self::rebuild::Rebuild;
use self::series::ReadSeries;

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
    let audit = library.audit().clone();
    runner.repeat(COLLECT_EVERY, move || {
        clean_up(store.clone(), audit.clone())
    });
    runner
}

/// Starts to read the series of a PACS on the current runtime, one at a time.
pub fn start_series_reader(cases: Cases, options: ArrivalOptions) -> Runner {
    let store = cases.store().clone();
    let work = Arc::new(ReadSeries { cases, options });
    let mut runner = Runner::start(&store, vec![vec![work]]);
    runner.repeat(COLLECT_EVERY, move || forget(store.clone(), options));
    runner
}

/// Reads one series that is due; `false` if there is none.
#[cfg(test)]
pub(crate) async fn read_one_series(cases: &Cases, options: ArrivalOptions) -> bool {
    let cases = cases.clone();
    let store = cases.store().clone();
    crate::runner::once(&store, Arc::new(ReadSeries { cases, options })).await
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

/// Removes the cases that are older than they are kept; returns how many. Each is on record before it goes; if it cannot be recorded,
/// it stays.
///
/// # Errors
/// If the rows or the objects cannot be written.
pub async fn remove_expired(store: &Store, audit: &Audit) -> Result<usize, StoreError> {
    let may_go = |id: CaseId| async move {
        let event = Event {
            outcome: Outcome::Allowed,
            project: project_named(id.project().name()),
            case: Some(id.to_string().into()),
            ..Event::new(
                EventKind::StudyDeleted,
                Action::Delete,
                "expired case",
                "isocortex",
            )
        };
        audit.record(event).await.is_ok()
    };
    store.remove_expired(may_go).await
}

/// Removes cases that are older than they are kept, jobs that ended some days ago, and objects that nobody needs.
async fn clean_up(store: Store, audit: Audit) {
    match remove_expired(&store, &audit).await {
        Ok(0) => {}
        Ok(removed) => tracing::info!(removed, "cases older than storage.keep_days were removed"),
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

/// Forgets what came some days ago, and results that were sent then.
async fn forget(store: Store, options: ArrivalOptions) {
    if let Err(error) = store.forget(options.keep).await {
        tracing::warn!(
            error = &error as &dyn std::error::Error,
            "series and results of some days ago will be forgotten later"
        );
    }
}
