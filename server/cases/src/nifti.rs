//! What is known of each voxel of a ready case, as NIfTI in the grid of the acquired volume.

use bytes::Bytes;
use case::{CandidateFacts, CaseFacts, CaseId, MapName, ObjectKind, PatientSide, VoxelValues};
use geometry::{DepthField, Grid, as_position, block_of};
use glam::DVec3;
use imaging::nifti::{write_labels, write_mask, write_numbers};
use pipeline::codec::decode_brain;
use pipeline::findings::BRUSH_RADIUS_MM;
use pipeline::maps::{MAP_FORMAT, compute_regions, side_at};
use render::LayerValues;

use crate::library::LoadedMaps;
use crate::{Cases, Error};

/// A gzipped NIfTI-1 file, and the names of its labels if it has some.
#[derive(Debug, Clone)]
pub struct VoxelFile {
    pub bytes: Vec<u8>,
    pub labels: Vec<(u16, String)>,
}

impl Cases {
    /// Values of the voxels of a ready case, in the grid of its acquired volume. The brain and the depth are interpolated there; maps, which
    /// have that grid, are not.
    ///
    /// # Errors
    /// As [`Cases::ready`]; [`Error::LayerNotReady`] or [`Error::MapsUndefined`] if they are of a map; [`Error::Busy`].
    pub async fn nifti(&self, id: &CaseId, values: VoxelValues) -> Result<VoxelFile, Error> {
        let facts = self.ready(id).await?;
        let grid = native_grid(&facts)?;
        let turn = self.queue.turn().await?;
        match values {
            VoxelValues::Brain => {
                let decode = |_: &CaseFacts, payloads: &[Bytes]| {
                    Some(decode_brain(payloads.first()?)?.mask().clone())
                };
                let brain = self.library.load(id, &[ObjectKind::Mask], decode).await?;
                let Some(brain) = brain else {
                    return Err(self.gone(id).await);
                };
                let write = move || plain(write_mask(&brain.resampled(grid)));
                turn.run(write).await?
            }
            VoxelValues::Depth => {
                let model = self.model(id).await?;
                let write =
                    move || plain(write_numbers(&grid, &depths(model.model().field(), &grid)));
                turn.run(write).await?
            }
            VoxelValues::Sides => {
                let model = self.model(id).await?;
                let write = move || {
                    let sides = sides(&facts, model.model().field(), &grid);
                    let names = SIDES.map(|(number, side)| (number, side.name().to_owned()));
                    labelled(&grid, &sides, names.to_vec())
                };
                turn.run(write).await?
            }
            VoxelValues::Regions => {
                let placed = self.placed(id).await?;
                let write = move || {
                    let regions = compute_regions(&facts, &placed.envelope, &placed.volume);
                    let regions = regions.map_err(Error::MapsUndefined)?;
                    let numbers = on_whole(&grid, &regions.grid, &regions.numbers);
                    let numbers: Vec<u16> = numbers.into_iter().map(u16::from).collect();
                    let names = regions.names.into_iter();
                    let names = names.map(|(number, name)| (number.into(), name.to_owned()));
                    labelled(&grid, &numbers, names.collect())
                };
                turn.run(write).await?
            }
            of_map => {
                let name = of_map.map().ok_or(Error::Internal)?;
                let maps = self.map(id, name).await?.maps(&self.library, id).await?;
                let write = move || match of_map.are_places() {
                    true => {
                        let places = maps.places(name);
                        let names = (1..).zip(places);
                        let names = names.map(|(rank, place)| (rank, place_label(rank, place)));
                        labelled(&grid, &painted(places, &grid), names.collect())
                    }
                    false => plain(write_numbers(&grid, &numbers(&maps, name, &grid)?)),
                };
                turn.run(write).await?
            }
        }
    }

    /// Distinguishes files with other values of a case; `None` if they never change.
    ///
    /// # Errors
    /// As [`Cases::layers`].
    pub async fn nifti_version(
        &self,
        id: &CaseId,
        values: VoxelValues,
    ) -> Result<Option<String>, Error> {
        match (values, values.map()) {
            (_, Some(name)) => Ok(Some(self.map(id, name).await?.version())),
            (VoxelValues::Regions, _) => Ok(Some(format!("maps {MAP_FORMAT}"))),
            _ => Ok(None),
        }
    }
}

/// The grid of the acquired volume of a case.
///
/// # Errors
/// [`Error::Internal`] if the facts have none, which no preparation writes.
pub fn native_grid(facts: &CaseFacts) -> Result<Grid, Error> {
    let affine = pipeline::affine_of(&facts.native_patient_from_voxel);
    Grid::new(facts.native_size, affine).map_err(|_| Error::Internal)
}

/// How far from a place it is marked, in mm: half of its size, and at least half a brush, as for findings.
pub fn place_radius_mm(place: &CandidateFacts) -> f64 {
    BRUSH_RADIUS_MM.max(f64::from(place.size_mm) / 2.0)
}

/// The name of a place among labels.
pub fn place_label(rank: u16, place: &CandidateFacts) -> String {
    format!("{rank}: score {:.1}, {}", place.score, place.side.name())
}

fn plain(file: Result<Vec<u8>, imaging::ImagingError>) -> Result<VoxelFile, Error> {
    Ok(VoxelFile {
        bytes: file.map_err(|_| Error::Internal)?,
        labels: Vec::new(),
    })
}

fn labelled(grid: &Grid, numbers: &[u16], labels: Vec<(u16, String)>) -> Result<VoxelFile, Error> {
    let names: Vec<_> = labels
        .iter()
        .map(|(number, name)| (*number, &**name))
        .collect();
    let file = plain(write_labels(grid, numbers, &names))?;
    Ok(VoxelFile { labels, ..file })
}

/// Values of a block of a grid on the whole grid; the default beyond the block.
fn on_whole<T: Copy + Default>(grid: &Grid, block: &Grid, values: &[T]) -> Vec<T> {
    let whole = (grid.first_of(block).map(|along| -along), grid.size());
    block_of(values, block.size(), whole)
}

/// The values of a map; NaN where it is undefined.
fn numbers(maps: &LoadedMaps, name: MapName, grid: &Grid) -> Result<Vec<f32>, Error> {
    let LayerValues::Codes { codes, least, step } = maps.layer(name).values() else {
        return Err(Error::Internal);
    };
    let value = |code: u8| match code {
        0 => f32::NAN,
        code => least + f32::from(code - 1) * step,
    };
    let codes = on_whole(grid, maps.grid(), codes);
    Ok(codes.into_iter().map(value).collect())
}

fn centre(grid: &Grid, index: usize) -> DVec3 {
    grid.patient_from_voxel()
        .transform_point3(as_position(grid.voxel(index)))
}

/// The depth of each voxel; NaN outside the envelope, and where it is unknown.
fn depths(field: &DepthField, grid: &Grid) -> Vec<f32> {
    let mut depths = field.resampled(grid);
    for (index, depth) in depths.iter_mut().enumerate() {
        if *depth < 0.0 || !field.is_known(centre(grid, index), *depth) {
            *depth = f32::NAN;
        }
    }
    depths
}

/// The numbers of the sides.
const SIDES: [(u16, PatientSide); 4] = [
    (1, PatientSide::Left),
    (2, PatientSide::Right),
    (3, PatientSide::Middle),
    (4, PatientSide::Unknown),
];

/// The side of each voxel; 0 outside the envelope.
fn sides(facts: &CaseFacts, field: &DepthField, grid: &Grid) -> Vec<u16> {
    let number = |(index, depth): (usize, f32)| {
        if depth < 0.0 {
            return 0;
        }
        let side = side_at(facts, centre(grid, index));
        let known = SIDES.iter().find(|(_, known)| *known == side);
        known.map_or(0, |(number, _)| *number)
    };
    let depths = field.resampled(grid);
    depths.into_iter().enumerate().map(number).collect()
}

/// The rank of the place at each voxel, or 0. Where two overlap, the higher one is seen.
fn painted(places: &[CandidateFacts], grid: &Grid) -> Vec<u16> {
    let mut ranks = vec![0; grid.voxel_count()];
    let voxel_from_patient = grid.voxel_from_patient();
    for (rank, place) in (1..=places.len() as u16).zip(places).rev() {
        let (middle, radius_mm) = (
            DVec3::from_array(place.position_in_patient),
            place_radius_mm(place),
        );
        let voxel = voxel_from_patient.transform_point3(middle);
        let along = |axis: usize| {
            let reach = radius_mm * voxel_from_patient.matrix3.row(axis).length();
            let end = |end: f64| end.clamp(0.0, grid.size()[axis] as f64) as usize;
            end((voxel[axis] - reach).ceil())..end((voxel[axis] + reach).floor() + 1.0)
        };
        for (z, y) in along(2).flat_map(|z| along(1).map(move |y| (z, y))) {
            for x in along(0) {
                let index = grid.index([x, y, z]);
                if centre(grid, index).distance(middle) <= radius_mm {
                    ranks[index] = rank;
                }
            }
        }
        if let Some(index) = grid.nearest(voxel) {
            ranks[index] = rank;
        }
    }
    ranks
}
