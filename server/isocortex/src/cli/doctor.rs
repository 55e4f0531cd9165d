//! `isocortex doctor`.

use std::io::ErrorKind;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cases::pictures::{Graphics, GraphicsState};
use cases::settings::Render;
use clap::Args;
use pipeline::Extractor;
use pipeline::atlas::Atlas;

use super::demo::colin27;
use super::serve::ServeArgs;
use super::status::CliError;
use crate::config::Config;

/// The configuration of the service that a package installs.
const SERVICE: &str = "/etc/isocortex/isocortex.toml";

/// How long a graphics driver may take to answer.
const DRIVER: Duration = Duration::from_secs(10);

/// Report what is here, what is missing, and the command that mends it
///
/// Takes the options and variables of `serve`. Opens no store and changes nothing.
#[derive(Debug, Clone, Args)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    serve: ServeArgs,
}

/// What was found of one thing: its state, or what is wrong with it and what mends that.
type Finding = Result<String, String>;

/// Prints a line for each thing.
pub(super) fn run(args: &DoctorArgs) -> Result<(), CliError> {
    let config = args.serve.config()?;
    let findings = [
        ("program", program()),
        ("weights", weights(&config)),
        ("demo head", demo_head()),
        ("atlas", atlas(&config)),
        ("graphics", graphics(&config.render)),
        ("processor", processor()),
        ("memory", memory(&config)?),
        ("temporary", temporary()),
        ("address", address(&config)),
        (
            "store",
            of_service(store(&config), args, Path::new(SERVICE)),
        ),
    ];
    for (name, finding) in findings {
        match finding {
            Ok(state) => println!("ok      {name:<10} {state}"),
            Err(problem) => println!("MISSING {name:<10} {problem}"),
        }
    }
    Ok(())
}

fn program() -> Finding {
    let own = std::env::current_exe().and_then(|path| path.canonicalize());
    let own = own.map_err(|error| format!("the file of the program cannot be found: {error}"))?;
    let path = std::env::var_os("PATH").unwrap_or_default();
    let others = std::env::split_paths(&path).map(|folder| folder.join("isocortex"));
    let is_other = |file: &PathBuf| {
        file.canonicalize()
            .is_ok_and(|file| file.is_file() && file != own)
    };
    let mut others = others.filter(is_other);
    match others.next() {
        None => Ok(format!("{} in {}", super::version(), own.display())),
        Some(other) => Err(format!(
            "{} in {}, and another one in {}: remove one with what installed it (`apt`, `pip`, or `rm`)",
            super::version(),
            own.display(),
            other.display()
        )),
    }
}

fn weights(config: &Config) -> Finding {
    let extractor = Extractor::open(config.prepare.network.as_deref());
    let extractor = extractor.map_err(|error| error.to_string())?;
    match extractor.has_network() {
        true => Ok("brains are extracted by the network".to_owned()),
        false => Err(format!(
            "brains are extracted by tree pruning, which is less exact: `pip download --no-deps deepbet==1.0.2`, and name the file {} in ISOCORTEX_NETWORK",
            pipeline::NETWORK_FILE
        )),
    }
}

fn demo_head() -> Finding {
    let missing =
        "the demo shows a synthetic head: `apt install mricron-data`, or set ISOCORTEX_DEMO_VOLUME";
    match colin27() {
        Some(file) => Ok(format!("Colin27, {}", file.display())),
        None => Err(missing.to_owned()),
    }
}

fn atlas(config: &Config) -> Finding {
    let atlas = Atlas::open(&config.prepare.atlas).map_err(|error| error.to_string())?;
    match atlas {
        Some(atlas) => Ok(format!("gyri are named by {}", atlas.path().display())),
        None => Err("gyri have no names: `apt install mricron-data`".to_owned()),
    }
}

/// No device is no fault: the CPU then draws every picture.
fn graphics(render: &Render) -> Finding {
    let graphics = Graphics::start(render);
    let begun = Instant::now();
    while graphics.state() == GraphicsState::Starting && begun.elapsed() < DRIVER {
        std::thread::sleep(Duration::from_millis(20));
    }
    match graphics.state() {
        GraphicsState::Present(adapter) => Ok(adapter.line()),
        GraphicsState::Absent(why) => Ok(format!("the CPU draws, because {why}")),
        GraphicsState::Starting => Err("the driver does not answer: use `--gpu off`".to_owned()),
    }
}

/// A processor with older instructions gives the same results, later.
fn processor() -> Finding {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    #[cfg(target_arch = "x86_64")]
    let kind = match std::arch::is_x86_feature_detected!("avx2") {
        true => "x86-64 with AVX2",
        false => "x86-64 without AVX2: preparations take longer, with the same result",
    };
    #[cfg(not(target_arch = "x86_64"))]
    let kind = std::env::consts::ARCH;
    Ok(format!("{threads} threads, {kind}"))
}

fn memory(config: &Config) -> Result<Finding, CliError> {
    let needed = config.needed_bytes()?;
    Ok(match Config::memory_bytes() {
        None => Ok("unknown".to_owned()),
        Some(there) if there >= needed => Ok(gigabytes(there)),
        Some(there) => Err(format!(
            "{}, and {} may be needed for the largest volume: lower `limits.max_voxels` or `render.cache_bytes`",
            gigabytes(there),
            gigabytes(needed)
        )),
    })
}

fn temporary() -> Finding {
    let folder = std::env::temp_dir();
    match tempfile::tempfile() {
        Ok(_) => Ok(with_free(&folder)),
        Err(error) => Err(format!(
            "{} cannot be written: {error}; set TMPDIR to a folder that can",
            folder.display()
        )),
    }
}

fn address(config: &Config) -> Finding {
    let listen = config.http.listen;
    match TcpListener::bind(listen) {
        Ok(_) => Ok(format!("{listen} is free")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => Ok(format!(
            "{listen} is in use, by the service or by another program: for a second server use `--listen`"
        )),
        Err(error) => Err(format!("{listen}: {error}; use `--listen`")),
    }
}

/// The demo and `render` need none.
fn store(config: &Config) -> Finding {
    let storage = &config.storage;
    let folder = &storage.data;
    if storage.database.is_some() && storage.objects.is_some() {
        return Ok("in a database and a bucket: `isocortex check-store`".to_owned());
    }
    if !folder.is_dir() {
        return Ok(format!(
            "none in {0}; before you serve: `isocortex init-store --data {0}`",
            folder.display()
        ));
    }
    match size_of(folder) {
        Ok(bytes) => Ok(format!("{} in {}", gigabytes(bytes), with_free(folder))),
        Err(error) => Err(format!(
            "{} cannot be read: {error}; run this as the user of the server",
            folder.display()
        )),
    }
}

/// A store that may be another one than meant: whoever names no configuration gets that of the folder they are in.
fn of_service(found: Finding, args: &DoctorArgs, service: &Path) -> Finding {
    let given = &args.serve.common.store;
    let is_named = given.config.is_some()
        || given.data.is_some()
        || given.database.is_some()
        || !service.exists();
    let named = |words| match is_named {
        true => words,
        false => format!(
            "{words}; the service has another one: `--config {}`",
            service.display()
        ),
    };
    found.map(named).map_err(named)
}

/// The bytes of all files below a folder.
fn size_of(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let metadata = entry.metadata()?;
        bytes += match metadata.is_dir() {
            true => size_of(&entry.path())?,
            false => metadata.len(),
        };
    }
    Ok(bytes)
}

/// A folder and the free bytes of its disk.
fn with_free(folder: &Path) -> String {
    let free = rustix::fs::statvfs(folder).map(|disk| disk.f_bavail.saturating_mul(disk.f_frsize));
    let free = free.map(|bytes| format!(", {} free", gigabytes(bytes)));
    format!("{}{}", folder.display(), free.unwrap_or_default())
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.1} GB", bytes as f64 / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_a_folder_is_that_of_all_files_below() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("objects")).unwrap();
        std::fs::write(folder.path().join("rows"), [0; 3]).unwrap();
        std::fs::write(folder.path().join("objects/a"), [0; 4]).unwrap();
        assert_eq!(size_of(folder.path()).unwrap(), 7);
    }

    #[test]
    fn a_missing_store_is_named_with_the_command_that_makes_it() {
        let mut config = Config::default();
        config.storage.data = "/nowhere/cases".into();
        let found = store(&config).unwrap();
        assert!(
            found.contains("`isocortex init-store --data /nowhere/cases`"),
            "{found}"
        );
    }

    #[test]
    fn the_configuration_of_the_service_is_named_unless_one_was_given() {
        #[derive(Debug, clap::Parser)]
        struct Doctor {
            #[command(flatten)]
            args: DoctorArgs,
        }
        let words = |line: &[&str], service: &str| {
            let doctor = <Doctor as clap::Parser>::try_parse_from(line).unwrap();
            of_service(Ok("none".to_owned()), &doctor.args, Path::new(service)).unwrap()
        };
        let here = tempfile::NamedTempFile::new().unwrap();
        let here = here.path().to_str().unwrap();
        assert!(words(&["doctor"], here).ends_with(&format!("`--config {here}`")));
        assert_eq!(words(&["doctor", "--config", "a.toml"], here), "none");
        assert_eq!(words(&["doctor"], "/nowhere"), "none");
    }

    #[test]
    fn an_address_in_use_is_told_from_a_free_one() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut config = Config::default();
        config.http.listen = taken.local_addr().unwrap();
        assert!(address(&config).unwrap().contains("use `--listen`"));
        drop(taken);
        assert!(address(&config).unwrap().ends_with("is free"));
    }
}
