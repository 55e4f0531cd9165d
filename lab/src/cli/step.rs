//! `isocortex-bench step`.

use std::path::PathBuf;

use bench::{BenchError, Cost, Head, PreparedHead, Spin, timed};
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use geometry::{BrainMask, MeshSize};
use render::{FrameSize, RenderBackend, encode_png};
use serde_json::json;

use super::head::HeadArgs;
use super::write;

/// The number of depths that are timed together, because one takes only microseconds.
const LOOK_UPS: usize = 1000;

/// Depth of pictures, in mm.
const DEPTH_MM: f32 = 10.0;

/// Time one step of the preparation or one picture, for a script that also measures other programs
///
/// Prints one JSON object: the step, its wall-clock and CPU time in seconds, and a number for comparing results with
/// other programs.
#[derive(Debug, Args)]
pub(super) struct StepArgs {
    /// The step to time.
    #[arg(value_enum)]
    step: SingleStep,
    #[command(flatten)]
    head: HeadArgs,
    /// Also write the envelope to this file as NIfTI.
    #[arg(long, value_name = "FILE")]
    envelope: Option<PathBuf>,
}

/// A step that can be timed separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SingleStep {
    /// Reading the file of the volume.
    Decode,
    /// The closing of the brain to the envelope.
    Closing,
    /// The exact distance map.
    Distance,
    /// The regional maxima of the distance map.
    Core,
    /// The optimal paths.
    Forest,
    /// The mesh of the envelope with 1,800 triangles.
    Mesh,
    /// That mesh at another depth.
    Depth,
    /// A picture of 512 × 512 pixels by splatting.
    Picture,
    /// The same picture by tracing.
    Traced,
    /// Encoding it as PNG.
    Png,
}

/// Performs the step and prints its cost.
pub(super) fn run(args: &StepArgs) -> Result<(), BenchError> {
    let head = args.head.read()?;
    let closing_mm = args.head.closing_radius_mm;
    let (prepared, _) = PreparedHead::prepare(&head, closing_mm)?;
    if let Some(path) = &args.envelope {
        let mask = prepared.distance.envelope().mask();
        let bytes = imaging::nifti::write_mask(mask);
        write(
            path,
            &bytes.map_err(|error| BenchError::unwritable(path, &error))?,
        )?;
    }
    let (cost, check) = args.step.once(&head, &prepared, closing_mm)?;
    let step = args.step.to_possible_value();
    let step = step.as_ref().map(PossibleValue::get_name);
    println!(
        "{}",
        json!({"step": step, "wall_s": cost.wall_s, "cpu_s": cost.cpu_s, "check": check})
    );
    Ok(())
}

impl SingleStep {
    /// Performs the step once; returns its cost and a number from its result: of voxels or triangles, or in mm.
    fn once(
        self,
        head: &Head,
        prepared: &PreparedHead,
        closing_mm: f64,
    ) -> Result<(Cost, f64), BenchError> {
        let distance = &prepared.distance;
        Ok(match self {
            Self::Decode => {
                let limits = imaging::Limits::default();
                let (volume, cost) = timed(|| imaging::nifti::read_volume(&head.volume, &limits));
                (cost, volume?.voxels().len() as f64)
            }
            Self::Closing => {
                let (volume, mask) = head.read()?;
                let brain = BrainMask::from_mask(&mask, volume.grid())?;
                let (envelope, cost) = timed(|| geometry::envelope(&brain, closing_mm));
                let inside = envelope?;
                let inside = inside.mask().voxels().iter().filter(|inside| **inside);
                (cost, inside.count() as f64)
            }
            Self::Distance => {
                let (map, cost) = timed(|| geometry::distance_map(distance.envelope()));
                (cost, f64::from(map.max_depth_mm()))
            }
            Self::Core => {
                let (core, cost) = timed(|| geometry::core(distance));
                (cost, core.voxels().len() as f64)
            }
            Self::Forest => {
                let core = geometry::core(distance);
                let (_, cost) = timed(|| geometry::forest(distance, &core));
                (cost, prepared.inside_voxels() as f64)
            }
            Self::Mesh => {
                let field = prepared.model().field();
                let (mesh, cost) = timed(|| geometry::envelope_mesh(field, MeshSize::STANDARD));
                (cost, mesh?.size.triangle_count() as f64)
            }
            Self::Depth => new_depth(prepared),
            Self::Picture => picture(prepared, &RenderBackend::Splat)?,
            Self::Traced => picture(prepared, &RenderBackend::Trace)?,
            Self::Png => {
                let job = prepared.job(spin()?.request(prepared, 0)?, None);
                let frame = RenderBackend::Splat.draw(&job)?.frame;
                let (png, cost) = timed(|| encode_png(&frame, &[]));
                (cost, png?.len() as f64)
            }
        })
    }
}

fn new_depth(prepared: &PreparedHead) -> (Cost, f64) {
    let table = prepared.model().default_paths();
    let ((), cost) = timed(|| {
        for number in 0..LOOK_UPS {
            let depth_mm = table.max_depth_mm * number as f32 / LOOK_UPS as f32;
            std::hint::black_box(table.shrink(depth_mm));
        }
    });
    (cost.shared_by(LOOK_UPS), table.size.triangle_count() as f64)
}

fn spin() -> Result<Spin, BenchError> {
    Ok(Spin {
        frames: 1,
        seconds: 1.0,
        size: FrameSize::new(512, 512)?,
        depth_mm: DEPTH_MM,
    })
}

fn picture(prepared: &PreparedHead, backend: &RenderBackend) -> Result<(Cost, f64), BenchError> {
    let job = prepared.job(spin()?.request(prepared, 0)?, None);
    let (frame, cost) = timed(|| backend.draw(&job));
    let frame = frame?.frame;
    let lit = frame.bytes().iter().filter(|byte| **byte > 0).count();
    Ok((cost, lit as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_can_be_taken_alone() {
        let head = Head::phantom(4.0).unwrap();
        let (prepared, _) = PreparedHead::prepare(&head, 10.0).unwrap();
        for step in SingleStep::value_variants() {
            let (cost, check) = step.once(&head, &prepared, 10.0).unwrap();
            assert!(cost.wall_s > 0.0 && check > 0.0, "{step:?}");
        }
    }
}
