//! Whether the images of a series lie elsewhere in the patient than they did before.

use std::collections::HashMap;

use case::{Case, ObjectKind};
use geometry::Grid;
use glam::DVec3;
use imaging::START_BYTES;
use imaging::dicom::Attributes;
use storage::arrivals::Superseded;
use storage::{StoreError, Upload};

use crate::application::Cases;
use crate::error::Error;

/// How far the corner of an image may move, in mm: numbers may be written with fewer digits.
const ROUNDING_MM: f64 = 0.1;

/// The corners of an image in patient space: its first voxel, the last one of its first row, and that of its first column.
type Corners = [DVec3; 3];

/// Where the images of a volume lie.
struct Places {
    grid: Grid,
    /// By image and frame; none if it is not known which slice is of which image.
    of_images: HashMap<(String, Option<usize>), Corners>,
}

impl Places {
    fn new(source: &Attributes, grid: Grid) -> Self {
        let slices = grid.size()[2];
        let interpolated = &source.interpolated_slices;
        let acquired = (0..slices).filter(|slice| !interpolated.contains(&(slice + 1)));
        let is_known = source.instances.len() + interpolated.len() == slices;
        let images = source.instances.iter().filter(|_| is_known);
        let of_images = images.zip(acquired).map(|(image, slice)| {
            let name = (image.sop_instance_uid.clone(), image.frame);
            (name, corners(&grid, slice))
        });
        Self {
            of_images: of_images.collect(),
            grid,
        }
    }

    /// Whether an image that both have lies elsewhere. If they have none in common, all slices must lie where they did.
    fn differ(&self, other: &Self) -> bool {
        let common = self.of_images.iter();
        let mut common = common
            .filter_map(|(name, corners)| Some((corners, other.of_images.get(name)?)))
            .peekable();
        let is_apart = |one: &Corners, other: &Corners| {
            let mut corners = one.iter().zip(other);
            corners.any(|(one, other)| one.distance(*other) > ROUNDING_MM)
        };
        if common.peek().is_some() {
            return common.any(|(one, other)| is_apart(one, other));
        }
        let last = |grid: &Grid| grid.size()[2].saturating_sub(1);
        self.grid.size() != other.grid.size()
            || [0, last(&self.grid)]
                .into_iter()
                .any(|slice| is_apart(&corners(&self.grid, slice), &corners(&other.grid, slice)))
    }
}

fn corners(grid: &Grid, slice: usize) -> Corners {
    let [columns, rows, _] = grid.size().map(|count| count.saturating_sub(1) as f64);
    let voxels = [[0.0, 0.0], [columns, 0.0], [0.0, rows]];
    voxels.map(|[column, row]| {
        let voxel = DVec3::new(column, row, slice as f64);
        grid.patient_from_voxel().transform_point3(voxel)
    })
}

impl Cases {
    /// Whether the images of an upload lie elsewhere in the patient than those of an older version; also if that is not known.
    pub(crate) async fn is_moved(&self, upload: &Upload, before: &Case) -> Result<bool, Error> {
        let Some(stated) = &upload.dicom else {
            return Ok(false);
        };
        let new = pipeline::attributes(&stated.read().await?)?;
        let old = self.attributes_of(&before.id).await?;
        let limits = self.library.limits();
        let start = upload.volume.head(START_BYTES).await?;
        let grid = imaging::nifti::read_grid(&start, &limits);
        let (Some(old), Ok(grid)) = (old, grid) else {
            return Ok(true);
        };
        let Some(old_grid) = self.grid_of(before).await? else {
            return Ok(true);
        };
        Ok(Places::new(&new, grid).differ(&Places::new(&old, old_grid)))
    }

    /// Why a case has inherited nothing from the version before: its images lie elsewhere, or those were rejected.
    pub(crate) async fn apart_from_previous(
        &self,
        case: &Case,
    ) -> Result<Option<Superseded>, StoreError> {
        let Some(previous) = &case.previous else {
            return Ok(None);
        };
        let before = self.store().series_of(previous).await?;
        let why = before.and_then(|before| before.superseded);
        Ok(why.filter(|why| matches!(why, Superseded::Moved | Superseded::Rejected)))
    }

    /// The grid of the volume of a case in any state; `None` if it is damaged.
    async fn grid_of(&self, case: &Case) -> Result<Option<Grid>, Error> {
        let names = self.store().case_objects(&case.id).await?;
        let read = self
            .store()
            .read(&case.id, &names, ObjectKind::SourceVolume);
        let Some(volume) = read.await? else {
            return Ok(None);
        };
        let start = &volume[..volume.len().min(START_BYTES as usize)];
        Ok(imaging::nifti::read_grid(start, &self.library.limits()).ok())
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3};
    use imaging::dicom::Instance;

    use super::*;

    /// A volume of 10 × 8 voxels of 2 mm and so many slices of 3 mm, the first of which has this number.
    fn places(first: usize, slices: usize, patient_from_voxel: DAffine3) -> Places {
        let image = |number: usize| Instance {
            sop_class_uid: "1".to_owned(),
            sop_instance_uid: format!("1.{number}"),
            frame: None,
            number: None,
        };
        let source = Attributes {
            instances: (first..first + slices).map(image).collect(),
            ..Attributes::default()
        };
        let moved = DAffine3::from_translation(DVec3::Z * 3.0 * first as f64);
        let affine = moved * patient_from_voxel;
        Places::new(&source, Grid::new([10, 8, slices], affine).unwrap())
    }

    #[test]
    fn late_images_move_nothing_and_other_places_of_the_same_images_do() {
        let affine = DAffine3::from_mat3_translation(
            DMat3::from_diagonal(DVec3::new(2.0, 2.0, 3.0)),
            DVec3::new(-9.0, -7.0, 1.0),
        );
        let before = places(5, 10, affine);
        // Further slices on both sides, and rounding.
        assert!(!places(3, 14, affine).differ(&before));
        let rounded = DAffine3::from_translation(DVec3::X * 0.01) * affine;
        assert!(!places(5, 10, rounded).differ(&before));
        // A shift by a whole slice looks like late images, but for the UIDs.
        let shifted = DAffine3::from_translation(DVec3::Z * 3.0) * affine;
        assert!(places(5, 10, shifted).differ(&before));
        let exchanged = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)) * affine;
        assert!(places(5, 10, exchanged).differ(&before));
        // Without a common image, the whole volume counts.
        assert!(places(50, 10, affine).differ(&before));
    }
}
