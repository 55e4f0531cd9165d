//! Values on surfaces, drawn into the voxels of a case.

use std::collections::BTreeMap;

use case::{
    CaseId, Failure, Layer, LayerKind, LayerParameters, SurfaceFacts, SurfaceName, Transform,
};
use geometry::Volume;
use glam::{DVec3, Vec3};
use storage::Spooled;
use worker::{SurfaceReading, Surfaces};

use super::{ReceivedLayer, parameters_of};
use crate::application::Cases;
use crate::dicom::{Drawing, Options, Space};
use crate::error::Error;
use crate::intake::VolumeFiles;
use crate::profile;

/// The fewest vertices in the head that tell whether a surface follows the cortex.
const LEAST_SAMPLES: usize = 500;

/// How far a surface is moved to see whether its place matters, in mm: two thicknesses of the cortex.
const MOVED_MM: f64 = 6.0;

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
    /// Map, which is the default, or labels.
    pub kind: Option<LayerKind>,
    pub unit: Option<String>,
    /// The other parameters. Names of labels are added to those of the files.
    pub parameters: LayerParameters,
}

impl Cases {
    /// Draws surfaces into a volume in the grid of a ready case, which is then a layer as any other.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::Failure`] that states what is wrong with the files, or that the surface fits the head only if it is mirrored;
    /// or an error of the store.
    pub async fn draw_surfaces(&self, new: ReceivedSurfaces) -> Result<ReceivedLayer, Error> {
        let facts = self.ready(&new.case).await?;
        let kind = new.kind.unwrap_or(LayerKind::Map);
        if kind.is_acquired() || new.parameters.transform != Transform::Auto {
            let detail = "values of a surface are a layer of the kind `map` or `labels` without a `transform`, because they lie where the surface lies";
            return Err(Failure::unusable("surface-parameters", detail).into());
        }
        // Before the files are read, which takes long.
        if let Some(name) = &new.name {
            Layer::check_name(name)?;
        }
        let name = new.name.as_deref();
        parameters_of(
            None,
            name,
            Some(kind),
            new.unit.clone(),
            new.parameters.clone(),
        )?;
        let surfaces = Surfaces {
            files: &new.files,
            t1: new.t1.as_ref(),
            drawing: Drawing {
                size: facts.native_size,
                patient_from_voxel: facts.native_patient_from_voxel,
                space: new.space,
                column: new.column,
                are_labels: kind == LayerKind::Labels,
            },
        };
        let scratch = self.store().spools().path();
        let reading: SurfaceReading = self.dicom.read_surfaces(surfaces, &scratch).await?;
        let volume = self.store().spools().take(reading.file()).await?;
        let drawn = reading.drawn;
        let mut labels = match kind {
            LayerKind::Labels => LayerParameters::fitting_labels(drawn.names),
            _ => BTreeMap::new(),
        };
        labels.extend(new.parameters.labels);

        let model = self.surface(&new.case, SurfaceName::Whole).await?;
        let compare = move || {
            let model = model.model();
            let normal = DVec3::from_array(facts.midsagittal.normal);
            let offset_mm = facts.midsagittal.offset_mm;
            let mirrored = |place: DVec3| place - 2.0 * (normal.dot(place) - offset_mm) * normal;
            let samples = drawn.samples.iter();
            let samples = samples.map(|&at| Vec3::from_array(at).as_dvec3());
            SurfaceFacts {
                vertices: drawn.vertices,
                triangles: drawn.triangles,
                thickness_mm: drawn.thickness_mm,
                spread: spread(model.volume(), samples.clone()),
                mirrored_spread: spread(model.volume(), samples.clone().map(mirrored)),
                mirrored_moved_spread: spread(model.volume(), moved(samples.map(mirrored))),
            }
        };
        let surface = self.queue.run(compare).await?;
        if surface.is_mirrored() {
            return Err(Failure::unusable(
                "surface-mirrored",
                "the surface follows the cortex of the case only if it is mirrored: left and right seem to be swapped. Correct the file; nothing else puts its \
                 sides right",
            )
            .into());
        }
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

/// Places that are moved along each axis, both ways.
fn moved(places: impl Iterator<Item = DVec3>) -> impl Iterator<Item = DVec3> {
    let [x, y, z] = DVec3::AXES.map(|axis| MOVED_MM * axis);
    places.flat_map(move |place| [x, -x, y, -y, z, -z].map(|by| place + by))
}

/// The range that holds the middle half of the intensities at some places; `None` if too few of them lie in the volume.
fn spread(volume: &Volume, places: impl Iterator<Item = DVec3>) -> Option<f32> {
    let found = places.filter_map(|place| profile::intensity(volume, place));
    let mut found: Vec<f32> = found.collect();
    if found.len() < LEAST_SAMPLES {
        return None;
    }
    found.sort_by(f32::total_cmp);
    let [low, high] = [1, 3].map(|quarter| found[quarter * (found.len() - 1) / 4]);
    Some(high - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Grid, Rescale};
    use glam::DAffine3;

    #[test]
    fn a_surface_that_follows_a_border_has_a_narrow_spread_and_its_mirror_image_a_wide_one() {
        // A wavy border between dark and bright, which is not its own mirror image.
        let border = |y: f64| 30.0 + 6.0 * (y / 4.0).sin();
        let grid = Grid::new([60, 60, 20], DAffine3::IDENTITY).unwrap();
        let bright = |index: usize| {
            let [x, y, _] = grid.voxel(index).map(|along| along as f64);
            (1000.0 / (1.0 + (border(y) - x).exp())) as u16
        };
        let voxels = (0..grid.voxel_count()).map(bright).collect();
        let rescale = Rescale {
            slope: 1.0,
            intercept: 0.0,
        };
        let volume = Volume::new(grid.clone(), voxels, rescale).unwrap();
        let places = (0..2000).map(|number| {
            let y = 5.0 + f64::from(number % 100) / 2.0;
            DVec3::new(border(y), y, 1.0 + f64::from(number / 200))
        });
        let facts = |places: Vec<DVec3>| {
            let mirrored = places.iter().map(|at| DVec3::new(60.0 - at.x, at.y, at.z));
            SurfaceFacts {
                vertices: 2000,
                triangles: 0,
                thickness_mm: 2.0,
                spread: spread(&volume, places.iter().copied()),
                mirrored_spread: spread(&volume, mirrored.clone()),
                mirrored_moved_spread: spread(&volume, moved(mirrored)),
            }
        };
        let own = facts(places.clone().collect());
        assert_eq!(own.follows_cortex(), Some(true), "{own:?}");
        assert!(!own.is_mirrored());
        let mirrored = facts(
            places
                .clone()
                .map(|at| DVec3::new(60.0 - at.x, at.y, at.z))
                .collect(),
        );
        assert!(mirrored.is_mirrored(), "{mirrored:?}");
        assert_eq!(mirrored.follows_cortex(), Some(false));
        let moved = facts(places.map(|at| at + DVec3::Y * 6.0).collect());
        assert_eq!(moved.follows_cortex(), Some(false), "{moved:?}");
        assert!(!moved.is_mirrored());
        assert_eq!(facts(Vec::new()).follows_cortex(), None);
    }
}
