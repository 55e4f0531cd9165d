//! Writes the network's probabilities for a volume, to be compared with those of another implementation.
//!
//! `cargo run --release -p isocortex-bench --example probabilities -- WHEEL VOLUME OUT` writes `OUT.p.f32` (256³) and
//! `OUT.small.f32` (128³): raw little-endian single precision, x-fastest along the axes right, anterior, superior.

use std::ops::ControlFlow;
use std::path::Path;

use extraction::{Network, Probability};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [wheel, volume, out] = &arguments[..] else {
        return Err("three arguments: WHEEL VOLUME OUT".into());
    };
    let network = Network::from_wheel(&std::fs::read(wheel)?)?;
    let volume = imaging::nifti::read_volume(&std::fs::read(volume)?, &imaging::Limits::default())?;
    let begun = std::time::Instant::now();
    let prediction = network.predict(&volume, &|done| {
        eprintln!(
            "{:5.2} s {:3.0} %",
            begun.elapsed().as_secs_f64(),
            done * 100.0
        );
        ControlFlow::Continue(())
    })?;
    eprintln!("{:5.2} s", begun.elapsed().as_secs_f64());
    write(&prediction.fine, Path::new(&format!("{out}.p.f32")))?;
    write(&prediction.coarse, Path::new(&format!("{out}.small.f32")))?;
    Ok(())
}

fn write(probability: &Probability, path: &Path) -> std::io::Result<()> {
    let bytes: Vec<u8> = probability
        .values()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    std::fs::write(path, bytes)
}
