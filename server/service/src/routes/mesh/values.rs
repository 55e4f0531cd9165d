//! Values of the vertices of a mesh.

use std::sync::Arc;

use case::{CandidateFacts, CaseId, MapName};
use cases::Cases;
use cases::findings::{FindingLabels, Findings, name_of};
use cases::library::LoadedMaps;
use cases::nifti::{place_label, place_radius_mm};
use cases::pictures::ChosenLayer;
use cases::profile;
use geometry::DeformableModel;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::wire::VertexLabel;
use http::problem::AppError;

/// What the vertices of a mesh have values of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum VertexValues {
    /// The intensity of the native volume, interpolated.
    Intensity,
    /// The depth in mm: less than that of the mesh where a path ends before it.
    Depth,
    /// The map `blur`.
    Blur,
    /// The map `thickness`.
    Thickness,
    /// The map of the newest FLAIR among the layers.
    Flair,
    /// The number of the finding there in the list of findings, as in its NIfTI labels.
    Findings,
    /// The rank of the place there in the list of blurred places of the cerebrum: a ball of its size.
    BlurPlaces,
    /// The same of thick places.
    ThicknessPlaces,
    /// The same of places that are bright in the newest FLAIR.
    FlairPlaces,
}

impl VertexValues {
    fn map(self) -> Option<MapName> {
        match self {
            Self::Intensity | Self::Depth | Self::Findings => None,
            Self::Blur | Self::BlurPlaces => Some(MapName::Blur),
            Self::Thickness | Self::ThicknessPlaces => Some(MapName::Thickness),
            Self::Flair | Self::FlairPlaces => Some(MapName::Flair),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Intensity => "intensity",
            Self::Depth => "depth",
            Self::Blur => "blur",
            Self::Thickness => "thickness",
            Self::Flair => "flair",
            Self::Findings => "findings",
            Self::BlurPlaces => "blur-places",
            Self::ThicknessPlaces => "thickness-places",
            Self::FlairPlaces => "flair-places",
        }
    }

    /// Whether they are numbers of labels.
    pub(super) fn are_labels(self) -> bool {
        matches!(
            self,
            Self::Findings | Self::BlurPlaces | Self::ThicknessPlaces | Self::FlairPlaces
        )
    }
}

/// What can change of the values of a case.
pub(super) enum Changing {
    Nothing,
    Map(ChosenLayer),
    Findings(Findings),
}

impl Changing {
    pub(super) async fn of(
        values: Option<VertexValues>,
        cases: &Cases,
        id: &CaseId,
    ) -> Result<Self, AppError> {
        Ok(match (values, values.and_then(VertexValues::map)) {
            (Some(VertexValues::Findings), _) => Self::Findings(cases.findings(id).await?),
            (_, Some(map)) => Self::Map(cases.map(id, map).await?),
            _ => Self::Nothing,
        })
    }

    /// Names the present state.
    pub(super) fn version(&self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Map(map) => Some(map.version()),
            Self::Findings(findings) => Some(findings.version.to_string()),
        }
    }

    /// Reads what the values are of.
    pub(super) async fn read(
        &self,
        cases: &Cases,
        id: &CaseId,
    ) -> Result<Option<Source>, AppError> {
        Ok(match self {
            Self::Nothing => None,
            Self::Map(map) => Some(Source::Maps(map.maps(&cases.library, id).await?)),
            Self::Findings(findings) => {
                let list = findings.list.clone();
                Some(Source::Findings(
                    cases.findings_in_voxels(id, list).await?.into(),
                ))
            }
        })
    }
}

/// What values of vertices are read from, beside the model.
#[derive(Clone)]
pub(super) enum Source {
    Maps(Arc<LoadedMaps>),
    Findings(Arc<FindingLabels>),
}

/// The values of the vertices of a case.
#[derive(Clone)]
pub(super) struct Values {
    pub(super) of: VertexValues,
    pub(super) source: Option<Source>,
}

impl Values {
    /// The value at a position (LPS mm) in a surface.
    pub(super) fn at(&self, model: &DeformableModel, position: DVec3) -> Option<f32> {
        match (&self.source, self.of.map()) {
            (Some(Source::Maps(maps)), Some(name)) if !self.of.are_labels() => {
                maps.layer(name).value_at(position)
            }
            (Some(Source::Maps(maps)), Some(name)) => {
                let is_there = |place: &CandidateFacts| {
                    let middle = DVec3::from_array(place.position_in_patient);
                    middle.distance(position) <= place_radius_mm(place)
                };
                let rank = maps.places(name).iter().position(is_there)?;
                Some(rank as f32 + 1.0)
            }
            (Some(Source::Findings(findings)), _) => {
                let voxel = findings
                    .grid
                    .voxel_from_patient()
                    .transform_point3(position);
                let index = findings.grid.nearest(voxel)?;
                Some(findings.labels[index].into()).filter(|&number| number > 0.0)
            }
            _ if self.of == VertexValues::Depth => Some(profile::depth_mm(model.field(), position)),
            _ => model.volume().intensity_at(position),
        }
    }

    /// The labels that they are numbers of.
    pub(super) fn labels(&self) -> Vec<VertexLabel> {
        match &self.source {
            Some(Source::Findings(findings)) => {
                let label = |(number, finding): &(u16, case::findings::Finding)| {
                    let digits = finding.colour.trim_start_matches('#');
                    let colour = u32::from_str_radix(digits, 16).unwrap_or_default();
                    let [_, red, green, blue] = colour.to_be_bytes();
                    VertexLabel {
                        number: *number,
                        name: name_of(finding).to_owned(),
                        colour: [red, green, blue],
                    }
                };
                findings.findings.iter().map(label).collect()
            }
            Some(Source::Maps(maps)) => {
                let name = self.of.map().unwrap_or(MapName::Blur);
                let label = |(rank, place): (u16, &CandidateFacts)| VertexLabel {
                    number: rank,
                    name: place_label(rank, place),
                    colour: render::label_color(usize::from(rank)),
                };
                (1..).zip(maps.places(name)).map(label).collect()
            }
            None => Vec::new(),
        }
    }
}
