//! The places of the junction of grey and white matter, and how far others are from it.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::block::{Block, Zone};
use crate::head::Head;
use crate::tissue::tissue_of;
use crate::undefined::MapsUndefined;

/// The value of the junction in the tissue scale: midway between grey and white matter.
const MIDWAY: f32 = 0.5;

/// The edge of a cell of places, in mm.
const CELL_MM: f32 = 3.0;

/// The cells to look at in each direction.
const REACH: i32 = 5;

/// Where intensities cross the middle between grey and white matter.
#[derive(Debug)]
pub struct JunctionPlaces {
    /// LPS mm, by their cell.
    cells: HashMap<[i32; 3], Vec<Vec3>>,
}

impl JunctionPlaces {
    /// The greatest distance that is measured, in mm.
    pub const MAX_MM: f32 = CELL_MM * REACH as f32;

    /// The junction of a head: between neighbouring voxels, of which one is brighter and one darker, interpolated linearly.
    ///
    /// # Errors
    /// If the voxels, the contrast or the envelope are unsuitable.
    pub fn new(head: Head<'_>) -> Result<Self, MapsUndefined> {
        let (block, values, _tissue) = tissue_of(head)?;
        Ok(Self::of(&block, &values))
    }

    fn of(block: &Block, values: &[f32]) -> Self {
        let mut cells: HashMap<[i32; 3], Vec<Vec3>> = HashMap::new();
        let [nx, ny, nz] = block.size;
        for (index, (&value, _)) in values
            .iter()
            .zip(&block.zones)
            .enumerate()
            .filter(|(_, (_, zone))| **zone >= Zone::Tissue)
        {
            let voxel = block.grid.voxel(index);
            for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
                if voxel[axis] + 1 == [nx, ny, nz][axis]
                    || block.zones[index + stride] < Zone::Tissue
                {
                    continue;
                }
                let next = values[index + stride];
                if (value < MIDWAY) == (next < MIDWAY) {
                    continue;
                }
                let mut at = DVec3::from_array(voxel.map(|along| along as f64));
                at[axis] += f64::from((MIDWAY - value) / (next - value));
                let place = block
                    .grid
                    .patient_from_voxel()
                    .transform_point3(at)
                    .as_vec3();
                cells.entry(cell(place)).or_default().push(place);
            }
        }
        Self { cells }
    }

    /// The distance of a place in LPS mm from the nearest one of the junction, at most [`Self::MAX_MM`].
    pub fn distance_mm(&self, place: DVec3) -> f32 {
        let place = place.as_vec3();
        let own = cell(place);
        let mut nearest = Self::MAX_MM;
        for ring in 0..=REACH {
            // What is in this ring or beyond is at least so far.
            if nearest <= (ring - 1) as f32 * CELL_MM {
                break;
            }
            let along = -ring..=ring;
            let planes = along
                .clone()
                .flat_map(|z| along.clone().map(move |y| [y, z]));
            let offsets = planes.flat_map(|[y, z]| along.clone().map(move |x| [x, y, z]));
            for offset in offsets.filter(|offset| offset.iter().any(|step| step.abs() == ring)) {
                let cell = [0, 1, 2].map(|axis| own[axis] + offset[axis]);
                let places = self.cells.get(&cell).map(Vec::as_slice).unwrap_or_default();
                let distances = places.iter().map(|other| other.distance(place));
                nearest = distances.fold(nearest, f32::min);
            }
        }
        nearest
    }
}

fn cell(place: Vec3) -> [i32; 3] {
    (place / CELL_MM)
        .to_array()
        .map(|along| along.floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Grid;
    use glam::DAffine3;

    #[test]
    fn distances_are_those_from_the_place_where_intensities_cross_the_middle() {
        // White for x < 20.25, grey beyond, from a corner of the patient that is not the origin.
        let corner = DVec3::new(-100.0, 7.0, 3.0);
        let grid = Grid::new([40, 12, 12], DAffine3::from_translation(corner)).unwrap();
        let values: Vec<f32> = (0..grid.voxel_count())
            .map(|index| (20.75 - grid.voxel(index)[0] as f32).clamp(-1.0, 2.0))
            .collect();
        let block = Block {
            first: [0; 3],
            size: grid.size(),
            spacing_mm: grid.spacing_mm(),
            zones: vec![Zone::Tissue; values.len()],
            grid,
        };
        let junction = JunctionPlaces::of(&block, &values);
        let distance = |x: f64| junction.distance_mm(corner + DVec3::new(x, 5.0, 6.0));
        for (x, expected) in [
            (20.25, 0.0),
            (21.5, 1.25),
            (8.0, 12.25),
            (0.0, 15.0),
            (500.0, 15.0),
        ] {
            let found = distance(x);
            assert!((found - expected).abs() < 1e-3, "{x}: {found}");
        }
        // Where nothing is tissue, nothing is a junction.
        let outside = Block {
            zones: vec![Zone::Outside; values.len()],
            ..block
        };
        assert!(JunctionPlaces::of(&outside, &values).cells.is_empty());
    }
}
