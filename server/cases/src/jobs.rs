//! Workers that prepare queued cases, and their layers.
//!
//! A job is a row with a lease. A worker renews the lease while it prepares. If the worker is killed, the lease ends
//! and another worker takes the job with a greater fence number, so that the first one can no longer publish.

mod headers;
mod layers;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use case::{Failure, FailureKind, Progress, Stage};
use pipeline::{Derived, Input};
use storage::{
    Claim, Count, LeaseTerms, Published, Publisher, Release, Store, StoreError, frame_all,
};
use tokio::sync::watch;
use tokio::task::{JoinError, JoinSet};
use tokio::time::MissedTickBehavior;

use self::headers::doubt_header;
use crate::library::Library;

/// How often to search for expired cases, and for objects that a killed process left behind.
const COLLECT_EVERY: Duration = Duration::from_secs(600);

/// The phases of the workers, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Working,
    /// Finish running work, and begin none.
    Finishing,
    /// Stop, and return running jobs.
    Stopping,
}

/// Running workers. Dropping them stops them; others take their jobs after the leases end.
#[derive(Debug)]
pub struct Workers {
    phase: watch::Sender<Phase>,
    tasks: JoinSet<()>,
}

impl Workers {
    /// Starts `count` workers on the current runtime. Each prepares one case at a time.
    pub fn start(library: Library, count: usize) -> Self {
        let phase = watch::Sender::new(Phase::Working);
        let mut tasks = JoinSet::new();
        for _ in 0..count {
            let worker = Worker {
                library: library.clone(),
                store: library.store().clone(),
                phase: phase.subscribe(),
            };
            tasks.spawn(worker.work());
        }
        tasks.spawn(collect_now_and_then(
            library.store().clone(),
            phase.subscribe(),
        ));
        Self { phase, tasks }
    }

    /// Takes no more work, lets running work finish within `grace`, and then returns unfinished jobs.
    pub async fn shut_down(mut self, grace: Duration) {
        self.phase.send_replace(Phase::Finishing);
        let all_done = async { while self.tasks.join_next().await.is_some() {} };
        if tokio::time::timeout(grace, all_done).await.is_err() {
            self.phase.send_replace(Phase::Stopping);
            while self.tasks.join_next().await.is_some() {}
        }
    }
}

/// Waits for a phase, or for the end of the workers.
async fn until(phase: &mut watch::Receiver<Phase>, reached: Phase) {
    // Holding the value would hold a lock.
    drop(phase.wait_for(|&phase| phase >= reached).await);
}

async fn collect_now_and_then(store: Store, mut phase: watch::Receiver<Phase>) {
    loop {
        remove_expired(&store).await;
        tokio::select! {
            () = until(&mut phase, Phase::Finishing) => return,
            () = tokio::time::sleep(COLLECT_EVERY) => {}
        }
        if let Err(error) = store.collect().await {
            tracing::warn!(
                error = &error as &dyn std::error::Error,
                "cannot remove left-over objects"
            );
        }
    }
}

/// Removes cases that are older than they are kept.
async fn remove_expired(store: &Store) {
    match store.remove_expired().await {
        Ok(0) => {}
        Ok(removed) => tracing::info!(removed, "cases older than storage.keep_days were removed"),
        Err(error) => tracing::warn!(
            error = &error as &dyn std::error::Error,
            "cannot remove expired cases"
        ),
    }
}

/// The end of a preparation.
enum Outcome {
    Derived(Box<Derived>),
    Refused(Failure),
    /// The case was deleted, or another worker has the lease.
    Lost,
    /// The process must stop.
    HandedBack,
}

struct Worker {
    library: Library,
    store: Store,
    phase: watch::Receiver<Phase>,
}

impl Worker {
    async fn work(mut self) {
        while *self.phase.borrow() == Phase::Working {
            let worked = match self.claim().await {
                Ok(Some(claim)) => {
                    self.prepare(&claim).await;
                    Ok(true)
                }
                Ok(None) => self.work_on_layer().await,
                Err(error) => Err(error),
            };
            match worked {
                Ok(true) => {}
                Ok(false) => self.wait().await,
                Err(error) => {
                    tracing::error!(
                        error = &error as &dyn std::error::Error,
                        "cannot take a job"
                    );
                    self.wait().await;
                }
            }
        }
    }

    /// Prepares a layer; `false` if none waits.
    async fn work_on_layer(&self) -> Result<bool, StoreError> {
        let claim = self.claim_layer().await?;
        if let Some(claim) = &claim {
            self.prepare_layer(claim).await;
        }
        Ok(claim.is_some())
    }

    async fn wait(&mut self) {
        let _idle = self.library.handover().idle();
        let poll = tokio::time::sleep(self.store.options().poll);
        tokio::select! {
            () = until(&mut self.phase, Phase::Finishing) => {}
            () = self.store.signals().until_queued() => {}
            () = poll => {}
        }
    }

    async fn claim(&self) -> Result<Option<Claim>, StoreError> {
        let terms = LeaseTerms {
            lease: self.store.options().lease,
            max_attempts: self.store.options().max_attempts,
        };
        self.store.claim(&terms).await
    }

    async fn prepare(&self, claim: &Claim) {
        tracing::info!(
            job = claim.fence,
            attempt = claim.attempt,
            "preparing a case"
        );
        self.store.signals().changed(&claim.id);
        let cancelled = self.store.signals().begin(&claim.id);
        let settled = match self.run(claim, &cancelled).await {
            Ok(outcome) => self.settle(claim, outcome).await,
            Err(error) => Err(error),
        };
        if let Err(error) = settled {
            self.retry_later(claim, &error).await;
        }
        self.store.signals().end(&claim.id, &cancelled);
        self.store.signals().changed(&claim.id);
    }

    /// Prepares and renews the lease; nothing is stored yet.
    async fn run(&self, claim: &Claim, cancelled: &Arc<AtomicBool>) -> Result<Outcome, StoreError> {
        let read = self.library.handover().take(&claim.id);
        let source = match &read {
            Some(_) => {
                self.library
                    .source_besides(&claim.id, &claim.sources)
                    .await?
            }
            None => self.library.source(&claim.id, &claim.sources).await?,
        };
        let Some(source) = source else {
            return Ok(Outcome::Refused(Failure::source_damaged()));
        };
        let (progress, seen) = watch::channel(None);
        let mut derived = tokio::task::spawn_blocking({
            let (library, claim) = (self.library.clone(), claim.clone());
            let cancelled = cancelled.clone();
            move || {
                let source = &source;
                let input = Input { source, read };
                derive(&library, &claim, input, &progress, &cancelled)
            }
        });
        let mut heartbeat = tokio::time::interval(self.store.options().heartbeat);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        heartbeat.tick().await;
        let mut phase = self.phase.clone();
        let longest = self.store.options().longest_preparation;
        let mut end = std::pin::pin!(tokio::time::sleep(longest));
        let mut is_too_slow = false;
        loop {
            tokio::select! {
                derived = &mut derived => {
                    return Ok(match is_too_slow {
                        true => Outcome::Refused(too_slow(longest)),
                        false => self.outcome(derived, cancelled),
                    });
                }
                () = &mut end, if !cancelled.load(Ordering::Relaxed) => {
                    is_too_slow = true;
                    cancelled.store(true, Ordering::Relaxed);
                }
                _ = heartbeat.tick() => {
                    let progress = *seen.borrow();
                    if !self.renew(claim, progress).await {
                        cancelled.store(true, Ordering::Relaxed);
                    }
                }
                () = until(&mut phase, Phase::Stopping),
                    if !cancelled.load(Ordering::Relaxed) =>
                {
                    cancelled.store(true, Ordering::Relaxed);
                }
            }
        }
    }

    fn outcome(
        &self,
        derived: Result<Result<Derived, Failure>, JoinError>,
        cancelled: &AtomicBool,
    ) -> Outcome {
        let is_stopping = *self.phase.borrow() == Phase::Stopping;
        match derived {
            _ if is_stopping => Outcome::HandedBack,
            _ if cancelled.load(Ordering::Relaxed) => Outcome::Lost,
            Ok(Ok(derived)) => Outcome::Derived(Box::new(derived)),
            Ok(Err(failure)) => Outcome::Refused(failure),
            Err(_) => Outcome::Refused(crashed()),
        }
    }

    /// `false` if the lease is lost. If the store is unreachable, the next beat tries again.
    async fn renew(&self, claim: &Claim, progress: Option<Progress>) -> bool {
        let renewed = self
            .store
            .renew(claim, self.store.options().lease, progress)
            .await;
        renewed.unwrap_or_else(|error| {
            tracing::warn!(
                job = claim.fence,
                error = &error as &dyn std::error::Error,
                "cannot renew a lease"
            );
            true
        })
    }

    async fn settle(&self, claim: &Claim, outcome: Outcome) -> Result<(), StoreError> {
        match outcome {
            Outcome::Derived(derived) => self.publish(claim, *derived).await,
            Outcome::Refused(failure) => {
                tracing::info!(
                    job = claim.fence,
                    kind = failure.name,
                    "a case cannot be prepared"
                );
                if self.store.fail(claim, &failure).await? {
                    self.store.signals().count(Count::Failed);
                }
                Ok(())
            }
            Outcome::Lost => {
                tracing::info!(job = claim.fence, "a preparation was cancelled");
                Ok(())
            }
            Outcome::HandedBack => {
                let release = Release {
                    after: Duration::ZERO,
                    counts: false,
                };
                self.store.release(claim, release).await?;
                tracing::info!(job = claim.fence, "a preparation was returned to the queue");
                Ok(())
            }
        }
    }

    async fn publish(&self, claim: &Claim, mut derived: Derived) -> Result<(), StoreError> {
        doubt_header(&self.store, &claim.id, &mut derived.facts).await?;
        self.store
            .signals()
            .progress(&claim.id, Some(Progress::at(Stage::Storing)));
        let framed = frame_all(derived.objects).await?;
        // The lease is renewed once more, because writing takes a bounded time.
        self.store
            .renew(
                claim,
                self.store.options().lease,
                Some(Progress::at(Stage::Storing)),
            )
            .await?;
        let published = self
            .store
            .publish(Publisher::Worker(claim), &framed, &derived.facts)
            .await?;
        if published == Published::Done {
            self.store.signals().count(Count::Prepared);
            tracing::info!(job = claim.fence, "a case is ready");
            self.library.ensure_maps(&claim.id);
            // Its layers can be prepared now.
            self.store.signals().queued();
        } else {
            tracing::info!(
                job = claim.fence,
                "a preparation finished after its lease had ended and was discarded"
            );
        }
        Ok(())
    }

    /// The store failed, not the input, so this worker or another one tries the job again.
    async fn retry_later(&self, claim: &Claim, error: &StoreError) {
        tracing::error!(
            job = claim.fence,
            error = error as &dyn std::error::Error,
            "a preparation was interrupted by a failure of the store"
        );
        self.store.signals().count(Count::Retried);
        let release = Release {
            after: self.store.options().retry_after,
            counts: true,
        };
        // If even this fails, the lease ends by itself.
        if let Err(error) = self.store.release(claim, release).await {
            tracing::warn!(
                job = claim.fence,
                error = &error as &dyn std::error::Error,
                "cannot return a lease"
            );
        }
    }
}

/// Prepares on a blocking thread, and reports progress.
fn derive(
    library: &Library,
    claim: &Claim,
    input: Input<'_>,
    progress: &watch::Sender<Option<Progress>>,
    cancelled: &AtomicBool,
) -> Result<Derived, Failure> {
    let observe = |now: Progress| {
        progress.send_replace(Some(now));
        library.store().signals().progress(&claim.id, Some(now));
    };
    library.prepare(input, &claim.parameters, &observe, cancelled)
}

/// The preparation exceeded its time limit.
fn too_slow(longest: Duration) -> Failure {
    let detail = format!(
        "the preparation exceeded the limit of {} seconds; upload a volume with fewer voxels",
        longest.as_secs()
    );
    Failure::unusable("preparation-too-slow", detail)
}

/// The preparation panicked. The same input would cause the same internal error again.
fn crashed() -> Failure {
    Failure::new(
        FailureKind::Internal,
        "preparation-crashed",
        "internal error during the preparation",
    )
}
