//! How far positions are from the border of an envelope, inside and outside.

use glam::DVec3;

use crate::transform::transformed;
use crate::{DistanceMap, GeometryError, Grid};

/// The greatest distance that is told apart, in mm.
const REACH_MM: f64 = 15.0;

/// The same in voxels: the greatest distance with a square below 2¹⁵.
const MOST_VOXELS: u8 = 181;

/// The distance from the border of an envelope, in voxels squared, on a grid that reaches 15 mm beyond the working grid.
///
/// Border voxels on a cut are not dura: they are no border here.
#[derive(Debug)]
pub struct BorderField {
    grid: Grid,
    reach: u8,
    /// The axes are x, z, y; negative inside.
    squared: Vec<i16>,
}

impl BorderField {
    /// The field around an envelope.
    ///
    /// # Errors
    /// If the grid has too many voxels.
    pub fn new(distance: &DistanceMap) -> Result<Self, GeometryError> {
        let working = distance.grid();
        let reach = (REACH_MM / working.spacing_mm()[0]).ceil();
        let reach = reach.min(f64::from(MOST_VOXELS)) as u8;
        let margin = usize::from(reach);
        let size = working.size().map(|side| side + 2 * margin);
        let grid = working.block([-(margin as i64); 3], size)?;
        let mut bounds = vec![reach; grid.voxel_count()];
        let there = |index: usize| working.voxel(index).map(|place| place + margin);
        for index in border_voxels(distance) {
            bounds[grid.index(there(index))] = 0;
        }
        let mut squared = transformed(size, &mut bounds, 0, |squared| squared as i16);
        let [nx, _, nz] = size;
        for (index, _) in distance.inside().iter().enumerate().filter(|(_, is)| **is) {
            let [x, y, z] = there(index);
            let value = &mut squared[x + nx * (z + nz * y)];
            *value = -*value;
        }
        Ok(Self {
            grid,
            reach,
            squared,
        })
    }

    /// The signed distance of a position (LPS mm) from the border, in mm, at the nearest voxel centre: negative inside; at most 15 either way.
    pub fn distance_mm(&self, position_in_patient: DVec3) -> f64 {
        let spacing_mm = self.grid.spacing_mm()[0];
        let voxel = self.grid.voxel_from_patient();
        let place = voxel.transform_point3(position_in_patient).round();
        let size = self.grid.size();
        let last = DVec3::from_array(size.map(|side| (side - 1) as f64));
        if place.cmplt(DVec3::ZERO).any() || place.cmpgt(last).any() {
            return f64::from(self.reach) * spacing_mm;
        }
        let [x, y, z] = place.to_array().map(|along| along as usize);
        let squared = self.squared[x + size[0] * (z + size[2] * y)];
        f64::from(squared.abs()).sqrt() * f64::from(squared.signum()) * spacing_mm
    }
}

/// The border voxels of an envelope that are dura.
fn border_voxels(distance: &DistanceMap) -> impl Iterator<Item = usize> + '_ {
    let is_border = |&index: &usize| {
        distance.inside()[index] && distance.squared()[index] == 0 && distance.is_known(index)
    };
    (0..distance.inside().len()).filter(is_border)
}

impl DistanceMap {
    /// The centres of the border voxels of the envelope that are dura, LPS mm.
    pub fn border(&self) -> Vec<DVec3> {
        let grid = self.grid();
        let position = |index: usize| {
            let voxel = DVec3::from_array(grid.voxel(index).map(|place| place as f64));
            grid.patient_from_voxel().transform_point3(voxel)
        };
        border_voxels(self).map(position).collect()
    }

    /// The area of the surface for each of its border voxels, in mm²: on average over all directions, 0.83 border voxels lie on each
    /// square of a voxel's edge.
    pub fn border_voxel_mm2(&self) -> f64 {
        self.grid().spacing_mm()[0].powi(2) / 0.831
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Face, cut_envelope, distance_map, envelope, phantom};

    fn ball(radius: f64) -> DistanceMap {
        distance_map(&envelope(&phantom::ball(radius), 0.0).unwrap())
    }

    #[test]
    fn around_a_ball_it_is_the_distance_to_its_sphere() {
        let distance = ball(20.0);
        let field = BorderField::new(&distance).unwrap();
        let middle = distance.border().iter().sum::<DVec3>() / distance.border().len() as f64;
        for direction in [DVec3::X, -DVec3::Z, DVec3::ONE.normalize()] {
            for from_middle in [8.0, 15.0, 24.0, 33.0] {
                let found = field.distance_mm(middle + direction * from_middle);
                let expected = from_middle - 20.0;
                assert!((found - expected).abs() < 1.5, "{found} {expected}");
            }
            assert_eq!(field.distance_mm(middle), -15.0);
            assert_eq!(field.distance_mm(middle + direction * 45.0), 15.0);
            assert_eq!(field.distance_mm(middle + direction * 500.0), 15.0);
        }
    }

    #[test]
    fn the_area_of_a_sphere_is_that_of_its_border_voxels() {
        let distance = ball(40.0);
        let found = distance.border().len() as f64 * distance.border_voxel_mm2();
        let expected = 4.0 * std::f64::consts::PI * 39.5f64.powi(2);
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
    }

    #[test]
    fn a_cut_is_no_border() {
        let brain = phantom::ellipsoid([20.0, 24.0, 18.0], 1.0);
        let grid = brain.mask().grid();
        let [_, _, height] = grid.size();
        let field_of_view = grid
            .block(
                [0, 0, (height / 2) as i64],
                [grid.size()[0], grid.size()[1], height - height / 2],
            )
            .unwrap();
        let seen = crate::Mask::new(
            grid.clone(),
            (0..grid.voxel_count())
                .map(|index| brain.mask().voxels()[index] && grid.voxel(index)[2] >= height / 2)
                .collect(),
        )
        .unwrap();
        let brain = crate::BrainMask::from_mask(&seen, &field_of_view).unwrap();
        let cuts = brain.cuts(&field_of_view);
        assert_eq!(cuts[0].face, Face::Inferior);
        let cut = distance_map(&cut_envelope(&brain, 10.0, &cuts).unwrap());
        let lowest = cut
            .border()
            .iter()
            .map(|place| place.z)
            .fold(f64::INFINITY, f64::min);
        let plane_mm = cuts[0].offset_mm;
        assert!(lowest > plane_mm + 0.9, "{lowest} {plane_mm}");
        // In the middle of the cut the dura is far.
        let field = BorderField::new(&cut).unwrap();
        let middle = cut.border().iter().sum::<DVec3>() / cut.border().len() as f64;
        let on_cut = DVec3::new(middle.x, middle.y, plane_mm + 1.0);
        assert!(field.distance_mm(on_cut) < -12.0);
    }
}
