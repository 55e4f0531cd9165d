//! Write timeout: ends connections whose client receives nothing, or too slowly.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::pace::{LeastRate, Pace};

/// A stream that fails to write if its client receives less than the minimum rate.
///
/// Otherwise, a client that requests a large body and does not read it would hold its connection for ever.
#[derive(Debug)]
pub(crate) struct Unstalled<S> {
    stream: S,
    pace: Pace,
}

impl<S> Unstalled<S> {
    pub(crate) fn new(stream: S, rate: LeastRate) -> Self {
        Self {
            stream,
            pace: Pace::new(rate),
        }
    }

    /// Passes progress on, and turns too long a wait into an error.
    fn watch<T>(
        &mut self,
        context: &mut Context<'_>,
        progress: Poll<io::Result<T>>,
        bytes: impl FnOnce(&T) -> usize,
    ) -> Poll<io::Result<T>> {
        if let Poll::Ready(done) = progress {
            self.pace.moved(done.as_ref().map_or(0, bytes));
            return Poll::Ready(done);
        }
        Poll::Ready(Err(ready!(self.pace.poll_too_slow(context)).into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Unstalled<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Unstalled<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.watch(context, progress, |&written| written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write_vectored(context, bytes);
        self.watch(context, progress, |&written| written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_flush(context);
        self.watch(context, progress, |()| 0)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_shutdown(context);
        self.watch(context, progress, |()| 0)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};
    use tokio::time::sleep;

    use super::*;

    const RATE: LeastRate = LeastRate {
        bytes_per_second: 10,
        grace: Duration::from_millis(300),
        pause: Duration::from_millis(300),
    };

    #[tokio::test]
    async fn a_client_that_takes_nothing_is_given_up() {
        let (ours, _theirs) = duplex(16);
        let mut ours = Unstalled::new(ours, RATE);
        let failed = ours.write_all(&[7; 40]).await.expect_err("nobody reads");
        assert_eq!(failed.kind(), io::ErrorKind::TimedOut);
    }

    /// What a client takes that reads a byte in each interval.
    async fn taken(every: Duration) -> Vec<u8> {
        let (ours, mut theirs) = duplex(4);
        let mut ours = Unstalled::new(ours, RATE);
        let reader = tokio::spawn(async move {
            let mut taken = Vec::new();
            let mut byte = [0; 1];
            while theirs.read(&mut byte).await.expect("the other end") > 0 {
                taken.push(byte[0]);
                sleep(every).await;
            }
            taken
        });
        // A failure shows in what is taken.
        let _ = ours.write_all(&[7; 200]).await;
        drop(ours);
        reader.await.expect("the reader")
    }

    #[tokio::test]
    async fn a_client_at_the_least_rate_gets_everything() {
        assert_eq!(taken(Duration::from_millis(2)).await, [7; 200]);
    }

    #[tokio::test]
    async fn a_client_that_takes_a_byte_now_and_then_is_given_up() {
        let taken = taken(Duration::from_millis(500)).await;
        assert!(taken.len() < 40, "{}", taken.len());
    }
}
