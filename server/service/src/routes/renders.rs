//! Many pictures in one answer: a zip, a contact sheet or an animation.

use cases::Error;
use std::io::{Cursor, Write as _};
use std::num::NonZeroU32;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::State;
use axum::extract::rejection::BytesRejection;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use render::{AnimatedPng, RenderBackend, Sheet, SheetPlan, Wanted};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::query::{ApiQuery, CasePath, NoQuery};
use super::refusals::without_input;
use super::render::PNG;
use crate::caching::{self, EntityTag};
use crate::negotiate::{Coding, media_type};
use crate::problem::{AppError, Problem};
use crate::state::AppState;
use case::CaseId;
use cases::models::WarmModel;
use cases::pictures::{
    DrawnPicture, ImageMetadata, Numbers, PictureRequest, annotated, backend_for, encode,
    picture_size,
};

const ZIP: &str = "application/zip";

/// The longest body.
pub(super) const MAX_BODY_BYTES: usize = 1 << 20;

/// The most pictures in one answer.
const MAX_PICTURES: usize = 256;

/// The most pixels of all pictures of one answer.
const MAX_TOTAL_PIXELS: usize = 1 << 26;

/// How long a picture waits before it asks again for room in a full queue.
const BACK_OFF: Duration = Duration::from_millis(20);

/// What is asked for: exactly one of `renders`, `swivel` and `sweep`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RendersBody {
    /// Pictures, each with the keys of the single one: a zip of PNGs, or one contact sheet.
    renders: Option<Vec<PictureRequest>>,
    /// Whether `renders` come as one PNG: a row for each depth, a column for each direction. They are then of one size.
    #[serde(default)]
    sheet: bool,
    /// A full turn around the axis that is upright in the picture, as animated PNG.
    swivel: Option<Swivel>,
    /// From one depth to another, as animated PNG.
    sweep: Option<Sweep>,
}

/// A full turn.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Swivel {
    /// Pictures of the turn.
    #[schema(minimum = 2, maximum = 256)]
    frames: u32,
    /// How long each is shown, in ms.
    #[serde(default = "default_delay")]
    #[schema(minimum = 10, maximum = 10000, default = 80)]
    delay_ms: u16,
    /// What turns.
    render: PictureRequest,
}

/// A way through the depths.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// The first depth, in mm.
    #[schema(minimum = 0)]
    from_mm: f32,
    /// The last depth, in mm.
    #[schema(minimum = 0)]
    to_mm: f32,
    /// Pictures on the way, the first and the last among them.
    #[schema(minimum = 2, maximum = 256)]
    frames: u32,
    /// How long each is shown, in ms.
    #[serde(default = "default_delay")]
    #[schema(minimum = 10, maximum = 10000, default = 80)]
    delay_ms: u16,
    /// Whether the way back follows; its pictures count as well.
    #[serde(default)]
    there_and_back: bool,
    /// What is seen, without a depth.
    render: PictureRequest,
}

fn default_delay() -> u16 {
    80
}

/// The pictures to draw, checked, and what becomes of them.
struct Plan {
    pictures: Vec<PictureRequest>,
    form: Form,
}

enum Form {
    Zip,
    Sheet {
        plan: SheetPlan,
        cells: Vec<[usize; 2]>,
    },
    Animation {
        delay_ms: u16,
    },
}

impl Form {
    /// What makes a form another: its name and the time that each picture is shown.
    fn parameters(&self) -> (&'static str, u16) {
        match self {
            Self::Zip => ("zip", 0),
            Self::Sheet { .. } => ("sheet", 0),
            Self::Animation { delay_ms } => ("animation", *delay_ms),
        }
    }
}

/// Many pictures at once
///
/// A JSON object with `renders` (a zip of PNGs, or with `"sheet": true` one contact sheet), `swivel` or `sweep` (animated PNG). At most
/// 256 pictures and 67,108,864 pixels in all.
#[utoipa::path(
    post, path = "/v1/cases/{id}/renders", tag = "pictures",
    params(("id" = String, Path, description = "The case")),
    request_body = RendersBody,
    responses(
        (status = 200, description = "The pictures; a sheet holds the state of each as the PNG text `row 1 column 1` and so on, a JSON object", content((Vec<u8> = "application/zip"), (Vec<u8> = "image/png"), (Vec<u8> = "image/apng")), headers(
            ("X-Isocortex-Renderer" = String, description = "Who drew on what, each once: `splat on cpu; trace on cpu`"),
            ("ETag" = String, description = "The same for the same pictures, whoever asks"),
        )),
        (status = 400, description = "The body is wrong; `parameter` is the path of what is", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No such case", body = Problem, content_type = "application/problem+json"),
        (status = 406, description = "The form is not accepted", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The case is not ready", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "The body is too long", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too much work waits, or it took too long", body = Problem, content_type = "application/problem+json"),
    )
)]
pub async fn create_renders(
    State(state): State<AppState>,
    CasePath(id): CasePath,
    _no_query: ApiQuery<NoQuery>,
    request: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, AppError> {
    let body = body.map_err(|_| AppError::TooLarge {
        limit_bytes: MAX_BODY_BYTES as u64,
    })?;
    let plan = parse(&body)?.plan()?;
    let offered: &'static [&'static str] = match plan.form {
        Form::Zip => &[ZIP],
        Form::Sheet { .. } => &[PNG],
        Form::Animation { .. } => &["image/apng", PNG],
    };
    let kind = media_type(&request, offered)?;
    state.cases.ready(&id).await?;
    let model = state.model(&id).await?;
    let count = plan.pictures.len();
    let asked = (plan.pictures.clone(), plan.form.parameters());
    let collector = Arc::new(Mutex::new(Collector::new(plan.form, count)));
    let mut backends = Vec::new();
    for (number, query) in plan.pictures.iter().enumerate() {
        let backend = draw_one(&state, &model, &id, query, (number, &collector)).await?;
        let name = backend.to_string();
        if !backends.contains(&name) {
            backends.push(name);
        }
    }
    let body = state
        .cases
        .pool
        .run(move || lock(&collector).take().finish())
        .await??;
    let mut response = (StatusCode::OK, body).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let name = HeaderName::from_static("x-isocortex-renderer");
    let backends = backends.join("; ");
    caching::insert(headers, name, &backends);
    let tag = EntityTag::of_answer(&id, "renders", &asked, (&backends, Coding::Identity));
    headers.insert(header::ETAG, tag.header());
    Ok(response)
}

/// Draws a picture and adds it to what is collected; between pictures others get their turn, and a client that left ends the work.
async fn draw_one(
    state: &AppState,
    model: &Arc<WarmModel>,
    id: &CaseId,
    query: &PictureRequest,
    (number, collector): (usize, &Arc<Mutex<Collector>>),
) -> Result<RenderBackend, AppError> {
    let backend = backend_for(query.renderer, &state.cases.graphics).await;
    let picture = state.cases.picture_job(model, query, backend).await?;
    let named = state.cases.identity(id, query.annotate).await?;
    let metadata = ImageMetadata::of(Some(id), &picture.job).named(named);
    loop {
        let (picture, metadata) = (picture.clone(), metadata.clone());
        let (query, collector) = (query.clone(), Arc::clone(collector));
        let work = move |is_wanted: &Wanted<'_>| {
            let drawn = picture.draw(is_wanted)?;
            lock(&collector).add(number, drawn, &metadata, &query)
        };
        match state.cases.pool.run_while(work).await {
            // A single picture is refused then; these have begun, and their time is bounded.
            Err(Error::Busy) if number > 0 => tokio::time::sleep(BACK_OFF).await,
            answer => return answer?,
        }
    }
}

fn lock(collector: &Mutex<Collector>) -> std::sync::MutexGuard<'_, Collector> {
    collector.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads a body.
///
/// # Errors
/// [`AppError::Query`] that names the path of what is wrong.
fn parse(body: &[u8]) -> Result<RendersBody, AppError> {
    let mut json = serde_json::Deserializer::from_slice(body);
    let parsed = serde_path_to_error::deserialize(&mut json);
    let refuse = |kind, path: String, detail: String| AppError::Query {
        kind,
        parameter: path.into(),
        detail,
    };
    let body = parsed.map_err(|error: serde_path_to_error::Error<serde_json::Error>| {
        let path = error.path().to_string();
        let reason = error.inner().to_string();
        if reason.starts_with("unknown field") {
            // The key itself is not repeated.
            let place = path.rsplit_once('.').map_or(".", |(place, _)| place);
            return refuse("body-unknown-key", place.to_owned(), without_input(&reason));
        }
        let detail = match error.inner().classify() {
            serde_json::error::Category::Data => without_input(&reason),
            _ => {
                return refuse(
                    "body-unreadable",
                    ".".to_owned(),
                    format!("is not JSON: {reason}"),
                );
            }
        };
        refuse("body-unreadable", path, detail)
    })?;
    json.end().map_err(|_| {
        refuse(
            "body-unreadable",
            ".".to_owned(),
            "has more after the object".to_owned(),
        )
    })?;
    Ok(body)
}

impl RendersBody {
    fn plan(self) -> Result<Plan, AppError> {
        let plan = match (self.renders, self.swivel, self.sweep) {
            (Some(pictures), None, None) => of_list(pictures, self.sheet)?,
            (None, Some(swivel), None) if !self.sheet => swivel.plan()?,
            (None, None, Some(sweep)) if !self.sheet => sweep.plan()?,
            (None, ..) if self.sheet => {
                return Err(out_of_range("sheet", "goes with `renders` alone"));
            }
            _ => {
                let detail = "must hold exactly one of `renders`, `swivel` and `sweep`";
                return Err(out_of_range(".", detail));
            }
        };
        let sizes = plan.pictures.iter();
        let pixels: usize = sizes
            .map(|picture| picture.width as usize * picture.height as usize)
            .sum();
        if pixels > MAX_TOTAL_PIXELS {
            let detail =
                format!("asks for {pixels} pixels; at most {MAX_TOTAL_PIXELS} are drawn at once");
            return Err(out_of_range(".", &detail));
        }
        Ok(plan)
    }
}

fn out_of_range(path: &str, detail: &str) -> AppError {
    AppError::Query {
        kind: "body-value-out-of-range",
        parameter: path.to_owned().into(),
        detail: detail.to_owned(),
    }
}

/// Checks a picture at a place of the body.
fn check_at(path: &str, picture: &PictureRequest) -> Result<(), AppError> {
    picture.check().map_err(|error| match error {
        Error::Parameter { kind, name, detail } => AppError::Query {
            kind,
            parameter: format!("{path}.{name}").into(),
            detail,
        },
        other => other.into(),
    })
}

fn check_frames(path: &str, frames: u32, delay_ms: u16) -> Result<(), AppError> {
    if !(2..=MAX_PICTURES as u32).contains(&frames) {
        return Err(out_of_range(&format!("{path}.frames"), "must be 2 to 256"));
    }
    if !(10..=10_000).contains(&delay_ms) {
        return Err(out_of_range(
            &format!("{path}.delay_ms"),
            "must be 10 to 10000",
        ));
    }
    Ok(())
}

fn of_list(pictures: Vec<PictureRequest>, sheet: bool) -> Result<Plan, AppError> {
    if !(1..=MAX_PICTURES).contains(&pictures.len()) {
        return Err(out_of_range("renders", "must hold 1 to 256 pictures"));
    }
    for (number, picture) in pictures.iter().enumerate() {
        check_at(&format!("renders[{number}]"), picture)?;
    }
    let form = if sheet {
        on_a_sheet(&pictures)?
    } else {
        Form::Zip
    };
    Ok(Plan { pictures, form })
}

/// Finds each picture's row, by its depth, and column, by its direction, in the order in which they come.
fn on_a_sheet(pictures: &[PictureRequest]) -> Result<Form, AppError> {
    let (mut rows, mut columns, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    let first = &pictures[0];
    for (number, picture) in pictures.iter().enumerate() {
        let path = format!("renders[{number}]");
        let of_first = (first.width, first.height, first.colormap, first.background);
        if (
            picture.width,
            picture.height,
            picture.colormap,
            picture.background,
        ) != of_first
        {
            let detail = "must have the width, height, colormap and background of the first picture of its sheet";
            return Err(out_of_range(&path, detail));
        }
        let cell = [
            place_in(&mut rows, format!("{} mm", picture.depth_mm)),
            place_in(&mut columns, picture.direction()),
        ];
        if cells.contains(&cell) {
            return Err(out_of_range(
                &path,
                "has the depth and direction of another picture of its sheet",
            ));
        }
        cells.push(cell);
    }
    let cell = picture_size(first.width, first.height)?;
    let plan = SheetPlan::new(cell, rows, columns);
    let plan = plan.map_err(|error| out_of_range("sheet", &format!("is not possible: {error}")))?;
    Ok(Form::Sheet { plan, cells })
}

/// The place of a label, which is added where it is new.
fn place_in(labels: &mut Vec<String>, label: String) -> usize {
    let known = labels.iter().position(|other| *other == label);
    known.unwrap_or_else(|| {
        labels.push(label);
        labels.len() - 1
    })
}

impl Swivel {
    fn plan(self) -> Result<Plan, AppError> {
        check_frames("swivel", self.frames, self.delay_ms)?;
        check_at("swivel.render", &self.render)?;
        let any_window = render::Window::between(0.0, 1.0);
        let request = self.render.at(0.0, any_window)?;
        let start = request.parameters().camera.orientation();
        let turned = |frame: u32| {
            let angle = std::f64::consts::TAU * f64::from(frame) / f64::from(self.frames);
            PictureRequest {
                view: None,
                orientation: Some(Numbers(
                    (glam::DQuat::from_rotation_y(angle) * start).to_array(),
                )),
                ..self.render.clone()
            }
        };
        Ok(Plan {
            pictures: (0..self.frames).map(turned).collect(),
            form: Form::Animation {
                delay_ms: self.delay_ms,
            },
        })
    }
}

impl Sweep {
    fn plan(self) -> Result<Plan, AppError> {
        check_frames("sweep", self.frames, self.delay_ms)?;
        check_at("sweep.render", &self.render)?;
        if self.render.depth_mm != 0.0 {
            return Err(out_of_range(
                "sweep.render.depth_mm",
                "is given by `from_mm` and `to_mm`",
            ));
        }
        for (path, depth_mm) in [("sweep.from_mm", self.from_mm), ("sweep.to_mm", self.to_mm)] {
            if !(0.0..=1000.0).contains(&depth_mm) {
                return Err(out_of_range(path, "must be 0 to 1000 mm"));
            }
        }
        let at = |frame: u32| {
            let share = frame as f32 / (self.frames - 1) as f32;
            PictureRequest {
                depth_mm: self.from_mm * (1.0 - share) + self.to_mm * share,
                ..self.render.clone()
            }
        };
        let mut pictures: Vec<_> = (0..self.frames).map(at).collect();
        if self.there_and_back {
            // Neither end is shown twice.
            pictures.extend((1..self.frames - 1).rev().map(at));
        }
        if pictures.len() > MAX_PICTURES {
            let detail = "must be 2 to 129: there and back, at most 256 pictures are drawn";
            return Err(out_of_range("sweep.frames", detail));
        }
        Ok(Plan {
            pictures,
            form: Form::Animation {
                delay_ms: self.delay_ms,
            },
        })
    }
}

/// The state of a picture of a sheet as one PNG text: `row 1 column 2`, counted from 1, and a JSON object.
fn state_of_cell([row, column]: [usize; 2], texts: &[(&'static str, String)]) -> (String, String) {
    let state: serde_json::Map<String, serde_json::Value> = texts
        .iter()
        .map(|(name, text)| ((*name).to_owned(), text.as_str().into()))
        .collect();
    let name = format!("row {} column {}", row + 1, column + 1);
    (name, serde_json::Value::Object(state).to_string())
}

/// Pictures on their way into one file.
enum Collector {
    Zip(Box<zip::ZipWriter<Cursor<Vec<u8>>>>),
    Sheet {
        plan: Option<SheetPlan>,
        sheet: Option<Box<Sheet>>,
        cells: Vec<[usize; 2]>,
        /// A PNG text for each picture.
        states: Vec<(String, String)>,
    },
    Animation {
        animation: Option<AnimatedPng>,
        frames: u32,
        delay_ms: u16,
    },
    Taken,
}

impl Collector {
    fn new(form: Form, count: usize) -> Self {
        match form {
            Form::Zip => Self::Zip(Box::new(zip::ZipWriter::new(Cursor::default()))),
            Form::Sheet { plan, cells } => Self::Sheet {
                plan: Some(plan),
                sheet: None,
                cells,
                states: Vec::new(),
            },
            Form::Animation { delay_ms } => Self::Animation {
                animation: None,
                frames: count as u32,
                delay_ms,
            },
        }
    }

    fn take(&mut self) -> Self {
        std::mem::replace(self, Self::Taken)
    }

    fn add(
        &mut self,
        number: usize,
        drawn: DrawnPicture,
        metadata: &ImageMetadata,
        query: &PictureRequest,
    ) -> Result<RenderBackend, AppError> {
        let backend = drawn.backend.clone();
        match self {
            Self::Zip(zip) => {
                let depth = query.depth_mm;
                let name = format!(
                    "{number:03}-{}-{depth}mm.png",
                    query.direction().replace(',', "_")
                );
                let png = encode(drawn, metadata, query.annotate)?.png;
                let options = zip::write::SimpleFileOptions::default()
                    .compression_method(zip::CompressionMethod::Stored);
                let started = zip.start_file(name, options);
                started.map_err(|_| Error::Internal)?;
                zip.write_all(&png).map_err(|_| Error::Internal)?;
            }
            Self::Sheet {
                plan,
                sheet,
                cells,
                states,
            } => {
                let frame = annotated(drawn.rendered.frame, metadata, query.annotate);
                if let Some(plan) = plan.take() {
                    *sheet = Some(Box::new(plan.begin(frame.format())));
                }
                let [row, column] = cells[number];
                let sheet = sheet.as_mut().ok_or(Error::Internal)?;
                sheet.put(&frame, row, column);
                states.push(state_of_cell([row, column], &metadata.texts(&backend)));
            }
            Self::Animation {
                animation,
                frames,
                delay_ms,
            } => {
                let frame = annotated(drawn.rendered.frame, metadata, query.annotate);
                if animation.is_none() {
                    let frames = NonZeroU32::new(*frames).ok_or(Error::Internal)?;
                    let texts = metadata.texts(&backend);
                    let begun =
                        AnimatedPng::begin(frame.size(), frame.format(), frames, *delay_ms, &texts);
                    *animation = Some(begun?);
                }
                animation.as_mut().ok_or(Error::Internal)?.add(&frame)?;
            }
            Self::Taken => return Err(Error::Internal.into()),
        }
        Ok(backend)
    }

    fn finish(self) -> Result<Vec<u8>, AppError> {
        match self {
            Self::Zip(zip) => {
                let finished = zip.finish().map_err(|_| Error::Internal)?;
                Ok(finished.into_inner())
            }
            Self::Sheet { sheet, states, .. } => {
                let frame = sheet.ok_or(Error::Internal)?.finish();
                let mut texts = vec![("Software", super::render::SOFTWARE.to_owned())];
                let states = states
                    .iter()
                    .map(|(name, state)| (name.as_str(), state.clone()));
                texts.extend(states);
                Ok(render::encode_png(&frame, &texts)?)
            }
            Self::Animation { animation, .. } => Ok(animation.ok_or(Error::Internal)?.finish()?),
            Self::Taken => Err(Error::Internal.into()),
        }
    }
}
