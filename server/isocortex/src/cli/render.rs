//! `isocortex render`.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use case::{CaseId, VoxelValues};
use cases::jobs::start_workers;
use cases::pictures::{PictureRequest, PictureSeries, SeriesPicture};
use cases::settings::GpuUse;
use cases::{Error, Library, LibraryOptions};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use http::{query, sent};
use render::choice::Renderer;
use storage::Store;

use super::common::StoreArgs;
use super::prepare::{GRACE, source, wait_until_ready, warn_of_doubts};
use super::status::{CliError, ExitStatus};
use super::voxels::on_store;
use super::{VolumeOptions, check_output, choices, write_output};
use crate::config::{Config, store_options};

/// Draw the cut of a case or a volume as PNG, or write values of its voxels
///
/// A depth beyond the deepest point is drawn at the deepest point.
#[derive(Debug, Args)]
pub(super) struct RenderArgs {
    /// The id of a case in the store, a NIfTI or MGH volume, or DICOM (a folder, a zip, one file).
    #[arg(value_name = "CASE|VOLUME")]
    input: PathBuf,
    #[command(flatten)]
    options: VolumeOptions,
    #[command(flatten)]
    store: StoreArgs,
    /// The PNG file to write; with --nifti, the .nii.gz file.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Instead of a picture, write what the voxels have values of as NIfTI, in the grid of the volume: depths in mm, labels, a map, or the
    /// places that a map lists.
    #[arg(long, value_name = "VALUES", value_parser = choices::voxel_values())]
    nifti: Option<VoxelValues>,
    /// Whether a GPU may draw.
    #[arg(long, value_parser = choices::gpu_use(), env = "ISOCORTEX_GPU", default_value = "auto")]
    gpu: GpuUse,
    #[command(flatten)]
    picture: PictureKeys,
}

/// The keys of `GET /v1/cases/{id}/render` that are given, each as an option: `--depth 8` is `depth_mm=8`.
#[derive(Debug)]
struct PictureKeys(Vec<(String, String)>);

/// The option of a key.
fn option_of(key: &str) -> String {
    let of_length = key.strip_suffix("_mm").unwrap_or(key);
    of_length.replace('_', "-")
}

impl Args for PictureKeys {
    fn augment_args(command: Command) -> Command {
        let keys = query::keys::<PictureRequest>().into_iter();
        let options = keys.map(|(key, words)| {
            let words = words.replace('\n', " ");
            let option = Arg::new(&key).long(option_of(&key)).help(words);
            let option = option.value_name("VALUE");
            match &*key {
                // What follows it is another argument.
                "annotate" => option
                    .num_args(0..=1)
                    .require_equals(true)
                    .default_missing_value("true"),
                // Negative numbers are values.
                _ => option.allow_hyphen_values(true),
            }
        });
        command.next_help_heading("Picture").args(options)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for PictureKeys {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let keys = query::keys::<PictureRequest>().into_iter();
        let given = keys.filter_map(|(key, _)| {
            let value = matches.get_one::<String>(&key)?.clone();
            Some((key, value))
        });
        Ok(Self(given.collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl RenderArgs {
    /// What is wrong with the name of the output, or with keys of a picture that is not drawn.
    fn wrong_output(&self) -> Option<String> {
        let name = self.output.display().to_string();
        let lower = name.to_lowercase();
        match self.nifti {
            Some(_) if !self.picture.0.is_empty() => {
                let option = option_of(&self.picture.0[0].0);
                Some(format!(
                    "`--{option}` is of a picture, and with --nifti none is drawn; omit one of them"
                ))
            }
            Some(_) if !lower.ends_with(".nii.gz") => Some(format!(
                "`--output` {name}: only gzipped NIfTI is written; name the file *.nii.gz"
            )),
            None if self.output.extension().is_some() && !lower.ends_with(".png") => Some(format!(
                "`--output` {name}: only PNG is written; name the file *.png"
            )),
            _ => None,
        }
    }

    fn request(&self) -> Result<PictureRequest, CliError> {
        let pairs = self.picture.0.iter();
        let pairs = pairs.map(|(key, value)| (Cow::from(key), Cow::from(value)));
        sent::from_pairs(pairs).map_err(|error| {
            let option = option_of(&error.path().to_string());
            CliError::new(ExitStatus::Usage, format!("`--{option}` {}", error.inner()))
        })
    }
}

/// Draws one picture, or writes one file of voxels.
pub(super) fn run(args: &RenderArgs) -> Result<(), CliError> {
    let picture = args.request()?.checked()?;
    if let Some(wrong) = args.wrong_output() {
        return Err(CliError::new(ExitStatus::Usage, wrong));
    }
    check_output(&args.output)?;
    let config = args.store.config()?;
    let file = super::block_on(async {
        // Splatting needs no GPU.
        let gpu = match picture.asked.renderer {
            Renderer::Splat => GpuUse::Off,
            _ => args.gpu,
        };
        let layers = picture.asked.layers();
        let named = case_id(&args.input);
        let (store, id) = match named {
            Some(id) => (Store::open(config.location()?, store_options()).await?, id),
            None => prepared(args, &config).await?,
        };
        let cases = on_store(store, gpu, layers.is_any() || args.nifti.is_some())?;
        cases.ready(&id).await?;
        if let Some(values) = args.nifti {
            if values.map().is_some() {
                cases.library.make_maps_now(&id).await?;
            }
            return Ok(cases.nifti(&id, values).await?.bytes);
        }
        if layers.of_case(&cases.library, &id).await?.has_maps() {
            cases.library.make_maps_now(&id).await?;
        }
        let mut series = PictureSeries::of(&cases, &id, [picture]).await?;
        if named.is_none() {
            series = series.unnamed();
        }
        let keep = |png: &mut Vec<u8>, picture: SeriesPicture| {
            *png = picture.encoded()?.png;
            Ok::<_, Error>(())
        };
        Ok(series.draw_each(&cases, Vec::new(), keep).await?)
    })?;
    write_output(&args.output, &file)
}

/// The id of a case, unless there is a file with that name.
fn case_id(input: &Path) -> Option<CaseId> {
    let id = CaseId::parse(input.to_str()?)?;
    (!input.exists()).then_some(id)
}

/// The case of a volume, in a store in memory.
async fn prepared(args: &RenderArgs, config: &Config) -> Result<(Store, CaseId), CliError> {
    let source = source(&args.input, &args.options).await?.source;
    let parameters = args.options.parameters(None)?;
    let store = Store::in_memory(storage::Options::default()).await?;
    let pipeline = args.options.pipeline(config)?;
    let library = Library::new(store.clone(), pipeline.into(), LibraryOptions::default());
    let workers = start_workers(library.clone(), 1);
    let id = library.submit(source, parameters).await?.case.id;
    let ready = wait_until_ready(&store, &id).await;
    workers.shut_down(GRACE).await;
    ready?;
    warn_of_doubts(&store, &id).await?;
    Ok((store, id))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use http::sent::from_query;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        render: RenderArgs,
    }

    fn request(keys: &[&str]) -> Result<PictureRequest, CliError> {
        let line = [&["render", "head.nii", "-o", "a.png"], keys].concat();
        Line::try_parse_from(line).unwrap().render.request()
    }

    #[test]
    fn the_command_line_knows_every_key_of_the_interface() {
        let options = [
            "--annotate",
            "--depth",
            "8",
            "--orientation",
            "-0.5,0,0,1",
            "--window=80,0.5",
            "--window-function",
            "sigmoid",
        ];
        let over_http =
            "depth_mm=8&orientation=-0.5,0,0,1&window=80,0.5&window_function=sigmoid&annotate=true";
        let over_http: PictureRequest = from_query(over_http).unwrap();
        assert_eq!(request(&options).unwrap(), over_http);
        let command = PictureKeys::augment_args(Command::new("render"));
        let known: Vec<_> = command
            .get_arguments()
            .map(|known| known.get_id().as_str())
            .collect();
        let all = serde_json::to_value(over_http).unwrap();
        for key in all.as_object().unwrap().keys() {
            assert!(known.contains(&&**key), "{key}");
        }
    }

    #[test]
    fn a_wrong_picture_is_refused_in_words() {
        for (option, value, words) in [
            ("--depth", "deep", "`--depth` must be a number"),
            ("--view", "above", "`--view` must be one of `left`,"),
        ] {
            let error = request(&[option, value]).unwrap_err();
            assert_eq!(error.status, ExitStatus::Usage);
            assert!(error.message.starts_with(words), "{}", error.message);
        }
        let line = ["render", "head.nii", "-o", "a.png", "--deep", "8"];
        assert!(Line::try_parse_from(line).is_err());
    }
}
