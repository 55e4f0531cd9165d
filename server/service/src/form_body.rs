//! The body of a form, with a limit on the bytes outside of parts.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use axum::BoxError;
use axum::body::{Body, Bytes};
use futures_util::stream::{self, StreamExt as _};

/// The most bytes from a boundary (at first, from the beginning) to the end of the next part's header.
const MAX_HEADER_BYTES: usize = 16 << 10;

/// Counts the bytes of a form that belong to no part yet.
///
/// multer, which reads the form, gathers everything until it finds a boundary and the end of a part's header, without a
/// limit.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeaderBudget(Arc<AtomicUsize>);

impl HeaderBudget {
    /// A part's header is expected from now on.
    pub(crate) fn begin_header(&self) {
        self.0.store(MAX_HEADER_BYTES, Ordering::Relaxed);
    }

    /// The header has come: what follows belongs to the part.
    pub(crate) fn end_header(&self) {
        self.0.store(usize::MAX, Ordering::Relaxed);
    }

    /// The body of a form that this counts.
    pub(crate) fn watch(&self, body: Body) -> Body {
        self.begin_header();
        let start = (body.into_data_stream(), self.clone());
        Body::from_stream(stream::unfold(start, async |(mut pieces, budget)| {
            // After each piece there seems to be no more for a moment, so that multer looks at what it has before it
            // gathers more.
            tokio::task::yield_now().await;
            let piece = match budget.is_spent() {
                true => Err(NoPart.into()),
                false => pieces.next().await?.map_err(BoxError::from),
            };
            budget.spend(piece.as_ref().map_or(0, Bytes::len));
            Some((piece, (pieces, budget)))
        }))
    }

    fn is_spent(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }

    fn spend(&self, bytes: usize) {
        let left = self.0.load(Ordering::Relaxed);
        if left != usize::MAX {
            self.0.store(left.saturating_sub(bytes), Ordering::Relaxed);
        }
    }
}

/// A part is missing where one must begin.
#[derive(Debug, thiserror::Error)]
#[error("the header of a part does not end within {MAX_HEADER_BYTES} bytes")]
struct NoPart;

#[cfg(test)]
mod tests {
    use http_body_util::BodyExt as _;

    use super::*;

    fn endless() -> Body {
        let pieces = futures_util::stream::repeat_with(|| {
            Ok::<_, std::convert::Infallible>(Bytes::from_static(&[b'x'; 1024]))
        });
        Body::from_stream(pieces)
    }

    #[tokio::test]
    async fn what_is_no_part_ends_after_16_kb() {
        let mut body = HeaderBudget::default().watch(endless());
        let mut seen = 0;
        while let Some(Ok(frame)) = body.frame().await {
            seen += frame.data_ref().map_or(0, Bytes::len);
        }
        assert_eq!(seen, MAX_HEADER_BYTES);
    }

    #[tokio::test]
    async fn a_part_has_no_such_limit() {
        let budget = HeaderBudget::default();
        let mut body = budget.watch(endless());
        budget.end_header();
        for _ in 0..1000 {
            body.frame().await.unwrap().unwrap();
        }
    }
}
