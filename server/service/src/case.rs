//! A case: one head, from the upload to the facts that a client needs to show it.

use std::fmt;
use std::str::FromStr;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::quality::Quality;

/// Part of every [`CaseId`]: a change of what is computed from the same input makes other cases of it.
const ID_FORMAT: u8 = 1;

/// The digest that names a case: 32 lower-case hexadecimal digits.
///
/// It is the first half of a BLAKE3 digest over the volume, the mask and the parameters that change the result. The same
/// input is the same case, wherever and whenever it is uploaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CaseId([u8; 16]);

impl CaseId {
    /// The name of the case with these inputs. The digests are BLAKE3 over the bytes as uploaded.
    ///
    /// [`Parameters::name`] is a label and takes no part: the same upload under another name renames the case. Which case
    /// it is a version of takes no part either.
    pub fn of(volume: &blake3::Hash, mask: Option<&blake3::Hash>, parameters: &Parameters) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"isocortex case");
        hasher.update(&[ID_FORMAT]);
        hasher.update(volume.as_bytes());
        hasher.update(&[u8::from(mask.is_some())]);
        if let Some(mask) = mask {
            hasher.update(mask.as_bytes());
        }
        // Adding 0 makes the one zero of the two.
        hasher.update(&(Self::closing_radius_mm(parameters) + 0.0).to_le_bytes());
        // What has its default is not said, so that a new parameter leaves the cases before it their names.
        let defaults = Self::about_mask(&Parameters::default());
        let about_mask = Self::about_mask(parameters);
        if about_mask != defaults {
            hasher.update(&about_mask);
        }
        let mut id = [0; 16];
        id.copy_from_slice(&hasher.finalize().as_bytes()[..16]);
        Self(id)
    }

    /// What is closed already is not closed, by whatever radius: it stands as the default one, so that stored names stay.
    fn closing_radius_mm(parameters: &Parameters) -> f64 {
        match parameters.mask_kind {
            MaskKind::Brain => parameters.closing_radius_mm,
            MaskKind::Envelope => Parameters::default().closing_radius_mm,
        }
    }

    fn about_mask(parameters: &Parameters) -> [u8; 18] {
        let mut bytes = [0; 18];
        bytes[0] = parameters.mask as u8;
        bytes[1] = parameters.mask_kind as u8;
        bytes[2..10].copy_from_slice(&(parameters.threshold + 0.0).to_le_bytes());
        bytes[10..].copy_from_slice(&(parameters.offset_mm + 0.0).to_le_bytes());
        bytes
    }

    /// Reads 32 lower-case hexadecimal digits; `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let digit = |byte: u8| match byte {
            b'0'..=b'9' => Some(byte - b'0'),
            b'a'..=b'f' => Some(byte - b'a' + 10),
            _ => None,
        };
        let digits: &[u8; 32] = text.as_bytes().try_into().ok()?;
        let mut id = [0; 16];
        for (byte, pair) in id.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Some(Self(id))
    }
}

impl CaseId {
    /// The id as a number.
    pub fn number(&self) -> u128 {
        u128::from_be_bytes(self.0)
    }
}

impl fmt::Display for CaseId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0
            .iter()
            .try_for_each(|byte| write!(formatter, "{byte:02x}"))
    }
}

/// The text is not a [`CaseId`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a case is named by 32 lower-case hexadecimal digits")]
pub struct NotACaseId;

impl FromStr for CaseId {
    type Err = NotACaseId;

    fn from_str(text: &str) -> Result<Self, NotACaseId> {
        Self::parse(text).ok_or(NotACaseId)
    }
}

impl Serialize for CaseId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for CaseId {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = <std::borrow::Cow<'de, str>>::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// Where the mask of the brain comes from when none is supplied.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    Serialize,
    Deserialize,
    utoipa::ToSchema,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
#[clap(rename_all = "snake_case")]
pub enum MaskSource {
    /// From the volume where that is skull-stripped already; else the brain is extracted.
    #[default]
    Auto,
    /// From the volume, which must be skull-stripped: its background is exactly 0.
    Volume,
    /// Extracted by the network alone, which must be there.
    Network,
    /// Extracted by tree pruning. What `auto` becomes where the brain must be extracted and there is no network.
    Pruning,
}

/// What a supplied mask shows.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    Serialize,
    Deserialize,
    utoipa::ToSchema,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
#[clap(rename_all = "snake_case")]
pub enum MaskKind {
    /// The brain, which is closed to the envelope.
    #[default]
    Brain,
    /// The envelope itself: it is not closed. Its largest component is kept and its holes are filled all the same.
    Envelope,
}

/// What a client may choose when it uploads a volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// Radius of the ball that closes the brain mask to the envelope, in mm: 0 to 50.
    pub closing_radius_mm: f64,
    /// Where the mask comes from when none is supplied.
    pub mask: MaskSource,
    /// What the mask shows.
    pub mask_kind: MaskKind,
    /// The probability above which a voxel is brain where the brain is extracted by the network: 0.05 to 0.95.
    pub threshold: f64,
    /// By how much the mask's surface is moved outwards (inwards where negative) before it is closed, in mm: -20 to 20.
    pub offset_mm: f64,
    /// A label to show in lists; at most [`Parameters::MAX_NAME_LENGTH`] characters, none of them a control character.
    ///
    /// It is no part of the [`CaseId`]: the label of the first upload stays.
    pub name: Option<String>,
}

impl Parameters {
    /// The longest accepted [`name`](Self::name), in characters.
    pub const MAX_NAME_LENGTH: usize = 200;

    /// Whether the parameters may be used.
    ///
    /// # Errors
    /// A [`Failure`] with status 422 when a number is out of its range, or the name is too long or holds control characters.
    pub fn check(&self) -> Result<(), Failure> {
        for (name, value, range) in [
            ("closing_radius_mm", self.closing_radius_mm, 0.0..=50.0),
            ("threshold", self.threshold, 0.05..=0.95),
            ("offset_mm", self.offset_mm, -20.0..=20.0),
        ] {
            if !range.contains(&value) {
                let (least, most) = range.into_inner();
                let kind = format!(
                    "{}-out-of-range",
                    name.trim_end_matches("_mm").replace('_', "-")
                );
                let detail = format!("{name} is {value}; it must be {least} to {most}");
                return Err(Failure::unprocessable(&kind, detail));
            }
        }
        let name = self.name.as_deref().unwrap_or_default();
        if name.chars().count() > Self::MAX_NAME_LENGTH {
            return Err(Failure::unprocessable(
                "name-too-long",
                format!(
                    "the name is longer than {} characters",
                    Self::MAX_NAME_LENGTH
                ),
            ));
        }
        if name.chars().any(char::is_control) {
            return Err(Failure::unprocessable(
                "name-not-text",
                "the name holds a control character".to_owned(),
            ));
        }
        Ok(())
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            closing_radius_mm: 10.0,
            mask: MaskSource::default(),
            mask_kind: MaskKind::default(),
            threshold: 0.5,
            offset_mm: 0.0,
            name: None,
        }
    }
}

/// How far a case has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CaseState {
    /// Waits for a worker.
    Queued,
    /// A worker prepares it.
    Preparing,
    /// Everything can be asked of it.
    Ready,
    /// It could not be prepared; the [`Failure`] says why. The same upload again tries again.
    Failed,
}

impl CaseState {
    /// Whether the state stays as it is until somebody uploads or deletes.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Ready | Self::Failed)
    }
}

/// The steps of a preparation, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// The uploaded bytes are read.
    Reading,
    /// The brain is extracted. Only where no mask was supplied and the volume shows more than a brain.
    Extracting,
    /// The brain mask comes to the working grid.
    Mask,
    /// The mask is closed to the envelope.
    Closing,
    /// The exact distance map.
    Distance,
    /// The seeds of the forest.
    Core,
    /// The optimal-path forest.
    Forest,
    /// The default mesh and the table of its paths.
    Mesh,
    /// The results are written to the store.
    Storing,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 9] = [
        Self::Reading,
        Self::Extracting,
        Self::Mask,
        Self::Closing,
        Self::Distance,
        Self::Core,
        Self::Forest,
        Self::Mesh,
        Self::Storing,
    ];

    /// The stage of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == name)
    }

    /// The name used in JSON and in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::Extracting => "extracting",
            Self::Mask => "mask",
            Self::Closing => "closing",
            Self::Distance => "distance",
            Self::Core => "core",
            Self::Forest => "forest",
            Self::Mesh => "mesh",
            Self::Storing => "storing",
        }
    }
}

/// How far a preparation has come.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The step at work.
    pub stage: Stage,
    /// How much of the whole preparation is done, 0 to 1.
    pub fraction: f32,
}

/// Why an input cannot be prepared, in words that a client may read: no paths, nothing of the patient.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct Failure {
    /// A stable name in kebab case, such as `mask-missing`.
    pub kind: String,
    /// One plain sentence.
    pub detail: String,
    /// The HTTP status that fits: 413, 415, 422, 500 …
    pub status: u16,
}

impl Failure {
    /// A failure with status 422: the input is understood and cannot be used.
    pub fn unprocessable(kind: &str, detail: String) -> Self {
        Self {
            kind: kind.to_owned(),
            detail,
            status: 422,
        }
    }
}

/// A DICOM window: the intensities from `center - width / 2` to `center + width / 2` span the grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindowFacts {
    /// Window centre, in intensities.
    pub center: f32,
    /// Window width, in intensities; above 0.
    pub width: f32,
}

/// A sphere in the patient.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SphereFacts {
    /// Its centre, LPS mm.
    pub center_in_patient: [f64; 3],
    /// Its radius in mm.
    pub radius_mm: f64,
}

/// A plane in the patient: the points `p` (LPS mm) with `normal · p = offset_mm`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlaneFacts {
    /// The direction across it, of length 1, LPS.
    pub normal: [f64; 3],
    /// Its distance from the origin along the normal, in mm.
    pub offset_mm: f64,
}

/// What is known of a case once it is ready.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseFacts {
    /// Voxels of the working grid along L, P and S.
    pub grid_size: [usize; 3],
    /// Edge of a voxel of the working grid, in mm.
    pub spacing_mm: f64,
    /// Rows of the affine from voxels of the working grid to LPS mm.
    pub patient_from_voxel: [[f64; 4]; 4],
    /// Voxels of the volume as it was acquired.
    pub native_size: [usize; 3],
    /// Edges of a voxel of the volume as it was acquired, in mm.
    pub native_spacing_mm: [f64; 3],
    /// Rows of the affine from voxels of the volume as it was acquired to LPS mm.
    pub native_patient_from_voxel: [[f64; 4]; 4],
    /// The sphere around the envelope that zoom 1 fits into a picture.
    pub envelope_sphere: SphereFacts,
    /// The plane between the hemispheres, its normal to the patient's left; `None` for a case that was prepared before it
    /// was fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub midsagittal: Option<PlaneFacts>,
    /// Depth of the deepest voxel, in mm.
    pub max_depth_mm: f32,
    /// Volume enclosed by the envelope, in ml.
    pub envelope_ml: f64,
    /// Least intensity of the stored volume.
    pub intensity_min: f32,
    /// Greatest intensity of the stored volume.
    pub intensity_max: f32,
    /// The default window: 2nd to 98th percentile inside the envelope.
    pub window: WindowFacts,
    /// How far the mask can be trusted; `None` for a case that was prepared before that was measured.
    #[serde(default)]
    pub quality: Option<Quality>,
    /// Of a volume that was made of DICOM files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dicom: Option<DicomFacts>,
    /// Wall time of each step of the preparation, in ms.
    pub timings: Vec<(Stage, f64)>,
}

/// What is told of DICOM files that a volume was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DicomFacts {
    /// Numbers of the slices, from 1, that were missing and are interpolated between their neighbours.
    pub interpolated_slices: Vec<usize>,
}

/// A case as its row tells it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// Its name.
    pub id: CaseId,
    /// What was chosen at the upload, with the label.
    pub parameters: Parameters,
    /// How far it has come.
    pub state: CaseState,
    /// While it is prepared.
    pub progress: Option<Progress>,
    /// Once it has failed.
    pub failure: Option<Failure>,
    /// Once it is ready.
    pub facts: Option<CaseFacts>,
    /// The case of which it is a version, with another mask or other parameters.
    pub previous: Option<CaseId>,
    /// Its own versions, oldest first.
    pub next: Vec<CaseId>,
    /// When it was first uploaded.
    pub created_at: Timestamp,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_read_back_as_it_was_written() {
        let id = CaseId::of(&blake3::hash(b"volume"), None, &Parameters::default());
        assert_eq!(CaseId::parse(&id.to_string()), Some(id));
        assert_eq!(
            serde_json::from_str::<CaseId>(&serde_json::to_string(&id).unwrap()).unwrap(),
            id
        );
    }

    #[test]
    fn the_names_of_cases_that_are_stored_already_stay() {
        let id = CaseId::of(&blake3::hash(b"volume"), None, &Parameters::default());
        assert_eq!(id.to_string(), "c4a2355cd84497c3678626aa8188b7c3");
    }

    #[test]
    fn anything_but_32_lower_case_digits_is_no_id() {
        for text in [
            "",
            "00",
            &"g".repeat(32),
            &"A".repeat(32),
            &"0".repeat(33),
            "../../../../../../../../etc/pass",
        ] {
            assert_eq!(CaseId::parse(text), None, "{text}");
        }
    }

    #[test]
    fn each_input_but_the_name_changes_the_id() {
        let [a, b] = [blake3::hash(b"a"), blake3::hash(b"b")];
        let parameters = Parameters::default();
        let id = CaseId::of(&a, None, &parameters);
        assert_ne!(id, CaseId::of(&b, None, &parameters));
        assert_ne!(id, CaseId::of(&a, Some(&b), &parameters));
        assert_ne!(
            CaseId::of(&a, Some(&b), &parameters),
            CaseId::of(&b, Some(&a), &parameters)
        );
        assert_ne!(
            id,
            CaseId::of(
                &a,
                None,
                &Parameters {
                    closing_radius_mm: 9.0,
                    ..Parameters::default()
                }
            )
        );
        for other in [
            Parameters {
                mask: MaskSource::Volume,
                ..Parameters::default()
            },
            Parameters {
                mask: MaskSource::Network,
                ..Parameters::default()
            },
            Parameters {
                mask: MaskSource::Pruning,
                ..Parameters::default()
            },
            Parameters {
                mask_kind: MaskKind::Envelope,
                ..Parameters::default()
            },
            Parameters {
                threshold: 0.4,
                ..Parameters::default()
            },
            Parameters {
                offset_mm: -1.0,
                ..Parameters::default()
            },
        ] {
            assert_ne!(id, CaseId::of(&a, None, &other));
        }
        assert_eq!(
            id,
            CaseId::of(
                &a,
                None,
                &Parameters {
                    name: Some("x".to_owned()),
                    ..parameters
                }
            )
        );
    }

    #[test]
    fn the_radius_of_a_closing_that_is_not_done_takes_no_part_in_the_id() {
        let volume = blake3::hash(b"volume");
        let id = |mask_kind, closing_radius_mm| {
            let parameters = Parameters {
                mask_kind,
                closing_radius_mm,
                ..Parameters::default()
            };
            CaseId::of(&volume, None, &parameters)
        };
        assert_eq!(id(MaskKind::Envelope, 10.0), id(MaskKind::Envelope, 4.0));
        assert_ne!(id(MaskKind::Brain, 10.0), id(MaskKind::Brain, 4.0));
        assert_ne!(id(MaskKind::Brain, 10.0), id(MaskKind::Envelope, 10.0));
    }

    #[test]
    fn stages_have_one_name_in_json_and_in_rows() {
        for stage in Stage::ALL {
            assert_eq!(serde_json::to_value(stage).unwrap(), stage.name());
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let radius = Parameters {
            closing_radius_mm: f64::NAN,
            ..Parameters::default()
        }
        .check()
        .unwrap_err();
        assert_eq!(radius.kind, "closing-radius-out-of-range");
        let name = Parameters {
            name: Some("a\u{7}".to_owned()),
            ..Parameters::default()
        }
        .check()
        .unwrap_err();
        assert_eq!((name.kind.as_str(), name.status), ("name-not-text", 422));
    }
}
