//! The layers of cases: prepared from their sources, and cached in memory as they are drawn.

use std::sync::Arc;

use bytes::Bytes;
use case::{CaseFacts, CaseState, Failure, Layer as LayerRow, LayerFacts, LayerKind, ObjectKind};
use geometry::{Envelope, Volume};
use glam::DVec3;
use pipeline::codec::decode_volume;
use pipeline::layers::{
    LayerCase, LayerSource, PreparedLayer, UNDEFINED_CODE, decode_layer, prepare_layer,
};
use pipeline::{affine_of, envelope_of};
use render::{KeyedLayer, Layer, LayerKey, LayerValues};
use storage::{Owner, StoreError};

use super::Library;
use crate::cache::Part;
use crate::error::Error;
use crate::pictures::ready;
use crate::profile::{ProfileLayer, SampledLayer};

/// The colours of labels: after the last one, they begin again.
const LABEL_COLORS: u16 = 255;

/// The voxels of a layer and its facts.
#[derive(Debug)]
pub struct LayerVoxels {
    /// Stored values around the envelope, on the grid of the acquisition; 0 is undefined.
    pub volume: Volume,
    pub facts: LayerFacts,
    /// What the values are.
    pub kind: LayerKind,
}

impl LayerVoxels {
    /// The grid of the voxels in the patient space of the case.
    ///
    /// # Errors
    /// [`Error::Geometry`] if the placement is beyond all bounds.
    pub fn grid_in_case(&self) -> Result<geometry::Grid, Error> {
        let grid = self.volume.grid();
        let case_from_layer = affine_of(&self.facts.placement.case_from_layer);
        let affine = case_from_layer * grid.patient_from_voxel();
        Ok(geometry::Grid::new(grid.size(), affine)?)
    }

    /// The number of the colour of each voxel of a label map, 1 to 255; 0 is no label.
    pub fn label_colors(&self) -> Vec<u8> {
        self.volume
            .voxels()
            .iter()
            .map(|&code| label_color(code))
            .collect()
    }

    fn into_layer(self, row: &LayerRow) -> Result<Layer, Error> {
        let names = [row.name.as_str(), row.parameters.unit.as_str()];
        let values = match self.kind {
            LayerKind::Labels => {
                let labels = (1..).zip(&self.facts.labels);
                let named = labels.map(|(code, label)| (label_color(code), label.name.clone()));
                LayerValues::Labels {
                    names: named.collect(),
                    codes: self.label_colors(),
                }
            }
            _ => {
                let number = |&code: &u16| match code {
                    UNDEFINED_CODE => f32::NAN,
                    code => self.volume.intensity(f32::from(code)),
                };
                LayerValues::Numbers(self.volume.voxels().iter().map(number).collect())
            }
        };
        let placement = &self.facts.placement;
        let case_from_layer = affine_of(&placement.case_from_layer);
        let layer = Layer::new(names, self.volume.grid(), case_from_layer, values)?;
        let review = match placement.quality {
            case::QualityState::Ok => "",
            _ => ", not checked",
        };
        Ok(layer.placed(&format!("{}{review}", placement.origin.words())))
    }
}

/// The number of the colour of a stored label; 0 is no label.
fn label_color(code: u16) -> u8 {
    match code.checked_sub(1) {
        Some(number) => (number % LABEL_COLORS) as u8 + 1,
        None => 0,
    }
}

impl SampledLayer {
    /// Its value at a position (LPS, mm); of labels, which of the list it is, from 1. It is sampled as it is drawn, so more labels than there are
    /// colours cannot be told, and have no value.
    pub(crate) fn value_at(&self, position: DVec3) -> Option<f32> {
        let is_told = self.about.labels.len() <= usize::from(LABEL_COLORS);
        self.layer.value_at(position).filter(|_| is_told)
    }
}

impl Library {
    /// A layer, ready for drawing.
    ///
    /// # Errors
    /// As [`Library::layer_voxels`].
    pub async fn layer(&self, row: &LayerRow) -> Result<KeyedLayer, Error> {
        let part = Part::Layer(row.id, row.name.clone());
        let load = async {
            let voxels = self.layer_voxels(row).await?;
            let owned = row.clone();
            let layer = tokio::task::spawn_blocking(move || voxels.into_layer(&owned)).await;
            let key = row.case.number().rotate_left(1) ^ row.id.number();
            Ok::<_, Error>(KeyedLayer {
                key: LayerKey(key),
                layer: Arc::new(layer.map_err(StoreError::from)??),
            })
        };
        let kept = self.cache().get_or_make(&row.case, part, load).await?;
        Ok((*kept).clone())
    }

    /// A layer for a profile.
    ///
    /// # Errors
    /// As [`Library::layer_voxels`].
    pub async fn sampled(&self, row: &LayerRow) -> Result<SampledLayer, Error> {
        let about = ProfileLayer {
            id: row.id,
            name: row.name.clone(),
            unit: row.parameters.unit.clone(),
            labels: ready(row)?.labels.clone(),
        };
        let layer = self.layer(row).await?.layer;
        Ok(SampledLayer { about, layer })
    }

    /// The stored voxels of a layer that is ready. If they are missing or damaged, the layer is prepared again.
    ///
    /// # Errors
    /// [`Error::LayerNotReady`], the failure of a failed layer, or an error of the store.
    pub async fn layer_voxels(&self, row: &LayerRow) -> Result<LayerVoxels, Error> {
        let facts = ready(row)?.clone();
        let volume = self.stored_voxels(row).await?;
        Ok(LayerVoxels {
            volume: volume.ok_or(Error::LayerNotReady)?,
            facts,
            kind: row.parameters.kind,
        })
    }

    /// The stored voxels of a layer that is ready; `None` if they are missing or damaged, and the layer is prepared again.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`], or if the store cannot be reached.
    pub(super) async fn stored_voxels(&self, row: &LayerRow) -> Result<Option<Volume>, StoreError> {
        let (store, owner) = (self.store(), Owner::from((&row.case, &row.id)));
        let names = store.objects_of(owner).await?;
        let payload = store.read(owner, &names, ObjectKind::Layer).await?;
        let decode = move || payload.and_then(|payload| decode_layer(&payload));
        let volume = tokio::task::spawn_blocking(decode).await?;
        if volume.is_none() {
            // A layer whose source is missing stays as it is.
            self.layer_source(row).await?;
        }
        if volume.is_none() && store.prepare_again(owner, CaseState::Ready).await? {
            tracing::warn!(
                case = row.case.short(),
                "the voxels of a layer are lost; it is prepared again from its source"
            );
        }
        Ok(volume)
    }

    /// Prepares a layer on a blocking thread; `None` if its case is gone.
    pub(crate) async fn prepare_layer(
        &self,
        row: &LayerRow,
    ) -> Result<Option<Result<PreparedLayer, Failure>>, StoreError> {
        const KINDS: &[ObjectKind] = &[ObjectKind::Envelope, ObjectKind::Volume];
        let Some(source) = self.layer_source(row).await? else {
            return Ok(Some(Err(Failure::source_damaged())));
        };
        let decode = |facts: &CaseFacts, payloads: &[Bytes]| {
            let [envelope, volume] = payloads else {
                return None;
            };
            let envelope = envelope_of(facts, envelope)?;
            Some((envelope, decode_volume(volume)?, facts.clone()))
        };
        let Some(prepared) = self.load(&row.case, KINDS, decode).await? else {
            return Ok(None);
        };
        let names = self.store().objects_of(&row.case).await?;
        let Some(own) = self.source(&row.case, &names).await? else {
            return Ok(Some(Err(Failure::source_damaged())));
        };
        let (limits, row) = (self.limits(), row.clone());
        let prepare = move || {
            let (envelope, volume, facts): (Envelope, Volume, CaseFacts) = prepared;
            let case = LayerCase {
                facts: &facts,
                envelope: &envelope,
                volume: &volume,
                source: &own.volume,
                dicom: own.dicom.as_deref(),
            };
            let kept = row.facts.as_ref().map(|facts| &facts.placement);
            prepare_layer(&source, &row.parameters, &limits, &case, kept)
        };
        Ok(Some(tokio::task::spawn_blocking(prepare).await?))
    }

    /// The uploaded files of a layer; `None`, reported, if one is damaged.
    ///
    /// # Errors
    /// [`StoreError::SourceMissing`], or if the store cannot be reached.
    async fn layer_source(&self, row: &LayerRow) -> Result<Option<LayerSource>, StoreError> {
        let (store, owner) = (self.store(), Owner::from((&row.case, &row.id)));
        let names = store.objects_of(owner).await?;
        let Some(volume) = store.read(owner, &names, ObjectKind::SourceLayer).await? else {
            return Ok(None);
        };
        let is_dicom = names
            .iter()
            .any(|name| name.kind == ObjectKind::SourceDicom);
        let dicom = store.read(owner, &names, ObjectKind::SourceDicom).await?;
        Ok((dicom.is_some() == is_dicom).then_some(LayerSource { volume, dicom }))
    }
}
