//! Prints what a NIfTI file states about its voxels, and which of them are farthest left, front and top.
//!
//! `cargo run -p isocortex-imaging --example identify [FILE]`; without a file, of a synthetic head.

use std::error::Error;

use geometry::phantom;
use imaging::{Limits, nifti, sniff};

fn main() -> Result<(), Box<dyn Error>> {
    let file = match std::env::args().nth(1) {
        Some(path) => std::fs::read(path)?,
        None => nifti::write_volume(&phantom::head(2.0).volume)?,
    };
    println!("{:?}, {} bytes", sniff(&file), file.len());

    let limits = Limits::default();
    let (volume, replaced) = nifti::read_counted(&file, &limits)?;
    let (grid, [least, most]) = (volume.grid(), volume.intensity_range());
    println!("{:?} voxels of {:.2?} mm", grid.size(), grid.spacing_mm());
    println!(
        "intensities from {least} to {most}; {} were not finite",
        replaced.not_finite
    );
    println!(
        "scanner space: {}",
        nifti::is_in_scanner_space(&file, &limits)?
    );

    // LPS: x to the patient's left, y to the back, z to the head. In a NIfTI header it is RAS.
    let voxel_from_patient = grid.voxel_from_patient();
    for (name, direction) in [
        ("left", glam::DVec3::X),
        ("front", -glam::DVec3::Y),
        ("top", glam::DVec3::Z),
    ] {
        let step = voxel_from_patient.transform_vector3(direction).normalize() + glam::DVec3::ZERO;
        println!("to the patient's {name}: {step:.2} along the axes of the file");
    }
    Ok(())
}
