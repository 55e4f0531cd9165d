//! The minimum rate at which a client must send or receive bytes.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use std::sync::{Arc, OnceLock};

use axum::body::{Bytes, HttpBody};
use cases::places::Places;
use hyper::body::{Frame, SizeHint};
use tokio::time::{Instant, Sleep, sleep};

/// The minimum rate while the server waits for bytes. Time in which the server itself is busy does not count.
#[derive(Debug, Clone, Copy)]
pub struct LeastRate {
    /// Bytes per second, on average.
    pub bytes_per_second: u64,
    /// How long a client may send nothing at first.
    pub grace: Duration,
    /// How long a client may pause that was fast before.
    pub pause: Duration,
}

/// The places that a body holds one of, if any: the fewer are left, the faster it must come.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hurry(Arc<OnceLock<Places>>);

impl Hurry {
    /// The first places count.
    pub(crate) fn by(&self, places: &Places) {
        let _has_places = self.0.set(places.clone());
    }

    fn times(&self) -> f64 {
        self.0.get().map_or(1.0, Places::hurry)
    }
}

/// The client was too slow.
#[derive(Debug, thiserror::Error)]
#[error("the client sends or receives less than {bytes_per_second} bytes per second")]
pub struct TooSlow {
    bytes_per_second: u64,
}

/// Measures one transfer. Each byte earns time to wait for the next ones.
#[derive(Debug)]
pub(crate) struct Pace {
    rate: LeastRate,
    /// The remaining time to wait for the client.
    credit: Duration,
    waiting: Option<(Instant, Pin<Box<Sleep>>)>,
}

impl Pace {
    pub(crate) fn new(rate: LeastRate) -> Self {
        Self {
            rate,
            credit: rate.grace,
            waiting: None,
        }
    }

    /// Counts transferred bytes.
    pub(crate) fn moved(&mut self, bytes: usize) {
        self.moved_in_hurry(bytes, 1.0);
    }

    /// Counts transferred bytes, of which a client must transfer so many times as many as usual.
    fn moved_in_hurry(&mut self, bytes: usize, times: f64) {
        if let Some((since, _)) = self.waiting.take() {
            self.credit = self.credit.saturating_sub(since.elapsed());
        }
        let earned = bytes as f64 / (times * self.rate.bytes_per_second.max(1) as f64);
        let most = self.rate.pause.max(self.rate.grace);
        self.credit = most.min(self.credit + Duration::from_secs_f64(earned));
    }

    /// Waits for the client; an error after too long.
    pub(crate) fn poll_too_slow(&mut self, context: &mut Context<'_>) -> Poll<TooSlow> {
        let credit = self.credit;
        let (_, timer) = self
            .waiting
            .get_or_insert_with(|| (Instant::now(), Box::pin(sleep(credit))));
        ready!(timer.as_mut().poll(context));
        Poll::Ready(TooSlow {
            bytes_per_second: self.rate.bytes_per_second,
        })
    }
}

impl From<TooSlow> for io::Error {
    fn from(error: TooSlow) -> Self {
        Self::new(io::ErrorKind::TimedOut, error)
    }
}

/// A body that fails if it arrives too slowly.
#[derive(Debug)]
pub(crate) struct PacedBody<B> {
    body: B,
    pace: Pace,
    hurry: Hurry,
}

impl<B> PacedBody<B> {
    pub(crate) fn new(body: B, rate: LeastRate, hurry: Hurry) -> Self {
        Self {
            body,
            pace: Pace::new(rate),
            hurry,
        }
    }
}

impl<B> HttpBody for PacedBody<B>
where
    B: HttpBody<Data = Bytes, Error: Into<axum::BoxError>> + Unpin,
{
    type Data = Bytes;
    type Error = axum::BoxError;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        let Self { body, pace, hurry } = &mut *self;
        match Pin::new(body).poll_frame(context) {
            Poll::Ready(frame) => {
                let frame = frame.map(|frame| frame.map_err(Into::into));
                let data = frame.as_ref().and_then(|frame| frame.as_ref().ok());
                let bytes = data.and_then(Frame::data_ref).map_or(0, Bytes::len);
                pace.moved_in_hurry(bytes, hurry.times());
                Poll::Ready(frame)
            }
            Poll::Pending => {
                let slow = ready!(pace.poll_too_slow(context));
                Poll::Ready(Some(Err(slow.into())))
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Whether an error of a body comes from a client that was too slow.
pub fn is_too_slow(error: &(dyn std::error::Error + 'static)) -> bool {
    std::iter::successors(Some(error), |error| error.source())
        .any(<dyn std::error::Error>::is::<TooSlow>)
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use axum::body::Body;
    use futures_util::StreamExt as _;
    use http_body_util::BodyExt as _;

    use super::*;

    const RATE: LeastRate = LeastRate {
        bytes_per_second: 1000,
        grace: Duration::from_millis(300),
        pause: Duration::from_millis(600),
    };

    /// A body of `count` pieces of `bytes`, one in each interval.
    fn body_of(count: usize, bytes: usize, every: Duration) -> PacedBody<Body> {
        let pieces = futures_util::stream::iter(0..count).then(move |_| async move {
            sleep(every).await;
            Ok::<_, Infallible>(Bytes::from(vec![0; bytes]))
        });
        PacedBody::new(Body::from_stream(pieces), RATE, Hurry::default())
    }

    #[tokio::test]
    async fn a_dripping_body_ends_soon_after_the_grace() {
        let started = Instant::now();
        let body = body_of(10_000, 1, Duration::from_millis(20));
        let error = body.collect().await.unwrap_err();
        assert!(is_too_slow(&*error), "{error}");
        let after = started.elapsed().as_millis();
        assert!((300..5000).contains(&after), "{after} ms");
    }

    #[tokio::test]
    async fn a_body_at_the_least_rate_comes_whole() {
        let body = body_of(20, 300, Duration::from_millis(20));
        assert_eq!(body.collect().await.unwrap().to_bytes().len(), 6000);
    }

    #[tokio::test]
    async fn the_same_rate_is_too_slow_once_all_places_are_taken() {
        let places = Places::in_quarters(4);
        let _all: Vec<_> = (0..4)
            .map(|_| places.take(cases::places::Client::default()).unwrap())
            .collect();
        let body = body_of(40, 60, Duration::from_millis(20));
        body.hurry.by(&places);
        let error = body.collect().await.unwrap_err();
        assert!(is_too_slow(&*error), "{error}");
    }

    #[tokio::test]
    async fn a_fast_start_does_not_earn_an_endless_pause() {
        let pieces = futures_util::stream::iter([Duration::ZERO, Duration::from_secs(60)]).then(
            |wait| async move {
                sleep(wait).await;
                Ok::<_, Infallible>(Bytes::from(vec![0; 1 << 20]))
            },
        );
        let body = PacedBody::new(Body::from_stream(pieces), RATE, Hurry::default());
        let started = Instant::now();
        assert!(body.collect().await.is_err());
        assert!(started.elapsed() < Duration::from_secs(30));
    }

    #[tokio::test]
    async fn time_in_which_nobody_reads_does_not_count() {
        let mut body = body_of(2, 10, Duration::from_millis(10));
        body.frame().await.unwrap().unwrap();
        sleep(Duration::from_secs(1)).await;
        body.frame().await.unwrap().unwrap();
    }
}
