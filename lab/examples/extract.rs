//! Extracts the brains of volumes and prints what the quality gate says.
//!
//! `cargo run --release -p isocortex-bench --example extract -- WHEEL VOLUME...`

use std::ops::ControlFlow;

use extraction::{Network, extract};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let wheel = arguments.next().ok_or("arguments: WHEEL VOLUME...")?;
    let network = Network::from_wheel(&std::fs::read(wheel)?)?;
    for path in arguments {
        let volume =
            imaging::nifti::read_volume(&std::fs::read(&path)?, &imaging::Limits::default())?;
        let begun = std::time::Instant::now();
        let found = extract(&volume, Some(&network), 0.5, &|_| ControlFlow::Continue(()));
        println!(
            "{path}: {:.2} s\n{:#?}",
            begun.elapsed().as_secs_f64(),
            found.map(|found| found.quality)
        );
    }
    Ok(())
}
