//! Many clients at a time, against this program in a process of its own.

use std::time::{Duration, Instant};

use hyper::StatusCode;
use measure::paper::Telling;
use measure::{Cell, Head, Summary, Table, column};

use super::client::Client;
use super::filled::{fill, temporary_directory};
use super::served::Served;
use crate::cli::status::CliError;
use case::CaseId;

/// Connections at a time.
const CONNECTIONS: [usize; 4] = [1, 16, 64, 256];

/// A client that was told to come again later waits so long.
const AFTER_REFUSAL: Duration = Duration::from_millis(50);

/// Depths and turns that requests go through, so that no cache of whole answers helps.
const VARIANTS: usize = 389;

/// How much load, and for how long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// Seconds for each kind of request and number of connections.
    pub(super) seconds: f64,
    /// The most connections.
    pub(super) connections: usize,
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
enum Ask {
    Mesh,
    Paths,
    Render,
    List,
}

impl Ask {
    const ALL: [Self; 4] = [Self::Mesh, Self::Paths, Self::Render, Self::List];

    fn name(self) -> &'static str {
        match self {
            Self::Mesh => "mesh, a depth of 1,800 triangles",
            Self::Paths => "paths, every depth of them",
            Self::Render => "render, 512 × 512 by splatting",
            Self::List => "list of the cases",
        }
    }

    /// The address of a variant.
    fn path(self, id: &CaseId, variant: usize) -> String {
        let variant = variant % VARIANTS;
        let depth_mm = 30.0 * variant as f64 / VARIANTS as f64;
        let half_turn = std::f64::consts::PI * variant as f64 / VARIANTS as f64;
        let (z, w) = half_turn.sin_cos();
        match self {
            Self::Mesh => format!("/v1/cases/{id}/mesh?depth_mm={depth_mm:.3}"),
            Self::Paths => format!("/v1/cases/{id}/mesh/paths"),
            Self::Render => format!(
                "/v1/cases/{id}/render?renderer=splat&depth_mm={depth_mm:.3}&orientation=0,0,{z:.5},{w:.5}"
            ),
            Self::List => "/v1/cases".to_owned(),
        }
    }
}

/// What the clients of one run saw.
#[derive(Debug, Default)]
struct Seen {
    /// Times of the answers 200, in seconds.
    seconds: Vec<f64>,
    bytes: usize,
    /// Answers 503: come again later.
    refused: u64,
    /// Every other answer, and none.
    errors: u64,
}

/// Requests a second, times, errors and memory by what is asked for and the connections.
pub(super) async fn table(head: &Head, load: Load, tell: &dyn Telling) -> Result<Table, CliError> {
    tell.tell("load: preparing a case and starting a server");
    let directory = temporary_directory()?;
    let ids = fill(directory.path(), head, 0..1).await?;
    let server = Served::start(directory.path())?;
    let columns = [
        column("request", "request"),
        column("connections", "connections"),
        column("requests_per_s", "requests/s"),
        column("p50_ms", "50 %, ms"),
        column("p99_ms", "99 %, ms"),
        column("cpu_us", "server's CPU, µs"),
        column("kib", "KiB"),
        column("refused", "503"),
        column("errors", "errors"),
        column("memory_mib", "server, MiB"),
        column("peak_memory_mib", "at most"),
    ];
    let title = "Load: one case, this program serving and asking on one machine";
    let mut table = Table::new("load", title, &columns);
    for ask in Ask::ALL {
        // The first answer reads the case from the disk.
        Client::connect(server.address)
            .await?
            .get_ok(&ask.path(&ids[0], 0))
            .await?;
        for connections in CONNECTIONS {
            if connections <= load.connections {
                tell.tell(&format!("load: {}, {connections} connections", ask.name()));
                let cells = row(&server, (ask, ids[0]), connections, load.seconds).await?;
                table.push(cells);
            }
        }
    }
    table.note("503 is an answer: the server's queue has an end, and the client comes again. Times are of the answers 200.");
    table.note("The clients share the processors with the server, so the server alone does better; its CPU time says how much.");
    Ok(table)
}

async fn row(
    server: &Served,
    (ask, id): (Ask, CaseId),
    connections: usize,
    seconds: f64,
) -> Result<Vec<Cell>, CliError> {
    let cpu_before = server.cpu_s();
    let begin = Instant::now();
    let end = begin + Duration::from_secs_f64(seconds);
    let mut clients = tokio::task::JoinSet::new();
    for number in 0..connections {
        let client = Client::connect(server.address).await?;
        clients.spawn(ask_until(client, (ask, id), end, number * 17));
    }
    let mut all = Seen::default();
    while let Some(seen) = clients.join_next().await {
        // A client that panicked is an error like any other.
        let seen = seen.unwrap_or_else(|_| Seen {
            errors: 1,
            ..Seen::default()
        });
        all.seconds.extend(seen.seconds);
        all.bytes += seen.bytes;
        all.refused += seen.refused;
        all.errors += seen.errors;
    }
    let wall_s = begin.elapsed().as_secs_f64();
    let cpu_s = server.cpu_s().zip(cpu_before).map(|(now, then)| now - then);
    let count = all.seconds.len();
    let times = Summary::of(all.seconds);
    Ok(vec![
        ask.name().into(),
        connections.into(),
        (count as f64 / wall_s).into(),
        times.map(|times| times.median * 1e3).into(),
        times.map(|times| times.p99 * 1e3).into(),
        cpu_s.map(|cpu_s| cpu_s / count as f64 * 1e6).into(),
        (all.bytes as f64 / count as f64 / 1024.0).into(),
        all.refused.into(),
        all.errors.into(),
        server.memory_mib().into(),
        server.peak_memory_mib().into(),
    ])
}

/// Asks again and again until it is time; at least once.
async fn ask_until(
    mut client: Client,
    (ask, id): (Ask, CaseId),
    end: Instant,
    first: usize,
) -> Seen {
    let mut seen = Seen::default();
    for variant in first.. {
        match client.get(&ask.path(&id, variant)).await {
            Ok(answer) if answer.status == StatusCode::OK => {
                seen.seconds.push(answer.seconds);
                seen.bytes += answer.length;
            }
            Ok(answer) if answer.status == StatusCode::SERVICE_UNAVAILABLE => {
                seen.refused += 1;
                tokio::time::sleep(AFTER_REFUSAL).await;
            }
            Ok(_) => seen.errors += 1,
            Err(_) => {
                // The connection is gone.
                seen.errors += 1;
                break;
            }
        }
        if Instant::now() >= end {
            break;
        }
    }
    seen
}
