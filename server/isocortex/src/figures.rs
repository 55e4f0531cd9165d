//! What the metrics say beside requests: the store, the PACS, the process.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use access::audit::Audit;
use access::auth::Access;
use http::metrics::{Figure, Metrics};
use pacs::dimse::{AssociationCounts, Rejection};
use pacs::{Pacs, PacsStore};
use storage::{Count, Store, failures, upkeep};

/// The clock ticks of `/proc` in a second, the same on every Linux.
const TICKS: f64 = 100.0;

/// Bytes of a page of memory in `/proc`.
const PAGE: f64 = 4096.0;

/// How long the database, and the objects, may take to answer. It is less than all figures may take, so that it is stated that one
/// does not answer.
const LONGEST_ANSWER: Duration = Duration::from_millis(1500);

/// Adds when the next of the tokens ends.
pub(crate) fn add_end_of_tokens(metrics: &Metrics, access: &Access) {
    let access = access.clone();
    metrics.add(move || {
        let help = "When the next of the tokens ends, since 1970";
        let next = Figure::gauge("isocortex_token_end_time_seconds", help);
        let end = access.next_end().into_iter();
        vec![end.fold(next, |figure, end| figure.with(&[], since_1970(end)))]
    });
}

fn since_1970(time: SystemTime) -> f64 {
    let since = time.duration_since(SystemTime::UNIX_EPOCH);
    since.unwrap_or_default().as_secs() as f64
}

/// Adds whether events can be recorded.
pub(crate) fn add_audit(metrics: &Metrics, audit: &Audit) {
    let audit = audit.clone();
    metrics.add(move || {
        let help = "Whether the audit record cannot be written";
        let full = Figure::gauge("isocortex_audit_full", help);
        vec![full.with(&[], f64::from(u8::from(audit.is_full())))]
    });
}

/// Adds the figures of the process and of the store.
pub(crate) fn add_store(metrics: &Metrics, store: &Store) {
    metrics.add(of_process);
    let counted = store.clone();
    metrics.add(move || counts(&counted));
    // The database may hang: what is counted in memory is a source of its own.
    let store = store.clone();
    metrics.add_source(Arc::new(move || {
        let store = store.clone();
        Box::pin(async move { rows(&store).await })
    }));
}

/// Adds the figures of the nodes of a PACS, and of what it has sent.
pub(crate) fn add_pacs(metrics: &Metrics, pacs: &Pacs) {
    let pacs = pacs.clone();
    metrics.add(move || vec![nodes(&pacs), images(&pacs)]);
}

/// Adds the figures of the listener for C-STORE.
pub(crate) fn add_associations(metrics: &Metrics, counts: &Arc<AssociationCounts>) {
    let counts = Arc::clone(counts);
    metrics.add(move || associations(&counts));
}

fn nodes(pacs: &Pacs) -> Figure {
    let help = "Whether a node answered when it was last asked, with whatever words";
    let figure = Figure::gauge("isocortex_node_reachable", help);
    let reached = pacs.reached();
    reached.iter().fold(figure, |figure, (node, is_reached)| {
        figure.with(&[("node", node)], f64::from(u8::from(*is_reached)))
    })
}

fn images(pacs: &Pacs) -> Figure {
    let help = "Images that came from a PACS by their way, and what became of them";
    let figure = Figure::counter("isocortex_images_received", help);
    let images = pacs.store().images().into_iter();
    images.fold(figure, |figure, (way, status, count)| {
        figure.with(&[("way", way), ("status", status.name())], count as f64)
    })
}

fn associations(counts: &AssociationCounts) -> Vec<Figure> {
    let running = Figure::gauge("isocortex_associations", "Associations of DIMSE now");
    let accepted = Figure::counter("isocortex_associations_accepted", "Associations accepted");
    let rejected = Figure::counter(
        "isocortex_associations_rejected",
        "Connections and associations rejected",
    );
    let answered = Figure::counter(
        "isocortex_c_store_answers",
        "Images of C-STORE by the answer",
    );
    let help = "When a peer last sent an image by C-STORE that was stored, since 1970";
    let last = Figure::gauge("isocortex_last_image_time_seconds", help);
    let [stored, not_stored] = counts.images();
    vec![
        running.with(&[], counts.running() as f64),
        accepted.with(&[], counts.accepted() as f64),
        Rejection::ALL.iter().fold(rejected, |figure, &why| {
            figure.with(&[("reason", why.name())], counts.rejected(why) as f64)
        }),
        answered
            .with(&[("answer", "success")], stored as f64)
            .with(&[("answer", "failure")], not_stored as f64),
        (counts.last_images().iter()).fold(last, |figure, (peer, &time)| {
            figure.with(&[("peer", peer)], since_1970(time))
        }),
    ]
}

/// What the store counts in memory.
fn counts(store: &Store) -> Vec<Figure> {
    let counted = |event| store.signals().counted(event) as f64;
    let failed = failures();
    let preparations = [
        ("ready", Count::Prepared),
        ("failed", Count::Failed),
        ("retried", Count::Retried),
    ];
    let help = "Preparations of cases and layers by this process, by their end";
    let prepared = Figure::counter("isocortex_preparations", help);
    let prepared = preparations.iter().fold(prepared, |figure, &(end, event)| {
        figure.with(&[("result", end)], counted(event))
    });
    let bad = Figure::counter("isocortex_bad_objects", "Objects found missing or damaged");
    let missing = Figure::counter(
        "isocortex_missing_sources",
        "Uploaded files and images of a PACS that were needed and are missing",
    );
    let rebuilt = Figure::counter("isocortex_rebuilds", "Cases rebuilt from their source");
    let failures = Figure::counter(
        "isocortex_store_failures",
        "Operations of the store that failed",
    );
    vec![
        prepared,
        bad.with(&[], counted(Count::BadObject)),
        missing.with(&[], counted(Count::MissingSource)),
        rebuilt.with(&[], counted(Count::Rebuild)),
        failures
            .with(&[("part", "database")], failed.database as f64)
            .with(&[("part", "objects")], failed.objects as f64),
    ]
}

/// What the rows count, for all processes on the store.
async fn rows(store: &Store) -> Vec<Figure> {
    let mut figures = Vec::new();
    if let Ok(free) = store.spools().free_bytes().await {
        let help = "Free bytes on the disk of the folder of this process";
        figures.push(Figure::gauge("isocortex_free_bytes", help).with(&[], free as f64));
    }
    let (counted, checked) = tokio::join!(
        tokio::time::timeout(LONGEST_ANSWER, upkeep::row_counts(store)),
        tokio::time::timeout(LONGEST_ANSWER, store.id()),
    );
    let counted = counted.ok().and_then(Result::ok);
    let up = Figure::gauge("isocortex_database_up", "Whether the database answers");
    figures.push(up.with(&[], f64::from(u8::from(counted.is_some()))));
    let Some(mut counted) = counted else {
        return figures;
    };
    let help =
        "Whether the folder or the bucket of the objects answers and belongs to the database";
    let up = Figure::gauge("isocortex_objects_up", help);
    let is_up = matches!(checked, Ok(Ok(_)));
    figures.push(up.with(&[], f64::from(u8::from(is_up))));
    let of_pacs = PacsStore::new(store.clone()).counts_by_state().await;
    counted.by_state.extend(of_pacs.unwrap_or_default());
    let help = "Cases that are older than storage.keep_days and are not removed yet";
    let waiting = Figure::gauge("isocortex_expired_cases", help);
    figures.push(waiting.with(&[], counted.expired as f64));
    for (what, part, name, help) in [
        ("cases", "", "isocortex_cases", "Cases by state"),
        (
            "arrivals",
            "",
            "isocortex_arrivals",
            "Series from a PACS by what became of them",
        ),
        (
            "closed",
            "reason",
            "isocortex_closed_cases",
            "Cases that are closed, by whether their images were corrected or rejected",
        ),
        (
            "jobs",
            "kind",
            "isocortex_jobs",
            "Jobs by kind and state; those that ended stay some days",
        ),
        (
            "results",
            "node",
            "isocortex_results",
            "Results for a node, by state",
        ),
    ] {
        let of_it = counted.by_state.iter().filter(|(found, ..)| found == what);
        let figure = Figure::gauge(name, help);
        figures.push(
            of_it.fold(figure, |figure, (_, value, state, count)| match part {
                "" => figure.with(&[("state", state)], *count as f64),
                part => figure.with(&[(part, value), ("state", state)], *count as f64),
            }),
        );
    }
    let help = "For how long the oldest job of a kind has not ended";
    let oldest = Figure::gauge("isocortex_oldest_job_seconds", help);
    let each = counted.oldest.iter();
    figures.push(each.fold(oldest, |figure, (kind, age)| {
        figure.with(&[("kind", kind)], age.as_secs_f64())
    }));
    figures
}

/// The process, as far as the system tells.
fn of_process() -> Vec<Figure> {
    let build = Figure::gauge("isocortex_build_info", "The version of the program");
    let mut figures = vec![build.with(&[("version", env!("CARGO_PKG_VERSION"))], 1.0)];
    let Some(process) = read_process() else {
        return figures;
    };
    let one = |figure: Figure, value: f64| figure.with(&[], value);
    figures.extend([
        one(
            Figure::counter("process_cpu_seconds", "CPU time of the process"),
            process.cpu_seconds,
        ),
        one(
            Figure::gauge("process_resident_memory_bytes", "Memory of the process"),
            process.resident_bytes,
        ),
        one(
            Figure::gauge("process_open_fds", "Open descriptors of the process"),
            process.open_fds,
        ),
        one(
            Figure::gauge("process_threads", "Threads of the process"),
            process.threads,
        ),
        one(
            Figure::gauge(
                "process_start_time_seconds",
                "When the process started, since 1970",
            ),
            process.started_at,
        ),
    ]);
    figures
}

/// What `/proc` tells about this process.
struct Process {
    cpu_seconds: f64,
    resident_bytes: f64,
    open_fds: f64,
    threads: f64,
    started_at: f64,
}

fn read_process() -> Option<Process> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program, in brackets, may have spaces.
    let fields: Vec<f64> = stat
        .rsplit_once(')')?
        .1
        .split_whitespace()
        .skip(1)
        .map(|field| field.parse().unwrap_or(0.0))
        .collect();
    // From the fourth field of proc(5) on.
    let field = |number: usize| fields.get(number - 4).copied();
    let boot = std::fs::read_to_string("/proc/stat").ok()?;
    let boot = boot.lines().find_map(|line| line.strip_prefix("btime "))?;
    Some(Process {
        cpu_seconds: (field(14)? + field(15)?) / TICKS,
        threads: field(20)?,
        started_at: boot.trim().parse::<f64>().ok()? + field(22)? / TICKS,
        resident_bytes: field(24)? * PAGE,
        open_fds: std::fs::read_dir("/proc/self/fd").ok()?.count() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_process_has_plausible_figures() {
        let process = read_process().unwrap();
        assert!(process.resident_bytes > 1e6 && process.resident_bytes < 1e12);
        assert!(process.open_fds >= 3.0 && process.threads >= 1.0);
        assert!(process.started_at > 1.7e9);
    }

    #[test]
    fn a_rejection_has_a_reason() {
        let figures = associations(&AssociationCounts::default());
        let rejected = &figures[2];
        assert_eq!(rejected.values.len(), Rejection::ALL.len());
        assert!(rejected.is_counter);
    }
}
