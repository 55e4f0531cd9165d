//! The whole service as one router.

use std::any::Any;

use axum::Router;
use axum::extract::{FromRef as _, Request};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use cases::Error;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{PropagateRequestIdLayer, SetRequestIdLayer};
use utoipa::openapi::OpenApi;

use crate::routes;
use crate::state::{AnswerTimeout, AppState, FrameAncestors, GuardAll};
use access::auth::{self, Access};
use access::origins;
use access::routes::ProtocolRoutes;
use http::logs::{self, MakeId, REQUEST_ID};
use http::metrics::Metrics;
use http::problem::AppError;
use http::unread::close_after_refusal;

/// What the page may load, and in whose frames it may stand: its own, and those of the configuration.
const CONTENT_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
     connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'";

/// Headers of every answer beside [`CONTENT_POLICY`]: nothing for another host, no guessed types.
const SECURITY_HEADERS: [(HeaderName, &str); 5] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("permissions-policy"),
        "camera=(), geolocation=(), microphone=()",
    ),
];

/// Builds the whole service. Serve it, or call `oneshot` without a socket.
pub fn app(state: AppState) -> Router {
    let (routes, openapi) = routes::all(&state);
    finish(state, routes, &openapi)
}

/// As [`app`], with the routes of another protocol.
pub fn app_with(state: AppState, beside: ProtocolRoutes) -> Router {
    let (routes, openapi) = routes::all(&state);
    let in_time =
        middleware::from_fn_with_state(AnswerTimeout::from_ref(&state), routes::answer_in_time);
    let answers = beside.answers.map(|routes| routes.route_layer(in_time));
    let (guarded, scopes) = beside.uploads.and(answers).into_parts();
    let guard = middleware::from_fn_with_state(routes::guard(&state, scopes), auth::require_token);
    let in_turn = middleware::from_fn(routes::in_turn);
    let guarded = guarded.route_layer(in_turn).route_layer(guard);
    let (guarded, mut description) = guarded.split_for_parts();
    routes::guarded::describe(&mut description);
    let routes = routes.merge(guarded.with_state(()));
    finish(state, routes, &openapi.merge_from(description))
}

fn finish(state: AppState, routes: Router<AppState>, openapi: &OpenApi) -> Router {
    let (access, metrics) = (Access::from_ref(&state), Metrics::from_ref(&state));
    let policy = content_policy(&FrameAncestors::from_ref(&state));
    let mut documents = routes::documents::written(openapi);
    if GuardAll::from_ref(&state).0 {
        let guard = routes::guard(&state, routes::documents::scopes());
        let guard = middleware::from_fn_with_state(guard, auth::require_token);
        documents = documents.route_layer(guard);
    }
    routes
        .merge(documents)
        .merge(routes::documents::page())
        .fallback(|| async { AppError::no_such_route() })
        .method_not_allowed_fallback(|| async { AppError::method_not_allowed() })
        .layer(middleware::from_fn_with_state(
            access.clone(),
            auth::guard_origin,
        ))
        .layer(middleware::from_fn_with_state(
            access.origins().clone(),
            origins::share,
        ))
        .layer(middleware::from_fn(refuse_coding))
        .layer(middleware::from_fn(routes::in_turn))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::map_response(move |response: Response| {
            add_security_headers(response, policy.clone())
        }))
        .layer(middleware::from_fn(close_after_refusal))
        .layer(middleware::from_fn_with_state(metrics, logs::observe))
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(SetRequestIdLayer::new(REQUEST_ID, MakeId))
        .layer(middleware::from_fn(logs::drop_bad_request_id))
        .with_state(state)
}

/// Bodies are read as they come: what is compressed says so itself, as gzipped NIfTI does.
async fn refuse_coding(request: Request, next: Next) -> Result<Response, AppError> {
    let coding = request.headers().get(header::CONTENT_ENCODING);
    if coding.is_some_and(|coding| !coding.as_bytes().eq_ignore_ascii_case(b"identity")) {
        let detail = "the body has a `Content-Encoding`; send it as it is (a gzipped NIfTI file is a file, and needs no coding)";
        let refusal = AppError::new(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "content-encoding",
            detail,
        );
        let identity = HeaderValue::from_static("identity");
        return Err(refusal.with_header(header::ACCEPT_ENCODING, identity));
    }
    Ok(next.run(request).await)
}

fn content_policy(ancestors: &FrameAncestors) -> HeaderValue {
    let mut policy = CONTENT_POLICY.as_bytes().to_vec();
    for origin in ancestors.0.iter() {
        policy.push(b' ');
        policy.extend(origin.as_bytes());
    }
    HeaderValue::from_bytes(&policy).unwrap_or(HeaderValue::from_static(CONTENT_POLICY))
}

async fn add_security_headers(mut response: Response, policy: HeaderValue) -> Response {
    let headers = response.headers_mut();
    headers
        .entry(header::CONTENT_SECURITY_POLICY)
        .or_insert(policy);
    for (name, value) in SECURITY_HEADERS {
        let headers = response.headers_mut();
        headers
            .entry(name)
            .or_insert(HeaderValue::from_static(value));
    }
    response
}

/// The panic hook writes the text of the panic to standard error; it never reaches the client.
fn panicked(_panic: Box<dyn Any + Send + 'static>) -> Response {
    tracing::error!("a handler panicked");
    AppError::from(Error::Internal).into_response()
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use axum::body::Body;
    use axum::extract::Request;
    use axum::routing::get;
    use case::Client;
    use cases::ConcurrencyLimit;
    use futures_util::future::join_all;
    use futures_util::poll;
    use http::listen::ThisClient;
    use tower::ServiceExt as _;

    use super::*;

    #[tokio::test]
    async fn clients_take_turns_with_their_work() {
        let limit = ConcurrencyLimit::new(1, 8);
        let served = Arc::new(Mutex::new(Vec::new()));
        let handler = {
            let (limit, served) = (limit.clone(), Arc::clone(&served));
            move |client: ThisClient| async move {
                let _turn = limit.turn().await.unwrap();
                served.lock().unwrap().push(client.0);
            }
        };
        let app: Router = Router::new()
            .route("/", get(handler))
            .layer(middleware::from_fn(routes::in_turn));
        let ask = |client: Client| {
            let mut request = Request::get("/").body(Body::empty()).unwrap();
            request.extensions_mut().insert(client);
            Box::pin(app.clone().oneshot(request))
        };
        let held = limit.turn().await.unwrap();
        let [greedy, other] = ["greedy", "other"].map(Client::named);
        let mut requests = [greedy, greedy, greedy, other].map(ask);
        for request in &mut requests {
            assert!(poll!(request).is_pending());
        }
        drop(held);
        join_all(requests).await;
        assert_eq!(*served.lock().unwrap(), [greedy, other, greedy, greedy]);
    }
}
