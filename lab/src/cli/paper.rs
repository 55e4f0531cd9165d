//! `isocortex-bench paper`.

use std::path::{Path, PathBuf};

use bench::paper::{Experiment, Protocol, pictures};
use bench::quality::{Judgement, figure_7};
use bench::{BenchError, Machine, PreparedHead, Report, StepCosts, Table};
use clap::{Args, ValueEnum};
use render::FrameSize;

use super::head::HeadArgs;
use super::{OutputArgs, create, progress, write, write_plots};

/// Depth at which meshes are compared with the isosurface, in mm.
const DEPTH_MM: f32 = 10.0;

/// Measure Tables 2 and 3 and Figures 5, 6 and 7 of the paper, and print them beside the published numbers
///
/// The cost of each step of the setup, the frame rate of every renderer while the head turns, the time for a new depth,
/// and the distance of the meshes from the isosurface. Wall-clock and CPU times are medians with their spreads.
///
/// The head is VOLUME with its mask; otherwise Colin27 from Debian's package mricron-data if it is installed; otherwise
/// a synthetic one. This takes some minutes; --quick gives rough figures in seconds. Measure a release build on a quiet
/// machine.
#[derive(Debug, Args)]
pub(super) struct PaperArgs {
    #[command(flatten)]
    head: HeadArgs,
    #[command(flatten)]
    output: OutputArgs,
    /// A renderer; may be given several times. [default: all that this machine has]
    #[arg(long, value_enum)]
    renderer: Vec<Renderer>,
    /// Do not use a graphics device.
    #[arg(long)]
    cpu_only: bool,
    /// Side of a frame in pixels, 1 to 4096.
    #[arg(long, default_value_t = 512)]
    size: u32,
    /// Depth of the inner isosurface, which has no sulci; at most 0.7 of the greatest depth.
    #[arg(long, value_name = "MM", default_value_t = 40.0)]
    inner_depth_mm: f32,
    /// The longest time for a frame rate, in seconds; it ends earlier after four turns.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// The number of repetitions of everything but frames.
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeat: usize,
    /// Rough figures in seconds: short frame rates, one repetition.
    #[arg(long)]
    quick: bool,
    /// Also draw the figures of the paper from this head, as PNG and SVG files, into this directory; it is created if
    /// missing.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// A renderer, on the CPU and on the graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Renderer {
    Splat,
    Mesh,
    Trace,
}

impl Renderer {
    fn name(self) -> &'static str {
        match self {
            Self::Splat => "splat",
            Self::Mesh => "mesh",
            Self::Trace => "trace",
        }
    }
}

/// Measures and prints.
pub(super) fn run(args: &PaperArgs) -> Result<(), BenchError> {
    let protocol = args.protocol()?;
    args.output.check()?;
    if let Some(directory) = &args.pictures {
        create(directory)?;
    }
    let head = args.head.read()?;
    progress(&format!("preparing {}", head.name));
    let prepare = || PreparedHead::prepare(&head, args.head.closing_radius_mm);
    let (mut prepared, costs) = prepare()?;
    let mut runs: Vec<StepCosts> = vec![costs];
    for _ in 1..protocol.repeat {
        let costs;
        (prepared, costs) = prepare()?;
        runs.push(costs);
    }
    let backends = args.backends();
    let experiment = Experiment {
        head: &prepared,
        runs: &runs,
        backends: &backends.all,
        protocol,
        progress: &progress,
    };
    let mut tables = experiment.tables()?;
    progress("Figure 7: meshes compared with the isosurface");
    let judgement = Judgement {
        depth_mm: DEPTH_MM.min(0.5 * prepared.distance.max_depth_mm()),
        size: protocol.size,
    };
    tables.push(figure_7(&prepared, &judgement)?);
    if let Some(directory) = &args.pictures {
        draw(directory, &prepared, &tables)?;
    }
    args.output.give(&Report {
        machine: Machine::this(),
        graphics: backends.graphics,
        head: args.head.facts(&head, &prepared),
        tables,
    })
}

/// Writes the pictures of the figures, and the plots of those that are plots.
fn draw(directory: &Path, head: &PreparedHead, tables: &[Table]) -> Result<(), BenchError> {
    write_plots(directory, tables)?;
    for picture in pictures(head, &progress)? {
        let path = directory.join(picture.name).with_extension("png");
        write(&path, &picture.png)?;
    }
    Ok(())
}

impl PaperArgs {
    fn backends(&self) -> bench::Backends {
        let backends = if self.cpu_only {
            bench::Backends::on_cpu()
        } else {
            bench::Backends::open().for_rates()
        };
        let names: Vec<&str> = self.renderer.iter().map(|one| one.name()).collect();
        backends.only(&names)
    }

    fn protocol(&self) -> Result<Protocol, BenchError> {
        let usage = |message: &str| BenchError::Usage(message.to_owned());
        if !(self.seconds > 0.0 && self.seconds <= 3600.0) {
            return Err(usage("--seconds must be above 0 and at most 3600"));
        }
        if !(0.0..=1000.0).contains(&self.inner_depth_mm) {
            return Err(usage("--inner-depth-mm must be within 0 to 1000"));
        }
        let size = FrameSize::new(self.size, self.size);
        Ok(Protocol {
            seconds: if self.quick {
                self.seconds.min(0.2)
            } else {
                self.seconds
            },
            repeat: if self.quick { 1 } else { self.repeat.max(1) },
            size: size.map_err(|error| usage(&error.to_string()))?,
            inner_depth_mm: self.inner_depth_mm,
        })
    }
}
