//! The one runner of jobs: it claims them, keeps their leases, ends them in time, and tries them again so many times.
//!
//! Whoever knows how to do a kind of job implements [`Work`] and starts it in a lane of a [`Runner`]. A lane does one job at
//! a time; a process never claims a kind that it does not know.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use case::{Failure, FailureKind, JobKind, STORE_FAILED};
use storage::{Claim, Count, Release, Store, StoreError};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;

/// The longest time to wait before another attempt.
const LONGEST_WAIT: Duration = Duration::from_secs(300);

/// How often, how soon and for how long a kind of job is tried.
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// After this many attempts the job fails.
    pub max_attempts: u32,
    /// How long to wait before the second attempt; each time twice as long.
    pub retry_after: Duration,
    /// The time limit of an attempt; then the job fails.
    pub longest: Duration,
}

impl Terms {
    /// The time to wait after an attempt, counted from 1.
    fn wait_after(&self, attempt: u32) -> Duration {
        let doublings = attempt.saturating_sub(1).min(16);
        let wait = self.retry_after.saturating_mul(1 << doublings);
        wait.min(LONGEST_WAIT.max(self.retry_after))
    }
}

/// How a kind of job is done.
#[async_trait]
pub trait Work: Send + Sync + 'static {
    /// The kind.
    fn kind(&self) -> JobKind;

    /// How often, how soon and for how long.
    fn terms(&self) -> Terms;

    /// Does a job. It is dropped when the job is cancelled, has taken too long, or the process stops; what goes on then
    /// on a blocking thread looks at [`Running::is_cancelled`].
    async fn run(&self, job: &Running) -> Result<End, Failed>;

    /// Looks for what is to be done, before each look for a job of this kind.
    async fn look(&self, _store: &Store) -> Result<(), StoreError> {
        Ok(())
    }

    /// Told when there is nothing to do; what it returns is kept until there may be.
    fn rest(&self) -> Option<Box<dyn Any + Send>> {
        None
    }
}

/// A job that is being done.
#[derive(Debug)]
pub struct Running {
    /// The job.
    pub claim: Claim,
    is_cancelled: Arc<AtomicBool>,
    progress: watch::Sender<Option<String>>,
}

impl Running {
    /// Notes how far it is; the row has it after the next heartbeat.
    pub fn report(&self, progress: &impl serde::Serialize) {
        self.reporter()(progress);
    }

    /// As [`Running::report`], for another thread.
    pub fn reporter<T: serde::Serialize + ?Sized>(&self) -> impl Fn(&T) + Send + use<T> {
        let sender = self.progress.clone();
        move |progress| drop(sender.send_replace(serde_json::to_string(progress).ok()))
    }

    /// Raised when the work is not wanted any more.
    pub fn is_cancelled(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.is_cancelled)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

/// The end of an attempt that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The job is done.
    Done,
    /// The work has ended the job itself, together with its result, or the lease is lost.
    Settled,
}

/// The end of an attempt that failed.
#[derive(Debug)]
pub enum Failed {
    /// It would fail in the same way the next time.
    Forever(Failure),
    /// Another attempt may succeed.
    ForNow(Failure),
}

impl From<StoreError> for Failed {
    fn from(error: StoreError) -> Self {
        tracing::error!(
            error = &error as &dyn std::error::Error,
            "a job was interrupted by a failure of the store"
        );
        // Messages of the store may contain paths.
        let detail = "the store failed; the log of the server has the details";
        Self::ForNow(Failure::new(FailureKind::Internal, STORE_FAILED, detail))
    }
}

/// The phases of a runner, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Working,
    /// Finish running work, and begin none.
    Finishing,
    /// Stop, and return running jobs.
    Stopping,
}

/// A running runner. Dropping it stops it; others take its jobs after the leases end.
#[derive(Debug)]
pub struct Runner {
    phase: watch::Sender<Phase>,
    tasks: JoinSet<()>,
}

impl Runner {
    /// Starts lanes on the current runtime. A lane does one job at a time, and prefers the kinds that come first.
    pub fn start(store: &Store, lanes: Vec<Vec<Arc<dyn Work>>>) -> Self {
        let phase = watch::Sender::new(Phase::Working);
        let mut tasks = JoinSet::new();
        for works in lanes {
            let lane = Lane {
                store: store.clone(),
                works,
                phase: phase.subscribe(),
            };
            tasks.spawn(lane.work());
        }
        Self { phase, tasks }
    }

    /// Does something now, and then each time the interval has passed.
    pub(crate) fn repeat<F: Future<Output = ()> + Send + 'static>(
        &mut self,
        every: Duration,
        act: impl Fn() -> F + Send + Sync + 'static,
    ) {
        let mut phase = self.phase.subscribe();
        self.tasks.spawn(async move {
            loop {
                act().await;
                tokio::select! {
                    () = until(&mut phase, Phase::Finishing) => return,
                    () = tokio::time::sleep(every) => {}
                }
            }
        });
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

/// Waits for a phase, or for the end of the runner.
async fn until(phase: &mut watch::Receiver<Phase>, reached: Phase) {
    // Holding the value would hold a lock.
    drop(phase.wait_for(|&phase| phase >= reached).await);
}

struct Lane {
    store: Store,
    works: Vec<Arc<dyn Work>>,
    phase: watch::Receiver<Phase>,
}

impl Lane {
    async fn work(mut self) {
        let mut queued = self.store.signals().watch_queue();
        while *self.phase.borrow() == Phase::Working {
            queued.mark_unchanged();
            match self.claim().await {
                Ok(Some((work, claim))) => {
                    self.conduct(&work, claim).await;
                    continue;
                }
                Ok(None) => {}
                Err(error) => tracing::error!(
                    error = &error as &dyn std::error::Error,
                    "cannot take a job"
                ),
            }
            let _resting: Vec<_> = self.works.iter().map(|work| work.rest()).collect();
            tokio::select! {
                () = until(&mut self.phase, Phase::Finishing) => {}
                // The store holds the sender.
                _ = queued.changed() => {}
                () = tokio::time::sleep(self.store.options().poll) => {}
            }
        }
    }

    async fn claim(&self) -> Result<Option<(Arc<dyn Work>, Claim)>, StoreError> {
        for work in &self.works {
            work.look(&self.store).await?;
            let claim = self.store.claim(work.kind(), work.terms().max_attempts);
            if let Some(claim) = claim.await? {
                return Ok(Some((Arc::clone(work), claim)));
            }
        }
        Ok(None)
    }

    /// Does a job and ends it.
    async fn conduct(&self, work: &Arc<dyn Work>, claim: Claim) {
        let (kind, job) = (claim.kind.name(), claim.fence);
        tracing::info!(kind, job, attempt = claim.attempt, "beginning a job");
        let (progress, mut seen) = watch::channel(None);
        let ended = match self.attend(work, &claim, progress, &seen).await {
            Attended::Ended(Ok(End::Done)) => self.store.finish(&claim).await,
            Attended::Ended(Ok(End::Settled)) => Ok(true),
            Attended::Ended(Err(Failed::Forever(failure))) => self.fail(&claim, &failure).await,
            Attended::Ended(Err(Failed::ForNow(failure))) => {
                self.try_again(&claim, failure, &work.terms()).await
            }
            Attended::Lost => {
                tracing::info!(kind, job, "a job was cancelled");
                Ok(true)
            }
            Attended::Stopped => {
                tracing::info!(kind, job, "a job was returned to the queue");
                let release = Release {
                    after: Duration::ZERO,
                    counts: false,
                    failure: None,
                };
                self.store.release(&claim, &release).await
            }
        };
        match ended {
            Ok(true) => {}
            Ok(false) => tracing::info!(kind, job, "a job ended after its lease and was ignored"),
            // The lease ends by itself.
            Err(error) => tracing::error!(
                kind,
                job,
                error = &error as &dyn std::error::Error,
                "cannot end a job"
            ),
        }
        // Work that was dropped may go on for a moment on a blocking thread, which still holds the sender.
        while seen.changed().await.is_ok() {}
        if let Some(case) = &claim.case {
            self.store.signals().progress(case, None);
            self.store.signals().changed(case);
        }
    }

    /// Runs the work in a task of its own, so that a panic ends the job and not the lane, and renews the lease.
    async fn attend(
        &self,
        work: &Arc<dyn Work>,
        claim: &Claim,
        progress: watch::Sender<Option<String>>,
        seen: &watch::Receiver<Option<String>>,
    ) -> Attended {
        let job = Running {
            claim: claim.clone(),
            is_cancelled: Arc::default(),
            progress,
        };
        // Dropping the set ends the task.
        let mut running = JoinSet::new();
        let work = Arc::clone(work);
        let longest = work.terms().longest;
        running.spawn(async move { work.run(&job).await });
        let mut heartbeat = tokio::time::interval(self.store.options().heartbeat);
        heartbeat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        heartbeat.tick().await;
        let mut phase = self.phase.clone();
        let mut limit = std::pin::pin!(tokio::time::sleep(longest));
        loop {
            tokio::select! {
                ended = running.join_next() => {
                    let ended = ended.and_then(Result::ok);
                    let crashed = || Err(Failed::Forever(crashed(claim.kind)));
                    return Attended::Ended(ended.unwrap_or_else(crashed));
                }
                () = &mut limit => {
                    let failure = too_slow(claim.kind, longest);
                    return Attended::Ended(Err(Failed::Forever(failure)));
                }
                _ = heartbeat.tick() => {
                    let progress = seen.borrow().clone();
                    if !self.renew(claim, progress.as_deref()).await {
                        return Attended::Lost;
                    }
                }
                () = until(&mut phase, Phase::Stopping) => return Attended::Stopped,
            }
        }
    }

    /// `false` if the lease is lost. If the store is unreachable, the next beat tries again.
    async fn renew(&self, claim: &Claim, progress: Option<&str>) -> bool {
        let renewed = self.store.renew(claim, progress).await;
        renewed.unwrap_or_else(|error| {
            tracing::warn!(
                job = claim.fence,
                error = &error as &dyn std::error::Error,
                "cannot renew a lease"
            );
            true
        })
    }

    /// Counts the ends of preparations; those of all kinds are counted by the rows.
    fn count(&self, kind: JobKind, what: Count) {
        if matches!(kind, JobKind::PREPARE | JobKind::LAYER) {
            self.store.signals().count(what);
        }
    }

    async fn fail(&self, claim: &Claim, failure: &Failure) -> Result<bool, StoreError> {
        let (kind, reason) = (claim.kind.name(), failure.name.as_str());
        tracing::info!(kind, job = claim.fence, reason, "a job failed");
        self.count(claim.kind, Count::Failed);
        self.store.fail(claim, failure).await
    }

    async fn try_again(
        &self,
        claim: &Claim,
        failure: Failure,
        terms: &Terms,
    ) -> Result<bool, StoreError> {
        if claim.attempt >= terms.max_attempts {
            let failure = Failure::after_attempts(claim.kind, claim.attempt, Some(failure));
            return self.fail(claim, &failure).await;
        }
        let (kind, reason) = (claim.kind.name(), failure.name.as_str());
        tracing::warn!(kind, job = claim.fence, reason, "a job will be tried again");
        self.count(claim.kind, Count::Retried);
        let release = Release {
            after: terms.wait_after(claim.attempt),
            counts: true,
            failure: Some(failure),
        };
        self.store.release(claim, &release).await
    }
}

/// Does one job of a kind; `false` if there is none.
#[cfg(test)]
pub(crate) async fn once(store: &Store, work: Arc<dyn Work>) -> bool {
    let phase = watch::Sender::new(Phase::Working);
    let lane = Lane {
        store: store.clone(),
        works: vec![work],
        phase: phase.subscribe(),
    };
    let claimed = lane.claim().await.unwrap();
    let is_any = claimed.is_some();
    if let Some((work, claim)) = claimed {
        lane.conduct(&work, claim).await;
    }
    is_any
}

/// How an attempt ended.
enum Attended {
    Ended(Result<End, Failed>),
    /// What it was about was deleted, or another process has the lease.
    Lost,
    /// The process must stop.
    Stopped,
}

/// The work exceeded its time limit.
fn too_slow(kind: JobKind, longest: Duration) -> Failure {
    let (noun, seconds) = (kind.noun(), longest.as_secs());
    let remedy = match noun == JobKind::PREPARE.noun() {
        true => "; send an input with fewer voxels",
        false => "",
    };
    let detail = format!("the {noun} exceeded the limit of {seconds} seconds{remedy}");
    Failure::unusable(&format!("{noun}-too-slow"), detail)
}

/// The work panicked. The same input would cause the same internal error again.
fn crashed(kind: JobKind) -> Failure {
    let noun = kind.noun();
    Failure::new(
        FailureKind::Internal,
        &format!("{noun}-crashed"),
        format!("internal error during the {noun}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_wait_is_twice_as_long_up_to_a_limit() {
        let terms = Terms {
            max_attempts: 8,
            retry_after: Duration::from_secs(5),
            longest: Duration::from_secs(1),
        };
        let waits = [1, 2, 3, 7, 100].map(|attempt| terms.wait_after(attempt).as_secs());
        assert_eq!(waits, [5, 10, 20, 300, 300]);
    }
}
