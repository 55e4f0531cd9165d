//! `isocortex bench`.

mod cases;
mod client;
mod filled;
mod load;
mod painters;
mod served;
mod telling;
mod turns;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use measure::growth::{Extent, Growth};
use measure::paper::{Experiment, Protocol, Telling as _};
use measure::quality::{Judgement, figure_7};
use measure::{
    Head, HeadFacts, Machine, MeasureError, MeasuredCase, Report, StepCosts, Table, pictures,
};
use render::FrameSize;

use self::load::Load;
use self::painters::Painters;
use self::telling::OnStandardError;
use super::status::{CliError, ExitStatus};
use super::{choices, demo, read_input, write_output};
use ::cases::pictures::GpuUse;
use case::Parameters;
use render::choice::Renderer;

/// Depth at which meshes are held against the isosurface and growth is measured, in mm.
const DEPTH_MM: f32 = 10.0;

/// Seconds at most for each kind of request and number of clients.
const LOAD_SECONDS: f64 = 3.0;

/// Edge of a voxel of the phantom head where no real one is found, in mm.
const PHANTOM_MM: f64 = 1.0;

/// Measure this machine by the experiments of the paper
///
/// Prints the paper's Tables 2 and 3 and its Figures 5, 6 and 7 as numbers, with the paper's own beside them: what each step of the
/// setup takes, how fast the head turns in every renderer, how long a new depth takes, and how far the meshes are from the
/// isosurface. Wall and processor times are medians; spreads are given.
///
/// The head is VOLUME with its mask; else Colin27 of Debian's package mricron-data where that is installed; else a made-up one.
/// The whole takes some minutes; --quick gives rough figures in seconds. Measure on a quiet machine, in a release build.
#[derive(Debug, Args)]
pub(super) struct BenchArgs {
    /// An MR volume, NIfTI.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_DEMO_VOLUME",
        requires = "mask"
    )]
    volume: Option<PathBuf>,
    /// Its brain mask, NIfTI.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_DEMO_MASK",
        requires = "volume"
    )]
    mask: Option<PathBuf>,
    /// Measure on the made-up head with voxels of this size, 0.5 to 4 mm.
    #[arg(long, value_name = "MM", conflicts_with = "volume", value_parser = phantom_spacing)]
    phantom: Option<f64>,
    /// Radius of the ball that closes the brain mask to the envelope, 0 to 50 mm.
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    closing_radius_mm: f64,
    /// Who draws; may be given several times. [default: all that this machine can]
    #[arg(long, value_parser = choices::renderer())]
    renderer: Vec<Renderer>,
    /// Whether pictures may be drawn by a graphics device.
    #[arg(long, value_parser = choices::gpu_use(), env = "ISOCORTEX_GPU", default_value = "auto")]
    gpu: GpuUse,
    /// Pixels along a side of a frame, 1 to 4096.
    #[arg(long, default_value_t = 512)]
    size: u32,
    /// Depth of the inner isosurface, on which no sulci are left; at most seven tenths of the greatest depth.
    #[arg(long, value_name = "MM", default_value_t = 40.0)]
    inner_depth_mm: f32,
    /// Seconds at most for a frame rate; four turns end it before.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// How often what is not a frame is measured.
    #[arg(long, value_name = "N", default_value_t = 5)]
    repeat: usize,
    /// Threads to use. [default: all]
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Measure instead how everything grows: with volume, triangles, pixels, threads, and cases in the store.
    #[arg(long)]
    growth: bool,
    /// Measure instead how many requests a second a server of its own answers, to 1 to 256 clients at a time.
    #[arg(long)]
    load: bool,
    /// Do one step for each name that is read from standard input, for a script that measures other programs in between.
    #[arg(long, value_name = "DIR", hide = true)]
    take_turns: Option<PathBuf>,
    /// Rough figures in seconds: short frame rates, one repetition, small ends of every growth.
    #[arg(long)]
    quick: bool,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
    /// Also write the figures as SVG files into this directory, which is made where it is missing.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

fn phantom_spacing(text: &str) -> Result<f64, String> {
    let spacing_mm: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.5..=4.0).contains(&spacing_mm) {
        Ok(spacing_mm)
    } else {
        Err("not within 0.5 to 4 mm".to_owned())
    }
}

/// Measures and prints.
pub(super) fn run(args: &BenchArgs) -> Result<(), CliError> {
    let protocol = args.protocol()?;
    if let Some(directory) = &args.plot {
        std::fs::create_dir_all(directory).map_err(|error| {
            let message = format!("{} cannot be made: {error}", directory.display());
            CliError::new(ExitStatus::CannotCreate, message)
        })?;
    }
    use_threads(args.threads)?;
    let head = args.head()?;
    let tell = OnStandardError;
    tell.tell(&format!("preparing {}", head.name));
    let (case, runs) = prepare(&head, args.closing_radius_mm, protocol.repeat)?;
    if let Some(directory) = &args.take_turns {
        return turns::take_turns(&head, &case, args.closing_radius_mm, directory);
    }
    let painters = if args.load && !args.growth {
        Painters::none()
    } else {
        Painters::open(&args.renderer, args.gpu)
    };
    let mut tables = Vec::new();
    if args.growth {
        let growth = Growth {
            head: &head,
            case: &case,
            closing_radius_mm: args.closing_radius_mm,
            painters: &painters.all,
            extent: args.extent(),
            depth_mm: DEPTH_MM.min(0.5 * case.distance.max_depth_mm()),
            tell: &tell,
        };
        tables.extend(growth.tables()?);
        let most = if args.quick { 10 } else { 1000 };
        tables.push(super::block_on(cases::table(most, &tell))?);
    }
    if args.load {
        let load = args.load_of();
        tables.push(super::block_on(load::table(&head, load, &tell))?);
    }
    if !args.growth && !args.load {
        let experiment = Experiment {
            case: &case,
            runs: &runs,
            painters: &painters.all,
            protocol,
            tell: &tell,
        };
        tables.extend(paper(&experiment)?);
    }
    let report = Report {
        machine: Machine::this(),
        graphics: painters.graphics,
        head: HeadFacts::of(&head.name, &case, args.closing_radius_mm),
        tables,
    };
    if let Some(directory) = &args.plot {
        write_plots(&report.tables, directory)?;
    }
    if args.json {
        println!("{:#}", report.json());
    } else {
        print!("{}", report.text());
    }
    Ok(())
}

/// The paper's tables, and the quality of its meshes.
fn paper(experiment: &Experiment<'_>) -> Result<Vec<Table>, CliError> {
    let mut tables = experiment.tables()?;
    experiment
        .tell
        .tell("Figure 7: meshes against the isosurface");
    let deepest = experiment.case.distance.max_depth_mm();
    let judgement = Judgement {
        depth_mm: DEPTH_MM.min(0.5 * deepest),
        size: experiment.protocol.size,
    };
    tables.push(figure_7(experiment.case, &judgement)?);
    Ok(tables)
}

fn write_plots(tables: &[Table], directory: &Path) -> Result<(), CliError> {
    for (name, plot) in tables.iter().flat_map(pictures) {
        write_output(
            &directory.join(format!("{name}.svg")),
            plot.svg().as_bytes(),
        )?;
    }
    Ok(())
}

/// Prepares the head again and again, and keeps the last.
fn prepare(
    head: &Head,
    closing_radius_mm: f64,
    repeat: usize,
) -> Result<(Arc<MeasuredCase>, Vec<StepCosts>), CliError> {
    let parameters = Parameters {
        closing_radius_mm,
        ..Parameters::default()
    };
    parameters
        .check()
        .map_err(|failure| CliError::new(ExitStatus::Usage, failure.detail))?;
    let (mut case, costs) = MeasuredCase::prepare(head, closing_radius_mm)?;
    let mut runs = vec![costs];
    for _ in 1..repeat {
        let (again, costs) = MeasuredCase::prepare(head, closing_radius_mm)?;
        case = again;
        runs.push(costs);
    }
    Ok((Arc::new(case), runs))
}

fn use_threads(threads: Option<usize>) -> Result<(), CliError> {
    let Some(threads) = threads else {
        return Ok(());
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build_global()
        .map_err(|error| CliError::new(ExitStatus::Unavailable, error))
}

impl BenchArgs {
    fn protocol(&self) -> Result<Protocol, CliError> {
        let usage = |message: &str| CliError::new(ExitStatus::Usage, message);
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
            size: size.map_err(|error| CliError::new(ExitStatus::Usage, error))?,
            inner_depth_mm: self.inner_depth_mm,
        })
    }

    fn extent(&self) -> Extent {
        if self.quick {
            Extent {
                volume_side: 128,
                triangles: 8000,
                picture_side: 512,
                repeat: 1,
            }
        } else {
            Extent {
                repeat: self.repeat.clamp(1, Extent::full().repeat),
                ..Extent::full()
            }
        }
    }

    fn load_of(&self) -> Load {
        if self.quick {
            Load {
                seconds: 0.2,
                connections: 16,
            }
        } else {
            Load {
                seconds: LOAD_SECONDS.min(self.seconds),
                connections: usize::MAX,
            }
        }
    }

    /// The head that was asked for, or the best that there is.
    fn head(&self) -> Result<Head, CliError> {
        if let Some((volume, mask)) = self.volume.as_ref().zip(self.mask.as_ref()) {
            let name = volume.file_name().unwrap_or_default().to_string_lossy();
            return from_files(&name, [volume, mask]);
        }
        match (self.phantom, demo::colin27()) {
            (None, Some(files)) => from_files("Colin27", files),
            (spacing_mm, _) => Ok(Head::phantom(spacing_mm.unwrap_or(PHANTOM_MM))?),
        }
    }
}

fn from_files(name: &str, [volume, mask]: [&Path; 2]) -> Result<Head, CliError> {
    Ok(Head {
        name: name.to_owned(),
        volume: read_input(volume)?.to_vec(),
        mask: read_input(mask)?.to_vec(),
    })
}

impl From<MeasureError> for CliError {
    fn from(error: MeasureError) -> Self {
        let status = match &error {
            MeasureError::Imaging(_)
            | MeasureError::Geometry(_)
            | MeasureError::MaskOutsideVolume => ExitStatus::BadInput,
            MeasureError::Gpu(_) => ExitStatus::Unavailable,
            _ => ExitStatus::Internal,
        };
        Self::new(status, error)
    }
}
