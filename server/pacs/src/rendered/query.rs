//! The query for a picture (PS3.18 §8.3.5.3), and what is drawn for it.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use case::{CaseFacts, SphereFacts, SurfaceName};
use cases::Error;
use cases::pictures::{
    CheckedPicture, Layout, MAX_PICTURES, Numbers, Part, PicturePlan, PictureRequest, PlanError,
    window_of,
};
use glam::{DMat3, DQuat, DVec3};
use render::WindowFunction;
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::Type;
use utoipa::openapi::{ObjectBuilder, Required};

use http::problem::AppError;
use http::sent::from_pairs;

/// The depth if none is requested, in mm: cuts are orthogonal to most sulci there.
const USUAL_DEPTH_MM: f32 = 8.0;

/// Width and height of a picture, if none are requested.
const USUAL_SIDE: u32 = 512;

/// The quality of JPEG if none is requested.
const USUAL_QUALITY: u8 = 90;

/// The step of an animation if none is requested, in degrees.
const USUAL_STEP: f64 = 10.0;

/// The pictures per second that are recommended if none are requested.
const USUAL_RATE: f64 = 12.5;

/// The most pixels of all pictures.
const MAX_TOTAL_PIXELS: usize = 1 << 25;

/// Directions are equal if they differ by less, so that a viewpoint that was computed gives the same picture as the
/// direction from which it was computed.
const DIRECTION_STEP: f64 = 1e-9;

/// The keys of the standard with what they mean, and our own that has another default here.
const KEYS: [(&str, &str); 15] = [
    ("accept", "The accepted media types, instead of the header"),
    (
        "orientation",
        "Where the viewer is: `a`, `p`, `r`, `l`, `h` or `f`",
    ),
    (
        "viewpointposition",
        "The place of the viewer, `x,y,z` in mm (LPS)",
    ),
    (
        "viewpointlookat",
        "The point in the middle of the picture, `x,y,z` in mm (LPS)",
    ),
    ("viewpointup", "The direction upwards, `x,y,z`"),
    ("window", "`centre,width` or `centre,width,function`"),
    ("viewport", "`width,height` in pixels, 1 to 4096 each"),
    ("quality", "Of JPEG, 1 to 100"),
    (
        "annotation",
        "`patient`, `technique` or both: draws the label of the case, depth, scale and directions",
    ),
    (
        "swivelrange",
        "Several pictures: the angle of the whole turn, in degrees",
    ),
    (
        "animationstepsize",
        "The angle between two pictures, in degrees",
    ),
    ("animationrate", "Recommended pictures per second"),
    ("renderingmethod", "`volume_rendered`"),
    (
        "renderedvolumetricmetadata",
        "`yes` for the values of the view instead of a picture",
    ),
    ("depth_mm", "Depth below the envelope, in mm; 8 by default"),
];

/// The keys of a picture that those determine, or that have no place in a PACS.
const NOT_OWN: &str = "depth_mm projection sides view orientation width height zoom pan window window_function background contours points paths annotate";

/// All other keys of a picture, which mean here what they mean there.
static OWN: LazyLock<Vec<String>> = LazyLock::new(|| {
    let keys = http::query::keys::<PictureRequest>().into_iter();
    let is_own = |key: &String| !NOT_OWN.split(' ').any(|other| other == key);
    keys.map(|(key, _)| key).filter(is_own).collect()
});

/// All keys, with what they mean.
fn keys() -> impl Iterator<Item = (&'static str, &'static str)> {
    let own = OWN.iter().map(String::as_str);
    KEYS.into_iter()
        .chain(own.map(|key| (key, "As of `GET /v1/cases/{id}/render`")))
}

/// The keys, for the description.
pub(crate) struct RenderedParams;

impl IntoParams for RenderedParams {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        let key = |(name, words): (&str, &str)| {
            ParameterBuilder::new()
                .name(name)
                .parameter_in(ParameterIn::Query)
                .required(Required::False)
                .description(Some(words))
                .schema(Some(ObjectBuilder::new().schema_type(Type::String)))
                .build()
        };
        keys().map(key).collect()
    }
}

/// A read query, whose keys are known.
#[derive(Debug)]
pub(crate) struct RenderedQuery<'a>(&'a BTreeMap<String, String>);

/// Where the viewer is, in LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Viewpoint {
    pub(crate) position: [f64; 3],
    pub(crate) look_at: [f64; 3],
    pub(crate) up: [f64; 3],
}

/// How intensities become brightness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Function {
    Linear,
    LinearExact,
    Sigmoid,
}

impl Function {
    /// Its name in VOI LUT Function (0028,1056).
    pub(crate) fn dicom_name(self) -> &'static str {
        match self {
            Self::Linear => "LINEAR",
            Self::LinearExact => "LINEAR_EXACT",
            Self::Sigmoid => "SIGMOID",
        }
    }
}

/// A window in DICOM's terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AskedWindow {
    pub(crate) centre: f64,
    pub(crate) width: f64,
    pub(crate) function: Function,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Swivel {
    pub(crate) range_degrees: f64,
    pub(crate) step_degrees: f64,
    /// Pictures per second.
    pub(crate) rate: f64,
}

/// What is drawn.
#[derive(Debug)]
pub(crate) struct Shown {
    pub(crate) viewpoint: Viewpoint,
    pub(crate) window: AskedWindow,
    pub(crate) quality: u8,
    pub(crate) swivel: Option<Swivel>,
    /// At least one.
    pub(crate) pictures: Vec<CheckedPicture>,
}

fn wrong(key: &str, rule: &str) -> AppError {
    AppError::wrong_value(key, rule)
}

fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    text.parse().ok().map(|Numbers(numbers)| numbers)
}

impl<'a> RenderedQuery<'a> {
    pub(crate) fn read(keys: &'a BTreeMap<String, String>) -> Result<Self, AppError> {
        // An unknown key may be a misspelt one, without which the picture would be another.
        let known: Vec<_> = self::keys().map(|(name, _)| name).collect();
        if keys.keys().any(|key| !known.contains(&&**key)) {
            let detail = format!(
                "a key of the query is unknown; known keys: {}",
                known.join(", ")
            );
            return Err(AppError::bad_request("query-unknown-key", detail));
        }
        let metadata = keys.get("renderedvolumetricmetadata").map(String::as_str);
        if !matches!(metadata, None | Some("yes" | "no")) {
            return Err(wrong("renderedvolumetricmetadata", "`yes` or `no`"));
        }
        Ok(Self(keys))
    }

    /// Whether the values of the view are requested instead of a picture.
    pub(crate) fn is_metadata(&self) -> bool {
        self.text("renderedvolumetricmetadata") == Some("yes")
    }

    /// The media types that the query accepts instead of the header, as an `<img>` can name them (PS3.18 §8.3.3.1).
    pub(crate) fn accept(&self) -> Option<&str> {
        self.text("accept")
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    fn number(
        &self,
        key: &str,
        accepted: std::ops::RangeInclusive<f64>,
    ) -> Result<Option<f64>, AppError> {
        let Some(text) = self.text(key) else {
            return Ok(None);
        };
        let number = text.parse().ok().filter(|number| accepted.contains(number));
        let rule = format!("{} to {}", accepted.start(), accepted.end());
        number.map(Some).ok_or_else(|| wrong(key, &rule))
    }

    /// The surface below which depth is measured.
    pub(crate) fn surface(&self) -> Result<SurfaceName, AppError> {
        Ok(self.own()?.surface)
    }

    /// The values of our own keys that mean the same as for every picture.
    fn own(&self) -> Result<PictureRequest, AppError> {
        let pairs = OWN
            .iter()
            .filter_map(|key| Some((key.into(), self.text(key)?.into())));
        from_pairs(pairs).map_err(|error| {
            let kind = "query-value-out-of-range";
            AppError::invalid(kind, error.path().to_string(), error.inner())
        })
    }

    /// What is drawn of a case, whose facts are those of the requested surface.
    pub(crate) fn shown(&self, facts: &CaseFacts) -> Result<Shown, AppError> {
        match self.text("renderingmethod") {
            None | Some("volume_rendered") => {}
            Some(_) => return Err(wrong("renderingmethod", "`volume_rendered`")),
        }
        let viewpoint = self.viewpoint(&facts.envelope_sphere)?;
        let window = self.window(facts)?;
        let viewport = match self.text("viewport") {
            None => [USUAL_SIDE; 2],
            Some(text) => {
                let sides = numbers::<2>(text).filter(|sides| {
                    sides
                        .iter()
                        .all(|side| side.fract() == 0.0 && (1.0..=4096.0).contains(side))
                });
                let sides = sides
                    .ok_or_else(|| wrong("viewport", "width,height: 1 to 4096 pixels each"))?;
                sides.map(|side| side as u32)
            }
        };
        let quality = self.number("quality", 1.0..=100.0)?;
        let first = self.picture(facts, viewpoint, window, viewport)?;
        let swivel = self.swivel()?;
        let plan = match &swivel {
            None => PicturePlan::one(&first),
            Some(swivel) => PicturePlan::turned(&first, &swivel.angles_rad()?, Layout::Separate),
        };
        let plan = plan.and_then(|plan| plan.within(MAX_TOTAL_PIXELS));
        let PicturePlan { pictures, .. } = plan.map_err(named)?;
        Ok(Shown {
            viewpoint,
            window,
            quality: quality.map_or(USUAL_QUALITY, |quality| quality as u8),
            swivel,
            pictures,
        })
    }

    fn viewpoint(&self, sphere: &SphereFacts) -> Result<Viewpoint, AppError> {
        let explicit = ["viewpointposition", "viewpointlookat", "viewpointup"];
        let given = explicit.map(|key| self.text(key));
        if given.iter().all(Option::is_none) {
            let (towards_viewer, up) = match self.text("orientation").unwrap_or("l") {
                "l" => (DVec3::X, DVec3::Z),
                "r" => (DVec3::NEG_X, DVec3::Z),
                "a" => (DVec3::NEG_Y, DVec3::Z),
                "p" => (DVec3::Y, DVec3::Z),
                "h" => (DVec3::Z, DVec3::NEG_Y),
                "f" => (DVec3::NEG_Z, DVec3::NEG_Y),
                _ => return Err(wrong("orientation", "a, p, r, l, h or f")),
            };
            let centre = DVec3::from_array(sphere.center_in_patient);
            let position = centre + 2.0 * sphere.radius_mm * towards_viewer;
            return Ok(Viewpoint {
                position: position.to_array(),
                look_at: centre.to_array(),
                up: up.to_array(),
            });
        }
        if self.text("orientation").is_some() {
            return Err(wrong("orientation", "omitted if a viewpoint is given"));
        }
        let read = |key: &str, text: Option<&str>| {
            let text =
                text.ok_or_else(|| wrong(key, "given if another part of the viewpoint is"))?;
            let fits = |values: &[f64; 3]| values.iter().all(|value| value.abs() <= 1e4);
            let values = numbers::<3>(text).filter(fits);
            values.ok_or_else(|| wrong(key, "x,y,z in mm, at most 10000"))
        };
        let [position, look_at, up] = [0, 1, 2].map(|index| read(explicit[index], given[index]));
        Ok(Viewpoint {
            position: position?,
            look_at: look_at?,
            up: up?,
        })
    }

    fn window(&self, facts: &CaseFacts) -> Result<AskedWindow, AppError> {
        match self.text("window") {
            Some(text) => given_window(text),
            None => {
                let usual = window_of(facts);
                Ok(AskedWindow {
                    centre: usual.centre(),
                    width: usual.width(),
                    function: Function::Linear,
                })
            }
        }
    }

    fn swivel(&self) -> Result<Option<Swivel>, AppError> {
        let step = self.number("animationstepsize", 0.1..=360.0)?;
        let rate = self.number("animationrate", 0.1..=100.0)?;
        let Some(range_degrees) = self.number("swivelrange", 0.1..=360.0)? else {
            return match step.or(rate) {
                Some(_) => Err(wrong(
                    "swivelrange",
                    "given with `animationstepsize` and `animationrate`",
                )),
                None => Ok(None),
            };
        };
        Ok(Some(Swivel {
            range_degrees,
            step_degrees: step.unwrap_or(USUAL_STEP),
            rate: rate.unwrap_or(USUAL_RATE),
        }))
    }

    fn picture(
        &self,
        facts: &CaseFacts,
        viewpoint: Viewpoint,
        window: AskedWindow,
        [width, height]: [u32; 2],
    ) -> Result<PictureRequest, AppError> {
        let (orientation, pan) = camera(viewpoint, facts.envelope_sphere.center_in_patient)?;
        let shown_window = self.shows_intensities(window)?;
        let depth_mm = self.number("depth_mm", 0.0..=1000.0)?;
        let annotation = self.text("annotation").map(|text| {
            let known = |word: &str| ["patient", "technique"].contains(&word);
            let is_known = text.split(',').all(known);
            is_known
                .then_some(true)
                .ok_or_else(|| wrong("annotation", "patient, technique or both"))
        });
        Ok(PictureRequest {
            depth_mm: depth_mm.map_or(USUAL_DEPTH_MM, |depth| depth as f32),
            orientation: Some(Numbers(orientation)),
            pan: Some(Numbers(pan)),
            window: shown_window,
            // A window that is not shown was not requested, and is linear.
            window_function: match window.function {
                Function::Sigmoid => Some(WindowFunction::Sigmoid),
                Function::Linear | Function::LinearExact => None,
            },
            width,
            height,
            annotate: annotation.transpose()?.unwrap_or(false),
            ..self.own()?
        })
    }

    /// The window for the renderer; `None`, the window of the layer, if a layer is shown and no window is requested.
    fn shows_intensities(&self, window: AskedWindow) -> Result<Option<Numbers<2>>, AppError> {
        if self.text("window").is_none() && self.text("layer").is_some() {
            return Ok(None);
        }
        let AskedWindow {
            centre,
            width,
            function,
        } = window;
        let is_wide = match function {
            Function::Linear => width >= 1.0,
            Function::LinearExact | Function::Sigmoid => width > 0.0,
        };
        if !is_wide {
            let rule = "of a width of at least 1, or above 0 if it is linear-exact or sigmoid";
            return Err(wrong("window", rule));
        }
        Ok(Some(match function {
            Function::Linear | Function::Sigmoid => Numbers([centre, width]),
            // LINEAR begins at centre - 0.5 - (width - 1) / 2, and its ramp is width - 1 long (PS3.3 C.11.2.1.2).
            Function::LinearExact => Numbers([centre + 0.5, width + 1.0]),
        }))
    }
}

/// Centre, width and, if given, function.
fn given_window(text: &str) -> Result<AskedWindow, AppError> {
    let rule = "centre,width,function with the function linear, linear-exact or sigmoid";
    let (values, function) = text.rsplit_once(',').ok_or_else(|| wrong("window", rule))?;
    let (values, function) = match function {
        "linear" => (values, Function::Linear),
        "linear-exact" => (values, Function::LinearExact),
        "sigmoid" => (values, Function::Sigmoid),
        // The function may be omitted.
        _ => (text, Function::Linear),
    };
    let [centre, width] = numbers::<2>(values).ok_or_else(|| wrong("window", rule))?;
    Ok(AskedWindow {
        centre,
        width,
        function,
    })
}

/// The quaternion x,y,z,w from patient to view space, and the shift of the head to the right and up in mm, of a
/// viewpoint.
fn camera(viewpoint: Viewpoint, centre: [f64; 3]) -> Result<([f64; 4], [f64; 2]), AppError> {
    let Viewpoint {
        position,
        look_at,
        up,
    } = viewpoint;
    let [position, look_at, up] = [position, look_at, up].map(DVec3::from_array);
    let rounded = |direction: DVec3| (direction / DIRECTION_STEP).round() * DIRECTION_STEP;
    let towards_viewer = (position - look_at).try_normalize().map(rounded);
    let towards_viewer = towards_viewer
        .ok_or_else(|| wrong("viewpointposition", "another point than `viewpointlookat`"))?;
    let right = up.cross(towards_viewer).try_normalize().map(rounded);
    let right = right.ok_or_else(|| wrong("viewpointup", "across the direction of the view"))?;
    let up = towards_viewer.cross(right);
    let patient_from_view = DMat3::from_cols(right, up, towards_viewer);
    let orientation = DQuat::from_mat3(&patient_from_view.transpose()).normalize();
    let shift = look_at - DVec3::from_array(centre);
    // Adding 0 turns −0 into 0.
    let pan = [right, up].map(|axis| 0.0 - axis.dot(shift));
    Ok((orientation.to_array(), pan))
}

impl Swivel {
    /// The angles of the pictures of a turn: all around, or from one side to the other.
    fn angles_rad(&self) -> Result<Vec<f64>, AppError> {
        let steps = (self.range_degrees / self.step_degrees).round().max(1.0) as usize;
        let is_full = self.range_degrees >= 360.0;
        let count = if is_full { steps } else { steps + 1 };
        if count > MAX_PICTURES {
            let rule = format!("larger: at most {MAX_PICTURES} pictures are drawn");
            return Err(wrong("animationstepsize", &rule));
        }
        let begin = if is_full {
            0.0
        } else {
            -self.range_degrees / 2.0
        };
        let angle = |number: usize| {
            let degrees = begin + self.range_degrees * number as f64 / steps as f64;
            degrees.to_radians()
        };
        Ok((0..count).map(angle).collect())
    }
}

/// The error with the names of the query: those of a picture are its own.
fn named(error: PlanError) -> Error {
    error.named("query-value-out-of-range", |part| match part {
        Part::Pixels => "viewport".to_owned(),
        _ => String::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use render::{NamedView, Window};

    fn ramp(Numbers([centre, width]): Numbers<2>) -> [f64; 2] {
        Window::new(centre, width).unwrap().ramp()
    }

    fn query(text: &str) -> BTreeMap<String, String> {
        let pairs = text.split('&').filter_map(|pair| pair.split_once('='));
        pairs
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .collect()
    }

    #[test]
    fn directions_are_those_of_the_named_views() {
        let centre = [3.0, -20.5, 7.25];
        for (letter, view) in [
            ("l", NamedView::Left),
            ("r", NamedView::Right),
            ("a", NamedView::Anterior),
            ("p", NamedView::Posterior),
            ("h", NamedView::Superior),
            ("f", NamedView::Inferior),
        ] {
            let keys = query(&format!("orientation={letter}"));
            let sphere = case::SphereFacts {
                center_in_patient: centre,
                radius_mm: 80.0,
            };
            let viewpoint = RenderedQuery(&keys).viewpoint(&sphere).unwrap();
            let (orientation, pan) = camera(viewpoint, centre).unwrap();
            let apart = DQuat::from_array(orientation).dot(view.orientation()).abs();
            assert!((apart - 1.0).abs() < 1e-12, "{letter}");
            assert_eq!(pan, [0.0; 2]);
        }
    }

    #[test]
    fn looking_beside_the_centre_moves_the_head_the_other_way() {
        // From the front: the patient's left is at the right of the picture.
        let viewpoint = Viewpoint {
            position: [10.0, -200.0, 5.0],
            look_at: [10.0, 0.0, 5.0],
            up: [0.0, 0.3, 1.0],
        };
        let (_, pan) = camera(viewpoint, [0.0; 3]).unwrap();
        assert_eq!(pan, [-10.0, -5.0]);
    }

    #[test]
    fn windows_are_those_of_the_standard() {
        let shown = |text: &str| {
            let keys = query(&format!("window={text}"));
            let asked = RenderedQuery(&keys);
            let window = given_window(text).and_then(|window| asked.shows_intensities(window));
            window.ok().flatten().map(ramp)
        };
        assert_eq!(shown("100,51,linear"), Some([74.5, 124.5]));
        assert_eq!(shown("100,51"), Some([74.5, 124.5]));
        assert_eq!(shown("100,50,linear-exact"), Some([75.0, 125.0]));
        assert_eq!(shown("100,0.5,linear-exact"), Some([99.75, 100.25]));
        for refused in [
            "100,0,sigmoid",
            "100,50,cubic",
            "100",
            "100,0,linear",
            "a,b,linear",
            "1,2,3,linear",
        ] {
            assert_eq!(shown(refused), None, "{refused}");
        }
    }

    #[test]
    fn a_sigmoid_is_passed_on_with_its_centre_and_width() {
        let window = given_window("100,0.5,sigmoid").unwrap();
        assert_eq!(window.function.dicom_name(), "SIGMOID");
        let keys = query("window=100,0.5,sigmoid");
        let shown = RenderedQuery(&keys).shows_intensities(window).unwrap();
        assert_eq!(shown, Some(Numbers([100.0, 0.5])));
    }

    #[test]
    fn a_turn_goes_all_around_or_from_side_to_side() {
        let count = |range_degrees, step_degrees| {
            let swivel = Swivel {
                range_degrees,
                step_degrees,
                rate: 10.0,
            };
            swivel.angles_rad().map(|angles| angles.len()).ok()
        };
        assert_eq!(count(360.0, 10.0), Some(36));
        assert_eq!(count(90.0, 10.0), Some(10));
        assert_eq!(count(5.0, 10.0), Some(2));
        assert_eq!(count(360.0, 0.1), None);
    }
}
