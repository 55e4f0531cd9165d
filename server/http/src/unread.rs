//! Refusals that come before the body of the request was read to its end.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use axum::body::{Body, HttpBody};
use axum::extract::Request;
use axum::http::{HeaderValue, Version, header};
use axum::middleware::Next;
use axum::response::Response;
use bytes::Bytes;
use hyper::body::{Frame, SizeHint};

/// Adds `Connection: close` to a refusal if the body of the request was not read to its end. The server closes the connection then, and
/// the next request of a client that was not told would be lost.
pub async fn close_after_refusal(request: Request, next: Next) -> Response {
    if request.body().is_end_stream() || request.version() > Version::HTTP_11 {
        return next.run(request).await;
    }
    let has_ended = Arc::new(AtomicBool::new(false));
    let request = request.map(|body| {
        let has_ended = has_ended.clone();
        Body::new(Watched { body, has_ended })
    });
    let mut response = next.run(request).await;
    let status = response.status();
    let is_refusal = status.is_client_error() || status.is_server_error();
    if is_refusal && !has_ended.load(Ordering::Relaxed) {
        let close = HeaderValue::from_static("close");
        response.headers_mut().insert(header::CONNECTION, close);
    }
    response
}

/// A body that notes its end.
struct Watched {
    body: Body,
    has_ended: Arc<AtomicBool>,
}

impl HttpBody for Watched {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = std::task::ready!(Pin::new(&mut self.body).poll_frame(context));
        if frame.is_none() || self.body.is_end_stream() {
            self.has_ended.store(true, Ordering::Relaxed);
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use axum::Router;
    use axum::http::StatusCode;
    use axum::middleware;
    use axum::routing::post;
    use tower::ServiceExt as _;

    use super::*;

    #[tokio::test]
    async fn a_refusal_before_the_end_of_the_body_closes_the_connection_and_says_so() {
        let refused = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        let app = Router::new()
            .route("/unread", post(async move || refused))
            .route("/read", post(async move |_: Bytes| refused))
            .route("/accepted", post(async || StatusCode::ACCEPTED))
            .layer(middleware::from_fn(close_after_refusal));
        for (path, body, closes) in [
            ("/unread", "body", true),
            ("/unread", "", false),
            ("/read", "body", false),
            ("/accepted", "body", false),
        ] {
            let request = Request::post(path).body(Body::from(body)).unwrap();
            let answer = app.clone().oneshot(request).await.unwrap();
            let close = answer.headers().get(header::CONNECTION);
            assert_eq!(
                close.is_some_and(|it| it == "close"),
                closes,
                "{path} {body}"
            );
        }
    }
}
