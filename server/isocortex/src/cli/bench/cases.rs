//! Growth with the cases in the store.

use std::path::Path;

use measure::growth::note_exponents;
use measure::paper::Telling;
use measure::{Cell, Head, Summary, Table, column};

use super::client::Client;
use super::filled::{fill, temporary_directory};
use super::served::Served;
use crate::cli::status::CliError;
use case::CaseId;

/// Cases in the store.
const COUNTS: [usize; 4] = [1, 10, 100, 1000];

/// Edge of a voxel of the small head of which the cases are, in mm.
const SPACING_MM: f64 = 4.0;

/// Starts of the server, and lists and first meshes that are asked for after each.
const STARTS: usize = 3;
const QUESTIONS: usize = 20;

/// Cases on a page, where all of them are listed.
const PAGE: usize = 200;

/// Start, list, first mesh and memory by the cases in the store, up to `most`.
pub(super) async fn table(most: usize, tell: &dyn Telling) -> Result<Table, CliError> {
    let columns = [
        column("cases", "cases"),
        column("start_ms", "start, ms"),
        column("list_ms", "list, ms"),
        column("all_pages_ms", "all pages, ms"),
        column("first_mesh_ms", "first mesh, ms"),
        column("again_ms", "again, ms"),
        column("memory_mib", "started, MiB"),
        column("used_memory_mib", "used, MiB"),
        column("prepare_ms", "prepared each, ms"),
    ];
    let title = "Growth with the cases in the store (small heads): wall, medians";
    let mut table = Table::new("growth_cases", title, &columns);
    let directory = temporary_directory()?;
    let head = Head::phantom(SPACING_MM)?;
    let mut ids = Vec::new();
    for count in COUNTS.into_iter().filter(|count| *count <= most) {
        tell.tell(&format!("growth with the cases: {count}"));
        let begin = std::time::Instant::now();
        let made = fill(directory.path(), &head, ids.len()..count).await?;
        let each_ms = begin.elapsed().as_secs_f64() * 1e3 / made.len() as f64;
        ids.extend(made);
        let mut cells = vec![Cell::from(count)];
        cells.extend(row(directory.path(), &ids).await?);
        cells.push(each_ms.into());
        table.push(cells);
    }
    let keys = [
        "start_ms",
        "list_ms",
        "all_pages_ms",
        "first_mesh_ms",
        "again_ms",
        "memory_mib",
        "used_memory_mib",
        "prepare_ms",
    ];
    note_exponents(&mut table, "cases", &keys);
    table.note(format!(
        "First mesh: of {QUESTIONS} cases that were not asked for before, at most. Used: after these."
    ));
    Ok(table)
}

/// Times in seconds, of which the median is shown.
#[derive(Default)]
struct Seen {
    start: Vec<f64>,
    list: Vec<f64>,
    all_pages: Vec<f64>,
    first: Vec<f64>,
    again: Vec<f64>,
    memory: Vec<f64>,
    used: Vec<f64>,
}

async fn row(directory: &Path, ids: &[CaseId]) -> Result<Vec<Cell>, CliError> {
    let mut seen = Seen::default();
    for _ in 0..STARTS {
        ask(&Served::start(directory)?, ids, &mut seen).await?;
    }
    let median = |numbers: Vec<f64>| Summary::of(numbers).map(|summary| summary.median);
    let ms = |seconds| Cell::from(median(seconds).map(|median| median * 1e3));
    Ok(vec![
        ms(seen.start),
        ms(seen.list),
        ms(seen.all_pages),
        ms(seen.first),
        ms(seen.again),
        median(seen.memory).into(),
        median(seen.used).into(),
    ])
}

/// Asks a server that has just started.
async fn ask(server: &Served, ids: &[CaseId], seen: &mut Seen) -> Result<(), CliError> {
    let mut client = Client::connect(server.address).await?;
    client.get_ok("/readyz").await?;
    seen.start.push(server.start_s);
    seen.memory.extend(server.memory_mib());
    for _ in 0..QUESTIONS {
        seen.list.push(client.get_ok("/v1/cases").await?.seconds);
    }
    seen.all_pages.push(all_pages(&mut client).await?);
    let stride = ids.len().div_ceil(QUESTIONS);
    for id in ids.iter().step_by(stride) {
        let path = format!("/v1/cases/{id}/mesh?depth_mm=8");
        seen.first.push(client.get_ok(&path).await?.seconds);
        let path = format!("/v1/cases/{id}/mesh?depth_mm=9");
        seen.again.push(client.get_ok(&path).await?.seconds);
    }
    seen.used.extend(server.memory_mib());
    Ok(())
}

/// Time of the whole list, page after page, in seconds.
async fn all_pages(client: &mut Client) -> Result<f64, CliError> {
    let begin = std::time::Instant::now();
    let mut path = format!("/v1/cases?limit={PAGE}");
    loop {
        let page = client.get_json(&path).await?;
        match page["next"].as_str() {
            Some(next) => path = format!("/v1/cases?limit={PAGE}&after={next}"),
            None => return Ok(begin.elapsed().as_secs_f64()),
        }
    }
}
