//! Finds the brain of a synthetic head by tree pruning, and prints what the crate thinks of it and how true it is.
//!
//! `cargo run -p isocortex-extraction --example prune`

use std::ops::ControlFlow;

use extraction::{ExtractionError, extract};
use geometry::phantom;

fn main() -> Result<(), ExtractionError> {
    let head = phantom::head(2.0);
    let found = extract(&head.volume, None, 0.5, &|_done| ControlFlow::Continue(()))?;
    let (own, true_ml) = (found.brain.volume_ml(), head.brain.volume_ml());
    println!("brain {own:.0} ml of {true_ml:.0} ml");
    println!(
        "deepest point {:.1} mm below the envelope",
        found.closed.max_depth_mm()
    );
    println!("{:?}", found.quality.rating);
    for reason in &found.quality.reasons {
        println!("  {reason}");
    }
    Ok(())
}
