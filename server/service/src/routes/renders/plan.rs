//! The request for many pictures, and the checked plan.

use cases::Error;
use cases::pictures::{CheckedPicture, PictureRequest, picture_size};
use render::SheetPlan;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use http_support::problem::AppError;
use http_support::refusals::Refusal;
use http_support::sent::{from_json, json_value};

/// The most pictures in one answer.
const MAX_PICTURES: usize = 256;

/// The most pixels of all pictures of one answer.
const MAX_TOTAL_PIXELS: usize = 1 << 26;

/// A request for many pictures: exactly one of `renders`, `swivel` and `sweep`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RendersBody {
    /// Pictures, each with the keys of a single one: a zip of PNGs, or one contact sheet.
    renders: Option<Vec<PictureRequest>>,
    /// Whether to return `renders` as one PNG with a row for each depth and a column for each direction. All must have
    /// one size.
    #[serde(default)]
    sheet: bool,
    /// A full turn around the vertical axis of the picture, as animated PNG.
    swivel: Option<Swivel>,
    /// A sweep from one depth to another, as animated PNG.
    sweep: Option<Sweep>,
}

/// A full turn.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Swivel {
    /// Number of pictures.
    #[schema(minimum = 2, maximum = 256)]
    frames: u32,
    /// The time of each picture, in ms.
    #[serde(default = "default_delay")]
    #[schema(minimum = 10, maximum = 10000, default = 80)]
    delay_ms: u16,
    /// The picture to turn.
    render: PictureRequest,
}

/// A sweep through the depths.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// The first depth, in mm.
    #[schema(minimum = 0)]
    from_mm: f32,
    /// The last depth, in mm.
    #[schema(minimum = 0)]
    to_mm: f32,
    /// Number of pictures, including the first and the last.
    #[schema(minimum = 2, maximum = 256)]
    frames: u32,
    /// The time of each picture, in ms.
    #[serde(default = "default_delay")]
    #[schema(minimum = 10, maximum = 10000, default = 80)]
    delay_ms: u16,
    /// Whether to append the way back; neither end is shown twice.
    #[serde(default)]
    there_and_back: bool,
    /// Whether intensities are averaged near the envelope unless `slab_mm` is given: over 1 mm of depth down to a depth
    /// of 1 mm, and over less down to 2 mm. Layers thinner than two voxels show as rings there.
    #[serde(default)]
    average_shallow: bool,
    /// The picture, without a depth.
    render: PictureRequest,
}

fn default_delay() -> u16 {
    80
}

/// The checked pictures and their file.
pub(super) struct Plan {
    pub(super) pictures: Vec<CheckedPicture>,
    pub(super) kind: FileKind,
}

/// The kind of file.
pub(super) enum FileKind {
    Zip,
    Sheet {
        plan: SheetPlan,
        cells: Vec<[usize; 2]>,
    },
    Animation {
        delay_ms: u16,
    },
}

impl FileKind {
    /// The values that distinguish files: the kind and the time of each picture.
    pub(super) fn parameters(&self) -> (&'static str, u16) {
        match self {
            Self::Zip => ("zip", 0),
            Self::Sheet { .. } => ("sheet", 0),
            Self::Animation { delay_ms } => ("animation", *delay_ms),
        }
    }
}

/// Reads a body.
///
/// # Errors
/// [`AppError::Query`] that names the path of what is wrong.
pub(super) fn parse(body: &[u8]) -> Result<RendersBody, AppError> {
    let refuse = |kind, path: String, detail| AppError::Query {
        kind,
        parameter: path.into(),
        detail,
    };
    let json =
        json_value(body).map_err(|detail| refuse("body-unreadable", ".".to_owned(), detail))?;
    from_json(json).map_err(|(path, refusal)| {
        let kind = match refusal {
            Refusal::UnknownKey { .. } => "body-unknown-key",
            _ => "body-unreadable",
        };
        refuse(kind, path, refusal.to_string())
    })
}

impl RendersBody {
    /// Checks the whole request.
    ///
    /// # Errors
    /// [`AppError::Query`] that names the path of what is wrong.
    pub(super) fn plan(self) -> Result<Plan, AppError> {
        let plan = match (self.renders, self.swivel, self.sweep) {
            (Some(pictures), None, None) => of_list(&pictures, self.sheet)?,
            (None, Some(swivel), None) if !self.sheet => swivel.plan()?,
            (None, None, Some(sweep)) if !self.sheet => sweep.plan()?,
            (None, ..) if self.sheet => {
                return Err(out_of_range("sheet", "is only accepted with `renders`"));
            }
            _ => {
                let detail = "must contain exactly one of `renders`, `swivel` and `sweep`";
                return Err(out_of_range(".", detail));
            }
        };
        let sizes = plan.pictures.iter();
        let pixels: usize = sizes
            .map(|picture| picture.asked.width as usize * picture.asked.height as usize)
            .sum();
        if pixels > MAX_TOTAL_PIXELS {
            let detail = format!("requests {pixels} pixels; the limit is {MAX_TOTAL_PIXELS}");
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
fn checked_at(path: &str, picture: &PictureRequest) -> Result<CheckedPicture, AppError> {
    picture.checked().map_err(|error| match error {
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

fn of_list(pictures: &[PictureRequest], sheet: bool) -> Result<Plan, AppError> {
    if !(1..=MAX_PICTURES).contains(&pictures.len()) {
        return Err(out_of_range("renders", "must contain 1 to 256 pictures"));
    }
    let numbered = pictures.iter().enumerate();
    let checked = numbered.map(|(number, picture)| checked_at(&place(number), picture));
    let checked = checked.collect::<Result<_, _>>()?;
    Ok(Plan {
        pictures: checked,
        kind: match sheet {
            true => on_a_sheet(pictures)?,
            false => FileKind::Zip,
        },
    })
}

/// The path of a picture of the list.
fn place(number: usize) -> String {
    format!("renders[{number}]")
}

/// Finds each picture's row, by its depth, and column, by its direction, in the order in which they come.
fn on_a_sheet(pictures: &[PictureRequest]) -> Result<FileKind, AppError> {
    let (mut rows, mut columns, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    let first = &pictures[0];
    for (number, picture) in pictures.iter().enumerate() {
        let path = place(number);
        let of_first = (
            first.width,
            first.height,
            first.colormap,
            first.background,
            first.overlay.is_some(),
        );
        if (
            picture.width,
            picture.height,
            picture.colormap,
            picture.background,
            picture.overlay.is_some(),
        ) != of_first
        {
            let detail = "must have the same width, height, colormap and background as the first picture of the sheet, and an overlay only if that has one";
            return Err(out_of_range(&path, detail));
        }
        let cell = [
            place_in(&mut rows, format!("{} mm", picture.depth_mm)),
            place_in(&mut columns, picture.direction()),
        ];
        if cells.contains(&cell) {
            return Err(out_of_range(
                &path,
                "has the same depth and direction as another picture of the sheet",
            ));
        }
        cells.push(cell);
    }
    let cell = picture_size(first.width, first.height)?;
    let plan = SheetPlan::new(cell, rows, columns);
    let plan = plan.map_err(|error| out_of_range("sheet", &format!("is not possible: {error}")))?;
    Ok(FileKind::Sheet { plan, cells })
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
        checked_at("swivel.render", &self.render)?;
        let turned = |frame: u32| {
            let render = self.render.turned(frame, self.frames)?;
            checked_at("swivel.render", &render)
        };
        Ok(Plan {
            pictures: (0..self.frames).map(turned).collect::<Result<_, _>>()?,
            kind: FileKind::Animation {
                delay_ms: self.delay_ms,
            },
        })
    }
}

impl Sweep {
    fn plan(self) -> Result<Plan, AppError> {
        check_frames("sweep", self.frames, self.delay_ms)?;
        checked_at("sweep.render", &self.render)?;
        if self.render.depth_mm != 0.0 {
            return Err(out_of_range(
                "sweep.render.depth_mm",
                "is determined by `from_mm` and `to_mm`; omit it",
            ));
        }
        for (path, depth_mm) in [("sweep.from_mm", self.from_mm), ("sweep.to_mm", self.to_mm)] {
            if !(0.0..=1000.0).contains(&depth_mm) {
                return Err(out_of_range(path, "must be 0 to 1000 mm"));
            }
        }
        let at = |frame: u32| {
            let share = frame as f32 / (self.frames - 1) as f32;
            let depth_mm = self.from_mm * (1.0 - share) + self.to_mm * share;
            let slab_mm = match self.average_shallow && self.render.slab_mm == 0.0 {
                true => shallow_slab_mm(depth_mm.into()),
                false => self.render.slab_mm,
            };
            let render = PictureRequest {
                depth_mm,
                slab_mm,
                ..self.render.clone()
            };
            checked_at("sweep.render", &render)
        };
        let mut pictures = (0..self.frames).map(at).collect::<Result<Vec<_>, _>>()?;
        if self.there_and_back {
            let back: Vec<_> = pictures[1..pictures.len() - 1].to_vec();
            pictures.extend(back.into_iter().rev());
        }
        if pictures.len() > MAX_PICTURES {
            let detail = "must be 2 to 129, because there and back at most 256 pictures are drawn";
            return Err(out_of_range("sweep.frames", detail));
        }
        Ok(Plan {
            pictures,
            kind: FileKind::Animation {
                delay_ms: self.delay_ms,
            },
        })
    }
}

/// How far to either side of a depth near the envelope intensities are averaged. Nothing lies above the envelope, so at
/// a depth of 0 mm the whole millimetre is below.
fn shallow_slab_mm(depth_mm: f64) -> f64 {
    let mean_mm = (2.0 - depth_mm).clamp(0.0, 1.0);
    match mean_mm > 0.0 {
        true => (0.5 * mean_mm).max(mean_mm - depth_mm),
        false => 0.0,
    }
}
