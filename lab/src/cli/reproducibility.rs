//! `isocortex-bench reproducibility`.

use std::path::PathBuf;

use bench::BenchError;
use bench::bids::{Pair, pairs, pipeline};
use clap::Args;
use serde_json::json;

use super::progress;

/// Compare the places that two scans of one person give
///
/// The first 1, 5 and 20 places of each scan are repeated if they lie within 10 mm of one of as many of the other scan. By chance means the
/// places of the second scan, mirrored. The second scan is brought to the first by registration.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("scans").required(true).args(["bids", "pair", "head"]))]
pub(super) struct ReproducibilityArgs {
    /// The heads of a BIDS folder that have two T1-weighted volumes, as sessions or runs.
    #[arg(long, value_name = "DIR")]
    bids: Option<PathBuf>,
    /// Two scans of one person, NIfTI.
    #[arg(long, num_args = 2, value_names = ["FIRST", "SECOND"])]
    pair: Option<Vec<PathBuf>>,
    /// A scan, NIfTI. The second one is made from it: half a voxel further along each axis, with new noise. May be given several times.
    #[arg(long, value_name = "FILE")]
    head: Vec<PathBuf>,
    /// The file with the weights of the network that extracts brains. [default: extract them by tree pruning]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// Compares and prints.
pub(super) fn run(args: &ReproducibilityArgs) -> Result<(), BenchError> {
    // The folder and the file: many files are named t1.nii.gz.
    let name = |path: &PathBuf| {
        let mut parts: Vec<_> = path.iter().rev().take(2).collect();
        parts.reverse();
        let parts: Vec<_> = parts.iter().map(|part| part.to_string_lossy()).collect();
        parts.join("/")
    };
    let mut compared = match &args.bids {
        Some(bids) => pairs(bids)?,
        None => Vec::new(),
    };
    compared.extend(args.pair.iter().map(|both| Pair {
        name: name(&both[0]),
        first: both[0].clone(),
        second: Some(both[1].clone()),
    }));
    compared.extend(args.head.iter().map(|head| Pair {
        name: name(head),
        first: head.clone(),
        second: None,
    }));
    let pipeline = pipeline(args.network.as_deref(), 1)?;
    let mut results = Vec::new();
    for pair in &compared {
        progress(&pair.name);
        results.push(pair.compare(&pipeline)?);
    }
    if args.json {
        println!("{:#}", json!(results));
        return Ok(());
    }
    println!(
        "| head | second scan | placement | first 1 / 5 / 20 repeated | by chance | unusual | of these repeated |"
    );
    println!("|---|---|---|---|---|---|---|");
    let shares = |shares: Option<[f64; 3]>| match shares {
        Some(shares) => shares.map(|share| format!("{share:.2}")).join(" / "),
        None => "–".to_owned(),
    };
    for result in &results {
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            result.head,
            result.second,
            result.placement,
            shares(result.of_first),
            shares(result.by_chance),
            result
                .unusual
                .map_or("–".to_owned(), |[one, other]| format!(
                    "{one} and {other}"
                )),
            result
                .of_unusual
                .map_or("–".to_owned(), |share| format!("{share:.2}")),
        );
    }
    Ok(())
}
