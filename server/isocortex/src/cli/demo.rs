//! `isocortex demo`.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::Args;

use super::common::{CommonArgs, StoreArgs};
use super::prepare::wait_until_ready;
use super::serve::{ServeArgs, Server};
use super::status::{CliError, ExitStatus};
use super::{choices, read_input};
use crate::logs;
use case::Parameters;
use cases::settings::GpuUse;
use pipeline::Source;
use pipeline::atlas::ATLAS_FOLDER;

/// The files of Colin27 and its brain mask.
const COLIN27: [&str; 2] = ["ch2.nii.gz", "ch2bet.nii.gz"];

/// The cut that the demo opens with: from here on, cuts are orthogonal to most of the sulci.
const FIRST_CUT: &str = "d=12&v=left";

/// Edge of a voxel of the phantom head, in mm.
const PHANTOM_SPACING_MM: f64 = 1.0;

/// Prepare and serve a sample head, and print the address to open
///
/// The head is ISOCORTEX_DEMO_VOLUME (with the mask ISOCORTEX_DEMO_MASK), otherwise Colin27, which comes with the packages of
/// Isocortex and with the Debian package mricron-data, otherwise a synthetic head. The network extracts the brain of Colin27;
/// without its weights, the ragged mask from mricron-data is used. Nothing is fetched. Without --data, everything is removed
/// when the demo ends.
#[derive(Debug, Args)]
pub(super) struct DemoArgs {
    /// The directory of the store; by default a temporary one.
    #[arg(long, value_name = "DIR", env = "ISOCORTEX_DATA")]
    data: Option<PathBuf>,
    /// The address to listen on. [default: 127.0.0.1:8640, or another port if that is taken]
    #[arg(long, value_name = "ADDR:PORT", env = "ISOCORTEX_LISTEN")]
    listen: Option<SocketAddr>,
    /// The volume to show.
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_DEMO_VOLUME")]
    volume: Option<PathBuf>,
    /// Its brain mask.
    #[arg(
        long,
        value_name = "FILE",
        env = "ISOCORTEX_DEMO_MASK",
        requires = "volume"
    )]
    mask: Option<PathBuf>,
    /// The file with the weights for brain extraction. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// Whether a GPU may draw. [default: auto]
    #[arg(long, value_parser = choices::gpu_use(), env = "ISOCORTEX_GPU")]
    gpu: Option<GpuUse>,
}

impl DemoArgs {
    /// What is served, with the store at `data`.
    fn serve(&self, data: Option<PathBuf>) -> ServeArgs {
        let store = StoreArgs {
            data,
            ..StoreArgs::default()
        };
        ServeArgs {
            common: CommonArgs {
                store,
                create: true,
                network: self.network.clone(),
                log: Some("warn".to_owned()),
                ..CommonArgs::default()
            },
            listen: self.listen,
            gpu: self.gpu,
            ..ServeArgs::default()
        }
    }
}

/// A head to show.
struct Sample {
    name: String,
    source: Source,
}

/// Serves until the process receives a signal to stop.
pub(super) fn run(args: &DemoArgs) -> Result<(), CliError> {
    super::keep_files_private();
    let temporary = match args.data {
        Some(_) => None,
        None => Some(temporary_directory()?),
    };
    let made = temporary.as_ref().map(|made| made.path().to_owned());
    let config = args.serve(args.data.clone().or(made)).config()?;
    logs::start(config.log_format, &config.log);
    super::block_on(async {
        let server = match Server::start(&config).await {
            Err(_) if args.listen.is_none() => Server::start(&on_any_port(config)).await?,
            started => started?,
        };
        let Some((server, _)) = server else {
            return Ok(());
        };
        let sample = sample(args, server.state.cases.library.has_network())?;
        let parameters = Parameters {
            name: Some(sample.name),
            ..Parameters::default()
        };
        let submitted = server
            .state
            .cases
            .library
            .submit(sample.source, parameters)
            .await?;
        let id = submitted.case.id;
        wait_until_ready(server.state.cases.store(), &id).await?;
        let address = format!("http://{}/#{id}&{FIRST_CUT}", server.address);
        println!("Open {address}");
        println!(
            "Drag to turn, scroll to zoom, move the depth slider to peel; double-click a place, and choose `With slices` to see it there."
        );
        println!("{} Ctrl-C ends the demo.", render::RESEARCH_USE_NOTICE);
        open_page(&address);
        server.until_stopped().await;
        Ok(())
    })
}

fn on_any_port(mut config: crate::config::Config) -> crate::config::Config {
    config.http.listen.set_port(0);
    config
}

fn temporary_directory() -> Result<tempfile::TempDir, CliError> {
    let made = tempfile::Builder::new().prefix("isocortex-demo-").tempdir();
    made.map_err(|error| {
        let message = format!(
            "cannot create a temporary directory: {error}; set TMPDIR to a folder that exists and can be written"
        );
        CliError::new(ExitStatus::CannotCreate, message)
    })
}

fn sample(args: &DemoArgs, has_network: bool) -> Result<Sample, CliError> {
    if let Some(volume) = &args.volume {
        println!("The demo shows {}.", volume.display());
        return from_files("Demo", volume, args.mask.as_deref());
    }
    if let Some(volume) = colin27() {
        println!("The demo shows Colin27, a real head.");
        let mask = volume.with_file_name(COLIN27[1]);
        let mask = (!has_network && mask.exists()).then_some(mask);
        return from_files("Colin27", &volume, mask.as_deref());
    }
    println!(
        "No real head was found, so the demo shows a synthetic one. For a real head, install the Debian package mricron-data, \
         or set ISOCORTEX_DEMO_VOLUME (and ISOCORTEX_DEMO_MASK) to NIfTI files."
    );
    phantom()
}

/// Colin27, as it came with the program or with Debian's package.
pub(super) fn colin27() -> Option<PathBuf> {
    let installed = Path::new(ATLAS_FOLDER).join(COLIN27[0]);
    pipeline::shipped(COLIN27[0]).or_else(|| installed.exists().then_some(installed))
}

/// Opens the page where there is a display. Whether that worked does not matter: the address is printed.
fn open_page(address: &str) {
    let has_display = |name| std::env::var_os(name).is_some_and(|display| !display.is_empty());
    let opener = match cfg!(target_os = "macos") {
        true => "open",
        false if has_display("DISPLAY") || has_display("WAYLAND_DISPLAY") => "xdg-open",
        false => return,
    };
    let nothing = std::process::Stdio::null;
    let mut command = std::process::Command::new(opener);
    let _ = command
        .arg(address)
        .stdin(nothing())
        .stdout(nothing())
        .stderr(nothing())
        .spawn();
}

fn from_files(name: &str, volume: &Path, mask: Option<&Path>) -> Result<Sample, CliError> {
    Ok(Sample {
        name: name.to_owned(),
        source: Source {
            volume: read_input(volume)?,
            mask: mask.map(read_input).transpose()?,
            ..Source::default()
        },
    })
}

fn phantom() -> Result<Sample, CliError> {
    let head = geometry::phantom::head(PHANTOM_SPACING_MM);
    let unwritable = |error| CliError::new(ExitStatus::Internal, error);
    Ok(Sample {
        name: "Phantom (not a real head)".to_owned(),
        source: Source {
            volume: imaging::nifti::write_volume(&head.volume)
                .map_err(unwritable)?
                .into(),
            mask: Some(
                imaging::nifti::write_mask(&head.brain)
                    .map_err(unwritable)?
                    .into(),
            ),
            ..Source::default()
        },
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Demo {
        #[command(flatten)]
        args: DemoArgs,
    }

    #[test]
    fn the_demo_can_be_kept_from_a_graphics_device() {
        for (flag, gpu) in [("off", GpuUse::Off), ("always", GpuUse::Always)] {
            let demo = Demo::try_parse_from(["demo", "--gpu", flag]).unwrap();
            assert_eq!(demo.args.serve(None).config().unwrap().render.gpu, gpu);
        }
    }
}
