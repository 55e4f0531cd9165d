//! The paths of vertices inwards.

use glam::Vec3;

use crate::core_voxels::neighbour_offsets;
use crate::deepest_first::DepthPyramid;
use crate::segment::Corner;
use crate::{DepthField, DistanceMap, Forest};

/// The kind of path that vertices follow.
#[derive(Debug, Clone, Copy)]
pub enum Paths<'a> {
    /// The optimal paths of the second transform, as in the paper.
    Forest(&'a Forest),
    /// The gradient of the distance map: the shortest way to a depth.
    Flow,
}

/// Length of a step up the gradient, in voxels.
const FLOW_STEP: f32 = 0.5;
/// The least gain of depth of such a step that counts as progress, in voxels.
const LEAST_GAIN: f32 = 0.05;

/// Finds the paths of vertices through one case.
pub(crate) struct Walker<'a> {
    distance: &'a DistanceMap,
    field: &'a DepthField,
    paths: Paths<'a>,
    pyramid: Option<DepthPyramid<'a>>,
    offsets: [isize; 26],
}

impl<'a> Walker<'a> {
    pub(crate) fn new(distance: &'a DistanceMap, field: &'a DepthField, paths: Paths<'a>) -> Self {
        let pyramid = matches!(paths, Paths::Flow).then(|| DepthPyramid::new(distance));
        Self {
            distance,
            field,
            paths,
            pyramid,
            offsets: neighbour_offsets(distance.grid().size()),
        }
    }

    pub(crate) fn field(&self) -> &DepthField {
        self.field
    }

    /// The corners of the path of a vertex, from `start` to its end.
    pub(crate) fn way(&self, start: Vec3) -> Box<dyn Iterator<Item = Corner> + '_> {
        let corner = |position| Corner {
            position,
            depth_mm: self.field.depth_mm(position),
        };
        let first = corner(start);
        match self.paths {
            Paths::Forest(forest) => {
                let path = forest.path(self.nearest_inside(start));
                Box::new(std::iter::once(first).chain(path.map(|index| self.centre_corner(index))))
            }
            Paths::Flow => Box::new(std::iter::successors(Some(first), move |&here| {
                self.flow_on(here.position).map(corner)
            })),
        }
    }

    /// The centre of a voxel, with its depth, which needs no interpolation.
    fn centre_corner(&self, index: usize) -> Corner {
        let millimetres = self.field.spacing_mm() / DepthField::STEPS_PER_VOXEL;
        let depth_mm = f32::from(self.field.values()[index]) * millimetres;
        Corner {
            position: self.centre(index),
            depth_mm,
        }
    }

    /// The next point along the gradient: half a voxel further, otherwise the steepest neighbour, otherwise the nearest
    /// deeper voxel.
    fn flow_on(&self, here: Vec3) -> Option<Vec3> {
        let depth = self.field.depth_mm(here);
        let least = depth + LEAST_GAIN * self.field.spacing_mm();
        let middle = here + self.direction(here) * (FLOW_STEP / 2.0);
        let next = here + self.direction(middle) * FLOW_STEP;
        if self.field.depth_mm(next) >= least {
            return Some(next);
        }
        self.steepest_neighbour(here, least)
            .or_else(|| self.pyramid.as_ref()?.nearest_deeper(here, least))
    }

    fn direction(&self, position: Vec3) -> Vec3 {
        self.field.gradient(position).normalize_or_zero()
    }

    /// The voxel centre around a position with the greatest gain of depth per distance that is at least `least` deep.
    fn steepest_neighbour(&self, here: Vec3, least: f32) -> Option<Vec3> {
        let depth = self.field.depth_mm(here);
        let nearest = self.nearest_inside(here);
        let neighbours = self
            .offsets
            .iter()
            .map(|&offset| nearest.wrapping_add_signed(offset));
        let slopes = neighbours.chain([nearest]).filter_map(|neighbour| {
            let gain = self
                .distance
                .depth_mm(neighbour)
                .filter(|&there| there >= least)?
                - depth;
            let centre = self.centre(neighbour);
            Some((gain / centre.distance(here), centre))
        });
        slopes
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, centre)| centre)
    }

    fn centre(&self, index: usize) -> Vec3 {
        Vec3::from_array(self.distance.grid().voxel(index).map(|place| place as f32))
    }

    /// The voxel inside the envelope nearest to a point on its surface or inside.
    fn nearest_inside(&self, position: Vec3) -> usize {
        let grid = self.distance.grid();
        let base = position.floor();
        let mut nearest = (f32::INFINITY, self.distance.deepest());
        for i in 0..8u8 {
            let corner =
                base + Vec3::new(f32::from(i & 1), f32::from(i >> 1 & 1), f32::from(i >> 2));
            let place = corner
                .max(Vec3::ZERO)
                .to_array()
                .map(|place| place as usize);
            let voxel = [0, 1, 2].map(|axis| place[axis].min(grid.size()[axis] - 1));
            let index = grid.index(voxel);
            let distance = corner.distance_squared(position);
            if self.distance.inside()[index] && distance < nearest.0 {
                nearest = (distance, index);
            }
        }
        nearest.1
    }
}
