//! The progress of a case as server-sent events.

use cases::Cases;
use std::convert::Infallible;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderName, HeaderValue};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream::{self, Stream, StreamExt};

use super::cases::CaseView;
use crate::routes::asked::CasePath;
use crate::state::{EventStreams, Stopping};
use http::client_limit::ClientPermit;
use http::listen::ThisClient;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};
use storage::Watch;

/// A comment is sent after this time without an event, so that no proxy closes the connection.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// The progress of a case
///
/// An event `case` with the case as JSON, at once and at every change; the stream ends when the case is `ready` or
/// `failed`. An event `gone` if the case is deleted.
#[utoipa::path(
    get, path = "/v1/cases/{id}/events", tag = "cases",
    params(("id" = String, Path, description = "The case")),
    responses(
        (status = 200, description = "Events `case` and `gone`", body = String, content_type = "text/event-stream"),
        (status = 503, description = "Too many streams of events at a time"),
    )
)]
pub async fn get_events(
    State(cases): State<Cases>,
    State(streams): State<EventStreams>,
    ThisClient(client): ThisClient,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    cases.case(&id).await?;
    let permit = streams.begin(client)?;
    let events = events(cases.store().subscribe(&id));
    Ok(stream_of(events, permit, &streams.stopping))
}

/// The answer with events, until they end or the server stops; it holds the permit meanwhile.
pub(super) fn stream_of(
    events: impl Stream<Item = Result<Event, Infallible>> + Send + 'static,
    permit: ClientPermit,
    stopping: &Stopping,
) -> Response {
    let events = events.take_until(stopping.begun());
    let mut response = Sse::new(events.inspect(move |_| _ = &permit))
        .keep_alive(KeepAlive::new().interval(KEEP_ALIVE))
        .into_response();
    // Tells nginx, the usual proxy, to pass each event on at once.
    response.headers_mut().insert(
        HeaderName::from_static("x-accel-buffering"),
        HeaderValue::from_static("no"),
    );
    response
}

/// Events until the case is ready, has failed, or is deleted.
fn events(watch: Watch) -> impl Stream<Item = Result<Event, Infallible>> + Send {
    stream::unfold(Some(watch), |watch| async move {
        let mut watch = watch?;
        match watch.next().await {
            Ok(Some(case)) => {
                let rest = (!case.state.is_final()).then_some(watch);
                let event = Event::default()
                    .event("case")
                    .json_data(CaseView::from(case))
                    .unwrap_or_default();
                Some((Ok(event), rest))
            }
            Ok(None) => Some((Ok(Event::default().event("gone").data("{}")), None)),
            Err(error) => {
                tracing::error!(%error, "the store failed");
                None
            }
        }
    })
}
