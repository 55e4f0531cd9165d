//! `isocortex-bench agreement`.

use std::path::PathBuf;

use bench::agreement::{markdown, side_by_side, ten_meshes};
use bench::{Backends, BenchError, Machine, PreparedHead, Report};
use clap::Args;
use render::{FrameSize, encode_png};

use super::head::HeadArgs;
use super::{OutputArgs, progress, write};

/// Compare pictures of meshes with exact ones, at five depths
///
/// Ten sizes of mesh are drawn on the CPU from six sides and compared with the traced isosurface. The head is chosen as
/// for `paper`.
#[derive(Debug, Args)]
pub(super) struct AgreementArgs {
    #[command(flatten)]
    head: HeadArgs,
    #[command(flatten)]
    output: OutputArgs,
    /// Side of a picture in pixels, 1 to 4096.
    #[arg(long, default_value_t = 512)]
    size: u32,
    /// Print the table as Markdown.
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// Also write a PNG with a picture from each backend, side by side.
    #[arg(long, value_name = "FILE")]
    side_by_side: Option<PathBuf>,
}

/// Draws, compares and prints.
pub(super) fn run(args: &AgreementArgs) -> Result<(), BenchError> {
    let size = FrameSize::new(args.size, args.size);
    let size = size.map_err(|error| BenchError::Usage(error.to_string()))?;
    args.output.check()?;
    let head = args.head.read()?;
    progress(&format!("preparing {}", head.name));
    let (prepared, _) = PreparedHead::prepare(&head, args.head.closing_radius_mm)?;
    let mut graphics = Backends::on_cpu().graphics;
    if let Some(path) = &args.side_by_side {
        let backends = Backends::open();
        graphics = backends.graphics;
        let sheet = side_by_side(&prepared, &backends.all)?;
        let png = encode_png(&sheet, &[]).map_err(|error| BenchError::unwritable(path, &error))?;
        write(path, &png)?;
    }
    progress("ten meshes compared with exact pictures");
    let table = ten_meshes(&prepared, size)?;
    if args.markdown {
        print!("{}", markdown(&table));
        return Ok(());
    }
    args.output.give(&Report {
        machine: Machine::this(),
        graphics,
        head: args.head.facts(&head, &prepared),
        tables: vec![table],
    })
}
