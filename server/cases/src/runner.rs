//! The one runner of jobs: it claims them, keeps their leases, ends them in time, and tries them again so many times.
//!
//! Whoever knows how to do a kind of job implements [`Work`] and starts it in a lane of a [`Runner`]. A lane does one job at
//! a time; a process never claims a kind that it does not know.

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
}

/// A job that is being done.
#[derive(Debug)]
pub struct Running {
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
    /// What it needs is not there now: the attempt does not count.
    Waiting(Failure),
}

impl From<StoreError> for Failed {
    fn from(error: StoreError) -> Self {
        if matches!(error, StoreError::SourceMissing) {
            return Self::Waiting(Failure::source_missing());
        }
        tracing::error!(
            error = &error as &dyn std::error::Error,
            "a job was interrupted by a failure of the store"
        );
        // Most messages of the store may contain paths.
        let detail = match error.is_unusable() {
            true => error.to_string(),
            false => "the store failed; the log of the server has the details".to_owned(),
        };
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
    /// Starts lanes on the current runtime. A lane does one job at a time, of its kinds in turn.
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
    pub fn repeat<F: Future<Output = ()> + Send + 'static>(
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
        let mut said = None;
        while *self.phase.borrow() == Phase::Working {
            queued.mark_unchanged();
            match self.claim().await {
                Ok(Some((work, claim))) => {
                    self.conduct(&work, claim).await;
                    continue;
                }
                Ok(None) => said = None,
                // Once, not at each look.
                Err(error) => {
                    let cause = error.cause();
                    if said.as_ref() != Some(&cause) {
                        tracing::error!(%error, cause, "cannot take a job");
                        said = Some(cause);
                    }
                }
            }
            tokio::select! {
                () = until(&mut self.phase, Phase::Finishing) => {}
                // The store holds the sender.
                _ = queued.changed() => {}
                () = tokio::time::sleep(self.store.options().poll) => {}
            }
        }
    }

    /// A job of the first kind that has one; this kind is the last to be asked next time.
    async fn claim(&mut self) -> Result<Option<(Arc<dyn Work>, Claim)>, StoreError> {
        for place in 0..self.works.len() {
            let work = Arc::clone(&self.works[place]);
            work.look(&self.store).await?;
            let claim = self.store.claim(work.kind(), work.terms().max_attempts);
            if let Some(claim) = claim.await? {
                self.works.rotate_left(place + 1);
                return Ok(Some((work, claim)));
            }
        }
        Ok(None)
    }

    /// Does a job and ends it.
    async fn conduct(&self, work: &Arc<dyn Work>, claim: Claim) {
        let (kind, job) = (claim.kind.name(), claim.fence);
        let case = claim.case.map(|case| case.short());
        tracing::info!(
            kind,
            job,
            case = case.as_deref(),
            attempt = claim.attempt,
            "beginning a job"
        );
        let (progress, mut seen) = watch::channel(None);
        let ended = match self.attend(work, &claim, progress, &seen).await {
            AttemptOutcome::Ended(Ok(End::Done)) => self.store.finish(&claim, Ok(())).await,
            AttemptOutcome::Ended(Ok(End::Settled)) => Ok(true),
            AttemptOutcome::Ended(Err(Failed::Forever(failure))) => {
                self.fail(&claim, &failure).await
            }
            AttemptOutcome::Ended(Err(Failed::ForNow(failure))) => {
                self.try_again(&claim, failure, &work.terms()).await
            }
            AttemptOutcome::Ended(Err(Failed::Waiting(failure))) => {
                self.wait(&claim, failure, &work.terms()).await
            }
            AttemptOutcome::Lost => {
                tracing::info!(kind, job, case = case.as_deref(), "a job was cancelled");
                Ok(true)
            }
            AttemptOutcome::Stopped => {
                tracing::info!(
                    kind,
                    job,
                    case = case.as_deref(),
                    "a job was returned to the queue"
                );
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
            Ok(false) => {
                tracing::info!(
                    kind,
                    job,
                    case = case.as_deref(),
                    "a job ended after its lease and was ignored"
                );
            }
            // The lease ends by itself.
            Err(error) => tracing::error!(
                kind,
                job,
                case = case.as_deref(),
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
    ) -> AttemptOutcome {
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
                    return AttemptOutcome::Ended(ended.unwrap_or_else(crashed));
                }
                () = &mut limit => {
                    let failure = too_slow(claim.kind, longest);
                    return AttemptOutcome::Ended(Err(Failed::Forever(failure)));
                }
                _ = heartbeat.tick() => {
                    let progress = seen.borrow().clone();
                    if !self.renew(claim, progress.as_deref()).await {
                        return AttemptOutcome::Lost;
                    }
                }
                () = until(&mut phase, Phase::Stopping) => return AttemptOutcome::Stopped,
            }
        }
    }

    /// `false` if the lease is lost. If the store is unreachable, the next beat tries again.
    async fn renew(&self, claim: &Claim, progress: Option<&str>) -> bool {
        let renewed = self.store.renew(claim, progress).await;
        renewed.unwrap_or_else(|error| {
            tracing::warn!(
                job = claim.fence,
                case = claim.case.map(|case| case.short()),
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
        let case = claim.case.map(|case| case.short());
        tracing::info!(kind, job = claim.fence, case, reason, "a job failed");
        self.count(claim.kind, Count::Failed);
        self.store.finish(claim, Err(failure)).await
    }

    /// Puts a job off for as long again as it has waited, within limits.
    async fn wait(
        &self,
        claim: &Claim,
        failure: Failure,
        terms: &Terms,
    ) -> Result<bool, StoreError> {
        let (kind, reason) = (claim.kind.name(), failure.name.as_str());
        let case = claim.case.map(|case| case.short());
        tracing::warn!(kind, job = claim.fence, case, reason, "a job waits");
        let release = Release {
            after: claim.age.min(LONGEST_WAIT).max(terms.retry_after),
            counts: false,
            failure: Some(failure),
        };
        self.store.release(claim, &release).await
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
        let case = claim.case.map(|case| case.short());
        tracing::warn!(
            kind,
            job = claim.fence,
            case,
            reason,
            "a job will be tried again"
        );
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
#[cfg(any(test, feature = "testing"))]
pub async fn once(store: &Store, work: Arc<dyn Work>) -> bool {
    let phase = watch::Sender::new(Phase::Working);
    let mut lane = Lane {
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
enum AttemptOutcome {
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
    use std::sync::atomic::AtomicUsize;

    use case::JobState;
    use storage::tables::{jobs, new_id};
    use storage::{Job, NewJob};

    use super::*;

    const KIND: JobKind = JobKind::new("stub", "work");
    const OTHER: JobKind = JobKind::new("other-stub", "work");

    const TERMS: Terms = Terms {
        max_attempts: 3,
        retry_after: Duration::from_secs(5),
        longest: Duration::from_secs(60),
    };

    /// Work that does what the payload of its job says.
    struct Stub {
        terms: Terms,
        at_work: AtomicUsize,
        most_at_work: AtomicUsize,
    }

    impl Stub {
        fn on(terms: Terms) -> Arc<Self> {
            Arc::new(Self {
                terms,
                at_work: AtomicUsize::new(0),
                most_at_work: AtomicUsize::new(0),
            })
        }
    }

    fn failure(name: &str) -> Failure {
        Failure::new(FailureKind::Internal, name, "a detail")
    }

    struct Shared(JobKind, Arc<Stub>);

    #[async_trait]
    impl Work for Shared {
        fn kind(&self) -> JobKind {
            self.0
        }

        fn terms(&self) -> Terms {
            self.1.terms
        }

        async fn run(&self, job: &Running) -> Result<End, Failed> {
            match job.claim.payload.as_str() {
                "later" => Err(Failed::ForNow(failure("later"))),
                "never" => Err(Failed::Forever(failure("never"))),
                "panic" => panic!("a fault of the program, on purpose"),
                "thread" => {
                    let (stub, report) = (Arc::clone(&self.1), job.reporter());
                    let cancelled = job.is_cancelled();
                    let on_a_thread = tokio::task::spawn_blocking(move || {
                        let now = stub.at_work.fetch_add(1, Ordering::SeqCst) + 1;
                        stub.most_at_work.fetch_max(now, Ordering::SeqCst);
                        report("begun");
                        while !cancelled.load(Ordering::Relaxed) {
                            std::thread::yield_now();
                        }
                        // A step that cannot be interrupted.
                        std::thread::sleep(Duration::from_millis(30));
                        stub.at_work.fetch_sub(1, Ordering::SeqCst);
                    });
                    on_a_thread.await.map_err(StoreError::from)?;
                    Ok(End::Done)
                }
                _ => Ok(End::Done),
            }
        }
    }

    async fn a_store() -> Store {
        Store::in_memory(crate::testing::options()).await.unwrap()
    }

    async fn queue(store: &Store, payload: &str) -> String {
        queue_of(KIND, store, payload).await
    }

    async fn queue_of(kind: JobKind, store: &Store, payload: &str) -> String {
        let new = NewJob {
            payload: payload.to_owned(),
            ..NewJob::new(kind, new_id())
        };
        store.enqueue(&new).await.unwrap().unwrap().id
    }

    async fn job(store: &Store, id: &str) -> Job {
        jobs::one(&mut store.connect().await.unwrap(), id)
            .await
            .unwrap()
            .unwrap()
    }

    fn work(stub: &Arc<Stub>) -> Arc<dyn Work> {
        Arc::new(Shared(KIND, Arc::clone(stub)))
    }

    #[tokio::test]
    async fn a_lane_takes_its_kinds_in_turn() {
        let (store, stub) = (a_store().await, Stub::on(TERMS));
        for _ in 0..3 {
            queue(&store, "").await;
        }
        queue_of(OTHER, &store, "").await;
        let mut lane = Lane {
            store: store.clone(),
            works: vec![work(&stub), Arc::new(Shared(OTHER, stub))],
            phase: watch::Sender::new(Phase::Working).subscribe(),
        };
        let mut kinds = Vec::new();
        while let Some((_, claim)) = lane.claim().await.unwrap() {
            kinds.push(claim.kind.name());
        }
        assert_eq!(kinds, ["stub", "other-stub", "stub", "stub"]);
    }

    #[test]
    fn each_wait_is_twice_as_long_up_to_a_limit() {
        let waits = [1, 2, 3, 7, 100].map(|attempt| TERMS.wait_after(attempt).as_secs());
        assert_eq!(waits, [5, 10, 20, 300, 300]);
    }

    #[tokio::test]
    async fn a_job_is_tried_again_after_a_while_and_fails_with_its_last_reason() {
        let (store, stub) = (a_store().await, Stub::on(TERMS));
        let id = queue(&store, "later").await;
        for wait in [5, 10] {
            assert!(once(&store, work(&stub)).await);
            store.pass_time(Duration::from_secs(wait - 1));
            assert!(!once(&store, work(&stub)).await, "{wait} s are not over");
            let waiting = job(&store, &id).await;
            assert_eq!(waiting.state, JobState::Queued);
            assert_eq!(waiting.failure, Some(failure("later")));
            store.pass_time(Duration::from_secs(1));
        }
        assert!(once(&store, work(&stub)).await);
        let failed = job(&store, &id).await;
        assert_eq!((failed.state, failed.attempts), (JobState::Failed, 3));
        let failure = failed.failure.unwrap();
        assert_eq!(failure.name, "later");
        assert_eq!(failure.detail, "failed after 3 attempts: a detail");
        store.pass_time(Duration::from_secs(3600));
        assert!(!once(&store, work(&stub)).await);
    }

    #[tokio::test]
    async fn what_would_fail_again_and_what_panics_is_tried_once() {
        let (store, stub) = (a_store().await, Stub::on(TERMS));
        for (payload, name) in [("never", "never"), ("panic", "work-crashed")] {
            let id = queue(&store, payload).await;
            assert!(once(&store, work(&stub)).await);
            let failed = job(&store, &id).await;
            assert_eq!((failed.state, failed.attempts), (JobState::Failed, 1));
            assert_eq!(failed.failure.unwrap().name, name);
        }
        let id = queue(&store, "nothing").await;
        assert!(once(&store, work(&stub)).await);
        assert_eq!(job(&store, &id).await.state, JobState::Done);
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_lane_begins_nothing_before_work_that_took_too_long_has_stopped() {
        let terms = Terms {
            longest: Duration::from_millis(5),
            ..TERMS
        };
        let (store, stub) = (a_store().await, Stub::on(terms));
        let mut ids = Vec::new();
        for _ in 0..4 {
            ids.push(queue(&store, "thread").await);
        }
        let runner = Runner::start(&store, vec![vec![work(&stub)]]);
        for id in &ids {
            while !job(&store, id).await.state.has_ended() {
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
            let failure = job(&store, id).await.failure.unwrap();
            assert_eq!(failure.name, "work-too-slow");
        }
        runner.shut_down(Duration::from_secs(10)).await;
        assert_eq!(stub.most_at_work.load(Ordering::SeqCst), 1);
        assert_eq!(stub.at_work.load(Ordering::SeqCst), 0);
    }

    #[tokio::test]
    async fn a_runner_that_must_stop_returns_its_job_and_the_attempt_does_not_count() {
        let (store, stub) = (a_store().await, Stub::on(TERMS));
        let id = queue(&store, "thread").await;
        let runner = Runner::start(&store, vec![vec![work(&stub)]]);
        while stub.at_work.load(Ordering::SeqCst) == 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        runner.shut_down(Duration::ZERO).await;
        let returned = job(&store, &id).await;
        assert_eq!((returned.state, returned.attempts), (JobState::Queued, 0));
        assert_eq!(stub.at_work.load(Ordering::SeqCst), 0);
    }
}
