//! Values on surfaces, drawn into the voxels of a case.

use std::collections::BTreeMap;

use case::{CaseId, Failure, Layer, LayerKind, LayerParameters, Transform};
use storage::Spooled;
use worker::{SurfaceReading, Surfaces};

use super::subject::facts_of;
use super::{ReceivedLayer, parameters_of};
use crate::application::Cases;
use crate::dicom::{Drawing, Options, Space};
use crate::error::Error;
use crate::intake::VolumeFiles;

/// Surfaces with values, which become a layer.
#[derive(Debug)]
pub struct ReceivedSurfaces {
    pub case: CaseId,
    /// Each with its values, unless they are in the same file.
    pub files: Vec<(Spooled, Option<Spooled>)>,
    /// The volume that `tkregister` coordinates belong to.
    pub t1: Option<Spooled>,
    /// What the client states about coordinates.
    pub space: Option<Space>,
    /// Which column of the values, from 1.
    pub column: Option<usize>,
    pub name: Option<String>,
    /// Map or labels; if it is not stated, the files decide.
    pub kind: Option<LayerKind>,
    pub unit: Option<String>,
    /// The other parameters. Names of labels are added to those of the files.
    pub parameters: LayerParameters,
}

impl Cases {
    /// Draws surfaces into a volume in the grid of a ready case, which is then a layer as any other.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::Failure`] that states what is wrong with the files; or an error of the store.
    pub async fn draw_surfaces(&self, new: ReceivedSurfaces) -> Result<ReceivedLayer, Error> {
        let facts = self.ready(&new.case).await?;
        let is_acquired = new.kind.is_some_and(LayerKind::is_acquired);
        if is_acquired || new.parameters.transform != Transform::Auto {
            let detail = "values of a surface are a layer of the kind `map` or `labels` without a `transform`, because they lie where the surface lies";
            return Err(Failure::unusable("surface-parameters", detail).into());
        }
        // Before the files are read, which takes long.
        if let Some(name) = &new.name {
            Layer::check_name(name)?;
        }
        let kind = new.kind.unwrap_or(match new.parameters.labels.is_empty() {
            true => LayerKind::Map,
            false => LayerKind::Labels,
        });
        let (name, unit) = (new.name.as_deref(), new.unit.clone());
        parameters_of(None, name, Some(kind), unit, new.parameters.clone())?;
        let surfaces = Surfaces {
            files: &new.files,
            t1: new.t1.as_ref(),
            drawing: Drawing {
                size: facts.native_size,
                patient_from_voxel: facts.native_patient_from_voxel,
                space: new.space,
                column: new.column,
                are_labels: new.kind.map(|kind| kind == LayerKind::Labels),
            },
        };
        let scratch = self.store().spools().path();
        let reading: SurfaceReading = self.dicom.read_surfaces(surfaces, &scratch).await?;
        let volume = self.store().spools().take(reading.file()).await?;
        let drawn = reading.drawn;
        let surface = facts_of(&drawn);
        let kind = match drawn.are_labels {
            true => LayerKind::Labels,
            false => LayerKind::Map,
        };
        let mut labels = match kind {
            LayerKind::Labels => LayerParameters::fitting_labels(drawn.names),
            _ => BTreeMap::new(),
        };
        labels.extend(new.parameters.labels);
        Ok(ReceivedLayer {
            case: new.case,
            volume: VolumeFiles::One(volume),
            options: Options::default(),
            name: new.name,
            kind: Some(kind),
            unit: new.unit,
            parameters: LayerParameters {
                labels,
                surface: Some(surface),
                contrast: new.parameters.contrast,
                ..LayerParameters::default()
            },
        })
    }
}
