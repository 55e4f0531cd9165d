//! Whether the images of a series lie elsewhere in the patient than they did before.

use std::collections::HashMap;

use bytes::Bytes;
use case::{Case, CaseId, ObjectKind};
use geometry::Grid;
use glam::DVec3;
use imaging::START_BYTES;
use imaging::dicom::{Attributes, ROUNDING_MM};
use storage::arrivals::Superseded;
use storage::{StoreError, Upload, unless_missing};

use super::tiles::Picture;
use crate::application::Cases;
use crate::error::Error;

/// The corners of an image in patient space: its first voxel, the last one of its first row, and that of its first column.
type Corners = [DVec3; 3];

/// Where the images of a volume lie.
struct Places {
    grid: Grid,
    /// The slice of each image and frame; none if it is not known which slice is of which image.
    of_images: HashMap<(String, Option<usize>), usize>,
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
            (name, slice)
        });
        Self {
            of_images: of_images.collect(),
            grid,
        }
    }

    /// The slices of the images that both have, here and there, in the order in which they lie here. If they have none in common,
    /// all slices, as far as there are as many.
    fn common(&self, other: &Self) -> Vec<[usize; 2]> {
        let both = self.of_images.iter();
        let both = both.filter_map(|(name, slice)| Some([*slice, *other.of_images.get(name)?]));
        let mut both: Vec<_> = both.collect();
        if both.is_empty() {
            let [here, there] = [self, other].map(|places| places.grid.size()[2]);
            both = (0..here.min(there)).map(|slice| [slice; 2]).collect();
        }
        both.sort_unstable();
        both
    }

    /// Whether an image that both have lies elsewhere. If they have none in common, all slices must lie where they did.
    fn differ(&self, other: &Self) -> bool {
        let [size, before] = [self, other].map(|places| places.grid.size());
        let has_common = (self.of_images.keys()).any(|name| other.of_images.contains_key(name));
        let is_comparable = match has_common {
            true => size[..2] == before[..2],
            false => size == before,
        };
        let is_apart = |[here, there]: [usize; 2]| {
            let [here, there] = [corners(&self.grid, here), corners(&other.grid, there)];
            let mut corners = here.iter().zip(there);
            corners.any(|(one, other)| one.distance(other) > ROUNDING_MM)
        };
        !is_comparable || self.common(other).into_iter().any(is_apart)
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

/// The most versions that an upload is compared with.
const MOST_VERSIONS: usize = 8;

impl Cases {
    /// Whether the images of an upload lie elsewhere in the patient than those of an older version, or of one from which that has inherited.
    /// A correction may come in parts, each of which differs little from the one before.
    pub(crate) async fn is_moved_since(
        &self,
        upload: &Upload,
        before: &Case,
    ) -> Result<bool, Error> {
        let Some(stated) = &upload.dicom else {
            return Ok(false);
        };
        let stated = pipeline::attributes(&stated.read().await?)?;
        let volume = upload.volume.read().await?;
        let digest = upload.volume.digest();
        let mut version = Some(before.clone());
        for _ in 0..MOST_VERSIONS {
            let Some(case) = version else { break };
            if self.is_moved(&stated, &volume, digest, &case).await? {
                return Ok(true);
            }
            version = match case.previous {
                Some(previous) if self.apart_from_previous(&case).await?.is_none() => {
                    self.store().case(&previous).await?
                }
                _ => None,
            };
        }
        Ok(false)
    }

    /// Whether images with these attributes and this volume lie elsewhere in the patient than those of an older version, or do not show
    /// what it shows in the same place; also if that is not known.
    async fn is_moved(
        &self,
        new: &Attributes,
        new_volume: &Bytes,
        digest: &blake3::Hash,
        before: &Case,
    ) -> Result<bool, Error> {
        let old = self.attributes_of(&before.id).await?;
        let names = self.store().case_objects(&before.id).await?;
        let kind = ObjectKind::SourceVolume;
        let read = self.store().read(&before.id, &names, kind);
        let Some(old_volume) = unless_missing(read.await)? else {
            return Ok(true);
        };
        let grid =
            |volume: &Bytes| imaging::nifti::read_grid(start(volume), &self.library.limits());
        let (Some(old), Ok(grid), Ok(old_grid)) = (old, grid(new_volume), grid(&old_volume)) else {
            return Ok(true);
        };
        let (new, old) = (Places::new(new, grid), Places::new(&old, old_grid));
        if new.differ(&old) {
            return Ok(true);
        }
        let mut volumes = names.iter().filter(|name| name.kind == kind);
        if volumes.any(|name| name.digest == *digest) {
            return Ok(false);
        }
        let (here, there) = new
            .common(&old)
            .into_iter()
            .map(|[here, there]| (here, there))
            .unzip();
        let new = self.picture(new_volume.clone(), here).await?;
        let old = self.picture(old_volume, there).await?;
        let Some((new, old)) = new.zip(old) else {
            return Ok(true);
        };
        self.queue.run(move || new.is_moved_from(&old)).await
    }

    /// Whether the images of a case lie elsewhere in the patient than those of another case with some of the same images or of their series, or do not
    /// show what it shows in the same place; also if that is not known.
    pub(crate) async fn is_moved_from(&self, case: &CaseId, other: &Case) -> Result<bool, Error> {
        let names = self.store().case_objects(case).await?;
        let mut volumes = names.iter();
        let volume = volumes.find(|name| name.kind == ObjectKind::SourceVolume);
        let read = self.store().read(case, &names, ObjectKind::SourceVolume);
        let (Some(name), Some(volume), Some(source)) = (
            volume,
            unless_missing(read.await)?,
            self.attributes_of(case).await?,
        ) else {
            return Ok(true);
        };
        self.is_moved(&source, &volume, &name.digest, other).await
    }

    /// Whether images with the same UIDs lie elsewhere in one case than in another one. Cases whose volume is damaged do not differ.
    pub(super) async fn lie_apart(
        &self,
        (one, source): (&CaseId, &Attributes),
        (other, other_source): (&CaseId, &Attributes),
    ) -> Result<bool, Error> {
        let (grid, other_grid) = (self.grid_of(one).await?, self.grid_of(other).await?);
        Ok(grid.zip(other_grid).is_some_and(|(grid, other_grid)| {
            Places::new(source, grid).differ(&Places::new(other_source, other_grid))
        }))
    }

    /// The grid of the acquired volume of a case; `None` if that is damaged.
    async fn grid_of(&self, case: &CaseId) -> Result<Option<Grid>, Error> {
        let held = self.store().case(case).await?;
        if let Some(facts) = held.and_then(|case| case.facts) {
            let affine = pipeline::affine_of(&facts.native_patient_from_voxel);
            return Ok(Grid::new(facts.native_size, affine).ok());
        }
        let names = self.store().case_objects(case).await?;
        let read = self.store().read(case, &names, ObjectKind::SourceVolume);
        let limits = self.library.limits();
        let grid = |volume: Bytes| imaging::nifti::read_grid(start(&volume), &limits).ok();
        Ok(unless_missing(read.await)?.and_then(grid))
    }

    /// Slices of a stored volume; `None` if it is damaged.
    async fn picture(&self, volume: Bytes, slices: Vec<usize>) -> Result<Option<Picture>, Error> {
        let room = match self.checks.enter(start(&volume)).await {
            Ok(room) => room,
            Err(Error::Failure(_)) => return Ok(None),
            Err(error) => return Err(error),
        };
        let limits = self.library.limits();
        let work = move || {
            let _room = room;
            let volume = imaging::nifti::read_volume(&volume, &limits).ok()?;
            Some(Picture::new(&volume, &slices))
        };
        self.queue.run(work).await
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
}

/// The part of a file that has its header.
fn start(volume: &Bytes) -> &[u8] {
    &volume[..volume.len().min(START_BYTES as usize)]
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
