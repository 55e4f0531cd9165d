//! The body of a form, with a limit on the bytes outside of parts.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};

/// The most bytes from a boundary (at first, from the beginning) to the end of the next part's header.
const MAX_HEADER_BYTES: usize = 16 << 10;

/// Counts the bytes of a form that belong to no part yet.
///
/// multer, which reads the form, gathers everything until it finds a boundary and the end of a part's header, without a
/// limit.
#[derive(Debug, Clone, Default)]
pub struct HeaderBudget(Arc<AtomicUsize>);

impl HeaderBudget {
    /// A part's header is expected from now on.
    pub fn begin_header(&self) {
        self.0.store(MAX_HEADER_BYTES, Ordering::Relaxed);
    }

    /// The header has come: what follows belongs to the part.
    pub fn end_header(&self) {
        self.0.store(usize::MAX, Ordering::Relaxed);
    }

    /// The body of a form that this counts.
    pub fn watch(&self, body: Body) -> Body {
        self.begin_header();
        Body::new(FormBody {
            body,
            budget: self.clone(),
            rests: false,
        })
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

struct FormBody {
    body: Body,
    budget: HeaderBudget,
    /// After each piece the body seems to have no more for a moment, so that multer looks at what it has before it gathers
    /// more.
    rests: bool,
}

impl HttpBody for FormBody {
    type Data = Bytes;
    type Error = axum::BoxError;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        if std::mem::take(&mut self.rests) {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        if self.budget.is_spent() {
            return Poll::Ready(Some(Err(NoPart.into())));
        }
        let frame = std::task::ready!(Pin::new(&mut self.body).poll_frame(context));
        if let Some(Ok(frame)) = &frame {
            self.budget
                .spend(frame.data_ref().map_or(0, bytes::Bytes::len));
            self.rests = true;
        }
        Poll::Ready(frame.map(|frame| frame.map_err(Into::into)))
    }

    fn is_end_stream(&self) -> bool {
        !self.rests && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

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
