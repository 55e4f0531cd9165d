//! Layers: further volumes of the head of a case, with their voxels as they were acquired and their place in the case.

mod fit;
mod place;
#[cfg(test)]
mod tests;
mod voxels;

use bytes::Bytes;
use case::{Failure, LayerFacts, LayerKind, LayerParameters, PlacementFacts};
use geometry::{Envelope, Grid, Volume};
use imaging::nifti;

use crate::affine::{affine_of, rows_of};
use crate::codec::{decode_volume, encode_volume};
use crate::failure::from_imaging;
use crate::{Limits, attributes, sequence_of};

use self::place::{Space, place, place_of_surface, with_assumed_axes};
use self::voxels::{Seen, Voxels, outside};

pub use self::place::LayerCase;
pub use self::voxels::UNDEFINED_CODE;

/// What is kept of a layer beyond the envelope, in mm.
const MARGIN_MM: f64 = 10.0;

/// The uploaded files of a layer.
#[derive(Debug, Clone, Default)]
pub struct LayerSource {
    pub volume: Bytes,
    /// The identifying attributes, if it comes from DICOM.
    pub dicom: Option<Bytes>,
}

/// A layer, ready to be stored.
#[derive(Debug)]
pub struct PreparedLayer {
    /// The payload of [`ObjectKind::Layer`](case::ObjectKind::Layer).
    pub payload: Bytes,
    /// The facts for clients.
    pub facts: LayerFacts,
}

/// Checks an upload by reading it.
///
/// # Errors
/// A [`Failure`] that states what is wrong with the volume or the parameters.
pub fn check_layer(
    source: &LayerSource,
    parameters: &LayerParameters,
    limits: &Limits,
) -> Result<(), Failure> {
    parameters.check()?;
    read(source, parameters, limits).map(drop)
}

fn read(
    source: &LayerSource,
    parameters: &LayerParameters,
    limits: &Limits,
) -> Result<(Voxels, bool), Failure> {
    let values = nifti::read_values(&source.volume, limits).map_err(from_imaging)?;
    let is_in_scanner_space = values.is_in_scanner_space;
    Ok((Voxels::of(values, parameters)?, is_in_scanner_space))
}

/// Reads a layer and finds its place, or keeps the place of an earlier preparation.
///
/// # Errors
/// A [`Failure`] that states what is wrong with the volume, or that it cannot be placed.
pub fn prepare_layer(
    source: &LayerSource,
    parameters: &LayerParameters,
    limits: &Limits,
    case: &LayerCase<'_>,
    kept: Option<&PlacementFacts>,
) -> Result<PreparedLayer, Failure> {
    parameters.check()?;
    let (voxels, is_in_scanner_space) = read(source, parameters, limits)?;
    let dicom = source.dicom.as_deref().map(attributes).transpose()?;
    let placement = match kept {
        Some(placement) => placement.clone(),
        None => {
            let space = Space::new(case, limits, (dicom.as_ref(), is_in_scanner_space))?;
            let placement = match parameters.surface {
                Some(_) => place_of_surface(case, &source.volume)?,
                None => place(case, &voxels.volume, parameters, &space)?,
            };
            match nifti::are_axes_assumed(&source.volume, limits).map_err(from_imaging)? {
                true => with_assumed_axes(placement),
                false => placement,
            }
        }
    };
    let case_from_layer = affine_of(&placement.case_from_layer);
    let seen = Seen::inside(case.envelope, &voxels.volume, case_from_layer);
    let facts = LayerFacts {
        size: voxels.volume.grid().size(),
        spacing_mm: voxels.volume.grid().spacing_mm(),
        patient_from_voxel: rows_of(voxels.volume.grid().patient_from_voxel()),
        placement,
        range: voxels.range,
        clipped: voxels.clipped,
        window: voxels.window(&seen, parameters)?,
        labels: voxels.labels.clone(),
        sequence: dicom.and_then(|dicom| sequence_of(&dicom.attributes)),
    };
    let around = around(&voxels.volume, case.envelope, case_from_layer).ok_or_else(outside)?;
    Ok(PreparedLayer {
        payload: encode_volume(&around).into(),
        facts,
    })
}

/// The part of a layer around the envelope.
fn around(volume: &Volume, envelope: &Envelope, case_from_layer: glam::DAffine3) -> Option<Volume> {
    let grid = envelope.grid();
    let layer_from_voxel = case_from_layer.inverse() * grid.patient_from_voxel();
    let region = Grid::new(grid.size(), layer_from_voxel).ok()?;
    let edges_mm = volume.grid().spacing_mm();
    let shortest_mm = edges_mm.into_iter().fold(f64::INFINITY, f64::min);
    volume.crop_to(&region, (MARGIN_MM / shortest_mm).ceil() as usize)
}

/// The voxels of a stored layer around the envelope, on the grid of their acquisition: a stored 0 is undefined. Of a
/// label map, the stored value is the number of the label in the facts, from 1. `None` if the payload is damaged.
pub fn decode_layer(payload: &[u8]) -> Option<Volume> {
    decode_volume(payload)
}

/// The value of each voxel of a stored layer; NaN if it is undefined. Of a label map, the value of the label.
pub fn numbers_of(volume: &Volume, facts: &LayerFacts, kind: LayerKind) -> Vec<f32> {
    let number = |&code: &u16| match (code, kind) {
        (UNDEFINED_CODE, LayerKind::Labels) => 0.0,
        (UNDEFINED_CODE, _) => f32::NAN,
        (code, LayerKind::Labels) => {
            let label = facts.labels.get(usize::from(code) - 1);
            label.map_or(f32::NAN, |label| label.value as f32)
        }
        (code, _) => volume.intensity(f32::from(code)),
    };
    volume.voxels().iter().map(number).collect()
}
