//! Layers: further volumes of the head of a case.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::facts::is_zero;
use crate::id::{half, id_as_text};
use crate::images::Closed;
use crate::{CaseId, CaseState, Failure, MapName, QualityState, is_control};

/// A part of every [`LayerId`]. It changes if the same input must give another layer.
const ID_FORMAT: u8 = 1;

/// The most layers of a case.
pub const MAX_LAYERS: usize = 20;

/// The id of a layer, a digest: 32 lower-case hexadecimal digits.
///
/// It is the first half of a BLAKE3 digest over the volume and the parameters that affect the result. The case is not
/// part of it: a version of a case has the same layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LayerId([u8; 16]);

id_as_text!(
    LayerId,
    NotALayerId,
    "the id of a layer is 32 lower-case hexadecimal digits"
);

impl LayerId {
    fn of_digits(digits: [u8; 16]) -> Self {
        Self(digits)
    }

    fn digits(&self) -> [u8; 16] {
        self.0
    }

    /// The id as a number.
    pub fn number(&self) -> u128 {
        u128::from_be_bytes(self.0)
    }

    /// The id of the layer of a volume. The digests are BLAKE3 over the uploaded bytes and the attributes of DICOM
    /// files.
    pub fn of(
        volume: &blake3::Hash,
        dicom: Option<&blake3::Hash>,
        parameters: &LayerParameters,
    ) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"isocortex layer");
        hasher.update(&[ID_FORMAT, parameters.kind as u8]);
        hasher.update(volume.as_bytes());
        hasher.update(&[u8::from(dicom.is_some())]);
        if let Some(dicom) = dicom {
            hasher.update(dicom.as_bytes());
        }
        let mut text = |text: &str| {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        };
        text(&parameters.unit);
        for (value, name) in &parameters.labels {
            text(&value.to_string());
            text(name);
        }
        let transform = parameters.transform;
        hasher.update(transform.name().as_bytes());
        if let Transform::Matrix(rows) = transform {
            for number in rows.as_flattened() {
                // Adding 0 turns −0 into 0.
                hasher.update(&(number + 0.0).to_le_bytes());
            }
        }
        Self(half(&hasher))
    }
}

/// What the values of a layer are.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum LayerKind {
    /// Intensities of an MR sequence.
    #[default]
    Mr,
    /// Hounsfield units of a CT.
    Ct,
    /// Uptake in a PET.
    Pet,
    /// Numbers that another program computed, such as a statistical map.
    Map,
    /// Whole numbers that name regions; 0 is none.
    Labels,
}

impl LayerKind {
    /// The kind of a series of DICOM files, by its modality (0008,0060).
    pub fn of_modality(modality: &str) -> Self {
        match modality {
            "CT" => Self::Ct,
            "PT" => Self::Pet,
            _ => Self::Mr,
        }
    }

    pub const ALL: [Self; 5] = [Self::Mr, Self::Ct, Self::Pet, Self::Map, Self::Labels];

    /// The name in JSON and on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether it is an image of the head, which can be registered.
    pub fn is_acquired(self) -> bool {
        matches!(self, Self::Mr | Self::Ct | Self::Pet)
    }
}

/// The contrast of an MR sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Contrast {
    /// White matter is brighter than grey matter, and fluid is dark.
    T1,
    /// Fluid is bright.
    T2,
    /// As T2, but fluid is dark.
    Flair,
    /// Another contrast.
    Other,
}

impl Contrast {
    pub const ALL: [Self; 4] = [Self::T1, Self::T2, Self::Flair, Self::Other];

    /// The name in JSON and on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// From the name of a sequence or of a layer: `FLAIR`, `T2 tse`. `None` if the name does not tell.
    pub fn of_name(name: &str) -> Option<Self> {
        const OTHERS: [&str; 6] = ["dwi", "swi", "tof", "asl", "epi", "pd"];
        let name = name.to_lowercase();
        let has = |part: &str| name.contains(part);
        let mut words = name.split(|letter: char| !letter.is_alphanumeric());
        if has("t1") || has("mprage") {
            Some(Self::T1)
        } else if has("flair") {
            Some(Self::Flair)
        } else if has("t2") {
            Some(Self::T2)
        } else {
            words
                .any(|word| OTHERS.contains(&word))
                .then_some(Self::Other)
        }
    }
}

/// How a layer is placed in the patient space of its case.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(into = "TransformText", try_from = "TransformText")]
pub enum Transform {
    /// An acquired volume is registered, from where its header places it; a map and labels lie where their header
    /// places them.
    #[default]
    Auto,
    /// Where its header places it.
    None,
    Rigid,
    /// By these rows of `case_from_layer`, LPS mm.
    Matrix([[f64; 4]; 4]),
}

/// A transform in JSON: a word, or 4 rows of 4 numbers.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "the transform is `auto`, `none`, `rigid` or 4 rows of 4 numbers"
)]
enum TransformText {
    Word(String),
    Rows([[f64; 4]; 4]),
}

impl From<Transform> for TransformText {
    fn from(transform: Transform) -> Self {
        match transform {
            Transform::Matrix(rows) => Self::Rows(rows),
            word => Self::Word(word.name().to_owned()),
        }
    }
}

impl TryFrom<TransformText> for Transform {
    type Error = &'static str;

    fn try_from(text: TransformText) -> Result<Self, &'static str> {
        match text {
            TransformText::Rows(rows) => Ok(Self::Matrix(rows)),
            TransformText::Word(word) => match word.as_str() {
                "auto" => Ok(Self::Auto),
                "none" => Ok(Self::None),
                "rigid" => Ok(Self::Rigid),
                _ => Err("the transform is `auto`, `none`, `rigid` or 4 rows of 4 numbers"),
            },
        }
    }
}

impl Transform {
    /// The greatest deviation of the columns of a rotation from orthonormal.
    const TOLERANCE: f64 = 1e-3;

    /// The greatest shift, in mm.
    const MAX_SHIFT_MM: f64 = 1e4;

    /// The word for it; `matrix` for rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::None => "none",
            Self::Rigid => "rigid",
            Self::Matrix(_) => "matrix",
        }
    }

    fn is_sound(self) -> bool {
        let Self::Matrix(rows) = self else {
            return true;
        };
        let column = |axis: usize| [rows[0][axis], rows[1][axis], rows[2][axis]];
        let [x, y, z] = [0, 1, 2].map(column);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let cross = [
            x[1] * y[2] - x[2] * y[1],
            x[2] * y[0] - x[0] * y[2],
            x[0] * y[1] - x[1] * y[0],
        ];
        // Comparisons with NaN fail.
        let near = |number: f64, expected: f64| (number - expected).abs() < Self::TOLERANCE;
        let is_rotation = near(dot(x, x), 1.0)
            && near(dot(y, y), 1.0)
            && near(dot(x, y), 0.0)
            && (0..3).all(|axis| near(z[axis], cross[axis]));
        is_rotation
            && column(3)
                .iter()
                .all(|shift| shift.abs() <= Self::MAX_SHIFT_MM)
            && rows[3] == [0.0, 0.0, 0.0, 1.0]
    }
}

/// What is known of a layer that was drawn from surfaces: each voxel around them has the value of the nearest place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LayerSurface))]
pub struct SurfaceFacts {
    /// Vertices of all its surfaces.
    pub vertices: u32,
    /// Triangles of all its surfaces.
    pub triangles: u32,
    /// How thick the sheet of voxels around the surfaces is, in mm. Elsewhere the layer is undefined.
    pub thickness_mm: f32,
}

/// How surfaces that a layer was drawn from fit the head of the case. A number is absent if it cannot be told: if too few vertices lie in the
/// head, or if the tissues of the head cannot be told apart.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceFit {
    /// The range that holds the middle half of the intensities of the case at the vertices. A surface that follows the cortex has a narrow one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spread: Option<f32>,
    /// The same of the mirrored surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirrored_spread: Option<f32>,
    /// The same of all copies of the mirrored surface that are moved by 6 mm along an axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirrored_moved_spread: Option<f32>,
    /// The median distance of the vertices from the junction of grey and white matter, in mm. What is further than 15 mm counts as 15 mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub junction_median_mm: Option<f32>,
    /// The 95th percentile of that distance, in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub junction_p95_mm: Option<f32>,
}

impl SurfaceFit {
    /// The most that the spread of a surface that follows the cortex is of that of its mirror image. In one head it is 0.27 to 0.33 for white
    /// and pial surfaces, and 0.68 and more for those moved by 2 mm.
    const FOLLOWS: f32 = 0.6;

    /// The same for a mirrored surface, which need not have been mirrored at the plane between the hemispheres: there it is 0.69.
    const IS_MIRRORED: f32 = 0.75;

    /// The most that the median distance of a surface of the cortex is from the junction, in mm.
    const NEAR_MM: f32 = 3.0;

    /// Whether it follows the cortex of the case; `None` if that cannot be told.
    pub fn follows_cortex(&self) -> Option<bool> {
        let (own, mirrored) = self.spread.zip(self.mirrored_spread)?;
        Some(own < Self::FOLLOWS * mirrored)
    }

    /// Whether its mirror image follows the cortex, and not the surface itself. The mirror image must fit where it lies, and not when it is
    /// moved: along a surface without folds, or in even tissue, intensities tell nothing about sides.
    pub fn is_mirrored(&self) -> bool {
        let others = self.spread.zip(self.mirrored_moved_spread);
        let both = others.zip(self.mirrored_spread);
        both.is_some_and(|((own, moved), mirrored)| mirrored < Self::IS_MIRRORED * own.min(moved))
    }

    /// Whether it lies too far from the junction for a surface of the cortex.
    pub fn is_far(&self) -> bool {
        self.junction_median_mm
            .is_some_and(|distance| distance > Self::NEAR_MM)
    }
}

/// The parameters of a layer. All but the contrast and the surface are part of its id.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayerParameters {
    /// What its values are.
    pub kind: LayerKind,
    /// The unit of its values; empty if they have none.
    pub unit: String,
    /// How it is placed.
    pub transform: Transform,
    pub labels: BTreeMap<u32, String>,
    /// The contrast of an MR sequence, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contrast: Option<Contrast>,
    /// The surfaces that it was drawn from, if it was not acquired in voxels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface: Option<SurfaceFacts>,
}

impl LayerParameters {
    /// The longest unit, in characters.
    pub const MAX_UNIT_LENGTH: usize = 24;

    /// The longest name of a layer or a label, in characters.
    pub const MAX_NAME_LENGTH: usize = 64;

    /// The most names of labels.
    pub const MAX_LABELS: usize = 4096;

    /// Checks the parameters.
    ///
    /// # Errors
    /// A [`Failure`] that names the one that is wrong.
    pub fn check(&self) -> Result<(), Failure> {
        if !is_short_text(&self.unit, Self::MAX_UNIT_LENGTH) {
            let most = Self::MAX_UNIT_LENGTH;
            let detail = format!(
                "the unit must have at most {most} characters, none of them a control character"
            );
            return Err(Failure::unusable("unit-unusable", detail));
        }
        if !self.transform.is_sound() {
            let detail = "the transform must be rigid: 4 rows with a rotation and a shift in mm, the last row 0 0 0 1";
            return Err(Failure::unusable("transform-not-rigid", detail));
        }
        if !self.kind.is_acquired() && self.transform == Transform::Rigid {
            let detail = format!(
                "a layer of the kind `{}` shows too little anatomy to be registered; send its transform as a matrix, or omit it",
                self.kind.name()
            );
            return Err(Failure::unusable("transform-not-possible", detail));
        }
        if self.contrast.is_some() && self.kind != LayerKind::Mr {
            let detail = format!(
                "only a layer of the kind `mr` has a `contrast`, and this one is of the kind `{}`; omit it",
                self.kind.name()
            );
            return Err(Failure::unusable("contrast-unexpected", detail));
        }
        if !self.labels.is_empty() && self.kind != LayerKind::Labels {
            let detail = "names of labels are only accepted for a layer of the kind `labels`";
            return Err(Failure::unusable("labels-unexpected", detail));
        }
        let are_short = self
            .labels
            .values()
            .all(|name| is_short_text(name, Self::MAX_NAME_LENGTH));
        if self.labels.len() > Self::MAX_LABELS || !are_short {
            let detail = format!(
                "there may be {} names of labels, each of at most {} characters without control characters",
                Self::MAX_LABELS,
                Self::MAX_NAME_LENGTH
            );
            return Err(Failure::unusable("labels-unusable", detail));
        }
        Ok(())
    }

    /// Names of labels as a layer may have them: the first ones, without control characters, shortened. A label without a name has its number.
    pub fn fitting_labels(names: BTreeMap<u32, String>) -> BTreeMap<u32, String> {
        let fit = |(value, name): (u32, String)| {
            let letters = name.chars().filter(|&letter| !is_control(letter));
            let name: String = letters.take(Self::MAX_NAME_LENGTH).collect();
            (value > 0 && !name.is_empty()).then_some((value, name))
        };
        (names.into_iter().filter_map(fit))
            .take(Self::MAX_LABELS)
            .collect()
    }

    /// Reads names of labels: one label per line, its number and its name, separated by spaces, a tab, a comma or `=`.
    /// Text after `#` and empty lines are ignored, and so are the four numbers of a colour at the end, as in
    /// FreeSurfer's tables.
    ///
    /// # Errors
    /// A [`Failure`] with the number of the line that cannot be read.
    pub fn parse_labels(text: &str) -> Result<BTreeMap<u32, String>, Failure> {
        let mut labels = BTreeMap::new();
        for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let (value, name) = label_of(line).ok_or_else(|| {
                let detail = format!(
                    "line {number} of the names of labels is not a whole number and a name"
                );
                Failure::unusable("labels-unreadable", detail)
            })?;
            labels.insert(value, name);
        }
        Ok(labels)
    }
}

fn label_of(line: &str) -> Option<(u32, String)> {
    let (value, name) = line.split_once([' ', '\t', ',', '='])?;
    let words: Vec<&str> = name
        .split([' ', '\t'])
        .filter(|word| !word.is_empty())
        .collect();
    let is_color = |words: &[&str]| words.iter().all(|word| word.parse::<u8>().is_ok());
    let end = match words.len().checked_sub(4) {
        Some(end) if end > 0 && is_color(&words[end..]) => end,
        _ => words.len(),
    };
    let name = words[..end].join(" ");
    (!name.is_empty()).then_some((value.trim().parse().ok()?, name))
}

fn is_short_text(text: &str, most: usize) -> bool {
    text.chars().count() <= most && !text.chars().any(is_control)
}

/// Where the matrix of a layer comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MatrixOrigin {
    /// From its header.
    Header,
    /// From the registration.
    Registered,
    /// From the request.
    ByHand,
}

impl MatrixOrigin {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// For people: `placed by its header`.
    pub fn words(self) -> &'static str {
        match self {
            Self::Header => "placed by its header",
            Self::Registered => "registered",
            Self::ByHand => "placed by hand",
        }
    }
}

/// The result of a registration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum PlacementVerdict {
    /// The layer was moved to where it fits.
    Registered,
    /// It fits where its header places it.
    Unchanged,
    /// It was not registered.
    Unchecked,
}

/// The place of a layer in its case.
// The description requires none of its fields: a layer that is not ready has none of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LayerPlacement))]
pub struct PlacementFacts {
    /// Rows of the rigid transform from the patient space of the layer to that of the case, LPS mm.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub case_from_layer: [[f64; 4]; 4],
    /// Where the matrix comes from.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub origin: MatrixOrigin,
    /// The result of the registration.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub verdict: PlacementVerdict,
    /// `ok`, or `review` if the place must be checked by eye.
    #[cfg_attr(feature = "openapi", schema(required = false))]
    pub quality: QualityState,
    /// The reason for `review`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The stable name of that reason: `place-not-compared`, `space-not-stated`, `covers-too-little`,
    /// `not-along-cortex`, `far-from-junction` or `axes-assumed`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason_code: Option<String>,
    /// Normalised mutual information where the header places it: 1 for none, 2 for complete.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nmi_before: Option<f64>,
    /// The same at the best place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nmi_after: Option<f64>,
    /// The fraction of the head that it covers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap: Option<f64>,
    /// The median shift at which the parts of the head fit best, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual_mm: Option<f64>,
    /// How the surfaces fit that it was drawn from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<SurfaceFit>,
}

/// A label that occurs in a layer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Label))]
pub struct LabelFacts {
    /// Its value in the file.
    pub value: u32,
    /// Its name.
    pub name: String,
    /// The number of voxels with it.
    pub voxels: u64,
}

/// The facts about a layer that is ready.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayerFacts {
    /// Size of the acquired volume in voxels.
    pub size: [usize; 3],
    /// Edges of a voxel, in mm.
    pub spacing_mm: [f64; 3],
    /// Rows of the affine from voxels to the layer's own patient space, LPS mm.
    pub patient_from_voxel: [[f64; 4]; 4],
    pub placement: PlacementFacts,
    /// Least and greatest value.
    pub range: [f32; 2],
    /// How many values lie so far beyond all others that they became the end of the range.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clipped: u64,
    /// The default window: the values of the first and the last colour.
    pub window: [f64; 2],
    /// The labels, ascending, if it is a label map.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub labels: Vec<LabelFacts>,
    /// The scanner's name of the sequence and its times in ms, if the layer comes from DICOM.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sequence: Option<String>,
}

/// A layer of a case, as stored in its row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Layer {
    pub case: CaseId,
    pub id: LayerId,
    /// Its name, unique in its case.
    pub name: String,
    pub parameters: LayerParameters,
    pub state: CaseState,
    /// The failure, if it has failed.
    pub failure: Option<Failure>,
    /// The facts, if it is ready.
    pub facts: Option<LayerFacts>,
    /// The time of the upload.
    pub created_at: Timestamp,
    /// Why it is closed, if it is. It is listed then, and not drawn.
    pub closed: Option<Closed>,
}

/// Changes of an added layer that keep its id.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = LayerPatch))]
#[serde(deny_unknown_fields, default)]
pub struct LayerChange {
    /// Another name.
    pub name: Option<String>,
    /// Another place among the added layers, from 0.
    pub place: Option<usize>,
    /// The contrast of a layer of the kind `mr`. The newest `flair` gets the map `flair`.
    pub contrast: Option<Contrast>,
}

impl Layer {
    /// Whether it can be drawn.
    pub fn is_shown(&self) -> bool {
        self.state == CaseState::Ready && self.closed.is_none()
    }

    /// The newest FLAIR that is ready, to which the map `flair` belongs.
    pub fn newest_flair(layers: &[Self]) -> Option<&Self> {
        let flairs = layers
            .iter()
            .filter(|layer| layer.is_flair() && layer.is_shown());
        flairs.max_by_key(|layer| (layer.created_at, layer.id))
    }

    /// Whether it is a FLAIR, ready or not.
    pub fn is_flair(&self) -> bool {
        self.parameters.contrast == Some(Contrast::Flair)
    }

    /// Checks a name: not empty, short, without control characters, and not confused with an id or a map.
    ///
    /// `FLAIR` and `Flair` are names of layers, although `flair` is the one of a map.
    ///
    /// # Errors
    /// A [`Failure`] that states what is wrong with it.
    pub fn check_name(name: &str) -> Result<(), Failure> {
        let most = LayerParameters::MAX_NAME_LENGTH;
        if name.trim() != name || name.is_empty() || !is_short_text(name, most) {
            let detail = format!(
                "the name of a layer must have 1 to {most} characters, none of them a control character, and no space at its ends"
            );
            return Err(Failure::unusable("name-unusable", detail));
        }
        if name.bytes().all(|byte| byte == b'.') {
            let detail = "the name of a layer must not be dots alone, because its address would be another one";
            return Err(Failure::unusable("name-unusable", detail));
        }
        let lower = name.to_lowercase();
        let is_map = match MapName::from_name(&lower) {
            Some(MapName::Flair) => lower == name,
            map => map.is_some(),
        };
        if LayerId::parse(&lower).is_some() || is_map {
            let detail = "the name of a layer must not be an id or the name of a map";
            return Err(Failure::unusable("name-unusable", detail));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(parameters: &LayerParameters) -> LayerId {
        LayerId::of(&blake3::hash(b"volume"), None, parameters)
    }

    const SHIFTED: [[f64; 4]; 4] = [
        [1.0, 0.0, 0.0, 0.5],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];

    #[test]
    fn a_surface_of_an_earlier_version_is_read() {
        let stored = r#"{"kind": "labels", "surface": {"vertices": 4, "triangles": 2, "thickness_mm": 1.5, "spread": 0.2, "mirrored_spread": 0.4}}"#;
        let parameters: LayerParameters = serde_json::from_str(stored).unwrap();
        assert_eq!(parameters.surface.map(|surface| surface.vertices), Some(4));
    }

    #[test]
    fn each_parameter_changes_the_id_and_ids_stay() {
        let usual = LayerParameters::default();
        assert_eq!(LayerId::parse(&id(&usual).to_string()), Some(id(&usual)));
        let others = [
            LayerParameters {
                kind: LayerKind::Pet,
                ..usual.clone()
            },
            LayerParameters {
                unit: "SUV".to_owned(),
                ..usual.clone()
            },
            LayerParameters {
                transform: Transform::Matrix(SHIFTED),
                ..usual.clone()
            },
            LayerParameters {
                labels: [(1, "x".to_owned())].into(),
                ..usual.clone()
            },
        ];
        for other in others {
            assert_ne!(id(&usual), id(&other), "{other:?}");
        }
        let flair = LayerParameters {
            contrast: Some(Contrast::Flair),
            ..usual.clone()
        };
        assert_eq!(id(&usual), id(&flair), "the contrast is no part of it");
        let dicom = blake3::hash(b"dicom");
        let with_dicom = LayerId::of(&blake3::hash(b"volume"), Some(&dicom), &usual);
        assert_ne!(id(&usual), with_dicom);
        assert_eq!(id(&usual).to_string(), "4ef1df3bb4f67c6266da5a3d65c2bdff");
    }

    #[test]
    fn a_transform_is_a_word_or_a_rigid_matrix() {
        let read = |json: &str| serde_json::from_str::<Transform>(json).ok();
        assert_eq!(read("\"rigid\""), Some(Transform::Rigid));
        assert_eq!(read("\"affine\""), None);
        let json = serde_json::to_string(&Transform::Matrix(SHIFTED)).unwrap();
        assert_eq!(read(&json), Some(Transform::Matrix(SHIFTED)));
        assert!(Transform::Matrix(SHIFTED).is_sound());
        for (row, column, value) in [
            (0, 0, -1.0),
            (0, 0, 1.1),
            (0, 1, 0.2),
            (3, 0, 1.0),
            (0, 3, f64::NAN),
        ] {
            let mut rows = SHIFTED;
            rows[row][column] = value;
            assert!(!Transform::Matrix(rows).is_sound(), "{rows:?}");
        }
    }

    #[test]
    fn names_of_labels_are_read_in_the_usual_forms() {
        let text = "# a table\n1 cluster one\n2\tcluster two\n3,three\n4=four\n17  Left-Hippocampus  220 216 20 0\n\n";
        let labels = LayerParameters::parse_labels(text).unwrap();
        let names: Vec<_> = labels
            .iter()
            .map(|(value, name)| (*value, name.as_str()))
            .collect();
        let expected = [
            (1, "cluster one"),
            (2, "cluster two"),
            (3, "three"),
            (4, "four"),
            (17, "Left-Hippocampus"),
        ];
        assert_eq!(names, expected);
        for wrong in ["one cluster", "1", "-1 x", "1.5 x"] {
            let refused = LayerParameters::parse_labels(wrong).unwrap_err();
            assert_eq!(refused.name, "labels-unreadable", "{wrong}");
        }
    }

    #[test]
    fn a_contrast_is_told_by_a_name_and_belongs_to_mr_alone() {
        let told = |name| Contrast::of_name(name).map(Contrast::name);
        assert_eq!(told("3D FLAIR sag"), Some("flair"));
        assert_eq!(told("T1 FLAIR"), Some("t1"));
        assert_eq!(told("T1 MPRAGE"), Some("t1"));
        assert_eq!(told("t2_tse"), Some("t2"));
        assert_eq!(told("DWI 2"), Some("other"));
        assert_eq!(told("second volume"), None);
        let with = |kind, contrast| {
            let parameters = LayerParameters {
                kind,
                contrast,
                ..LayerParameters::default()
            };
            parameters.check().map_err(|failure| failure.name)
        };
        assert!(with(LayerKind::Mr, Some(Contrast::T2)).is_ok());
        assert!(with(LayerKind::Pet, None).is_ok());
        let refused = with(LayerKind::Pet, Some(Contrast::T2)).unwrap_err();
        assert_eq!(refused, "contrast-unexpected");
    }

    #[test]
    fn names_that_would_be_confused_are_refused() {
        for name in ["FLAIR 3D", "FLAIR", "Flair"] {
            assert!(Layer::check_name(name).is_ok(), "{name}");
        }
        let id = id(&LayerParameters::default()).to_string();
        for name in [
            "",
            " x",
            "blur",
            "Blur",
            "flair",
            "a\tb",
            "a\u{202e}b",
            id.as_str(),
            &"x".repeat(65),
        ] {
            assert!(Layer::check_name(name).is_err(), "{name}");
        }
    }
}
