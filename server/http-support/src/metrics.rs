//! Counts and times for Prometheus.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

/// Upper bounds of the buckets of answer times, in seconds.
const TIME_CLASSES: [f64; 12] = [
    0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0, 5.0, 30.0,
];

/// The labels of requests: the template of the route, never the address itself.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RequestLabels {
    method: &'static str,
    route: String,
    status: u16,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RouteLabels {
    route: String,
}

/// The service's metrics. Cheap to clone: all clones count into the same.
#[derive(Debug, Clone)]
pub struct Metrics {
    registry: Arc<Registry>,
    requests: Family<RequestLabels, Counter>,
    times: Family<RouteLabels, Histogram, fn() -> Histogram>,
    in_flight: Gauge,
    waiting_renders: Gauge,
    uploaded_bytes: Counter<u64, AtomicU64>,
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

impl Metrics {
    /// Metrics that stand at zero.
    pub fn new() -> Self {
        let mut registry = Registry::with_prefix("isocortex");
        let requests = Family::default();
        let times: Family<_, _, fn() -> Histogram> =
            Family::new_with_constructor(|| Histogram::new(TIME_CLASSES));
        let in_flight = Gauge::default();
        let waiting_renders = Gauge::default();
        let uploaded_bytes = Counter::default();
        registry.register("http_requests", "Requests answered", requests.clone());
        registry.register_with_unit(
            "http_answer_time",
            "Time to the first byte of an answer",
            Unit::Seconds,
            times.clone(),
        );
        registry.register("http_in_flight", "Requests in progress", in_flight.clone());
        registry.register(
            "render_queue_waiting",
            "Work waiting for a render thread",
            waiting_renders.clone(),
        );
        registry.register_with_unit(
            "uploaded",
            "Bytes of volumes and masks received",
            Unit::Bytes,
            uploaded_bytes.clone(),
        );
        Self {
            registry: Arc::new(registry),
            requests,
            times,
            in_flight,
            waiting_renders,
            uploaded_bytes,
        }
    }

    /// A request begins; it ends when the guard is dropped.
    pub fn begin(&self) -> InFlight {
        self.in_flight.inc();
        InFlight(self.in_flight.clone())
    }

    /// A request was answered.
    pub fn answered(&self, method: &'static str, route: &str, status: u16, time: Duration) {
        let labels = RequestLabels {
            method,
            route: route.to_owned(),
            status,
        };
        self.requests.get_or_create(&labels).inc();
        let labels = RouteLabels {
            route: labels.route,
        };
        self.times
            .get_or_create(&labels)
            .observe(time.as_secs_f64());
    }

    /// Bytes of an upload have come.
    pub fn uploaded(&self, bytes: usize) {
        self.uploaded_bytes.inc_by(bytes as u64);
    }

    /// Everything in the text format of OpenMetrics 1.0.
    ///
    /// # Errors
    /// None in practice: it is written to memory.
    pub fn text(&self, waiting_renders: usize) -> Result<String, fmt::Error> {
        self.waiting_renders.set(waiting_renders as i64);
        let mut text = String::new();
        prometheus_client::encoding::text::encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

/// A request in progress.
#[derive(Debug)]
pub struct InFlight(Gauge);

impl Drop for InFlight {
    fn drop(&mut self) {
        self.0.dec();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_counted_by_route() {
        let metrics = Metrics::new();
        let guard = metrics.begin();
        metrics.answered("GET", "/v1/cases/{id}/mesh", 200, Duration::from_millis(2));
        let text = metrics.text(3).unwrap();
        assert!(text.contains(
            "isocortex_http_requests_total{method=\"GET\",route=\"/v1/cases/{id}/mesh\",status=\"200\"} 1"
        ), "{text}");
        assert!(text.contains("isocortex_http_in_flight 1"));
        assert!(text.contains("isocortex_render_queue_waiting 3"));
        drop(guard);
        assert!(
            metrics
                .text(0)
                .unwrap()
                .contains("isocortex_http_in_flight 0")
        );
    }
}
