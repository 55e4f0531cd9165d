//! Log lines: one for each request, without patient data.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, Method};
use axum::middleware::Next;
use axum::response::Response;
use tower_http::request_id::{MakeRequestId, RequestId};
use tracing::Instrument as _;

use crate::metrics::Metrics;

/// How often something happened, for at most one line in the log a minute.
#[derive(Debug, Default)]
pub struct LogRateLimit(Mutex<(u64, Option<Instant>)>);

/// The time of one line.
const LOGGED_EVERY: Duration = Duration::from_secs(60);

impl LogRateLimit {
    /// Counts once. If this is to be logged, returns how often it happened since the last line.
    pub fn count(&self) -> Option<u64> {
        self.count_at(Instant::now())
    }

    fn count_at(&self, now: Instant) -> Option<u64> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (count, last) = &mut *state;
        *count += 1;
        if last.is_some_and(|last| now.duration_since(last) < LOGGED_EVERY) {
            return None;
        }
        *last = Some(now);
        Some(std::mem::take(count))
    }
}

/// The header of the request id, in both directions.
pub const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Gives each request without an id a new one.
#[derive(Debug, Clone, Copy, Default)]
pub struct MakeId;

impl MakeRequestId for MakeId {
    fn make_request_id<B>(&mut self, _request: &axum::http::Request<B>) -> Option<RequestId> {
        use std::hash::{BuildHasher as _, RandomState};
        use std::sync::LazyLock;
        use std::sync::atomic::{AtomicU64, Ordering};
        static PROCESS: LazyLock<u32> = LazyLock::new(|| RandomState::new().hash_one(0) as u32);
        static NUMBER: AtomicU64 = AtomicU64::new(1);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let text = format!("{:08x}-{number:x}", *PROCESS);
        text.parse().ok().map(RequestId::new)
    }
}

/// Whether a client may choose this id: only random ids from programs (a UUID, or 32 hexadecimal digits). Anything else
/// could be a name or the number of a patient, and would reach the log.
fn is_acceptable_id(id: &[u8]) -> bool {
    let digits = id.iter().filter(|byte| byte.is_ascii_hexdigit()).count();
    let is_uuid = id.len() == 36 && [8, 13, 18, 23].iter().all(|&at| id[at] == b'-');
    digits == 32 && (id.len() == 32 || is_uuid)
}

/// Removes an id that a client may not choose.
pub async fn drop_bad_request_id(mut request: Request, next: Next) -> Response {
    let id = request.headers().get(&REQUEST_ID);
    if id.is_some_and(|id| !is_acceptable_id(id.as_bytes())) {
        request.headers_mut().remove(&REQUEST_ID);
    }
    next.run(request).await
}

/// Counts the request and writes its line: method, route template, status, time and id.
///
/// It contains neither query nor headers, and only the template of the address, because case ids are digests of patient
/// data.
pub async fn observe(State(metrics): State<Metrics>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let in_flight = metrics.begin();
    let method = known_method(request.method());
    let route = request.extensions().get::<MatchedPath>().cloned();
    let id = request.extensions().get::<RequestId>().cloned();
    let id = id.as_ref().and_then(|id| id.header_value().to_str().ok());
    let span = tracing::info_span!("request", id);
    let response = next.run(request).instrument(span.clone()).await;
    let _entered = span.enter();
    drop(in_flight);
    let route = route.as_ref().map_or("none", MatchedPath::as_str);
    let status = response.status().as_u16();
    let time = started.elapsed();
    metrics.answered(method, route, status, time);
    write_line(method, route, status, time);
    response
}

fn write_line(method: &str, route: &str, status: u16, time: Duration) {
    let ms = time.as_secs_f64() * 1e3;
    if status == 500 {
        tracing::warn!(method, route, status, ms, "answered");
    } else {
        tracing::debug!(method, route, status, ms, "answered");
    }
}

/// Methods become labels of metrics, so their number must be small.
fn known_method(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::PATCH => "PATCH",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_one_line_a_minute_with_its_count() {
        let (limit, start) = (LogRateLimit::default(), Instant::now());
        let logged = [0, 1, 59, 60, 61, 200]
            .map(|second| limit.count_at(start + Duration::from_secs(second)));
        assert_eq!(logged, [Some(1), None, None, Some(3), None, Some(2)]);
    }

    #[test]
    fn ids_that_could_be_words_are_not_taken() {
        assert!(is_acceptable_id(b"4bf92f3577b34da6a3ce929d0e0e4736"));
        assert!(is_acceptable_id(b"0af76519-16cd-43dd-8448-eb211c80319c"));
        for id in [
            &b""[..],
            b"a b",
            b"19670312",
            b"Smith-Anna",
            &[b'a'; 65],
            b"0af76519-16cd-43dd-8448-eb211c80319-",
        ] {
            assert!(!is_acceptable_id(id));
        }
    }

    #[test]
    fn each_method_of_a_route_has_its_own_label() {
        for method in ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"] {
            assert_eq!(known_method(&method.parse().unwrap()), method);
        }
        assert_eq!(known_method(&Method::TRACE), "other");
    }

    #[test]
    fn every_request_has_an_id_of_its_own() {
        let request = axum::http::Request::new(());
        let mut ids = [(); 2].map(|()| MakeId.make_request_id(&request).unwrap());
        let [a, b] = &mut ids;
        assert_ne!(a.header_value(), b.header_value());
    }
}
