//! Counts and times for Prometheus.

use std::fmt;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use futures_util::future::BoxFuture;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};
use tokio::time::Timeout;

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

/// A figure with a value for each combination of labels, which is read when it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its name, with the unit at its end and without `_total`.
    pub name: &'static str,
    /// What it counts or measures.
    pub help: &'static str,
    /// Whether it only grows until the process ends.
    pub is_counter: bool,
    /// Labels, and the value.
    pub values: Vec<(Vec<(&'static str, String)>, f64)>,
}

impl Figure {
    /// A value that rises and falls.
    pub fn gauge(name: &'static str, help: &'static str) -> Self {
        Self {
            name,
            help,
            is_counter: false,
            values: Vec::new(),
        }
    }

    /// A value that only grows.
    pub fn counter(name: &'static str, help: &'static str) -> Self {
        Self {
            is_counter: true,
            ..Self::gauge(name, help)
        }
    }

    /// The same with the value of a combination of labels.
    #[must_use]
    pub fn with(mut self, labels: &[(&'static str, &str)], value: f64) -> Self {
        let labels = labels.iter().map(|&(name, value)| (name, value.to_owned()));
        self.values.push((labels.collect(), value));
        self
    }

    fn write(&self, text: &mut String) {
        let kind = if self.is_counter { "counter" } else { "gauge" };
        let suffix = if self.is_counter { "_total" } else { "" };
        let Self { name, help, .. } = self;
        text.push_str(&format!("# HELP {name} {help}.\n# TYPE {name} {kind}\n"));
        for (labels, value) in &self.values {
            let labels: Vec<_> = labels
                .iter()
                .map(|(name, value)| format!("{name}=\"{}\"", escaped(value)))
                .collect();
            let labels = match labels.is_empty() {
                true => String::new(),
                false => format!("{{{}}}", labels.join(",")),
            };
            text.push_str(&format!("{name}{suffix}{labels} {value}\n"));
        }
    }
}

fn escaped(value: &str) -> String {
    value
        .replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

/// What reads figures.
pub type Source = Arc<dyn Fn() -> BoxFuture<'static, Vec<Figure>> + Send + Sync>;

/// How long all figures may take.
const LONGEST_READING: Duration = Duration::from_secs(2);

/// The media type of OpenMetrics.
pub const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The last line of OpenMetrics.
const END: &str = "# EOF\n";

/// The service's metrics. Cheap to clone: all clones count into the same.
#[derive(Clone)]
pub struct Metrics {
    registry: Arc<Registry>,
    requests: Family<RequestLabels, Counter>,
    times: Family<RouteLabels, Histogram, fn() -> Histogram>,
    in_flight: Gauge,
    waiting_renders: Gauge,
    uploaded_bytes: Counter<u64, AtomicU64>,
    sources: Arc<Mutex<Vec<Source>>>,
}

impl fmt::Debug for Metrics {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Metrics(…)")
    }
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
            sources: Arc::default(),
        }
    }

    /// Adds figures that can be read at once, whenever the metrics are asked for.
    pub fn add(&self, figures: impl Fn() -> Vec<Figure> + Send + Sync + 'static) {
        self.add_source(Arc::new(move || {
            let figures = figures();
            Box::pin(async { figures })
        }));
    }

    /// Adds figures, which are read whenever the metrics are asked for. Those of a source that hangs are left out.
    pub fn add_source(&self, source: Source) {
        let mut sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        sources.push(source);
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
    pub async fn all(&self, waiting_renders: usize) -> Result<String, fmt::Error> {
        let mut text = self.text(waiting_renders)?;
        text.truncate(text.trim_end_matches(END).len());
        let readings = self.readings();
        let figures = futures_util::future::join_all(readings).await;
        for figure in figures.into_iter().flatten().flatten() {
            figure.write(&mut text);
        }
        text.push_str(END);
        Ok(text)
    }

    /// Begins to read every source.
    fn readings(&self) -> Vec<Timeout<BoxFuture<'static, Vec<Figure>>>> {
        let sources = self.sources.lock().unwrap_or_else(PoisonError::into_inner);
        let limited = |source: &Source| tokio::time::timeout(LONGEST_READING, source());
        sources.iter().map(limited).collect()
    }

    /// What is counted here, in the text format of OpenMetrics 1.0.
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

    #[tokio::test]
    async fn figures_are_read_when_they_are_asked_for() {
        let metrics = Metrics::new();
        metrics.add_source(Arc::new(|| {
            Box::pin(async {
                let figure = Figure::counter("isocortex_images", "Images that came");
                vec![figure.with(&[("way", "st\"ow")], 3.0).with(&[], 0.5)]
            })
        }));
        let hanging: Source = Arc::new(|| Box::pin(std::future::pending()));
        metrics.add_source(hanging);
        let text = metrics.all(0).await.unwrap();
        let expected = "# HELP isocortex_images Images that came.\n# TYPE isocortex_images counter\n\
             isocortex_images_total{way=\"st\\\"ow\"} 3\nisocortex_images_total 0.5\n# EOF\n";
        assert!(text.ends_with(expected), "{text}");
        assert_eq!(text.matches("# EOF").count(), 1);
    }

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
