//! One step at a time, for whoever measures another program beside this one, turn by turn.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use geometry::{BrainMask, MeshSize};
use render::{FrameSize, encode_png};

use crate::rotation::{Painter, Spin};
use crate::{Cost, Head, MeasureError, MeasuredCase, timed};

/// Depths that are looked up together, so that a clock sees them.
const LOOK_UPS: usize = 1000;

/// Depth of surfaces and pictures, in mm.
pub const ASKED_DEPTH_MM: f32 = 10.0;

/// A step that can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked {
    /// The volume's file to its voxels.
    Decode,
    /// The brain to the envelope.
    Closing,
    /// The exact distance map.
    Distance,
    /// Its regional maxima.
    Core,
    /// The optimal paths.
    Forest,
    /// The envelope's mesh of 1,800 triangles.
    Mesh,
    /// That mesh at another depth.
    Depth,
    /// A picture of 512 × 512 pixels by splatting.
    Picture,
    /// The same by tracing.
    Traced,
    /// Its PNG.
    Png,
}

/// The steps by their names.
const NAMES: [(&str, Asked); 10] = [
    ("decode", Asked::Decode),
    ("closing", Asked::Closing),
    ("distance", Asked::Distance),
    ("core", Asked::Core),
    ("forest", Asked::Forest),
    ("mesh", Asked::Mesh),
    ("depth", Asked::Depth),
    ("picture", Asked::Picture),
    ("traced", Asked::Traced),
    ("png", Asked::Png),
];

/// A name that no step has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownStep;

impl fmt::Display for UnknownStep {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = NAMES.map(|(name, _)| name).join(", ");
        write!(formatter, "no such step; there are: {names}")
    }
}

impl FromStr for Asked {
    type Err = UnknownStep;

    fn from_str(text: &str) -> Result<Self, UnknownStep> {
        let mut steps = NAMES.into_iter();
        let found = steps.find(|(name, _)| *name == text);
        found.map(|(_, step)| step).ok_or(UnknownStep)
    }
}

impl Asked {
    /// Does the step once; what it took, and a number of its result that another program can be held against.
    ///
    /// The number is of voxels or triangles, or in mm.
    ///
    /// # Errors
    /// When the step fails.
    pub fn once(
        self,
        head: &Head,
        case: &Arc<MeasuredCase>,
        closing_radius_mm: f64,
    ) -> Result<(Cost, f64), MeasureError> {
        Ok(match self {
            Self::Decode => {
                let limits = imaging::Limits::default();
                let (volume, cost) = timed(|| imaging::nifti::read_volume(&head.volume, &limits));
                (cost, volume?.voxels().len() as f64)
            }
            Self::Closing => {
                let (volume, mask) = head.read()?;
                let brain = BrainMask::from_mask(&mask, volume.grid())?;
                let (envelope, cost) = timed(|| geometry::envelope(&brain, closing_radius_mm));
                let inside = envelope?;
                let inside = inside.mask().voxels().iter().filter(|inside| **inside);
                (cost, inside.count() as f64)
            }
            Self::Distance => {
                let (map, cost) = timed(|| geometry::distance_map(case.distance.envelope()));
                (cost, f64::from(map.max_depth_mm()))
            }
            Self::Core => {
                let (core, cost) = timed(|| geometry::core(&case.distance));
                (cost, core.voxels().len() as f64)
            }
            Self::Forest => {
                let core = geometry::core(&case.distance);
                let (_, cost) = timed(|| geometry::forest(&case.distance, &core));
                (cost, case.inside_voxels() as f64)
            }
            Self::Mesh => {
                let size = MeshSize::STANDARD;
                let (mesh, cost) = timed(|| geometry::envelope_mesh(&case.field, size));
                (cost, mesh?.size.triangle_count() as f64)
            }
            Self::Depth => new_depth(case)?,
            Self::Picture => picture(case, &Painter::Splat)?,
            Self::Traced => picture(case, &Painter::Trace)?,
            Self::Png => {
                let request = spin()?.request(case, 0)?;
                let frame = Painter::Splat.draw(case, request, None)?;
                let (png, cost) = timed(|| encode_png(&frame, &[]));
                (cost, png?.len() as f64)
            }
        })
    }
}

fn new_depth(case: &MeasuredCase) -> Result<(Cost, f64), MeasureError> {
    let (mesh, table) = case.table(MeshSize::STANDARD)?;
    let deepest = case.distance.max_depth_mm();
    let ((), cost) = timed(|| {
        for number in 0..LOOK_UPS {
            let depth_mm = deepest * number as f32 / LOOK_UPS as f32;
            std::hint::black_box(table.shrink(depth_mm));
        }
    });
    Ok((cost.shared_by(LOOK_UPS), mesh.size.triangle_count() as f64))
}

fn spin() -> Result<Spin, MeasureError> {
    Ok(Spin {
        frames: 1,
        seconds: 1.0,
        size: FrameSize::new(512, 512)?,
        depth_mm: ASKED_DEPTH_MM,
    })
}

fn picture(case: &Arc<MeasuredCase>, painter: &Painter) -> Result<(Cost, f64), MeasureError> {
    let request = spin()?.request(case, 0)?;
    let (frame, cost) = timed(|| painter.draw(case, request, None));
    let lit = frame?.bytes().iter().filter(|byte| **byte > 0).count();
    Ok((cost, lit as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_that_has_a_name_can_be_done() {
        let head = Head::phantom(4.0).unwrap();
        let case = Arc::new(MeasuredCase::prepare(&head, 10.0).unwrap().0);
        for (name, step) in NAMES {
            assert_eq!(name.parse(), Ok(step));
            let (cost, check) = step.once(&head, &case, 10.0).unwrap();
            assert!(cost.wall_s > 0.0 && check > 0.0, "{name}");
        }
    }

    #[test]
    fn an_unknown_step_is_told_with_those_that_are_known() {
        let error = "cerebellum".parse::<Asked>().unwrap_err().to_string();
        assert!(error.contains("closing, distance"), "{error}");
    }
}
