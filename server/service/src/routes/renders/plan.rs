//! The request for many pictures.

use cases::Error;
use cases::pictures::{Part, PicturePlan, PictureRequest, Sweep, Swivel};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use http::problem::AppError;
use http::refusals::Refusal;
use http::sent::{from_json, json_value};

/// The most pixels of all pictures of one answer.
const MAX_TOTAL_PIXELS: usize = 1 << 26;

/// The kind of the error about a value of the body.
const OUT_OF_RANGE: &str = "body-value-out-of-range";

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

/// Reads a body.
///
/// # Errors
/// An error that names the path of what is wrong.
pub(super) fn parse(body: &[u8]) -> Result<RendersBody, AppError> {
    let unreadable = "body-unreadable";
    let json = json_value(body).map_err(|detail| AppError::invalid(unreadable, ".", detail))?;
    from_json(json).map_err(|(path, refusal)| {
        let kind = match refusal {
            Refusal::UnknownKey { .. } => "body-unknown-key",
            _ => unreadable,
        };
        AppError::invalid(kind, path, refusal)
    })
}

impl RendersBody {
    /// Checks the whole request.
    ///
    /// # Errors
    /// [`Error::Parameter`] that names the path of what is wrong.
    pub(super) fn plan(self) -> Result<PicturePlan, Error> {
        let (path, plan) = match (self.renders, self.swivel, self.sweep) {
            (Some(pictures), None, None) => (
                "renders",
                match self.sheet {
                    true => PicturePlan::sheet(&pictures),
                    false => PicturePlan::list(&pictures),
                },
            ),
            (None, Some(swivel), None) if !self.sheet => ("swivel", PicturePlan::turn(&swivel)),
            (None, None, Some(sweep)) if !self.sheet => ("sweep", PicturePlan::sweep(&sweep)),
            (None, ..) if self.sheet => {
                return Err(out_of_range("sheet", "is only accepted with `renders`"));
            }
            _ => {
                let detail = "must contain exactly one of `renders`, `swivel` and `sweep`";
                return Err(out_of_range(".", detail));
            }
        };
        let plan = plan.and_then(|plan| plan.within(MAX_TOTAL_PIXELS));
        plan.map_err(|error| error.named(OUT_OF_RANGE, |part| path_of(path, part)))
    }
}

fn out_of_range(path: &'static str, detail: &str) -> Error {
    Error::Parameter {
        kind: OUT_OF_RANGE,
        name: path.into(),
        detail: detail.to_owned(),
    }
}

/// The path of a part of `renders`, `swivel` or `sweep`.
fn path_of(path: &str, part: Part) -> String {
    let key = match part {
        Part::Picture(number) if path == "renders" => return format!("renders[{number}]"),
        Part::Picture(_) => "render",
        Part::Varied => "render.depth_mm",
        Part::Frames => "frames",
        Part::FrameTime => "delay_ms",
        Part::FirstDepth => "from_mm",
        Part::LastDepth => "to_mm",
        Part::Pictures => return path.to_owned(),
        Part::Sheet => return "sheet".to_owned(),
        Part::Pixels => return ".".to_owned(),
    };
    format!("{path}.{key}")
}
