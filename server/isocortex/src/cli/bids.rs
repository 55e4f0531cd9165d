//! `isocortex bids`, called as BIDS Apps are.

mod summary;

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use case::{Layer, Parameters, PlacementFacts, SurfaceName};
use cases::bids::{
    Derivatives, Folder, FolderError, Found, HeadError, HeadFiles, HeadName, HeadRecord, Labels,
    MadeWith, NewHead, OutputError, write_head,
};
use cases::jobs::start_workers;
use cases::settings::GpuUse;
use cases::{Cases, Library, StartError};
use clap::Args;
use geometry::{DeformableModel, MeshSize, ShrunkMesh};
use pipeline::atlas::{Atlas, AtlasChoice};
use pipeline::{Extractor, Source};
use service::wire::{Mesh, gifti, known_triangles};
use tokio::task::JoinSet;

use self::summary::{Row, Summary};
use super::common::{set, set_some};
use super::layers::{LayerFile, add_layer};
use super::prepare::{GRACE, until_ready};
use super::process::told_to_stop;
use super::read_input;
use super::status::{CliError, ExitStatus};
use crate::config::Config;

/// How the file begins that git-annex leaves in place of one that it has not fetched.
const ANNEX_POINTER: &[u8] = b"/annex/objects/";

/// Derive depths, maps, places and reports from the heads of a BIDS folder
///
/// Each T1-weighted volume is a head of its own, with the FLAIR beside it. The results are BIDS derivatives in the grid of the T1-weighted volume,
/// a report for each head, and summary.tsv and summary.html of all. A head whose files are complete and whose volumes are unchanged is not done
/// again: the same command goes on where it was ended. Volumes may be links that lead elsewhere, as DataLad makes them. The exit status is 0
/// if all heads that were asked for are done, and 65 if not; summary.tsv states why.
#[derive(Debug, Args)]
pub(super) struct BidsArgs {
    /// The BIDS folder.
    bids_dir: PathBuf,
    /// The folder of the results, such as BIDS_DIR/derivatives/isocortex; it is made if there is none.
    output_dir: PathBuf,
    /// The level of the analysis: each head by itself.
    #[arg(value_parser = ["participant"])]
    analysis_level: String,
    /// The participants to do, with or without `sub-`. [default: all]
    #[arg(long, alias = "participant_label", value_name = "LABEL", num_args = 1..)]
    participant_label: Vec<String>,
    /// The sessions to do, with or without `ses-`. [default: all]
    #[arg(long, alias = "session_label", value_name = "LABEL", num_args = 1..)]
    session_label: Vec<String>,
    /// Do not check that the folder has the description of a BIDS data set.
    #[arg(long, alias = "skip_bids_validation")]
    skip_bids_validation: bool,
    /// The number of heads to do at a time. One of 256³ voxels needs 0.75 GB of memory, and uses several cores.
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: NonZeroUsize,
    /// The weights of the network that extracts brains. [default: deepbet-1.0.2-py3-none-any.whl beside the program]
    #[arg(long, value_name = "FILE", env = "ISOCORTEX_NETWORK")]
    network: Option<PathBuf>,
    /// The atlas that names gyri, as for `serve`, or none. [default: that of Debian's package mricron-data, if it is installed]
    #[arg(long, value_name = "DIR|FILE|none", env = "ISOCORTEX_ATLAS")]
    atlas: Option<String>,
}

impl BidsArgs {
    fn config(&self) -> Config {
        let mut config = Config {
            prepares_apart: true,
            ..Config::default()
        };
        config.render.gpu = GpuUse::Off;
        set_some(&mut config.prepare.network, self.network.as_ref());
        let atlas = self.atlas.clone().map(AtlasChoice::from);
        set(&mut config.prepare.atlas, atlas.as_ref());
        config
    }
}

impl From<FolderError> for CliError {
    fn from(error: FolderError) -> Self {
        // `BadInput` means that a head is not done.
        Self::new(ExitStatus::NoInput, error)
    }
}

impl From<OutputError> for CliError {
    fn from(error: OutputError) -> Self {
        Self::new(ExitStatus::CannotCreate, error)
    }
}

impl From<HeadError> for CliError {
    fn from(error: HeadError) -> Self {
        match error {
            HeadError::Case(error) => error.into(),
            HeadError::Output(error) => error.into(),
        }
    }
}

/// Does every head that is not done yet.
pub(super) fn run(args: &BidsArgs) -> Result<(), CliError> {
    let config = args.config();
    let labels = Labels {
        participants: &args.participant_label,
        sessions: &args.session_label,
    };
    let folder = Folder::read(&args.bids_dir, labels, !args.skip_bids_validation)?;
    let started = |error: StartError| CliError::from(crate::start::StartError::from(error));
    let extractor = Extractor::open(config.prepare.network.as_deref());
    let extractor = extractor.map_err(|error| started(error.into()))?;
    let atlas = Atlas::open(&config.prepare.atlas).map_err(|error| started(error.into()))?;
    let tag = atlas.as_ref().map_or("", Atlas::tag);
    let made_with = MadeWith::new(env!("CARGO_PKG_VERSION"), extractor.weights_blake3(), tag);
    let out = Derivatives::open(&args.output_dir, &folder.root, &made_with)?;
    let heads = Heads {
        options: config.cases()?,
        raw: folder.root,
        made_with,
        atlas: atlas.map(Arc::new),
        out,
    };
    super::block_on(heads.do_all(folder.heads, folder.others, args.jobs.get()))
}

/// What is needed for each head.
struct Heads {
    options: cases::Options,
    raw: PathBuf,
    made_with: MadeWith,
    atlas: Option<Arc<Atlas>>,
    out: Derivatives,
}

impl Heads {
    async fn do_all(
        self,
        heads: Vec<Found>,
        others: Vec<Found>,
        jobs: usize,
    ) -> Result<(), CliError> {
        let this = Arc::new(self);
        let mut summary = Summary::new(this.out.clone(), &heads, others);
        let mut waiting = heads.into_iter().enumerate();
        let mut running = JoinSet::new();
        let stop = told_to_stop();
        tokio::pin!(stop);
        loop {
            while running.len() < jobs
                && let Some((number, found)) = waiting.next()
            {
                let this = Arc::clone(&this);
                running.spawn(async move { (number, this.row(found).await) });
            }
            let ended = tokio::select! {
                ended = running.join_next() => ended,
                () = &mut stop => return Err(CliError::new(
                    ExitStatus::Unavailable,
                    "stopped; the same command goes on with the heads that are not done",
                )),
            };
            match ended {
                None => break,
                Some(Ok((number, row))) => summary.add(number, row)?,
                Some(Err(error)) => return Err(CliError::new(ExitStatus::Internal, error)),
            }
        }
        summary.end()
    }

    /// Does a head, whatever happens to it.
    async fn row(self: Arc<Self>, found: Found) -> Row {
        let begun = Instant::now();
        let row = Row::new(found.name.clone(), found.notes.clone());
        let (name, notes) = (found.name, found.notes);
        let files = match found.files {
            Ok(files) => files,
            Err(why) => return row.refused(why, begun.elapsed()),
        };
        // Apart, so that a panic ends this head alone.
        let done = tokio::spawn(async move { self.head(name, files, notes, begun).await });
        match done.await {
            Ok(Ok((record, is_new))) => row.done(record, is_new),
            Ok(Err(error)) if is_of_input(&error) => row.refused(error.message, begun.elapsed()),
            Ok(Err(error)) => row.failed(error.message, begun.elapsed()),
            Err(_) => row.failed("internal error".to_owned(), begun.elapsed()),
        }
    }

    /// Does a head, unless it is done; what is recorded of it, and whether that is new.
    async fn head(
        &self,
        name: HeadName,
        files: HeadFiles,
        mut notes: Vec<String>,
        begun: Instant,
    ) -> Result<(HeadRecord, bool), CliError> {
        let most = self.options.limits.max_upload_bytes;
        let (volume, hash) = read(&files.t1w, most).await?;
        let mut source_blake3 = BTreeMap::from([(file_name(&files.t1w), hash)]);
        let mut flair = files.flair.clone();
        if let Some(path) = &files.flair {
            match read(path, most).await {
                Ok((_, hash)) => _ = source_blake3.insert(file_name(path), hash),
                Err(error) if is_of_input(&error) => {
                    notes.push(format!("no FLAIR is used: {}", error.message));
                    flair = None;
                }
                Err(error) => return Err(error),
            }
        }
        let known = self.out.record(&name)?;
        if let Some(known) = known
            && known.made_with == self.made_with
            && known.source_blake3 == source_blake3
        {
            return Ok((known, false));
        }
        self.out.clear(&name)?;
        // A store for each head: nothing of it is left when it ends.
        let opened = Cases::in_memory(&self.options, self.atlas.clone()).await;
        let (cases, library) = opened.map_err(crate::start::StartError::from)?;
        let workers = start_workers(library.clone(), 1);
        let new = NewHead {
            files: HeadFiles { flair, ..files },
            name,
            raw: self.raw.clone(),
            made_with: self.made_with.clone(),
            source_blake3,
            flair: None,
            notes,
            begun,
        };
        let done = self.derive(&cases, &library, volume, new).await;
        workers.shut_down(GRACE).await;
        Ok((done?, true))
    }

    async fn derive(
        &self,
        cases: &Cases,
        library: &Library,
        volume: Bytes,
        mut new: NewHead,
    ) -> Result<HeadRecord, CliError> {
        let source = Source {
            volume,
            ..Source::default()
        };
        let name = new.name.clone();
        let parameters = Parameters {
            name: Some(label(&name.prefix)),
            ..Parameters::default()
        };
        let id = library.submit(source, parameters).await?.case.id;
        until_ready(library.store(), &id, |_| {}).await?;
        if let Some(path) = new.files.flair.clone() {
            let added = add_layer(library.store(), &id, LayerFile::flair(path)).await;
            new.flair = Some(match added {
                Ok(layer) => place(layer),
                Err(error) if is_of_input(&error) => Err(error.message),
                // The same head may have one at the next run.
                Err(error) => return Err(error),
            });
        }
        cases.library.make_maps_now(&id).await?;
        let record = write_head(cases, &id, new, (&self.out, surface_file)).await?;
        self.out.finish(&name, &record)?;
        Ok(record)
    }
}

/// Whether an error is one of a file, and not of the program, the machine or the disk.
fn is_of_input(error: &CliError) -> bool {
    matches!(error.status, ExitStatus::BadInput | ExitStatus::NoInput)
}

fn place(layer: Layer) -> Result<PlacementFacts, String> {
    let facts = layer.facts.map(|facts| facts.placement);
    facts.ok_or_else(|| "it has no place".to_owned())
}

/// The label of a case, for its report.
fn label(prefix: &str) -> String {
    let shown = prefix.chars().filter(|letter| !letter.is_control());
    shown.take(Parameters::MAX_NAME_LENGTH).collect()
}

fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// A volume and its hash.
async fn read(path: &Path, most_bytes: u64) -> Result<(Bytes, String), CliError> {
    let path = path.to_owned();
    let read = move || {
        let bad = |why: String| Err(CliError::new(ExitStatus::BadInput, why));
        if std::fs::metadata(&path).is_ok_and(|file| file.len() > most_bytes) {
            return bad(format!(
                "{} has more than {most_bytes} bytes",
                file_name(&path)
            ));
        }
        let bytes = read_input(&path)?;
        if bytes.starts_with(ANNEX_POINTER) {
            let name = file_name(&path);
            return bad(format!(
                "{name} is a pointer of git-annex; fetch the file first (`datalad get`, `git annex get`)"
            ));
        }
        let hash = blake3::hash(&bytes).to_hex().to_string();
        Ok((bytes, hash))
    };
    let read = tokio::task::spawn_blocking(read).await;
    read.map_err(|error| CliError::new(ExitStatus::Internal, error))?
}

fn surface_file(
    shrunk: &ShrunkMesh,
    model: &DeformableModel,
    size: MeshSize,
    surface: SurfaceName,
) -> Vec<u8> {
    let unknown = shrunk.unknown_vertices(model.field());
    let mesh = Mesh {
        depth_mm: shrunk.depth_mm,
        positions_in_patient: &shrunk.positions_in_patient,
        triangles: &known_triangles(shrunk, size, &unknown),
    };
    gifti(mesh, surface)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory as _;
    use clap::Parser as _;
    use serde_json::Value;

    use super::*;
    use crate::cli::{Cli, Command};

    const BOUTIQUES: &str = include_str!("../../../../docker/bids/boutiques.json");
    const XNAT: &str = include_str!("../../../../docker/bids/command.json");

    fn parsed(line: &[&str]) -> BidsArgs {
        match Cli::try_parse_from(line).map(|cli| cli.command) {
            Ok(Some(Command::Bids(args))) => args,
            other => panic!("{line:?}: {other:?}"),
        }
    }

    #[test]
    fn it_is_called_as_bids_apps_are() {
        let line = "isocortex bids /data /out participant --participant_label 01 sub-02 --session-label a \
                    --skip_bids_validation --jobs 2";
        let args = parsed(&line.split_whitespace().collect::<Vec<_>>());
        assert_eq!(args.participant_label, ["01", "sub-02"]);
        assert_eq!(
            (&*args.session_label, args.jobs.get()),
            (&["a".to_owned()][..], 2)
        );
        assert!(args.skip_bids_validation);
        for wrong in ["group", "participant --jobs 0"] {
            let line = format!("isocortex bids /data /out {wrong}");
            assert!(
                Cli::try_parse_from(line.split_whitespace()).is_err(),
                "{wrong}"
            );
        }
    }

    #[test]
    fn the_descriptor_of_boutiques_has_the_options_of_the_command() {
        let descriptor: Value = serde_json::from_str(BOUTIQUES).unwrap();
        assert_eq!(descriptor["tool-version"], env!("CARGO_PKG_VERSION"));
        let inputs = descriptor["inputs"].as_array().unwrap();
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let described: BTreeSet<_> = inputs.iter().map(|input| text(&input["id"])).collect();
        let command = Cli::command();
        let command = command.find_subcommand("bids").unwrap();
        let known = command
            .get_arguments()
            .map(|known| known.get_id().to_string());
        assert_eq!(described, known.collect());
        let line = text(&descriptor["command-line"]);
        for input in inputs {
            let known = command
                .get_arguments()
                .find(|known| known.get_id() == &*text(&input["id"]));
            let flag = known.unwrap().get_long().map(|long| format!("--{long}"));
            assert_eq!(
                input["command-line-flag"].as_str(),
                flag.as_deref(),
                "{input}"
            );
            assert!(line.contains(&text(&input["value-key"])), "{input}");
            assert_eq!(
                input["optional"],
                !known.unwrap().is_required_set(),
                "{input}"
            );
        }
    }

    #[test]
    fn the_command_of_xnat_is_one_of_the_program() {
        let command: Value = serde_json::from_str(XNAT).unwrap();
        assert_eq!(command["version"], env!("CARGO_PKG_VERSION"));
        let mut line = command["command-line"].as_str().unwrap().to_owned();
        for input in command["inputs"].as_array().unwrap() {
            let [key, value] =
                ["replacement-key", "default-value"].map(|name| input[name].as_str().unwrap());
            line = line.replace(key, value);
        }
        let args = parsed(&line.split_whitespace().collect::<Vec<_>>());
        let mounts = command["mounts"].as_array().unwrap();
        let mounts: Vec<_> = mounts
            .iter()
            .map(|mount| mount["path"].as_str().unwrap())
            .collect();
        assert_eq!(
            mounts,
            [&args.bids_dir, &args.output_dir].map(|path| path.to_str().unwrap())
        );
    }
}
