//! The state of an added layer as server-sent events.

use std::convert::Infallible;

use axum::extract::{RawPathParams, State};
use axum::response::Response;
use axum::response::sse::Event;
use case::{CaseId, Layer, LayerId};
use cases::Cases;
use futures_util::stream::{self, Stream};
use storage::Watch;

use super::{LayerView, layer_of};
use crate::routes::asked::CasePath;
use crate::routes::events::stream_of;
use crate::state::EventStreams;
use http::listen::ThisClient;
use http::problem::AppError;
use http::query::{ApiQuery, NoQuery};

/// The state of an added layer
///
/// An event `layer` with the layer as JSON, at once and at every change; the stream ends when the layer is `ready` or
/// `failed`. An event `gone` if the layer or its case is deleted.
#[utoipa::path(
    get, path = "/v1/cases/{id}/layers/{layer}/events", tag = "layers",
    params(
        ("id" = String, Path, description = "The case"),
        ("layer" = String, Path, description = "The id or name of an added layer"),
    ),
    responses(
        (status = 200, description = "Events `layer` and `gone`", body = String, content_type = "text/event-stream"),
        (status = 503, description = "Too many streams of events at a time"),
        (status = 404, description = "No such case or added layer"),
    )
)]
pub async fn get_layer_events(
    State(cases): State<Cases>,
    State(streams): State<EventStreams>,
    ThisClient(client): ThisClient,
    CasePath(id): CasePath,
    path: RawPathParams,
    _no_query: ApiQuery<NoQuery>,
) -> Result<Response, AppError> {
    let layer = cases.layer(&id, &layer_of(&path)?).await?.id;
    let place = streams.begin(client)?;
    let watching = Watching {
        watch: cases.store().subscribe(&id),
        cases,
        key: (id, layer),
        seen: None,
    };
    Ok(stream_of(events(watching), place, &streams.stopping))
}

/// A layer, and what was sent of it.
struct Watching {
    cases: Cases,
    watch: Watch,
    key: (CaseId, LayerId),
    seen: Option<Layer>,
}

impl Watching {
    /// The layer at the first call, then each change; `None` once it is gone.
    async fn next(&mut self) -> Result<Option<Layer>, storage::StoreError> {
        loop {
            let layer = self.cases.store().layer(&self.key.0, &self.key.1).await?;
            if layer.is_none() || layer != self.seen {
                self.seen.clone_from(&layer);
                return Ok(layer);
            }
            self.watch.changed().await;
        }
    }
}

/// Events until the layer is ready, has failed, or is deleted.
fn events(watching: Watching) -> impl Stream<Item = Result<Event, Infallible>> + Send {
    stream::unfold(Some(watching), |watching| async move {
        let mut watching = watching?;
        match watching.next().await {
            Ok(Some(layer)) => {
                let event = Event::default()
                    .event("layer")
                    .json_data(LayerView::of_layer(&layer))
                    .unwrap_or_default();
                Some((Ok(event), (!layer.state.is_final()).then_some(watching)))
            }
            Ok(None) => Some((Ok(Event::default().event("gone").data("{}")), None)),
            Err(error) => {
                tracing::error!(%error, "the store failed");
                None
            }
        }
    })
}
