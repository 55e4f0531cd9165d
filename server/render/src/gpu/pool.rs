//! Threads with a device each, behind a bounded queue.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::mpsc::{self, Receiver, Sender, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::thread::JoinHandle;

use futures_channel::oneshot;

use super::adapter::Adapter;
#[cfg(any(test, feature = "faults"))]
use super::fault::Fault;
use super::renderer::GpuLimits;
use super::worker::GpuWorker;
use super::{AdapterSummary, GpuError, GpuJob};
use crate::{Hits, RenderedFrame};

/// Limits on threads, queue and memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuOptions {
    /// Threads, each with a device and textures of its own: at least 1.
    pub threads: usize,
    /// Pictures that may wait: at least 1.
    pub queue: usize,
    /// Bytes of the textures of cases on each device.
    pub case_bytes: u64,
    /// The longest side of a 3-D texture, if it must be less than the limit of the adapter.
    pub max_side_3d: Option<u32>,
}

impl Default for GpuOptions {
    /// One thread, 32 waiting pictures, 1 GiB of textures, the adapter's own limit.
    fn default() -> Self {
        Self {
            threads: 1,
            queue: 32,
            case_bytes: 1 << 30,
            max_side_3d: None,
        }
    }
}

/// Draws pictures on graphics devices. Dropping it waits for running work.
#[derive(Debug)]
pub struct GpuPool {
    adapter: AdapterSummary,
    tasks: Option<SyncSender<Task>>,
    threads: Vec<JoinHandle<()>>,
}

type Reply<T> = oneshot::Sender<Result<T, GpuError>>;

/// A command for a thread.
enum Task {
    Frame(GpuJob, Reply<RenderedFrame>),
    Hits(GpuJob, Reply<Hits>),
    #[cfg(any(test, feature = "faults"))]
    Break(Fault),
}

/// The future of a queued picture. If it is dropped before its turn, the picture is not drawn.
#[derive(Debug)]
pub struct GpuTicket<T>(oneshot::Receiver<Result<T, GpuError>>);

impl<T> GpuTicket<T> {
    /// Waits for the picture on this thread.
    ///
    /// # Errors
    /// The error of the device's thread.
    pub fn wait(self) -> Result<T, GpuError> {
        pollster::block_on(self)
    }
}

impl<T> Future for GpuTicket<T> {
    type Output = Result<T, GpuError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let answer = Pin::new(&mut self.0).poll(context);
        answer.map(|answer| answer.unwrap_or(Err(GpuError::Closed)))
    }
}

impl GpuPool {
    /// Finds an adapter and opens a device for each thread.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] on a machine without a driver, [`GpuError::NoDevice`] with one that does not work.
    pub fn start(options: GpuOptions) -> Result<Self, GpuError> {
        let adapter = Adapter::find()?;
        let (tasks, queue) = mpsc::sync_channel(options.queue.max(1));
        let queue = Arc::new(Mutex::new(queue));
        let (opened, outcomes) = mpsc::channel();
        let limits = GpuLimits {
            case_bytes: options.case_bytes,
            max_side_3d: options.max_side_3d,
        };
        let mut pool = Self {
            adapter: adapter.summary(),
            tasks: Some(tasks),
            threads: Vec::new(),
        };
        for _ in 0..options.threads.max(1) {
            let (adapter, queue, opened) = (adapter.clone(), Arc::clone(&queue), opened.clone());
            let thread = std::thread::Builder::new()
                .name("graphics".to_owned())
                .spawn(move || work(adapter, limits, &queue, &opened));
            pool.threads
                .push(thread.map_err(|error| GpuError::NoDevice {
                    reason: error.to_string(),
                })?);
        }
        drop(opened);
        for _ in 0..pool.threads.len() {
            outcomes.recv().unwrap_or(Err(GpuError::Closed))?;
        }
        Ok(pool)
    }

    /// The adapter.
    pub fn adapter(&self) -> &AdapterSummary {
        &self.adapter
    }

    /// Draws a picture and waits for it.
    ///
    /// # Errors
    /// [`GpuError::Busy`] at once if the queue is full; otherwise the error of the device.
    pub fn draw(&self, job: GpuJob) -> Result<RenderedFrame, GpuError> {
        self.begin_draw(job)?.wait()
    }

    /// Finds the point that each pixel of [`GpuPool::draw`] shows, and waits for it. The edges of a mesh are not
    /// antialiased.
    ///
    /// # Errors
    /// As [`GpuPool::draw`].
    pub fn hits(&self, job: GpuJob) -> Result<Hits, GpuError> {
        let (reply, answer) = oneshot::channel();
        self.enqueue(Task::Hits(job, reply))?;
        GpuTicket(answer).wait()
    }

    /// Queues a picture without waiting.
    ///
    /// # Errors
    /// [`GpuError::Busy`] if too many pictures wait.
    pub fn begin_draw(&self, job: GpuJob) -> Result<GpuTicket<RenderedFrame>, GpuError> {
        let (reply, answer) = oneshot::channel();
        self.enqueue(Task::Frame(job, reply))?;
        Ok(GpuTicket(answer))
    }

    /// Simulates a fault, for tests: the next picture encounters it.
    ///
    /// # Errors
    /// [`GpuError::Busy`] if too many pictures wait.
    #[cfg(any(test, feature = "faults"))]
    pub fn break_device(&self, fault: Fault) -> Result<(), GpuError> {
        self.enqueue(Task::Break(fault))
    }

    fn enqueue(&self, task: Task) -> Result<(), GpuError> {
        let tasks = self.tasks.as_ref().ok_or(GpuError::Closed)?;
        tasks.try_send(task).map_err(|error| match error {
            TrySendError::Full(_) => GpuError::Busy,
            TrySendError::Disconnected(_) => GpuError::Closed,
        })
    }
}

impl Drop for GpuPool {
    fn drop(&mut self) {
        // The threads end when the queue is closed.
        self.tasks = None;
        for thread in self.threads.drain(..) {
            // A thread that panicked has ended.
            let _ = thread.join();
        }
    }
}

/// Runs a thread: opens its device, reports whether that succeeded, and draws until the queue is closed.
fn work(
    adapter: Adapter,
    limits: GpuLimits,
    queue: &Mutex<Receiver<Task>>,
    opened: &Sender<Result<(), GpuError>>,
) {
    let mut worker = match GpuWorker::new(adapter, limits) {
        Ok(worker) => worker,
        Err(error) => {
            // Nobody receives this if another thread has failed.
            let _ = opened.send(Err(error));
            return;
        }
    };
    let _ = opened.send(Ok(()));
    loop {
        let next = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
        match next {
            Ok(Task::Frame(job, reply)) => {
                answer(&mut worker, reply, |worker| {
                    worker.attempt(|renderer| renderer.draw(&job))
                });
            }
            Ok(Task::Hits(job, reply)) => {
                answer(&mut worker, reply, |worker| {
                    worker.attempt(|renderer| renderer.hits(&job))
                });
            }
            #[cfg(any(test, feature = "faults"))]
            Ok(Task::Break(fault)) => worker.meet(fault),
            Err(_) => return,
        }
    }
}

/// Draws a picture if its ticket still exists. A panic costs the device, not the thread.
fn answer<T>(
    worker: &mut GpuWorker,
    reply: Reply<T>,
    draw: impl FnOnce(&mut GpuWorker) -> Result<T, GpuError>,
) {
    if reply.is_canceled() {
        return;
    }
    let result = catch_unwind(AssertUnwindSafe(|| draw(worker))).unwrap_or_else(|_| {
        worker.give_up();
        Err(GpuError::Failed {
            reason: "its thread panicked".to_owned(),
        })
    });
    // The ticket may have been dropped meanwhile.
    let _ = reply.send(result);
}
