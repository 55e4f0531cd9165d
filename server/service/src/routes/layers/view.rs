//! A layer as clients see it.

use case::{
    CaseId, CaseState, Closed, Contrast, LabelFacts, Layer, LayerKind, MapName, PlacementFacts,
    SurfaceFacts, Transform,
};
use cases::dicom::Choice;
use cases::library::{FlairState, MapsState};
use cases::pictures::{MAPS_OFF, style_of_layer, style_of_map};
use pipeline::Undefined;
use pipeline::maps::{MAP_FORMAT, map_unit};
use render::{ColorMap, OverlayParameters};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa::openapi::schema::{ArrayBuilder, ObjectBuilder, OneOfBuilder, Schema, Type};

use super::address_of;
use http::problem::{AppError, Problem};

/// A layer of a case: a map, which is computed from the case itself, or a volume that was added.
#[derive(Debug, Clone, Default, Serialize, ToSchema)]
#[schema(as = Layer)]
pub struct LayerView {
    /// The id: of a map its name, otherwise 32 hexadecimal digits, the same for the same upload.
    id: String,
    /// The name for `layer`, `overlay` and addresses. The id can be used, too.
    name: String,
    /// `map` for maps of the case and of other programs; `mr`, `ct`, `pet` or `labels`.
    #[schema(value_type = String)]
    kind: LayerKind,
    /// The unit of its values: `1/mm`, `z`, `SUV`, or empty.
    unit: String,
    /// `ready`; of a map of the case also `making`, `undefined` or `off`; of an added layer `queued`, `preparing` or
    /// `failed`.
    state: LayerState,
    /// The reason why it is undefined or off.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    /// The stable name of that reason: `coarse-voxels`, `low-contrast`, `no-white-matter`, `noise-unknown`,
    /// `failed-envelope`, `nothing-deep`, `maps-failed` or `maps-off`; of the map `flair` also `no-flair`, `flair-not-placed`,
    /// `flair-place-doubtful`, `flair-coarse-voxels`, `flair-shows-too-little`, `flair-no-signal` or `flair-bright-fluid`.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason_code: Option<String>,
    /// Why an added layer is closed, as of a case; absent if it is open. It is not drawn then, and it has no map and no places.
    #[serde(skip_serializing_if = "Option::is_none")]
    closed: Option<&'static str>,
    /// The reason why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Problem>,
    /// The default values of the first and the last colour, or of black and white. Absent until it is ready.
    #[serde(skip_serializing_if = "Option::is_none")]
    window: Option<[f64; 2]>,
    /// Its default colours. Absent until it is ready.
    #[serde(skip_serializing_if = "Option::is_none")]
    colormap: Option<ColorMap>,
    /// The default threshold: values up to this are transparent; for diverging colours, magnitudes. Absent if every
    /// value is shown.
    #[serde(skip_serializing_if = "Option::is_none")]
    threshold: Option<f64>,
    /// The default opacity. Absent until it is ready.
    #[serde(skip_serializing_if = "Option::is_none")]
    opacity: Option<f64>,
    /// The contrast of an added layer of the kind `mr`, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    contrast: Option<Contrast>,
    /// The id of the layer that the map `flair` belongs to; it is deleted with that layer. Absent until one is ready.
    #[serde(skip_serializing_if = "Option::is_none")]
    of_layer: Option<String>,
    /// The version of the maps, if it is one of the case.
    #[serde(skip_serializing_if = "Option::is_none")]
    format: Option<u32>,
    /// Where the matrix of an added layer comes from, and its verdict. Absent until it is ready.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    placement: Option<PlacementFacts>,
    /// The requested transform of an added layer: `auto`, `none`, `rigid`, or the matrix.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = transform_schema)]
    transform: Option<Transform>,
    /// The surfaces that an added layer was drawn from; absent if it is of a volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    surface: Option<SurfaceFacts>,
    /// Least and greatest value of an added layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<[f32; 2]>,
    /// How many values of an added layer lay so far beyond all others that they are shown as the end of the range; absent if none.
    #[serde(skip_serializing_if = "Option::is_none")]
    clipped_voxels: Option<u64>,
    /// The grid of the acquisition of an added layer, in its own patient space.
    #[serde(skip_serializing_if = "Option::is_none")]
    grid: Option<LayerGrid>,
    /// The labels of a label map, ascending. The first one has the number 1 in the voxels; after 255, numbers begin
    /// again.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    labels: Vec<LabelFacts>,
    /// The scanner's name of the sequence and its times in ms, if the layer comes from DICOM.
    #[serde(skip_serializing_if = "Option::is_none")]
    sequence: Option<String>,
    /// The address of its voxels.
    volume: String,
    /// When an added layer was uploaded.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(format = DateTime)]
    created_at: Option<String>,
    /// The choice among DICOM files, in the answer to their upload.
    #[serde(skip_serializing_if = "Option::is_none")]
    dicom: Option<Choice>,
}

/// The grid of an added layer.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct LayerGrid {
    /// Voxels along x, y and z.
    size: [usize; 3],
    /// Edges of a voxel, in mm.
    spacing_mm: [f64; 3],
    /// Rows of the affine from voxels to the layer's own patient space, LPS mm.
    patient_from_voxel: [[f64; 4]; 4],
}

/// The state of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum LayerState {
    /// It is available.
    Ready,
    /// The maps are being computed; try again in a moment.
    Making,
    /// The maps are undefined for this head.
    Undefined,
    /// This server computes no maps.
    Off,
    /// It waits for a worker.
    #[default]
    Queued,
    /// A worker prepares it.
    Preparing,
    /// It could not be prepared; `error` states why. Uploading it again starts another attempt.
    Failed,
}

impl From<MapsStateName> for LayerState {
    fn from(state: MapsStateName) -> Self {
        match state {
            MapsStateName::Ready => Self::Ready,
            MapsStateName::Making => Self::Making,
            MapsStateName::Undefined => Self::Undefined,
            MapsStateName::Off => Self::Off,
        }
    }
}

impl From<CaseState> for LayerState {
    fn from(state: CaseState) -> Self {
        match state {
            CaseState::Queued => Self::Queued,
            CaseState::Preparing => Self::Preparing,
            CaseState::Ready => Self::Ready,
            CaseState::Failed => Self::Failed,
        }
    }
}

/// The state of the maps of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum MapsStateName {
    /// They are available.
    Ready,
    /// They are being computed; try again in a moment.
    Making,
    /// They are undefined for this head.
    Undefined,
    /// This server computes none.
    Off,
}

/// The state of the maps of a case, and the reason if there are none.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = MapsState)]
pub struct MapsView {
    /// `ready`, `making`, `undefined` or `off`.
    state: MapsStateName,
    /// The reason why they are undefined or off.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    /// The stable name of that reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason_code: Option<String>,
}

/// A word, or 4 rows of 4 numbers.
fn transform_schema() -> Schema {
    let words = ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(["auto", "none", "rigid"]));
    let four = || ArrayBuilder::new().min_items(Some(4)).max_items(Some(4));
    let number = ObjectBuilder::new().schema_type(Type::Number);
    let rows = four().items(four().items(number));
    OneOfBuilder::new()
        .description(Some(
            "The requested transform of an added layer: `auto`, `none`, `rigid`, or the matrix",
        ))
        .item(words)
        .item(rows)
        .into()
}

impl From<&MapsState> for MapsView {
    fn from(state: &MapsState) -> Self {
        let (state, reason) = match state {
            MapsState::Ready(_) => (MapsStateName::Ready, None),
            MapsState::Making => (MapsStateName::Making, None),
            MapsState::Undefined(reason) => (MapsStateName::Undefined, Some(reason.clone())),
            MapsState::Off => (MapsStateName::Off, Some(MAPS_OFF)),
        };
        let (reason, reason_code) = reason
            .map(|Undefined { code, sentence }| (sentence.into_owned(), code.into_owned()))
            .unzip();
        Self {
            state,
            reason,
            reason_code,
        }
    }
}

impl LayerView {
    /// A map of a case.
    pub(super) fn of_map((id, name): (&CaseId, MapName), maps: &MapsView) -> Self {
        Self {
            id: name.name().to_owned(),
            name: name.name().to_owned(),
            kind: LayerKind::Map,
            unit: map_unit(name).to_owned(),
            state: maps.state.into(),
            reason: maps.reason.clone(),
            reason_code: maps.reason_code.clone(),
            format: Some(MAP_FORMAT),
            volume: format!("/v1/cases/{id}/layers/{}/volume", name.name()),
            ..Self::default()
        }
        .styled(style_of_map(name))
    }

    /// The map of the newest FLAIR.
    pub(super) fn of_flair(id: &CaseId, flair: &FlairState) -> Self {
        Self {
            of_layer: flair.layer.map(|layer| layer.to_string()),
            ..Self::of_map((id, MapName::Flair), &MapsView::from(&flair.state))
        }
    }

    pub(in crate::routes) fn of_layer(layer: &Layer) -> Self {
        let parameters = &layer.parameters;
        let view = Self {
            id: layer.id.to_string(),
            name: layer.name.clone(),
            kind: parameters.kind,
            unit: parameters.unit.clone(),
            contrast: parameters.contrast,
            state: layer.state.into(),
            error: layer
                .failure
                .clone()
                .map(|failure| AppError::from(failure).problem()),
            transform: Some(parameters.transform),
            surface: parameters.surface,
            volume: format!("{}/volume", address_of(layer)),
            created_at: Some(layer.created_at.to_string()),
            closed: layer.closed.map(Closed::name),
            ..Self::default()
        };
        let facts = layer.facts.as_ref();
        let Some(facts) = facts.filter(|_| layer.state == CaseState::Ready) else {
            return view;
        };
        Self {
            placement: Some(facts.placement.clone()),
            range: Some(facts.range),
            clipped_voxels: Some(facts.clipped).filter(|&count| count > 0),
            grid: Some(LayerGrid {
                size: facts.size,
                spacing_mm: facts.spacing_mm,
                patient_from_voxel: facts.patient_from_voxel,
            }),
            labels: facts.labels.clone(),
            sequence: facts.sequence.clone(),
            ..view
        }
        .styled(style_of_layer(parameters.kind, facts))
    }

    /// The same, with the choice among DICOM files.
    #[must_use]
    pub(in crate::routes) fn choosing(self, dicom: Option<Choice>) -> Self {
        Self { dicom, ..self }
    }

    fn styled(self, style: OverlayParameters) -> Self {
        Self {
            window: Some(style.window),
            colormap: Some(style.colormap),
            threshold: style.threshold,
            opacity: Some(style.opacity),
            ..self
        }
    }
}
