//! One step for each line that is read: how `scripts/peers/` measures other programs beside this one, turn by turn.

use std::io::{BufRead as _, Write as _};
use std::path::Path;
use std::sync::Arc;

use imaging::nifti;
use measure::{Asked, Head, MeasuredCase};
use serde_json::json;

use crate::cli::status::{CliError, ExitStatus};
use crate::cli::write_output;

/// Reads names of steps from standard input until its end, does each once and prints a line of JSON: what it took, and a number of
/// its result. Before that it writes the envelope, as the other programs are to take it, into `directory`.
pub(super) fn take_turns(
    head: &Head,
    case: &Arc<MeasuredCase>,
    closing_radius_mm: f64,
    directory: &Path,
) -> Result<(), CliError> {
    let internal = |error: &dyn std::fmt::Display| CliError::new(ExitStatus::Internal, error);
    let envelope = nifti::write_mask(case.distance.envelope().mask());
    let envelope = envelope.map_err(|error| internal(&error))?;
    write_output(&directory.join("envelope.nii.gz"), &envelope)?;
    println!("{}", json!({ "ready": true }));
    for line in std::io::stdin().lock().lines() {
        let line = line.map_err(|error| CliError::new(ExitStatus::NoInput, error))?;
        let step: Asked = line
            .trim()
            .parse()
            .map_err(|error| CliError::new(ExitStatus::Usage, error))?;
        let (cost, check) = step.once(head, case, closing_radius_mm)?;
        println!(
            "{}",
            json!({ "wall_s": cost.wall_s, "cpu_s": cost.cpu_s, "check": check })
        );
        std::io::stdout()
            .flush()
            .map_err(|error| internal(&error))?;
    }
    Ok(())
}
