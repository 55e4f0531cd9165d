//! Write timeouts: end connections whose client receives nothing for a while, or takes too long for an answer.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep};

/// When the client must have received the answer of a connection; none while there is none, or if it has no end. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub(crate) struct AnswerDeadline(Arc<Mutex<Option<Instant>>>);

impl AnswerDeadline {
    pub(crate) fn set(&self, deadline: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = deadline;
    }

    fn is_over(&self) -> bool {
        let deadline = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        deadline.is_some_and(|deadline| deadline <= Instant::now())
    }
}

/// A stream that fails to write if its client receives nothing for a while, or after a deadline.
///
/// Otherwise, a client that requests a large body and does not read it would hold its connection for ever.
#[derive(Debug)]
pub(crate) struct WriteTimeout<S> {
    stream: S,
    idle: Duration,
    deadline: AnswerDeadline,
    /// Since the client receives nothing.
    stalled: Option<Pin<Box<Sleep>>>,
}

impl<S> WriteTimeout<S> {
    pub(crate) fn new(stream: S, idle: Duration, deadline: AnswerDeadline) -> Self {
        Self {
            stream,
            idle,
            deadline,
            stalled: None,
        }
    }

    /// Passes progress on, and turns too long a wait into an error.
    fn watch<T>(
        &mut self,
        context: &mut Context<'_>,
        progress: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if self.deadline.is_over() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        if progress.is_ready() {
            self.stalled = None;
            return progress;
        }
        let idle = self.idle;
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(idle)));
        ready!(stalled.as_mut().poll(context));
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for WriteTimeout<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for WriteTimeout<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.watch(context, progress)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write_vectored(context, bytes);
        self.watch(context, progress)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_flush(context);
        self.watch(context, progress)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_shutdown(context);
        self.watch(context, progress)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};

    use super::*;

    const IDLE: Duration = Duration::from_millis(300);

    #[tokio::test]
    async fn a_client_that_takes_nothing_is_given_up() {
        let (ours, _theirs) = duplex(16);
        let mut ours = WriteTimeout::new(ours, IDLE, AnswerDeadline::default());
        let started = Instant::now();
        let failed = ours.write_all(&[7; 40]).await.expect_err("nobody reads");
        assert_eq!(failed.kind(), io::ErrorKind::TimedOut);
        assert!(started.elapsed() >= IDLE);
    }

    /// What a client takes that reads a byte in 2 ms, before a deadline.
    async fn taken(deadline: Option<Duration>) -> usize {
        let (ours, mut theirs) = duplex(4);
        let ends = AnswerDeadline::default();
        ends.set(deadline.map(|wait| Instant::now() + wait));
        let mut ours = WriteTimeout::new(ours, IDLE, ends);
        let reader = tokio::spawn(async move {
            let (mut taken, mut byte) = (0, [0; 1]);
            while theirs.read(&mut byte).await.expect("the other end") > 0 {
                taken += 1;
                sleep(Duration::from_millis(2)).await;
            }
            taken
        });
        // A failure shows in what is taken.
        let _ = ours.write_all(&[7; 200]).await;
        drop(ours);
        reader.await.expect("the reader")
    }

    #[tokio::test]
    async fn a_slow_client_gets_everything_before_the_deadline_and_no_more_after_it() {
        assert_eq!(taken(None).await, 200);
        assert_eq!(taken(Some(Duration::from_secs(300))).await, 200);
        let cut = taken(Some(Duration::from_millis(40))).await;
        assert!(cut < 40, "{cut}");
    }
}
