//! Threads for work that keeps a processor busy, behind a queue that does not grow without bound.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use render::Wanted;
use tokio::sync::oneshot;

use crate::error::Error;

/// Worker threads and the queue before them. Cheap to clone; the threads end with the last clone.
///
/// Work whose request has gone away is dropped from the queue, not run.
#[derive(Debug, Clone)]
pub struct RenderPool {
    shared: Arc<Shared>,
    // Held for its Drop alone, by every clone.
    _closer: Arc<Closer>,
}

#[derive(Debug)]
struct Shared {
    /// A std mutex is enough: it is held for a push or a pop.
    queue: Mutex<Queue>,
    work_came: Condvar,
    capacity: usize,
}

#[derive(Default)]
struct Queue {
    waiting: VecDeque<Box<dyn Work>>,
    closed: bool,
}

impl std::fmt::Debug for Queue {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Queue({} waiting)", self.waiting.len())
    }
}

#[derive(Debug)]
struct Closer(Arc<Shared>);

impl Drop for Closer {
    fn drop(&mut self) {
        self.0.lock().closed = true;
        self.0.work_came.notify_all();
    }
}

/// Something to do for a client that may go away.
trait Work: Send {
    fn is_wanted(&self) -> bool;
    fn run(self: Box<Self>);
}

struct Task<F, T> {
    work: F,
    answer: oneshot::Sender<thread::Result<T>>,
}

impl<F, T> Work for Task<F, T>
where
    F: FnOnce(&Wanted<'_>) -> T + Send,
    T: Send,
{
    fn is_wanted(&self) -> bool {
        !self.answer.is_closed()
    }

    fn run(self: Box<Self>) {
        let Self { work, answer } = *self;
        let is_wanted = || !answer.is_closed();
        // What the closure holds is dropped with it, so nothing half-changed is seen afterwards.
        let result = catch_unwind(AssertUnwindSafe(|| work(&is_wanted)));
        // The client may have gone meanwhile: then nobody wants the result.
        drop(answer.send(result));
    }
}

impl RenderPool {
    /// Starts `threads` workers behind a queue of at most `capacity` pieces of work.
    ///
    /// # Errors
    /// When the system gives no more threads.
    pub fn start(threads: usize, capacity: usize) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            queue: Mutex::default(),
            work_came: Condvar::new(),
            capacity,
        });
        let closer = Arc::new(Closer(Arc::clone(&shared)));
        for number in 0..threads {
            let shared = Arc::clone(&shared);
            thread::Builder::new()
                .name(format!("render-{number}"))
                .spawn(move || shared.work())?;
        }
        Ok(Self {
            shared,
            _closer: closer,
        })
    }

    /// Runs `work` on a worker thread. Dropping the future before its turn cancels it.
    ///
    /// # Errors
    /// [`Error::Busy`] when the queue is full, [`Error::Internal`] when the work panics.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Error> {
        self.run_while(|_| work()).await
    }

    /// As [`RenderPool::run`], for work that asks now and then whether it is still wanted: not once the future is dropped.
    ///
    /// # Errors
    /// As [`RenderPool::run`].
    pub async fn run_while<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Wanted<'_>) -> T + Send + 'static,
    ) -> Result<T, Error> {
        let (answer, result) = oneshot::channel();
        self.shared.push(Box::new(Task { work, answer }))?;
        match result.await {
            Ok(Ok(value)) => Ok(value),
            Ok(Err(_panic)) => Err(Error::Internal),
            Err(_closed) => Err(Error::Unavailable),
        }
    }

    /// Pieces of work that wait.
    pub fn waiting(&self) -> usize {
        self.shared.lock().waiting.len()
    }
}

impl Shared {
    /// No work runs under the lock, so a poisoned one holds a sound queue.
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, work: Box<dyn Work>) -> Result<(), Error> {
        let mut queue = self.lock();
        if queue.waiting.len() >= self.capacity {
            queue.waiting.retain(|work| work.is_wanted());
        }
        if queue.waiting.len() >= self.capacity {
            return Err(Error::Busy);
        }
        queue.waiting.push_back(work);
        drop(queue);
        self.work_came.notify_one();
        Ok(())
    }

    fn work(&self) {
        while let Some(work) = self.next() {
            if work.is_wanted() {
                work.run();
            }
        }
    }

    /// The next piece of work; `None` once the pool is closed.
    fn next(&self) -> Option<Box<dyn Work>> {
        let mut queue = self.lock();
        loop {
            if queue.closed {
                return None;
            }
            if let Some(work) = queue.waiting.pop_front() {
                return Some(work);
            }
            queue = self
                .work_came
                .wait(queue)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    use super::*;

    /// A pool whose only worker waits until the sender is dropped.
    async fn held(capacity: usize) -> (RenderPool, mpsc::Sender<()>) {
        let pool = RenderPool::start(1, capacity).unwrap();
        let (release, held) = mpsc::channel::<()>();
        let (running, is_running) = oneshot::channel();
        let busy = pool.clone();
        tokio::spawn(async move {
            busy.run(move || {
                running.send(()).unwrap();
                held.recv().unwrap_err();
            })
            .await
        });
        is_running.await.unwrap();
        (pool, release)
    }

    async fn until_waiting(pool: &RenderPool, count: usize) {
        while pool.waiting() != count {
            tokio::task::yield_now().await;
        }
    }

    #[tokio::test]
    async fn work_gives_its_value() {
        let pool = RenderPool::start(2, 8).unwrap();
        assert_eq!(pool.run(|| 6 * 7).await.unwrap(), 42);
    }

    #[tokio::test]
    async fn a_full_queue_refuses() {
        let (pool, release) = held(1).await;
        let waiting = tokio::spawn({
            let pool = pool.clone();
            async move { pool.run(|| 1).await }
        });
        until_waiting(&pool, 1).await;
        assert!(matches!(pool.run(|| 2).await, Err(Error::Busy)));
        drop(release);
        assert_eq!(waiting.await.unwrap().unwrap(), 1);
    }

    #[tokio::test]
    async fn work_of_a_client_that_went_away_is_not_run_and_makes_room() {
        let (pool, release) = held(1).await;
        let runs = Arc::new(AtomicUsize::new(0));
        let count = |runs: &Arc<AtomicUsize>| {
            let runs = Arc::clone(runs);
            move || runs.fetch_add(1, Ordering::SeqCst)
        };
        let gone = tokio::spawn({
            let (pool, work) = (pool.clone(), count(&runs));
            async move { pool.run(work).await }
        });
        until_waiting(&pool, 1).await;
        gone.abort();
        assert!(gone.await.unwrap_err().is_cancelled());
        let kept = tokio::spawn({
            let (pool, work) = (pool.clone(), count(&runs));
            async move { pool.run(work).await }
        });
        until_waiting(&pool, 1).await;
        drop(release);
        kept.await.unwrap().unwrap();
        assert_eq!(runs.load(Ordering::SeqCst), 1);
    }

    #[tokio::test]
    async fn work_that_runs_learns_that_its_client_went_away() {
        let pool = RenderPool::start(1, 8).unwrap();
        let (begun, has_begun) = oneshot::channel();
        let (left, learned) = oneshot::channel();
        let gone = tokio::spawn({
            let pool = pool.clone();
            async move {
                pool.run_while(move |is_wanted| {
                    begun.send(is_wanted()).unwrap();
                    while is_wanted() {
                        thread::yield_now();
                    }
                    left.send(()).unwrap();
                })
                .await
            }
        });
        assert!(has_begun.await.unwrap());
        gone.abort();
        learned.await.unwrap();
    }

    #[tokio::test]
    async fn a_panic_is_an_error_and_the_worker_goes_on() {
        let pool = RenderPool::start(1, 8).unwrap();
        let panicked = pool.run(|| panic!("on purpose")).await;
        assert!(matches!(panicked, Err(Error::Internal)));
        assert_eq!(pool.run(|| 1).await.unwrap(), 1);
    }
}
