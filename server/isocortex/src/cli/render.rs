//! `isocortex render`.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use case::CaseId;
use cases::jobs::Workers;
use cases::pictures::{GpuUse, GraphicsOptions, PictureRequest, PictureSeries, SeriesPicture};
use cases::{Cases, Error, Library, Preparation};
use clap::Args;
use http_support::refusals::Refusal;
use http_support::{query, sent};
use pipeline::Limits;
use render::choice::Renderer;
use storage::{Location, Store};

use super::prepare::{GRACE, source, wait_until_ready, warn_of_doubts};
use super::status::{CliError, ExitStatus};
use super::{VolumeOptions, check_output, choices, write_output};
use crate::config::Config;

/// Draw the cut of a case or a volume as PNG
///
/// A depth beyond the deepest point is drawn at the deepest point.
#[derive(Debug, Args)]
#[command(after_help = keys_in_words())]
pub(super) struct RenderArgs {
    /// The id of a case in the store, a NIfTI volume, or DICOM (a folder, a zip, one file).
    #[arg(value_name = "CASE|VOLUME")]
    input: PathBuf,
    /// The picture: the keys of `GET /v1/cases/{id}/render`, such as depth_mm=8 view=left.
    #[arg(value_name = "KEY=VALUE", value_parser = pair)]
    picture: Vec<(String, String)>,
    #[command(flatten)]
    options: VolumeOptions,
    /// The directory of the store, for a case. [default: isocortex-data]
    #[arg(long, value_name = "DIR", env = "ISOCORTEX_DATA")]
    data: Option<PathBuf>,
    /// The PNG file to write.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// Whether a GPU may draw.
    #[arg(long, value_parser = choices::gpu_use(), env = "ISOCORTEX_GPU", default_value = "auto")]
    gpu: GpuUse,
}

fn pair(text: &str) -> Result<(String, String), &'static str> {
    let (key, value) = text.split_once('=').ok_or("write a key as KEY=VALUE")?;
    Ok((key.to_owned(), value.to_owned()))
}

/// The keys of a picture, for `--help`.
fn keys_in_words() -> String {
    let keys = query::keys::<PictureRequest>();
    let width = keys.iter().map(|(key, _)| key.len()).max().unwrap_or(0);
    let lines = keys.iter().map(|(key, words)| {
        let words = words.replace('\n', " ");
        format!("  {key:width$}  {words}")
    });
    let lines: Vec<_> = lines.collect();
    format!("Keys of the picture:\n{}", lines.join("\n"))
}

impl RenderArgs {
    fn request(&self) -> Result<PictureRequest, CliError> {
        let pairs = self.picture.iter();
        let pairs = pairs.map(|(key, value)| (Cow::from(key), Cow::from(value)));
        sent::from_pairs(pairs).map_err(|error| {
            let subject = match error.inner() {
                Refusal::UnknownKey { .. } | Refusal::KeyTwice { .. } => "the picture".to_owned(),
                _ => format!("`{}`", error.path()),
            };
            CliError::new(ExitStatus::Usage, format!("{subject} {}", error.inner()))
        })
    }
}

/// Draws one picture.
pub(super) fn run(args: &RenderArgs) -> Result<(), CliError> {
    let picture = args.request()?.checked()?;
    check_output(&args.output)?;
    let png = super::block_on(async {
        // Splatting needs no GPU.
        let use_of = match picture.asked.renderer {
            Renderer::Splat => GpuUse::Off,
            _ => args.gpu,
        };
        let layers = picture.asked.layers();
        let named = case_id(&args.input);
        let (store, id) = match named {
            Some(id) => (open(args).await?, id),
            None => prepared(args).await?,
        };
        let library = match layers.is_any() {
            true => Library::with_maps(store, Preparation::default(), Limits::default(), u64::MAX),
            false => Library::of(store),
        };
        let options = cases::Options {
            graphics: GraphicsOptions::of_one(use_of),
            model_cache_bytes: u64::MAX,
            ..Config::default().cases()?
        };
        let cases = Cases::on(library, &options);
        cases.ready(&id).await?;
        if layers.of_case(&cases.library, &id).await?.has_maps() {
            cases.library.maps_now(&id).await?;
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
    write_output(&args.output, &png)
}

/// The id of a case, unless there is a file with that name.
fn case_id(input: &Path) -> Option<CaseId> {
    let id = CaseId::parse(input.to_str()?)?;
    (!input.exists()).then_some(id)
}

/// The store with the case.
async fn open(args: &RenderArgs) -> Result<Store, CliError> {
    let data = args.data.clone();
    let data = data.unwrap_or_else(|| Config::default().storage.data);
    Location::from(&*data).must_exist().await?;
    Ok(Store::open(&data).await?)
}

/// The case of a volume, in a store in memory.
async fn prepared(args: &RenderArgs) -> Result<(Store, CaseId), CliError> {
    let source = source(&args.input, &args.options).await?;
    let parameters = args.options.parameters(None)?;
    let store = Store::in_memory(storage::Options::default()).await?;
    let pipeline = args.options.pipeline()?;
    let library = Library::new(store.clone(), pipeline.into(), Limits::default());
    let workers = Workers::start(library.clone(), 1);
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
        let keys = [
            "depth_mm=8",
            "orientation=-0.5,0,0,1",
            "window=80,0.5",
            "window_function=sigmoid",
            "annotate=true",
        ];
        let over_http =
            "depth_mm=8&orientation=-0.5,0,0,1&window=80,0.5&window_function=sigmoid&annotate=true";
        let over_http = query::parse::<PictureRequest>(over_http).unwrap();
        assert_eq!(request(&keys).unwrap(), over_http.asked);
        let help = keys_in_words();
        let all = serde_json::to_value(over_http.asked).unwrap();
        for key in all.as_object().unwrap().keys() {
            assert!(help.contains(&format!("\n  {key} ")), "{key}");
        }
    }

    #[test]
    fn a_wrong_picture_is_refused_in_words() {
        for (key, words) in [
            ("depth_mm=deep", "`depth_mm` must be a number"),
            ("view=above", "`view` must be one of `left`,"),
            (
                "deep=8",
                "the picture has an unknown key; known: `depth_mm`",
            ),
        ] {
            let error = request(&[key]).unwrap_err();
            assert_eq!(error.status, ExitStatus::Usage);
            assert!(error.message.starts_with(words), "{}", error.message);
        }
    }
}
