//! `isocortex render`.

use std::path::{Path, PathBuf};

use case::CaseId;
use cases::models::{Models, PathKind};
use cases::pictures::{
    CheckedPicture, GpuUse, Graphics, GraphicsOptions, ImageMetadata, LayerRef, Numbers,
    PictureJob, PictureLayers, PictureRequest, backend_for, default_picture_count, encode,
    warm_job,
};
use cases::{ConcurrencyLimit, Error, Library, Preparation};
use clap::Args;
use pipeline::Limits;
use render::choice::Renderer;
use render::{Background, ColorMap, NamedView};
use storage::{Location, Store};

use super::case_file::{self, LocalCase};
use super::prepare::{prepare_here, source};
use super::status::{CliError, ExitStatus};
use super::{VolumeOptions, check_output, choices, head_of, read_input, write_output};
use crate::config::Config;

/// Draw the cut of a case, a volume or a prepared file as PNG
///
/// A depth beyond the deepest point is drawn at the deepest point.
#[derive(Debug, Args)]
pub(super) struct RenderArgs {
    /// The id of a case in the store, a NIfTI volume, DICOM (a folder, a zip, one file), or a file from `isocortex
    /// prepare --output`.
    #[arg(value_name = "CASE|VOLUME")]
    input: PathBuf,
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
    #[command(flatten)]
    picture: PictureArgs,
}

/// The picture, with the values of the HTTP interface.
#[derive(Debug, Args)]
struct PictureArgs {
    /// Depth below the envelope, in mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    depth: f32,
    /// The view. [default: left]
    #[arg(long, value_parser = choices::view())]
    view: Option<NamedView>,
    /// The quaternion x,y,z,w from patient to view space, instead of --view.
    #[arg(
        long,
        value_name = "X,Y,Z,W",
        conflicts_with = "view",
        allow_hyphen_values = true
    )]
    orientation: Option<Numbers<4>>,
    /// The renderer.
    #[arg(long, value_parser = choices::renderer(), default_value = "auto")]
    renderer: Renderer,
    /// Width in pixels.
    #[arg(long, default_value_t = 512)]
    width: u32,
    /// Height in pixels.
    #[arg(long, default_value_t = 512)]
    height: u32,
    /// 1 fits the head into the picture.
    #[arg(long, default_value_t = 1.0)]
    zoom: f64,
    /// Moves the head to the right and up, in mm.
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pan: Option<Numbers<2>>,
    /// Window centre and width, in intensities: as in DICOM, the ramp from black to white is W - 1 long about C - 0.5.
    /// [default: that of the case]
    #[arg(long, value_name = "C,W", allow_hyphen_values = true)]
    window: Option<Numbers<2>>,
    /// The colour map.
    #[arg(long, value_parser = choices::colormap(), default_value = "grey")]
    colormap: ColorMap,
    /// Average intensities over this depth to either side, in mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    slab: f64,
    /// The fraction of ambient light, 0 to 1; 1 turns the shading off.
    #[arg(long, default_value_t = 0.3)]
    ambient: f64,
    /// The background.
    #[arg(long, value_parser = choices::background(), default_value = "black")]
    background: Background,
    /// Number of contours of the mesh, for the renderer mesh.
    #[arg(long, default_value_t = default_picture_count())]
    contours: usize,
    /// Number of points on each contour of the mesh, for the renderer mesh.
    #[arg(long, default_value_t = default_picture_count())]
    points: usize,
    /// The paths of the vertices, for the renderer mesh.
    #[arg(long, value_parser = choices::paths(), default_value = "flow")]
    paths: PathKind,
    /// Write the label, day and short id of the case, depth, window, scale, directions and the notice into the picture.
    #[arg(long)]
    annotate: bool,
    /// The layer to show instead of the intensities: a map (blur, sharpness, asymmetry, intensity-asymmetry, junction),
    /// or the name or id of a layer of the case.
    #[arg(long, value_name = "NAME")]
    layer: Option<LayerRef>,
    /// The layer to show in colours over the texture: a map, or the name or id of a layer of the case.
    #[arg(long, value_name = "NAME")]
    overlay: Option<LayerRef>,
    /// The values of the first and last colour of the overlay. [default: from the layer]
    #[arg(
        long,
        value_name = "LOW,HIGH",
        requires = "overlay",
        allow_hyphen_values = true
    )]
    overlay_window: Option<Numbers<2>>,
    /// The colours of the overlay. [default: from the layer]
    #[arg(long, value_parser = choices::colormap(), requires = "overlay")]
    overlay_colormap: Option<ColorMap>,
    /// Values of the overlay up to this are transparent; for diverging colours, magnitudes. [default: from the layer]
    #[arg(
        long,
        value_name = "VALUE",
        requires = "overlay",
        allow_hyphen_values = true
    )]
    overlay_threshold: Option<f64>,
    /// The opacity of the overlay, 0 to 1. [default: from the layer]
    #[arg(long, value_name = "SHARE", requires = "overlay")]
    overlay_opacity: Option<f64>,
}

impl PictureArgs {
    fn checked(&self) -> Result<CheckedPicture, Error> {
        let request = PictureRequest {
            depth_mm: self.depth,
            view: self.view,
            orientation: self.orientation,
            renderer: self.renderer,
            width: self.width,
            height: self.height,
            zoom: self.zoom,
            pan: self.pan,
            window: self.window,
            window_function: None,
            colormap: self.colormap,
            slab_mm: self.slab,
            ambient: self.ambient,
            background: self.background,
            contours: self.contours,
            points: self.points,
            paths: self.paths,
            annotate: self.annotate,
            layer: self.layer.clone(),
            overlay: self.overlay.clone(),
            overlay_window: self.overlay_window,
            overlay_colormap: self.overlay_colormap,
            overlay_threshold: self.overlay_threshold,
            overlay_opacity: self.overlay_opacity,
        };
        request.checked()
    }
}

/// Draws one picture.
pub(super) fn run(args: &RenderArgs) -> Result<(), CliError> {
    let picture = args.picture.checked()?;
    check_output(&args.output)?;
    let png = super::block_on(async {
        // The search runs while the case is read; splatting needs no GPU.
        let use_of = if picture.asked.renderer == Renderer::Splat {
            GpuUse::Off
        } else {
            args.gpu
        };
        let graphics = Graphics::start(GraphicsOptions::of_one(use_of));
        match case_id(&args.input) {
            Some(id) => of_case(args, id, &picture, &graphics).await,
            None => of_file(args, &picture, &graphics).await,
        }
    })?;
    write_output(&args.output, &png)
}

/// The id of a case, unless there is a file with that name.
fn case_id(input: &Path) -> Option<CaseId> {
    let id = CaseId::parse(input.to_str()?)?;
    (!input.exists()).then_some(id)
}

async fn of_case(
    args: &RenderArgs,
    id: CaseId,
    picture: &CheckedPicture,
    graphics: &Graphics,
) -> Result<Vec<u8>, CliError> {
    let data = args.data.clone();
    let data = data.unwrap_or_else(|| Config::default().storage.data);
    Location::from(&*data).must_exist().await?;
    let store = Store::open(&data).await?;
    let choice = picture.asked.layers();
    let library = if choice.is_any() {
        Library::with_maps(store, Preparation::default(), Limits::default(), u64::MAX)
    } else {
        Library::of(store)
    };
    let model = Models::new(library.clone(), u64::MAX).get(&id).await?;
    let model = model.ok_or_else(|| {
        CliError::new(
            ExitStatus::NoInput,
            "the store has no ready case with this id",
        )
    })?;
    let chosen = choice.of_case(&library, &id).await?;
    if chosen.has_maps() {
        library.maps_now(&id).await?;
    }
    let layers = chosen.load(&library, &id).await?;
    let backend = backend_for(picture.asked.renderer, graphics).await;
    let job = warm_job(&model, picture, layers, backend).await?;
    let case = library.store().case(&id).await?;
    let is_named = picture.asked.annotate;
    let named = case.filter(|_| is_named).map(|case| case.identity());
    let metadata = ImageMetadata::of(Some(&id), &job.job).named(named);
    drawn(job, metadata, is_named).await
}

async fn drawn(
    job: PictureJob,
    metadata: ImageMetadata,
    annotate: bool,
) -> Result<Vec<u8>, CliError> {
    let turn = ConcurrencyLimit::new(1, 0).turn().await?;
    let drawn = job.draw(&turn).await?;
    Ok(encode(drawn, &metadata, annotate)?.png)
}

async fn of_file(
    args: &RenderArgs,
    picture: &CheckedPicture,
    graphics: &Graphics,
) -> Result<Vec<u8>, CliError> {
    let is_case = head_of(&args.input)?.starts_with(case_file::MAGIC);
    let case = if is_case {
        case_file::read(&read_input(&args.input)?)?
    } else {
        let source = source(&args.input, &args.options).await?;
        let parameters = args.options.parameters(None)?;
        LocalCase::of(prepare_here(
            &source,
            &parameters,
            &args.options.pipeline()?,
        )?)
    };
    let choice = picture.asked.layers();
    let layers = if choice.is_any() {
        choice.among(&[])?.of_maps(&case.maps()?)?
    } else {
        PictureLayers::default()
    };
    let backend = backend_for(picture.asked.renderer, graphics).await;
    let shrink = async |depth_mm| {
        let shrunk = case.shrink(picture.mesh, picture.asked.paths, depth_mm);
        Ok(shrunk?)
    };
    let job = picture.job(case.keyed(), &case.facts, layers, backend, shrink);
    let job = job.await?;
    let metadata = ImageMetadata::of(None, &job.job);
    drawn(job, metadata, picture.asked.annotate).await
}
