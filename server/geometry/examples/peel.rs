//! Prints the area of the isosurface of a synthetic head at each depth below its envelope.
//!
//! `cargo run -p isocortex-geometry --example peel`

use geometry::{
    BrainMask, ClosedBrain, DeformableModel, GeometryError, ShrunkMesh, envelope, phantom,
};
use glam::Vec3;

fn main() -> Result<(), GeometryError> {
    let head = phantom::head(2.0);
    let brain = BrainMask::from_mask(&head.brain, head.volume.grid())?;
    let envelope = envelope(&brain, 10.0)?;
    println!(
        "brain {:.0} ml, envelope {:.0} ml",
        brain.volume_ml(),
        envelope.volume_ml()
    );

    let volume =
        DeformableModel::crop(&head.volume, &envelope).expect("the brain is in the volume");
    let observe = |_step| Ok::<_, GeometryError>(());
    let built = DeformableModel::build(volume, ClosedBrain::Envelope(envelope), observe)?;
    let paths = built.model.default_paths();
    println!("deepest point {:.1} mm", built.distance.max_depth_mm());

    println!("depth_mm  area_cm2");
    for depth_mm in (0..=30).step_by(5) {
        let mesh = paths.shrink(depth_mm as f32);
        println!("{depth_mm:8}  {:8.0}", area_cm2(&mesh));
    }
    Ok(())
}

/// The area of the triangles, which are the same at every depth.
fn area_cm2(mesh: &ShrunkMesh) -> f32 {
    let triangles = DeformableModel::DEFAULT_MESH.triangles();
    let doubled = triangles.iter().map(|corners| {
        let [a, b, c] =
            corners.map(|vertex| Vec3::from(mesh.positions_in_patient[vertex as usize]));
        (b - a).cross(c - a).length()
    });
    doubled.sum::<f32>() / 2.0 / 100.0
}
