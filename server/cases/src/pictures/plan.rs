//! Several pictures of one request: a list, a sheet, a turn, or a way through the depths.

use render::{NamedView, SheetPlan};
use serde::{Deserialize, Serialize};

use super::request::{CheckedPicture, PictureRequest, picture_size};
use crate::error::Error;

/// The most pictures of one request.
pub const MAX_PICTURES: usize = 256;

/// The greatest depth of a way through the depths, in mm.
const MAX_DEPTH_MM: f32 = 1000.0;

/// Checked pictures, and how they become one answer.
#[derive(Debug, Clone)]
pub struct PicturePlan {
    /// 1 to 256 pictures.
    pub pictures: Vec<CheckedPicture>,
    /// How they are arranged.
    pub layout: Layout,
}

/// How pictures become one answer.
#[derive(Debug, Clone)]
pub enum Layout {
    Separate,
    Sheet {
        plan: SheetPlan,
        /// The row and the column of each picture.
        cells: Vec<[usize; 2]>,
    },
    /// One after the other.
    Animation {
        /// The time of each picture, in ms.
        frame_time_ms: u16,
    },
}

/// A full turn.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Swivel {
    /// Number of pictures.
    #[cfg_attr(feature = "openapi", schema(minimum = 2, maximum = 256))]
    pub frames: u32,
    /// The time of each picture, in ms.
    #[serde(default = "default_delay")]
    #[cfg_attr(
        feature = "openapi",
        schema(minimum = 10, maximum = 10000, default = 80)
    )]
    pub delay_ms: u16,
    /// The picture to turn.
    pub render: PictureRequest,
}

/// A sweep through the depths.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// The first depth, in mm.
    #[cfg_attr(feature = "openapi", schema(minimum = 0))]
    pub from_mm: f32,
    /// The last depth, in mm.
    #[cfg_attr(feature = "openapi", schema(minimum = 0))]
    pub to_mm: f32,
    /// Number of pictures, including the first and the last.
    #[cfg_attr(feature = "openapi", schema(minimum = 2, maximum = 256))]
    pub frames: u32,
    /// The time of each picture, in ms.
    #[serde(default = "default_delay")]
    #[cfg_attr(
        feature = "openapi",
        schema(minimum = 10, maximum = 10000, default = 80)
    )]
    pub delay_ms: u16,
    /// Whether to append the way back; neither end is shown twice.
    #[serde(default)]
    pub there_and_back: bool,
    /// Whether intensities are averaged near the envelope unless `slab_mm` is given: over 1 mm of depth down to a depth
    /// of 1 mm, and over less down to 2 mm. Layers thinner than two voxels show as rings there.
    #[serde(default)]
    pub average_shallow: bool,
    /// The picture, without a depth.
    pub render: PictureRequest,
}

fn default_delay() -> u16 {
    80
}

/// Why pictures cannot be planned.
#[derive(Debug)]
pub enum PlanError {
    /// A picture is invalid.
    Picture(usize, Error),
    /// Another part is invalid: the error as a sentence that begins with its verb.
    Part(Part, String),
}

/// A part of a request for several pictures. Each interface has its own name for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A picture, by its number.
    Picture(usize),
    /// The list of pictures, or the lists of depths and views.
    Pictures,
    /// The keys of the picture that differ from picture to picture, and so must not be given.
    Varied,
    /// The number of pictures of an animation.
    Frames,
    /// The time of each picture of an animation.
    FrameTime,
    FirstDepth,
    LastDepth,
    Sheet,
    /// Width and height of all pictures.
    Pixels,
}

impl PlanError {
    /// The error with the kind and the names of an interface. For the name of a picture, its keys follow after a point.
    pub fn named(self, kind: &'static str, name: impl FnOnce(Part) -> String) -> Error {
        match self {
            Self::Part(part, detail) => Error::Parameter {
                kind,
                name: name(part).into(),
                detail,
            },
            Self::Picture(
                number,
                Error::Parameter {
                    kind,
                    name: key,
                    detail,
                },
            ) => Error::Parameter {
                kind,
                name: match name(Part::Picture(number)) {
                    picture if picture.is_empty() => key,
                    picture => format!("{picture}.{key}").into(),
                },
                detail,
            },
            Self::Picture(_, other) => other,
        }
    }
}

fn refused<T>(part: Part, detail: impl Into<String>) -> Result<T, PlanError> {
    Err(PlanError::Part(part, detail.into()))
}

/// An animation of so many pictures, each shown for a time.
fn animation(frames: u32, delay_ms: u16) -> Result<Layout, PlanError> {
    if !(2..=MAX_PICTURES as u32).contains(&frames) {
        return refused(Part::Frames, "must be 2 to 256");
    }
    if !(10..=10_000).contains(&delay_ms) {
        return refused(Part::FrameTime, "must be 10 to 10000");
    }
    Ok(Layout::Animation {
        frame_time_ms: delay_ms,
    })
}

impl PicturePlan {
    /// One picture.
    ///
    /// # Errors
    /// If it is invalid.
    pub fn one(picture: &PictureRequest) -> Result<Self, PlanError> {
        Self::list(std::slice::from_ref(picture))
    }

    /// Pictures, each for itself.
    ///
    /// # Errors
    /// If they are not 1 to 256, or one is invalid.
    pub fn list(pictures: &[PictureRequest]) -> Result<Self, PlanError> {
        check_count(pictures.len())?;
        Self::each(pictures.iter().cloned(), Layout::Separate)
    }

    /// Pictures of one size on one page, with a row for each depth and a column for each direction, in the order in which they
    /// come.
    ///
    /// # Errors
    /// As [`PicturePlan::list`]; if their format differs, two have one place, or the page is too large.
    pub fn sheet(pictures: &[PictureRequest]) -> Result<Self, PlanError> {
        let plan = Self::list(pictures)?;
        let (mut rows, mut columns, mut cells) = (Vec::new(), Vec::new(), Vec::new());
        let first = &pictures[0];
        for (number, picture) in pictures.iter().enumerate() {
            if format_of(picture) != format_of(first) {
                let detail = "must have the same width, height, colormap and background as the first picture of the sheet, and an overlay only if that has one";
                return refused(Part::Picture(number), detail);
            }
            let cell = [
                place_in(&mut rows, row(picture.depth_mm)),
                place_in(&mut columns, picture.direction()),
            ];
            if cells.contains(&cell) {
                let detail = "has the same depth and direction as another picture of the sheet";
                return refused(Part::Picture(number), detail);
            }
            cells.push(cell);
        }
        plan.on_a_sheet(first, [rows, columns], cells)
    }

    /// A picture on one page with a row for each depth and a column for each view.
    ///
    /// # Errors
    /// If the picture has a depth or a view or is invalid, the pictures are not 1 to 256, or the page is too large.
    pub fn grid(
        picture: &PictureRequest,
        depths_mm: &[f32],
        views: &[NamedView],
    ) -> Result<Self, PlanError> {
        if picture.view.is_some() || picture.orientation.is_some() || picture.depth_mm != 0.0 {
            let detail =
                "must omit `depth_mm`, `view` and `orientation`, which the sheet determines";
            return refused(Part::Varied, detail);
        }
        check_count(depths_mm.len() * views.len())?;
        let (rows, columns) = (0..depths_mm.len(), 0..views.len());
        let cells = rows.flat_map(|row| columns.clone().map(move |column| [row, column]));
        let cells: Vec<_> = cells.collect();
        let pictures = cells.iter().map(|&[row, column]| PictureRequest {
            depth_mm: depths_mm[row],
            view: Some(views[column]),
            ..picture.clone()
        });
        let plan = Self::each(pictures, Layout::Separate)?;
        let rows = depths_mm.iter().copied().map(row).collect();
        let columns = views.iter().map(|view| view.name().to_owned()).collect();
        plan.on_a_sheet(picture, [rows, columns], cells)
    }

    /// A full turn around the vertical axis of the picture.
    ///
    /// # Errors
    /// If the number of pictures, their time or the picture is invalid.
    pub fn turn(swivel: &Swivel) -> Result<Self, PlanError> {
        let count = swivel.frames;
        let layout = animation(count, swivel.delay_ms)?;
        let angle = |step| std::f64::consts::TAU * f64::from(step) / f64::from(count);
        let angles_rad: Vec<_> = (0..count).map(angle).collect();
        Self::turned(&swivel.render, &angles_rad, layout)
    }

    /// A picture turned around its vertical axis by each of some angles.
    ///
    /// # Errors
    /// If they are not 1 to 256, or the picture is invalid.
    pub fn turned(
        picture: &PictureRequest,
        angles_rad: &[f64],
        layout: Layout,
    ) -> Result<Self, PlanError> {
        check_count(angles_rad.len())?;
        let of_picture = |error| PlanError::Picture(0, error);
        picture.checked().map_err(of_picture)?;
        let turned = angles_rad.iter().map(|&angle| picture.turned(angle));
        let turned: Result<Vec<_>, _> = turned.collect();
        Self::each(turned.map_err(of_picture)?, layout)
    }

    /// A picture at depths of equal distances.
    ///
    /// # Errors
    /// If the number of pictures, their time, the depths or the picture is invalid, or the picture has a depth.
    pub fn sweep(sweep: &Sweep) -> Result<Self, PlanError> {
        let picture = &sweep.render;
        let (from_mm, to_mm, frames) = (sweep.from_mm, sweep.to_mm, sweep.frames);
        let layout = animation(frames, sweep.delay_ms)?;
        let checked = picture.checked();
        checked.map_err(|error| PlanError::Picture(0, error))?;
        if picture.depth_mm != 0.0 {
            return refused(
                Part::Varied,
                "is determined by the first and last depth; omit it",
            );
        }
        for (part, depth_mm) in [(Part::FirstDepth, from_mm), (Part::LastDepth, to_mm)] {
            if !(0.0..=MAX_DEPTH_MM).contains(&depth_mm) {
                return refused(part, "must be 0 to 1000 mm");
            }
        }
        let at = |frame: u32| {
            let share = frame as f32 / (frames - 1) as f32;
            let depth_mm = from_mm * (1.0 - share) + to_mm * share;
            let slab_mm = match sweep.average_shallow && picture.slab_mm == 0.0 {
                true => shallow_slab_mm(depth_mm.into()),
                false => picture.slab_mm,
            };
            PictureRequest {
                depth_mm,
                slab_mm,
                ..picture.clone()
            }
        };
        let mut plan = Self::each((0..frames).map(at), layout)?;
        if sweep.there_and_back {
            let back: Vec<_> = plan.pictures[1..plan.pictures.len() - 1].to_vec();
            plan.pictures.extend(back.into_iter().rev());
        }
        if plan.pictures.len() > MAX_PICTURES {
            let detail = "must be 2 to 129, because there and back at most 256 pictures are drawn";
            return refused(Part::Frames, detail);
        }
        Ok(plan)
    }

    /// The same plan, if its pictures have no more pixels in all.
    ///
    /// # Errors
    /// If they have.
    pub fn within(self, most_pixels: usize) -> Result<Self, PlanError> {
        let sizes = self.pictures.iter().map(|picture| &picture.asked);
        let pixels: usize = sizes
            .map(|asked| asked.width as usize * asked.height as usize)
            .sum();
        if pixels > most_pixels {
            let detail = format!("requests {pixels} pixels in all; the limit is {most_pixels}");
            return refused(Part::Pixels, detail);
        }
        Ok(self)
    }

    fn each(
        pictures: impl IntoIterator<Item = PictureRequest>,
        layout: Layout,
    ) -> Result<Self, PlanError> {
        let numbered = pictures.into_iter().enumerate();
        let checked = numbered.map(|(number, picture)| {
            let checked = picture.checked();
            checked.map_err(|error| PlanError::Picture(number, error))
        });
        Ok(Self {
            pictures: checked.collect::<Result<_, _>>()?,
            layout,
        })
    }

    fn on_a_sheet(
        self,
        first: &PictureRequest,
        [rows, columns]: [Vec<String>; 2],
        cells: Vec<[usize; 2]>,
    ) -> Result<Self, PlanError> {
        let cell = picture_size(first.width, first.height);
        let cell = cell.map_err(|error| PlanError::Picture(0, error))?;
        match SheetPlan::new(cell, rows, columns) {
            Ok(plan) => Ok(Self {
                layout: Layout::Sheet { plan, cells },
                ..self
            }),
            Err(error) => refused(Part::Sheet, format!("is not possible: {error}")),
        }
    }
}

fn check_count(count: usize) -> Result<(), PlanError> {
    match (1..=MAX_PICTURES).contains(&count) {
        true => Ok(()),
        false => refused(Part::Pictures, "must contain 1 to 256 pictures"),
    }
}

/// What all pictures of a sheet share.
fn format_of(picture: &PictureRequest) -> impl PartialEq {
    (
        picture.width,
        picture.height,
        picture.colormap,
        picture.background,
        picture.overlay.is_some(),
    )
}

/// The label of a row.
fn row(depth_mm: f32) -> String {
    format!("{depth_mm} mm")
}

/// The place of a label, which is added where it is new.
fn place_in(labels: &mut Vec<String>, label: String) -> usize {
    let known = labels.iter().position(|other| *other == label);
    known.unwrap_or_else(|| {
        labels.push(label);
        labels.len() - 1
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(from_mm: f32, to_mm: f32) -> Sweep {
        Sweep {
            from_mm,
            to_mm,
            frames: 5,
            delay_ms: 80,
            there_and_back: false,
            average_shallow: false,
            render: PictureRequest::default(),
        }
    }

    fn depths(sweep: &Sweep) -> Vec<f32> {
        let plan = PicturePlan::sweep(sweep).unwrap();
        let asked = plan.pictures.iter().map(|picture| picture.asked.depth_mm);
        asked.collect()
    }

    #[test]
    fn a_sweep_shows_neither_end_twice() {
        let mut sweep = sweep(4.0, 12.0);
        assert_eq!(depths(&sweep), [4.0, 6.0, 8.0, 10.0, 12.0]);
        sweep.there_and_back = true;
        let there_and_back = [4.0, 6.0, 8.0, 10.0, 12.0, 10.0, 8.0, 6.0];
        assert_eq!(depths(&sweep), there_and_back);
    }

    #[test]
    fn errors_have_the_names_of_the_interface() {
        let named = |error: PlanError| error.named("kind", |part| format!("{part:?}")).to_string();
        let deep = PictureRequest {
            depth_mm: 3.0,
            ..PictureRequest::default()
        };
        let mut sweep = sweep(0.0, 2000.0);
        let refused = PicturePlan::sweep(&sweep).unwrap_err();
        assert_eq!(named(refused), "`LastDepth` must be 0 to 1000 mm");
        sweep.render = deep.clone();
        let refused = PicturePlan::sweep(&sweep).unwrap_err();
        assert!(named(refused).starts_with("`Varied` is determined"));
        let wrong = PictureRequest {
            depth_mm: -3.0,
            ..PictureRequest::default()
        };
        let refused = PicturePlan::list(&[deep, wrong]).unwrap_err();
        assert!(named(refused).starts_with("`Picture(1).depth_mm` must not be negative"));
    }
}
